"""Region of the sea with floating objects: water, holes in it, and protrusions of land that may be ships.

A water mask has a hole where a ship is. A hole that is no larger than the largest ship belongs to the sea. A ship
alongside a quay makes a protrusion of the land, not a hole. Directional morphological openings find protrusions that
are narrow and straight. By its shape, a ship differs from rocks and corners of quays, but not from short piers.
Protrusions with land at both ends and water at both sides (bridges, sandbars, turbid water) are ignored. Holes next to
land count as clutter: as false alarms.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from deglint.errors import InputError
from deglint.morphology import grown

from ..arrays import Array, Float64, Mask, Uint8

Classes = Uint8
NOT_SEA, WATER, RIM, AFLOAT, ALONGSIDE, ATTACHED = 0, 1, 2, 3, 4, 5
"""Classes of pixels. RIM: water next to land (mixed pixels); it is in the statistics, and has no score. AFLOAT: holes
that a ship may fill. ALONGSIDE: protrusions of the land with the shape of a ship. ATTACHED: holes of the size of a ship
next to land, which count as clutter."""
LARGEST = (400.0, 60.0)  # length and width of the largest ships [m]
MOST = 128  # maximum length of a hole [pixel], which limits the halo of tiles: larger ones are land or moored ships
_SHORTEST = 50.0  # minimum length of a ship alongside [m]: with fewer than five pixels of 10 m, no shape is measurable
_FILL = 0.55  # minimum fraction of its smallest rectangle that a ship fills; hulls fill 0.7 to 0.9, small ones less
ELONGATION = 1.8  # minimum ratio of length to width of a ship; ships have 4 to 8, the blur of a pixel lowers the ratio
_ATTACHED_WITHIN = 2  # largest distance of an attached part from land [pixel]: a pixel between them is mixed
_CONTINUED = (0.5, 0.25)
"""A part is a piece of longer land if the fraction of land is at least the first value at each end, and at most the
second at each side. Bends and mixed pixels lower the fraction at the ends; land at a side is a quay."""
_DIRECTIONS = 12
"""Number of directions in the search for ships: a hull 8 times as long as wide tolerates a deviation of 7.5 degrees."""
_HULL_BLUR = 1.5  # width that the point spread function adds to a hull [pixel]


@dataclass(frozen=True)
class SeaRule:
    """Size of a pixel and of the largest floating object. If `length` is 0, no hole of the water mask is filled."""

    pixel: float  # side of a pixel [m]
    length: float = LARGEST[0]  # length of the largest floating object [m]
    width: float = LARGEST[1]  # width of the largest floating object [m]

    def __post_init__(self) -> None:
        if not self.pixel > 0:
            raise InputError(f"pixel: want a side above 0 m, got {self.pixel}.")
        if not 0 <= self.width <= self.length < math.inf:
            size = f"length {self.length:g} and width {self.width:g}"
            raise InputError(f"largest object: want 0 <= width <= length < infinity [m], got {size}.")

    @property
    def sides(self) -> tuple[float, float]:
        """Length and width of the largest floating object [pixel], both scaled so that the length is at most `MOST`."""
        scale = min(1 / self.pixel, MOST / self.length if self.length else math.inf)
        return self.length * scale, self.width * scale

    @property
    def halo(self) -> int:
        """Width of the margin around a tile that its classes depend on [pixel]."""
        length, width = self.sides
        return math.ceil(length) + 2 * math.ceil(width) + 4 if length else 2


def region(water: Mask, rule: SeaRule, valid: Mask | None = None) -> Classes:
    """Classify the pixels of a water mask that has holes at floating objects; mask and classes are (row, column).

    WATER is open water, RIM is water next to land. AFLOAT are holes that a ship may fill, ATTACHED are such holes next
    to land or the edge of the image, and ALONGSIDE are protrusions of land with the shape of a ship. The rest is
    NOT_SEA. Pixels that are neither in `water` nor `valid` are NOT_SEA, but do not count as land.
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
        out[(out == WATER) & grown(land, 3)] = RIM
        if width:
            out[_alongside(land, rule)] = ALONGSIDE
    return out


def _opened(mask: Mask, window: Uint8) -> Mask:
    return np.asarray(cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, window).view(np.bool_))


def _line(length: float, angle: float) -> Uint8:
    """Structuring element: a line of a length [pixel], at an angle clockwise from the upward direction [degree]."""
    half = (length - 1) / 2
    middle = math.ceil(half)
    across, down = half * math.sin(math.radians(angle)), -half * math.cos(math.radians(angle))
    window = np.zeros((2 * middle + 1, 2 * middle + 1), np.uint8)
    ends = [(round(middle + sign * across), round(middle + sign * down)) for sign in (-1, 1)]
    return np.asarray(cv2.line(window, ends[0], ends[1], (1,)))


def hull(length: float, width: float, size: float) -> bool:
    """Whether a part is elongated, and its `size` pixels fill most of its rectangle, `length` x `width` [pixel]."""
    return length >= ELONGATION * width and size >= _FILL * length * width


