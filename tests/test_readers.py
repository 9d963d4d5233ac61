"""Opening scenes: bands, wavelengths, sensors, several files."""

import math
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp
from rasterio.transform import Affine
from rasterio.warp import transform, transform_bounds

from deglint.errors import BandError, InputError, ReadError
from deglint.readers import band_roles, find_nir, open_scene
from deglint.readers.spectral import nanometres, nominal_wavelength, wavelength_in_name

from .common import NAMES, SHARED, beside, says, wavelengths
from .common import write_bare as write

GDAL = tuple(int(n) for n in rasterio.__gdal_version__.split(".")[:2])
WV3 = ("COASTAL", "BLUE", "GREEN", "YELLOW", "RED", "REDEDGE", "NIR1", "NIR2")


def place(x, y, width, height):
    return Affine(width, 0, x, 0, -height, y)


def zeros(count, dtype="uint16"):
    return np.zeros((count, 4, 5), dtype)


@pytest.mark.parametrize(
    "tags",
    [
        [{"wavelength": "490"}, {"wavelength": "842"}],
        [{"WAVELENGTH": "0.49"}, {"WAVELENGTH": "0.842"}],
        [{"wavelength": "490 nm"}, {"wavelength": "0.842 um"}],
        [{"center_wavelength": "0.49 µm"}, {"Centre Wavelength": "842"}],
        [{"wavelength": "0.49", "wavelength_units": "Micrometers"}] * 1 + [{"wavelength_nm": "842.0"}],
        [{"CENTRAL_WAVELENGTH_UM": "0.490"}, {"wl": "842"}],
    ],
)
def test_wavelengths_from_band_tags(tmp_path, tags):
    scene = open_scene(write(tmp_path / "a.tif", zeros(2), band_tags=tags))
    assert wavelengths(scene) == pytest.approx([490, 842])


@pytest.mark.parametrize("value", ["{0.49, 0.842}", "0.49,0.842", "[0.49 0.842]"])
def test_wavelengths_from_a_list_in_the_dataset(tmp_path, value):
    path = write(
        tmp_path / "a.tif", zeros(2), describe=lambda d: d.update_tags(ns="ENVI", wavelength=value, fwhm="{0.03, 0.1}")
    )
    scene = open_scene(path)
    assert wavelengths(scene) == pytest.approx([490, 842])
    assert [b.width for b in scene.bands] == pytest.approx([30, 100])


@pytest.mark.parametrize("units", ["Micrometers", "Nanometers", "Angstroms", None])
def test_envi_file(tmp_path, units):
    path = write(tmp_path / "a.img", zeros(3), driver="ENVI")
    factor = {"Micrometers": 1, "Angstroms": 10_000}.get(units, 1000)
    listed = ", ".join(f"{w * factor:g}" for w in (0.49, 0.56, 0.842))
    with (tmp_path / "a.hdr").open("a") as header:
        header.write(f"\nwavelength = {{{listed}}}\nfwhm = {{{20e-3 * factor}, {30e-3 * factor}, {0.1 * factor}}}\n")
        header.write(f"wavelength units = {units}\n" if units else "")
    scene = open_scene(path)
    assert wavelengths(scene) == pytest.approx([490, 560, 842])
    assert [b.width for b in scene.bands] == pytest.approx([20, 30, 100])
    assert find_nir(scene) == (2,)


def test_nonsense_in_tags_is_no_wavelength(tmp_path):
    tags = [{"wavelength": "blue"}, {"wavelength": "nan"}, {"wavelength": "-3"}, {"wavelength": "5e9"}]
    tags = [t | {"time_offset_s": "soon"} for t in tags]
    scene = open_scene(write(tmp_path / "a.tif", zeros(4), band_tags=tags))
    assert wavelengths(scene) == [None] * 4
    assert {b.time_offset for b in scene.bands} == {None}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("NIR1", 840),
        ("nir", 840),
        ("Blue", 485),
        ("Coastal", 440),
        ("coastal_blue", 440),
        ("Red Edge", 720),
        ("RedEdge-705", 720),
        ("rededge2", 740),
        ("Band 5 - Near Infrared", 840),
        ("SWIR 2", 2200),
        ("green_i", 531),
        ("red and blue", None),
        ("pan", None),
        ("B8", None),
        ("", None),
    ],
)
def test_colour_words(name, expected):
    assert nominal_wavelength(name) == expected


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("band_0.490", 490),
        ("Rrs_443", 443),
        ("865nm", 865),
        ("NIR (0.842 um)", 842),
        ("Blue 450-520 nm", 485),
        ("Band 1 - Blue (450-520 nm)", 485),
        ("0.45-0.51 um", 480),
        ("Green 520\u2013600 nm", 560),
        ("green 520 nm to 600 nm", 560),
        ("Red 0.63um - .69um", 660),
        ("blue 443 nm (400-500 nm)", 443),
        ("Band 2 - 2.2 um", 2200),
        ("Band 1-444 nm", 444),
        ("v1.5-560nm", 560),
        ("2016-490 nm", 490),
        ("705 nm-20 nm", 705),
        ("Band 3", None),
        ("B08", None),
        ("2016", None),
        ("scene 490", None),
        ("1.5.2", None),
    ],
)
def test_numbers_in_names(name, expected):
    assert wavelength_in_name(name) == expected


