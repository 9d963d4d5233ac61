"""Location of a raster or of the shapes in a GeoJSON file, and the size of pixels on the ground."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..raster.info import gdal_errors, one_line, open_dataset
from ..scene import Scene
from .areas import LONGITUDE_LATITUDE, crs_of, geometries
from .text import positive, read_json

_GEOCENTRIC = "EPSG:4978"  # x, y, z from the centre of the WGS 84 ellipsoid [m]
_TRUE = 0.01  # relative error of lengths in a map projection that is neglected; UTM has at most 0.001


def ground_size(transform: Any, crs: Any, height: int, width: int) -> tuple[float, float] | None:
    """Sides of the central pixel of a raster on the ground [m]: along a row, and along a column.

    They are distances on the ellipsoid, as coordinates may be degrees, and the metres of web Mercator are too long by
    1 / cos(latitude). `height` and `width` are the size of the raster [pixel]. None without a valid CRS and transform.
    """
    from rasterio.warp import transform as to_crs

    if transform is None or crs is None or transform.is_identity:
        return None
    x, y = transform * (0.5 * width, 0.5 * height)
    steps = (transform.a, transform.d), (transform.b, transform.e)
    xs, ys = zip(*((x + end * dx, y + end * dy) for dx, dy in steps for end in (-0.5, 0.5)), strict=True)
    try:
        places = np.array(to_crs(crs, _GEOCENTRIC, xs, ys, zs=[0.0] * 4))
    except gdal_errors(ValueError):
        return None
    across, down = np.linalg.norm(places[:, 1::2] - places[:, ::2], axis=0).tolist()
    if not all(0.0 < side < math.inf for side in (across, down)):
        return None
    if crs.is_projected:
        unit = float(crs.linear_units_factor[1])
        stated = unit * math.hypot(*steps[0]), unit * math.hypot(*steps[1])
        if all(abs(found - s) <= _TRUE * s for found, s in zip((across, down), stated, strict=True)):
            return stated
    return across, down


def pixel_size(scene: Scene) -> float | None:
    """Mean side of a pixel on the ground [m], from georeferencing or else the tag GSD_M; None if not known."""
    info = getattr(scene.source, "info", None)
    if scene.transform is None or scene.transform.is_identity:
        tags = info.tags.get("", {}) if info is not None else {}
        return positive(tags.get("GSD_M"))
    sides = ground_size(scene.transform, scene.crs, scene.height, scene.width)
    return None if sides is None else math.sqrt(sides[0] * sides[1])


def ground_area(transform: Any, crs: Any, height: int, width: int) -> float | None:
    """Area of the central pixel of a raster on the ground [m2]; None if `ground_size` returns None.

    Rows and columns need not be perpendicular; the angle between them is taken from the raster's coordinates.
    """
    sides = ground_size(transform, crs, height, width)
    if sides is None:
        return None
    lengths = math.hypot(transform.a, transform.d) * math.hypot(transform.b, transform.e)
    return sides[0] * sides[1] * abs(transform.determinant) / lengths


def middle_of(path: str) -> tuple[float, float]:
    """Latitude and longitude [degree] of the centre of a raster, or of the bounding box of a GeoJSON file's shapes."""
    from rasterio.warp import transform

    if Path(path).suffix.lower() in (".geojson", ".json"):
        document = read_json(path, "--place")
        points = np.array([p for _kind, coordinates in geometries(document) for p in _points(coordinates)])
        if not len(points):
            raise InputError(f"{path} (--place) holds no point. Draw a point, a line or an area in it.")
        x, y = 0.5 * (points.min(axis=0) + points.max(axis=0))
        crs = crs_of(document, path)
    else:
        with open_dataset(path) as dataset:
            crs, corner = dataset.crs, dataset.transform * (0.5 * dataset.width, 0.5 * dataset.height)
        if crs is None:
            raise InputError(f"{path} (--place) has no CRS, so its place is not known. Give --lat and --lon.")
        x, y = corner
    try:
        (longitude,), (latitude,) = transform(crs, LONGITUDE_LATITUDE, [x], [y])
    except gdal_errors(ValueError) as error:
        raise InputError(f"{path} (--place) has a place that cannot be found: {one_line(error)}.") from error
    if not np.isfinite([latitude, longitude]).all() or abs(latitude) > 90.0:
        raise InputError(f"{path} (--place) lies nowhere on Earth in its CRS. Give --lat and --lon.")
    return float(latitude), float(longitude)


def _points(node: Any) -> Iterator[tuple[float, float]]:
    """Yield the points (x, y) in the coordinates of a geometry, which are lists nested to any depth."""
    if isinstance(node, list) and len(node) > 1 and all(isinstance(n, (int, float)) for n in node[:2]):
        yield float(node[0]), float(node[1])
    elif isinstance(node, list):
        for child in node:
            yield from _points(child)
