"""Names of bands as distributors give them, and what users state of bands: names, wavelengths, scale, sensors."""

import json

import numpy as np
import pytest
import rasterio

from deglint import sensors
from deglint.errors import BandError, DeglintError, InputError, ReadError
from deglint.pipeline import Recipe, remove_glint
from deglint.readers import find_nir, open_scene
from deglint.readers.bands import match, only_numbered, short_names
from deglint.readers.spectral import band_code, example_names, letter_wavelengths, plain_name, wavelength_in_name
from deglint.scene import Band

from .common import SENTINEL2, SHARED, beside, wavelengths


def named(*names):
    return [Band(n) for n in names]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Blue-444", 444),
        ("Red edge 705", 705),
        ("green_530", 530),
        ("SWIR 1610", 1610),
        ("nir_2016", None),
        ("blue 842", None),
        ("band_2200", 2200),
        ("2200", 2200),
        ("2020", None),
        ("T53_20160210_B02", None),
    ],
)
def test_a_number_is_a_wavelength_where_it_agrees_with_the_colour(name, expected):
    assert wavelength_in_name(name) == expected


def test_parts_of_names():
    codes = [band_code(n) for n in ("B02", "SR_B2", "band02", "SREFL_B4", "B8A", "nbart_band03", "blue")]
    assert codes == ["2", "2", "2", "4", "8a", "3", None]
    assert [plain_name(n) for n in ("nbart_red_edge_1", "SR_B2", "Red")] == ["red_edge_1", "b2", "red"]
    assert letter_wavelengths(["R", "G", "B", "NIR"]) == [660.0, 555.0, 485.0, 840.0]
    assert letter_wavelengths(["R", "x"]) == [None, None]
    assert [only_numbered(["Band 1", "Band_2"]), only_numbered(["band02", "band03"])] == [True, False]
    assert [example_names(2), example_names(6)] == ["blue,nir", "blue,green,red,nir,b5,b6"]


@pytest.mark.parametrize(
    ("names", "sensor", "expected"),
    [
        (("B2", "B3", "B4", "B8"), "sentinel2", SENTINEL2),
        (("SREFL_B8", "SREFL_B4"), "sentinel2", ("B08", "B04")),
        (("band08", "band02"), "sentinel2", ("B08", "B02")),
        (("nbart_blue", "nbart_nir_1", "nbart_nir_2", "nbart_swir_2"), "sentinel2", ("B02", "B08", "B8A", "B11")),
        (("nbart_nir", "nbart_swir_2"), "landsat8", ("B5", "B7")),
        (("nir08", "swir16", "blue"), "landsat8", ("B5", "B6", "B2")),
        (("SR_B4", "SR_B1"), "landsat7", ("B4", "B1")),
        (("red_edge", "Coastal_Blue"), "planetscope", ("rededge", "coastal_blue")),
        (("Red edge-717", "Blue-444", "NIR"), "micasense10", ("Red edge", "Blue-444", "NIR")),
        (("R", "RE", "NIR"), "mavic3m", ("Red", "RedEdge", "NIR")),
        (("nir", "pan"), "worldview2", (None, None)),
    ],
)
def test_names_of_distributors_find_the_bands_of_a_sensor(names, sensor, expected):
    if not any(expected):
        with pytest.raises(BandError, match=r"no band name fits.*2 bands"):
            match(named(*names), sensors.load(sensor), ())
        return
    found, how = match(named(*names), sensors.load(sensor), ())
    assert how == "name"
    assert tuple(b.name if b else None for b in found) == expected


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("B2", "B3", "B4", "B8"), [492.4, 559.8, 664.6, 832.8]),
        (("nbart_red_edge_1", "nbart_nir_1", "nbart_swir_3"), [704.1, 832.8, 2202.4]),
        (("SR_B2", "SR_B5", "SR_B6"), [482, 865, 1608]),
        (("SR_B2", "SR_B5"), [None, None]),
        (("R", "G", "B", "NIR"), [660, 555, 485, 840]),
        (("Blue-444", "Red edge 705", "rededge", "NIR"), [444, 705, 720, 840]),
        (("Band 1", "Band 2", "Band 3"), [None, None, None]),
    ],
)
def test_wavelengths_from_names_alone(tmp_path, write, names, expected):
    path = write(tmp_path / "a.tif", np.zeros((len(names), 4, 5), np.uint16), names=names)
    assert wavelengths(open_scene(path)) == expected


