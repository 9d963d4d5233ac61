"""Products made small: their own layout and file names, metadata cut down from real ones, some thousand pixels.

Each maker writes into a folder and returns the name that a user would open.
"""

import json
import tarfile
import zipfile

import numpy as np
import pytest
from rasterio.transform import from_origin

from ..common import write_bare

UTM = "EPSG:32630"
CODES = ("B1", "B2", "B3", "B4", "B5", "B6", "B7", "B8", "B8A", "B9", "B10", "B11", "B12")
CENTRES = (442.7, 492.7, 559.8, 664.6, 704.1, 740.5, 782.8, 832.8, 864.7, 945.1, 1373.5, 1613.7, 2202.4)
S2 = "S2A_MSIL{}_20220622T105631_N0400_R094_T30TXR_20220622T154313"
L2 = "LC09_L2SP_130039_20220311_20220314_02_T1"
L1 = "LC08_L1TP_130039_20220311_20220314_02_T1"
PLANET = "20220310_100530_83_2420"
MAXAR = "17JUL05211635-M2AS-016445286010_01_P001"


def raster(path, *bands, pixel=10.0, placed=True, **options):
    """Write bands (row, column) as a raster; a name that ends in .jp2 becomes a lossless JPEG 2000."""
    path.parent.mkdir(parents=True, exist_ok=True)
    jpeg = {"driver": "JP2OpenJPEG", "QUALITY": "100", "REVERSIBLE": "YES"} if path.suffix == ".jp2" else {}
    place = {"crs": UTM, "transform": from_origin(600_000, 5_100_000, pixel, pixel)} if placed else {}
    write_bare(path, np.stack(bands), **(jpeg | place | options))
    return path


def packed(folder, kind, place):
    """A zip or tar of a folder, without folders of its own above it for a tar."""
    place.parent.mkdir(parents=True, exist_ok=True)
    files = [f for f in sorted(folder.rglob("*")) if f.is_file()]
    if kind == "zip":
        with zipfile.ZipFile(place, "w") as archive:
            for file in files:
                archive.write(file, file.relative_to(folder.parent))
    else:
        with tarfile.open(place, "w") as archive:
            for file in files:
                archive.add(file, f"./{file.relative_to(folder)}")
    return place


def sentinel2_metadata(level, *, offset=-1000, baseline="04.00"):
    """MTD_MSIL1C.xml or MTD_MSIL2A.xml."""
    tag, quantum = ("RADIO", "QUANTIFICATION_VALUE") if level == "1C" else ("BOA", "BOA_QUANTIFICATION_VALUE")
    offsets = "".join(f'<{tag}_ADD_OFFSET band_id="{i}">{offset}</{tag}_ADD_OFFSET>' for i in range(13))
    spectral = "".join(
        f'<Spectral_Information bandId="{i}" physicalBand="{code}"><RESOLUTION>10</RESOLUTION><Wavelength>'
        f'<MIN unit="nm">{centre - 40:g}</MIN><MAX unit="nm">{centre + 40:g}</MAX><CENTRAL unit="nm">{centre}</CENTRAL>'
        '</Wavelength><Spectral_Response><STEP unit="nm">4</STEP><VALUES>0.1 0.4 0.8 1 0.9 0.6 0.2</VALUES>'
        "</Spectral_Response></Spectral_Information>"
        for i, (code, centre) in enumerate(zip(CODES, CENTRES, strict=True))
    )
    name = "PRODUCT_URI"
    return f"""<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<n1:Level-{level}_User_Product xmlns:n1="https://psd-14.sentinel2.eo.esa.int/PSD/User_Product_Level-{level}.xsd">
<n1:General_Info><Product_Info>
<PRODUCT_START_TIME>2022-06-22T10:56:31.024Z</PRODUCT_START_TIME>
<{name}>{S2.format(level)}.SAFE</{name}>
<PROCESSING_LEVEL>Level-{level}</PROCESSING_LEVEL><PROCESSING_BASELINE>{baseline}</PROCESSING_BASELINE>
<Datatake><SPACECRAFT_NAME>Sentinel-2A</SPACECRAFT_NAME></Datatake></Product_Info>
<Product_Image_Characteristics>
<Special_Values><SPECIAL_VALUE_TEXT>NODATA</SPECIAL_VALUE_TEXT><SPECIAL_VALUE_INDEX>0</SPECIAL_VALUE_INDEX></Special_Values>
<Special_Values><SPECIAL_VALUE_TEXT>SATURATED</SPECIAL_VALUE_TEXT><SPECIAL_VALUE_INDEX>65535</SPECIAL_VALUE_INDEX></Special_Values>
<{quantum} unit="none">10000</{quantum}>
{f"<Offset_List>{offsets}</Offset_List>" if offset is not None else ""}
<Spectral_Information_List>{spectral}</Spectral_Information_List>
</Product_Image_Characteristics></n1:General_Info></n1:Level-{level}_User_Product>
"""


