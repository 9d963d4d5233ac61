"""What measures other programs beside ours: the processes, the scenes, the floors, and the arrays."""

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rasterio

from deglint.errors import DeglintError
from detect.bench import arrays, floor, kernels, peers, peers_arrays, peers_files, peers_growth, report, seas
from detect.bench.processes import ROOT, Run, in_turns, output_of
from detect.bench.section import Effort


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
    assert all(isinstance(r, Run) and 0 < r.wall < 60 and r.cpu > 0 for r in found["one"])
    assert all(r.peak > 200 for r in found["three"])
    assert all(r.peak < 100 for r in found["one"]), "memory of what started them is not theirs"


def test_what_a_child_says_and_that_it_ends_with_its_caller(tmp_path):
    assert output_of([sys.executable, "-c", "print(input())"], "hello") == "hello\n"
    with pytest.raises(DeglintError, match="gone"):
        output_of([sys.executable, "-c", "raise SystemExit('gone')"])
    mark = tmp_path / "pid"
    inner = f"import os, time; open({str(mark)!r}, 'w').write(str(os.getpid())); time.sleep(60)"
    outer = "import sys\nfrom detect.bench.processes import in_turns\n"
    outer += f"in_turns({{'x': [sys.executable, '-c', {inner!r}]}}, 1)"
    with subprocess.Popen([sys.executable, "-c", outer], cwd=ROOT, stderr=subprocess.DEVNULL) as child:
        _wait(lambda: mark.exists() and mark.read_text())
        child.send_signal(signal.SIGINT)
        child.wait(30)
    _wait(lambda: not _runs(int(mark.read_text())))


def _wait(happened):
    for _ in range(600):
        if happened():
            return
        time.sleep(0.05)
    raise AssertionError("it did not happen")


def _runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    try:
        return ") Z" not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


def test_a_sea_is_the_same_every_time_and_so_is_its_copy(tmp_path):
    a, b, copy, band = (tmp_path / name for name in ("a.tif", "b.tif", "copy.tif", "band.tif"))
    for path in (a, b):
        seas.write_sea(path, 300, dtype="uint16", compress="deflate")
    floor.main(["copy", str(a), str(copy)])
    floor.main(["twice", str(a), str(band)])
    with rasterio.open(a) as one, rasterio.open(b) as two, rasterio.open(copy) as three, rasterio.open(band) as four:
        assert one.count == 8
        assert one.descriptions[6] == "NIR1"
        np.testing.assert_array_equal(one.read(), two.read())
        np.testing.assert_array_equal(one.read(), three.read())
        assert three.profile["compress"] == "deflate"
        np.testing.assert_array_equal(one.read(1), four.read()[0])


@pytest.mark.parametrize("bands", [4, 8, 20])
def test_a_sea_of_any_number_of_bands_is_deglinted(tmp_path, bands, deglint):
    path = tmp_path / "sea.tif"
    seas.write_sea(path, 256, bands=bands)
    case = peers_files.Case(256, bands=bands)
    ran = deglint("remove", path, tmp_path / "out.tif", "--method", "hedley", "--sample", case.window, "--mask", "none")
    assert ran.code == 0, ran.err
    with rasterio.open(path) as raw, rasterio.open(tmp_path / "out.tif") as clean:
        nir = raw.read(round(bands * 7 / 8))[:, 60:].ravel()
        assert np.corrcoef(nir, raw.read(2)[:, 60:].ravel())[0, 1] > 0.9
        assert abs(np.corrcoef(nir, clean.read(2)[:, 60:].ravel())[0, 1]) < 0.1


def test_other_programs_score_what_we_score():
    block = arrays.image(5, 24)
    cube = np.ascontiguousarray(block.transpose(1, 2, 0))
    mine = np.asarray(arrays.ours(block, None, 1))
    np.testing.assert_allclose(arrays.by_spectral(cube, None), mine, rtol=1e-3)
    n = mine.size  # its covariance is divided by n
    np.testing.assert_allclose(arrays.by_sklearn(cube.reshape(-1, 5)), mine.ravel() * n / (n - 1), rtol=1e-3)
    mine = np.asarray(arrays.ours(block, (3, 9), 1))
    assert np.corrcoef(mine.ravel(), np.ravel(arrays.by_spectral(cube, (3, 9))))[0, 1] > 0.95  # its border differs


