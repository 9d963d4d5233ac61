"""`rxdetect bench`: what it measures is right, and what it writes is whole; two runs are compared."""

import json
import math
import re
import sys
from dataclasses import asdict
from importlib.util import find_spec

import numpy as np
import pytest

from benchmarks import compare
from deglint.physics.presets import preset
from deglint.physics.sensor import noise_equivalent_radiance
from deglint.remove import METHODS
from detect.bench import report, run, scenes
from detect.bench.numbers import Number, over_seeds, rms_error, timed
from detect.bench.run import DEFAULT, RAW
from detect.global_rx import rx
from detect.report.page import as_uri, check_installed
from detect.roc import Roc

SMALL = 64
NAN = math.nan


@pytest.fixture
def rxdetect(command, tmp_path, monkeypatch):
    """Run the command in this process and in a directory of its own, on the least of scenes."""
    from detect.cli import run as main

    simulated = scenes.simulated
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(run, "simulated", lambda *a: simulated(*a[:4], side=SMALL))
    return command(main)


# measures


def test_error_is_that_of_a_loop_over_pixels():
    generator = np.random.default_rng(3)
    truth = generator.uniform(1, 2, (7, 6, 8))
    image = truth + generator.normal(size=truth.shape)
    for columns in (slice(None), slice(3)):
        squares = []
        for band in range(5):  # COASTAL to RED
            away = [image[band, r, c] - truth[band, r, c] for r in range(6) for c in range(8)[columns]]
            squares.append(sum(a * a for a in away) / len(away) / np.median(truth[band]) ** 2)
        assert rms_error(image, truth, columns) == pytest.approx(100 * math.sqrt(sum(squares) / 5), rel=1e-12)


def test_distances_and_areas_are_those_of_brute_force():
    generator = np.random.default_rng(5)
    image = generator.normal(size=(3, 9, 11))
    kinds = generator.integers(-1, 3, (9, 11))
    sample = np.zeros((9, 11), bool)
    sample[:, :6] = True
    scores = rx(image, sample)
    inside = image[:, sample]
    inverse = np.linalg.inv(np.cov(inside))
    for row, column in ((0, 0), (4, 7), (8, 10)):
        away = image[:, row, column] - inside.mean(axis=1)
        assert scores[row, column] == pytest.approx(away @ inverse @ away, rel=1e-9)
    for number in (1, 2):
        found = Roc.of(scores, kinds == number, (kinds == 0) | (kinds == number))
        pairs = [(x > y) + (x == y) / 2 for x in scores[kinds == number] for y in scores[kinds == 0]]
        assert found.auc == pytest.approx(np.mean(pairs), rel=1e-12)


def test_numbers_over_seeds_have_their_interval():
    number = over_seeds([1.0, 2.0, 3.0], "%")
    half = 4.302652729911275 / math.sqrt(3)  # t of 2 degrees of freedom, from tables
    assert (number.value, number.low, number.high) == (2, 0, pytest.approx(2 + half))  # no error is below 0
    assert over_seeds([0.9, 1.0], better="higher", most=1.0).high == 1
    assert math.isnan(over_seeds([1.0]).low)
    assert timed([4.0, 1.0, 2.0]) == Number(2.0, 1.0, 4.0, "s", exact=False)


