"""The command `rxdetect roc` and its page: its numbers, what it refuses, and HTML that is whole."""

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from rasterio.transform import from_origin

from detect.report import Request, evaluate, page
from detect.report.page import shrink
from detect.roc import Roc, auc_interval, bootstrap

from .common import PLACE, says

VOID = {"meta", "br", "img", "path", "rect", "circle", "image"}


def make_scene(seed=0, shape=(60, 80)):
    """Scores of two detectors and objects 1 to 6 of four pixels by five."""
    rng = np.random.default_rng(seed)
    first = rng.chisquare(4, shape).astype(np.float32)
    truth = np.zeros(shape, np.uint16)
    for i in range(6):
        r, c = 8 + 25 * (i // 3), 10 + 22 * (i % 3)
        truth[r : r + 4, c : c + 5] = i + 1
        first[r : r + 4, c : c + 5] += 4.0 * i
    second = (first + rng.normal(0, 4, shape)).astype(np.float32)
    return first, second, truth


@pytest.fixture
def files(tmp_path, write):
    first, second, truth = make_scene()
    first[:4, :10] = -9999
    names = {"first": first, "second": second, "truth": truth}
    for name, array in names.items():
        nodata = -9999 if name == "first" else None
        write(tmp_path / f"{name}.tif", array[None], names=None, nodata=nodata)
    return tmp_path


class Page(HTMLParser):
    """Checks that tags close as they open, and gathers what would be fetched or run."""

    def __init__(self, text):
        super().__init__()
        self.open, self.faults, self.links, self.text = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        self.links += [v for k, v in attrs if k in ("src", "href", "xlink:href", "action", "data")]
        self.faults += [k for k, _ in attrs if k.startswith("on")]
        if tag in ("script", "link", "iframe", "object", "embed", "form"):
            self.faults.append(tag)

    def handle_endtag(self, tag):
        if tag in VOID:
            return
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"/{tag}")

    def handle_data(self, data):
        self.text.append(data)


def test_report_and_json_say_what_the_arrays_say(files, rxdetect):
    report = files / "roc.html"
    ran = rxdetect("roc", files / "first.tif", files / "second.tif", files / "truth.tif", "--report", report,
                   "--per-object", "--bootstrap", 80, "--seed", 3, "--json")  # fmt: skip
    assert ran.code == 0, ran.err
    numbers = json.loads(ran.out)
    assert numbers == json.loads((files / "roc.html.json").read_text())
    first, second, truth = make_scene()
    valid = np.ones(truth.shape, bool)
    valid[:4, :10] = False
    assert numbers["pixels"] == {
        "total": 4800, "judged": 4760, "targets": 120, "background": 4640, "objects": 6,
        "left_out": {"not valid, or not finite, in first": 40},
    }  # fmt: skip
    assert numbers["scene"]["area_km2"] == pytest.approx(4760 * 100 / 1e6)
    for said, scores in zip(numbers["detectors"], (first, second), strict=True):
        roc = Roc.of(scores, truth, valid)
        assert said["auc"] == roc.auc
        assert said["delong"]["standard_error"] == auc_interval(roc).standard_error
        assert said["average_precision"] == roc.average_precision
        assert said["partial_auc"]["mcclish"] == roc.mcclish(0.1)
        bands = bootstrap(scores, truth, valid, draws=80, seed=3)
        assert (said["bootstrap"]["low"], said["bootstrap"]["high"]) == bands.auc
        for point in said["operating_points"]:
            assert point["pd"] == roc.point(point["pfa_requested"]).pd
            assert point["objects"] == 6
            assert point["false_alarms_per_km2"] == pytest.approx(point["false_alarms"] / 0.476)
        assert {o["number"] for o in said["objects"]["table"]} == {1, 2, 3, 4, 5, 6}
        worst = said["worst_false_alarms"][0]
        high = np.where(valid & (truth == 0), scores, -1)
        assert worst["score_max"] == high.max()
        assert worst["x"] == pytest.approx(400_000 + 10 * (worst["column"] + 0.5))
    (pair,) = numbers["comparisons"]
    assert pair["difference"] == pytest.approx(numbers["detectors"][0]["auc"] - numbers["detectors"][1]["auc"])
    assert pair["bootstrap_low"] < pair["difference"] < pair["bootstrap_high"]
    made = numbers["made"]
    assert made["seed"] == 3
    assert made["versions"]["numpy"] == np.__version__
    assert len(made["inputs"]) == 3
    assert all(len(f["crc32"]) == 8 for f in made["inputs"])
    assert "--seed 3" in made["command"]
    assert "--per-object" in made["command"]


