"""Which detector saw each pixel of each band, on the grid of the scene: Sentinel-2's MSK_DETFOO.

The masks of products since baseline 04.00 are rasters; older ones are outlines in GML, which are drawn. Where outlines
overlap, the detector of the higher number is taken.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ReadError
from ...raster import RasterInfo, RasterSource
from ...raster.info import describe_file
from ...scene import FloatArray, Window
from ..grid import nearest_on
from .container import read_named
from .metadata import MetadataError, numbers, xml_of

MOST_NUMBERS = 1_000_000
"""Coordinates of one outline that are read."""
_EPSG = re.compile(r"crs:EPSG:[\d.]*:(\d{4,5})$")
_DETECTOR = re.compile(r"-(\d{2})-\d+$")  # detector_footprint-B03-06-0


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
        self._sources: dict[str, Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {"paths": self.paths, "grid": self.grid, "_sources": {}}

    def read(self, window: Window, bands: Sequence[int]) -> FloatArray:
        """Detector numbers of a window, (len(bands), rows, columns) float32; NaN where no detector saw the pixel.

        Raises
        ------
        ReadError
            A mask cannot be read.
        """
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

    def _source(self, path: str) -> Any:
        found = self._sources.get(path)
        if found is None:
            made = _Outlines(path, self.grid) if path.lower().endswith(".gml") else _raster(path, self.grid)
            found = self._sources.setdefault(path, made)  # another thread may have been quicker
        return found


def _raster(path: str, grid: RasterInfo) -> RasterSource:
    info, place = describe_file(path), {n: getattr(grid, n) for n in ("height", "width", "crs", "transform")}
    return RasterSource([nearest_on(info, grid, nodata=0)], replace(info, nodatas=(0.0,), **place))


class _Outlines:
    """Outlines of detectors, drawn window by window."""

    def __init__(self, path: str, grid: RasterInfo) -> None:
        self._grid = grid
        self._shapes = _shapes(path, grid)

    def read(self, window: Window, bands: Sequence[int]) -> FloatArray:
        from rasterio.features import rasterize
        from rasterio.transform import Affine

        (top, bottom), (left, right) = window
        place = (self._grid.transform or Affine.identity()) @ Affine.translation(left, top)
        shape = (bottom - top, right - left)
        drawn = np.zeros(shape, np.uint8)
        if self._shapes and 0 not in shape:
            drawn = rasterize(self._shapes, out_shape=shape, transform=place, fill=0, dtype="uint8")
        found = np.where(drawn > 0, drawn, np.nan).astype(np.float32)
        return np.broadcast_to(found, (len(bands), *shape))

    def close(self) -> None:
        """Nothing is open."""


def _shapes(path: str, grid: RasterInfo) -> list[tuple[dict[str, Any], int]]:
    """Polygons of a GML file in the crs of the grid, and their detectors, in ascending order."""
    from rasterio.warp import transform_geom

    try:
        root = xml_of(read_named(path), path)
    except MetadataError as error:
        raise ReadError(f"{error}: the detector footprints cannot be read. Download the product again.") from error
    code = next((m[1] for n in root.iter() for v in n.attrib.values() if (m := _EPSG.search(v))), None)
    found = []
    for feature in root.iter("MaskFeature"):
        name = next((v for k, v in feature.attrib.items() if k.endswith("id")), "")
        detector = _DETECTOR.search(name)
        for ring in feature.iter("posList") if detector else ():
            values = numbers(ring.text, most=MOST_NUMBERS)
            step = 3 if ring.get("srsDimension") == "3" else 2
            if len(values) >= 4 * step and len(values) % step == 0:
                points = [[values[i : i + 2] for i in range(0, len(values), step)]]
                found.append(({"type": "Polygon", "coordinates": points}, int(detector[1]) if detector else 0))
    if code and grid.crs is not None and grid.crs.to_epsg() != int(code):
        found = [(transform_geom(f"EPSG:{code}", grid.crs, shape), n) for shape, n in found]
    return sorted(found, key=lambda pair: pair[1])
