"""What a file does not say: numbers that mean no data, and an offset that a cut product has lost."""

import cv2
import numpy as np
import pytest
from rasterio.transform import from_origin

from deglint import Recipe, correct, fit_scene, open_scene
from deglint.errors import InputError
from deglint.masks import fit_water, water
from deglint.readers.roles import find_nir
from deglint.readers.undeclared import settled, undeclared
from deglint.xr import remove as remove_array

from .common import ROLES, SENTINEL2


def bordered(sea, value, dtype="float32", **options):
    """A sea with a border of one number and a ragged corner of it."""
    scene = sea(100, 120, dtype=dtype, **options)
    scene[:, :6] = value
    scene[:, np.add.outer(np.arange(100), np.arange(120)) < 30] = value
    return scene


@pytest.mark.slow
@pytest.mark.parametrize(
    ("value", "dtype"),
    [(0, "uint16"), (65535, "uint16"), (-999, "int16"), (-9999, "float32"), (-3e38, "float32"), (1e20, "float64")],
)
def test_a_border_of_one_number_is_left_out_and_kept_to_the_bit(value, dtype, sea, write, read, deglint, tmp_path):
    scene = bordered(sea, value, dtype)
    source, out = write(tmp_path / "in.tif", scene), tmp_path / "out.tif"
    assert settled(open_scene(source)).source.info.nodatas == (float(np.array(value, dtype)),) * 4
    ran = deglint("remove", source, out, "--compensate", "off")
    assert ran.code == 0, ran.err
    assert ran.err.count("taken for nodata") == ran.err.count("--nodata none") == 1
    fill, got = (scene == np.array(value, dtype)).all(axis=0), read(out)
    np.testing.assert_array_equal(got[:, fill], scene[:, fill])
    assert (got != scene)[:3][:, ~fill].mean() > 0.5
    whole = deglint("remove", source, tmp_path / "same.tif", "--compensate", "off", "--nodata", value)
    assert whole.code == 0, whole.err
    np.testing.assert_array_equal(got, read(tmp_path / "same.tif"))