@pytest.mark.slow
def test_page_is_whole_and_fetches_nothing(files, rxdetect):
    report = files / "roc.html"
    run = ("roc", files / "first.tif", files / "second.tif", files / "truth.tif", "--report", report, "--bootstrap", 50)
    for extra in ((), ("--per-object",)):
        assert rxdetect(*run, *extra, "--overwrite", "-q").code == 0
        parsed = Page(report.read_text(encoding="utf-8"))
        assert parsed.faults == []
        assert parsed.open == []
        assert parsed.links
        assert all(link.startswith("data:image/") for link in parsed.links)
        text = " ".join(parsed.text)
        for word in ("ROC report", "first", "Operating points", "3-D ROC", "How to read", "numpy", "rxdetect roc"):
            assert word in text
        assert ("Objects" in text) == bool(extra)
        assert "nan" not in text.lower().replace("nanometre", "")


def test_names_are_escaped(tmp_path, write, rxdetect):
    first, _, truth = make_scene()
    bad = "a<script>alert(1)<&'\">b"
    scores = write(tmp_path / f"{bad.replace('/', '')}.tif", first[None], names=None)
    write(tmp_path / "t.tif", truth[None], names=None)
    report = tmp_path / "roc.html"
    assert rxdetect("roc", scores, tmp_path / "t.tif", "--report", report, "--bootstrap", 0, "-q").code == 0
    text = report.read_text(encoding="utf-8")
    assert "<script" not in text
    assert "a&lt;script&gt;" in text
    assert Page(text).faults == []


@pytest.mark.slow
def test_the_same_seed_makes_the_same_page(files):
    request = Request((str(files / "first.tif"),), str(files / "truth.tif"), draws=40, seed=1, per_object=True)
    assert page(evaluate(request), {}) == page(evaluate(request), {})


def test_terminal_table(files, rxdetect):
    ran = rxdetect("roc", files / "first.tif", files / "truth.tif", "--bootstrap", 0)
    assert ran.code == 0
    assert says(ran.out, "4760 of 4800 pixels", "120 ", "6 objects")
    assert "Pd@1e-02" in ran.out
    assert ran.err == ""
    assert rxdetect("roc", files / "first.tif", files / "truth.tif", "--bootstrap", 0, "-q").out == ""


def ring_of(truth, i, wider=0):
    r, c = np.nonzero(truth == i)
    west, east, north, south = c.min() - wider, c.max() + 1 + wider, r.min() - wider, r.max() + 1 + wider
    corners = [(west, north), (east, north), (east, south), (west, south), (west, north)]
    return [(400_000 + 10 * x, 800_000 - 10 * y) for x, y in corners]


def test_truth_as_polygons_is_truth_as_pixels(files, rxdetect, geojson):
    _, _, truth = make_scene()
    rings = [ring_of(truth, i) for i in range(1, 7)]
    far = [(0, 0), (10, 0), (10, 10), (0, 0)]
    drawn = geojson(files / "truth.geojson", *rings, far, crs="EPSG:32653")
    runs = [rxdetect("roc", files / "first.tif", t, "--json", "--per-object", "--bootstrap", 20)
            for t in (files / "truth.tif", drawn)]  # fmt: skip
    pixels, polygons = (json.loads(r.out) for r in runs)
    assert polygons["detectors"] == pixels["detectors"]
    assert "1 of 7 features" in runs[1].err


def test_truth_outside_the_scores_is_refused(files, rxdetect, geojson):
    far = [(900_012, 799_982), (900_092, 799_982), (900_092, 799_902)]
    ran = rxdetect("roc", files / "first.tif", geojson(files / "far.geojson", far, crs="EPSG:32653"))
    assert ran.code == 1
    assert says(ran.err, "far.geojson", "position and CRS"), ran.err


def test_a_feature_below_another_is_told(files, rxdetect, geojson):
    _, _, truth = make_scene()
    rings = ring_of(truth, 1), ring_of(truth, 1, wider=1), ring_of(truth, 2)
    drawn = geojson(files / "truth.geojson", *rings, crs="EPSG:32653")
    ran = rxdetect("roc", files / "first.tif", drawn, "--json", "--bootstrap", 0)
    assert json.loads(ran.out)["pixels"]["objects"] == 2
    assert "1 of 3 features" in ran.err


