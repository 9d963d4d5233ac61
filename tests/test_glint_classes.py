"""Sun and sky glint as CEOS-ARD Aquatic Reflectance names them: classes in the flags, amounts beside the image."""

import logging

import numpy as np
import pytest
import rasterio

from deglint import Recipe, open_scene, remove_glint
from deglint.pipeline.flags import CORRECTABLE, NEGLIGIBLE, NOT_ASSESSED, UNCORRECTABLE, glint_classes, sky_glint
from deglint.simulate import Setup, simulate

from .common import at_wavelengths, says

HEDLEY = Recipe(method="hedley", sample="0,50,100,30", mask="0,0,60,80", compensate="off")
CENTRES = at_wavelengths(480, 550, 660, 1030)
ANGLES = {"sun_elevation": "50", "sun_azimuth": "135", "view_elevation": "80", "view_azimuth": "300"}


def test_classes_follow_from_amount_noise_and_saturation():
    amount = np.array([[[0.5, 1.5, 1.5, 0.5, np.nan, np.nan]], [[0.5, 0.5, 0.5, -3.0, 0.5, np.nan]]], np.float32)
    full = np.array([[False, False, True, False, False, False]])
    found = glint_classes(amount, np.array([1.0, 2.0]), full, True)
    assert found.tolist() == [[NEGLIGIBLE, CORRECTABLE, UNCORRECTABLE, CORRECTABLE, NEGLIGIBLE, NOT_ASSESSED]]
    assert not glint_classes(amount, np.array([1.0, 2.0]), full, np.zeros((1, 6), bool)).any()
    alone = glint_classes(amount[:0], np.zeros(0), full, True)  # no band was corrected
    assert alone.tolist() == [[0, 0, UNCORRECTABLE, 0, 0, 0]]


def test_the_second_band_of_the_flags_has_the_classes(sea, write, read, tmp_path):
    raw = sea()
    raw[:, 5:10] = 0
    raw[0, 20, 20:30] = 65535
    raw[3, 30:40, 20:30] = raw[3, 10:].min()  # without glint
    source, flags, amount = write(tmp_path / "in.tif", raw, nodata=0), tmp_path / "f.tif", tmp_path / "a.tif"
    said = remove_glint(source, tmp_path / "o.tif", HEDLEY, flags=flags, amount=amount).sidecar
    remove_glint(source, tmp_path / "alone.tif", HEDLEY)
    assert (tmp_path / "o.tif").read_bytes() == (tmp_path / "alone.tif").read_bytes()
    with rasterio.open(flags) as dataset:
        assert dataset.descriptions == ("flags", "sun glint class")
        assert dataset.tags(2)["CLASS_2"] == "correctable (moderate)"
        assert dataset.colorinterp[0].name == "palette"
        bits, classes = dataset.read()
    water = bits & 4 != 0
    noise = np.array(list(said["sun_glint"]["negligible_up_to"].values()))
    assert 2 < noise.min() < noise.max() < 8  # 3 in each band, and that of the NIR that was subtracted
    above = (np.abs(read(amount)) > noise[:, None, None]).any(axis=0)
    assert (classes[20, 20:30] == UNCORRECTABLE).all()
    assert (classes[30:40, 20:30] == NEGLIGIBLE).mean() > 0.9
    np.testing.assert_array_equal(classes[bits & 16 == 0], np.where(water, 1 + above, 0)[bits & 16 == 0])
    assert said["sun_glint"]["specification"] == "CEOS-ARD Aquatic Reflectance 2.0.1"
    assert list(said["sun_glint"]["pixels"].values()) == np.bincount(classes.ravel(), minlength=4).tolist()