def test_nodata_none_says_that_they_are_data(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", bordered(sea, 0, "uint16"))
    assert settled(open_scene(source, nodata="none")).source.info.nodatas == (None,) * 4
    with pytest.raises(InputError, match=r'nodata .*"none".*want a number'):
        open_scene(source, nodata="all")


@pytest.mark.parametrize(("value", "dtype"), [(0, "uint16"), (-9999, "float32")])
def test_a_border_is_left_out_before_files_are_resampled(value, dtype, sea, write, tmp_path):
    coarse, fine = (sea(60, 60, dtype=dtype)[:2].repeat(n, 1).repeat(n, 2) for n in (1, 2))
    coarse[:, :20], fine[:, :40] = value, value
    ends = {20: {"transform": from_origin(400_000, 800_000, 20, 20)}, 10: {}}
    found = []
    for nodata in (None, value):
        files = [
            write(tmp_path / f"{step}_{nodata}.tif", array, names=names, nodata=nodata, **ends[step])
            for step, array, names in ((10, fine, ("blue", "green")), (20, coarse, ("red", "nir")))
        ]
        found.append(settled(open_scene(files)))
    assert [scene.source.info.nodatas for scene in found] == [(value,) * 4] * 2
    np.testing.assert_array_equal(*(scene.read() for scene in found))
    assert np.nanmin(found[0].read()) > 50


def test_info_and_rxdetect_say_the_same(sea, write, deglint, tmp_path):
    from detect.cli import run as rxdetect

    source = write(tmp_path / "in.tif", bordered(sea, -9999))
    said = deglint("info", source)
    assert "-9999 in all bands" in said.out + said.err
    assert rxdetect(["score", source, str(tmp_path / "s.tif"), "--mask", "water"]) == 0


def test_a_band_of_dark_water_that_is_often_0_keeps_its_zeros(sea, write, tmp_path):
    scene = bordered(sea, 0, "uint16")
    scene[3][scene[3] < 110] = 0
    found = settled(open_scene(write(tmp_path / "in.tif", scene)))
    assert found.source.info.nodatas == (0, 0, 0, None)


def test_sparkle_that_saturates_all_bands_is_data(sea, write, tmp_path):
    scene = sea(100, 120)
    scene[:, np.random.default_rng(1).random((100, 120)) < 0.05] = 4095
    scene[:, 40:45, 40:45] = 4095
    assert not undeclared(open_scene(write(tmp_path / "in.tif", scene))).notes


def test_a_saturated_boat_among_saturated_glint_is_data(sea, write, tmp_path):
    """Blurred by the optics, so that the pixels beside are nearly as bright."""
    scene = sea(100, 120).astype(float)
    bright = np.zeros((100, 120))
    bright[40:62, 40:70] = 2.0
    bright[np.random.default_rng(1).random((100, 120)) < 0.01] = 20.0
    scene = np.minimum(scene + 4095 * cv2.GaussianBlur(bright, (9, 9), 1.2), 4095).astype("uint16")
    assert (scene == 4095).all(axis=0).mean() > 0.04
    assert not undeclared(open_scene(write(tmp_path / "in.tif", scene))).notes


def test_the_highest_number_of_twelve_bits_is_saturation(sea, write, tmp_path):
    assert not undeclared(open_scene(write(tmp_path / "in.tif", bordered(sea, 4095, "uint16")))).notes
    assert undeclared(open_scene(write(tmp_path / "other.tif", bordered(sea, 4000, "uint16")))).notes


def test_what_is_declared_is_not_asked_for(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", bordered(sea, -9999), nodata=0)
    assert not undeclared(open_scene(source)).notes


@pytest.mark.parametrize("stray", [0, -7])
def test_one_pixel_of_0_hides_no_border_of_another_value(stray, sea, write, tmp_path):
    scene = bordered(sea, 20_000, "int16")
    scene[:, 50, 60] = stray
    found = settled(open_scene(write(tmp_path / "in.tif", scene)))
    assert found.source.info.nodatas == (20_000,) * 4


def test_a_second_fit_to_a_scene_finds_the_same_and_says_it_once(sea, write, tmp_path, caplog):
    raw = bordered(sea, 0, "uint16")
    scene = open_scene(write(tmp_path / "in.tif", raw, names=None))
    recipe = Recipe(method="hedley", sample="all", mask="none")
    first, second = (fit_scene(scene, recipe) for _ in range(2))
    assert second.model == first.model
    assert caplog.text.count("is taken for nodata") == caplog.text.count("are taken for blue,green,red,nir") == 1
    np.testing.assert_array_equal(np.isnan(correct(scene, second)[0]), raw[0] == 0)


def test_only_a_part_of_a_large_scene_is_looked_at(sea, write, tmp_path, monkeypatch):
    monkeypatch.setattr("deglint.readers.undeclared.PIXELS_READ", 3000)
    monkeypatch.setattr("deglint.readers.undeclared.SAMPLED_SIDE", 16)
    scene = open_scene(write(tmp_path / "in.tif", bordered(sea, 0, "uint16")))
    asked = []
    read_raw = scene.source.read_raw
    scene.source.read_raw = lambda window: asked.append(window) or read_raw(window)
    assert settled(scene).source.info.nodatas == (0,) * 4
    assert len(asked) < 28


def test_arrays_are_settled_too(sea):
    xarray = pytest.importorskip("xarray")
    scene = bordered(sea, -9999)
    given = xarray.DataArray(scene, dims=("band", "y", "x"), coords={"band": ["blue", "green", "red", "nir"]})
    got = remove_array(given).values
    fill = (scene == -9999).all(axis=0)
    np.testing.assert_array_equal(got[:, fill], scene[:, fill])
    assert (got != scene)[:3][:, ~fill].mean() > 0.5


# ------------------------------------------------------------------------------------------ the offset of Sentinel-2
def lost_offset(sea, offset=1000):
    """Clear water and a coast in integers of reflectance x 10000, as Level-2A has them."""
    scene = sea(100, 120, dtype="int32") // 3
    scene[:, :, 90:] = np.array([400, 700, 800, 2500])[:, None, None] + scene[:, :, 90:] // 4
    return (scene + offset).astype("uint16")


def test_a_lost_offset_is_found_and_leaves_the_output_in_its_own_numbers(sea, write, read, deglint, tmp_path):
    plain, cut = (write(tmp_path / f"{n}.tif", lost_offset(sea, n), names=SENTINEL2) for n in (0, 1000))
    assert not undeclared(open_scene(plain)).notes
    found = settled(open_scene(cut))
    assert found.source.info.offsets == (-1000.0,) * 4
    outs = []
    for source in (plain, cut):
        outs.append(tmp_path / "out.tif")
        ran = deglint("remove", source, outs[-1], "--overwrite", "--compensate", "off")
        assert ran.code == 0, ran.err
        assert ("hold the offset of Sentinel-2" in ran.err) is (source == cut)
        outs[-1] = read(outs[-1]).astype(int)
    np.testing.assert_array_equal(outs[1], outs[0] + 1000)


@pytest.mark.parametrize("options", [(), ("--compensate", "thesis")])
def test_a_class_band_hides_no_offset_and_is_copied(options, sea, write, read, deglint, tmp_path):
    scene = lost_offset(sea)
    scene[:3, 20:50:10, 10:80:10] += np.uint16(900)  # glint that the NIR does not show
    classes = np.full_like(scene[:1], 6)
    classes[:, 30, 10:80] = 9
    source = write(tmp_path / "in.tif", np.concatenate([scene, classes]), names=[*SENTINEL2, "SCL"])
    alone = write(tmp_path / "alone.tif", scene, names=SENTINEL2)
    assert settled(open_scene(source)).source.info.offsets == (-1000.0,) * 4 + (0.0,)
    outs = []
    for path in (source, alone):
        ran = deglint("remove", path, tmp_path / "out.tif", "--overwrite", *options)
        assert ran.code == 0, ran.err
        outs.append(read(tmp_path / "out.tif"))
    np.testing.assert_array_equal(outs[0][4], classes[0])
    np.testing.assert_array_equal(outs[0][:4], outs[1])
    assert (outs[1] != scene)[:3].any()


@pytest.mark.parametrize(("less", "held"), [(300, True), (600, True), (900, False)])
def test_an_offset_is_found_where_visible_bands_are_darker(less, held, sea, write, tmp_path):
    scene = lost_offset(sea)
    scene[0, :40] -= np.uint16(less)  # a blue below zero, after a correction of too much air light
    source = write(tmp_path / "in.tif", scene, names=SENTINEL2)
    found = undeclared(open_scene(source))
    assert found.offsets == ((-1000.0,) * 4 if held else ())
    remedy = "--offset 0" if held else "--offset -1000"
    assert [note for note in found.notes if "hold the offset" in note and note.endswith(remedy)]
    assert undeclared(settled(open_scene(source))) == found  # not searched again
    scene[3, :40] -= 600
    assert not undeclared(open_scene(write(tmp_path / "dark.tif", scene, names=SENTINEL2))).notes


def test_a_suspected_offset_is_said_once(sea, write, deglint, tmp_path):
    scene = lost_offset(sea)
    scene[0, :40] -= np.uint16(900)
    ran = deglint("remove", write(tmp_path / "in.tif", scene, names=SENTINEL2), tmp_path / "out.tif")
    assert ran.code == 0, ran.err
    assert ran.err.count("may hold the offset") == 1


@pytest.mark.parametrize(
    ("names", "sensor", "zero", "scale"),
    [
        (("SR_B2", "SR_B3", "SR_B4", "SR_B5", "SR_B6"), None, 7273, 2.75e-5),
        (("SR_B1", "SR_B2", "SR_B3", "SR_B4", "SR_B5"), "landsat7", 7273, 2.75e-5),
        (("B2", "B3", "B4", "B5", "B6"), "landsat8", 5000, 2e-5),
    ],
)
def test_the_offset_of_landsat_is_found(names, sensor, zero, scale, sea, write, tmp_path):
    """Without it, the level of the glint would be that of the offset, and all of the water would be darkened."""
    bands = lost_offset(sea, 0)
    reflectance = np.concatenate([bands, bands[3:]]) / 10_000
    source = write(tmp_path / "in.tif", np.round(reflectance / scale + zero).astype("uint16"), names=names)
    scene = open_scene(source, sensor=sensor)
    assert settled(scene).source.info.offsets == (-zero,) * 5
    stated = open_scene(source, sensor=sensor, scale=scale, offset=-scale * zero)
    found, known = (correct(s, fit_scene(s, Recipe(method="wiener")))[:, :, :80] for s in (scene, stated))
    np.testing.assert_allclose(scale * found, known, atol=1e-4)


@pytest.mark.parametrize("how", ["names", "declared", "desert", "sixteen bits"])
def test_no_offset_is_made_up(how, sea, write, tmp_path):
    scene = lost_offset(sea)
    if how == "desert":
        scene = (scene * np.array([1, 2, 3, 4])[:, None, None]).astype("uint16")
    if how == "sixteen bits":  # 65535 is a reflectance of 1: the NIR of the coast is 0.3
        scene[:, :, 90:] = np.array([3_000, 5_000, 6_000, 20_000])[:, None, None]
    source = write(tmp_path / "in.tif", scene, names=None if how == "names" else SENTINEL2)
    if how == "declared":
        import rasterio

        with rasterio.open(source, "r+") as data:
            data.offsets = (-1000.0,) * 4
    assert not undeclared(open_scene(source)).offsets


def test_the_mask_does_not_depend_on_the_offset(sea):
    scene, roles = lost_offset(sea).astype(np.float32), ROLES
    with_offset, without = (water(s, fit_water([s], roles, pixel=10.0)) for s in (scene, scene - 1000))
    np.testing.assert_array_equal(with_offset, without)
    assert with_offset[:, :90].mean() > 0.99
    assert not with_offset[:, 90:].any()


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (2, 1, 0, 3)])
def test_four_bands_without_names_are_known_by_their_order(order, sea, write, read, deglint, tmp_path):
    names, scene = ("blue", "green", "red", "nir"), sea(100, 120)[list(order)]
    ran = deglint("remove", write(tmp_path / "in.tif", scene, names=None), tmp_path / "out.tif")
    asked = ",".join(names[i] for i in order)
    assert ran.code == 0, ran.err
    assert ran.err.count(f"bands without names are taken for {asked}") == 1
    named = write(tmp_path / "named.tif", scene, names=[names[i] for i in order])
    assert deglint("remove", named, tmp_path / "same.tif").code == 0
    np.testing.assert_array_equal(read(tmp_path / "out.tif"), read(tmp_path / "same.tif"))
    assert (read(tmp_path / "out.tif")[:3] != scene[:3]).any()
    assert find_nir(open_scene(tmp_path / "out.tif")) == (3,)


