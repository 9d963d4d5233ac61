"""The whole job on every kind of input: what is corrected, what passes, and what goes from scene to scene."""

import json
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.shutil
import rasterio.vrt
from rasterio.transform import from_origin
from rasterio.warp import transform_geom

import deglint as library
from deglint import Recipe, fit_scene, open_scene, remove_glint
from deglint.errors import InputError

from .common import PLACE, PLAIN, RUN, says

SLOPES = (1.1, 1.0, 0.9)


def slopes_of(result):
    return [f.slope for f in result.fitted.model.fits]


def test_glint_goes_and_the_water_stays(sea, write, read, tmp_path):
    raw = sea(300, 300)
    result = remove_glint(write(tmp_path / "in.tif", raw), tmp_path / "out.tif")
    assert slopes_of(result) == pytest.approx(SLOPES, rel=0.01)
    out = read(tmp_path / "out.tif")
    assert (out[:3].std(axis=(1, 2)) < 0.1 * raw[:3].std(axis=(1, 2))).all()
    np.testing.assert_allclose(out[:3].mean(axis=(1, 2)), (900, 700, 400), rtol=0.03)
    np.testing.assert_array_equal(out[3], raw[3])


@pytest.mark.parametrize("size", [(1, 1), (1, 70), (70, 1), (17, 23), (64, 64), (65, 129), (3, 1000)])
@pytest.mark.parametrize("layout", [{}, {"tiled": True, "blockxsize": 16, "blockysize": 16, "compress": "lzw"}])
def test_any_size(sea, write, read, tmp_path, size, layout):
    raw = sea(*size)
    model = library.fit(
        "hedley", sea(dtype="float32"), nir=3, bands=[library.Band(n) for n in ("blue", "green", "red", "nir")]
    )
    source = write(tmp_path / "in.tif", raw, **layout)
    remove_glint(source, tmp_path / "out.tif", Recipe(mask="none"), model=model, flags=tmp_path / "f.tif")
    expected = library.apply(raw.astype(np.float64), model)
    np.testing.assert_allclose(read(tmp_path / "out.tif"), expected, atol=0.51)
    assert (read(tmp_path / "f.tif")[0] == 4).all()
    if raw[3].size >= 70:
        result = remove_glint(source, tmp_path / "out.tif", PLAIN, overwrite=True)
        assert result.fitted.model.fits[0].n == raw[3].size


