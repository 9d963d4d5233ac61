"""`rxdetect score`, from file to file: scores, thresholds, objects, masks, backgrounds, and what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest
import rasterio

from deglint import open_scene
from deglint.errors import InputError
from detect import background, global_rx, local, rx, threshold
from detect.pipeline import Recipe, score_file
from detect.pipeline import scoring as flags
from detect.pipeline.features import to_wgs84
from detect.pipeline.plan import water_of_removal

from ..common import read_raster, says


@pytest.fixture
def scene(tmp_path, sea, write):
    """A sea with an odd 3 x 3 patch, and a hole of nodata."""
    pixels = sea(height=200, width=230)
    pixels[1, 100:103, 50:53] += 400
    pixels[:, :10, :10] = 0
    return write(tmp_path / "scene.tif", pixels, nodata=0, tiled=True, blockxsize=64, blockysize=64)


def pixels_of(path):
    with rasterio.open(path) as dataset:
        image = dataset.read().astype(np.float32)
    image[:, (image == 0).any(axis=0)] = np.nan
    return image


@pytest.mark.parametrize("method", ["local", *(n for n, kind in global_rx.DETECTORS.items() if kind.matrices)])
def test_the_file_is_what_the_arrays_give(rxdetect, scene, tmp_path, method):
    out = tmp_path / "out.tif"
    options = ("--window", "3,9") if method == "local" else ()
    ran = rxdetect("score", scene, out, "--method", method, *options, "--json")
    assert ran.code == 0, ran.err
    image = pixels_of(scene)
    if method == "local":
        expected = local.local_rx(image, inner=3, outer=9)
    else:
        expected = global_rx.score(image, global_rx.detector(method, background.fit(image), nir=[3]))
    np.testing.assert_array_equal(read_raster(out)[0], expected)
    said = json.loads(ran.out)
    assert said["pixels"]["not_valid"] == 100
    assert said["pixels"]["scored"] == 200 * 230 - 100
    assert json.loads((tmp_path / "out.tif.json").read_text()) == said


def test_the_raster_is_a_valid_float_cog(rxdetect, scene, tmp_path):
    from rio_cogeo import cog_validate

    out = tmp_path / "out.tif"
    assert rxdetect("score", scene, out, "--method", "rx", "--co", "COMPRESS=ZSTD").code == 0
    assert cog_validate(out)[0]
    with rasterio.open(out) as dataset, rasterio.open(scene) as source:
        assert (dataset.count, dataset.dtypes, dataset.descriptions) == (1, ("float32",), ("rx",))
        assert np.isnan(dataset.nodata)
        assert (dataset.crs, dataset.transform, dataset.shape) == (source.crs, source.transform, source.shape)
        assert dataset.profile["compress"] == "zstd"


@pytest.mark.parametrize("options", [("--covariance", "mcd"), ("--covariance", "ledoit-wolf"), ("--method", "local")])
def test_threads_and_blocks_do_not_matter(tmp_path, sea, write, options, rxdetect):
    pixels = sea(height=300, width=330)
    found = []
    for name, layout, threads in (
        ("a", {"tiled": True, "blockxsize": 64, "blockysize": 64}, 1),
        ("b", {"blockysize": 7}, 3),
    ):
        scene = write(tmp_path / f"{name}.tif", pixels, **layout)
        out = tmp_path / f"{name}_out.tif"
        assert rxdetect("score", scene, out, "--threads", threads, *options).code == 0
        found.append(read_raster(out)[0])
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("law", threshold.THRESHOLDS)
def test_threshold_and_objects(rxdetect, scene, tmp_path, law):
    out, marked = tmp_path / "out.tif", tmp_path / "found.geojson"
    options = ["--pfa", "1e-3", "--threshold", law, "--objects", marked, "--min-size", "4"]
    ran = rxdetect("score", scene, out, "--method", "rx", *options, "--json")
    assert ran.code == 0, ran.err
    said = json.loads(ran.out)
    scores = read_raster(out)[0]
    valid = scores[np.isfinite(scores)]
    expected = {
        "gpd": lambda: threshold.from_gpd(valid, 1e-3),
        "empirical": lambda: threshold.from_quantile(valid, 1e-3),
        "f": lambda: threshold.from_f(1e-3, 4, 200 * 230 - 100),
        "chi2": lambda: threshold.from_chi2(1e-3, 4),
    }[law]()
    assert said["threshold"]["value"] == pytest.approx(expected.value, rel=1e-12)
    assert said["threshold"]["pfa_observed"] == pytest.approx((valid > expected.value).mean(), abs=1e-12)
    features = json.loads(marked.read_text())["features"]
    assert len(features) == said["objects"] >= 1
    first = features[0]["properties"]
    assert (first["row"], first["column"]) == pytest.approx((101, 51), abs=1)
    assert first["area_m2"] == pytest.approx(100 * first["pixels"], rel=0.01)


def test_p_values_are_those_of_the_law_of_the_scores(rxdetect, scene, tmp_path):
    out, p = tmp_path / "out.tif", tmp_path / "p.tif"
    assert rxdetect("score", scene, out, "--p-value", p).code == 0
    expected = threshold.p_value(read_raster(out)[0], 4, 200 * 230 - 100)
    np.testing.assert_allclose(read_raster(p)[0], expected, rtol=1e-7, atol=1e-40)


def test_the_f_law_holds_for_any_divisor_of_the_covariance(tmp_path, write):
    source = write(tmp_path / "noise.tif", np.random.default_rng(0).normal(50, 3, (4, 60, 60)).astype(np.float32))
    recipe, whole = Recipe(method="local", window=(5, 9), pfa=1e-3, threshold="f"), (slice(4, -4), slice(4, -4))
    ratios, p_values = [], []
    for ddof in (0, 1, 4):
        out, p = tmp_path / f"{ddof}.tif", tmp_path / f"{ddof}_p.tif"
        found = score_file(source, out, replace(recipe, ddof=ddof), p_value=p)
        ratios.append(read_raster(out)[0][whole] / found.threshold.value)
        p_values.append(read_raster(p)[0][whole])
    for ratio, p_value in zip(ratios, p_values, strict=True):
        np.testing.assert_allclose(ratio, ratios[1], rtol=1e-5)
        np.testing.assert_allclose(p_value, p_values[1], rtol=1e-4)


def test_flags_of_global_scores(rxdetect, scene, tmp_path):
    out, marked = tmp_path / "out.tif", tmp_path / "flags.tif"
    options = ["--mask", "0,0,230,150", "--background", "0,0,100,200", "--flags", marked]
    assert rxdetect("score", scene, out, *options).code == 0
    expected = np.zeros((200, 230), np.uint8)
    expected[:10, :10] = flags.NOT_VALID
    expected[150:] = flags.MASKED_OUT
    expected[:, 100:] += flags.NOT_BACKGROUND
    found = read_raster(marked)[0]
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(np.isnan(read_raster(out)[0]), found & (flags.NOT_VALID | flags.MASKED_OUT) > 0)
    said = json.loads((tmp_path / "out.tif.json").read_text())["flags"]
    assert said == {"file": str(marked), "bits": {str(bit): words for bit, words in flags.MEANINGS.items()}}


def test_flags_of_local_scores_in_any_tiling(rxdetect, tmp_path, sea, write):
    pixels = sea(height=300, width=330)
    pixels[:, 130:170, 20:60] = 0
    pixels[:, 150, 40] = 500  # alone
    pixels[2, 200:240, 200:240] = 300  # a constant band
    image = pixels.astype(np.float32)
    image[:, (pixels == 0).any(axis=0)] = np.nan
    states = np.zeros(image.shape[1:], np.uint8)
    local.local_rx(image, inner=3, outer=9, flags=states)
    expected = np.where(np.isnan(image).any(axis=0), flags.NOT_VALID, 0)
    expected += np.select([states == 1, states == 2], [flags.PSEUDO_INVERSE, flags.NO_RING])
    for name, layout in (("a", {"tiled": True, "blockxsize": 64, "blockysize": 64}), ("b", {"blockysize": 7})):
        scene, marked = write(tmp_path / f"{name}.tif", pixels, nodata=0, **layout), tmp_path / f"{name}_flags.tif"
        options = ["--method", "local", "--window", "3,9", "--flags", marked]
        assert rxdetect("score", scene, tmp_path / f"{name}_out.tif", *options).code == 0
        np.testing.assert_array_equal(read_raster(marked)[0], expected)
    assert expected[150, 40] == flags.NO_RING
    assert expected[220, 220] == flags.PSEUDO_INVERSE


@pytest.mark.parametrize(("bands", "n"), [(1, 3), (1, None), (2, 40), (5, 416), (8, 10**7), (8, None), (33, 60)])
def test_p_values_against_mpmath(bands, n):
    from mpmath import betainc, gammainc, mp, mpf

    scores = np.concatenate([[0.0, 1e-9, 1e-3], np.geomspace(0.01, 900, 60)])
    with mp.workdps(40):

        def exact(d):
            if n is None:
                return gammainc(mpf(bands) / 2, mpf(d) / 2, mp.inf, regularized=True)
            w = mpf(d) * n / (mpf(n) ** 2 - 1)
            return betainc(mpf(n - bands) / 2, mpf(bands) / 2, 0, 1 / (1 + w), regularized=True)

        expected = np.array([float(exact(float(d))) for d in scores])
    np.testing.assert_allclose(threshold.p_value(scores, bands, n), expected, rtol=1e-9)
    assert np.isnan(threshold.p_value(np.array([np.nan, 1.0]), bands, n)).tolist() == [True, False]


def test_fit_on_one_scene_score_another(rxdetect, scene, tmp_path, sea, write):
    out, saved = tmp_path / "out.tif", tmp_path / "sea.json"
    assert rxdetect("score", scene, out, "-b", "red,nir,blue", "--save-background", saved).code == 0
    other = write(tmp_path / "other.tif", sea(height=70, width=80, seed=9)[::-1], names=("nir", "red", "green", "blue"))
    ran = rxdetect("score", other, tmp_path / "out2.tif", "--background", saved)
    assert ran.code == 0, ran.err
    fitted = background.fit(pixels_of(scene)[[2, 3, 0]])
    scores = read_raster(tmp_path / "out2.tif")[0]
    np.testing.assert_allclose(scores, rx(pixels_of(other)[[1, 0, 3]], fitted), rtol=2e-7)
    ran = rxdetect("score", other, tmp_path / "out3.tif", "--background", saved, "-b", "1,2")
    assert (ran.code, "the saved background has 3 bands" in ran.err) == (1, True)


def test_bands_by_name_are_matched_with_a_saved_background(rxdetect, scene, tmp_path):
    saved, named, plain = (tmp_path / name for name in ("sea.json", "named.tif", "plain.tif"))
    assert rxdetect("score", scene, tmp_path / "a.tif", "-b", "blue,green,red", "--save-background", saved).code == 0
    assert rxdetect("score", scene, plain, "--background", saved).code == 0
    assert rxdetect("score", scene, named, "--background", saved, "-b", "red,blue,green").code == 0
    np.testing.assert_array_equal(read_raster(named)[0], read_raster(plain)[0])
    ran = rxdetect("score", scene, tmp_path / "other.tif", "--background", saved, "-b", "blue,green,nir")
    assert ran.code == 1
    assert says(ran.err, "3 bands: blue, green, red", "3: blue, green, nir")


@pytest.mark.parametrize(("option", "method"), [(("--window", "3,9"), "local"), (("--drop", "2"), "subspace")])
def test_auto_with_p_values_takes_the_method_of_an_option(rxdetect, scene, tmp_path, option, method):
    ran = rxdetect("score", scene, tmp_path / "out.tif", *option, "--p-value", tmp_path / "p.tif", "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["recipe"]["method"] == method


def test_a_band_of_classes_is_not_scored_without_being_named(rxdetect, sea, write, tmp_path):
    classes = np.full((1, *sea().shape[1:]), 6, np.uint16)
    path = write(tmp_path / "a.tif", np.concatenate([sea(), classes]), names=["blue", "green", "red", "nir", "SCL"])
    ran = rxdetect("score", path, tmp_path / "s.tif", "--method", "rx", "-v")
    assert "rx on 4 bands: blue, green, red, nir" in ran.err
    ran = rxdetect("score", path, tmp_path / "s.tif", "--method", "rx", "-v", "-b", "blue,nir,SCL", "--overwrite")
    assert "rx on 3 bands: blue, nir, SCL" in ran.err


def test_background_and_mask_from_files(rxdetect, scene, tmp_path, geojson, write):
    west, north = 400_000, 800_000
    ring = [(west, north), (west + 1000, north), (west + 1000, north - 2000), (west, north - 2000), (west, north)]
    area = geojson(tmp_path / "area.geojson", ring, crs="urn:ogc:def:crs:EPSG::32653")
    image, inside = pixels_of(scene), np.zeros((200, 230), bool)
    inside[:, :100] = True
    out = tmp_path / "out.tif"
    assert rxdetect("score", scene, out, "--background", area).code == 0
    np.testing.assert_array_equal(read_raster(out)[0], rx(image, inside))
    ran = rxdetect("score", scene, out, "--method", "rx", "--mask", area, "--overwrite", "--json")
    np.testing.assert_array_equal(read_raster(out)[0], rx(image, mask=inside))
    assert json.loads(ran.out)["pixels"]["masked_out"] == 200 * 130
    mask = write(tmp_path / "mask.tif", inside[None].astype(np.uint8), names=None)
    for method in ("local", "rx"):
        assert rxdetect("score", scene, out, "--mask", mask, "--overwrite", "--method", method).code == 0
        expected = (
            local.local_rx(image, inner=5, outer=21, mask=inside) if method == "local" else rx(image, mask=inside)
        )
        np.testing.assert_array_equal(read_raster(out)[0], expected)


def test_the_robust_sample_is_a_share_of_the_background_not_of_the_scene(rxdetect, scene, tmp_path, monkeypatch):
    monkeypatch.setattr(background, "ROBUST_SAMPLE", 600)
    image, inside = pixels_of(scene), np.zeros((200, 230), bool)
    inside[20:40, 30:60] = True
    whole = background.fit(image[:, 20:40, 30:60], covariance="mcd")
    assert whole.n > 500
    ran = rxdetect("score", scene, tmp_path / "o.tif", "--background", "30,20,30,20", "--covariance", "mcd", "--json")
    assert json.loads(ran.out)["background"]["n"] == whole.n == background.fit(image, mask=inside, covariance="mcd").n


@pytest.mark.parametrize("method", ["rx", "local"])
def test_scores_beyond_single_precision_are_the_largest_of_it(rxdetect, sea, write, tmp_path, method, recwarn):
    pixels = sea(height=40, width=50, dtype="float64")
    pixels[1, 20, 25] = 1e120
    scene, out = write(tmp_path / "scene.tif", pixels), tmp_path / "out.tif"
    options = ("--method", "rx", "--background", "0,0,50,10") if method == "rx" else ("--method", "local")
    ran = rxdetect("score", scene, out, *options)
    assert (ran.code, read_raster(out)[0, 20, 25]) == (0, np.finfo(np.float32).max)
    assert not recwarn.list


def test_water_mask_leaves_land_out(rxdetect, tmp_path, sea, write):
    pixels = sea(height=150, width=160)
    pixels[:, :, :60] = 9000 + np.random.default_rng(0).integers(0, 3000, (4, 150, 60))
    scene, out = write(tmp_path / "scene.tif", pixels), tmp_path / "out.tif"
    for method in ("rx", "local"):
        assert rxdetect("score", scene, out, "--mask", "water", "--overwrite", "--method", method).code == 0
        scores = read_raster(out)[0]
        assert np.isnan(scores[:, :60]).all()
        assert np.isfinite(scores[:, 70:]).mean() > 0.95


def test_the_rule_of_water_is_read_from_a_sidecar_with_roles_of_another_version(deglint, scene, tmp_path):
    out, sidecar = tmp_path / "clean.tif", tmp_path / "clean.tif.json"
    assert deglint("remove", scene, out, "--method", "hedley").code == 0
    known = water_of_removal(open_scene(out), 3)
    numbers = json.loads(sidecar.read_text())
    numbers["water"]["roles"]["swir"] = None
    sidecar.write_text(json.dumps(numbers))
    assert known is not None
    assert water_of_removal(open_scene(out), 3) == known


def test_a_deglinted_scene_is_told_that_rx_is_blind_to_it(rxdetect, deglint, scene, tmp_path):
    clean, out = tmp_path / "clean.tif", tmp_path / "out.tif"
    assert (
        deglint(
            "remove", scene, clean, "--method", "hedley", "--sample", "all", "--dtype", "float32", "--compensate", "off"
        ).code
        == 0
    )
    line = "do not change under hedley"
    for method in ("rx", "local", "residual"):
        assert line in rxdetect("score", clean, out, "--overwrite", "--method", method).err
    assert line not in rxdetect("score", clean, out, "--overwrite", "--method", "rx", "-b", "1,2,3").err
    assert line not in rxdetect("score", clean, out, "--overwrite", "--method", "subspace").err
    rxdetect("score", scene, tmp_path / "raw.tif", "--method", "rx")
    rxdetect("score", clean, out, "--overwrite", "--method", "rx")
    np.testing.assert_allclose(read_raster(out)[0], read_raster(tmp_path / "raw.tif")[0], rtol=2e-3)
    sidecar = tmp_path / "clean.tif.json"
    numbers = json.loads(sidecar.read_text())
    del numbers["model"]["method"]  # as another program may write it
    sidecar.write_text(json.dumps(numbers))
    ran = rxdetect("score", clean, out, "--overwrite", "--method", "rx")
    assert ran.code == 0
    assert line not in ran.err


def test_odd_covariances_are_told(rxdetect, tmp_path, sea, write):
    pixels = sea(height=60, width=60)
    pixels[2] = 7
    scene, out = write(tmp_path / "scene.tif", pixels), tmp_path / "out.tif"
    assert "1 of 4 bands are constant" in rxdetect("score", scene, out, "--method", "rx").err
    ran = rxdetect("score", scene, out, "--overwrite", "--method", "local")
    assert "3600 of 3600 pixels: covariance of the ring" in ran.err
    small = write(tmp_path / "small.tif", sea(height=5, width=5))
    assert "few pixels in the background" in rxdetect("score", small, out, "--overwrite", "--method", "rx").err


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--objects", "o.geojson"], 1, "give --pfa"),
        (["--method", "utd", "--p-value", "p.tif"], 1, "no known distribution"),
        (["--method", "utd", "--pfa", "1e-3", "--threshold", "f"], 1, "--threshold gpd or empirical"),
        (["--method", "local", "--covariance", "mcd"], 1, "--covariance must be empirical or ridge"),
        (["--method", "local", "--background", "1,1,5,5"], 1, "leave out --background"),
        (["--method", "sea", "--mask", "none", "--background", "1,1,5,5"], 1, "leave out --background"),
        (["--moving", "--pfa", "1e-3"], 1, "give --objects FILE"),
        (
            ["--pfa", "1e-3", "--objects", "o.geojson", "--chips", "scene.tif"],
            1,
            "scene.tif (--chips) is a file",
        ),
        (["--method", "local", "--save-background", "b.json"], 1, "Leave out --save-background"),
        (["--method", "local", "--window", "4,9"], 1, "want odd sides"),
        (["--method", "local", "--window", "x"], 2, "is not INNER,OUTER"),
        (["--method", "subspace", "--drop", "4"], 1, "drop: want 0 to 3"),
        (["--method", "rx", "--window", "3,9"], 1, "--window is for method local, not rx"),
        (["--method", "local", "--drop", "2"], 1, "--drop is for method subspace, not local"),
        (["--method", "rx", "--largest-object", "9,3"], 1, "--largest-object is for method sea, not rx"),
        (["--window", "3,9", "--drop", "2"], 1, "--drop is for method subspace, not local"),
        (["--ridge", "0.1"], 1, "--ridge needs --covariance ridge"),
        (["--pfa", "1e-3", "--min-size", "4"], 1, "are for objects: give --objects FILE"),
        (["--method", "residual", "-b", "1,2"], 1, "needs the NIR among the bands"),
        (["-b", "nonsense"], 1, "nonsense"),
        (["--pfa", "2"], 2, "0<x<1"),
        (["--pfa", "5%"], 2, "'5%' is not a valid share"),
        (["--pfa", "1e-6", "--threshold", "empirical"], 1, "Give 2.3e-05"),
        (["--background", "missing.geojson"], 1, "no such file"),
        (["--background", "5000,5000,5,5"], 1, "lies off the scene"),
        (["--background", "0,0,5,5"], 1, "0 valid pixels"),
        (["--mask", "0,0,5,5", "--background", "100,100,50,50"], 1, "0 valid pixels"),
        (["--p-value", "out.tif"], 1, "two outputs have the same name"),
        (["--nodata", "nonsense"], 2, "not a number"),
    ],
)
def test_refusals_leave_nothing_behind(rxdetect, scene, tmp_path, monkeypatch, options, code, message):
    monkeypatch.chdir(tmp_path)
    ran = rxdetect("score", scene, "out.tif", *options)
    assert ran.code == code, ran
    assert message in ran.err
    assert "a bug in" not in ran.err
    assert {p.name for p in tmp_path.iterdir()} == {"scene.tif"}
    if code == 1:
        assert len(ran.err.splitlines()) == 1


def test_nothing_to_score_is_exit_code_3(rxdetect, scene, tmp_path):
    saved = tmp_path / "sea.json"
    assert rxdetect("score", scene, tmp_path / "a.tif", "--save-background", saved).code == 0
    ran = rxdetect("score", scene, tmp_path / "b.tif", "--background", saved, "--mask", "0,0,5,5")
    assert ran.code == 3
    assert "nothing to score" in ran.err
    assert not (tmp_path / "b.tif").exists()


def test_an_output_that_exists_or_is_the_input_stays(rxdetect, scene, tmp_path):
    out = tmp_path / "out.tif"
    out.write_text("old")
    assert "exists already" in rxdetect("score", scene, out).err
    assert "would be lost" in rxdetect("score", scene, scene, "--overwrite").err
    assert out.read_text() == "old"


@pytest.fixture
def never_scored(monkeypatch):
    """Fail if a tile is scored."""

    def fail(_scoring, _tile):
        raise AssertionError("a tile was scored before the refusal")

    monkeypatch.setattr(flags.Scoring, "__call__", fail)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--false-per-km2", "1"], "false-per-km2 needs the size of a pixel"),
        (["--pfa", "1e-3", "--objects", "o.geojson", "--moving"], "--moving needs the size of a pixel"),
        (["--pfa", "1e-3", "--objects", "o.geojson", "--chips", "in.tif/a/b"], "in.tif (--chips) is a file"),
        (["--pfa", "1e-3", "--objects", "old.gpkg"], "old.qml exists already"),
        (["--pfa", "1e-3", "--objects", "o.geojson", "--chips", "chips"], "object_0001.png exists already"),
    ],
)
def test_refusals_come_before_the_long_work(
    rxdetect, tmp_path, sea, write, monkeypatch, never_scored, options, message
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "chips").mkdir()
    for name in ("old.qml", "chips/object_0001.png"):
        (tmp_path / name).write_text("old")

    def delays(dataset):
        for band in (1, 2, 3):
            dataset.update_tags(band, time_offset_s=str(band))

    source = write(tmp_path / "in.tif", sea(60, 70), crs=None, transform=None, describe=delays)
    ran = rxdetect("score", source, "out.tif", "--method", "sea", "--mask", "none", *options)
    assert (ran.code, message in ran.err) == (1, True), ran.err


def test_auto_takes_rx_for_fewer_pixels_than_the_statistics_of_water_need(rxdetect, tmp_path, sea, write):
    ran = rxdetect("score", write(tmp_path / "in.tif", sea(9, 9)), tmp_path / "out.tif")
    assert ran.code == 0, ran.err
    assert says(ran.err, "auto: rx", "81 pixels", "too few")


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (3, 2)])
@pytest.mark.parametrize("method", ["rx", "local"])
def test_tiny_scenes_are_scored_or_refused(tmp_path, sea, write, size, method, rxdetect):
    scene = write(tmp_path / "scene.tif", sea(*size))
    options = ("--window", "1,3") if method == "local" else ()
    ran = rxdetect("score", scene, tmp_path / "out.tif", "--method", method, *options)
    assert ran.code == (0 if size != (1, 1) else 3 if method == "local" else 1)
    assert "a bug in" not in ran.err


def test_python_gives_the_result_of_the_file(scene, tmp_path):
    result = score_file(scene, tmp_path / "out.tif", Recipe(method="rx", bands=("1", "2")), threads=2)
    assert (result.background.names, result.threshold, result.objects) == (("blue", "green"), None, None)
    assert result.counts.scored == 200 * 230 - 100


LOCAL = 'LOCAL_CS["site",UNIT["metre",1]]'


@pytest.mark.parametrize(("crs", "left"), [(LOCAL, 0.0), ("EPSG:32633", 5e8)], ids=["local", "outside"])
def test_objects_without_a_place_on_the_earth_keep_rows_and_columns(rxdetect, sea, write, tmp_path, crs, left):
    pixels = sea(60, 70)
    pixels[1, 30:33, 20:23] += 4000
    place = {"crs": crs, "transform": rasterio.transform.from_origin(left, 4e6, 2, 2)}
    out = tmp_path / "o.geojson"
    source = write(tmp_path / "in.tif", pixels, **place)
    ran = rxdetect("score", source, tmp_path / "out.tif", "--method", "rx", "--pfa", "1e-3", "--objects", out)
    assert ran.code == 0, ran.err
    (found,) = [f for f in json.loads(out.read_text())["features"] if f["properties"]["pixels"] > 4]
    assert [23, 33] in found["geometry"]["coordinates"][0]
    assert "longitude" not in found["properties"]


def test_a_corner_outside_the_projection_is_refused_in_one_line(write, sea, tmp_path):
    place = {"crs": "+proj=geos +h=35785831 +lon_0=0", "transform": rasterio.transform.from_origin(0, 2e6, 2e5, 2e5)}
    move = to_wgs84(open_scene(write(tmp_path / "disc.tif", sea(20, 20), **place)))
    with pytest.raises(InputError, match=r"outside.*CRS.*--mask"):
        move([(1, 1), (500, 1)])