@pytest.mark.parametrize("missing", ["rows", "scattered"])
def test_missing_values_of_a_band_are_no_noise_and_not_counted_as_changed(sea, write, tmp_path, missing):
    raw = sea(dtype="float32")
    holes = np.arange(80) < 60 if missing == "rows" else np.random.default_rng(4).random((80, 100)) < 0.3
    limits = []
    for name, fill in (("whole", raw[1, holes]), ("holes", np.nan)):
        raw[1, holes] = fill
        source, flags = write(tmp_path / f"{name}.tif", raw, nodata=np.nan), tmp_path / f"{name}_flags.tif"
        recipe = Recipe(method="hedley", sample="all", mask="none", compensate="off", bands="green,red")
        said = remove_glint(source, tmp_path / f"{name}_out.tif", recipe, flags=flags).sidecar
        limits.append(said["sun_glint"]["negligible_up_to"])
    assert limits[1] == pytest.approx(limits[0], rel=0.25)
    assert said["pixels"]["changed"] == {"green": np.isfinite(raw[1]).sum(), "red": 8000}


@pytest.mark.parametrize("wind", ["0.05", "0.1", "15"])
def test_sky_glint_takes_a_stated_wind_within_the_range_of_the_slope_models(sea, write, tmp_path, wind):
    path = write(tmp_path / "in.tif", sea(), tags=ANGLES | {"WIND_M_S": wind}, band_tags=CENTRES)
    found = sky_glint(open_scene(path))
    assert found["wind_stated"] == (wind != "0.05")


@pytest.mark.parametrize("sky", ["harrison-coombes", "cardioidal"])
def test_sky_glint_is_that_of_the_simulated_sea(sky, tmp_path):
    from deglint.raster.simulated import write_scene

    made = simulate(Setup(size=(128, 128), sky=sky, view_zenith=25.0, view_azimuth=200.0, wind=6.0))
    write_scene(made, tmp_path / "sea")
    found = sky_glint(open_scene(tmp_path / "sea.tif"))
    mirrored = (made.truth - made.truth_water).mean(axis=(1, 2))
    truth = np.pi * mirrored / (made.light.direct + made.light.diffuse)
    assert found["wind_stated"]
    assert all(low < t < high for t, (low, high) in zip(truth, found["range"].values(), strict=True))
    if sky == "harrison-coombes":
        np.testing.assert_allclose(list(found["reflectance"].values()), truth, rtol=0.05)


def test_amounts_state_the_sky_glint_where_the_scene_states_its_angles(sea, write, read, caplog, tmp_path):
    caplog.set_level(logging.INFO, "deglint")
    for name, tags in (("with", ANGLES), ("without", {}), ("wrong", ANGLES | {"sun_elevation": "-5"})):
        source = write(tmp_path / f"{name}.tif", sea(), tags=tags, band_tags=CENTRES)
        amount = tmp_path / f"a_{name}.tif"
        found = remove_glint(source, tmp_path / f"o_{name}.tif", HEDLEY, amount=amount).sidecar.get("sky_glint")
        with rasterio.open(amount) as dataset:
            said = dataset.tags(1).get("SKY_GLINT_REFLECTANCE")
        if name == "with":
            assert "nir" not in found["reflectance"]  # beyond the tables of the irradiance
            assert float(said) == pytest.approx(found["reflectance"]["blue"], rel=1e-3)
            low, high = found["range"]["blue"]
            assert 0.001 < low < found["reflectance"]["blue"] < high < 0.03
            assert (found["removed"], found["wind_stated"]) == (False, False)
        else:
            assert found is said is None
    np.testing.assert_array_equal(read(tmp_path / "a_with.tif"), read(tmp_path / "a_without.tif"))
    lines = [r.message for r in caplog.records if r.message.startswith("sky glint")]
    assert lines[0].startswith("sky glint: modelled, not removed; reflectance at the surface blue 0.00")
    missing = "sun zenith angle, sun azimuth, view zenith angle, view azimuth", "sun zenith angle"
    assert all(says(line, "not modelled", f": {names}") for line, names in zip(lines[1:], missing, strict=True))
