"""The compiled inner loop of `deglint.remove.detrend`; its plain twin stands in the tests."""

import numpy as np
from numba import njit


@njit(nogil=True, cache=True, error_model="numpy")
def subtract_local_mean(block, sample, half, out):  # type: ignore[no-untyped-def]
    """out = block - mean over the sample in (2 half + 1)^2 pixels; NaN outside the sample.

    Columns of the square are summed first, then along the row: always afresh and in the same order, so that
    the result does not depend on where the block begins.
    """
    bands, rows, columns = block.shape
    count, total = np.empty(columns), np.empty(columns)
    column_sums = np.zeros(columns + 2 * half)
    inner = column_sums[half : half + columns]
    for r in range(rows):
        here = sample[r]
        if not here.any():
            out[:, r] = np.nan
            continue
        first, last = max(0, r - half), min(rows, r + half + 1)
        for b in range(-1, bands):
            inner[:] = 0.0
            for k in range(first, last):
                weight = sample[k]
                if b < 0:
                    for c in range(columns):
                        inner[c] += 1.0 if weight[c] else 0.0
                else:
                    row = block[b, k]
                    for c in range(columns):
                        inner[c] += row[c] if weight[c] else 0.0
            sums = count if b < 0 else total
            sums[:] = 0.0
            for k in range(2 * half + 1):
                for c in range(columns):
                    sums[c] += column_sums[c + k]
            if b >= 0:
                source, target = block[b, r], out[b, r]
                for c in range(columns):
                    target[c] = source[c] - total[c] / count[c] if here[c] else np.nan