@pytest.mark.parametrize(
    ("stems", "expected"),
    [
        (["T53_20160210_B02_10m", "T53_20160210_B8A_20m"], ["B02", "B8A"]),
        (["ortho_red", "ortho_near infrared"], ["red", "near infrared"]),
        (["S2_blue_10m", "S2_green_10m"], ["blue", "green"]),
        (["IMG_0192_1", "IMG_0192_2"], ["IMG_0192_1", "IMG_0192_2"]),
        (["a", "a"], ["a", "a"]),
        (["", "nir"], ["", "nir"]),
    ],
)
def test_files_of_one_band_are_named_after_what_distinguishes_them(stems, expected):
    assert short_names(stems) == expected


@pytest.mark.parametrize(
    ("sensor", "count", "last"),
    [("sentinel2", 4, 832.8), ("sentinel2", 10, 2202.4), ("sentinel2", 12, 2202.4), ("sentinel2", 13, 2202.4),
     ("planetscope", 4, 865), ("worldview3", 4, 832.5), ("worldview3", 8, 950), ("landsat8", 7, 2200)],
)  # fmt: skip
def test_bands_without_names_are_known_by_their_number(tmp_path, write, sensor, count, last):
    path = write(tmp_path / "a.tif", np.zeros((count, 4, 5), np.uint16), names=())
    scene = open_scene(path, sensor=sensor)
    assert wavelengths(scene)[-1] == last
    assert scene.names == tuple(b.name for b in sensors.load(sensor).product(count))
    said = [n for n in scene.notes if "matched by" in n]
    whole = count == len(sensors.load(sensor).bands)
    assert len(said) == 1
    assert ("is assumed to hold" in said[0]) != whole


# what cannot be opened

WHAT = [
    (b"hello\n", "text file"), (b"", "is empty"), (b"<!DOCTYPE html><html>", "web page"),
    (b"\x1f\x8b\x08", "/vsigzip/"),
    (b"PK\x03\x04", "/vsizip/"),
    (b"version https://git-lfs", "git lfs pull"), (b"\0" * 600, "zeros"),
    (b"ENVI\nsamples = 3\n", "image beside it"), (b"\x7fELF\x02\x01\x01\0", "no format that is known"),
]  # fmt: skip


@pytest.mark.parametrize(("head", "says"), WHAT)
def test_what_is_no_raster_is_named_for_what_it_is_and_not_called_truncated(tmp_path, head, says):
    (tmp_path / "a.tif").write_bytes(head)
    with pytest.raises(ReadError, match=f"not a raster.*: it .*{says}") as caught:
        open_scene(tmp_path / "a.tif")
    assert "truncated" not in str(caught.value)


def test_an_output_that_is_forgotten_is_asked_for(deglint, rxdetect, tmp_path, write, sea):
    path = write(tmp_path / "a.tif", sea())
    for program, name in ((deglint, "remove"), (rxdetect, "score")):
        ran = program(name, path)
        assert ran.code == 2
        assert "OUT is missing" in ran.err
        assert f"{name} {path} {path[:-4]}_out.tif" in ran.err


def test_what_was_assumed_is_in_the_log_without_v(deglint, tmp_path, write, sea):
    path = write(tmp_path / "a.tif", sea(), names=())
    run = ("--method", "hedley", "--sample", "all", "--mask", "none")
    ran = deglint("remove", path, tmp_path / "b.tif", "--sensor", "sentinel2", *run)
    assert "assumed to hold B02, B03, B04, B08" in ran.err
    path = write(tmp_path / "three.tif", sea()[1:], names=())
    ran = deglint("remove", path, tmp_path / "c.tif", "--nir", "3", "-b", "1", *run)
    assert "wavelength of band 3" in ran.err
    path = write(tmp_path / "d.tif", sea(), names=("blue", "green", "red", "rededge"))
    ran = deglint("remove", path, tmp_path / "e.tif", "--nir", "4", *run)
    assert "warning: rededge is red edge" in ran.err


# what users state


def test_bands_and_wavelengths_name_a_file_without_metadata(tmp_path, write, sea):
    path = write(tmp_path / "a.tif", sea(), names=())
    with pytest.raises(BandError, match=r'--bands "blue,green,red,nir".*--wavelengths.* 4 bands'):
        find_nir(open_scene(path))
    named = open_scene(path, bands="blue,green,red,nir")
    assert named.names == ("blue", "green", "red", "nir")
    assert find_nir(named) == (3,)
    assert wavelengths(open_scene(path, wavelengths=[0.475, 560, 668, 842])) == [475, 560, 668, 842]
    both = open_scene(path, bands=["a", "b", "c", "d"], wavelengths="475,560,668,842")
    assert both.names == ("a", "b", "c", "d")
    assert find_nir(both) == (3,)


