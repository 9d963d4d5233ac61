"""Products of commercial satellites and of drones, made small: layout, names and metadata as their makers have them.

Each maker writes into a folder and returns the name that a user would open.
"""

from functools import partial

from rasterio.transform import from_origin

from .makers import MAXAR
from .makers import raster as raster_of

LETTERS = ("C", "B", "G", "Y", "R", "RE", "N", "N2")
raster = partial(raster_of, pixel=2.0)


def imd(letters=LETTERS, satellite="WV02", level="LV2A", enhancement="Off", columns=100, rows=80):
    """An IMD file."""
    bands = "".join(
        f"BEGIN_GROUP = BAND_{letter}\n\tULLon = -1.71;\n\tULLat = 46.04;\n\tabsCalFactor = 9.{i}00000e-03;\n"
        f"\teffectiveBandwidth = {4 + i}.000000e-02;\n\tTDILevel = 24;\nEND_GROUP = BAND_{letter}\n"
        for i, letter in enumerate(letters)
    )
    kind = "Multi" if len(letters) > 1 else letters[0]
    return (
        f'version = "28.3";\ngenerationTime = 2017-07-06T02:14:20.000000Z;\nproductOrderId = "016445286010_01_P001";\n'
        f'productLevel = "{level}";\nradiometricEnhancement = "{enhancement}";\nbandId = "{kind}";\nnumRows = {rows};\n'
        f'numColumns = {columns};\nbitsPerPixel = 16;\ncompressionType = "None";\n{bands}outputFormat = "GeoTIFF";\n'
        f'BEGIN_GROUP = IMAGE_1\n\tsatId = "{satellite}";\n\tmode = "FullSwath";\n\tscanDirection = "Forward";\n'
        "\tTLCTime = 2017-07-05T21:16:35.787350Z;\n\tTLCList = (\n\t(0, 0.000000),\n\t(61440, 12.3) );\n"
        "\tfirstLineTime = 2017-07-05T21:16:35.787350Z;\n\tmeanSunAz = 152.1;\n\tmeanSunEl = 61.5;\n"
        "\tmeanSatAz = 79.7;\n\tmeanSatEl = 66.0;\n\tmeanOffNadirViewAngle = 21.4;\nEND_GROUP = IMAGE_1\nEND;\n"
    )


def imd_xml(letters=LETTERS, satellite="WV02"):
    """The XML file that repeats an IMD file."""
    bands = "".join(
        f"<BAND_{letter}><ULLON>-1.71</ULLON><ABSCALFACTOR>9.{i}e-03</ABSCALFACTOR><EFFECTIVEBANDWIDTH>{4 + i}e-02"
        f"</EFFECTIVEBANDWIDTH></BAND_{letter}>"
        for i, letter in enumerate(letters)
    )
    return (
        f"<isd><IMD><VERSION>28.3</VERSION><PRODUCTLEVEL>LV2A</PRODUCTLEVEL><BANDID>Multi</BANDID>{bands}<IMAGE>"
        f"<SATID>{satellite}</SATID><FIRSTLINETIME>2017-07-05T21:16:35.787350Z</FIRSTLINETIME><MEANSUNEL>61.5</MEANSUNEL>"
        "</IMAGE></IMD></isd>"
    )


def til(tiles, columns, rows):
    """A TIL file: names of tiles, and the first and last column and row of each."""
    groups = "".join(
        f'BEGIN_GROUP = TILE_{i}\n\tfilename = "{name}";\n\tULColOffset = {x0};\n\tULRowOffset = {y0};\n'
        f"\tLRColOffset = {x1 - 1};\n\tLRRowOffset = {y1 - 1};\nEND_GROUP = TILE_{i}\n"
        for i, (name, (x0, x1), (y0, y1)) in enumerate(tiles, start=1)
    )
    return (
        f'bandId = "Multi";\nnumTiles = {len(tiles)};\ntileSizeX = {columns};\ntileSizeY = {rows};\n'
        f'tileUnits = "Pixels";\ntileOverlap = 0;\n{groups}END;\n'
    )


