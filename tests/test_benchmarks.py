"""The benchmarks run and print tables; what they print is looked at by people."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio

from benchmarks import floor, peers, seas, size
from benchmarks.processes import in_turns

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared" / "data"


def printed(*arguments):
    """What `python -m ...` prints from the repository's root."""
    done = subprocess.run([sys.executable, "-m", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def rows(text):
    """Cells of every table row, by its first cell."""
    cells = [[c.strip() for c in line.strip("| ").split("|")] for line in text.splitlines() if line.startswith("| ")]
    return {row[0]: row[1:] for row in cells}


@pytest.mark.shared
@pytest.mark.skipif(not (SHARED / "simulated").exists(), reason="the shared scenes do not lie beside the project")
def test_error():
    text = printed("benchmarks", "error", "--quick")
    published = rows(text)["recorded: hedley ols"]
    assert re.search(r"\| hedley ols +\| polygon +\| " + r" +\| ".join(published[1:]), text)
    recorded = re.findall(r"\| wind\d+_delay\d+ +\| (?:hedley|lyzenga|joyce) +\| (\S+) +\| (\S+) +\|", text)
    assert len(recorded) == 6
    for ours, theirs in recorded:
        assert float(ours) == pytest.approx(float(theirs), rel=0.005)


def test_children_are_measured_in_turns_and_failures_told(tmp_path):
    note = f"open({str(tmp_path / 'out.txt')!r}, 'x').close(); open({str(tmp_path / 'log')!r}, 'a').write"
    hold = "b = bytearray(200 << 20); b[::4096] = b'1' * len(b[::4096])"
    found = in_turns(
        {
            "one": [sys.executable, "-c", f"{note}('1')"],
            "two": [sys.executable, "-c", "1 / 0"],
            "three": [sys.executable, "-c", f"{note}('3'); {hold}"],
            "none": [str(tmp_path / "no program")],
        },
        2,
        [str(tmp_path / "out.t*")],
    )
    assert (tmp_path / "log").read_text() == "1313"
    assert not (tmp_path / "out.txt").exists()
    assert found["two"] == "ZeroDivisionError: division by zero"
    assert "cannot start" in found["none"]
    assert all(r.peak > 200 for r in found["three"])
    assert all(r.peak < 100 for r in found["one"]), "the memory of their parent is not theirs"


def test_a_sea_is_the_same_every_time_and_so_is_its_copy(tmp_path):
    a, b, copied = (tmp_path / name for name in ("a.tif", "b.tif", "copied.tif"))
    for path in (a, b):
        seas.write_sea(path, 300, dtype="uint16", compress="deflate")
    floor.copy(str(a), str(copied))
    with rasterio.open(a) as one, rasterio.open(b) as two, rasterio.open(copied) as three:
        assert one.descriptions[6] == "NIR1"
        np.testing.assert_array_equal(one.read(), two.read())
        np.testing.assert_array_equal(one.read(), three.read())
        assert three.profile["compress"] == "deflate"


def test_other_programs_score_what_we_score():
    block, inside = peers.image(5, 24), slice(10, -10)  # at the edges programs shift or cut their windows
    for jobs in (peers.global_jobs, peers.local_jobs):
        mine, *others = (np.asarray(job()).reshape(24, 24)[inside, inside] for job in jobs(block).values())
        for theirs in others:
            np.testing.assert_allclose(theirs, mine, rtol=3e-3)  # n or n - 1


def test_sizes_of_rooms_and_of_what_is_too_large():
    long = "def f(self, a, b, c, d, e, f, g, h):\n" + '    """Doc.\n\n    More.\n    """\n' + "    a = 1\n" * 60
    found = {"deglint/moments.py": "x = 1\n", "deglint/pipeline/run.py": long, "detect/bench/run.py": "\n" * 401,
             "detect/rx.py": "\n" * 2, "benchmarks/big.py": long}  # fmt: skip
    lines = size.sizes(found)
    assert (lines["foundations"], lines["pipeline"], lines["detect/bench"], lines["detect"]) == (1, 65, 401, 2)
    modules, functions, parameters = (rows for _, _, rows in size.too_large(found))
    assert modules == [["detect/bench/run.py", "401"]]
    assert functions == [["deglint/pipeline/run.py: f", "65", "61"]]
    assert parameters == [["deglint/pipeline/run.py: f", "8"]]


def test_every_room_is_counted_once():
    found = size.modules(ROOT)
    assert sum(size.sizes(found).values()) == sum(text.count("\n") for text in found.values())
    assert "detect/bench/run.py" in found


def test_plan():
    table = rows(printed("benchmarks", "plan", "--quick"))
    assert {"reticle", "answer of the page", "deglint plan -o plan.png"} <= set(table)


def test_the_model_of_scale_is_a_line_through_what_was_measured(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import scale

    def run(side):
        values = 8 * side**2 / 1e6
        return {"cpu": 2 + 0.03 * values, "wall": 1, "peak": 200, "read": 1.5e6 * values, "size": 0.5e6 * values}

    runs = {f"{what} {side}": run(side) for what in scale.COMMANDS for side in (1024, 8192)}
    runs["score 16384"] = {"stopped": "the disk has 1 GB left"}
    found = {"machine": "a machine.", "disk": 1e8, "runs": runs}
    line = scale.line_of(found, "score")
    assert line["slope"] == pytest.approx(0.03)
    assert line["start"] == pytest.approx(2)
    text = "\n\n".join(scale.tables(found))
    assert "the disk has 1 GB left" in text
    hours = (73 * 2 + 73 * 10980**2 * 4 / 1e6 * 0.03) / 60
    assert f"{hours:.3g} min" in text


@pytest.mark.parametrize("kind", ["disc", "diamond"])
def test_round_things_keep_their_colour_where_removal_leaves_the_blue_bands_alone(tmp_path, monkeypatch, kind):
    """The NIR explains next to nothing of them, so that removal, and what follows it, do not change them."""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import compensation

    condition = next(c for c in compensation.CONDITIONS if c.name == "wind05_delay60")
    found = compensation.measure(tmp_path, compensation.setup(condition, 1, 0.005, kind, "cardioidal"))
    fitted = [fit["band"] for fit in json.loads((tmp_path / "out.tif.json").read_text())["model"]["fits"]]
    assert min(fitted) > 0
    assert found.whole < 1.15 * 3.6


@pytest.mark.parametrize(("kind", "wind"), [("disc", 5.0), ("diamond", 5.0), ("disc", 9.0)])
def test_round_things_are_kept_where_bands_see_the_sea_at_one_instant(tmp_path, monkeypatch, kind, wind):
    """Sparkle has outlines in all of them, too, but no square opening leaves a disc of this width."""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import compensation

    condition = compensation.Condition("", wind, 0.0)
    found = compensation.measure(tmp_path, compensation.setup(condition, 7, 0.06, kind, "cardioidal"))
    assert found.deep < 1.15 * 3.9
    assert found.whole < 6.5


@pytest.mark.parametrize(("sensor", "delay"), [("thesis-f30", 0.06), ("thesis-f30", 0.02), ("thesis", 0.0)])
def test_discs_come_to_no_harm_where_flashes_are_rare(tmp_path, monkeypatch, sensor, delay):
    """Across the sun at 5 m/s. They hold no square of 13 pixels; and they are no reason to leave the flashes in."""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import away, compensation
    from deglint.simulate import simulate

    made = compensation.setup(compensation.Condition("", 5.0, delay, sensor=sensor), 3, 0.06, "disc", "cardioidal")
    scene = simulate(replace(made, view_zenith=40.0, view_azimuth=made.sun_azimuth + 90))
    truth = scene.truth.astype(np.float64)
    raw, clean = (away.errors(image, truth) for image in away.measure(tmp_path, scene))
    assert (clean / raw).max() <= away.WORSE
    assert np.sqrt((clean[1, :5] ** 2).mean()) < 4
    if delay == 0:
        assert np.sqrt((raw[1, :5] ** 2).mean()) > 15


@pytest.mark.parametrize(("kind", "patch"), [("square", 0.06), ("square", 0.005), ("disc", 0.06), ("diamond", 0.06)])
def test_own_scenes_keep_to_the_figures_that_the_docs_give(tmp_path, monkeypatch, kind, patch):
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import compensation

    condition = next(c for c in compensation.CONDITIONS if c.name == "wind09_delay60")
    found = compensation.measure(tmp_path, compensation.setup(condition, 7, patch, kind, "cardioidal"))
    assert found.deep < 1.15 * 3.9
    assert found.whole < (1.15 * 5.0 if kind == "square" else 6.5)
    assert (np.array([found.deep_auc, found.robust_auc]) >= (0.98, 0.995, 0.998, 0.998)).all()
