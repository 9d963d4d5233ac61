"""Conversion of physical values to file values: scale, offset, rounding, saturation; lost values are counted.

Pixels that were not corrected keep their bits: they are not converted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray
from .convert import is_valid, slabs
from .info import same_nodata

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Counts:
    """Corrected pixels per band that are `negative`, or `clipped` to the range of the type or moved off its nodata
    value.
    """

    negative: npt.NDArray[np.int64]
    clipped: npt.NDArray[np.int64]


def retype(raw: npt.NDArray[Any], dtype: np.dtype[Any]) -> tuple[npt.NDArray[Any], Mask | None]:
    """File values in another type, and the mask of clipped values (None if there can be none).

    Values are rounded to the nearest integer and saturate; NaN becomes 0.
    """
    with np.errstate(over="ignore"):
        if dtype.kind not in "iu" or np.can_cast(raw.dtype, dtype):
            return raw.astype(dtype), None
    low, high = _range(dtype)
    numbers = np.rint(raw) if raw.dtype.kind == "f" else raw
    clipped = ((numbers < low) | (numbers > high)) & np.isfinite(numbers)
    return np.clip(np.nan_to_num(numbers, nan=0), low, high).astype(dtype), clipped


def encode(
    physical: FloatArray,
    raw: npt.NDArray[Any],
    *,
    bands: Sequence[int],
    scales: Sequence[float],
    offsets: Sequence[float],
    where: npt.NDArray[np.bool_] | None = None,
    nodata: float | None = None,
    flags: npt.NDArray[np.uint8] | None = None,
    marks: tuple[int, int] = (0, 0),
) -> Counts:
    """Store corrected values of some bands (0-based) in `raw`, (band, row, column), in its type and in place.

    physical = raw * scale + offset, per band. `raw` is not changed where values are not finite, or outside `where`
    (row, column). Values equal to `nodata` are moved off it. `flags` (row, column) get `marks[0]` where a value is
    negative, and `marks[1]` where one is clipped.

    Notes
    -----
    Integers are rounded to nearest (ties to even) and saturate at the ends of their type.
    """
    counts = Counts(np.zeros(len(raw), np.int64), np.zeros(len(raw), np.int64))
    for b, rows in slabs(raw.shape):
        if b not in bands:
            continue
        values = physical[b, rows]
        put = values.astype(np.float64)
        if offsets[b] != 0:
            put -= offsets[b]
        if scales[b] != 1:
            put /= scales[b]
        good, below = np.isfinite(put), values < 0
        if where is not None:
            good &= where[rows]
            below &= where[rows]
        outside = _put(put, raw[b, rows], good, nodata)
        for count, found, mark in zip((counts.negative, counts.clipped), (below, outside), marks, strict=True):
            many = np.count_nonzero(found)
            count[b] += many
            if flags is not None and many:
                flags[rows][found] |= mark
    return counts


def _put(put: npt.NDArray[np.float64], raw: npt.NDArray[Any], good: Mask, nodata: float | None) -> Mask:
    """Store values in the type of a band, avoiding its nodata; return the mask of clipped values."""
    whole = raw.dtype.kind in "iu"
    outside = np.zeros(raw.shape, np.bool_)
    if whole:
        np.rint(put, out=put)
        low, high = _range(raw.dtype)
        if not (put.min(initial=0.0) >= low and put.max(initial=0.0) <= high):  # or some are NaN
            outside = good & ((put < low) | (put > high))
            put = np.clip(np.where(good, put, 0.0), low, high)
    with np.errstate(over="ignore"):
        stored = put.astype(raw.dtype)
    if nodata is not None and np.isfinite(nodata):
        number = raw.dtype.type(nodata)
        hit = good & (stored == number)
        if whole:
            outside |= hit
            stored[hit] = int(nodata) + (1 if number < np.iinfo(raw.dtype).max else -1)
        else:
            stored[hit] = np.nextafter(number, raw.dtype.type(np.inf))
    np.copyto(raw, stored, where=good)
    return outside


def _range(dtype: np.dtype[Any]) -> tuple[float, float]:
    """Smallest and largest float64 that an integer type can hold."""
    info = np.iinfo(dtype)
    high = float(info.max)
    return float(info.min), high if int(high) <= info.max else float(np.nextafter(high, 0))


def relaid(
    raw: npt.NDArray[Any], valid: Any, own: Sequence[float | None], dtype: str, nodata: float | None
) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_] | None]:
    """File values in another type and with another nodata value, and the mask of clipped values.

    `own` is the present nodata value of each band; further entries are ignored. `raw` is overwritten if the type is the
    same.
    """
    lost, own = None, own[: len(raw)]
    hidden = None if nodata is None or all(n is None or same_nodata(n, nodata) for n in own) else is_valid(raw, own)
    if raw.dtype != np.dtype(dtype):
        raw, lost = retype(raw, np.dtype(dtype))
        if lost is not None and valid is not None:
            lost &= valid
    if hidden is not None:
        np.copyto(raw, np.dtype(dtype).type(nodata), where=~hidden)
    return raw, lost
