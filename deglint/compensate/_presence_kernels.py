"""Compiled: sums over cells of how far a band lies from its level, in whole numbers, so that their order is all one."""

from __future__ import annotations

import numba as nb
import numpy as np

from ._apart import apart


@nb.njit(cache=True, nogil=True)
def add_row(row, level, scale, most, steps):  # type: ignore[no-untyped-def]
    """Of a piece of a row, none further away than `most`: how many numbers, and sums in whole steps, and of squares."""
    apart()
    count, total, square = nb.int32(0), nb.int32(0), nb.int32(0)
    for j in range(row.size):
        away = (np.float32(row[j]) - level) * scale
        known = away == away
        away = min(max(away, -most), most) if known else np.float32(0)
        count += np.int32(1) if known else np.int32(0)
        total += np.int32(np.rint(away * steps))
        square += np.int32(np.rint(away * away * steps))
    return count, total, square


@nb.njit(cache=True, nogil=True)
def sum_cells(band, rows, columns, level, scale, most, steps):  # type: ignore[no-untyped-def]
    """The same of cells, (3, row, column) of cells; rows and columns are the cells' edges in the band."""
    sums = np.zeros((3, rows.size - 1, columns.size - 1), np.int32)
    for m in range(rows.size - 1):
        for i in range(rows[m], rows[m + 1]):
            for n in range(columns.size - 1):
                count, total, square = add_row(band[i, columns[n] : columns[n + 1]], level, scale, most, steps)
                sums[0, m, n] += count
                sums[1, m, n] += total
                sums[2, m, n] += square
    return sums


@nb.njit(cache=True, nogil=True)
def halve(image, own, replaced, share, corner, most, around, out):  # type: ignore[no-untyped-def]
    """Put the middle of a block as it is and as it was where it was replaced for at most so much, with nothing beside
    it that was for more; in the part of it that begins at the corner, where its share is 0."""
    top, left = corner
    for i in range(share.shape[0]):
        for j in range(share.shape[1]):
            if share[i, j] != 0 or not replaced[top + i, left + j]:
                continue
            faint = True
            for m in range(max(top + i - around, 0), min(top + i + around + 1, image.shape[0])):
                for n in range(max(left + j - around, 0), min(left + j + around + 1, image.shape[1])):
                    if replaced[m, n] and own[m, n] - image[m, n] > most:
                        faint = False
            if faint:
                was, now = own[top + i, left + j], image[top + i, left + j]
                out[i, j] = now + np.float32(0.5) * (was - now)
