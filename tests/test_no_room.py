"""No room: caches of compiled functions that cannot be written, no directory for temporary files, files of no size."""

import errno
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import caching

from deglint.jit import njit

ROOT = Path(__file__).parents[1]


def twice(x):
    return 2 * x


def test_functions_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))
    assert njit(cache=True)(twice)(3) == 6
    assert list(tmp_path.rglob("*.nbi"))
    again = njit(cache=True, nogil=True)(twice)
    assert again(3) == 6


def test_no_directory_can_be_written_to(monkeypatch):
    """As in an installation that is read-only, for a user without a home: numba itself would not even load."""

    def refuse(self):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(caching._CacheLocator, "ensure_cache_path", refuse)
    assert njit(cache=True)(twice)(3) == 6


@pytest.mark.parametrize("where", ["_save_overload", "_load_overload"])
@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EFBIG, errno.EACCES])
def test_the_disk_refuses(tmp_path, monkeypatch, where, error):
    def refuse(*_):
        raise OSError(error, "no")

    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(caching.Cache, where, refuse)
    assert njit(cache=True)(twice)(3) == 6


def test_every_kernel_is_compiled_so():
    straight = re.compile(r"^(from numba import .*\bnjit\b|import numba\b)", re.MULTILINE)
    found = [
        p.name for room in ("deglint", "detect") for p in (ROOT / room).rglob("*.py") if straight.search(p.read_text())
    ]
    assert found == ["jit.py"]


def no_files():
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))


@pytest.mark.parametrize("arguments", [["--help"], ["info", "in.tif"], ["plan", "--sun", "30@90"]])
def test_a_result_that_cannot_be_printed_is_one_line(sea, write, tmp_path, arguments):
    write(tmp_path / "in.tif", sea())
    with (tmp_path / "said").open("w") as said:
        ran = subprocess.run([sys.executable, "-m", "deglint", *arguments], cwd=tmp_path, stdout=said, check=False,
                             stderr=subprocess.PIPE, text=True, preexec_fn=no_files,
                             env=os.environ | {"PYTHONPATH": str(ROOT)})  # fmt: skip
    assert ran.returncode == 1
    assert ran.stderr.endswith("standard output: File too large.\n")


@pytest.mark.parametrize("limit", [None, no_files], ids=["no temporary directory", "and files of no size"])
@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [(["--help"], 0, ""), (["info", "in.tif"], 0, ""), (["plan", "--sun", "30@90"], 0, "wind: "),
     (["remove", "in.tif", "out.tif", "--method", "hedley", "--mask", "none"], 1, "cannot write out.tif: the disk")],
    ids=["help", "info", "plan", "remove"],
)  # fmt: skip
def test_commands_need_no_temporary_files(sea, write, tmp_path, arguments, code, said, limit):
    write(tmp_path / "in.tif", sea())
    nowhere = {name: str(tmp_path / "nowhere") for name in ("TMPDIR", "TEMP", "TMP")}
    settings = os.environ | nowhere | {"PYTHONPATH": str(ROOT)}
    ran = subprocess.run([sys.executable, "-m", "deglint", *arguments], cwd=tmp_path, capture_output=True, text=True,
                         check=False, preexec_fn=limit, env=settings)  # fmt: skip
    assert "Traceback" not in ran.stderr
    if limit is None and code:
        assert ran.returncode == 0, ran.stderr
        return
    assert ran.returncode == code, ran.stderr
    assert said in ran.stderr