def maxar(folder, sea, *, tiles=1, satellite="WV02", letters=LETTERS, **options):
    """A _MUL folder, with a _PAN folder beside it."""
    blue, green, red, nir = sea
    bands = {"C": blue, "B": blue, "G": green, "Y": green, "R": red, "RE": red, "N": nir, "N2": nir}
    mul, pan = folder / "016445286010_01_P001_MUL", folder / "016445286010_01_P001_PAN"
    arrays = [bands[letter] for letter in letters]
    rows, columns = blue.shape
    parts = [(f"{MAXAR}.TIF", (0, columns))]
    if tiles == 2:
        half = columns // 2
        parts = [(f"{MAXAR}_R1C1.TIF", (0, half)), (f"{MAXAR}_R1C2.TIF", (half, columns))]
    for name, (left, right) in parts:
        raster(mul / name, *[a[:, left:right] for a in arrays],
               transform=from_origin(600_000 + 2 * left, 5_100_000, 2, 2))  # fmt: skip
    (mul / f"{MAXAR}.IMD").write_text(imd(letters, satellite, columns=columns, rows=rows, **options))
    (mul / f"{MAXAR}.TIL").write_text(til([(name, x, (0, rows)) for name, x in parts], columns, rows))
    pan_name = MAXAR.replace("M2AS", "P2AS")
    raster(pan / f"{pan_name}.TIF", nir, pixel=0.5)
    (pan / f"{pan_name}.IMD").write_text(imd(("P",), satellite))
    return folder


def dimap_metadata(tiles, rows, columns, *, mission="PHR", ids=("B2", "B1", "B0", "B3"), listed=True,
                   processing="BASIC",
                   count=None):  # fmt: skip
    """DIM_*.XML (DIMAP 2)."""
    ranges = {"B0": (0.43, 0.55), "B1": (0.50, 0.62), "B2": (0.59, 0.71), "B3": (0.74, 0.94), "P": (0.47, 0.83)}
    measured = "".join(
        f"<Band_Radiance><BAND_ID>{b}</BAND_ID><MEASURE_UNIT>W.sr-1.m-2.micrometers-1</MEASURE_UNIT><GAIN>{g}</GAIN>"
        f"<BIAS>0.5</BIAS></Band_Radiance>"
        for b, g in zip(sorted(ids), (9.0, 10.0, 11.0, 16.0), strict=False)
    ) + "".join(
        f"<Band_Spectral_Range><BAND_ID>{b}</BAND_ID><MEASURE_UNIT>micrometers</MEASURE_UNIT><MIN>{ranges[b][0]}</MIN>"
        f"<MAX>{ranges[b][1]}</MAX></Band_Spectral_Range>"
        for b in sorted(ids)
    )
    places = "".join(
        f'<Data_File tile_R="1" tile_C="{c}"><DATA_FILE_PATH href="{name}"/></Data_File>'
        for c, name in enumerate(tiles, start=1)
    )
    index = "".join(
        f"<Raster_Index><BAND_ID>{b}</BAND_ID><BAND_INDEX>{i}</BAND_INDEX></Raster_Index>"
        for i, b in enumerate(ids, start=1)
    )
    order = f"<Raster_Index_List>{index}</Raster_Index_List>" if listed else ""
    return f"""<?xml version="1.0" encoding="ISO-8859-1" standalone="no"?>
<Dimap_Document xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">
<Metadata_Identification><METADATA_FORMAT version="2.15">DIMAP</METADATA_FORMAT></Metadata_Identification>
<Dataset_Identification><DATASET_NAME>DS_{mission}1A_202201151030456_FR1_PX</DATASET_NAME></Dataset_Identification>
<Coordinate_Reference_System><Projected_CRS><PROJECTED_CRS_CODE>urn:ogc:def:crs:EPSG::32630</PROJECTED_CRS_CODE>
</Projected_CRS></Coordinate_Reference_System>
<Raster_Data><Data_Access><DATA_FILE_ORGANISATION>BAND_COMPOSITE</DATA_FILE_ORGANISATION>
<DATA_FILE_FORMAT>image/tiff</DATA_FILE_FORMAT><DATA_FILE_TILES>true</DATA_FILE_TILES><Data_Files>{places}</Data_Files>
</Data_Access><Raster_Dimensions><NROWS>{rows}</NROWS><NCOLS>{columns}</NCOLS><NBANDS>{count or len(ids)}</NBANDS>
<Tile_Set><NTILES>{len(tiles)}</NTILES><Regular_Tiling><NTILES_SIZE nrows="{rows}" ncols="{columns // len(tiles)}"/>
<NTILES_COUNT ntiles_R="1" ntiles_C="{len(tiles)}"/><OVERLAP_ROW>0</OVERLAP_ROW><OVERLAP_COL>0</OVERLAP_COL>
</Regular_Tiling></Tile_Set></Raster_Dimensions>
<Raster_Encoding><DATA_TYPE>INTEGER</DATA_TYPE><NBITS>16</NBITS><SIGN>UNSIGNED</SIGN></Raster_Encoding>
<Raster_Display>{order}<Band_Display_Order><RED_CHANNEL>B2</RED_CHANNEL><GREEN_CHANNEL>B1</GREEN_CHANNEL>
<BLUE_CHANNEL>B0</BLUE_CHANNEL></Band_Display_Order>
<Special_Value><SPECIAL_VALUE_TEXT>NODATA</SPECIAL_VALUE_TEXT><SPECIAL_VALUE_COUNT>0</SPECIAL_VALUE_COUNT></Special_Value>
<Special_Value><SPECIAL_VALUE_TEXT>SATURATED</SPECIAL_VALUE_TEXT><SPECIAL_VALUE_COUNT>4095</SPECIAL_VALUE_COUNT>
</Special_Value></Raster_Display></Raster_Data>
<Radiometric_Data><Radiometric_Calibration><Instrument_Calibration><Band_Measurement_List>{measured}
</Band_Measurement_List></Instrument_Calibration></Radiometric_Calibration></Radiometric_Data>
<Processing_Information><Product_Settings><SPECTRAL_PROCESSING>MS</SPECTRAL_PROCESSING><Radiometric_Settings>
<RADIOMETRIC_PROCESSING>{processing}</RADIOMETRIC_PROCESSING></Radiometric_Settings></Product_Settings>
</Processing_Information>
<Geometric_Data><Use_Area><Located_Geometric_Values><Acquisition_Angles>
<INCIDENCE_ANGLE unit="deg">12.5</INCIDENCE_ANGLE>
</Acquisition_Angles><Solar_Incidences><SUN_AZIMUTH unit="deg">152.0</SUN_AZIMUTH><SUN_ELEVATION unit="deg">61.0
</SUN_ELEVATION></Solar_Incidences></Located_Geometric_Values></Use_Area></Geometric_Data>
<Dataset_Sources><Source_Identification><Strip_Source><MISSION>{mission}</MISSION><MISSION_INDEX>1A</MISSION_INDEX>
<IMAGING_DATE>2022-01-15</IMAGING_DATE><IMAGING_TIME>10:30:45.6Z</IMAGING_TIME></Strip_Source></Source_Identification>
</Dataset_Sources></Dimap_Document>
"""


