"""The sea with what floats on it: water closed over holes and protrusions no larger than the largest ship.

A ship is not water: a water mask has a hole where a ship lies. A hole that a ship could fill belongs to the sea. A ship
alongside a quay is no hole but a protrusion of the land: a morphological opening of the land with a window wider than a
ship removes it, and its shape distinguishes it from rocks and corners of quays, though not from short piers.
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
NOT_SEA, WATER, RIM, AFLOAT, ALONGSIDE = 0, 1, 2, 3, 4
"""Classes of pixels. RIM: water beside land, half land itself: it counts in the statistics and gets no score."""
LARGEST = (400.0, 60.0)
"""Length and width of the largest ships [m]."""
MOST = 128
"""Most pixels of a length: at fine pixels larger holes of the water are land or a moored ship, and tiles stay small."""
_SHORTEST = 50.0
"""Least length of a protrusion that is taken for a ship [m]: five pixels of 10 m, fewer have no shape."""
_FILL = 0.55
"""Least share of its smallest rectangle that a ship alongside fills: a hull fills 0.7 to 0.9, corners of quays less."""
_ELONGATION = 1.8
"""Least length over width of a ship alongside: ships have 4 to 8, and the blur of a pixel lowers it."""
_CUTS = (0.0, 1 / 3, 1 / 2, 2 / 3)
"""Shares of the width at which thin parts are cut first: a ship along a narrow breakwater is wider than that."""


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
        NOT_SEA, WATER, RIM, AFLOAT or ALONGSIDE.

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
        out[_afloat(land, length, width)] = AFLOAT
        land &= out != AFLOAT
    if land.any():
        out[(out == WATER) & _grown(land, 3)] = RIM
        if width:
            out[_alongside(land, rule)] = ALONGSIDE
    return out


def _grown(mask: Mask, side: int) -> Mask:
    import cv2

    return np.asarray(cv2.dilate(mask.view(np.uint8), np.ones((side, side), np.uint8)).view(np.bool_))


def _opened(mask: Mask, side: int) -> Mask:
    import cv2

    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, disc).view(np.bool_))


def _odd(pixels: float) -> int:
    return 2 * max(round((pixels - 1) / 2), 0) + 1


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


def _afloat(land: Mask, length: float, width: float) -> Mask:
    """Holes of the water that a ship could fill."""
    labels, stats, found = _fitting(land, length, width)
    chosen = np.zeros(len(stats), np.bool_)
    chosen[[part for part, *_ in found]] = True
    return np.asarray(chosen[labels])


def _alongside(land: Mask, rule: SeaRule) -> Mask:
    """Protrusions of the land that have a ship's size and shape."""
    length, width = rule.sides
    shortest = max(_SHORTEST / rule.pixel, 5.0) if rule.sides[0] * rule.pixel >= rule.length - 1 else 5.0
    wide = _opened(land, _odd(width) + 2)
    found = np.zeros_like(land)
    beside = _grown(~land, 3)
    for cut in sorted({_odd(width * share) for share in _CUTS}):
        base = land if cut == 1 else _opened(land, cut)
        labels, stats, parts = _fitting(base & ~wide & ~found, length, width * 1.15)
        for part, long, across in parts:
            if long < shortest or long < _ELONGATION * across or stats[part, 4] < _FILL * long * across:
                continue
            x, y, w, h = stats[part, :4]
            box = (slice(y, y + h), slice(x, x + w))
            own = labels[box] == part
            if (own & beside[box]).any():
                found[box] |= own
    return found
