"""The compiled twin of `detect.rx.score`, for large arrays of few bands; the tests run over both."""

import numpy as np
from numba import njit

WIDTH = 256  # pixels scored side by side: they stay in the first-level cache


@njit(nogil=True, cache=True, fastmath={"contract"})
def _row_times(row, x, bands, z):  # type: ignore[no-untyped-def]
    """z += row . x, four bands at a time; what lies beyond `bands` is zero."""
    for b in range(0, bands, 4):
        a0, a1, a2, a3 = row[b], row[b + 1], row[b + 2], row[b + 3]
        for c in range(WIDTH):
            z[c] += a0 * x[b, c] + a1 * x[b + 1, c] + a2 * x[b + 2, c] + a3 * x[b + 3, c]


@njit(nogil=True, cache=True, fastmath={"contract"})
def squared_lengths(flat, first, mean, matrix, moved, rank, out):  # type: ignore[no-untyped-def]
    """out = sum over the first `rank` rows of (matrix (x - mean) - moved)^2, plus the rows after them as they are.

    As many pixels of `flat`, from `first` on, as `out` has room for.
    flat : (bands, pixels); matrix : (rows, columns), columns at least `bands`, a multiple of 4, filled up with zeros
    """
    bands, pixels = flat.shape[0], out.shape[0]
    x, z, total = np.zeros((matrix.shape[1], WIDTH)), np.empty(WIDTH), np.empty(WIDTH)
    for start in range(0, pixels, WIDTH):
        count = min(WIDTH, pixels - start)
        for b in range(bands):
            band, centre = flat[b, first + start : first + start + count], mean[b]
            for c in range(count):
                x[b, c] = band[c] - centre
        for c in range(WIDTH):
            total[c] = 0.0
        for i in range(matrix.shape[0]):
            for c in range(WIDTH):
                z[c] = -moved[i]
            _row_times(matrix[i], x, bands, z)
            if i < rank:
                for c in range(WIDTH):
                    total[c] += z[c] * z[c]
            else:
                for c in range(WIDTH):
                    total[c] += z[c]
        for c in range(count):
            out[start + c] = total[c]