def test_ranges_in_names_give_roles(tmp_path):
    names = ["Blue 450-520 nm", "Green 520-600 nm", "Red 630-690 nm", "NIR 770-890 nm"]
    scene = open_scene(write(tmp_path / "a.tif", zeros(4), names=names))
    assert wavelengths(scene) == [485, 560, 660, 830]
    assert find_nir(scene) == (3,)


@pytest.mark.parametrize(("width", "expected"), [("10", 10), ("1", 1), ("0.02", 20)])
def test_a_width_of_no_known_unit_has_that_which_its_size_suggests(tmp_path, width, expected):
    tags = [{"wavelength": "490", "wavelength_units": "Unknown", "fwhm": width}]
    (band,) = open_scene(write(tmp_path / "a.tif", zeros(1), band_tags=tags)).bands
    assert (band.wavelength, band.width) == (490, expected)


def test_wavelengths_are_converted_from_units_or_by_size():
    assert nanometres(20000, "Wavenumber") is None
    assert nanometres(30) == 30000
    assert nanometres(31) == 31
    assert nanometres(0.49, "nanometers") == 0.49
    assert [nanometres(0.49, unit) for unit in ("N/A", "None", "nan")] == [490] * 3


def test_sentinel2_codes_give_wavelengths(tmp_path):
    scene = open_scene(write(tmp_path / "a.tif", zeros(4), names=["B02", "B8A", "B11", "SCL"]))
    assert wavelengths(scene) == [492.4, 864.7, 1613.7, None]
    (note,) = scene.notes
    assert says(note, "Sentinel-2", "assumed")
    ambiguous = open_scene(write(tmp_path / "b.tif", zeros(2), names=["B2", "B8"]))
    assert wavelengths(ambiguous) == [None, None]


def test_bands_without_names(tmp_path):
    scene = open_scene(write(tmp_path / "a.tif", zeros(3)))
    assert scene.names == ("band 1", "band 2", "band 3")
    doubled = open_scene(write(tmp_path / "b.tif", zeros(3), names=["x", "X", None]))
    assert doubled.names == ("x", "X (2)", "band 3")


def test_full_scale_is_the_saturation_in_physical_units(tmp_path):
    path = write(tmp_path / "a.tif", zeros(2), tags={"FULL_SCALE": "4095"})
    with rasterio.open(path, "r+") as dataset:
        dataset.scales, dataset.offsets = (0.5, 1), (0, -10)
    assert [b.saturation for b in open_scene(path).bands] == [2047.5, 4085]


@pytest.mark.parametrize(
    ("dtype", "nodata", "expected"),
    [("uint8", None, 255), ("int16", 0, 32767), ("uint16", 65535, None), ("int32", None, None), ("float32", 0, None)],
)
def test_without_full_scale_small_integers_are_full_at_their_largest(tmp_path, dtype, nodata, expected):
    scene = open_scene(write(tmp_path / "a.tif", zeros(1, dtype), nodata=nodata))
    assert scene.bands[0].saturation == expected


def test_sensor_by_name(tmp_path):
    tags = [{"wavelength": "830"}, {}, {}]
    path = write(tmp_path / "a.tif", zeros(3), names=["first", "Coastal", "pan"], band_tags=tags)
    scene = open_scene(path, sensor="WV3")
    assert scene.sensor == "worldview3"
    assert [(b.wavelength, b.group) for b in scene.bands] == [(830, None), (425, "MS2"), (None, None)]
    assert "worldview3 has no band first, pan" in scene.notes
    assert any("time offsets of worldview3 are not verified" in n for n in scene.notes)