def test_one_band_alone_needs_another_not_a_name(deglint, tmp_path, write):
    said = deglint("info", write(tmp_path / "a.tif", np.ones((1, 20, 20), np.uint16), names=())).out
    assert "stack a NIR band" in said
    assert "--bands" not in said


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 7, 8, 10, 13])
def test_the_message_that_no_band_is_named_is_followed_to_a_result(deglint, tmp_path, write, count):
    import re

    path = write(tmp_path / "a.tif", np.ones((count, 20, 20), np.uint16), names=())
    said = deglint("info", path).out
    (names,) = re.findall(r'--bands ("[^"]*")', said)
    assert names.count(",") == count - 1
    scene = open_scene(path, bands=names.strip('"'))
    assert find_nir(scene)
    assert deglint("info", path, "--bands", names.strip('"')).code == 0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"bands": "blue,nir"}, r"--bands gives 2 and .*a\.tif has 4 bands.*; -b chooses"),
        ({"bands": "1,2,3,4"}, r"use -b 1,2,3,4"),
        ({"bands": "a,b,a,d"}, r"two bands the name 'a'"),
        ({"bands": "a,,c,d"}, r"name 2 of 4 is empty"),
        ({"bands": 4}, r"bands: want names such as .*got 4"),
        ({"wavelengths": "475,560,blue,842"}, r"--wavelengths: want numbers such as 475,560,668,842.*475,560,blue,842"),
        ({"wavelengths": [475, 560, 668, 90]}, r"allowed is 100 to 20000 nm .*got 90"),
        ({"wavelengths": (475, 560)}, r"--wavelengths gives 2 and "),
        ({"scale": 0}, r"--scale: want numbers other than 0 such as 0\.0001, got 0\b"),
        ({"scale": True}, r"--scale: want"),
        ({"offset": [1, 2, 3]}, r"--offset gives 3 and "),
        ({"offset": "nan"}, r"--offset: want numbers"),
        ({"nodata": "none at all"}, r"nodata .*want a number"),
        ({"sensor": 3}, r"sensor: want a file name.* 3"),
        ({"nir": 4.0}, r"want a band by name or by number \(from 1\)"),
    ],
)
def test_wrong_values_are_named_in_one_line(tmp_path, write, options, says):
    path = write(tmp_path / "a.tif", np.zeros((4, 4, 5), np.uint16), names=())
    with pytest.raises(DeglintError, match=says) as caught:
        open_scene(path, **options)
    assert "\n" not in str(caught.value)


def test_names_are_unique_beside_one_that_is_numbered(tmp_path, write):
    names = ("a", "a", "a (2)", "A")
    found = open_scene(write(tmp_path / "a.tif", np.zeros((4, 4, 5), np.uint16), names=names)).names
    assert found[:2] == ("a", "a (2)")
    assert len(set(map(str.casefold, found))) == 4


@pytest.mark.parametrize("path", [None, 3, b"a.tif", np.zeros((2, 2)), ["a.tif", 3]])
def test_what_is_no_name_of_a_file_is_said_so(path):
    with pytest.raises(InputError, match="path: want a file name, got "):
        open_scene(path)


def test_a_fourth_band_that_gdal_takes_for_alpha_is_the_nir_where_bands_are_named(tmp_path, write):
    array = np.full((4, 4, 5), 9, np.uint8)
    path = write(tmp_path / "a.tif", array, names=(), photometric="rgb", alpha="yes")
    plain = open_scene(path)
    assert len(plain.bands) == 3
    assert any("band 4 is used as alpha" in n and "--bands" in n for n in plain.notes)
    with pytest.raises(BandError, match=r'beyond 700 nm.*for alpha.*--bands "red,green,blue,nir"'):
        find_nir(plain)
    assert find_nir(open_scene(path, bands="red,green,blue,nir")) == (3,)


def test_scale_and_offset_win_over_the_file_and_the_output_says_them(tmp_path, write, sea, read):
    def declare(dataset):
        dataset.scales, dataset.offsets = (0.5,) * 4, (7.0,) * 4

    path = write(tmp_path / "a.tif", sea(), describe=declare)
    scene = open_scene(path, scale=1e-4, offset=(-0.1, -0.1, -0.1, 0))
    raw = read(path)
    np.testing.assert_allclose(scene.read()[0], raw[0] * 1e-4 - 0.1, atol=1e-7)
    np.testing.assert_allclose(scene.read()[3], raw[3] * 1e-4, atol=1e-7)
    out = tmp_path / "out.tif"
    remove_glint(path, out, Recipe(method="hedley", sample="all", mask="none"), scale="1e-4", offset=-0.1)
    with rasterio.open(out) as dataset:
        assert dataset.scales == (1e-4,) * 4
        assert dataset.offsets == (-0.1,) * 4
        np.testing.assert_array_equal(dataset.read(4), raw[3])


