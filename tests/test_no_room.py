"""No room: no directory for the cache of compiled functions, nor for temporary files."""

import errno
import os
import re
import subprocess
import sys

import pytest
from numba.core import caching

from deglint.jit import njit

from .common import ROOT


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


def test_every_kernel_is_compiled_so():
    straight = re.compile(r"^(from numba import .*\bnjit\b|import numba\b)", re.MULTILINE)
    found = [
        p.name for room in ("deglint", "detect") for p in (ROOT / room).rglob("*.py") if straight.search(p.read_text())
    ]
    assert found == ["jit.py"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["info", "in.tif"], ["plan", "--sun", "30@90"],
     ["remove", "in.tif", "out.tif", "--method", "hedley", "--mask", "none"]],
    ids=["help", "info", "plan", "remove"],
)  # fmt: skip
def test_commands_need_no_temporary_files(sea, write, tmp_path, arguments):
    write(tmp_path / "in.tif", sea())
    nowhere = {name: str(tmp_path / "nowhere") for name in ("TMPDIR", "TEMP", "TMP")}
    settings = os.environ | nowhere | {"PYTHONPATH": str(ROOT)}
    ran = subprocess.run([sys.executable, "-m", "deglint", *arguments], cwd=tmp_path, capture_output=True, text=True,
                         check=False, env=settings)  # fmt: skip
    assert ran.returncode == 0, ran.stderr