def sentinel2(folder, sea, level="2A", *, metadata=None, masks="jp2"):
    """A .SAFE folder: bands of 10, 20 and 60 m, and detectors 5 and 6 side by side."""
    safe = folder / f"{S2.format(level)}.SAFE"
    granule = safe / "GRANULE" / f"L{level}_T30TXR_A026117_20220622T105647"
    blue, green, red, nir = sea + 1000
    coarse = nir[::2, ::2]
    bands = {"B01": (blue[::6, ::6], 60), "B02": (blue, 10), "B03": (green, 10), "B04": (red, 10), "B05": (coarse, 20),
             "B08": (nir, 10), "B11": (coarse, 20)}  # fmt: skip
    for name, (array, pixel) in bands.items():
        if level == "1C":
            place = granule / "IMG_DATA" / f"T30TXR_20220622T105631_{name}.jp2"
        else:
            place = granule / "IMG_DATA" / f"R{pixel}m" / f"T30TXR_20220622T105631_{name}_{pixel}m.jp2"
        raster(place, array, pixel=pixel)
        detectors = np.full(array.shape, 5, np.uint8)
        detectors[:, array.shape[1] // 2 :] = 6
        detectors[0] = 0
        if masks == "jp2":
            raster(granule / "QI_DATA" / f"MSK_DETFOO_{name}.jp2", detectors, pixel=pixel)
    if level == "2A":
        raster(granule / "IMG_DATA" / "R20m" / "T30TXR_20220622T105631_B02_20m.jp2", blue[::2, ::2], pixel=20)
        raster(granule / "IMG_DATA" / "R20m" / "T30TXR_20220622T105631_SCL_20m.jp2", coarse.astype("uint8"), pixel=20)
    if metadata != "":
        (safe / f"MTD_MSIL{level}.xml").write_text(metadata or sentinel2_metadata(level))
    return safe


MTL = """GROUP = LANDSAT_METADATA_FILE
  GROUP = PRODUCT_CONTENTS
    LANDSAT_PRODUCT_ID = "{name}"
    PROCESSING_LEVEL = "{processing}"
    COLLECTION_NUMBER = 02
  END_GROUP = PRODUCT_CONTENTS
  GROUP = IMAGE_ATTRIBUTES
    SPACECRAFT_ID = "LANDSAT_{digit}"
    DATE_ACQUIRED = 2022-03-11
    SCENE_CENTER_TIME = "03:47:32.6439190Z"
    SUN_AZIMUTH = 137.01927455
    SUN_ELEVATION = 50.00000000
  END_GROUP = IMAGE_ATTRIBUTES
{surface}  GROUP = LEVEL1_MIN_MAX_PIXEL_VALUE
{full}  END_GROUP = LEVEL1_MIN_MAX_PIXEL_VALUE
  GROUP = LEVEL1_RADIOMETRIC_RESCALING
{level1}  END_GROUP = LEVEL1_RADIOMETRIC_RESCALING
END_GROUP = LANDSAT_METADATA_FILE
END
"""


def factors(mult, add, numbers):
    return "".join(f"    REFLECTANCE_MULT_BAND_{n} = {mult}\n    REFLECTANCE_ADD_BAND_{n} = {add}\n" for n in numbers)


def landsat(folder, sea, level=2, *, form="txt"):
    """Bands 1 to 7 (and 9 of Level 1) and the metadata; water near 0.02 of reflectance."""
    name, digit = (L2, 9) if level == 2 else (L1, 8)
    place = folder / name
    blue, green, red, nir = (sea + 7300).astype("uint16")
    nir[0, :5] = 0
    for n, array in enumerate((blue, blue, green, red, nir, nir // 2, nir // 3), start=1):
        raster(place / f"{name}_{'SR_' if level == 2 else ''}B{n}.TIF", array, pixel=30)
    full = "".join(f"    QUANTIZE_CAL_MAX_BAND_{n} = 65535\n" for n in range(1, 10))
    surface = "  GROUP = LEVEL2_SURFACE_REFLECTANCE_PARAMETERS\n" + full + factors("2.75e-05", "-0.2", range(1, 8))
    surface += "  END_GROUP = LEVEL2_SURFACE_REFLECTANCE_PARAMETERS\n"
    if level == 1:
        raster(place / f"{name}_B8.TIF", np.repeat(np.repeat(nir, 2, 0), 2, 1), pixel=15)
        raster(place / f"{name}_B9.TIF", nir, pixel=30)
    text = MTL.format(name=name, digit=digit, processing=name.split("_")[1], full=full,
                      surface=surface if level == 2 else "",
                      level1=factors("2.0000E-05", "-0.100000", range(1, 10)))  # fmt: skip
    if form == "json":
        from deglint.readers.products.metadata import groups_of

        text = json.dumps({"LANDSAT_METADATA_FILE": {k: v for k, v in groups_of(text).items() if k}})
    if form == "xml":
        from deglint.readers.products.metadata import groups_of

        inner = ((g, "".join(f"<{k}>{v}</{k}>" for k, v in vs.items())) for g, vs in groups_of(text).items() if g)
        text = f"<LANDSAT_METADATA_FILE>{''.join(f'<{g}>{v}</{g}>' for g, v in inner)}</LANDSAT_METADATA_FILE>"
    (place / f"{name}_MTL.{form}").write_text(text)
    return place


def planet_metadata(coefficients, instrument="PSB.SD"):
    """The XML of an AnalyticMS image."""
    bands = "".join(
        f"<ps:bandSpecificMetadata><ps:bandNumber>{i}</ps:bandNumber><ps:radiometricScaleFactor>0.01"
        f"</ps:radiometricScaleFactor><ps:reflectanceCoefficient>{c}</ps:reflectanceCoefficient></ps:bandSpecificMetadata>"
        for i, c in enumerate(coefficients, start=1)
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<ps:EarthObservation xmlns:ps="http://schemas.planet.com/ps/v1/planet_product_metadata_geocorrected_level"
  xmlns:eop="http://earth.esa.int/eop" xmlns:opt="http://earth.esa.int/opt" xmlns:gml="http://www.opengis.net/gml">
<gml:using><eop:EarthObservationEquipment><eop:instrument><eop:Instrument><eop:shortName>{instrument}</eop:shortName>
</eop:Instrument></eop:instrument><eop:acquisitionParameters><ps:Acquisition>
<opt:illuminationElevationAngle uom="deg">51.3</opt:illuminationElevationAngle>
<ps:acquisitionDateTime>2022-03-10T10:05:30+00:00</ps:acquisitionDateTime></ps:Acquisition></eop:acquisitionParameters>
</eop:EarthObservationEquipment></gml:using><gml:resultOf><ps:EarthObservationResult>{bands}</ps:EarthObservationResult>
</gml:resultOf></ps:EarthObservation>"""


def planetscope(folder, sea, count=4, *, surface=False, instrument="PS2.SD", metadata=True):
    """One image of a scene with its XML, its JSON and its mask of usable data."""
    place = folder / "PSScene"
    blue, green, red, nir = sea
    every = sea if count == 4 else (blue, blue, green, green, red, red, nir, nir)
    end = "_8b" if count == 8 else ""
    raster(place / f"{PLANET}_3B_AnalyticMS{'_SR' if surface else ''}{end}.tif", *every, pixel=3, photometric="RGB")
    raster(place / f"{PLANET}_3B_udm2.tif", *[np.ones_like(blue)] * 8, pixel=3)
    if metadata:
        (place / f"{PLANET}_3B_AnalyticMS{end}_metadata.xml").write_text(
            planet_metadata([2.1e-05 + 1e-07 * i for i in range(count)], instrument)
        )
    (place / f"{PLANET}_metadata.json").write_text(json.dumps({"id": PLANET, "properties": {"view_angle": 3.1}}))
    return place


def check(scene, kind, facts):
    """What must be known of a product that was opened."""
    info = scene.source.info
    bands = facts["bands"] | facts.get("more", {})
    assert {b.name: b.wavelength for b in scene.bands} == pytest.approx(bands)
    assert list(bands) == list(scene.names)
    assert all(b.width and b.width > 0 for b in scene.bands)
    assert scene.sensor == facts["sensor"]
    assert (info.scales[0], info.offsets[0], info.units[0]) == pytest.approx(
        (facts["scale"], facts["offset"], facts["unit"])
    )
    assert set(info.nodatas) == {facts["nodata"]}
    full = None if facts["full"] is None else pytest.approx(facts["full"] * info.scales[0] + info.offsets[0])
    assert scene.bands[0].saturation == full
    assert scene.notes[0].startswith(f"{kind}, product ")
