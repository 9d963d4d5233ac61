"""Convert the values in a file to physical values and back; all functions work on arrays in memory.

Physical value = file value * scale + offset. Values for an integer type are rounded, and clipped to its range; masks
show which ones were clipped. Pixels that were not corrected are not converted, so that no bit of them changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..moments import Mask
from ..scene import FloatArray, Window

Raw = npt.NDArray[Any]
Nodatas = Sequence[float | None]  # of each band
FORGOTTEN = (3.4028e38, 3.40283e38)
"""In floating-point files, numbers with absolute values between these two are not valid: many programs write the
largest float32 as nodata without declaring it. In float64 files the largest float64 is not valid either."""


def physical_dtype(dtype: npt.DTypeLike) -> np.dtype[Any]:
    """Type of physical values for a file type: float32 if `dtype` is float32 or has up to 16 bits, else float64."""
    single = np.dtype(np.float32)
    return single if np.result_type(np.dtype(dtype), single) == single else np.dtype(np.float64)


def to_physical(raw: Raw, valid: Mask | None, scales: Sequence[float], offsets: Sequence[float]) -> FloatArray:
    """Convert file values to physical values: raw * scale + offset, or NaN where a value is not valid or not finite.

    Arrays are (band, row, column); `valid` is None if all values are valid. `scales` and `offsets` have one entry per
    band. In float files, the largest float32 or float64 counts as nodata. The result has the type `physical_dtype`.
    """
    out = np.empty(raw.shape, physical_dtype(raw.dtype))
    for band, (numbers, values) in enumerate(zip(raw, out, strict=True)):
        values[...] = numbers
        with np.errstate(all="ignore"):
            if scales[band] != 1:
                values *= out.dtype.type(scales[band])
            if offsets[band] != 0:
                values += out.dtype.type(offsets[band])
        if raw.dtype.kind == "f":
            values[~is_finite(numbers) | np.isinf(values)] = np.nan
        if valid is not None:
            values[~valid[band]] = np.nan
    return out


def is_valid(raw: Raw, nodatas: Nodatas) -> Mask | None:
    """Mask (band, row, column), True where a file value in `raw` is not nodata; None if no value is nodata.

    `nodatas` has one entry per band. Entries that are NaN, or that the type of `raw` cannot hold, are ignored here.
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


def is_finite(values: Raw) -> Mask:
    """Mask, True where a floating-point value is finite and not, in magnitude, the largest float32 or float64."""
    size = np.abs(values)
    low, high = FORGOTTEN
    if values.dtype.itemsize <= 4:
        return np.asarray(size < np.float32(low))  # as float32: float16 cannot hold the limit
    return np.asarray(((size < low) | (size > high)) & (size < np.finfo(np.float64).max))


def holds(dtype: npt.DTypeLike, number: float) -> bool:
    """Whether an integer type can hold a number exactly; always True for floating-point types."""
    if np.dtype(dtype).kind not in "iu":
        return True
    limits = np.iinfo(dtype)
    return bool(limits.min <= number <= limits.max) and float(number).is_integer()


def same_nodata(a: float | None, b: float | None) -> bool:
    """Whether two nodata values are the same; NaN counts as equal to NaN."""
    return a == b or (a != a and b != b)


def retype(raw: Raw, dtype: np.dtype[Any]) -> tuple[Raw, Mask | None]:
    """Convert file values to another type. Return the new values, and a mask of clipped finite values (None: all fit).

    Values for an integer type are rounded to the nearest integer and clipped to its range; NaN and infinity become 0.
    """
    with np.errstate(over="ignore"):
        if dtype.kind not in "iu" or np.can_cast(raw.dtype, dtype):
            return raw.astype(dtype), None
    limits = np.iinfo(dtype)
    low, high = float(limits.min), float(limits.max)
    if int(high) > limits.max:
        high = float(np.nextafter(high, 0))  # the largest float64 that the type can hold
    wide = np.result_type(raw.dtype, physical_dtype(dtype))  # float32 would round the limits of long integers up
    numbers = np.rint(raw, dtype=wide) if raw.dtype.kind == "f" else raw
    if numbers.min(initial=0) >= low and numbers.max(initial=0) <= high:
        return numbers.astype(dtype), None
    clipped = ((numbers < low) | (numbers > high)) & np.isfinite(numbers)
    return np.clip(np.nan_to_num(numbers, nan=0, posinf=0, neginf=0), low, high).astype(dtype), clipped