def test_tasks_are_done_in_a_process_of_their_own():
    mine = arrays.OURS
    tasks = [arrays.Task(3, 32, (mine, f"{mine}, 2 threads", arrays.SKLEARN, arrays.SPECTRAL), 2),
             arrays.Task(3, 24, (mine, arrays.SPECTRAL), 1, (3, 7)), arrays.Task(3, 64, (mine,), 0)]  # fmt: skip
    times, local, memory = arrays.measured(tasks)
    assert {name: len(seconds) for name, seconds in times.items()} == dict.fromkeys(tasks[0].programs, 2)
    assert min(min(s) for s in (*times.values(), *local.values())) > 0
    assert memory is None or memory >= 0
    assert tasks[0].slug == "global_3x32"
    assert tasks[1].slug == "local3-7_3x24"
    assert str(tasks[1]) == "local, window 3, 7, 3 bands of 24 x 24"


def test_programs_that_are_missing_are_said_to_be(monkeypatch):
    from importlib import metadata

    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(peers_arrays.metadata, "version", missing)
    assert peers_arrays.installed() == ((), "scikit-learn and spectral not installed: left out.")
    python, said = peers_files.interpreter(str(Path("no python")))
    assert python == ""
    assert "cannot start" in said


def test_what_is_run_on_a_scene_runs(tmp_path):
    effort, case = Effort(True, 1, tmp_path, 1), peers_files.Case(96)
    section, found = peers_files.beside(case, effort, 1, "", tmp_path)
    names = (peers_files.COPY, peers_files.REMOVE, peers_files.PLAIN, peers_files.NUMPY, peers_files.TWICE,
             peers_files.SCORE)  # fmt: skip
    assert tuple(found) == names
    assert [row[0] for row in section.tables[0].rows] == list(names), found
    assert section.numbers["peers/files/8x96_float32/copy/ratio"].value == 1
    assert [p.name for p in tmp_path.iterdir()] == ["8x96_float32.tif"]


def test_there_is_nothing_to_compare_where_a_program_of_ours_fails(monkeypatch, tmp_path):
    monkeypatch.setattr(peers_files, "in_turns", lambda commands, *_: dict.fromkeys(commands, "no memory"))
    monkeypatch.setattr(peers_files, "write_sea", lambda path, *_, **__: path.write_text(""))
    with pytest.raises(DeglintError, match="block copy failed on 8 bands of 96 x 96, float32, uncompressed: no memory"):
        peers_files.beside(peers_files.Case(96), Effort(True, 1, tmp_path, 1), 1, "", tmp_path)


@pytest.mark.parametrize("quick", [True, False])
def test_every_part_and_the_words_from_its_numbers(monkeypatch, tmp_path, quick):
    """With times that are made up: every program takes 1 s, deglint 3; sensingpy fails."""

    def in_turns(commands, rounds, _cleanup=()):
        made_up = {n: [Run(3.0 if "deglint" in n else 1.0, 2.0, 100.0)] * rounds for n in commands}
        return made_up | {n: "no memory" for n in commands if n == peers_files.SENSINGPY}

    def measured(tasks):
        return [{p: [0.5] if p == arrays.OURS else [2.0] for p in t.programs} if t.rounds else 7.0 for t in tasks]

    monkeypatch.setattr(peers_files, "in_turns", in_turns)
    monkeypatch.setattr(peers_files, "interpreter", lambda _: ("python", "3.0"))
    monkeypatch.setattr(peers_files, "write_sea", lambda path, *_, **__: path.write_text(""))
    for home in (peers_arrays, peers_growth):
        monkeypatch.setattr(home, "measured", measured)
    monkeypatch.setattr(kernels, "output_of", lambda *_, **__: json.dumps({kernels.ONCE: [1.0], "apply": [2.0]}))
    found = peers.run(Effort(quick, 1, tmp_path, 2))
    numbers = found.every_number()
    side = 1024 if quick else 4096
    stem = f"peers/files/8x{side}_float32"
    assert numbers[f"{stem}/remove/ratio"].value == 3
    assert numbers[f"{stem}/remove/ratio"].better == "lower"
    assert not numbers[f"{stem}/remove/ratio"].exact
    assert f"{stem}/sensingpy/ratio" not in numbers
    assert "sensingpy, hedley, window failed: no memory" in found.parts[0].tables[0].note
    assert "deglint remove takes 3 times as long as a block copy of the same file" in found.finding
    assert "scikit-learn 4 times as long as detect" in found.finding
    assert "100 to 100 MB" in found.words[-1]
    assert numbers["peers/growth/threads/2/faster"].value == 1
    assert all(math.isfinite(n.value) for n in numbers.values())
    assert all(name.startswith("peers/") for name in numbers)
    assert "Window of local RX" in report.section(found)
    assert not list(tmp_path.iterdir())


def test_kernels_print_seconds(capsys):
    kernels.main(64, 2)
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {kernels.ONCE, *kernels.SLUGS}
    assert all(len(seconds) == 2 for seconds in found.values())
