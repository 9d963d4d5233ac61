"""The sea and what floats on it: region, detector, false-alarm rates, files of objects."""

import json
import re
import sqlite3
import struct
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from deglint import open_scene
from deglint.errors import InputError
from detect.objects import find, find_among
from detect.pipeline import Recipe, plan, score_file
from detect.sea.model import SIDES, fit, score
from detect.sea.region import AFLOAT, ALONGSIDE, ATTACHED, NOT_SEA, RIM, WATER, SeaRule, region
from detect.sea.search import clutter_of, score_scene
from detect.threshold import Tail

from ..common import ROOT, SHARED, beside, says

SHIPS = [(40, 60), (90, 150), (150, 40), (60, 210)]


def port(seed=0, ships=SHIPS):
    """Four bands of sea with swell, land on the right with a quay, ships of 4 x 12 pixels, and the water."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:200, :300]
    swell = 12 * np.sin(columns / 3 + rows / 9) + rng.gamma(2, 6, (200, 300))
    image = np.stack([level + share * swell + rng.normal(0, 3, (200, 300))
                      for level, share in ((900, 0.7), (700, 0.8), (450, 0.9), (200, 1.0))])  # fmt: skip
    water = columns < 260
    land = ~water
    land[100:104, 215:260] = True  # a quay of 450 m
    image[:, land] = np.array([1500, 1700, 1800, 3000])[:, None] + rng.normal(0, 200, (4, land.sum()))
    for row, column in ships:
        image[:, row : row + 4, column : column + 12] = np.array([2500, 2500, 2600, 2700])[:, None, None]
    return image.astype(np.uint16), ~land


@pytest.fixture
def scene(tmp_path, write):
    image, _ = port()
    return write(tmp_path / "port.tif", image)


def test_holes_and_protrusions_of_a_ships_size_are_sea():
    water = np.ones((120, 160), bool)
    water[:, 130:] = False
    water[20:24, 30:45] = False  # 150 m by 40 m, afloat
    water[60:80, 30:50] = False  # an island of 200 m by 200 m
    water[40:45, 112:130] = False  # a ship at the quay, 180 m by 50 m
    water[90:93, 80:130] = False  # a pier of 500 m
    found = region(water, SeaRule(10.0))
    at = {"afloat": (22, 40), "island": (70, 40), "ship": (42, 120), "pier": (91, 100), "land": (10, 150),
          "open": (10, 10), "shore": (10, 129)}  # fmt: skip
    assert {k: int(found[p]) for k, p in at.items()} == {
        "afloat": AFLOAT, "island": NOT_SEA, "ship": ALONGSIDE, "pier": NOT_SEA, "land": NOT_SEA, "open": WATER,
        "shore": RIM}  # fmt: skip
    exact = region(water, SeaRule(10.0, 0, 0))
    assert not np.isin(exact, (AFLOAT, ALONGSIDE)).any()


def test_holes_beside_land_or_cut_by_the_border_are_attached():
    water = np.ones((120, 160), bool)
    water[:, 130:] = False
    water[20:23, 126:129] = False  # one pixel of water between
    water[40:43, 125:128] = False  # two
    water[60:64, 114:129] = False  # a ship, its bow one pixel off the quay
    water[80:84, :4] = False
    found = region(water, SeaRule(10.0))
    at = {"one": (21, 127), "two": (41, 126), "ship": (62, 120), "border": (82, 2), "between": (21, 129)}
    assert {k: int(found[p]) for k, p in at.items()} == {
        "one": ATTACHED, "two": AFLOAT, "ship": ALONGSIDE, "border": ATTACHED, "between": RIM}  # fmt: skip


@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_what_land_continues_at_both_ends_is_no_ship(slope):
    """A strip between two shores, and the same with a gap: a quay with a free end on either side of it."""
    water = np.ones((120, 160), bool)
    water[:, :50] = water[:, 80:] = False
    rows, columns = np.mgrid[:120, :160]
    water &= abs(rows - 60 - slope * (columns - 65)) > 2
    bridge = region(water, SeaRule(10.0))
    water[:, 72:74] = True
    apart = region(water, SeaRule(10.0))
    between = columns - 50 < 30
    assert not (bridge[between] == ALONGSIDE).any()
    assert apart[60, 62] == ALONGSIDE


def test_what_is_attached_to_land_is_clutter_and_no_object(rxdetect, write, tmp_path):
    image, _ = port()
    image[:, 96:99, 225:228] = image[:, 190:193, 40:43] = np.array([2500, 2500, 2600, 2700])[:, None, None]
    scene = write(tmp_path / "port.tif", image)
    marked = tmp_path / "found.geojson"
    ran = rxdetect("score", scene, tmp_path / "out.tif", "--pfa", "1e-3", "--objects", marked)
    assert ran.code == 0, ran.err
    searched = score_scene(image[:3], image[3] < 1000, pfa=1e-3)
    for objects in ([f["properties"] for f in json.loads(marked.read_text())["features"]], searched.objects):
        for (row, column), count in (((97, 226), 0), ((191, 41), 1)):
            assert sum(np.hypot(o["row"] - row, o["column"] - column) < 6 for o in objects) == count
    assert rasterio.open(tmp_path / "out.tif").read(1)[97, 226] > 20


@pytest.mark.parametrize("side", SIDES)
def test_dark_anomalies_count_where_both_are_wanted(side):
    image, water = port(ships=())
    image[:3, 80:86, 80:86] = 100
    classes = region(water, SeaRule(10.0))
    scores = score(image[:3], classes, fit([(image[:3], classes)], side=side))
    inside = scores[81:85, 81:85]
    assert (inside.min() > 6) == (side == "both")
    assert np.isnan(scores[classes == RIM]).all()


def test_a_block_with_its_halo_scores_as_the_whole():
    image, water = port()
    rule = SeaRule(10.0)
    classes = region(water, rule)
    model = fit([(image, classes)])
    whole = score(image, classes, model)
    halo = model.halo + rule.halo
    part = slice(0, 100 + halo)
    block = score(image[:, part], region(water[part], rule), model)
    np.testing.assert_allclose(block[:100], whole[:100], rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("pfa", [1e-3, 1e-4])
def test_the_requested_rate_is_the_observed_one_below_anomalies(seed, pfa):
    rng = np.random.default_rng(seed)
    shape = (1000, 1000)
    scores = np.abs(rng.standard_t(6, shape))
    ships = np.zeros(shape, bool)
    for row, column in rng.integers(20, 970, (40, 2)):
        ships[row : row + 8, column : column + 14] = True
    scores[ships] = 60 + rng.normal(0, 5, ships.sum())  # 0.4 % of the sea: more than either rate
    q90 = float(np.quantile(scores[~ships], 0.9))
    candidates = find(scores > 1.5 * q90, scores)
    clutter = clutter_of(Tail.of(scores), candidates, q90, area=100.0)
    threshold = clutter.threshold(pfa)
    assert clutter.confirmed >= 35
    assert 0.5 < (scores[~ships] > threshold.value).mean() / pfa < 2
    rates = [clutter.false_per_km2(s) for s in np.linspace(clutter.low + 0.1, 90, 50)]
    assert (np.diff(rates) <= 0).all()
    for rate in (10.0, 0.5, 0.005):
        assert clutter.false_per_km2(clutter.score_at(rate)) == pytest.approx(rate, rel=0.05, abs=1.01 / 100)


def test_a_brighter_object_is_never_more_likely_false_where_the_law_ends():
    scores = np.zeros((800, 20))
    scores[::2, 5:8] = 1.6 + 6 * np.random.default_rng(5).beta(1, 3, 400)[:, None]
    clutter = clutter_of(Tail.of(scores), find(scores > 1.5, scores), 1.0, area=4.0)
    assert clutter.shape < -0.1
    end = clutter.low - clutter.scale / clutter.shape
    rates = [clutter.false_per_km2(s) for s in np.linspace(clutter.peaks[-1], 1.5 * end, 200)]
    assert (np.diff(rates) <= 0).all()
    assert rates[-1] == 0
    assert clutter.false_per_km2(clutter.score_at(0.01)) == pytest.approx(0.01)
    alone = replace(clutter, peaks=np.append(clutter.peaks, 1e6), shape=0.0)  # the distribution never gets there
    assert alone.false_per_km2(2e6) == 0
    assert np.isfinite(alone.score_at(0.001))


def test_few_candidates_are_ranked_not_fitted():
    scores = np.zeros((50, 50))
    scores[::10, ::10] = 5 + np.arange(25).reshape(5, 5)
    candidates = find(scores > 3, scores)
    clutter = clutter_of(Tail.of(scores), candidates, 1.0, area=25.0)
    assert not clutter.fitted
    assert clutter.false_per_km2(100.0) == pytest.approx(1 / 25)
    assert "quantile" in " ".join(clutter.threshold(0.01).notes)


def test_a_law_is_not_fitted_to_few_boats_because_noise_has_many_peaks():
    scores = np.zeros((100, 100))
    scores[::5, ::5] = 2.0  # above the level of candidates, but below it as the mean of three pixels
    for column, boat in enumerate((3.0, 3.0, 3.2, 12.0)):
        scores[50:52, 20 * column : 20 * column + 2] = boat
    clutter = clutter_of(Tail.of(scores), find(scores > 1.5, scores), 1.0, area=1.0)
    assert len(clutter.peaks) == 400
    assert not clutter.fitted
    assert clutter.score_at(0.05) == 12.0


def test_a_large_offset_does_not_hide_the_sea():
    waves = np.random.default_rng(0).normal(0, 1, (3, 100, 100))
    waves[:, 50:53, 60:70] += 20
    waves[:, 0, 0] = 1e300
    near, far = score_scene(waves).scores, score_scene(waves + 1e8).scores
    np.testing.assert_allclose(far, near, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("size", [(np.inf, 60), (np.inf, np.inf), (np.nan, 60), (60, 400)])
def test_a_largest_object_without_a_size_is_refused(size):
    with pytest.raises(InputError, match="width <= length < infinity"):
        SeaRule(10.0, *size)


@pytest.mark.parametrize("given", [("--pfa", "1e-3"), ("--false-per-km2", "0.5")])
def test_ships_are_found_and_placed(rxdetect, scene, tmp_path, given):
    marked, chips = tmp_path / "found.geojson", tmp_path / "chips"
    options = (*given, "--objects", marked, "--chips", chips, "--flags", tmp_path / "f.tif", "--json")
    ran = rxdetect("score", scene, tmp_path / "out.tif", *options)
    assert ran.code == 0, ran.err
    said = json.loads(ran.out)
    assert said["recipe"]["method"] == "sea"
    document = json.loads(marked.read_text())
    assert "crs" not in document
    first = [f["properties"] for f in document["features"][:4]]
    assert {(round(p["row"] - 1.5), round(p["column"] - 5.5)) for p in first} == set(SHIPS)
    for p in first:
        assert p["length_m"] == pytest.approx(120, abs=25)
        assert p["bearing"] == pytest.approx(90, abs=10)
        assert p["false_per_km2"] < 0.2 < p["probability"]
        assert 120 < p["longitude"] < 135
        assert (tmp_path / p["chip"]).read_bytes().startswith(b"\x89PNG")
    flags = rasterio.open(tmp_path / "f.tif").read(1)
    assert (flags[41, 65] & 64, flags[10, 290] & 2, flags[10, 259] & 32) == (64, 2, 32)


def test_geopackage_holds_what_geojson_does(rxdetect, scene, tmp_path):
    for name in ("found.gpkg", "found.geojson"):
        ran = rxdetect("score", scene, tmp_path / "o.tif", "--pfa", "1e-3", "--objects", tmp_path / name, "--overwrite")
        assert ran.code == 0, ran.err
    features = json.loads((tmp_path / "found.geojson").read_text())["features"]
    with closing(sqlite3.connect(tmp_path / "found.gpkg")) as db:
        assert db.execute("PRAGMA application_id").fetchone()[0] == 0x47504B47
        rows = db.execute("SELECT geom, label, longitude, kind FROM objects ORDER BY fid").fetchall()
        assert db.execute("SELECT srs_id FROM gpkg_contents").fetchone() == (4326,)
        columns = [row[1] for row in db.execute("PRAGMA table_info(objects)")]
    assert columns[2:] == list(dict.fromkeys(k for f in features for k in f["properties"]))  # null columns, too
    assert [r[1] for r in rows] == [f["properties"]["label"] for f in features]
    blob, _, longitude, kind = rows[0]
    assert (blob[:2], struct.unpack("<i", blob[4:8])[0], kind) == (b"GP", 4326, "afloat")
    low, high = struct.unpack("<2d", blob[8:24])
    assert low < longitude < high
    assert "<qgis" in (tmp_path / "found.qml").read_text()


def test_a_rate_per_area_is_not_called_a_requested_rate_per_pixel(rxdetect, scene, tmp_path):
    ran = rxdetect("score", scene, tmp_path / "out.tif", "--false-per-km2", "1")
    assert says(ran.err, "(peaks): requested 1 false objects per km2", "observed Pfa"), ran.err


def test_pixels_without_coordinates_have_the_size_in_the_tag(rxdetect, write, tmp_path):
    path = write(tmp_path / "a.tif", port()[0], crs=None, describe=lambda d: d.update_tags(GSD_M="8"), transform=None)
    ran = rxdetect("score", path, tmp_path / "out.tif", "--method", "sea", "--false-per-km2", "1")
    assert "pixels 8 m" in ran.err, ran.err


def test_the_size_assumed_for_pixels_is_logged_once(rxdetect, write, tmp_path):
    path = write(tmp_path / "a.tif", port()[0], crs=None, transform=None)
    ran = rxdetect("score", path, tmp_path / "out.tif", "--method", "sea")
    assert "taken as 10 m" in ran.err, ran.err
    assert "below 1 m" not in ran.err


def test_large_scenes_are_sampled_in_all_parts(tmp_path, write, monkeypatch):
    monkeypatch.setattr(plan, "_SAMPLE_BLOCK", 64)
    rng = np.random.default_rng(0)
    rougher = np.linspace(1, 30, 1024)[:, None]  # downwards
    image = 500 + rougher * rng.normal(size=(3, 1024, 256)).astype(np.float32)
    made = plan.make_plan(open_scene(write(tmp_path / "large.tif", image)), Recipe(method="sea", mask="none"), 1)
    assert (plan.fitted(made).model.spread > 8).all()  # 12 in the whole scene, 3 in the upper row of blocks


def test_tiles_give_the_same_scores(rxdetect, scene, tmp_path, monkeypatch):
    images = []
    for tile in (512, 64):
        monkeypatch.setattr(plan, "SEA_TILE", tile)
        assert rxdetect("score", scene, tmp_path / f"{tile}.tif").code == 0
        images.append(rasterio.open(tmp_path / f"{tile}.tif").read(1))
    np.testing.assert_allclose(*images, rtol=2e-3, atol=1e-3)


@pytest.mark.parametrize(
    ("options", "method", "why"),
    [
        ((), "sea", "water was found"),
        (("--nir", "1"), "rx", "no near infrared"),
        (("--background", "0,0,50,50"), "rx", "--background is for rx"),
        (("--window", "3,15"), "local", "--window is for local"),
        (("--drop", "2"), "subspace", "--drop is for subspace"),
        (("--threshold", "f", "--pfa", "1e-3"), "rx", "--threshold f is for rx"),
        (("--mask", "0,0,200,200"), "sea", "--mask gives the water"),
    ],
)
def test_auto_says_what_it_takes_and_why(rxdetect, scene, tmp_path, options, method, why):
    ran = rxdetect("score", scene, tmp_path / "out.tif", *options, "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["recipe"]["method"] == method
    assert f"auto: {method}" in ran.err
    assert why in ran.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--false-per-km2", "1", "--pfa", "1e-3"), "give one of them"),
        (("--false-per-km2", "1", "--method", "rx"), "--false-per-km2 is for method sea, not rx"),
        (("--false-per-km2", "1", "--threshold", "empirical"), "leave out --threshold"),
        (("--method", "sea", "--covariance", "oas"), "--covariance must be empirical"),
        (("--method", "sea", "--pfa", "1e-3", "--threshold", "f"), "neither chi-squared nor F"),
        (("--method", "sea", "--save-background", "b.json"), "take --method rx"),
        (("--pfa", "1e-3", "--chips", "chips"), "give --objects"),
        (("--pfa", "1e-3", "--objects", "o.shp"), "allowed are .geojson"),
        (("--largest-object", "60,400"), "width <= length < infinity"),
    ],
)
def test_options_that_the_sea_does_not_take_are_refused(rxdetect, scene, tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    ran = rxdetect("score", scene, "out.tif", *options)
    assert (ran.code, message in ran.err) == (1, True), ran.err
    assert {p.name for p in tmp_path.iterdir()} == {"port.tif"}


def test_a_scene_in_memory_gives_a_table_of_objects():
    pandas = pytest.importorskip("pandas")
    image, water = port()
    found = score_scene(image[:3], water & (image[3] < 2000), pixel=10.0, pfa=1e-3)
    table = pandas.DataFrame(found.objects).head(4)
    assert {(round(r - 1.5), round(c - 5.5)) for r, c in zip(table.row, table.column, strict=True)} == set(SHIPS)
    assert (table.false_per_km2 < 0.2).all()


def test_ships_side_by_side_at_a_quay_are_apart():
    water = np.ones((120, 160), bool)
    water[:, 150:] = False
    water[80:85, 40:150] = False  # a quay of 1100 m, 50 m wide
    for column, length in ((60, 24), (67, 18), (74, 20), (110, 14)):
        water[80 - length : 80, column : column + 5] = False
    found = region(water, SeaRule(10.0))[:80] == ALONGSIDE
    boxes = sorted(o.bounds for o in find(found, found.astype(float)))
    assert len(boxes) == 4
    assert all(bottom - top >= 8 and right - left <= 6 for (top, bottom), (left, right) in boxes)


def test_parts_of_a_ship_are_one_object():
    scores = np.array([[9.0, 2, 8, 0, 0, 7], [1, 2, 1, 0, 0, 7]])
    rows, columns = np.nonzero(scores > 1.5)
    found = find_among(rows, columns, scores[rows, columns], above=5.0)
    assert [(o.size, o.score_max, o.bounds) for o in found] == [(2, 9.0, ((0, 1), (0, 3))), (2, 7.0, ((0, 2), (5, 6)))]


def test_what_is_large_bright_and_long_counts_before_what_is_bright():
    scores = np.zeros((60, 60))
    scores[::10, ::10] = 5 + np.arange(36).reshape(6, 6)
    candidates = find(scores > 3, scores)
    clutter = clutter_of(Tail.of(scores), candidates, 1.0, area=25.0)
    assert clutter.false_per_km2(30.0, 50) < clutter.false_per_km2(30.0) / 20
    assert clutter.false_per_km2(8.0, 50) == clutter.false_per_km2(8.0)


def test_a_body_of_many_fine_pixels_is_no_clutter():
    scores = np.abs(np.random.default_rng(0).normal(0, 1, (300, 300)))
    scores[50:60, 50:60] = 3.0
    candidates = find(scores > 2.5, scores)
    kept = [clutter_of(Tail.of(scores), candidates, 1.6, area=1.0, fine=fine).confirmed for fine in (0, 1)]
    assert kept == [0, 1]


@pytest.mark.parametrize("pixel", [1.0, 10.0])
def test_what_a_confirmed_object_is_follows_from_the_pixel_not_from_the_side(pixel, tmp_path, write):
    image = np.random.default_rng(0).normal(100, 3, (3, 200, 200)).astype(np.float32)
    image[:, 100:104, 100:105] += 60
    image[:, 40:44, 40:52] += 60
    kept = [score_scene(image, pixel=pixel, side=side).clutter.confirmed for side in ("bright", "both")]
    assert kept == [1 + (pixel == 1.0)] * 2
    source = write(tmp_path / "sea.tif", image, transform=from_origin(400_000, 800_000, pixel, pixel))
    recipe = Recipe(method="sea", mask="none", bands=("1", "2", "3"), pfa=1e-3)
    for side in ("bright", "both"):
        marked = tmp_path / f"{side}.geojson"
        score_file(source, tmp_path / f"{side}.tif", replace(recipe, side=side), objects=marked)
        rates = [f["properties"]["false_per_km2"] for f in json.loads(marked.read_text())["features"]]
        direct = sorted(o["false_per_km2"] for o in score_scene(image, pixel=pixel, side=side, pfa=1e-3).objects)
        assert rates == pytest.approx(direct, rel=0.01)


@pytest.mark.parametrize(("side", "confirmed"), [(10, 0), (15, 1)])
def test_what_is_narrower_than_the_smallest_object_is_clutter_however_bright(side, confirmed):
    """At 0.25 m: 6 and 14 m2, for a disc of 4 m."""
    scores = np.abs(np.random.default_rng(0).normal(0, 1, (300, 300)))
    scores[50 : 50 + side, 50 : 50 + side] = 30.0
    candidates = find(scores > 5, scores)
    area = scores.size * 0.25**2 / 1e6
    assert clutter_of(Tail.of(scores), candidates, 1.6, area=area, fine=True).confirmed == confirmed


def test_a_tail_without_a_mean_gives_its_quantile():
    rng = np.random.default_rng(0)
    scores = np.concatenate([np.abs(rng.normal(0, 1, 99_000)), 5 + rng.pareto(0.6, 1000)])
    clutter = clutter_of(Tail.of(scores), [], 1.0, area=1.0)
    threshold = clutter.threshold(1e-3)
    assert threshold.method == "quantile"
    assert "no mean" in threshold.notes[0]
    assert threshold.pfa_observed == pytest.approx(1e-3, rel=0.02)


@pytest.mark.slow
@beside("real")
@pytest.mark.parametrize("name", ["gdynia", "klang"])
def test_requested_rates_hold_in_ports(name):
    ships, water = (rasterio.open(SHARED / "real" / name / f"{kind}.tif").read(1) > 0 for kind in ("ships", "water"))
    image = np.stack([rasterio.open(SHARED / "real" / name / f"B0{b}.tiff").read(1) for b in (2, 3, 4)]).astype("f4")
    found = score_scene(image, water, pfa=1e-3)
    counted = np.isfinite(found.scores) & water & (cv2.dilate(ships.astype(np.uint8), np.ones((15, 15))) == 0)
    assert 0.5 < (found.scores[counted] > found.threshold.value).mean() / 1e-3 < 2


def test_an_object_is_found_where_little_glint_covers_it():
    rng = np.random.default_rng(0)
    glint = rng.gamma(0.3, 20, (300, 300)) * (np.arange(300) % 60 < 30)
    image = 100 + rng.normal(0, 1, (3, 300, 300)) + glint * rng.normal(0, 1, (3, 300, 300))
    image[:, 100:104, 40:44] += 8  # where there is no glint
    nir = (50 + glint + rng.normal(0, 1, (300, 300)))[None]
    classes = region(np.ones((300, 300), bool), SeaRule(1.0))
    ranks = []
    for known in ((), (nir,)):
        model = fit([(image, classes)], pixel=1.0, nir=known)
        scores = score(image, classes, model, *known)
        ranks.append((scores > scores[101:103, 41:43].max()).mean())
    assert ranks[1] < 1e-4 < 1e-3 < ranks[0]
    half = score(image[:, :, :200], classes[:, :200], model, nir[:, :, :200])
    np.testing.assert_allclose(half[:, :100], scores[:, :100], rtol=1e-3)


def test_the_chain_of_the_readme_finds_what_it_promises(deglint, rxdetect, tmp_path):
    """Of the 16 objects of the sample at a rate of 1e-4, as the README says."""
    clean, scored = tmp_path / "deglinted.tif", tmp_path / "scores.tif"
    assert deglint("remove", ROOT / "sample_data" / "sea.tif", clean).code == 0
    with rasterio.open(ROOT / "sample_data" / "sea_objects.tif") as data:
        objects = data.read(1)
    found = []
    for source in (ROOT / "sample_data" / "sea.tif", clean):
        marked = tmp_path / "found.geojson"
        chips = tmp_path / source.stem
        options = ("--pfa", "1e-4", "--objects", marked, "--chips", chips, "--overwrite")
        assert rxdetect("score", source, scored, *options).code == 0
        height, width = cv2.imread(str(chips / "object_0001.png")).shape[:2]
        assert width // height == (2 if source == ROOT / "sample_data" / "sea.tif" else 3)  # the raw scene, too
        with rasterio.open(scored) as data:
            scores = data.read(1)
        threshold = json.loads(Path(f"{scored}.json").read_text())["threshold"]["value"]
        found.append(len(set(objects[scores > threshold]) - {0}))
    far = cv2.dilate((objects > 0).astype(np.uint8), np.ones((7, 7))) == 0
    assert 0.5 < (scores[far] > threshold).mean() / 1e-4 < 2
    each = [f["properties"] for f in json.loads(marked.read_text())["features"]]
    alarms = sum(bool(far[round(o["row"]), round(o["column"])]) for o in each)
    promised = re.search(r"finds (\d+) of (\d+) .* with (\d+) false", (ROOT / "README.md").read_text())
    assert (found[1], objects.max(), alarms) == tuple(map(int, promised.groups()))
    assert found[1] >= found[0]


def test_candidates_of_single_pixels_are_ranked_not_fitted():
    """The three highest scores of each, of which two are 0, do not exceed the bulk of the scores."""
    scores = np.zeros((100, 100))
    scores[::10, ::10] = 2.0
    clutter = clutter_of(Tail.of(scores), find(scores > 1.5, scores), 1.0, area=1.0)
    assert len(clutter.peaks) == 100
    assert not clutter.fitted


def clouded(clouds, ships=((60, 40), (150, 230))):
    """Three bands of noise with round clouds of 60 m to 110 m, at (row, column), and evenly bright ships of 240 m."""
    rng = np.random.default_rng(4)
    image = rng.normal(100, 3, (3, 300, 300))
    rows, columns = np.mgrid[:300, :300]
    for (row, column), size in zip(clouds, np.linspace(6, 11, len(clouds)), strict=True):
        image += 150 * np.exp(-np.log(2) * (2 * np.hypot(rows - row, columns - column) / size) ** 2)
    for row, column in ships:
        image[:, row : row + 4, column : column + 24] += 120
    return image


def test_many_round_objects_are_taken_for_clouds_and_ships_are_not():
    clouds = [(row, column) for row in range(20, 300, 65) for column in range(20, 300, 65)]
    found = score_scene(clouded(clouds)).objects
    rates = {(o["row"], o["column"]): o["false_per_km2"] for o in found}
    of_clouds = [rate for (row, column), rate in rates.items()
                 if min(np.hypot(row - r, column - c) for r, c in clouds) < 3]  # fmt: skip
    of_ships = [rate for (row, column), rate in rates.items() if (round(row), round(column)) in ((62, 52), (152, 242))]
    assert len(of_clouds) == len(clouds)
    assert min(of_clouds) >= len(clouds) / 9.01  # per km2: each is as likely a cloud as the others
    assert len(of_ships) == 2
    assert max(of_ships) < 0.2


def test_a_single_round_object_is_as_rare_as_any_other():
    (one,) = [o for o in score_scene(clouded([(220, 60)])).objects if o["row"] > 200 and o["pixels"] > 20]
    assert one["false_per_km2"] < 1.01 / 9  # per km2: the least that ranks can tell


def test_clouds_do_not_raise_the_threshold_of_ships():
    clouds = [(row, column) for row in range(20, 300, 65) for column in range(20, 300, 65)]
    few, many = (score_scene(clouded(c)).clutter for c in (clouds[:1], clouds))
    assert len(many.clouds) == len(clouds)
    assert many.score_at(1.0) < 1.5 * few.score_at(1.0)


@pytest.mark.parametrize("dim", ["wake", "deck"])
def test_a_ship_with_a_bright_superstructure_is_not_round(dim):
    scores = np.zeros((60, 60))
    scores[20:25, 20:25] = 100.0  # 5 x 5 pixels
    scores[21:24, 25:50] = {"wake": 15.0, "deck": 30.0}[dim]
    clutter = clutter_of(Tail.of(scores), find(scores > 1.5, scores), 1.0, area=1.0)
    assert not clutter.clouds
    scores[21:24, 25:50] = 10.0  # less than an eighth: not of this object
    assert clutter_of(Tail.of(scores), find(scores > 1.5, scores), 1.0, area=1.0).clouds == {(20, 20)}


def test_a_rate_leaves_many_clouds_out_of_the_file(write, tmp_path):
    clouds = [(row, column) for row in range(20, 300, 65) for column in range(20, 300, 65)]
    image = np.round(clouded(clouds) * 10).astype(np.uint16)
    kinds, said = {}, []
    for given in ({"pfa": 1e-3}, {"false_per_km2": 0.5}):
        source = write(tmp_path / "clouds.tif", image)
        recipe = Recipe(method="sea", mask="none", **given)
        done = score_file(source, tmp_path / "s.tif", recipe, objects=tmp_path / "o.geojson", overwrite=True)
        said = done.sidecar["warnings"]
        features = json.loads((tmp_path / "o.geojson").read_text())["features"]
        kinds[next(iter(given))] = [f["properties"]["kind"] for f in features]
    assert kinds["pfa"].count("round") == len(clouds)
    assert kinds["pfa"][:2] == ["afloat"] * 2
    assert kinds["false_per_km2"].count("afloat") >= 2
    assert "round" not in kinds["false_per_km2"]
    assert any(says(line, f"{len(clouds)} round objects", "clouds", "--pfa") for line in said)
