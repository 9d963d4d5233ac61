"""Conversion of file values to physical values and back: pure functions on arrays.

On the way back, values are rounded and clipped to the range of the file's type; masks show which were clipped. Pixels
that were not corrected are not converted: they keep their bits.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray, Window

Raw = npt.NDArray[Any]
Valid = npt.NDArray[np.bool_]
FORGOTTEN = (3.4028e38, 3.40283e38)
"""In floating-point files, numbers with absolute values between these two are not valid: many programs write the
largest float32 as nodata without declaring it. In float64 files the largest float64 is not valid either."""
_CONVERTED_AT_ONCE = 1 << 16
"""Values of a band that are processed at a time. Whole tiles do not fit into the processor's cache: with them, a
correction takes a tenth longer."""


def physical_dtype(dtype: npt.DTypeLike) -> np.dtype[Any]:
    """Type of physical values, given the file type: float32 for float32 and types of up to 16 bits, else float64."""
    single = np.dtype(np.float32)
    return single if np.result_type(np.dtype(dtype), single) == single else np.dtype(np.float64)


def to_physical(raw: Raw, valid: Valid | None, scales: Sequence[float], offsets: Sequence[float]) -> FloatArray:
    """Physical values, raw * scale + offset; NaN where not valid, not finite, or the largest float32 or float64.

    Arrays are (band, row, column); `valid` is None if all values are valid. `scales` and `offsets` have one entry per
    band. The type of the result is `physical_dtype`.
    """
    out = np.empty(raw.shape, physical_dtype(raw.dtype))
    for band, rows in slabs(raw.shape):
        numbers, values = raw[band, rows], out[band, rows]
        values[...] = numbers
        with np.errstate(all="ignore"):
            if scales[band] != 1:
                values *= out.dtype.type(scales[band])
            if offsets[band] != 0:
                values += out.dtype.type(offsets[band])
        if raw.dtype.kind == "f":
            values[_is_endless(numbers) | np.isinf(values)] = np.nan
        if valid is not None:
            values[~valid[band, rows]] = np.nan
    return out


def slabs(shape: tuple[int, ...]) -> Iterator[tuple[int, slice]]:
    """Yield band and rows of the parts of a (band, row, column) array; each part fits into the processor's cache."""
    bands, rows, columns = shape
    step = max(1, _CONVERTED_AT_ONCE // max(1, columns))
    for band in range(bands):
        for start in range(0, rows, step):
            yield band, slice(start, start + step)


def is_valid(raw: Raw, nodatas: Sequence[float | None]) -> Valid | None:
    """Mask (band, row, column) of the values that are not nodata; None if no value is nodata.

    `nodatas` has one entry per band. Entries that are NaN, or that the type cannot hold, are ignored here.
    """
    valid = None
    for band, nodata in enumerate(nodatas):
        if nodata is None or nodata != nodata or not holds(raw.dtype, nodata):
            continue
        with np.errstate(over="ignore"):
            found = raw[band] != raw.dtype.type(nodata)
        if not found.all():
            valid = np.ones(raw.shape, np.bool_) if valid is None else valid
            valid[band] = found
    return valid


def _is_endless(values: Raw) -> Valid:
    """Mask of floating-point values that are infinite, or the largest float32 or float64 of either sign."""
    size = np.abs(values)
    low, high = FORGOTTEN
    if values.dtype.itemsize <= 4:
        return np.asarray(size >= low)
    return np.asarray(((size >= low) & (size <= high)) | (size >= np.finfo(np.float64).max))


def holds(dtype: npt.DTypeLike, number: float) -> bool:
    """Whether an integer type can hold a number without change; always True for floating-point types."""
    if np.dtype(dtype).kind not in "iu":
        return True
    limits = np.iinfo(dtype)
    return bool(limits.min <= number <= limits.max) and float(number).is_integer()


def same_nodata(a: float | None, b: float | None) -> bool:
    """Whether two nodata values are the same (NaN is NaN)."""
    return a == b or (a != a and b != b)


def retype(raw: npt.NDArray[Any], dtype: np.dtype[Any]) -> tuple[npt.NDArray[Any], Valid | None]:
    """Convert file values to another type; return them and the mask of clipped values (None if none can be clipped).

    For an integer type, values are rounded to the nearest integer and clipped to its range; NaN becomes 0.
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
    where: Valid | None = None,
    nodata: float | None = None,
) -> tuple[Valid, Valid]:
    """Write the `physical` values of some bands (0-based) into `raw`, in the type of `raw` and in place.

    raw = (physical - offset) / scale, both (band, row, column). Integers are rounded to nearest (ties to even) and
    clipped to the range of the type. A result that equals `nodata` is moved to the next number. `raw` does not change
    where `physical` is not finite, nor outside `where` (row, column).

    Returns two masks (len(bands), row, column): the negative physical values; and the values that were clipped, or
    moved because an integer equalled `nodata`.
    """
    negative, clipped = np.zeros((2, len(bands), *raw.shape[1:]), np.bool_)
    for i, rows in slabs(negative.shape):
        b = bands[i]
        values = physical[b, rows]
        put = values.astype(np.result_type(values, physical_dtype(raw.dtype)))
        if offsets[b] != 0:
            put -= offsets[b]
        if scales[b] != 1:
            put /= scales[b]
        inside = True if where is None else where[rows]
        negative[i, rows] = (values < 0) & inside
        clipped[i, rows] = _put(put, raw[b, rows], np.isfinite(put) & inside, nodata)
    return negative, clipped


def _put(put: FloatArray, raw: npt.NDArray[Any], good: Valid, nodata: float | None) -> Valid:
    """Write `put` into `raw` in the type of `raw`, where `good` is True; all are (row, column).

    Integers are rounded and clipped. A value that equals `nodata` is moved to the next number. Returns the mask of
    values that were clipped, and of integers that were moved. `put` may be changed.
    """
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
) -> tuple[npt.NDArray[Any], Valid | None]:
    """Convert file values to the type and nodata of an output; return them, and the mask of clipped valid values.

    Arrays are (band, row, column); the mask is None if none can be clipped. `own` has the nodata of each band in
    `raw`; further entries are ignored. If the types are the same, the result is `raw`, changed in place.
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


@dataclass(frozen=True)
class FlatField:
    """Vignetting and row gradient of a capture by a frame camera.

    File values are corrected while they are read: black + (value - black) * factor, with one factor per pixel. The
    result is floating point; the scale and offset of the file are applied to it.
    """

    black: float = 0.0  # file value of a pixel that gets no light
    centre: tuple[float, float] = (0.0, 0.0)  # column and row of the centre of the vignette [pixel]
    polynomial: tuple[float, ...] = ()  # p1, p2, ... of v = 1 + p1 r + p2 r^2 + ...; r: distance from `centre` [pixel]
    corrects: bool = False  # True: v is the factor; False: v is the fall-off of light, by which values are divided
    row_gradient: float = 0.0  # a row is too bright by the factor 1 + row_gradient * row

    def apply(self, raw: npt.NDArray[Any], window: Window, nodata: float | None) -> None:
        """Correct the file values `raw` (row, column) of a window in place, except values that equal `nodata`."""
        (top, bottom), (left, right) = window
        rows = np.arange(top, bottom, dtype=np.float64)[:, np.newaxis]
        columns = np.arange(left, right, dtype=np.float64)
        r = np.hypot(columns - self.centre[0], rows - self.centre[1])
        vignette = np.polyval([*self.polynomial[::-1], 1.0], r)
        factor = (vignette if self.corrects else 1.0 / vignette) / (1.0 + self.row_gradient * rows)
        light = raw - np.float32(self.black)
        corrected = light * factor.astype(np.float32) + np.float32(self.black)
        np.copyto(raw, corrected, where=True if nodata is None else raw != nodata)
