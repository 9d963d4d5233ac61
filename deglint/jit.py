"""numba's compiler, whose cache on disk is used where it can be, and done without where it cannot.

numba ends a program whose functions it cannot keep: in an installation that is read-only for a user without a home, or
on a full disk. Kernels take `njit` and everything else of numba from here.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numba
from numba.core.caching import FunctionCache


class _Cache(FunctionCache):
    """A cache that an error of the disk turns off, and does not end what asked it."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was kept; None where it cannot be read."""
        try:
            return super().load_overload(sig, target_context)
        except (OSError, EOFError, ValueError):
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep it, if that can be."""
        try:
            super().save_overload(sig, data)
        except OSError:
            self.disable()


def njit(function: Callable[..., Any] | None = None, /, *, cache: bool = False, **options: Any) -> Any:
    """Compile a function as `numba.njit` does; with `cache`, for the next process, too, where the disk allows it."""
    if function is None:
        return partial(njit, cache=cache, **options)
    made = numba.njit(**options)(function)
    if cache and hasattr(made, "enable_caching"):  # not where NUMBA_DISABLE_JIT is set
        try:
            made._cache = _Cache(made.py_func)  # what enable_caching does, with the cache above
        except RuntimeError:  # there is no directory that can be written to
            return made
    return made


def __getattr__(name: str) -> Any:
    """Everything else of numba."""
    return getattr(numba, name)
