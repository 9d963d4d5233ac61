"""numba's compiler with a disk cache that is optional: an unusable cache is not an error.

numba itself raises an error if it cannot cache a function: in a read-only installation without a home directory, or on
a full disk. Kernels import `njit` and all other names of numba from this module.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numba
from numba.core.caching import FunctionCache


class _Cache(FunctionCache):
    """A cache that is disabled by an error of the disk."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The cached function; None where it cannot be read."""
        try:
            return super().load_overload(sig, target_context)
        except (OSError, EOFError, ValueError):
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Cache a function, if possible."""
        try:
            super().save_overload(sig, data)
        except OSError:
            self.disable()


def njit(function: Callable[..., Any] | None = None, /, *, cache: bool = False, **options: Any) -> Any:
    """Compile a function like `numba.njit`; with `cache`, it is cached on disk where possible."""
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
    """All other names of numba."""
    return getattr(numba, name)
