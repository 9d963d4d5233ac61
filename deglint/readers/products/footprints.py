"""Which detector saw each pixel of each band, on the grid of the scene: Sentinel-2's MSK_DETFOO.

The masks of products since baseline 04.00 are rasters; the outlines in GML of older ones are not read.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...raster import RasterInfo, RasterSource
from ...raster.info import describe_file
from ...scene import FloatArray, Window
from ..grid import nearest_on


class Footprints:
    """Detector number of each band at each pixel; a `deglint.scene.Source`.

    Files are opened when they are first read. It can be pickled.

    Parameters
    ----------
    paths : sequence of str or None
        GDAL name of the mask of each band of the scene; None where there is none.
    grid : RasterInfo
        Whose grid the scene has.
    """

    def __init__(self, paths: Sequence[str | None], grid: RasterInfo) -> None:
        self.paths = tuple(p if p is None or p.startswith("/vsi") else str(Path(p).absolute()) for p in paths)
        self.grid = grid
        self._sources: dict[str, RasterSource] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {"paths": self.paths, "grid": self.grid, "_sources": {}}

    def read(self, window: Window, bands: Sequence[int]) -> FloatArray:
        """Detector numbers of a window, (len(bands), rows, columns) float32; NaN where no detector saw the pixel."""
        (top, bottom), (left, right) = window
        out = np.full((len(bands), bottom - top, right - left), np.nan, np.float32)
        for i, band in enumerate(bands):
            path = self.paths[band]
            if path is not None:
                out[i] = self._source(path).read(window, [0])[0]
        return out

    def close(self) -> None:
        """Close the masks' files."""
        sources, self._sources = self._sources, {}
        for source in sources.values():
            source.close()

    def _source(self, path: str) -> RasterSource:
        if path not in self._sources:
            made = nearest_on(describe_file(path), self.grid, nodata=0.0)
            self._sources.setdefault(path, made)  # another thread may have been quicker
        return self._sources[path]