@pytest.mark.parametrize(("options", "objects"), [((), 1), (("--connected",), 2)])
def test_a_feature_of_two_parts_is_one_object(files, rxdetect, geojson, options, objects):
    _, _, truth = make_scene()
    rings = ring_of(truth, 1), ring_of(truth, 2)
    drawn = geojson(files / "truth.geojson", *rings, crs="EPSG:32653", kind="MultiPolygon")
    ran = rxdetect("roc", files / "first.tif", drawn, "--json", "--bootstrap", 0, *options)
    assert json.loads(ran.out)["pixels"]["objects"] == objects


def test_one_target_pixel_has_no_interval(files, rxdetect, write):
    truth = np.zeros((60, 80), np.uint8)
    truth[30, 40] = 1
    one = write(files / "one.tif", truth[None], names=None)
    ran = rxdetect("roc", files / "first.tif", one, "--bootstrap", 0)
    assert ran.code == 0, ran.err
    assert "not known" in ran.out


def test_truth_with_nodata_zero_is_background_there(files, rxdetect, write):
    _, _, truth = make_scene()
    write(files / "zero.tif", truth[None], names=None, nodata=0)
    ran = rxdetect("roc", files / "first.tif", files / "zero.tif", "--json", "--bootstrap", 0)
    assert json.loads(ran.out)["pixels"]["targets"] == 120
    assert "declares 0 as nodata" in ran.err


def test_unknown_truth_is_left_out(files, rxdetect, write):
    _, _, truth = make_scene()
    marked = truth.astype(np.float32)
    marked[50:] = np.nan
    write(files / "part.tif", marked[None], names=None, nodata=np.nan)
    ran = rxdetect("roc", files / "first.tif", files / "part.tif", "--json", "--bootstrap", 0)
    assert json.loads(ran.out)["pixels"]["left_out"]["not valid in the truth"] == 800


def test_classes_are_distinguished_from_objects(files, rxdetect, write):
    _, _, truth = make_scene()
    write(files / "classes.tif", ((truth + 1) // 2)[None], names=None)
    run = ("roc", files / "first.tif", files / "classes.tif", "--json", "--bootstrap", 0)
    ran = rxdetect(*run)
    assert json.loads(ran.out)["pixels"]["objects"] == 3
    assert "3 object numbers" in ran.err
    assert "6 separate parts" in ran.err
    ran = rxdetect(*run, "--connected")
    assert json.loads(ran.out)["pixels"]["objects"] == 6
    assert ran.err == ""
    assert "--connected" in json.loads(ran.out)["made"]["command"]


def test_mask_judges_only_there(files, rxdetect):
    ran = rxdetect("roc", files / "first.tif", files / "truth.tif", "--mask", "0,0,80,30", "--json", "--bootstrap", 0)
    pixels = json.loads(ran.out)["pixels"]
    assert (pixels["judged"], pixels["objects"], pixels["left_out"]["outside the mask"]) == (2360, 3, 2400)


def test_lower_is_anomalous_turns_scores_and_thresholds(files, rxdetect, write):
    first, _, _ = make_scene()
    first[:4, :10] = np.nan
    write(files / "turned.tif", -first[None], names=None, nodata=np.nan)
    options = ("--json", "--bootstrap", 30, "--per-object")
    right = json.loads(rxdetect("roc", files / "first.tif", files / "truth.tif", *options).out)["detectors"][0]
    ran = rxdetect("roc", files / "turned.tif", files / "truth.tif", "--lower-is-anomalous", *options)
    turned = json.loads(ran.out)["detectors"][0]
    assert turned["auc"] == right["auc"]
    for a, b in zip(turned["operating_points"], right["operating_points"], strict=True):
        assert (a["threshold"], a["pd"], a["pd_low"]) == (-b["threshold"], b["pd"], b["pd_low"])
    assert turned["objects"]["table"][0]["score_max"] == -right["objects"]["table"][0]["score_max"]


def test_objects_nobody_could_see_are_neither_found_nor_missed(files, rxdetect):
    ran = rxdetect("roc", files / "first.tif", files / "truth.tif", "--mask", "0,0,80,30", "--per-object", "--json",
                   "--bootstrap", 20)  # fmt: skip
    said = json.loads(ran.out)["detectors"][0]
    assert said["objects"]["unseen"] == [4, 5, 6]
    assert all(p["objects"] == 3 for p in said["operating_points"])
    assert says(ran.err, "without a valid pixel", ": 3")


def shifted(name, **how):
    def make(files, write):
        _, _, truth = make_scene()
        options = PLACE | how
        return files / "first.tif", write(files / name, truth[None], names=None, **options)

    return make


def numbers_of(change):
    def make(files, write):
        _, _, truth = make_scene()
        return files / "first.tif", write(files / "bad.tif", change(truth)[None], names=None)

    return make


def flat(files, write):
    write(files / "flat.tif", np.ones((1, 60, 80), np.float32), names=None)
    return files / "flat.tif", files / "truth.tif"


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (numbers_of(lambda t: t[:30]), r"30 x 80 pixels\) .* \(60 x 80 pixels\) must have the same size"),
        (shifted("b.tif", transform=from_origin(400_030, 800_000, 10, 10)), "must have the same size"),
        (shifted("b.tif", transform=from_origin(400_000, 800_000, 10.01, 10)), "must have the same size"),
        (shifted("b.tif", crs="EPSG:32654"), "must have the same size"),
        (numbers_of(lambda t: t * 0), "got 0 and 4760 valid pixels"),
        (numbers_of(lambda t: t * 0 + 1), "got 4760 and 0 valid pixels"),
        (numbers_of(lambda t: t + 0.5), "allowed are 0 and integers"),
        (flat, "flat: all 4800 scores are 1: they distinguish nothing"),
        (lambda files, _: (files / "first.tif", files / "none.tif"), "no such file"),
        (lambda files, _: (files / "none.tif", files / "truth.tif"), "no such file"),
        (lambda files, _: (files / "first.tif", files / "none.geojson"), "no such file"),
    ],
)
def test_what_does_not_fit_is_one_line(files, write, rxdetect, make, said):
    scores, truth = make(files, write)
    ran = rxdetect("roc", scores, truth, "--report", files / "roc.html")
    assert ran.code == 1
    assert re.search(said, ran.err), ran.err
    assert ran.err.count("\n") == 1
    assert ran.out == ""
    assert not (files / "roc.html").exists()