def likeness(length: float, width: float, size: float) -> float:
    """How similar a part attached to land is to a ship: size times the cube of the filled fraction of its rectangle.

    `length` and `width` are the sides of the smallest rectangle [pixel], `size` is the number of pixels in the part. A
    hull fills its rectangle. Corners and bends of piers, the most frequent false alarms, do not.
    """
    return size * (size / (length * width)) ** 3


def rectangle(footprint: Mask) -> tuple[float, float, float]:
    """Smallest rectangle of a mask: length and width [pixel], angle of the length clockwise from up [degree]."""
    rows, columns = np.nonzero(footprint)
    points = np.stack([columns, rows], axis=1).astype(np.float32)  # centres; the sides of a pixel are 1
    corners = np.concatenate([points + d for d in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5))])
    (_centre, (a, b), angle) = cv2.minAreaRect(cv2.convexHull(corners.astype(np.float32)))
    along = angle if a >= b else angle + 90  # of the longer side, clockwise from the direction of the rows
    return float(max(a, b)), float(min(a, b)), float((along + 90) % 180)


def _fitting(mask: Mask, length: float, width: float) -> tuple[Array, Array, list[tuple[int, float, float]]]:
    """Label the connected parts of a mask, and list the small ones.

    A part is small if its smallest rectangle is at most `length` + 1 by `width` + 1 pixels, and it has at most `length`
    * `width` pixels. Returns labels, (row, column), statistics as OpenCV computes them, (label, 5), and the list of
    small parts: (label, length and width of the rectangle).
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=8)
    found = []
    diagonal = math.hypot(length, width) + 1
    small = (stats[:, 2] <= diagonal) & (stats[:, 3] <= diagonal) & (stats[:, 4] <= length * width)
    for part in np.flatnonzero(small[1:count]) + 1:
        x, y, w, h = stats[part, :4]
        long, across, _angle = rectangle(labels[y : y + h, x : x + w] == part)
        if long <= length + 1 and across <= width + 1:  # mixed pixels at the edges add up to one pixel
            found.append((int(part), long, across))
    return labels, stats, found


def _holes(land: Mask, length: float, width: float) -> tuple[Mask, Mask]:
    """Masks of holes (parts of `land` up to `length` x `width` [pixel]): those in water, those near land or an edge."""
    labels, stats, found = _fitting(land, length, width)
    chosen = np.zeros(len(stats), np.bool_)
    chosen[[part for part, *_ in found]] = True
    near = grown(land & ~chosen[labels], 2 * _ATTACHED_WITHIN + 1)
    near[[0, -1]] = near[:, [0, -1]] = True
    attached = np.zeros_like(chosen)
    attached[labels[near]] = True
    return (chosen & ~attached)[labels], (chosen & attached)[labels]


def _continued(around: Mask, own: Mask) -> bool:
    """Whether a part of land has land at both ends and water at both sides. A ship has a free end, or a quay at a side.

    `own` is the mask of the part in its bounding box, `around` is the mask of all land in this box,
    enlarged by `_ATTACHED_WITHIN` pixels on each side.
    """
    inside = np.pad(own, _ATTACHED_WITHIN)
    ring = grown(inside, 2 * _ATTACHED_WITHIN + 1) & ~inside
    angle = math.radians(rectangle(own)[2])

    def along(mask: Mask, angle: float) -> Float64:
        rows, columns = np.nonzero(mask)
        return columns * math.sin(angle) - rows * math.cos(angle)

    part, place = along(inside, angle), along(ring, angle)
    across = along(ring, angle + math.pi / 2) - np.median(along(inside, angle + math.pi / 2))
    ends = place < part.min() - 0.5, place > part.max() + 0.5
    sides = (~ends[0] & ~ends[1] & (sign * across > 0) for sign in (-1, 1))
    land = around[ring]
    least, most = _CONTINUED
    return bool(min(land[e].mean() for e in ends) >= least and max(land[s].mean() for s in sides) <= most)


def _alongside(land: Mask, rule: SeaRule) -> Mask:
    """Mask of the parts of `land` with size and shape of a ship; of two that touch, only the one of higher `likeness`.

    For every direction, the function selects land that is not wider than a ship across the direction, and straight
    along it for the minimum length of a ship. This separates ships from their quay and from piers in other directions.
    """
    length, width = rule.sides
    shortest = max(_SHORTEST / rule.pixel, 5.0) if rule.sides[0] * rule.pixel >= rule.length - 1 else 5.0
    beside, wider = grown(~land, 3), np.pad(land, _ATTACHED_WITHIN, mode="edge")
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
                found.append((likeness(long, across, size), box, own))
    chosen, taken = np.zeros_like(land), np.zeros_like(land)
    for _likeness, (rows, columns), own in sorted(found, key=lambda f: -f[0]):
        if not (taken[rows, columns] & own).any():
            chosen[rows, columns] |= own
            box = (slice(max(rows.start - 1, 0), rows.stop + 1), slice(max(columns.start - 1, 0), columns.stop + 1))
            taken[box] |= grown(chosen[box], 3)
    return chosen
