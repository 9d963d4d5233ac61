"""Speed and heading of the objects that were found, where the bands look at different times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from deglint.errors import InputError
from deglint.readers.place import ground_area
from deglint.scene import Scene

from ..moving import FASTEST, Mover, find_moving
from ..objects import Object
from .ground import distance_and_bearing, to_wgs84

_SEARCH_MARGIN = 40
"""Water around an object that contrast is taken from [pixel]."""


def delayed_bands(scene: Scene) -> tuple[list[int], list[float]]:
    """0-based bands whose time is known, and their times [s].

    Raises
    ------
    InputError
        Fewer than three bands are known to look at different times.
    """
    known = [(i, b.time_offset) for i, b in enumerate(scene.bands) if b.time_offset is not None]
    if len({t for _, t in known}) < 3:
        raise InputError(
            f"--moving needs three bands with known, different times, and {scene.path} has {len(known)}. "
            "Name the sensor with --sensor, or set time_offset_s in the bands' tags."
        )
    return [i for i, _ in known], [t for _, t in known]


def motions(scene: Scene, found: Sequence[Object]) -> list[dict[str, Any]]:
    """Speed [m/s] and heading [degree, clockwise from north] of every object; None for both where it does not move."""
    bands, times = delayed_bands(scene)
    area = ground_area(scene.transform, scene.crs, scene.height, scene.width)
    if area is None:
        raise InputError(f"--moving needs the size of a pixel, and {scene.path} has no CRS.")
    pixel = math.sqrt(area)
    reach = math.ceil(FASTEST * (max(times) - min(times)) / pixel)
    return [_motion(scene, o, bands, times, pixel, reach) for o in found]


def _motion(
    scene: Scene, found: Object, bands: list[int], times: list[float], pixel: float, reach: int
) -> dict[str, Any]:
    rows, columns = (
        (max(low - _SEARCH_MARGIN - reach, 0), min(high + _SEARCH_MARGIN + reach, size))
        for (low, high), size in zip(found.bounds, (scene.height, scene.width), strict=True)
    )
    block = scene.read((rows, columns), bands=bands)
    movers = find_moving(block, times, pixel=pixel)
    row, column = found.centroid[0] - rows[0], found.centroid[1] - columns[0]
    size = math.hypot(*found.footprint.shape)
    near = [m for m in movers if math.hypot(m.row - row, m.column - column) <= reach + size]
    if not near:
        return {"speed_m_s": None, "heading": None}
    best = min(near, key=lambda m: math.hypot(m.row - row, m.column - column))
    return {"speed_m_s": best.speed, "heading": _north(scene, best, rows[0], columns[0])}


def _north(scene: Scene, mover: Mover, top: int, left: int) -> float:
    """Heading of a mover from north, which need not be upward in the image."""
    move = to_wgs84(scene)
    assert move is not None
    x, y = left + mover.column + 0.5, top + mover.row + 0.5
    angle = np.radians(mover.heading)
    start, end = move([(x, y), (x + float(np.sin(angle)), y - float(np.cos(angle)))])
    return distance_and_bearing(start, end)[1]