def test_outputs_are_whole_or_not_there(files, rxdetect):
    run = ("roc", files / "first.tif", files / "truth.tif", "--bootstrap", 0, "-q", "--report")
    report = files / "roc.html"
    report.write_text("old")
    ran = rxdetect(*run, report)
    assert ran.code == 1
    assert "--overwrite" in ran.err
    assert report.read_text() == "old"
    assert rxdetect(*run, report, "--overwrite").code == 0
    assert "<!doctype html>" in report.read_text()
    ran = rxdetect(*run, files / "no" / "roc.html")
    assert ran.code == 1
    assert "does not exist" in ran.err
    assert not list(files.glob(".*"))


def test_one_detector_given_twice_is_refused(files, rxdetect):
    ran = rxdetect("roc", files / "first.tif", files / "first.tif", files / "truth.tif")
    assert ran.code == 1
    assert "given twice" in ran.err


def test_missing_and_wrong_arguments_have_exit_code_2(rxdetect, files):
    assert rxdetect("roc").code == 2
    assert rxdetect("roc", files / "first.tif", files / "truth.tif", "--pfa-max", 0).code == 2
    ran = rxdetect("roc", "--help")
    assert ran.code == 0
    assert "--per-object" in ran.out


def test_small_scenes_and_single_pixels(tmp_path, write, rxdetect):
    """Two by two: one target, no rate of Pfa that three pixels could show."""
    write(tmp_path / "s.tif", np.array([[[1.0, 2], [3, 9]]], np.float32), names=None)
    write(tmp_path / "t.tif", np.array([[[0, 0], [0, 1]]], np.uint8), names=None)
    ran = rxdetect("roc", tmp_path / "s.tif", tmp_path / "t.tif", "--per-object", "--report", tmp_path / "r.html")
    assert ran.code == 0, ran.err
    assert Page((tmp_path / "r.html").read_text()).faults == []
    found = json.loads((tmp_path / "r.html.json").read_text())["detectors"][0]
    assert found["auc"] == 1
    assert found["delong"]["standard_error"] is None


def test_a_large_scene_is_shrunk_to_the_highest_of_its_cells():
    rng = np.random.default_rng(0)
    scores = rng.normal(size=(1000, 1500)).astype(np.float32)
    valid = np.ones(scores.shape, bool)
    valid[:300, :600] = False
    seen, step = shrink(scores, valid)
    assert (seen.shape, step) == ((334, 500), 3)
    assert np.isnan(seen[:100, :200]).all()
    assert np.isfinite(seen[100:]).all()
    assert seen[200, 300] == scores[600:603, 900:903].max()
    assert seen[333, 0] == scores[999:, :3].max()
