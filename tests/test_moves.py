"""Several outputs move together: an error in the middle or a signal is undone, what was killed is cleared."""

import os
import re
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from deglint import remove_glint
from deglint.errors import WriteError
from deglint.raster.targets import Scratch, _clear_scratch

from .common import HEDLEY, RUN, says

OUTPUTS = ("out.tif", "out.tif.json", "f.tif", "m.json")


@pytest.fixture
def old(tmp_path):
    """Old outputs with companions."""
    for name in (*OUTPUTS, "out.tif.aux.xml", "out.tif.msk"):
        (tmp_path / name).write_bytes(b"old")
    return lambda: {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.name != "in.tif"}


@pytest.mark.parametrize("failing", range(1, 9))
def test_an_error_between_two_moves_is_undone(deglint, sea, write, tmp_path, monkeypatch, old, failing):
    source, before, calls, whole = write(tmp_path / "in.tif", sea()), old(), [], Path.replace

    def replace(self, target):
        calls.append(target)
        if len(calls) == failing:
            raise OSError(5, "Input/output error", str(self), None, str(target))
        return whole(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    ran = deglint("remove", source, tmp_path / "out.tif", *RUN, "--overwrite", "--flags", tmp_path / "f.tif",
                  "--save-model", tmp_path / "m.json", "-q")  # fmt: skip
    assert ran.code == 1
    assert says(ran.err, "cannot move", "Input/output error")
    assert "Nothing was changed" in ran.err
    assert old() == before


def test_new_outputs_are_taken_away_again(deglint, sea, write, tmp_path, monkeypatch):
    source, whole = write(tmp_path / "in.tif", sea()), Path.replace

    def replace(self, target):
        if target.name == "out.tif":
            raise OSError(5, "Input/output error")
        return whole(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    assert deglint("remove", source, tmp_path / "out.tif", *RUN, "-q").code == 1
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]


def test_files_that_cannot_be_restored_are_named(tmp_path, monkeypatch, old):
    whole, calls = Path.replace, []

    def replace(self, target):
        calls.append(target)
        if len(calls) > 1:
            raise OSError(5, "Input/output error")
        return whole(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(WriteError, match=r"out.tif is now .*\.old"), Scratch() as scratch:
        scratch.add(tmp_path / "out.tif").write_text("new")


def test_companions_go_last(tmp_path, monkeypatch, old):
    seen, whole = [], Path.replace

    def replace(self, target):
        seen.append({p.name for p in tmp_path.iterdir()} >= {"out.tif.aux.xml", "out.tif.msk"})
        return whole(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with Scratch() as scratch:
        for name in ("out.tif", "f.tif"):
            scratch.add(tmp_path / name).write_text("new")
    assert seen == [True] * 4
    assert set(old()) == set(OUTPUTS)


INTERRUPTED = """
    import os, signal, sys
    from pathlib import Path
    whole, calls = Path.replace, []
    def replace(self, target):
        calls.append(target)
        if len(calls) == abs(int(sys.argv[1])):
            if sys.argv[1].startswith("-"):  # the signal follows the move
                whole(self, target)
            os.kill(os.getpid(), int(sys.argv[2]))
        return whole(self, target)
    Path.replace = replace
    from deglint.cli import run
    sys.exit(run(sys.argv[3:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("at", "how"), [(1, signal.SIGINT), (-1, signal.SIGINT), (3, signal.SIGTERM), (-4, signal.SIGTERM)]
)
def test_a_signal_between_two_moves_is_undone(sea, write, tmp_path, old, at, how):
    source, before = write(tmp_path / "in.tif", sea()), old()
    call = [sys.executable, "-c", textwrap.dedent(INTERRUPTED), str(at), str(int(how)), "remove", source,
            str(tmp_path / "out.tif"), *RUN, "--overwrite", "--flags", str(tmp_path / "f.tif"), "-q"]  # fmt: skip
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 130
    assert re.fullmatch(r"\ninterrupted: .*no incomplete output.*\n", done.stderr)
    assert old() == before


@pytest.mark.slow
def test_a_killed_move_is_cleared_by_the_next_run(tmp_path, sea, write, deglint):
    source = write(tmp_path / "in.tif", sea())
    (tmp_path / "out.tif").write_bytes(b"old")
    call = [sys.executable, "-c", textwrap.dedent(INTERRUPTED), "2", "9", "remove", source, str(tmp_path / "out.tif"),
            *RUN, "--overwrite", "-q"]  # fmt: skip
    subprocess.run(call, capture_output=True, text=True, check=False)
    assert (tmp_path / "out.tif").read_bytes() == b"old"
    assert any(p.name.startswith(".") for p in tmp_path.iterdir())
    assert deglint("remove", source, tmp_path / "out.tif", *RUN, "--overwrite", "-q").code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif", "out.tif", "out.tif.json"]


def test_scratch_of_runs_that_live_stays(tmp_path):
    names = {
        "dead": ".out.tif.999999999-00000000.part.tif",
        "alive": f".out.tif.{os.getpid()}-00000000.part.tif",
        "of another": ".x.out.tif.999999999-00000000.part.tif",
        "the user's": ".out.tif.bak",
    }
    for name in names.values():
        (tmp_path / name).write_text("half")
    _clear_scratch(tmp_path / "out.tif")
    assert {p.name for p in tmp_path.iterdir()} == set(names.values()) - {names["dead"]}


def test_an_output_that_another_run_made_meanwhile_stays(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())

    def progress(stage, done, total):
        (tmp_path / "out.tif").write_bytes(b"theirs")

    with pytest.raises(WriteError, match=r"out\.tif.*by another run.*--overwrite"):
        remove_glint(source, tmp_path / "out.tif", HEDLEY, progress=progress)
    assert (tmp_path / "out.tif").read_bytes() == b"theirs"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif", "out.tif"]
