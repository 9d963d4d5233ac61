"""From physical values back to what stands in a file: scale, offset, rounding, saturation - and what was lost.

Pixels that were not corrected keep their bits: they are never converted there and back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray


@dataclass(frozen=True, eq=False)
class Counts:
    """Pixels per band.

    Attributes
    ----------
    negative : (bands,) int64 ndarray
        Corrected, and below zero after.
    clipped : (bands,) int64 ndarray
        Corrected, and outside what the output's integer type can hold, so set to its end.
    """

    negative: npt.NDArray[np.int64]
    clipped: npt.NDArray[np.int64]


def encode(
    physical: FloatArray,
    raw: npt.NDArray[Any],
    *,
    bands: Sequence[int],
    scales: Sequence[float],
    offsets: Sequence[float],
    where: npt.NDArray[np.bool_] | None = None,
    flags: npt.NDArray[np.uint8] | None = None,
    marks: tuple[int, int] = (0, 0),
) -> Counts:
    """Put corrected values into `raw`, in its type.

    Parameters
    ----------
    physical : (band, row, column) ndarray
        Corrected values; those that are not finite leave `raw` as it is.
    raw : (band, row, column) ndarray
        Values as in the file, changed in place. May be `physical` itself where the file holds physical values.
    bands : sequence of int
        0-based bands that were corrected.
    scales, offsets : sequence of float
        physical = raw * scale + offset, a band.
    where : (row, column) bool ndarray, optional
        True where pixels were corrected.
    flags : (row, column) uint8 ndarray, optional
        Gets `marks[0]` where a value is negative and `marks[1]` where one is clipped.

    Returns
    -------
    Counts

    Notes
    -----
    Integers are rounded to nearest (ties to even) and saturate at the ends of their type.
    """
    negative = np.zeros(len(raw), np.int64)
    clipped = np.zeros(len(raw), np.int64)
    everywhere = where is None
    mask = np.ones((1, 1), np.bool_) if where is None else where
    with_flags = flags is not None
    marked = np.zeros((1, 1), np.uint8) if flags is None else flags
    for b in bands:
        if raw is physical or np.shares_memory(raw, physical):
            negative[b] = _kernels().look(raw[b], mask, everywhere, marked, with_flags, marks[0])
            continue
        given = (physical[b], raw[b], mask, everywhere, float(scales[b]), float(offsets[b]))
        if raw.dtype.kind in "iu":
            low, high = _range(raw.dtype)
            negative[b], clipped[b] = _kernels().put_integers(*given, low, high, marked, with_flags, *marks)
        else:
            negative[b] = _kernels().put_floats(*given, marked, with_flags, marks[0])
    return Counts(negative, clipped)


def _range(dtype: np.dtype[Any]) -> tuple[float, float]:
    """Smallest and largest float64 that an integer type can hold."""
    info = np.iinfo(dtype)
    high = float(info.max)
    return float(info.min), high if int(high) <= info.max else float(np.nextafter(high, 0))


@cache
def _kernels() -> Any:
    from . import _kernels

    return _kernels
