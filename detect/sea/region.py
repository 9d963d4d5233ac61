"""The sea with what floats on it: water closed over holes and protrusions no larger than the largest ship.

A ship is not water: a water mask has a hole where a ship lies. A hole that a ship could fill belongs to the sea. A ship
alongside a quay is no hole but a protrusion of the land: directional morphological openings find what is narrow across
a direction and straight along it, and its shape distinguishes it from rocks and corners of quays, though not from
short piers. A hole beside the land is taken for a part of it, and what the land continues at both ends for a piece of a
bridge, a bar or a front of turbid water.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint.errors import InputError

Mask = npt.NDArray[np.bool_]
Classes = npt.NDArray[np.uint8]
NOT_SEA, WATER, RIM, AFLOAT, ALONGSIDE, ATTACHED = 0, 1, 2, 3, 4, 5
"""Classes of pixels. RIM: water beside land, half land itself: it counts in the statistics and gets no score.
ATTACHED: holes that a ship could fill, but beside land and without a ship's shape: clutter, and no objects."""
LARGEST = (400.0, 60.0)
"""Length and width of the largest ships [m]."""
MOST = 128
"""Most pixels of a length: at fine pixels larger holes of the water are land or a moored ship, and tiles stay small."""
_SHORTEST = 50.0
"""Least length of a protrusion that is taken for a ship [m]: five pixels of 10 m, fewer have no shape."""
_FILL = 0.55
"""Least share of its smallest rectangle that a ship fills: a hull fills 0.7 to 0.9, less where it is a few pixels."""
_ELONGATION = 1.8
"""Least length over width of a ship: ships have 4 to 8, and the blur of a pixel lowers it."""
_ATTACHED_WITHIN = 2
"""Parts so near are attached [pixel]: the one pixel between is mixed with both, and does not show water."""
_CONTINUED = (0.5, 0.25)
"""Least share of land at both ends of a part that land continues, and most share at its sides: bends and mixed pixels
are at the ends, and land beside is a quay. 0.2 to 0.3 at the sides find the same ships in six real ports."""
_DIRECTIONS = 12
"""Directions in which ships alongside are looked for: a hull 8 times as long as wide lies within 7.5 degrees of one."""
_HULL_BLUR = 1.5
"""Width that the point spread function adds to a hull [pixel]."""


@dataclass(frozen=True)
class SeaRule:
    """Sizes that decide what floats.

    Attributes
    ----------
    pixel : float
        Side of a pixel [m].
    length, width : float
        Of the largest object that may float [m]; 0 closes nothing.
    """

    pixel: float
    length: float = LARGEST[0]
    width: float = LARGEST[1]

    def __post_init__(self) -> None:
        if not self.pixel > 0:
            raise InputError(f"pixel: allowed is above 0 m, got {self.pixel}.")
        if not 0 <= self.width <= self.length:
            raise InputError(
                f"largest object: allowed is a length of at least its width, got {self.length:g} by {self.width:g} m."
            )

    @property
    def sides(self) -> tuple[float, float]:
        """Length and width [pixel]."""
        scale = min(1 / self.pixel, MOST / self.length if self.length else math.inf)
        return self.length * scale, self.width * scale

    @property
    def halo(self) -> int:
        """Pixels around a tile that its region depends on."""
        length, width = self.sides
        return math.ceil(length) + 2 * math.ceil(width) + 4 if length else 2


def region(water: Mask, rule: SeaRule, valid: Mask | None = None) -> Classes:
    """Which pixels belong to the sea.

    Parameters
    ----------
    water : (row, column) ndarray of bool
        Water without what floats on it, as `deglint.masks.water` gives it.
    rule : SeaRule
    valid : (row, column) ndarray of bool, optional
        Pixels of the image; what is not valid is neither water nor land.

    Returns
    -------
    (row, column) ndarray of uint8
        NOT_SEA, WATER, RIM, AFLOAT, ALONGSIDE or ATTACHED.

    Examples
    --------
    >>> water = np.ones((9, 9), bool)
    >>> water[4, 3:6] = False
    >>> int((region(water, SeaRule(10.0)) == AFLOAT).sum())
    3
    """
    water = np.asarray(water, np.bool_)
    land = ~water if valid is None else ~water & valid
    out = np.where(water, WATER, NOT_SEA).astype(np.uint8)
    length, width = rule.sides
    if length:
        afloat, attached = _holes(land, length, width)
        out[afloat], out[attached] = AFLOAT, ATTACHED
        land &= ~afloat
    if land.any():
        out[(out == WATER) & _grown(land, 3)] = RIM
        if width:
            out[_alongside(land, rule)] = ALONGSIDE
    return out


def _grown(mask: Mask, side: int) -> Mask:
    import cv2

    return np.asarray(cv2.dilate(mask.view(np.uint8), np.ones((side, side), np.uint8)).view(np.bool_))


def _opened(mask: Mask, window: npt.NDArray[np.uint8]) -> Mask:
    import cv2

    return np.asarray(cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, window).view(np.bool_))


def _line(length: float, angle: float) -> npt.NDArray[np.uint8]:
    """Pixels on a line [pixel] at an angle clockwise from the upward direction of the image [degree]."""
    import cv2

    half = (length - 1) / 2
    middle = math.ceil(half)
    across, down = half * math.sin(math.radians(angle)), -half * math.cos(math.radians(angle))
    window = np.zeros((2 * middle + 1, 2 * middle + 1), np.uint8)
    ends = [(round(middle + sign * across), round(middle + sign * down)) for sign in (-1, 1)]
    return np.asarray(cv2.line(window, ends[0], ends[1], (1,)))


