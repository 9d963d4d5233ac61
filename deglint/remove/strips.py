"""Strips of a scene whose bands have opposite delays: detectors that look forward and backward in turn.

The detectors of Sentinel-2 stand in two rows. One row sees the blue band first, the other sees it last, so that waves
move from the NIR to a band by opposite ways in neighbouring strips, and one kernel for both would follow neither. Which
strip a pixel lies in is known from the product's footprints, or found from the image: the kernel of one strip is the
mirror image of that of the other. Arrays only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..moments import CELL, Float64
from .kernels import LagGrams, solve, unexplained

SPLIT_WORTH = 0.15
"""Relative noise that two kernels must save against one for the image to show strips: 0.27 in a scene of two
detectors, 0.00 to 0.06 in scenes of one."""
ROUNDS = 20
"""Rounds in which squares are given to the kernel that suits them; they settle within five."""
LEAST_SQUARES_OF_KIND = 2
"""Squares that each kind of strip must have in the sample for kernels of its own."""


@dataclass(frozen=True, slots=True)
class Strips:
    """Which squares of `CELL` pixels of a scene lie in strips of the second kind.

    Attributes
    ----------
    rows : tuple of str
        One a row of squares, "0" or "1" for each square.
    """

    rows: tuple[str, ...]

    @classmethod
    def of(cls, second: npt.NDArray[np.bool_]) -> Strips:
        """From an array (row of squares, column of squares)."""
        return cls(tuple("".join("1" if s else "0" for s in row) for row in second))

    def share(self, rows: tuple[int, int], columns: tuple[int, int]) -> npt.NDArray[np.float32]:
        """How much of the second kind each pixel of a window is: 0 to 1, faded over a square at the seam.

        Bilinear between the centres of the squares, (row, column) of float32: the same for any window.
        """
        kind = np.array([[c == "1" for c in row] for row in self.rows], np.float32)
        (top, low, down), (left, right, across) = (
            _between(np.arange(*span), n) for span, n in zip((rows, columns), kind.shape, strict=True)
        )
        upper = kind[top][:, left] * (1 - across) + kind[top][:, right] * across
        lower = kind[low][:, left] * (1 - across) + kind[low][:, right] * across
        return np.asarray(upper * (1 - down[:, None]) + lower * down[:, None], np.float32)

    def of_cells(self, grams: LagGrams) -> npt.NDArray[np.bool_]:
        """Which squares of a sample are of the second kind."""
        middle = grams.places + CELL // 2
        return np.array([self.share((r, r + 1), (c, c + 1))[0, 0] > 0.5 for r, c in middle], np.bool_)


def _between(places: npt.NDArray[np.int64], count: int) -> tuple[npt.NDArray[np.int64], ...]:
    """Squares before and after some pixels, and how far the pixels are from the first to the second centre."""
    at = np.clip((places + 0.5) / CELL - 0.5, 0, count - 1)
    first = np.minimum(at.astype(np.int64), count - 1)
    return first, np.minimum(first + 1, count - 1), (at - first).astype(np.float32)


def find_kernels(grams: LagGrams, bands: int) -> tuple[Float64, Float64] | None:
    """Two kernels of 3 x 3 pixels that explain the squares of a sample much better than one; None where one will do.

    Squares are given to the kernel that leaves less, and the kernels fitted to their squares, in turn; begun with the
    kernel of all and its mirror image.

    Parameters
    ----------
    grams : LagGrams
    bands : int
        How many bands there are.
    """
    inputs, outputs = grams.columns(0, 3), [grams.band(b) for b in range(bands)]
    total = grams.grams.sum(axis=0)
    one = solve(total, inputs, outputs)
    two = [one, one[::-1]]
    for _ in range(ROUNDS):
        second = second_kind(grams, two)
        if min(int(second.sum()), int((~second).sum())) < LEAST_SQUARES_OF_KIND:
            return None
        two = [solve(grams.grams[second == k].sum(axis=0), inputs, outputs) for k in (False, True)]
    left = np.minimum(*(_left(grams, kernel) for kernel in two)).sum()
    saved = 1 - np.sqrt(left / _left(grams, one).sum())
    return (two[0], two[1]) if saved > SPLIT_WORTH else None


def second_kind(grams: LagGrams, kernels: Sequence[Float64]) -> npt.NDArray[np.bool_]:
    """Which squares the second of two kernels explains better."""
    first, second = (_left(grams, kernel) for kernel in kernels)
    return np.asarray(second < first)


def _left(grams: LagGrams, kernel: Float64) -> Float64:
    """What a kernel of 3 x 3 pixels leaves in each square: the sum over bands of relative power."""
    inputs, outputs = grams.columns(0, 3), [grams.band(b) for b in range(kernel.shape[1])]
    power = np.maximum(grams.grams.sum(axis=0)[outputs, outputs], np.finfo(float).tiny)
    return np.array([(unexplained(g, inputs, outputs, kernel) / power).sum() for g in grams.grams])


def filled(known: npt.NDArray[np.int8]) -> npt.NDArray[np.bool_]:
    """Squares of the second kind, where some are known (0 or 1) and others (-1) take the kind of the nearest.

    A square whose eight neighbours mostly are of the other kind takes theirs.
    """
    import cv2
    from scipy.ndimage import distance_transform_edt

    if (known < 0).all():
        return np.zeros(known.shape, np.bool_)
    nearest = distance_transform_edt(known < 0, return_distances=False, return_indices=True)
    kinds = known[tuple(nearest)].astype(np.uint8)
    return np.asarray(cv2.medianBlur(kinds, 3)).view(np.bool_) if min(kinds.shape) >= 3 else kinds.view(np.bool_)
