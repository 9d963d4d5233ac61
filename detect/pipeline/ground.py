"""Positions and motion of objects on the ground: longitude and latitude, distances, bearings, speeds."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from deglint.errors import InputError
from deglint.readers.grid import at
from deglint.scene import Scene

from ..moving import FASTEST, Mover, find_moving
from ..objects import Move, Object

_EARTH = 6_371_008.8
"""Mean radius of the Earth [m]."""
_SEARCH_MARGIN = 40
"""Margin around an object in the search for its motion [pixel]: its contrast is relative to this water."""


def to_wgs84(scene: Scene) -> Move | None:
    """Function from (column, row) corners to (longitude, latitude) [degree]; None if the scene has no CRS."""
    transform, crs = scene.transform, scene.crs
    if transform is None or crs is None:
        return None
    from rasterio.warp import transform as warp

    def move(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        xs, ys = zip(*(at(transform, x, y) for x, y in points), strict=True)
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


def delayed_bands(scene: Scene) -> tuple[list[int], list[float]]:
    """0-based bands whose time is known, and their times [s]; an InputError where fewer than three times differ."""
    known = [(i, b.time_offset) for i, b in enumerate(scene.bands) if b.time_offset is not None]
    if len({t for _, t in known}) < 3:
        raise InputError(
            f"--moving needs three bands with known, different times, and {scene.path} has {len(known)}. "
            "Name the sensor with --sensor, or set time_offset_s in the bands' tags."
        )
    return [i for i, _ in known], [t for _, t in known]


def motions(scene: Scene, area: float | None, found: Sequence[Object]) -> list[dict[str, Any]]:
    """Speed [m/s] and heading [degree, clockwise from north] of every object; None for both where it does not move."""
    bands, times = delayed_bands(scene)
    if area is None:
        raise InputError(f"--moving needs the size of a pixel, and {scene.path} has no CRS.")
    pixel = math.sqrt(area)
    reach = math.ceil(FASTEST * (max(times) - min(times)) / pixel)
    return [_motion(scene, o, bands, times, pixel, reach) for o in found]


def _motion(
    scene: Scene, found: Object, bands: list[int], times: list[float], pixel: float, reach: int
) -> dict[str, Any]:
    """Speed and heading of the nearest moving boat within the distance that the object can travel."""
    rows, columns = (
        (max(low - _SEARCH_MARGIN - reach, 0), min(high + _SEARCH_MARGIN + reach, size))
        for (low, high), size in zip(found.bounds, (scene.height, scene.width), strict=True)
    )
    block = scene.read((rows, columns), bands=bands)
    row, column = found.centroid[0] - rows[0], found.centroid[1] - columns[0]

    def away(mover: Mover) -> float:
        return math.hypot(mover.row - row, mover.column - column)

    best = min(find_moving(block, times, pixel=pixel), key=away, default=None)
    if best is None or away(best) > reach + math.hypot(*found.footprint.shape):
        return {"speed_m_s": None, "heading": None}
    move = to_wgs84(scene)
    assert move is not None
    x, y = columns[0] + best.column + 0.5, rows[0] + best.row + 0.5
    angle = np.radians(best.heading)  # clockwise from the columns of the image, which need not point north
    start, end = move([(x, y), (x + float(np.sin(angle)), y - float(np.cos(angle)))])
    return {"speed_m_s": best.speed, "heading": distance_and_bearing(start, end)[1]}
