"""Compiled: sums over cells of how far a band lies from its level, in whole numbers, so that their order is all one."""

from __future__ import annotations

import numba as nb
import numpy as np

from ._apart import apart


@nb.njit(cache=True, nogil=True)
def add_row(row, level, scale, most, steps):  # type: ignore[no-untyped-def]
    """Sum of the squares of a piece of a row in whole steps, none above `most`, and of how many numbers."""
    apart()
    total, count = nb.int32(0), nb.int32(0)
    for j in range(row.size):
        away = (np.float32(row[j]) - level) * scale
        square = away * away
        square = square if square < most else most
        known = away == away
        total += np.int32(square * steps + np.float32(0.5)) if known else np.int32(0)
        count += np.int32(1) if known else np.int32(0)
    return total, count


@nb.njit(cache=True, nogil=True)
def sum_cells(band, rows, columns, level, scale, most, steps):  # type: ignore[no-untyped-def]
    """Sums and counts of cells, (row, column) of cells each; rows and columns are the cells' edges in the band."""
    totals = np.zeros((rows.size - 1, columns.size - 1), np.int32)
    counts = np.zeros((rows.size - 1, columns.size - 1), np.int32)
    for m in range(rows.size - 1):
        for i in range(rows[m], rows[m + 1]):
            for n in range(columns.size - 1):
                total, count = add_row(band[i, columns[n] : columns[n + 1]], level, scale, most, steps)
                totals[m, n] += total
                counts[m, n] += count
    return totals, counts
