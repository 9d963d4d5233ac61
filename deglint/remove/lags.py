"""Least squares of bands on the neighbourhoods of references: sums by squares of the image, which add up in any order.

The variables are every reference at every offset of a square of `SIDE` pixels, then the bands. One Gram matrix is kept
for each square of `CELL` pixels of the sample, so that some can be left out in turn. Arrays only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..moments import CELL
from ..scene import FloatArray
from .detrend import detrend
from .reference import LEAST_OPEN

Float64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SIDE = 5
"""Side of the largest kernel [pixel]; kernels of 7 pixels were no better on any scene."""
KERNEL_REACH = SIDE // 2
KERNEL_RIDGE = 1e-6
"""Added to the diagonal, in units of its mean, against singular sums; results do not change from 1e-6 to 1e-2."""


def offsets(side: int) -> tuple[tuple[int, int], ...]:
    """(row, column) of every pixel of a centred square.

    >>> offsets(1)
    ((0, 0),)
    """
    half = side // 2
    return tuple((row, column) for row in range(-half, half + 1) for column in range(-half, half + 1))


@dataclass(frozen=True, eq=False)
class LagGrams:
    """Gram matrices of [references at every offset | bands], one for each square of the sample.

    Attributes
    ----------
    grams : (square, variable, variable) ndarray of float64
        About the mean of the square.
    pixels : (square,) ndarray of int
    references : int
        How many references there are.
    places : (square, 2) ndarray of int
        Row and column in the scene of the first pixel of each square.
    """

    grams: Float64
    pixels: npt.NDArray[np.int64]
    references: int
    places: npt.NDArray[np.int64]

    def some(self, chosen: Mask) -> LagGrams:
        """Those of some squares."""
        return LagGrams(self.grams[chosen], self.pixels[chosen], self.references, self.places[chosen])

    def columns(self, reference: int, side: int) -> list[int]:
        """Variables of one reference that a kernel of this side uses."""
        inside = set(offsets(side))
        return [reference * SIDE**2 + i for i, offset in enumerate(offsets(SIDE)) if offset in inside]

    def band(self, place: int) -> int:
        """Variable of a band, counted from 0."""
        return self.references * SIDE**2 + place

    def centre(self, reference: int) -> int:
        """Variable of a reference at its own pixel."""
        return reference * SIDE**2 + SIDE**2 // 2


def gather(
    references: Sequence[FloatArray],
    bands: Sequence[FloatArray],
    sample: Mask,
    *,
    size: int,
    origin: tuple[int, int] = (0, 0),
    weight: FloatArray | None = None,
) -> LagGrams:
    """Sums of one tile.

    Parameters
    ----------
    references, bands : sequences of (row, column) ndarray
    sample : (row, column) ndarray of bool
        Pixels to learn from, all of them finite.
    size : int
        A local mean over squares of this side is subtracted from everything before; 0 for none [pixel].
    origin : (int, int)
        Row and column of the tile in the scene.
    weight : (row, column) ndarray, optional
        Of each pixel in the sums; 1 by default.
    """
    import cv2

    stack = np.stack([*references, *bands])
    values = detrend(stack, sample, size) if size else stack.astype(np.float64)
    values[:, ~sample] = 0.0
    padded = np.pad(values[: len(references)], ((0, 0), (KERNEL_REACH, KERNEL_REACH), (KERNEL_REACH, KERNEL_REACH)))
    square = np.ones((SIDE, SIDE), np.uint8)
    inner = cv2.erode(sample.view(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=0).view(np.bool_)
    grams, pixels, places = [], [], []
    for top in range(0, sample.shape[0], CELL):
        for left in range(0, sample.shape[1], CELL):
            mask = inner[top : top + CELL, left : left + CELL]
            if mask.sum() < LEAST_OPEN * CELL**2:
                continue
            height, width = mask.shape
            shifted = [
                plane[top + KERNEL_REACH + row :, left + KERNEL_REACH + column :][:height, :width]
                for plane in padded
                for row, column in offsets(SIDE)
            ]
            own = [plane[top : top + height, left : left + width] for plane in values[len(references) :]]
            w = mask.astype(np.float64)
            if weight is not None:
                w *= weight[top : top + height, left : left + width]
            grams.append(_gram(np.stack([*shifted, *own], axis=1), w))
            pixels.append(int(mask.sum()))
            places.append((origin[0] + top, origin[1] + left))
    count = len(references) * SIDE**2 + len(bands)
    return LagGrams(
        np.array(grams).reshape(-1, count, count),
        np.array(pixels, np.int64),
        len(references),
        np.array(places, np.int64).reshape(-1, 2),
    )


def _gram(variables: Float64, weight: Float64) -> Float64:
    """Weighted sums of products about the weighted mean: variables are (row, variable, column), weights (row, column).

    By rows, since a product of a whole square is large enough for BLAS to start threads of its own, which then compete
    with those that share the tiles: where other work runs, too, that took three times the time.
    """
    mean = np.einsum("rvc,rc->v", variables, weight) / weight.sum()
    centred = variables - mean[:, None]
    weighted = centred * weight[:, None, :]
    return np.asarray((weighted @ centred.transpose(0, 2, 1)).sum(axis=0))


def merge(parts: Sequence[LagGrams]) -> LagGrams:
    """The sums of several tiles, in their order."""
    return LagGrams(
        np.concatenate([p.grams for p in parts]),
        np.concatenate([p.pixels for p in parts]),
        parts[0].references,
        np.concatenate([p.places for p in parts]),
    )


def solve(gram: Float64, inputs: Sequence[int], outputs: Sequence[int]) -> Float64:
    """Coefficients (input, output) of least squares."""
    power, cross = gram[np.ix_(inputs, inputs)], gram[np.ix_(inputs, outputs)]
    if len(inputs) == 1:
        return np.asarray(cross / power, np.float64) if power[0, 0] > 0 else np.zeros_like(cross)
    ridge = KERNEL_RIDGE * np.trace(power) / len(power) or 1.0
    return np.asarray(np.linalg.solve(power + ridge * np.eye(len(power)), cross), np.float64)


def unexplained(gram: Float64, inputs: Sequence[int], outputs: Sequence[int], coefficients: Float64) -> Float64:
    """Sum of squares of each output that the coefficients leave."""
    rest = gram[outputs, outputs] - 2 * (coefficients * gram[np.ix_(inputs, outputs)]).sum(axis=0)
    return np.asarray(rest + (coefficients * (gram[np.ix_(inputs, inputs)] @ coefficients)).sum(axis=0))
