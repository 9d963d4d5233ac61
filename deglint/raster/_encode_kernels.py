"""The compiled twin of the inner loop of `deglint.raster.encode`, for whole numbers of up to 16 bits: the tests run
over both."""

import numpy as np

from .. import jit as nb


@nb.njit(cache=True, nogil=True, error_model="numpy")
def put(values, where, scale, offset, low, high, nodata, beside, raw):  # type: ignore[no-untyped-def]
    """Put a band of physical values into whole numbers of a file; returns how many were negative, how many clipped.

    where : (row, column) bool, of no size for everywhere; low, high : what the file's type holds; nodata, beside : a
    number that is not to be left, NaN for none, and the one to put for it
    """
    negative, clipped, every = 0, 0, np.ones(raw.shape[1], np.bool_)
    for i in range(raw.shape[0]):
        may = where[i] if where.size else every
        a, b = put_row(values[i], may, scale, offset, low, high, nodata, beside, raw[i])
        negative, clipped = negative + a, clipped + b
    return negative, clipped


@nb.njit(cache=True, nogil=True, error_model="numpy")
def put_row(values, may, scale, offset, low, high, nodata, beside, raw):  # type: ignore[no-untyped-def]
    """A row of it; without an `if`, so that many are put at once."""
    negative = clipped = nb.int32(0)
    for j in range(raw.size):
        value = np.float64(values[j])
        number = np.rint((value - offset) / scale)
        good = may[j] & (abs(number) < np.inf)
        inside = min(max(number, low), high)
        left = beside if inside == nodata else inside
        raw[j] = nb.int32(left) if good else nb.int32(raw[j])
        negative += nb.int32(may[j] & (value < 0))
        clipped += nb.int32(good & (left != number))
    return negative, clipped
