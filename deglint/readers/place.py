"""Where on Earth a raster or the shapes of a GeoJSON file lie: the latitude and longitude of their middle."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..raster.info import one_line, open_dataset
from .areas import _crs_of
from .text import read_json

_LONGITUDE_LATITUDE = "OGC:CRS84"


def middle_of(path: str, option: str = "--place") -> tuple[float, float]:
    """Latitude and longitude of the middle of a raster, or of the box around a GeoJSON file's shapes.

    Parameters
    ----------
    path : str
        GDAL name of the raster, or a file that ends in .geojson or .json.
    option : str
        The option's name, for messages.

    Raises
    ------
    InputError
        It has no place on Earth.
    ReadError
        There is no such file, or it is neither.
    """
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import RasterioError
    from rasterio.warp import transform

    if Path(path).suffix.lower() in (".geojson", ".json"):
        document = read_json(path, option)
        points = np.array(list(_points(document)), dtype=np.float64).reshape(-1, 2)
        if not len(points) or not np.isfinite(points).all():
            raise InputError(f"{path} ({option}) holds no point. Draw a point, a line or an area in it.")
        x, y = 0.5 * (points.min(axis=0) + points.max(axis=0))
        crs = _crs_of(document, path)
    else:
        with open_dataset(path) as dataset:
            crs, corner = dataset.crs, dataset.transform * (0.5 * dataset.width, 0.5 * dataset.height)
        if crs is None:
            raise InputError(f"{path} ({option}) has no CRS, so its place is not known. Give --lat and --lon.")
        x, y = corner
    try:
        (longitude,), (latitude,) = transform(crs, _LONGITUDE_LATITUDE, [x], [y])
    except (RasterioError, CPLE_BaseError, ValueError) as error:
        raise InputError(f"{path} ({option}) has a place that cannot be found: {one_line(error)}.") from error
    if not np.isfinite([latitude, longitude]).all() or abs(latitude) > 90.0:
        raise InputError(f"{path} ({option}) lies nowhere on Earth in its CRS. Give --lat and --lon.")
    return float(latitude), float(longitude)


def _points(node: Any) -> Iterator[tuple[float, float]]:
    """All positions in a GeoJSON document, whatever wraps them."""
    if isinstance(node, dict):
        for member in ("features", "geometries", "geometry", "coordinates"):
            yield from _points(node.get(member))
    elif isinstance(node, list):
        if len(node) >= 2 and all(isinstance(n, (int, float)) for n in node[:2]):
            yield float(node[0]), float(node[1])
        else:
            for child in node:
                yield from _points(child)
