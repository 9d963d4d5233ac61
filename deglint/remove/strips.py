"""Strips of a scene with opposite band delays, from detectors that look forward and backward alternately.

The detectors of Sentinel-2 are arranged in two rows. One row takes the blue band first, the other takes it last, so
that waves are displaced in opposite directions in neighbouring strips. There are therefore two kinds of strips, and one
kernel for both would fit neither. The kind at a pixel is known from the footprints of the detectors in the metadata, or
determined from the image: the kernels of the two kinds are point reflections of each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt

from ..moments import CELL, Float64, Mask
from .kernels import LagGrams, solve, unexplained

SPLIT_WORTH = 0.15
"""Least relative reduction of the RMS residual by two kernels instead of one, from which on a scene has two kinds of
strips: 0.27 in a scene of two detectors, 0.00 to 0.06 in scenes of one."""
ROUNDS = 20  # iterations in which squares are assigned to the better kernel; they converge within five
LEAST_SQUARES_OF_KIND = 2  # fewest squares of each kind of strip in the sample, for separate kernels


@dataclass(frozen=True, slots=True)
class Strips:
    """Map of two kinds of detector strips, which have opposite band delays, in squares of `CELL` x `CELL` pixels."""

    rows: tuple[str, ...]  # one text per row of squares: "0" for a square of the first kind, "1" of the second

    @classmethod
    def of(cls, second: Mask) -> Self:
        """Make the map from a mask, (row of squares, column of squares), that is True for the second kind of strip."""
        return cls(tuple("".join("1" if s else "0" for s in row) for row in second))

    def share(self, rows: tuple[int, int], columns: tuple[int, int]) -> npt.NDArray[np.float32]:
        """Weight of the second kind of strip, 0 to 1, at each pixel of a window, (row, column).

        It is interpolated bilinearly between the centres of the squares, so it does not depend on the window. `rows`
        and `columns` are the first, and the last + 1, row and column of the window in the scene [pixel].
        """
        kind = np.array([[c == "1" for c in row] for row in self.rows], np.float32)
        down, across = (_hat(np.arange(*span), n) for span, n in zip((rows, columns), kind.shape, strict=True))
        return np.asarray(down @ kind @ across.T)


def _hat(places: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.float32]:
    """Weight of each of `count` squares at each row or column in `places`, (place, square); 1 at a square's centre."""
    at = np.clip((places + 0.5) / CELL - 0.5, 0, count - 1)
    return np.maximum(1 - np.abs(at[:, None] - np.arange(count)), 0).astype(np.float32)


def find_kernels(grams: LagGrams) -> tuple[Float64, Float64] | None:
    """Kernels of 3 x 3 pixels, (offset, band) each, of the two kinds of strips; None if one kernel is nearly as good.

    It starts with the kernel of all squares and its point reflection. Each iteration assigns every square to the kernel
    with the smaller residual, and fits each kernel to its squares. The result is also None if a kind has few squares.
    """
    inputs, outputs = grams.columns(0, 3), grams.outputs
    total = grams.grams.sum(axis=0)
    one = solve(total, inputs, outputs)
    two = [one, one[::-1]]
    for _ in range(ROUNDS):
        second = second_is_better(grams, two)
        if min(int(second.sum()), int((~second).sum())) < LEAST_SQUARES_OF_KIND:
            return None
        two = [solve(grams.grams[second == k].sum(axis=0), inputs, outputs) for k in (False, True)]
    left = np.minimum(*(_residual_power(grams, kernel) for kernel in two)).sum()
    saved = 1 - np.sqrt(left / _residual_power(grams, one).sum())
    return (two[0], two[1]) if saved > SPLIT_WORTH else None


def second_is_better(grams: LagGrams, kernels: Sequence[Float64]) -> Mask:
    """Mask (square,) of those image squares whose glint the second of two `kernels` predicts better than the first."""
    first, second = (_residual_power(grams, kernel) for kernel in kernels)
    return np.asarray(second < first)


def _residual_power(grams: LagGrams, kernel: Float64) -> Float64:
    """Sum over bands of residual power relative to power in the sample, (square,); `kernel`: 3 x 3, (input, band)."""
    inputs, outputs = grams.columns(0, 3), grams.outputs
    power = np.maximum(grams.grams.sum(axis=0)[outputs, outputs], np.finfo(float).tiny)
    return np.asarray((unexplained(grams.grams, inputs, outputs, kernel) / power).sum(axis=1))


def filled(known: npt.NDArray[np.int8]) -> Mask:
    """Complete a map of the kinds of strips; return a mask, (row of squares, column of squares), of the second kind.

    `known` is 0 or 1, the kind, or -1 if not known. Unknown squares take the kind of the nearest known square, or
    the first kind if none is known. Then isolated squares take the kind of most of their neighbours.
    """
    from scipy.ndimage import distance_transform_edt

    if (known < 0).all():
        return np.zeros(known.shape, np.bool_)
    nearest = distance_transform_edt(known < 0, return_distances=False, return_indices=True)
    kinds = known[tuple(nearest)].astype(np.uint8)
    return np.asarray(cv2.medianBlur(kinds, 3)).view(np.bool_) if min(kinds.shape) >= 3 else kinds.view(np.bool_)
