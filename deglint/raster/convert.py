"""From the numbers in a file to physical values: pure functions on arrays. Nothing here opens a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray

Raw = npt.NDArray[Any]
Valid = npt.NDArray[np.bool_]
FORGOTTEN = (3.4028e38, 3.40283e38)
"""The largest numbers of float32, which many programs write where there is no data, and do not always say so. In
float64, and there its own largest number, too."""


_CONVERTED_AT_ONCE = 1 << 16
"""Values of a band worked on at a time: a correction takes a tenth longer where whole tiles pass through memory."""


def physical_dtype(dtype: npt.DTypeLike) -> np.dtype[Any]:
    """float32 for int8..uint16, float16 and float32; float64 for anything wider."""
    single = np.dtype(np.float32)
    return single if np.result_type(np.dtype(dtype), single) == single else np.dtype(np.float64)


def to_physical(
    raw: Raw,
    valid: Valid | None,
    scales: Sequence[float],
    offsets: Sequence[float],
    *,
    nodatas: Sequence[float | None] | None = None,
) -> FloatArray:
    """value = raw * scale + offset, NaN where not valid, not finite, or at the end of what float32 or float64 holds.

    Arrays are (band, row, column); `valid` is None where everything is valid. `nodatas` are numbers that say "not
    valid", one a band, where `valid` does not tell of them already. The result has `physical_dtype`.
    """
    out = np.empty(raw.shape, physical_dtype(raw.dtype))
    for band, rows in slabs(raw.shape):
        numbers, values = raw[band, rows], out[band, rows]
        nodata = None if nodatas is None else _as_stored(nodatas[band], raw.dtype)
        values[...] = numbers
        with np.errstate(all="ignore"):
            if scales[band] != 1:
                values *= out.dtype.type(scales[band])
            if offsets[band] != 0:
                values += out.dtype.type(offsets[band])
        if nodata is not None:
            values[numbers == nodata] = np.nan
        if raw.dtype.kind == "f":
            values[_is_endless(numbers) | np.isinf(values)] = np.nan
        if valid is not None:
            values[~valid[band, rows]] = np.nan
    return out


def slabs(shape: tuple[int, ...]) -> Iterator[tuple[int, slice]]:
    """Band and rows of parts of a (band, row, column) array that stay in the processor's cache."""
    bands, rows, columns = shape
    step = max(1, _CONVERTED_AT_ONCE // max(1, columns))
    for band in range(bands):
        for start in range(0, rows, step):
            yield band, slice(start, start + step)


def is_valid(raw: Raw, nodatas: Sequence[float | None]) -> Valid | None:
    """Where raw differs from nodata, (band, row, column); None where it does everywhere.

    A NaN as nodata, or one that the type cannot hold, matches nothing here.
    """
    valid = None
    for band, nodata in enumerate(nodatas):
        value = _as_stored(nodata, raw.dtype)
        if value is None:
            continue
        found = raw[band] != value
        if not found.all():
            valid = np.ones(raw.shape, np.bool_) if valid is None else valid
            valid[band] = found
    return valid


def _is_endless(values: Raw) -> Valid:
    """Infinities, and the largest numbers of their type or of float32."""
    size = np.abs(values)
    low, high = FORGOTTEN
    if values.dtype.itemsize <= 4:
        return np.asarray(size >= low)
    return np.asarray(((size >= low) & (size <= high)) | (size >= np.finfo(np.float64).max))


def holds(dtype: npt.DTypeLike, number: float) -> bool:
    """Whether an integer type has a number; of a floating type it is taken for granted."""
    if np.dtype(dtype).kind not in "iu":
        return True
    limits = np.iinfo(dtype)
    return bool(limits.min <= number <= limits.max) and float(number).is_integer()


def _as_stored(nodata: float | None, dtype: np.dtype[Any]) -> Any:
    """A nodata as it stands in a file of that type; None where it can match nothing there."""
    if nodata is None or nodata != nodata or not holds(dtype, nodata):
        return None
    with np.errstate(all="ignore"):
        return dtype.type(int(nodata) if dtype.kind in "iu" else nodata)