def hull(length: float, width: float, size: float) -> bool:
    """Whether so many pixels within a rectangle have the shape of a ship: long, straight and full."""
    return length >= _ELONGATION * width and size >= _FILL * length * width


def likeness(size: float, fill: float) -> float:
    """Likeness to a ship of parts attached to land: number of pixels, and share of the rectangle that they fill.

    A hull fills its rectangle; corners and bends of piers, with which most of what is no ship ends, do not. The cube
    makes the share count more than the size.
    """
    return size * fill**3


def rectangle(footprint: Mask) -> tuple[float, float, float]:
    """Smallest rectangle around the pixels of a mask: length and width [pixel], and the angle of its length.

    The angle is clockwise from the upward direction of the image, 0 to 180 degrees.
    """
    import cv2

    rows, columns = np.nonzero(footprint)
    points = np.stack([columns, rows], axis=1).astype(np.float32)
    corners = np.concatenate([points + d for d in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5))])
    hull = cv2.convexHull(corners.astype(np.float32))
    (_centre, (a, b), angle) = cv2.minAreaRect(hull)
    along = angle if a >= b else angle + 90  # of the longer side, from the row's direction, clockwise as seen
    return float(max(a, b)), float(min(a, b)), float((along + 90) % 180)


def _fitting(mask: Mask, length: float, width: float) -> tuple[Any, Any, list[tuple[int, float, float]]]:
    """Labels and boxes of the parts that fit into a rectangle, and number, length and width of each [pixel]."""
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=8)
    found = []
    diagonal = math.hypot(length, width) + 1
    small = (stats[:, 2] <= diagonal) & (stats[:, 3] <= diagonal) & (stats[:, 4] <= length * width)
    for part in np.flatnonzero(small[1:count]) + 1:
        x, y, w, h = stats[part, :4]
        long, across, _angle = rectangle(labels[y : y + h, x : x + w] == part)
        if long <= length + 1 and across <= width + 1:  # an edge that lies within a pixel widens by up to one
            found.append((int(part), long, across))
    return labels, stats, found


def _holes(land: Mask, length: float, width: float) -> tuple[Mask, Mask]:
    """Holes that a ship could fill: apart from land; and beside it, or cut by the border as land may be."""
    labels, stats, found = _fitting(land, length, width)
    chosen = np.zeros(len(stats), np.bool_)
    chosen[[part for part, *_ in found]] = True
    near = _grown(land & ~chosen[labels], 2 * _ATTACHED_WITHIN + 1)
    near[[0, -1]] = near[:, [0, -1]] = True
    attached = np.zeros_like(chosen)
    attached[labels[near]] = True
    return (chosen & ~attached)[labels], (chosen & attached)[labels]


def _continued(around: Mask, own: Mask) -> bool:
    """Whether land lies at both ends of a part and water at its sides; ships have a free end, or a quay beside them.

    `around` is the land in the box of the part and `_ATTACHED_WITHIN` pixels more on every side.
    """
    inside = np.pad(own, _ATTACHED_WITHIN)
    ring = _grown(inside, 2 * _ATTACHED_WITHIN + 1) & ~inside
    angle = math.radians(rectangle(own)[2])

    def along(mask: Mask, angle: float) -> npt.NDArray[np.float64]:
        rows, columns = np.nonzero(mask)
        return columns * math.sin(angle) - rows * math.cos(angle)

    part, place = along(inside, angle), along(ring, angle)
    across = along(ring, angle + math.pi / 2) - np.median(along(inside, angle + math.pi / 2))
    ends = place < part.min() - 0.5, place > part.max() + 0.5
    sides = (~ends[0] & ~ends[1] & (sign * across > 0) for sign in (-1, 1))
    land = around[ring]
    return bool(
        min(land[e].mean() for e in ends) >= _CONTINUED[0] and max(land[s].mean() for s in sides) <= _CONTINUED[1]
    )


def _alongside(land: Mask, rule: SeaRule) -> Mask:
    """Protrusions of the land that have a ship's size and shape, each apart from the others.

    For every direction: land that is no wider than a ship across it, and straight along it for a ship's least length.
    This separates ships from the quay that they lie at, and from piers of another direction.
    """
    length, width = rule.sides
    shortest = max(_SHORTEST / rule.pixel, 5.0) if rule.sides[0] * rule.pixel >= rule.length - 1 else 5.0
    beside, wider = _grown(~land, 3), np.pad(land, _ATTACHED_WITHIN, mode="edge")
    found: list[tuple[float, tuple[slice, slice], Mask]] = []
    for angle in np.arange(0, 180, 180 / _DIRECTIONS):
        narrow = land & ~_opened(land, _line(width + _HULL_BLUR + 1, angle + 90))
        straight = _opened(narrow, _line(shortest, angle))
        labels, stats, parts = _fitting(straight, length, width + _HULL_BLUR)
        for part, long, across in parts:
            x, y, w, h, size = stats[part]
            if long < shortest or not hull(long, across, size):
                continue
            box = (slice(y, y + h), slice(x, x + w))
            own = labels[box] == part
            around = wider[y : y + h + 2 * _ATTACHED_WITHIN, x : x + w + 2 * _ATTACHED_WITHIN]
            if (own & beside[box]).any() and not _continued(around, own):
                found.append((likeness(size, size / (long * across)), box, own))
    chosen, taken = np.zeros_like(land), np.zeros_like(land)
    for _likeness, (rows, columns), own in sorted(found, key=lambda f: -f[0]):
        if not (taken[rows, columns] & own).any():
            chosen[rows, columns] |= own
            box = (slice(max(rows.start - 1, 0), rows.stop + 1), slice(max(columns.start - 1, 0), columns.stop + 1))
            taken[box] |= _grown(chosen[box], 3)
    return chosen