# a sensor of one's own

CAMERA = """
[mycam]
title = "My camera"
bands = [
  { name = "deep", wavelength = 450, width = 30, time_offset = 0.0 },
  { name = "lime", aliases = ["L"], wavelength = 550, time_offset = 0.1 },
  { name = "far", wavelength = 860, time_offset = 0.2 },
]
products = [["lime", "far"]]
optics = { f_number = 4, pixel_pitch = 5 }
"""


def test_a_sensor_of_ones_own(tmp_path, write):
    from deglint.readers.bands import optics_of

    toml = tmp_path / "cam.toml"
    toml.write_text(CAMERA)
    scene = open_scene(write(tmp_path / "a.tif", np.zeros((3, 4, 5), np.uint16), names=()), sensor=toml)
    assert scene.names == ("deep", "lime", "far")
    assert [b.time_offset for b in scene.bands] == [0, 0.1, 0.2]
    assert optics_of(scene)["f_number"] == 4
    two = open_scene(write(tmp_path / "b.tif", np.zeros((2, 4, 5), np.uint16), names=()), sensor=str(toml))
    assert wavelengths(two) == [550, 860]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("wavelength = 550", "wavelenght = 550", r"bands, entry 2: 'wavelenght' is not one of name, wavelength, width"),
        ("wavelength = 550, ", "", r"bands, entry 2: wavelength is missing; needed are name, wavelength"),
        ("wavelength = 550", 'wavelength = "550"', r"bands, entry 2: wavelength: .*number.* '550'"),
        ("wavelength = 550", "wavelength = 0.55", r"wavelength: allowed is 300 to 20000 nm.* 0\.55"),
        ('"lime", "far"]', '"lime", "near"]', r"products: want lists of deep, lime, far"),
        ("f_number", "fnumber", r"\[mycam\] optics: 'fnumber' is not one of aperture, focal_length"),
        ('"lime", "far"]', '"lime", ["far"]]', r"products: want lists of deep, lime, far"),
        ("width = 30", "width = -3", r"bands, entry 1: width: .*finite number above 0.* -3"),
        ("width = 30", "width = true", r"bands, entry 1: width: .*finite number above 0.* True"),
        ("time_offset = 0.1", "time_offset = inf", r"bands, entry 2: time_offset: .*number.* inf"),
        ("f_number = 4", "aperture = 0, focal_length = 1", r"optics: aperture: .*finite number above 0.* 0"),
        (CAMERA.partition("bands")[2].partition("products")[0], " = []\n", r"\[mycam\]: bands is empty"),
        ('["L"]', "[1]", r"\[mycam\] bands, entry 2: aliases: want texts in quotes.* \[1\]"),
        ("[mycam]", "", r"want one table, such as \[mycamera\]"),
        ("title = ", "title : ", "is not TOML"),
    ],
)
def test_a_sensor_file_with_a_mistake_names_key_and_what_is_allowed(tmp_path, write, old, new, says):
    toml = tmp_path / "cam.toml"
    assert old in CAMERA
    toml.write_text(CAMERA.replace(old, new, 1))
    path = write(tmp_path / "a.tif", np.zeros((3, 4, 5), np.uint16), names=())
    with pytest.raises(InputError, match=says) as caught:
        open_scene(path, sensor=str(toml))
    assert "\n" not in str(caught.value)
    with pytest.raises(ReadError, match=r"no such file: none\.toml"):
        open_scene(path, sensor="none.toml")


# beside the project


@beside()
def test_shared_four_bands_without_names(deglint):
    path = SHARED / "real" / "sdb" / "image.tif"
    assert "taken for blue,green,red,nir" in deglint("info", path).err
    found = json.loads(deglint("info", path, "--bands", "blue,green,red,nir", "--json").out)
    assert found["nir"] == ["nir"]
    assert 0 < found["r2"]["blue"] < 1
    assert wavelengths(open_scene(path, sensor="sentinel2")) == [492.4, 559.8, 664.6, 832.8]


@beside()
def test_shared_ten_bands_are_named_as_the_cameras_name_them():
    scene = open_scene(SHARED / "real" / "micasense" / "aligned_0192.tif")
    assert wavelengths(scene)[5:] == [444, 531, 650, 705, 740]
    assert find_nir(scene) == (3,)
    assert None not in [b.width for b in open_scene(scene.path, sensor="micasense10").bands]
