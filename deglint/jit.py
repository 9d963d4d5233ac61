"""A variant of `numba.njit` that also works where compiled code cannot be stored on disk; the package uses this one."""

from collections.abc import Callable
from typing import Any

import numba

from .checks import T


def njit(*, cache: bool, **options: Any) -> Callable[[T], T]:
    """Decorator like `numba.njit`; with `cache`, compiled code is stored on disk if a directory for it is writable."""

    def compiled(function: T) -> T:
        try:
            return numba.njit(cache=cache, **options)(function)
        except RuntimeError:  # there is no directory that can be written to
            return numba.njit(**options)(function)

    return compiled
