"""Conversion of physical values to file values: scale, offset, rounding, saturation; lost values are counted.

Pixels that were not corrected keep their bits: they are not converted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray
from .convert import is_valid, slabs
from .info import same_nodata

Mask = npt.NDArray[np.bool_]


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
    where: Mask | None = None,
    nodata: float | None = None,
) -> tuple[Mask, Mask]:
    """Put corrected values of some bands (0-based) into `raw`, (band, row, column), in its type and in place.

    physical = raw * scale + offset, a band. Values that are not finite, and pixels outside `where` (row, column), leave
    `raw` as it is. No value is left on `nodata`.

    Returns
    -------
    (len(bands), row, column) ndarrays of bool
        Where a value is negative, and where it was clipped to what the type can hold or moved off `nodata`.

    Notes
    -----
    Integers are rounded to nearest (ties to even) and saturate at the ends of their type.
    """
    negative, clipped = np.zeros((2, len(bands), *raw.shape[1:]), np.bool_)
    for i, rows in slabs(negative.shape):
        b = bands[i]
        values = physical[b, rows]
        put = values.astype(np.float64)
        if offsets[b] != 0:
            put -= offsets[b]
        if scales[b] != 1:
            put /= scales[b]
        inside = True if where is None else where[rows]
        negative[i, rows] = (values < 0) & inside
        clipped[i, rows] = _put(put, raw[b, rows], np.isfinite(put) & inside, nodata)
    return negative, clipped


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
) -> tuple[npt.NDArray[Any], Mask | None]:
    """Numbers of a file in the type, and with the nodata, of another, and where a valid number was clipped.

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