def test_sensor_by_order_and_by_wavelength(tmp_path):
    ordered = open_scene(write(tmp_path / "a.tif", zeros(8)), sensor="worldview2")
    assert [b.group for b in ordered.bands] == ["MS2", "MS1", "MS1", "MS2", "MS1", "MS2", "MS1", "MS2"]
    assert ordered.bands[6].time_offset == 0.324
    tags = [{"wavelength": w} for w in ("668", "475", "842")]
    mosaic = open_scene(write(tmp_path / "b.tif", zeros(3), band_tags=tags), sensor="micasense")
    assert [b.width for b in mosaic.bands] == [14, 32, 57]


@pytest.mark.parametrize(
    ("sensor", "count", "says"),
    [
        ("worldview3", 3, "4 or 8 bands, not 3.*band 1, band 2, band 3; the preset has COASTAL, BLUE"),
        ("micasense", 5, "come in more than one band order"),
    ],
)
def test_sensor_that_does_not_fit(tmp_path, sensor, count, says):
    with pytest.raises(BandError, match=says) as caught:
        open_scene(write(tmp_path / "a.tif", zeros(count)), sensor=sensor)
    assert "\n" not in str(caught.value)


def test_order_is_refused_where_wavelengths_contradict_it(tmp_path):
    tags = [{"wavelength": w} for w in ("950", "660", "560", "480")]
    with pytest.raises(BandError, match="not those of the preset"):
        open_scene(write(tmp_path / "a.tif", zeros(4), band_tags=tags), sensor="geoeye1")


def test_sensor_from_a_tag_is_used_where_it_fits(tmp_path):
    fits = open_scene(
        write(tmp_path / "a.tif", zeros(8), describe=lambda d: d.update_tags(ns="IMAGERY", SATELLITEID="WV02"))
    )
    assert fits.sensor == "worldview2"
    other = open_scene(write(tmp_path / "b.tif", zeros(2), tags={"sensor": "worldview-3"}))
    assert other.sensor is None
    assert any("tags is not used" in n for n in other.notes)


def test_an_unknown_sensor_is_refused(tmp_path):
    with pytest.raises(InputError, match="no sensor preset 'hubble'"):
        open_scene(write(tmp_path / "a.tif", zeros(1)), sensor="hubble")


def test_opening_reads_no_pixel(tmp_path, monkeypatch):
    path = write(tmp_path / "a.tif", zeros(2))
    monkeypatch.setattr(rasterio.io.DatasetReader, "read", None, raising=False)
    with pytest.raises(TypeError):
        rasterio.open(path).read()
    assert open_scene(path).shape == (2, 4, 5)


def test_no_such_file_and_not_a_raster_differ(tmp_path):
    text = tmp_path / "notes.txt"
    text.write_text("not a raster")
    for missing in (tmp_path / "none.tif", f"/vsizip/{tmp_path}/none.zip/a.tif", f"zip://{tmp_path}/none.zip!a.tif"):
        with pytest.raises(ReadError, match=r"no such file: .*none"):
            open_scene(missing)
    for other in (text, tmp_path):
        with pytest.raises(ReadError, match="not a raster"):
            open_scene(other)
    with pytest.raises(InputError, match="at least one file"):
        open_scene([])


@pytest.mark.parametrize("name", ["/vsizip/{}/a.tif", "zip://{}!a.tif"])
def test_names_that_only_gdal_knows(tmp_path, name):
    write(tmp_path / "a.tif", zeros(2) + np.uint16(3))
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.write(tmp_path / "a.tif", "a.tif")
    scene = open_scene(name.format(tmp_path / "a.zip"))
    assert scene.read().min() == 3
    assert (scene.crs, scene.transform) == (None, None)