def encode(
    values: FloatArray, raw: Raw, *, scale: float, offset: float, where: Mask, nodata: float | None = None
) -> tuple[Mask, Mask]:
    """Convert the physical values of a band to file values, and write these into `raw`, in place.

    raw = (values - offset) / scale; arrays are (row, column). Integers are rounded to nearest (ties to even) and
    clipped to the range of the type. A result that equals `nodata` is moved to an adjacent number. `raw` does not
    change where `values` is not finite or `where` is False.

    Returns two masks. The first is True where a physical value is negative; the second where a value was clipped, or
    an integer was moved.
    """
    wide = np.float64 if offset != 0 and raw.dtype.kind in "iu" else physical_dtype(raw.dtype)
    numbers = values.astype(np.result_type(values, wide))  # in float32 an offset of 1000 rounds ties of integers
    if offset != 0:
        numbers -= offset
    if scale != 1:
        numbers /= scale
    good = np.isfinite(numbers) & where
    stored, clipped = retype(numbers, raw.dtype)
    outside = _moved(stored, good, nodata)
    if clipped is not None:
        outside |= clipped & good
    np.copyto(raw, stored, where=good)
    return (values < 0) & where, outside


def _moved(stored: Raw, good: Mask, nodata: float | None) -> Mask:
    """Move `good` values that equal `nodata` to an adjacent number, in place; return the mask of moved integers."""
    if nodata is None or not np.isfinite(nodata) or not holds(stored.dtype, nodata):
        return np.zeros(stored.shape, np.bool_)
    number = stored.dtype.type(nodata)
    hit = good & (stored == number)
    if stored.dtype.kind in "iu":
        stored[hit] = int(nodata) + (1 if number < np.iinfo(stored.dtype).max else -1)
        return hit
    stored[hit] = np.nextafter(number, stored.dtype.type(np.inf))
    return np.zeros(stored.shape, np.bool_)


def relaid(raw: Raw, valid: Mask | None, own: Nodatas, dtype: str, nodata: float | None) -> tuple[Raw, Mask]:
    """Convert file values to the type `dtype` and the `nodata` of an output.

    Arrays are (band, row, column). `valid` is the mask of valid values, None if all are valid. `own` has the nodata
    value of each band of `raw`; these values become `nodata`, unless it is None. In integer types, NaN and infinity
    become `nodata`, or 0 if it is None. A valid value that equals `nodata` is moved to an adjacent number; in a band
    without nodata, this is done only in pixels that are valid in all bands. Returns the new values (`raw` itself if
    nothing changes), and the mask of valid values that were clipped, or moved in an integer type.
    """
    to = np.dtype(dtype)
    if raw.dtype == to and (nodata is None or all(same_nodata(n, nodata) for n in own)):
        return raw, np.zeros(raw.shape, np.bool_)
    hidden, good = is_valid(raw, own), np.ones(raw.shape, np.bool_) if valid is None else valid
    # in a band without nodata, the new nodata value means not valid where another band is not valid
    stays = good.all(axis=0) | np.array([n is not None for n in own])[:, None, None]
    if raw.dtype.kind == "f" and to.kind in "iu":  # which have no NaN
        finite = is_finite(raw)
        hidden, good = finite if hidden is None else hidden & finite, good & finite
    raw, lost = retype(raw, to)
    lost = np.zeros(raw.shape, np.bool_) if lost is None else lost & good
    lost |= _moved(raw, good & stays, nodata)
    if hidden is not None and nodata is not None:
        np.copyto(raw, to.type(nodata), where=~hidden)
    return raw, lost


@dataclass(frozen=True)
class FlatField:
    """Correction of the vignetting and the row gradient of an image from a frame camera.

    File values are corrected while they are read: black + (value - black) * factor, where each pixel has its own
    factor. The results are floating-point numbers; the scale and offset of the file are then applied to them.
    """

    black: float = 0.0  # file value of a pixel that gets no light
    centre: tuple[float, float] = (0.0, 0.0)  # column and row of the centre of the vignette [pixel]
    polynomial: tuple[float, ...] = ()  # p1, p2, ... of v = 1 + p1 r + p2 r^2 + ...; r: distance from `centre` [pixel]
    corrects: bool = False  # True: v is the factor; False: v is the fall-off of light, by which values are divided
    row_gradient: float = 0.0  # a row is too bright by the factor 1 + row_gradient * row

    def apply(self, raw: Raw, window: Window, nodata: float | None) -> None:
        """Correct file values `raw`, float (row, column), of a window in place, except values that equal `nodata`."""
        (top, bottom), (left, right) = window
        rows = np.arange(top, bottom, dtype=np.float64)[:, np.newaxis]
        columns = np.arange(left, right, dtype=np.float64)
        r = np.hypot(columns - self.centre[0], rows - self.centre[1])
        vignette = np.polyval([*self.polynomial[::-1], 1.0], r)
        factor = (vignette if self.corrects else 1.0 / vignette) / (1.0 + self.row_gradient * rows)
        corrected = (raw - np.float32(self.black)) * factor.astype(np.float32) + np.float32(self.black)
        np.copyto(raw, corrected, where=True if nodata is None else raw != nodata)
