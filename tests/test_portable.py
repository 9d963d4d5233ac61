"""What other systems lack is used with a fallback: a run without it, as on Windows."""

import subprocess
import sys

import pytest

CODE = """
import os, signal, sys
for name in ("fcntl", "resource", "termios", "grp", "pwd"):
    sys.modules[name] = None
for home, names in ((os, "sched_getaffinity pread pwrite copy_file_range memfd_create sysconf getloadavg"),
                    (signal, "SIGHUP SIGKILL SIGQUIT SIGTSTP SIGXCPU")):
    for name in names.split():
        delattr(home, name)
import types
from deglint.raster import targets
targets.sys = types.SimpleNamespace(platform="win32")
locked = []
sys.modules["msvcrt"] = types.SimpleNamespace(LK_LOCK=1, LK_NBLCK=2, locking=lambda *given: locked.append(given))
from pathlib import Path
with targets.claimed(Path(sys.argv[2]).parent):
    assert locked
from deglint.cli import run
code = run(["remove", sys.argv[1], sys.argv[2], "--method", "hedley", "-q"])
from detect.cli import run
sys.exit(code or run(["score", sys.argv[2], sys.argv[2] + ".scores.tif", "--method", "rx", "-q"]))
"""


@pytest.mark.slow
def test_both_programs_run_without_what_only_posix_has(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(1030, 400))
    call = [sys.executable, "-c", CODE, source, str(tmp_path / "out.tif")]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