def test_vrt_with_bands_of_two_types(tmp_path):
    write(tmp_path / "a.tif", zeros(1, "uint8") + np.uint8(200))
    write(tmp_path / "b.tif", zeros(1, "int16") - np.int16(5))
    source = '<SimpleSource><SourceFilename relativeToVRT="1">{}.tif</SourceFilename></SimpleSource>'
    bands = [
        f'<VRTRasterBand dataType="{kind}" band="{i}">{source.format(name)}</VRTRasterBand>'
        for i, (kind, name) in enumerate((("Byte", "a"), ("Int16", "b")), start=1)
    ]
    vrt = tmp_path / "a.vrt"
    vrt.write_text(f'<VRTDataset rasterXSize="5" rasterYSize="4">{"".join(bands)}</VRTDataset>')
    scene = open_scene(vrt)
    raw, valid = scene.source.read_raw(((0, 4), (0, 5)))
    assert raw.dtype == np.int16
    assert valid is None
    assert [b.min() for b in raw] == [200, -5]


def test_info_keeps_what_a_writer_needs(tmp_path):
    path = write(
        tmp_path / "a.tif",
        np.zeros((2, 32, 32), "uint16"),
        names=["red", "nir"],
        tags={"AUTHOR": "me"},
        band_tags=[{"a": "1"}, {"b": "2"}],
        nodata=9,
        compress="deflate",
        predictor=2,
        tiled=True,
        blockxsize=16,
        blockysize=16,
        interleave="band",
        crs="EPSG:32653",
        transform=place(5e5, 1e6, 10, 10),
    )
    info = open_scene(path).source.info
    assert (info.driver, info.compression, info.predictor, info.interleave) == ("GTiff", "deflate", "2", "band")
    assert info.block_shapes == ((16, 16), (16, 16))
    assert info.tiled
    assert info.nodatas == (9, 9)
    assert info.dtype == np.uint16
    assert info.descriptions == ("red", "nir")
    assert info.tags[""]["AUTHOR"] == "me"
    assert [t[""] for t in info.band_tags] == [{"a": "1"}, {"b": "2"}]
    assert info.mask_flags == (("nodata",), ("nodata",))
    assert info.crs.to_epsg() == 32653
    assert info.transform.c == 5e5


# several files


def ramp(size, step, start=0.0, dtype="float32"):
    """One band whose value is the column's place on the ground, sampled at pixel centres."""
    columns = start + (np.arange(size) + 0.5) * step
    return np.broadcast_to(columns, (1, size, size)).astype(dtype)


UTM = {"crs": "EPSG:32653"}


def test_coarse_band_is_resampled_bilinear_to_the_finest(tmp_path):
    coarse = write(tmp_path / "T53_B8A.tif", ramp(10, 20), **UTM, transform=place(5e5, 1e6, 20, 20))
    fine = write(tmp_path / "T53_B02.tif", ramp(20, 10), **UTM, transform=place(5e5, 1e6, 10, 10))
    scene = open_scene([coarse, fine])
    assert scene.shape == (2, 20, 20)
    assert scene.names == ("B8A", "B02")
    assert wavelengths(scene) == [864.7, 492.4]
    assert any("resampled (bilinear)" in n for n in scene.notes)
    image = scene.read()
    np.testing.assert_allclose(image[0, :, 1:-1], image[1, :, 1:-1], atol=1e-3)
    np.testing.assert_array_equal(scene.read(((3, 9), (4, 12)), [0]), image[:1, 3:9, 4:12])
    np.testing.assert_array_equal(scene.read(None, ["B02", "B8A"]), image[::-1])
    named = open_scene([coarse, fine], grid="B8A.tif")
    assert named.shape == (2, 10, 10)
    np.testing.assert_allclose(named.read()[1], ramp(10, 20)[0], atol=1e-3)
    assert open_scene([coarse, fine], grid=1).shape == (2, 10, 10)
    with pytest.raises(InputError, match=r"^grid: .*'finest'.*1-2.*\b3\b"):
        open_scene([coarse, fine], grid=3)


def test_files_of_one_size_are_read_as_they_are(tmp_path):
    paths = [write(tmp_path / f"B0{i}.tif", zeros(1) + np.uint16(i), **UTM, nodata=i % 2) for i in (2, 3)]
    scene = open_scene(paths)
    assert scene.source.files[0].warp is None
    assert scene.source.info.nodatas == (0, 1)
    assert [b[0, 0] for b in scene.read()] == [2, 3]


def test_files_without_georeference_cover_the_same_ground(tmp_path):
    coarse = write(tmp_path / "coarse.tif", ramp(10, 20))
    fine = write(tmp_path / "fine.tif", ramp(20, 10))
    image = open_scene([fine, coarse]).read()
    np.testing.assert_allclose(image[1, :, 1:-1], image[0, :, 1:-1], atol=1e-3)