def dimap(folder, sea, *, mission="PHR", tiles=2, **options):
    """A folder with VOL, an MS and a P image, as IMG_..._MS_001 and IMG_..._P_001."""
    name = f"{mission}1A_MS_202201151030456_ORT_1234567101-1"
    place = folder / f"IMG_{mission}1A_MS_001"
    rows, columns = sea[0].shape
    blue, green, red, nir = sea
    half = columns // tiles
    names = []
    for c in range(tiles):
        part = (slice(None), slice(c * half, (c + 1) * half))
        names.append(f"IMG_{name}_R1C{c + 1}.TIF")
        raster(place / names[-1], *[a[part] for a in (red, green, blue, nir)],
               transform=from_origin(600_000 + 2 * c * half, 5_100_000, 2, 2))  # fmt: skip
    (place / f"DIM_{name}.XML").write_text(dimap_metadata(names, rows, columns, mission=mission, **options))
    pan = folder / f"IMG_{mission}1A_P_001"
    raster(pan / f"IMG_{name.replace('_MS_', '_P_')}_R1C1.TIF", nir, pixel=0.5)
    (pan / f"DIM_{name.replace('_MS_', '_P_')}.XML").write_text(
        dimap_metadata([f"IMG_{name.replace('_MS_', '_P_')}_R1C1.TIF"], rows, columns, ids=("P",), count=1)
    )
    return folder


