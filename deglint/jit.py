"""numba's compiler with an optional disk cache; kernels import `njit` from this module."""

from collections.abc import Callable
from typing import Any

import numba


def njit(*, cache: bool, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function like `numba.njit`; with `cache`, it is cached on disk where possible."""

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(cache=cache, **options)(function)
        except RuntimeError:  # there is no directory that can be written to
            return numba.njit(**options)(function)

    return compiled
