"""Serve the pixels of an array in memory, or of a lazy one, as those of a file are served."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..scene import Window
from .convert import Raw, Valid, is_valid
from .handle import FileBands
from .info import RasterInfo
from .source import RasterSource


class ArraySource(RasterSource):
    """Pixels of a scene from a (band, row, column) numpy or dask array; what it gives are copies.

    Of a lazy array only the window that is asked for is computed. `origin` is the row and column in the scene of the
    array's first pixel, where it is a part of it.
    """

    def __init__(self, values: Any, info: RasterInfo, origin: tuple[int, int] = (0, 0)) -> None:
        super().__init__([FileBands(info.paths[0], tuple(range(1, info.count + 1)), info.nodatas)], info)
        self.values, self.origin = values, origin

    def declared(self, info: RasterInfo) -> ArraySource:
        """The same pixels with another nodata and offset declared."""
        found = ArraySource(self.values, info, self.origin)
        found.settled = True
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "values": self.values, "origin": self.origin}

    def _read(self, window: Window, bands: Sequence[int], *, nodata: bool) -> tuple[Raw, Valid | None]:
        rows, columns = ((a - first, b - first) for (a, b), first in zip(window, self.origin, strict=True))
        _, height, width = self.values.shape
        if not (0 <= rows[0] <= rows[1] <= height and 0 <= columns[0] <= columns[1] <= width):
            raise InputError(
                f"window: allowed inside the {height} rows and {width} columns from {self.origin} on, got {window}"
            )
        first = min(bands, default=0)
        together = list(bands) == list(range(first, first + len(bands)))
        chosen = slice(first, first + len(bands)) if together else list(bands)  # a slice copies nothing
        raw = np.array(self.values[chosen, slice(*rows), slice(*columns)], self.info.dtype)
        return raw, is_valid(raw, [self.info.nodatas[b] for b in bands]) if nodata else None