def test_a_fourth_band_without_a_name_is_the_nir(sea, write, tmp_path):
    scene = sea(100, 120)[[2, 1, 0, 3]]
    found = settled(open_scene(write(tmp_path / "in.tif", scene, names=("red", "green", "blue"))))
    assert [b.wavelength for b in found.bands] == [660.0, 555.0, 485.0, 840.0]
    assert any("are taken for nir, from" in note for note in found.notes)


def test_another_order_of_four_bands_is_not_guessed(sea, write, deglint, tmp_path):
    ran = deglint("info", write(tmp_path / "in.tif", sea(100, 120)[[3, 2, 1, 0]], names=None))
    assert "no near-infrared band" in ran.out + ran.err
    assert "taken for" not in ran.out + ran.err


@pytest.mark.parametrize(
    ("names", "order", "expected"),
    [
        (("blue",), (2, 1, 0, 3), [485.0, 555.0, 660.0, 840.0]),
        ((None, None, "red"), (2, 1, 0, 3), [485.0, 555.0, 660.0, 840.0]),
        (("red",), (0, 1, 2, 3), [660.0, 555.0, 485.0, 840.0]),
        ((None, "red"), (0, 1, 2, 3), [None, 660.0, None, None]),
    ],
)
def test_the_order_of_bands_does_not_contradict_the_name_of_one(names, order, expected, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(100, 120)[list(order)], names=names)
    assert [b.wavelength for b in settled(open_scene(source)).bands] == expected


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [0, np.nan])
def test_four_bands_without_names_or_valid_values_stay_unknown(value, write, tmp_path):
    source = write(tmp_path / "in.tif", np.full((4, 50, 60), value, "float32"), names=None)
    assert not undeclared(open_scene(source)).wavelengths
