"""From physical values back to what stands in a file: scale, offset, rounding, saturation - and what was lost.

Pixels that were not corrected keep their bits: they are never converted there and back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray
from .convert import is_valid, may_be_endless
from .info import same_nodata

Mask = npt.NDArray[np.bool_]
_SLAB = 1 << 16
"""Pixels worked on at a time, so that they stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Counts:
    """Pixels per band.

    Attributes
    ----------
    negative : (bands,) int64 ndarray
        Corrected, and below zero after.
    clipped : (bands,) int64 ndarray
        Corrected, and outside what the output's integer type can hold, so set to its end; or on the number that
        says "not valid", so set to the one beside it.
    """

    negative: npt.NDArray[np.int64]
    clipped: npt.NDArray[np.int64]


def retype(raw: npt.NDArray[Any], dtype: np.dtype[Any]) -> tuple[npt.NDArray[Any], Mask | None]:
    """Numbers of a file in another type; integers are rounded to nearest, and saturate.

    Parameters
    ----------
    raw : (band, row, column) ndarray
        Not modified.
    dtype : dtype

    Returns
    -------
    out : (band, row, column) ndarray
        0 where raw is NaN and `dtype` an integer.
    clipped : (band, row, column) bool ndarray or None
        Where a number is outside what the type can hold; None where none can be.
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
    nodata : float, optional
        Number that says "not valid" in the file: no corrected value is left on it.
    flags : (row, column) uint8 ndarray, optional
        Gets `marks[0]` where a value is negative and `marks[1]` where one is clipped.

    Returns
    -------
    Counts

    Notes
    -----
    Integers are rounded to nearest (ties to even) and saturate at the ends of their type.
    """
    counts = Counts(np.zeros(len(raw), np.int64), np.zeros(len(raw), np.int64))
    in_place = np.shares_memory(raw, physical)
    rows = max(1, _SLAB // max(raw.shape[2], 1))
    for top in range(0, raw.shape[1], rows):
        part = slice(top, top + rows)
        asked = None if where is None else where[part]
        for b in bands:
            values, outside = physical[b, part], None
            if not in_place:
                outside = _put(values, raw[b, part], asked, scales[b], offsets[b])
            outside = _off_nodata(raw[b, part], values, asked, nodata, outside)
            lowest = values.min(initial=0)
            if not lowest >= 0:  # or some is no number
                below = values < 0 if asked is None else (values < 0) & asked
                counts.negative[b] += np.count_nonzero(below)
                if flags is not None:
                    flags[part][below] |= marks[0]
            if outside is not None:
                counts.clipped[b] += np.count_nonzero(outside)
                if flags is not None:
                    flags[part][outside] |= marks[1]
    return counts


def _beside(nodata: float, dtype: np.dtype[Any]) -> float:
    """The integer next to the one that says "not valid"."""
    return nodata + (1 if nodata < np.iinfo(dtype).max else -1)


def _put(values: FloatArray, raw: npt.NDArray[Any], where: Mask | None, scale: float, offset: float) -> Mask | None:
    """Store some rows of a band; return where they were clipped."""
    put = values
    if offset != 0 or scale != 1 or raw.dtype != values.dtype:
        put = values.astype(np.float64)
        _unscale(put, scale, offset)
    if raw.dtype.kind not in "iu":
        good = where
        if may_be_endless(put):
            good = np.isfinite(put) if where is None else np.isfinite(put) & where
        _store(raw, put, good)
        return None
    np.rint(put, out=put)
    low, high = _range(raw.dtype)
    ends = np.array([values.min(initial=np.inf), values.max(initial=-np.inf)], np.float64)
    _unscale(ends, scale, offset)  # as all numbers between them
    if low <= np.rint(ends.min()) and np.rint(ends.max()) <= high:
        _store(raw, put, where)
        return None
    good = np.isfinite(put)
    if where is not None:
        good &= where
    outside = (put < low) | (put > high)
    outside &= good
    put[~good] = 0
    np.clip(put, low, high, out=put)
    _store(raw, put, good)
    return outside


def _unscale(values: FloatArray, scale: float, offset: float) -> None:
    """Physical values as numbers of the file, in place."""
    if offset != 0:
        values -= offset
    if scale != 1:
        values /= scale


def _store(raw: npt.NDArray[Any], put: npt.NDArray[Any], where: Mask | None) -> None:
    """Numbers in the type of `raw`, where they are wanted: their bits, as speckle is slow to branch by."""
    if where is None:
        raw[...] = put
        return
    whole = np.dtype(f"i{raw.dtype.itemsize}")
    old = raw.view(whole)
    new = put.astype(raw.dtype, copy=False).view(whole) ^ old
    new &= -where.astype(whole)
    old ^= new


def _off_nodata(
    raw: npt.NDArray[Any], values: FloatArray, where: Mask | None, nodata: float | None, clipped: Mask | None
) -> Mask | None:
    """Move corrected numbers off the one that says "not valid", to the next; return what was clipped, and these."""
    if nodata is None or not np.isfinite(nodata):
        return clipped
    hit = raw == raw.dtype.type(nodata)
    if not hit.any():
        return clipped
    hit &= np.isfinite(values)
    if where is not None:
        hit &= where
    if raw.dtype.kind == "f":
        raw[hit] = np.nextafter(raw.dtype.type(nodata), raw.dtype.type(np.inf))
        return clipped
    raw[hit] = _beside(int(nodata), raw.dtype)
    return hit if clipped is None else clipped | hit


def _range(dtype: np.dtype[Any]) -> tuple[float, float]:
    """Smallest and largest float64 that an integer type can hold."""
    info = np.iinfo(dtype)
    high = float(info.max)
    return float(info.min), high if int(high) <= info.max else float(np.nextafter(high, 0))


def relaid(
    raw: npt.NDArray[Any], valid: Any, own: Sequence[float | None], dtype: str, nodata: float | None
) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_] | None]:
    """Numbers of a file in the type, and with the nodata, of another.

    Parameters
    ----------
    raw : (band, row, column) ndarray
        Overwritten where the type is the same.
    valid : bool ndarray or None
        Which of them are valid; None for all.
    own : sequence of float or None
        Nodata of each band as it is; there may be more.
    dtype, nodata
        Of the other file.

    Returns
    -------
    (band, row, column) ndarray
    bool ndarray or None
        Where a valid number was clipped; None where none can be.
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
