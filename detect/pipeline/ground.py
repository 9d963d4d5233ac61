"""Where pixels lie on the ground: places as longitude and latitude, distances and bearings between them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from deglint.scene import Scene

Points = Sequence[tuple[float, float]]
_EARTH = 6_371_008.8
"""Mean radius of the Earth [m]."""


def to_wgs84(scene: Scene) -> Callable[[Points], list[tuple[float, float]]] | None:
    """What turns (column, row) corners into (longitude, latitude) [degree]; None where the scene has no CRS."""
    transform, crs = scene.transform, scene.crs
    if transform is None or crs is None:
        return None
    from rasterio.warp import transform as warp

    def move(points: Points) -> list[tuple[float, float]]:
        t: Any = transform
        xs = [t.a * x + t.b * y + t.c for x, y in points]
        ys = [t.d * x + t.e * y + t.f for x, y in points]
        longitudes, latitudes = warp(crs, "OGC:CRS84", xs, ys)[:2]
        return [(float(x), float(y)) for x, y in zip(longitudes, latitudes, strict=True)]

    return move


def distance_and_bearing(start: tuple[float, float], end: tuple[float, float]) -> tuple[float, float]:
    """Distance [m] and initial bearing [degree, clockwise from north] between (longitude, latitude) places."""
    (lon0, lat0), (lon1, lat1) = (tuple(map(math.radians, p)) for p in (start, end))
    half = math.sin((lat1 - lat0) / 2) ** 2 + math.cos(lat0) * math.cos(lat1) * math.sin((lon1 - lon0) / 2) ** 2
    east = math.sin(lon1 - lon0) * math.cos(lat1)
    north = math.cos(lat0) * math.sin(lat1) - math.sin(lat0) * math.cos(lat1) * math.cos(lon1 - lon0)
    return 2 * _EARTH * math.asin(min(math.sqrt(half), 1.0)), math.degrees(math.atan2(east, north)) % 360