VIGNETTE = ((45, 38), (1e-4, -5e-5))  # far stronger than a real one: these images are small
MICASENSE = (("Blue", 475, 32), ("Green", 560, 27), ("Red", 668, 14), ("NIR", 842, 57), ("Red edge", 717, 12))
DJI = (("Green", "G", "560(+/-16)nm"), ("Red", "R", "650(+/-16)nm"), ("RedEdge", "RE", "730(+/-16)nm"),
       ("NIR", "NIR", "860(+/-26)nm"))  # fmt: skip
_XMP = '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
_XMP += 'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">{}</rdf:RDF></x:xmpmeta><?xpacket end="w"?>'


def seq(name, values):
    return f"<{name}><rdf:Seq>{''.join(f'<rdf:li>{v}</rdf:li>' for v in values)}</rdf:Seq></{name}>"


def micasense_xmp(name, centre, width, rig="RedEdge-M"):
    return _XMP.format(
        '<rdf:Description rdf:about="" xmlns:Camera="http://pix4d.com/camera/1.0" '
        f'xmlns:MicaSense="http://micasense.com/MicaSense/1.0/"><Camera:RigName>{rig}</Camera:RigName>'
        f"<Camera:BandName>{name}</Camera:BandName><Camera:CentralWavelength>{centre}</Camera:CentralWavelength>"
        f"<Camera:WavelengthFWHM>{width}</Camera:WavelengthFWHM>"
        + seq("Camera:VignettingCenter", VIGNETTE[0])
        + seq("Camera:VignettingPolynomial", VIGNETTE[1])
        + seq("MicaSense:RadiometricCalibration", (1e-4, 1e-7, 2e-5))
        + seq("MicaSense:DarkRowValue", (4790, 4810)) + "</rdf:Description>"
    )  # fmt: skip


def dji_xmp(name, spread):
    return _XMP.format(
        '<rdf:Description rdf:about="DJI Meta Data" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" '
        f'xmlns:tiff="http://ns.adobe.com/tiff/1.0/" tiff:Model="M3M" drone-dji:BandName="{name}" '
        f'drone-dji:BandFreq="{spread}" drone-dji:ExposureTime="1000" drone-dji:SensorGain="2.000" '
        'drone-dji:SensorGainAdjustment="0.5" drone-dji:BlackLevel="3200" drone-dji:CalibratedOpticalCenterX="45" '
        'drone-dji:CalibratedOpticalCenterY="38" drone-dji:VignettingData="1e-4, 2e-5"/>'
    )


def mosaic_xmp(bands):
    names, centres, widths = zip(*bands, strict=True)
    return _XMP.format(
        '<rdf:Description rdf:about="" xmlns:Camera="http://pix4d.com/camera/1.0">'
        + seq("Camera:BandName", names) + seq("Camera:CentralWavelength", centres)
        + seq("Camera:WavelengthFWHM", widths)
        + "</rdf:Description>"
    )  # fmt: skip


def tagged(xmp, **exif):
    def describe(dataset):
        head, _, rest = xmp.partition("=")  # GDAL wants the text itself, and rasterio gives it NAME=VALUE
        dataset.update_tags(ns="xml:XMP", **{head: rest})
        dataset.update_tags(ns="EXIF", **exif)

    return describe


def micasense(folder, sea, *, more=()):
    """The files of one capture."""
    blue, green, red, nir = (sea + 4800).astype("uint16")
    every = [*zip(MICASENSE, (blue, green, red, nir, red), strict=True), *((b, nir) for b in more)]
    for i, ((name, centre, width), array) in enumerate(every, start=1):
        exif = {"EXIF_ExposureTime": "(0.002)", "EXIF_ISOSpeed": "200"}
        xmp = micasense_xmp(name, centre, width)
        raster(folder / f"IMG_0192_{i}.tif", array, placed=False, describe=tagged(xmp, **exif))
    return folder


def dji(folder, sea):
    """The four bands of one capture."""
    _, green, red, nir = (sea + 3200).astype("uint16")
    for (name, letter, spread), array in zip(DJI, (green, red, red, nir), strict=True):
        place = folder / f"DJI_20220315101112_0001_MS_{letter}.TIF"
        raster(place, array, placed=False, describe=tagged(dji_xmp(name, spread)))
    return folder


def mosaic(folder, sea):
    """A mosaic whose XMP names its bands."""
    blue, green, red, nir = sea
    bands = (blue, green, red, nir, red)
    return raster(folder / "mosaic.tif", *bands, describe=tagged(mosaic_xmp(MICASENSE)))