def test_scenes_hold_what_they_should(tmp_path):
    sensors = [preset("thesis").delayed(delay) for delay in (0.0, 0.06)]
    for scene in scenes.simulated(tmp_path, sensors, 3.0, 0, SMALL):
        assert sorted(set(scene.kinds[:, SMALL // 2 :].ravel())) == [-1, 0, 1, 2, 3, 4]
        assert not scene.kinds[:, : SMALL // 2 - scenes.BLURRED_EDGE].any()
        assert scene.sample.mean() == 0.5
        np.testing.assert_array_equal(scene.made.objects > 0, scene.kinds > 0)
        np.testing.assert_allclose(scene.scene.read(), scene.radiance(scene.made.image), rtol=1e-6)
        squares = []
        for band, truth in zip(sensors[0].bands[:5], scene.made.truth, strict=False):
            noise = noise_equivalent_radiance(truth, sensors[0], band)
            squares.append((noise**2).mean() / np.median(truth) ** 2)
        # 5 x 4096 pixels: a standard deviation is known to 0.5 %
        found = rms_error(scene.radiance(scene.made.truth_image), scene.made.truth)
        assert found == pytest.approx(100 * math.sqrt(np.mean(squares)), rel=0.02)


def test_every_method_is_measured():
    assert list(run.removals()) == [*METHODS, DEFAULT]
    full, quick = (run.Effort.of(["hedley"], quick=q, seeds=None) for q in (False, True))
    assert (full.seeds, quick.seeds, quick.winds) == (5, 2, (9.0,))


# the command


@pytest.mark.slow
def test_the_report_is_whole_and_fetches_nothing(rxdetect, tmp_path):
    ran = rxdetect("bench", "--quick", "--seeds", "1", "--only", "default,hedley,goodman")
    assert ran.code == 0, ran.err
    assert "bands to correct" not in ran.err  # the log of every removal
    text = (tmp_path / "benchmark.html").read_text(encoding="utf-8")
    assert "<script" not in text
    assert set(re.findall(r'(?:src|href)="([^:]*:[^/;]*)', text)) == {"data:image"}
    assert "rxdetect bench benchmark.html --quick --only default,hedley,goodman --seeds 1" in text
    assert re.search(r"<li>goodman: goodman needs a band within 20 nm of 750 nm", text)
    data = json.loads((tmp_path / "benchmark.html.json").read_text(), parse_constant=pytest.fail)
    numbers = data["numbers"]
    names = {name.split("/")[2] for name in numbers if name.startswith("wind09/")}
    assert names == {RAW, "noise-only", "hedley", DEFAULT}
    error = {name: numbers[f"wind09/delay00/{name}/rms-whole"]["value"] for name in names}
    assert error["noise-only"] < error["hedley"] < error[RAW]
    assert numbers["time/hedley/fit"]["value"] > 0
    assert "goodman" in data["refused"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["benchmark.html", "benchmark.html.json"]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Two winds, one seed, hedley."""
    effort = run.Effort(("hedley",), (3.0, 9.0), (0.0,), seeds=1, side=SMALL, rounds=1)
    simulated = scenes.simulated
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "simulated", lambda *a: simulated(*a[:4], side=SMALL))
        return run.measure(effort, tmp_path_factory.mktemp("bench"), lambda *_: None)


@pytest.mark.slow
def test_figures_hold_every_removal(results):
    for draw in (report.against_wind, report.time_against_error, report.roc_curves):
        figure = draw(results)
        labels = {text.get_text() for text in figure.legends[0].get_texts()}
        assert labels >= {"hedley"}
        assert as_uri(figure) == as_uri(draw(results))


@pytest.mark.slow
def test_names_that_escape_html(results):
    made = {"versions": {"deglint": "<b>"}, "machine": {}, "command": "a<script>", "date": "", "seeds": 1}
    text = report.page(results, made)
    assert "a&lt;script&gt;" in text
    assert "<script" not in text


def test_objects_are_counted_at_the_rate(results, tmp_path):
    (scene,) = scenes.simulated(tmp_path, [preset("thesis").delayed(0.0)], 3.0, 0, SMALL)
    bright = scene.made.truth + 100 * scene.made.truth.mean() * (scene.kinds == 2)
    rng = np.random.default_rng(0)
    found = run.quality(scene, bright + rng.normal(0, 1e-3, bright.shape))
    assert found.found[1] == 1
    assert found.auc[1] == 1
    assert found.curve[1][0] == 1


def test_outputs_are_not_replaced_and_nothing_is_measured_in_vain(rxdetect, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "measure", lambda *_: pytest.fail("measured"))
    (tmp_path / "benchmark.html.json").write_text("mine")
    ran = rxdetect("bench")
    assert ran.code == 1
    assert "--overwrite" in ran.err
    assert rxdetect("bench", "a.html", "--json", "a.html").code == 2
    assert rxdetect("bench", "nowhere/a.html").code == 1
    assert "Name it scene.html." in rxdetect("bench", "scene.tif", "--quick", "--only", "kutser").err
    assert "Name it b.json." in rxdetect("bench", "--json", "b.html", "--quick", "--only", "kutser").err
    ran = rxdetect("bench", "--only", "speed")
    assert ran.code == 2
    assert "hedley" in ran.err
    assert [p.name for p in tmp_path.iterdir()] == ["benchmark.html.json"]


def test_a_package_that_is_missing_is_named_with_its_remedy(rxdetect, monkeypatch):
    known = check_installed.__globals__
    monkeypatch.setitem(known, "find_spec", lambda name: None if name == "jinja2" else find_spec(name))
    ran = rxdetect("bench")
    assert ran.code == 1
    assert re.search(r"needs jinja2: pip install 'deglint\[reports\]'", ran.err)
    assert len(ran.err.splitlines()) == 1


def test_the_command_imports_no_plotting(rxdetect):
    sys.modules.pop("detect.bench.report", None)
    assert "--quick" in rxdetect("bench", "--help").out
    assert "detect.bench.report" not in sys.modules


# two runs


def of(value, half=NAN, **extra):
    return Number(value, value - half, value + half, **extra)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (of(5, 1), of(8, 1), "worse"),
        (of(5, 1), of(2, 0.5), "better"),
        (of(5, 1, better="higher"), of(8, 1, better="higher"), "better"),
        (of(5, 1), of(6, 1), "changed"),
        (of(5, 1), of(5 + 1e-7, 1), None),
        (of(13), of(6), "changed"),
        (of(0), of(0), None),
        (of(NAN), of(NAN), None),
        (of(NAN), of(1), "changed"),
        (of(1, 0.1, exact=False), of(2, 0.1, exact=False), "slower"),
        (of(1, 0.1, exact=False), of(0.5, 0.1, exact=False), "faster"),
        (of(1, 0.1, exact=False), of(1.15, 0.1, exact=False), None),
        (of(1, 0.01, exact=False), of(1.09, 0.01, exact=False), None),
    ],
)
def test_what_counts_as_a_change(old, new, expected):
    assert compare.judge(old, new) == expected
    assert compare.judge(old, new, same_machine=False) == (expected if old.exact else None)


def test_two_runs_are_compared(tmp_path, capsys):
    made = {"machine": {"processor": "p", "cores": 2}}
    runs = {"old": {"a": of(1, 0.1), "t": of(1, 0.1, exact=False), "gone": of(NAN)},
            "new": {"a": of(3, 0.1), "t": of(9, 0.1, exact=False), "b": of(1)}}  # fmt: skip
    old, new = files = [tmp_path / f"{name}.json" for name in runs]
    for file, numbers in zip(files, runs.values(), strict=True):
        values = {name: asdict(number) for name, number in numbers.items()}
        file.write_text(json.dumps({"made": made, "numbers": values, "refused": {}}))
    compare.main([old, old])
    assert "nothing changed" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="1"):
        compare.main([old, new])
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines] == [["worse", "a"], ["slower", "t"], ["gone", "gone"], ["new", "b"]]