@pytest.mark.parametrize(("dtype", "nodata"), [("uint16", None), ("uint16", 7), ("float32", None), ("float32", -1)])
def test_ground_that_a_file_does_not_cover_is_not_valid(tmp_path, dtype, nodata):
    fine = write(tmp_path / "a.tif", np.ones((1, 20, 20), dtype), **UTM, transform=place(5e5, 1e6, 10, 10))
    there = place(5e5 + 100, 1e6, 20, 20)
    east = write(tmp_path / "b.tif", np.full((1, 10, 10), 3, dtype), **UTM, transform=there, nodata=nodata)
    scene = open_scene([fine, east])
    image = scene.read()
    assert np.isnan(image[1, :, :9]).all()
    np.testing.assert_array_equal(image[1, :, 10:], 3)
    raw, valid = scene.source.read_raw(((0, 20), (0, 20)))
    np.testing.assert_array_equal(scene.source.to_physical(raw, valid), image)


def test_masked_pixels_do_not_leak_when_resampled(tmp_path):
    fine = write(tmp_path / "a.tif", np.ones((1, 20, 20), "uint16"), **UTM, transform=place(5e5, 1e6, 10, 10))
    coarse = np.full((1, 10, 10), 100, "uint16")
    coarse[0, 4:6] = 5000
    path = write(tmp_path / "b.tif", coarse, **UTM, transform=place(5e5, 1e6, 20, 20))
    mask = np.where(coarse[0] == 5000, 0, 255).astype("uint8")
    with rasterio.open(path, "r+") as dataset:
        dataset.write_mask(mask)
    band = open_scene([fine, path]).read(bands=[1])[0]
    assert np.isnan(band[9:11]).all()
    assert set(np.unique(band[np.isfinite(band)])) == {100}


@pytest.fixture
def regridded(tmp_path):
    """Write an array as a file of 20 m pixels, and read it on the grid of another one of 10 m; NaN becomes -1."""
    fine = write(tmp_path / "fine.tif", np.ones((1, 20, 20), "uint8"), **UTM, transform=place(5e5, 1e6, 10, 10))

    def resampled(array, *, mask=None, colours=None, given=None, **options):
        path = tmp_path / "coarse.tif"
        with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True):
            write(path, array, **UTM, transform=place(5e5, 1e6, 20, 20), **options)
            with rasterio.open(path, "r+") as dataset:
                if mask is not None:
                    dataset.write_mask(mask)
                if colours is not None:
                    dataset.colorinterp = colours
        return np.nan_to_num(open_scene([fine, path], nodata=given).read()[1:], nan=-1)

    return resampled


@pytest.mark.parametrize(("dtype", "nodata"), [("uint16", 0), ("uint16", 7), ("float32", -9999), ("float32", np.nan)])
def test_nodata_of_one_band_alone_does_not_leak_when_resampled(regridded, dtype, nodata):
    array = np.full((2, 10, 10), 500, dtype)
    array[0, :5] = nodata
    found = regridded(array, nodata=nodata)
    assert set(np.unique(found[0])) == {-1, 500}
    assert (found[0, :9] == -1).all()
    assert (found[1] == 500).all()


@pytest.mark.parametrize(
    "hides",
    [
        "alpha",
        pytest.param("mask", marks=pytest.mark.skipif(GDAL >= (3, 12), reason="GDAL ignores a mask beside nodata")),
    ],
)
def test_nodata_beside_a_mask_or_alpha_does_not_leak_when_resampled(regridded, hides):
    array, mask = np.full((2, 10, 10), 500, "uint16"), np.full((10, 10), 65535, "uint16")
    array[:, :3], mask[:3], array[0, 5:8] = 12345, 0, 0
    if hides == "mask":
        found = regridded(array, mask=mask != 0, nodata=0)
    else:
        colours = [ColorInterp.gray, ColorInterp.undefined, ColorInterp.alpha]
        named = ["red", "nir", "alpha"]
        found = regridded(np.concatenate([array, mask[None]]), colours=colours, names=named, nodata=0)
    assert set(np.unique(found)) == {-1, 500}
    assert (found[:, :5] == -1).all()
    assert (found[0, 11:15] == -1).all()
    assert (found[1, 8:] == 500).all()


