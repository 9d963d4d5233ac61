"""The compiled inner loop of `deglint.remove.apply`; its numpy twin stands in the tests."""

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def subtract(block, out, where, everywhere, weights, levels, which, slopes):  # type: ignore[no-untyped-def]
    """out = block - slope * (index - level), row by row, where asked or `everywhere`; `out` may be `block`."""
    bands, rows, columns = block.shape
    glint = np.empty((levels.shape[0], columns))
    for r in range(rows):
        for k in range(levels.shape[0]):
            g = glint[k]
            g[:] = 0.0
            for b in range(bands):
                w = weights[k, b]
                if w != 0.0:
                    row = block[b, r]
                    for c in range(columns):
                        g[c] += w * row[c]
            level = levels[k]
            for c in range(columns):
                g[c] -= level
        for b in range(bands):
            source = block[b, r]
            target = out[b, r]
            if which[b] < 0:
                target[:] = source
                continue
            g = glint[which[b]]
            slope = slopes[b]
            if everywhere:
                for c in range(columns):
                    target[c] = source[c] - slope * g[c]
            else:
                mask = where[r]
                for c in range(columns):
                    target[c] = source[c] - slope * g[c] if mask[c] else source[c]
