"""Compiled functions that LLVM is not to copy into their callers.

Within one large function it no longer knows that two rows of one array are apart, and leaves loops over them as slow
as they are written; a function of its own tells that from its arguments, once a call, and is compiled only once.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic


def _apart(_typing: Any) -> Any:
    """To be called anywhere in a function that is to stay one."""

    def mark(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), mark


apart: Any = intrinsic(_apart)
