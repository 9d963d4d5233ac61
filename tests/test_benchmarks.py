"""The benchmarks run and print tables; what they print is looked at by people."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

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


def test_digits():
    table = rows(printed("benchmarks", "digits", "--quick"))
    assert float(table["NumAcc4, mean"][0]) > 15
    assert float(table["plain"][0]) > 15


def test_detect():
    table = rows(printed("benchmarks", "detect", "--quick"))
    assert all(float(cells[-1]) > 0 for name, cells in table.items() if name.startswith("global"))
    assert "rxdetect score" in table


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


def test_synthetic_scene_is_the_same_every_time_and_so_is_its_copy(tmp_path):
    import rasterio

    for name in ("a.tif", "b.tif"):
        options = ["--side", "300", "--dtype", "uint16", "--compress", "deflate"]
        printed("benchmarks.scenes", str(tmp_path / name), *options)
    with rasterio.open(tmp_path / "a.tif") as a, rasterio.open(tmp_path / "b.tif") as b:
        assert a.count == 8
        np.testing.assert_array_equal(a.read(), b.read())
    printed("benchmarks.block_copy", str(tmp_path / "a.tif"), str(tmp_path / "copy.tif"))
    with rasterio.open(tmp_path / "copy.tif") as copy, rasterio.open(tmp_path / "a.tif") as a:
        np.testing.assert_array_equal(copy.read(), a.read())


def test_children_are_measured_and_failures_told(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks.timing import FailedError, in_turns, rows_of, run_once, table

    found = in_turns({"one": [sys.executable, "-c", "pass"], "two": [sys.executable, "-c", "1 / 0"]}, 2)
    assert all(r.wall > 0 and r.peak > 1 for r in found["one"])
    assert "ZeroDivisionError" in found["two"]
    assert table(["a", "b", "c", "d", "e"], rows_of(found, "one")).count("\n") == 3
    with pytest.raises(FailedError, match="gone"):
        run_once([sys.executable, "-c", "raise SystemExit('gone')"])


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
