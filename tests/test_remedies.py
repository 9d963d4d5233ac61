"""Every remedy that a message about water, masks and samples suggests is followed, one by one, to a result."""

import numpy as np
import pytest

from deglint import Recipe, fit_scene, open_scene
from detect.cli import run as rxdetect

from .common import NAMES

HEDLEY = ("--method", "hedley", "--compensate", "off", "--overwrite")


def land(sea):
    """Dry ground: brighter in the NIR than in the visible, with waves of light that all bands share."""
    return sea(80, 100)[[3, 2, 1, 0]]


def polygon(geojson, tmp_path, top=20, left=10, bottom=70, right=90):
    x, y = 400_000, 800_000
    ring = [
        (x + 10 * c, y - 10 * r) for r, c in ((top, left), (top, right), (bottom, right), (bottom, left), (top, left))
    ]
    return geojson(tmp_path / "water.geojson", ring, crs="EPSG:32653")


@pytest.fixture
def remedies(sea, write, geojson, tmp_path):
    """What the message on a scene without water suggests."""
    raster = np.zeros((1, 80, 100), np.uint8)
    raster[0, 20:70, 10:90] = 1
    return {
        "--mask none": ("--mask", "none"),
        "--mask FILE": ("--mask", polygon(geojson, tmp_path)),
        "the water)": ("--mask", write(tmp_path / "mask.tif", raster, names=("water",))),
    }


def test_no_water_is_3_and_every_remedy_works(sea, write, read, deglint, tmp_path, remedies):
    source, out = write(tmp_path / "in.tif", land(sea)), tmp_path / "out.tif"
    ran = deglint("remove", source, out, *HEDLEY)
    assert (ran.code, out.exists()) == (3, False)
    said = [line for line in ran.err.splitlines() if "no water" in line]
    assert len(said) == 1
    assert said[0].split("no water")[1] in deglint("info", source).out
    for words, options in remedies.items():
        assert words in said[0]
        done = deglint("remove", source, out, *HEDLEY, *options)
        assert done.code == 0, done.err
        assert (read(out) != read(source)).any()


def test_another_nir_is_followed(sea, write, deglint, tmp_path):
    """The band that is called NIR holds something else."""
    scene = sea(80, 100)
    scene = np.concatenate([scene, scene[3:]])
    scene[3] += 3000
    source, out = (
        write(tmp_path / "in.tif", scene, names=("blue", "green", "red", "nir", "rededge")),
        tmp_path / "out.tif",
    )
    ran = deglint("remove", source, out, *HEDLEY)
    assert ran.code == 3
    assert "(--nir)" in ran.err
    done = deglint("remove", source, out, *HEDLEY, "--nir", "rededge")
    assert done.code == 0, done.err


def test_rxdetect_says_the_same_and_its_remedies_work(sea, write, tmp_path, capfd, remedies):
    source, out = write(tmp_path / "in.tif", land(sea)), str(tmp_path / "s.tif")
    assert rxdetect(["score", source, out, "--mask", "water"]) == 3
    said = capfd.readouterr().err
    for words, (option, value) in remedies.items():
        assert words in said
        assert rxdetect(["score", source, out, "--overwrite", option, value]) == 0, capfd.readouterr().err


@pytest.mark.parametrize("mask", ["polygons", "raster"])
def test_a_mask_in_a_file_is_the_users_word(sea, write, geojson, tmp_path, monkeypatch, deglint, read, mask, remedies):
    """Nothing is searched for beside it, and the sample lies in it."""

    def never(*_args, **_options):
        raise AssertionError("water is searched for")

    monkeypatch.setattr("deglint.pipeline.overview.fit_water", never)
    value = remedies["--mask FILE" if mask == "polygons" else "the water)"][1]
    for name, scene in (("land", land(sea)), ("sea", sea(80, 100))):
        source, out = write(tmp_path / f"{name}.tif", scene), tmp_path / f"{name}_out.tif"
        ran = deglint("remove", source, out, *HEDLEY, "--mask", value)
        assert ran.code == 0, ran.err
        assert "water:" not in ran.err
        changed = (read(out) != scene).any(axis=0)
        assert changed[20:70, 10:90].mean() > 0.5
        changed[20:70, 10:90] = False
        assert not changed.any()


def test_without_a_known_band_below_750_nm_a_sample_and_a_mask_help(sea, write, deglint, geojson, tmp_path, capfd):
    scene = sea(80, 100)[2:]
    source = write(tmp_path / "in.tif", scene, names=("other", "nir"))
    out = tmp_path / "out.tif"
    ran = deglint("remove", source, out, *HEDLEY)
    assert ran.code == 1
    for words, value in (
        ("--sample FILE.geojson", polygon(geojson, tmp_path)), ("a window", "10,70,10,90"), ("--sample all", "all"),
    ):  # fmt: skip
        assert words in ran.err
        done = deglint("remove", source, out, *HEDLEY, "--sample", value)
        assert done.code == 0, done.err
    capfd.readouterr()
    assert rxdetect(["score", source, str(tmp_path / "s.tif"), "--mask", "water"]) == 1
    said = capfd.readouterr().err
    for words, value in (("--mask none", "none"), ("--mask FILE", polygon(geojson, tmp_path))):
        assert words in said
        assert rxdetect(["score", source, str(tmp_path / "s.tif"), "--mask", value, "--overwrite"]) == 0


