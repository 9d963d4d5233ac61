"""Operations with squares of pixels: cut an array into squares; dilate, erode and open a mask; sum over squares."""

from collections.abc import Iterator
from itertools import product
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt


def square(side: int) -> npt.NDArray[np.uint8]:
    """A square structuring element of `side` x `side` pixels: an array of ones, (side, side)."""
    return np.ones((side, side), np.uint8)


def squares(shape: tuple[int, ...], side: int) -> Iterator[tuple[slice, slice]]:
    """Yield (row, column) slices of squares of `side` pixels that fill an array; the last of an axis may be smaller."""
    for row, column in product(*(range(0, n, side) for n in shape)):
        yield slice(row, row + side), slice(column, column + side)


def grown(mask: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.bool_]:
    """The mask (row, column), dilated by a square of `side` x `side` pixels (morphological dilation)."""
    return np.asarray(cv2.dilate(mask.view(np.uint8), square(side))).view(np.bool_)


def eroded(mask: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.bool_]:
    """The mask (row, column), eroded by a square of `side` x `side` pixels; outside the image the mask is False."""
    inner = cv2.erode(mask.view(np.uint8), square(side), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(inner).view(np.bool_)


def opened(mask: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.bool_]:
    """Opened mask (row, column): True in the `side` x `side` squares, centred on a pixel, that have no False pixel."""
    return np.asarray(cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, square(side))).view(np.bool_)


def box_sum(values: npt.NDArray[Any], side: int) -> npt.NDArray[Any]:
    """Sum of values (row, column) over the `side` x `side` pixels around each pixel; values outside the image are 0.

    The result has the data type of the values if that is a float, else int32. Sums of integers below 2^31 are exact.
    """
    depth = -1 if values.dtype.kind == "f" else cv2.CV_32S
    return np.asarray(cv2.boxFilter(values, depth, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT))