@pytest.mark.parametrize("second", [65535, None])
@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_each_band_of_a_resampled_file_has_its_own_nodata(tmp_path, second, dtype):
    array = np.full((3, 10, 10), 500, dtype)
    array[:, 2:4], array[:, 6:8] = 0, 65535
    bands = [write(tmp_path / f"{i}.tif", array[i : i + 1], **UTM, transform=place(5e5, 1e6, 20, 20)) for i in range(3)]
    given = "".join(
        f'<VRTRasterBand dataType="{"UInt16" if dtype == "uint16" else "Float32"}" band="{i}">'
        f"{f'<NoDataValue>{n}</NoDataValue>' if n is not None else ''}"
        f"<SimpleSource><SourceFilename>{path}</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand>"
        for i, (path, n) in enumerate(zip(bands, (0, second, 0), strict=True), start=1)
    )
    (tmp_path / "e.vrt").write_text(
        f'<VRTDataset rasterXSize="10" rasterYSize="10"><SRS>{UTM["crs"]}</SRS>'
        f"<GeoTransform>500000, 20, 0, 1000000, 0, -20</GeoTransform>{given}</VRTDataset>"
    )
    fine = write(tmp_path / "fine.tif", np.ones((1, 20, 20), "uint8"), **UTM, transform=place(5e5, 1e6, 10, 10))
    scene = open_scene([fine, tmp_path / "e.vrt"])
    found = scene.read()[1:]
    middle, high, low = found[:, ::19], found[:, 13:15], found[:, 5:7]
    assert (middle == 500).all()
    assert np.isnan(low[[0, 2]]).all()
    assert (high[[0, 2]] == 65535).all()
    assert (low[1] == 0).all()
    assert np.isnan(high[1]).all() if second else (high[1] == 65535).all()
    np.testing.assert_array_equal(scene.read(((3, 16), (2, 9)), [3, 2]), found[[2, 1], 3:16, 2:9])
    with scene.source as source:
        raw, valid = source.read_raw(((0, 20), (0, 20)))
        np.testing.assert_array_equal(source.to_physical(raw, valid)[1:], found)


def test_every_number_is_data_in_a_resampled_file_too(regridded):
    array = np.full((1, 10, 10), 500, "uint16")
    array[:, :5] = 0
    assert (regridded(array, nodata=0, given="none")[0, :8] == 0).all()


def test_a_band_that_gdal_takes_for_alpha_is_not_resampled(regridded):
    with pytest.raises(InputError, match=r"coarse\.tif: .*for alpha.*-colorinterp_4 undefined"):
        regridded(np.full((4, 10, 10), 9, "uint8"), names=NAMES, photometric="rgb", alpha="yes")


def test_the_smallest_pixels_are_the_finest_in_degrees_too(tmp_path):
    files = [
        write(tmp_path / f"{i}.tif", np.ones((1, size, size)), crs="EPSG:4326", transform=place(23, 37, step, step))
        for i, (size, step) in enumerate([(10, 2e-5), (20, 1e-5), (20, 1e-5 * (1 + 1e-12))])
    ]
    assert open_scene(files[:2]).source.info.paths == (files[0], files[1])
    assert open_scene(files[:2]).shape == (2, 20, 20)
    assert open_scene([files[0], *files[:0:-1]]).transform.a == 1e-5 * (1 + 1e-12)  # the first of equal ones


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_file_without_crs_lies_in_that_of_the_other(tmp_path, order):
    paths = [
        write(
            tmp_path / f"{i}.tif",
            np.full((1, 10, 10), 500, "uint16"),
            transform=place(5e5 + 5 * i, 1e6, 10, 10),
            crs=crs,
        )
        for i, crs in enumerate(("EPSG:32653", None))
    ]
    image = open_scene([paths[i] for i in order]).read()
    assert np.isfinite(image).mean() > 0.9


@pytest.mark.parametrize(("crs", "x"), [('LOCAL_CS["local",UNIT["metre",1]]', 5e5), ("EPSG:3031", 1e30)])
def test_a_file_that_cannot_be_placed_is_one_line(tmp_path, crs, x):
    fine = write(tmp_path / "a.tif", np.ones((1, 20, 20)), **UTM, transform=place(5e5, 1e6, 10, 10))
    other = write(tmp_path / "b.tif", np.ones((1, 10, 10)), crs=crs, transform=place(x, 1e6, 20, 20))
    with pytest.raises(InputError, match=r"b\.tif cannot be placed.*CRS of .*a\.tif: .*Check its CRS"):
        open_scene([fine, other])