def test_too_small_is_3_and_the_remedies_work(sea, write, deglint, tmp_path):
    small, large = (write(tmp_path / f"{n}.tif", sea(n, n)) for n in (12, 90))
    out, model = tmp_path / "out.tif", tmp_path / "model.json"
    ran = deglint("remove", small, out, *HEDLEY)
    assert ran.code == 3
    assert "12 x 12 pixels are too few" in ran.err
    assert all(words in ran.err for words in ("a larger image", "--model", "--sample all"))
    assert deglint("remove", large, out, *HEDLEY, "--save-model", model).code == 0
    assert deglint("remove", small, out, "--overwrite", "--model", model).code == 0
    assert deglint("remove", small, out, *HEDLEY, "--sample", "all").code == 0
    assert "hedley" not in deglint("remove", write(tmp_path / "tiny.tif", sea(3, 3)), out, "--overwrite").err


@pytest.mark.parametrize("side", [12, 16])
def test_a_scene_that_is_too_small_for_the_default_is_corrected_as_the_message_says(
    sea, write, deglint, tmp_path, side
):
    source, out = write(tmp_path / "in.tif", sea(side, side)), tmp_path / "out.tif"
    for options in ((), ("--sample", "all")):
        ran = deglint("remove", source, out, *options)
        assert ran.code == 3
        assert "take --method hedley --sample all." in ran.err
    assert deglint("remove", source, out, "--method", "hedley", "--sample", "all").code == 0


def test_a_mask_beside_the_water_is_3_and_another_one_works(sea, write, deglint, geojson, tmp_path):
    scene = sea(80, 100)
    scene[:, 20:70, 10:90] = 7
    source, out = write(tmp_path / "in.tif", scene, nodata=7), tmp_path / "out.tif"
    mask = polygon(geojson, tmp_path)
    ran = deglint("remove", source, out, "--method", "nir-subtraction", "--compensate", "off", "--mask", mask)
    assert ran.code == 3
    assert "--nodata" in ran.err
    assert "--mask" in ran.err
    plain = ("--method", "nir-subtraction", "--compensate", "off", "--overwrite", "--mask")
    assert deglint("remove", source, out, *plain, mask, "--nodata", "none").code == 0
    assert deglint("remove", source, out, *plain, polygon(geojson, tmp_path, 0, 0, 20, 100)).code == 0


def test_a_mask_of_another_size_is_named_by_its_own_option(sea, write, deglint, tmp_path):
    source = write(tmp_path / "in.tif", sea(80, 100))
    mask = write(tmp_path / "mask.tif", np.ones((1, 40, 50), np.uint8), crs=None, transform=None)
    for option in ("--mask", "--sample"):
        ran = deglint("remove", source, tmp_path / "out.tif", *HEDLEY, option, mask)
        assert (ran.code, f"Error: {option} {mask} has 40 x 50 pixels" in ran.err) == (1, True), ran.err


@pytest.mark.parametrize("kind", ["sea", "land", "coast", "bordered"])
def test_info_and_remove_decide_the_same(kind, sea, write, deglint, tmp_path):
    """Of water and nodata one says what the other does, and both end alike where there is no water."""
    import json

    scene = land(sea) if kind == "land" else sea(80, 100)
    if kind == "coast":
        scene[:, :, 60:] = land(sea)[:, :, 60:]
    if kind == "bordered":
        scene[:, :10] = 0
    source, out = write(tmp_path / "in.tif", scene, names=NAMES), tmp_path / "out.tif"
    found = json.loads(deglint("info", source, "--json").out)
    ran = deglint("remove", source, out, *HEDLEY)
    if kind == "land":
        assert ran.code == 3
        assert found["reason"] in ran.err
        return
    sidecar = json.loads((tmp_path / "out.tif.json").read_text())
    assert found["water_fraction"] == sidecar["water"]["water_fraction"]
    assert sidecar["water"]["reason"] in found["notes"]
    assert sidecar["water"]["reason"] in ran.err
    assert found["nodata"] == (0 if kind == "bordered" else None)


def test_what_was_fitted_and_what_is_corrected_agree_in_memory(sea, write, tmp_path):
    from deglint.pipeline.run import correct

    scene = sea(80, 100)
    scene[:, :10] = 0
    opened = open_scene(write(tmp_path / "in.tif", scene))
    fitted = fit_scene(opened, Recipe(method="hedley", compensate="off"))
    clean = correct(opened, fitted)
    assert np.isnan(clean[:, :10]).all()
    assert np.isfinite(clean[:, 10:]).all()
    part = correct(opened, fitted, mask=(20, 30, 10, 10))
    np.testing.assert_array_equal(part, correct(opened, fitted, mask="20,30,10,10"))
    assert np.argwhere((part != scene)[0, 10:]).min(axis=0).tolist() == [20, 20]