def test_a_given_model_takes_its_own_recipe_and_refuses_another(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    model = fit_scene(open_scene(source), PLAIN).model
    for options in ({"method": "joyce"}, {"compensate": "thesis"}):
        with pytest.raises(InputError, match=r"model is hedley.*no stages.*--method"):
            remove_glint(source, tmp_path / "out.tif", Recipe(**options), model=model)
    own = replace(PLAIN, nir_use="best")
    result = remove_glint(source, tmp_path / "own.tif", own, model=model)
    assert (result.fitted.recipe.method, result.fitted.recipe.nir_use) == ("hedley", "auto")
    used = Recipe(mask="none", nir=("nir",), bands=("blue",), compensate="off")
    assert remove_glint(source, tmp_path / "out.tif", used, model=model).changed == ("blue",)


def test_a_scene_too_small_for_a_fit_says_so(deglint, sea, write, tmp_path):
    ran = deglint("remove", write(tmp_path / "in.tif", sea(1, 1)), tmp_path / "out.tif", *RUN)
    assert ran.code == 1
    assert "64 are needed" in ran.err


def test_bands_choose_what_is_corrected(deglint, sea, write, read, tmp_path):
    raw = sea()
    source = write(tmp_path / "in.tif", raw)
    assert deglint("remove", source, tmp_path / "out.tif", *RUN, "-b", "green,1").code == 0
    out = read(tmp_path / "out.tif")
    np.testing.assert_array_equal(out[2:], raw[2:])
    assert all((out[b] != raw[b]).any() for b in (0, 1))
    said = json.loads((tmp_path / "out.tif.json").read_text())
    assert said["skipped"]["red"] == "not among the bands to correct: copied"
    assert said["recipe"]["nir"] == ["nir"]


def test_two_nir_bands_are_averaged(deglint, sea, write, tmp_path):
    raw = np.concatenate([sea(), sea()[3:] * 2])
    source = write(tmp_path / "in.tif", raw, names=("blue", "green", "red", "NIR1", "NIR2"))
    ran = deglint("remove", source, tmp_path / "out.tif", *RUN, "--nir", "NIR1,5")
    assert ran.code == 0
    index = json.loads((tmp_path / "out.tif.json").read_text())["model"]["indexes"][0]
    assert index["bands"] == [3, 4]
    assert index["weights"] == [0.5, 0.5]


def test_land_and_cloud_and_nodata_are_copied(sea, write, read, tmp_path):
    raw = sea(300, 320)
    rng = np.random.default_rng(1)
    land = np.zeros(raw.shape[1:], bool)
    land[:120, :140] = True
    raw[:, land] = (np.array([300, 500, 600, 3000])[:, None] * rng.normal(1, 0.1, (4, land.sum()))).astype(np.uint16)
    cloud = np.zeros_like(land)
    cloud[200:260, 220:300] = True
    raw[:, cloud] = rng.normal(12_000, 300, (4, cloud.sum())).astype(np.uint16)
    nodata = np.zeros_like(land)
    nodata[280:, :50] = True
    raw[:, nodata] = 0
    result = remove_glint(write(tmp_path / "in.tif", raw, nodata=0), tmp_path / "out.tif", flags=tmp_path / "f.tif")
    out, flags = read(tmp_path / "out.tif"), read(tmp_path / "f.tif")[0]
    for where in (land, cloud, nodata):
        np.testing.assert_array_equal(out[:, where], raw[:, where])
    assert (flags[land | cloud] == 2).all()
    assert (flags[nodata] == 1).all()
    open_water = ~(land | cloud | nodata)
    assert (flags[open_water] & 4 != 0).mean() > 0.97
    assert slopes_of(result) == pytest.approx(SLOPES, rel=0.02)


@pytest.mark.parametrize(("names", "found"), [(("B05", "B06", "B07", "B8A"), True), (None, False)])
def test_land_is_known_by_the_red_edge_or_it_is_said_that_it_is_not(names, found, sea, write, read, tmp_path, caplog):
    raw = sea(100, 200)
    raw[:, :, 120:] = np.array([300, 700, 800, 3000])[:, None, None] + raw[:, :, 120:] // 8
    source = write(tmp_path / "in.tif", raw, names=names or [f"layer {n}" for n in "abcd"])
    remove_glint(source, tmp_path / "out.tif", Recipe(method="wiener", nir=(4,), compensate="off"))
    assert ("every valid pixel is corrected" in caplog.text) is not found
    changed = (read(tmp_path / "out.tif") != raw).any(axis=0)
    assert changed[:, :118].mean() > 0.5
    assert changed[:, 120:].any() != found


def masked_by(sea, write, read, tmp_path, mask):
    raw = sea()
    source = write(tmp_path / "in.tif", raw)
    remove_glint(source, tmp_path / "out.tif", Recipe(method="hedley", sample="all", mask=str(mask)),
                 flags=tmp_path / "f.tif")  # fmt: skip
    remove_glint(source, tmp_path / "all.tif", PLAIN)
    flags = read(tmp_path / "f.tif")[0]
    inside = flags & 4 != 0
    out = read(tmp_path / "out.tif")
    np.testing.assert_array_equal(out[:, ~inside], raw[:, ~inside])
    np.testing.assert_array_equal(out[:, inside], read(tmp_path / "all.tif")[:, inside])
    return inside


def test_a_mask_limits_what_is_corrected(sea, write, read, geojson, tmp_path):
    values = (np.random.default_rng(0).random((1, 80, 100)) < 0.4).astype(np.uint8)
    inside = masked_by(sea, write, read, tmp_path, write(tmp_path / "m.tif", values, names=None))
    np.testing.assert_array_equal(inside, values[0] != 0)


def test_geojson_in_degrees_as_a_mask(sea, write, read, geojson, tmp_path):
    ring = [(400_204, 799_896), (400_606, 799_896), (400_606, 799_494), (400_204, 799_494), (400_204, 799_896)]
    own = transform_geom("EPSG:32653", "EPSG:4326", {"type": "Polygon", "coordinates": [ring]})
    inside = masked_by(sea, write, read, tmp_path, geojson(tmp_path / "m.geojson", own["coordinates"][0]))
    expected = np.zeros((80, 100), bool)
    expected[10:51, 20:61] = True
    np.testing.assert_array_equal(inside, expected)


def test_a_mask_on_another_grid(sea, write, read, tmp_path):
    coarse = np.zeros((1, 8, 10), np.uint8)
    coarse[0, 2:5, 3:7] = 1
    place = from_origin(400_000, 800_000, 100, 100)
    inside = masked_by(sea, write, read, tmp_path, write(tmp_path / "m.tif", coarse, names=None, transform=place))
    np.testing.assert_array_equal(inside, np.kron(coarse[0], np.ones((10, 10))) != 0)


def test_a_sample_in_degrees_is_the_same_as_in_metres(sea, write, geojson, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    ring = [(400_204, 799_896), (400_606, 799_896), (400_606, 799_494), (400_204, 799_494), (400_204, 799_896)]
    degrees = transform_geom("EPSG:32653", "EPSG:4326", {"type": "Polygon", "coordinates": [ring]})
    paths = [geojson(tmp_path / "m.geojson", ring, crs="EPSG:32653"),
             geojson(tmp_path / "d.geojson", degrees["coordinates"][0]), "20,10,41,41"]  # fmt: skip
    fits = [fit_scene(open_scene(source), Recipe(method="hedley", sample=p, mask="none")).model for p in paths]
    assert fits[0] == fits[1] == fits[2]
    block = sea()[:, 10:51, 20:61].astype(np.float64)
    assert fits[0].fits[0].n == block[0].size
    for fit in fits[0].fits:
        expected = np.cov(block[fit.band].ravel(), block[3].ravel())
        assert fit.slope == pytest.approx(expected[0, 1] / expected[1, 1], rel=1e-9)
    assert fits[0].indexes[0].level == block[3].min()


def test_a_saved_sample_gives_the_same_fit(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(300, 300))
    saved = tmp_path / "s.geojson"
    ran = deglint(
        "remove", source, tmp_path / "a.tif", "--method", "hedley", "--regression", "ols", "--save-sample", saved
    )
    assert ran.code == 0
    assert json.loads(saved.read_text())["type"] == "FeatureCollection"
    assert deglint("remove", source, tmp_path / "b.tif", "--method", "hedley", "--sample", saved).code == 0
    one, other = (json.loads((tmp_path / f"{n}.tif.json").read_text()) for n in "ab")
    assert one["model"]["fits"] == other["model"]["fits"]
    assert one["sample"]["pixels"] == other["sample"]["pixels"]


def test_a_saved_model_goes_onto_another_scene(deglint, sea, write, read, tmp_path):
    first = write(tmp_path / "first.tif", sea(seed=1))
    raw = sea(seed=2)
    order = [3, 1, 0, 2]
    second = write(tmp_path / "second.tif", raw[order], names=[("blue", "green", "red", "nir")[b] for b in order])
    model = tmp_path / "model.json"
    assert deglint("remove", first, tmp_path / "a.tif", *RUN, "--save-model", model).code == 0
    assert deglint("remove", second, tmp_path / "b.tif", "--mask", "none", "--model", model).code == 0
    fitted = library.GlintModel.from_json(model.read_text())
    expected = library.apply(raw.astype(np.float64), fitted)[order]
    np.testing.assert_allclose(read(tmp_path / "b.tif"), expected, atol=0.51)
    said = json.loads((tmp_path / "b.tif.json").read_text())
    assert [f["slope"] for f in said["model"]["fits"]] == [f.slope for f in fitted.fits]
    ran = deglint("remove", second, tmp_path / "d.tif", "--mask", "none", "--model", model, "-b", "nope")
    assert ran.code == 1
    assert "no band 'nope'" in ran.err
    again = tmp_path / "again.json"
    assert (
        deglint("remove", second, tmp_path / "c.tif", "--mask", "none", "--model", model, "--save-model", again).code
        == 0
    )
    assert {f.name: f.slope for f in library.GlintModel.from_json(again.read_text()).fits} == {
        f.name: f.slope for f in fitted.fits
    }


def test_a_model_of_other_units_is_warned_of(deglint, sea, write, tmp_path):
    model, counts = tmp_path / "model.json", sea()
    reflectance = write(tmp_path / "first.tif", counts.astype(np.float32) / 10_000)
    assert deglint("remove", reflectance, tmp_path / "a.tif", *RUN, "--save-model", model).code == 0
    ran = deglint("remove", write(tmp_path / "second.tif", counts), tmp_path / "b.tif", "--model", model)
    assert (ran.code, "units may differ" in ran.err) == (0, True)
    ran = deglint("remove", reflectance, tmp_path / "c.tif", "--model", model)
    assert (ran.code, "units may differ" in ran.err) == (0, False)


def test_of_a_saved_model_the_named_bands_are_used(deglint, sea, write, read, tmp_path):
    source, model, out = write(tmp_path / "in.tif", sea()), tmp_path / "model.json", tmp_path / "out.tif"
    assert deglint("remove", source, tmp_path / "all.tif", *RUN, "--save-model", model).code == 0
    again = ("remove", source, out, "--mask", "none", "--model", model)
    assert deglint(*again, "-b", "green", "--nir", "nir").code == 0
    expected = sea()
    expected[1] = read(tmp_path / "all.tif")[1]
    np.testing.assert_array_equal(read(out), expected)
    assert list(json.loads((tmp_path / "out.tif.json").read_text())["pixels"]["changed"]) == ["green"]
    for options, said in (
        (("-b", "nir"), "does not correct nir"),
        (("--nir", "red"), "leave out --nir"),
        (("--nir", "nosuch"), "no band 'nosuch'"),
    ):
        ran = deglint(*again, *options, "--overwrite")
        assert ran.code == 1
        assert said in ran.err


def test_of_a_saved_model_with_stages_the_named_bands_are_used(deglint, sea, write, read, tmp_path):
    source, model, out = write(tmp_path / "in.tif", sea()), tmp_path / "model.json", tmp_path / "out.tif"
    stages = ("--method", "wiener", "--compensate", "remove, posterior", "--mask", "none")
    assert deglint("remove", source, tmp_path / "all.tif", *stages, "--save-model", model).code == 0
    again = ("remove", source, out, "--mask", "none", "--model", model)
    ran = deglint(*again, "-b", "green")
    assert "compensation: remove, posterior\n" in ran.err
    expected = sea()
    expected[1] = read(tmp_path / "all.tif")[1]
    np.testing.assert_array_equal(read(out), expected)
    assert says(deglint(*again, "-b", "nir", "--overwrite").err, "does not correct nir", "-b")
    alone = deglint(*again, "--compensate", "off", "--overwrite")  # the removal was fitted for its stages
    assert says(alone.err, "stages remove, posterior", "leave out", "--compensate")
    assert alone.code == 1


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["plain", "with red edge"])
def test_a_saved_model_gives_the_same_on_its_own_scene(deglint, sea, write, read, tmp_path, scene):
    """Also where a reference comes before the NIR in the file: water is found with the NIR, stages are applied."""
    samples = Path(__file__).parents[1] / "sample_data"
    first = samples / "sea.tif" if scene == "with red edge" else write(tmp_path / "first.tif", sea(200, 200))
    assert deglint("remove", first, tmp_path / "a.tif", "--save-model", tmp_path / "m.json").code == 0
    assert deglint("remove", first, tmp_path / "b.tif", "--model", tmp_path / "m.json").code == 0
    np.testing.assert_array_equal(read(tmp_path / "a.tif"), read(tmp_path / "b.tif"))
    fitted, applied = (json.loads((tmp_path / f"{name}.tif.json").read_text())["recipe"] for name in "ab")
    assert applied["compensate"] == fitted["compensate"]


def test_no_sample_to_save_is_said(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    ran = deglint("remove", source, tmp_path / "out.tif", "--method", "nir-subtraction", "--mask", "none",
                  "--save-sample", tmp_path / "s.geojson")  # fmt: skip
    assert ran.code == 1
    assert says(ran.err, "not fitted to a sample", "--save-sample")


@pytest.mark.parametrize("name", ["/vsizip/{}/scene.tif", "zip://{}!scene.tif"])
def test_names_of_gdal_are_read(deglint, sea, write, read, tmp_path, name):
    source = write(tmp_path / "scene.tif", sea())
    with zipfile.ZipFile(tmp_path / "scene.zip", "w") as archive:
        archive.write(source, "scene.tif")
    assert deglint("remove", name.format(tmp_path / "scene.zip"), tmp_path / "zipped.tif", *RUN).code == 0
    assert deglint("remove", source, tmp_path / "plain.tif", *RUN).code == 0
    np.testing.assert_array_equal(read(tmp_path / "zipped.tif"), read(tmp_path / "plain.tif"))
    said = json.loads((tmp_path / "zipped.tif.json").read_text())
    assert said["input"][0]["crc32"] is None


def test_envi_and_vrt_become_geotiff(deglint, sea, write, read, tmp_path):
    raw = sea()
    envi = write(tmp_path / "scene.img", raw, driver="ENVI")
    plain = write(tmp_path / "scene.tif", raw)
    vrt = tmp_path / "scene.vrt"
    with rasterio.open(plain) as dataset, rasterio.vrt.WarpedVRT(dataset) as warped:
        rasterio.shutil.copy(warped, vrt, driver="VRT")
    assert deglint("remove", plain, tmp_path / "plain_out.tif", *RUN).code == 0
    for source in (envi, vrt):
        out = tmp_path / f"{Path(source).suffix[1:]}_out.tif"
        ran = deglint("remove", source, out, *RUN, "--nir", "4", "-b", "1,2,3")
        assert ran.code == 0, ran.err
        np.testing.assert_array_equal(read(out), read(tmp_path / "plain_out.tif"))
        with rasterio.open(out) as dataset:
            assert dataset.driver == "GTiff"
            assert dataset.crs.to_epsg() == 32653
            assert dataset.transform == PLACE["transform"]


def test_files_of_one_band_and_different_pixels_are_stacked(deglint, sea, write, tmp_path):
    raw = sea()
    paths = [write(tmp_path / f"B0{i + 2}.tif", raw[i : i + 1], names=None) for i in range(3)]
    coarse = raw[3].reshape(40, 2, 50, 2).mean(axis=(1, 3)).astype(np.uint16)[None]
    place = from_origin(400_000, 800_000, 20, 20)
    paths.append(write(tmp_path / "B08.tif", coarse, names=None, transform=place))
    ran = deglint("remove", *paths, tmp_path / "out.tif", *RUN, "--picture", tmp_path / "p.png")
    assert ran.code == 0, ran.err
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.shape == (80, 100)
        assert dataset.count == 4
        assert dataset.dtypes == ("uint16",) * 4
    said = json.loads((tmp_path / "out.tif.json").read_text())
    assert [b["name"] for b in said["bands"]] == ["B02", "B03", "B04", "B08"]
    assert [Path(i["path"]).name for i in said["input"]] == ["B02.tif", "B03.tif", "B04.tif", "B08.tif"]
    assert deglint("remove", *paths, tmp_path / "coarse.tif", *RUN, "--grid", "4").code == 0
    with rasterio.open(tmp_path / "coarse.tif") as dataset:
        assert dataset.shape == (40, 50)


def test_files_that_cover_different_ground_keep_what_is_missing_as_nodata(sea, write, read, tmp_path):
    raw = sea()
    paths = [write(tmp_path / f"B0{i + 2}.tif", raw[i : i + 1], names=None) for i in range(3)]
    part = raw[3:, :50]  # the NIR ends after 50 rows
    paths.append(write(tmp_path / "B08.tif", part, names=None))
    result = remove_glint(paths, tmp_path / "out.tif", PLAIN)
    assert result.counts.nodata == 30 * 100
    assert result.fitted.model.fits[0].n == 50 * 100
    with rasterio.open(tmp_path / "out.tif") as dataset:
        out = dataset.read()
        np.testing.assert_array_equal(dataset.read_masks(4)[50:], 0)
        np.testing.assert_array_equal(dataset.read_masks(4)[:50], 255)
    np.testing.assert_array_equal(out[:3, 50:], raw[:3, 50:])


def test_without_crs_and_place(deglint, sea, write, read, tmp_path):
    raw = sea()
    source = write(tmp_path / "in.tif", raw, crs=None, transform=None)
    ran = deglint("remove", source, tmp_path / "out.tif", "--mask", "0,0,100,80", "--sample", "5,5,90,70",
                  "--save-sample", tmp_path / "s.geojson")  # fmt: skip
    assert ran.code == 0, ran.err
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.crs is None
        assert dataset.transform.is_identity
    assert "crs" not in json.loads((tmp_path / "s.geojson").read_text())


def test_many_bands(sea, write, read, tmp_path):
    raw = np.concatenate([sea(90, 70)[:3]] * 33 + [sea(90, 70)[3:]])
    source = write(tmp_path / "in.tif", raw, names=[f"b{i}" for i in range(100)])
    recipe = Recipe(method="hedley", sample="all", mask="none", nir=("100",), bands=tuple(map(str, range(1, 100))))
    result = remove_glint(source, tmp_path / "out.tif", recipe)
    assert slopes_of(result) == pytest.approx(SLOPES * 33, rel=0.01)
    assert read(tmp_path / "out.tif").shape == (100, 90, 70)


def test_the_input_is_only_read(sea, write, tmp_path):
    source = Path(write(tmp_path / "in.tif", sea()))
    before, when = source.read_bytes(), source.stat().st_mtime_ns
    remove_glint(source, tmp_path / "out.tif")
    assert source.read_bytes() == before
    assert source.stat().st_mtime_ns == when


def test_progress_counts_to_the_end(sea, write, tmp_path):
    seen = []
    remove_glint(write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", progress=lambda *a: seen.append(a))
    assert {stage for stage, _, _ in seen} == {"fit", "correct"}
    for stage in ("fit", "correct"):
        done = [(d, t) for s, d, t in seen if s == stage]
        assert [d for d, _ in done] == list(range(1, done[-1][1] + 1))


def test_info_of_a_scene_that_cannot_be_worked_on(deglint, write, tmp_path):
    source = write(tmp_path / "in.tif", np.zeros((4, 30, 30), np.uint16), nodata=0)
    ran = deglint("info", source, "--json")
    assert ran.code == 0
    said = json.loads(ran.out)
    assert said["suggested_method"] is None
    assert said["reason"]
    assert deglint("info", source).code == 0


def test_the_library_has_the_same_in_steps(sea, write, read, tmp_path):
    source = write(tmp_path / "in.tif", sea(dtype="float32"))
    scene = open_scene(source)
    fitted = fit_scene(scene, PLAIN)
    clean = library.apply(scene.read(), fitted.model)
    remove_glint(source, tmp_path / "out.tif", PLAIN)
    np.testing.assert_array_equal(read(tmp_path / "out.tif"), clean)
    fitted = fit_scene(scene)  # with all that is found out by itself
    whole = library.correct(scene, fitted)
    remove_glint(source, tmp_path / "auto.tif")
    np.testing.assert_array_equal(read(tmp_path / "auto.tif"), whole)
    np.testing.assert_array_equal(library.correct(scene, fitted, window=((3, 50), (10, 90))), whole[:, 3:50, 10:90])
    with pytest.raises(InputError, match="nir_use"):
        fit_scene(scene, Recipe(method="hedley", nir_use="sideways"))


@pytest.mark.slow
def test_the_module_runs_as_a_program(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    call = [sys.executable, "-m", "deglint", "remove", source, str(tmp_path / "out.tif"), *RUN, "--json", "-q"]
    done = subprocess.run(call, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["pixels"]["corrected"] == 8000
    assert done.stderr == ""
