"""Conversion of file values to physical values: pure functions on arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray, Window

Raw = npt.NDArray[Any]
Valid = npt.NDArray[np.bool_]
FORGOTTEN = (3.4028e38, 3.40283e38)
"""The largest values of float32, which many programs write as nodata without declaring it; also in float64 files,
besides the largest value of float64."""


_CONVERTED_AT_ONCE = 1 << 16
"""Values of a band processed at a time; whole tiles do not fit into the processor's cache, which makes a correction a
tenth slower."""


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
    """value = raw * scale + offset; NaN where not valid, not finite, or at the limit of float32 or float64.

    Arrays are (band, row, column); `valid` is None if everything is valid. `nodatas` are the nodata values of the
    bands, if not yet considered in `valid`. The result has `physical_dtype`.
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
    """Band and rows of parts of a (band, row, column) array that fit into the processor's cache."""
    bands, rows, columns = shape
    step = max(1, _CONVERTED_AT_ONCE // max(1, columns))
    for band in range(bands):
        for start in range(0, rows, step):
            yield band, slice(start, start + step)


def is_valid(raw: Raw, nodatas: Sequence[float | None]) -> Valid | None:
    """Mask of values other than nodata, (band, row, column); None if there is no nodata.

    A nodata value of NaN, or one that the type cannot hold, is ignored here.
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
    """Mask of infinities, and of the largest values of the type or of float32."""
    size = np.abs(values)
    low, high = FORGOTTEN
    if values.dtype.itemsize <= 4:
        return np.asarray(size >= low)
    return np.asarray(((size >= low) & (size <= high)) | (size >= np.finfo(np.float64).max))


def holds(dtype: npt.DTypeLike, number: float) -> bool:
    """Whether an integer type can hold a number; always True for floating-point types."""
    if np.dtype(dtype).kind not in "iu":
        return True
    limits = np.iinfo(dtype)
    return bool(limits.min <= number <= limits.max) and float(number).is_integer()


def _as_stored(nodata: float | None, dtype: np.dtype[Any]) -> Any:
    """A nodata value in the type of a file; None if the type cannot hold it."""
    if nodata is None or nodata != nodata or not holds(dtype, nodata):
        return None
    with np.errstate(all="ignore"):
        return dtype.type(int(nodata) if dtype.kind in "iu" else nodata)


@dataclass(frozen=True)
class FlatField:
    """Vignetting and row gradient of a capture by a frame camera.

    Values are corrected when read, black + (value - black) * factor, with a factor for each pixel. They become floating
    point; scale and offset of the file still apply.
    """

    black: float = 0.0  # number in the file without any light
    centre: tuple[float, float] = (0.0, 0.0)  # column and row of the middle of the vignette [pixel]
    polynomial: tuple[float, ...] = ()  # p1, p2 ... of 1 + p1 r + p2 r^2 + ..., r: distance from the centre [pixel]
    corrects: bool = False  # the polynomial is the correction itself, not the fall-off that is to be corrected
    row_gradient: float = 0.0  # rows are brighter by 1 + row_gradient * row

    def factor(self, window: Window) -> npt.NDArray[np.float32]:
        """Factor of each pixel of a window, (row, column)."""
        (top, bottom), (left, right) = window
        rows = np.arange(top, bottom, dtype=np.float64)[:, np.newaxis]
        columns = np.arange(left, right, dtype=np.float64)
        r = np.hypot(columns - self.centre[0], rows - self.centre[1])
        vignette = np.polyval([*self.polynomial[::-1], 1.0], r)
        found = (vignette if self.corrects else 1.0 / vignette) / (1.0 + self.row_gradient * rows)
        return found.astype(np.float32)

    def apply(self, raw: npt.NDArray[Any], window: Window, nodata: float | None) -> None:
        """Correct the values of a window in place, except nodata."""
        light = raw - np.float32(self.black)
        corrected = light * self.factor(window) + np.float32(self.black)
        np.copyto(raw, corrected, where=True if nodata is None else raw != nodata)
