"""From the numbers in a file to physical values: pure functions on arrays, a cache-sized slab at a time.

Nothing here opens a file. An input array is changed only where the caller says that it may be.
"""

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
_CLEAR = 1e30  # no number below is infinite, or what stands for no data
_SLAB = 1 << 17  # values worked on at a time, so that they stay in the processor's cache


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
    in_place: bool = False,
    clear: bool = False,
) -> FloatArray:
    """value = raw * scale + offset, NaN where not valid, not finite, or at the end of what float32 or float64 holds.

    Parameters
    ----------
    raw : (band, row, column) ndarray
        Numbers as the file has them.
    valid : (band, row, column) ndarray of bool, or None
        None where everything is valid.
    scales, offsets : sequence of float
        One a band.
    nodatas : sequence of float or None, optional
        Numbers that say "not valid", one a band, where `valid` does not tell of them already.
    in_place : bool, optional
        `raw` may be changed and returned where its type is right already.
    clear : bool, optional
        `all_clear` has said so of raw.

    Returns
    -------
    (band, row, column) ndarray
        float32 or float64, see `physical_dtype`; `raw` itself where there is nothing to do.
    """
    dtype = physical_dtype(raw.dtype)
    keep = raw.dtype == dtype and all(s == 1 for s in scales) and all(o == 0 for o in offsets)
    sentinels = [_as_stored(n, raw.dtype) for n in nodatas or [None] * len(raw)]
    if keep and not in_place and valid is None and sentinels == [None] * len(raw) and (clear or not has_infinite(raw)):
        return raw
    out = np.empty(raw.shape, dtype)
    if keep:
        out = raw if in_place else raw.copy()
    floating = not np.issubdtype(raw.dtype, np.integer)
    with np.errstate(all="ignore"):
        for band, rows in _slabs(raw):
            source, block = raw[band, rows], out[band, rows]
            bad = None if sentinels[band] is None else source == sentinels[band]
            if floating and may_be_endless(source):
                endless = _is_endless(source)
                bad = endless if bad is None else bad | endless
            if not keep:
                _scale(source, dtype.type(scales[band]), dtype.type(offsets[band]), block)
            if bad is not None:
                np.copyto(block, np.nan, where=bad)
            if valid is not None:
                np.copyto(block, np.nan, where=~valid[band, rows])
            if floating and not keep and not np.isfinite(np.add.reduce(block, axis=None)):  # that a scale made
                np.copyto(block, np.nan, where=np.isinf(block))
    return out


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


def ends(array: Raw) -> npt.NDArray[np.float64]:
    """The least and the largest number of each band, (band, 2), 0 counted in; NaN where some number is none.

    Examples
    --------
    >>> ends(np.array([[[1.0, 2.0]], [[-1.0, np.nan]]])).tolist()
    [[0.0, 2.0], [nan, nan]]
    """
    found = np.zeros((len(array), 2))
    for band, rows in _slabs(array):
        values, (least, most) = array[band, rows], found[band]
        found[band] = np.minimum(values.min(initial=0), least), np.maximum(values.max(initial=0), most)
    return found


def all_clear(found: npt.NDArray[np.float64]) -> bool:
    """Whether `ends` tell that all numbers of a floating-point array are finite, and none what `FORGOTTEN` says."""
    return bool((np.abs(found) < _CLEAR).all())


def has_infinite(array: Raw) -> bool:
    """Whether there is an infinity in a floating-point array, or what `FORGOTTEN` says (NaN is none)."""
    with np.errstate(all="ignore"):
        return any(may_be_endless(array[at]) and bool(_is_endless(array[at]).any()) for at in _slabs(array))


def may_be_endless(values: Raw) -> bool:
    """A quick look; NaN and large numbers ask for a second one."""
    return not (values.max(initial=0) < _CLEAR and values.min(initial=0) > -_CLEAR)


def _is_endless(values: Raw) -> Valid:
    """Infinities, and the largest numbers of their type or of float32."""
    size = np.abs(values)
    low, high = FORGOTTEN
    if values.dtype.itemsize <= 4:
        return np.asarray(size >= low)
    return np.asarray(((size >= low) & (size <= high)) | (size >= np.finfo(np.float64).max))


def _as_stored(nodata: float | None, dtype: np.dtype[Any]) -> Any:
    if nodata is None or nodata != nodata:
        return None
    if np.issubdtype(dtype, np.integer):
        limits = np.iinfo(dtype)
        return int(nodata) if limits.min <= nodata <= limits.max and float(nodata).is_integer() else None
    with np.errstate(all="ignore"):
        return dtype.type(nodata)


def _scale(raw: Raw, scale: Any, offset: Any, out: Raw) -> None:
    if scale == 1:
        np.copyto(out, raw, casting="same_kind")
    else:
        np.multiply(raw, scale, out=out, dtype=out.dtype)
    if offset:
        out += offset


def _slabs(array: Raw) -> Iterator[tuple[int, slice]]:
    bands, rows, columns = array.shape
    step = max(1, _SLAB // max(1, columns))
    for band in range(bands):
        for start in range(0, rows, step):
            yield band, slice(start, start + step)
