"""Compiled: the subtraction of `deglint.remove.model`, each number in float64 in the same order, rounded once."""

from __future__ import annotations

import numpy as np

from .. import jit as nb


@nb.njit(cache=True, nogil=True)
def summed(row, weight, first, out):  # type: ignore[no-untyped-def]
    """A row times its weight, put down or added."""
    if first:
        for j in range(out.size):
            out[j] = weight * np.float64(row[j])
    else:
        for j in range(out.size):
            out[j] = out[j] + weight * np.float64(row[j])


@nb.njit(cache=True, nogil=True)
def subtract(image, bands, weights, levels, slopes, targets, follows):  # type: ignore[no-untyped-def]
    """In place on a block; bands, weights : (index, place), -1 where there is no more; targets, follows : (fit,)."""
    count, rows, columns = len(levels), image.shape[1], image.shape[2]
    above = np.empty((count, columns))
    for i in range(rows):
        for n in range(count):
            for k in range(bands.shape[1]):
                if bands[n, k] >= 0:
                    summed(image[bands[n, k], i], weights[n, k], k == 0, above[n])
        for f in range(len(targets)):
            row, index, level, slope = image[targets[f], i], above[follows[f]], levels[follows[f]], slopes[f]
            for j in range(columns):
                row[j] = np.float64(row[j]) - (index[j] - level) * slope