def test_a_reprojected_file_does_not_depend_on_the_window(tmp_path):
    (left,), (top,) = transform("EPSG:32653", "EPSG:3857", [7e5 - 100], [4e6 + 500])
    numbers = np.random.default_rng(0).random((1, 350, 350), "float32")
    turned = write(tmp_path / "b.tif", numbers, crs="EPSG:3857", transform=place(left, top, 13, 13))
    fine = write(tmp_path / "a.tif", np.ones((1, 600, 600), "uint8"), **UTM, transform=place(7e5, 4e6, 5, 5))
    scene = open_scene([fine, turned])
    part = scene.read(((0, 300), (0, 300)), [1])
    np.testing.assert_allclose(scene.read(None, [1])[:, :300, :300], part, atol=3e-4)


def test_other_crs_is_warped_and_other_places_are_refused(tmp_path):
    fine = write(tmp_path / "a.tif", ramp(20, 10), **UTM, transform=place(5e5, 1e6, 10, 10))
    left, bottom, right, top = transform_bounds("EPSG:32653", "EPSG:4326", 5e5, 1e6 - 200, 5e5 + 200, 1e6)
    around = place(left - 0.001, top + 0.001, (right - left + 0.002) / 9, (top - bottom + 0.002) / 9)
    degree = write(tmp_path / "b.tif", np.full((1, 9, 9), 4.0, "float32"), crs="EPSG:4326", transform=around)
    scene = open_scene([fine, degree])
    with ThreadPoolExecutor(2) as pool:
        parts = list(pool.map(scene.read, [((0, 10), (0, 20)), ((10, 20), (0, 20))] * 4))
    np.testing.assert_allclose([p[1] for p in parts], 4)
    far = write(tmp_path / "c.tif", ramp(20, 10), **UTM, transform=place(7e5, 1e6, 10, 10))
    with pytest.raises(InputError, match=r"c\.tif.*a\.tif do not overlap"):
        open_scene([fine, far])
    nowhere = write(tmp_path / "d.tif", ramp(10, 10))
    with pytest.raises(InputError, match=r"d\.tif.*no coordinate reference system.*another size"):
        open_scene([fine, nowhere])


def test_files_on_one_rotated_grid_are_not_resampled(tmp_path):
    turned = Affine(math.cos(0.5), -math.sin(0.5), 5e5, math.sin(0.5), math.cos(0.5), 1e6)
    paths = [write(tmp_path / f"{i}.tif", zeros(1) + np.uint16(i), **UTM, transform=turned) for i in (1, 2)]
    scene = open_scene(paths)
    assert scene.source.files[1].warp is None
    assert scene.transform.b != 0


def test_import_is_light():
    code = (
        "import sys, deglint.readers, deglint.sensors;"
        "print([m for m in ('rasterio', 'numba', 'scipy', 'cv2', 'tomllib') if m in sys.modules])"
    )
    root = Path(__file__).parents[1]
    out = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


# scenes beside the project


@beside()
def test_shared_simulated_scene():
    scene = open_scene(SHARED / "simulated" / "wind09_delay60.tif")
    assert scene.names == WV3
    assert wavelengths(scene) == [425, 480, 545, 605, 660, 725, 832.5, 950]
    assert [b.time_offset for b in scene.bands] == pytest.approx([0.06 * i for i in range(8)])
    image = scene.read()
    full = np.array([b.saturation for b in scene.bands]).reshape(-1, 1, 1)
    raw, _ = scene.source.read_raw(((0, 384), (0, 384)))
    np.testing.assert_array_equal(image >= full * (1 - 1e-6), raw == 4095)
    assert find_nir(scene) == (6,)
    assert open_scene(scene.path, sensor="thesis").bands[1].width == 60


@beside()
@pytest.mark.parametrize(("name", "nir", "swir"), [("palau", 7, 10), ("wistari", 7, 11), ("casablanca", 3, 4)])
def test_shared_sentinel2_scenes(name, nir, swir):
    scene = open_scene(SHARED / "sentinel2" / f"{name}.tif", sensor="sentinel2")
    assert find_nir(scene) == (nir,)
    assert band_roles(scene)["swir"] == swir
    assert scene.bands[scene.index("B04")].time_offset == 1.005
    assert np.isfinite(scene.read(((0, 50), (0, 50)))).all()
