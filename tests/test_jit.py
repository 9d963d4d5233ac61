"""Compiled functions are kept on disk where that can be; where it cannot, they work all the same."""

import errno
import re
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
