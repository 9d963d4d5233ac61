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
def mark_row(image, own, replaced, limit, out):  # type: ignore[no-untyped-def]
    """Where a row was replaced for more than its limit, and whether it was anywhere; the limit is that of `halve`."""
    apart()
    rise, middle, slope, most, share = limit[0], limit[1], limit[2], limit[3], limit[4]
    found = np.uint8(0)
    for j in range(image.size):
        above = max(image[j] - middle, np.float32(0))
        least = rise * (np.float32(1) + min(above * slope, most)) + share * above
        strong = np.uint8(replaced[j]) & np.uint8(own[j] - image[j] > least)
        out[j] = strong
        found |= strong
    return found


@nb.njit(cache=True, nogil=True)
def halve_row(image, own, replaced, strong, share, out):  # type: ignore[no-untyped-def]
    """Put the middle of a row as it is and as it was where it was replaced, nothing is strong, and its share is 0."""
    apart()
    for j in range(out.size):
        faint = np.uint8(replaced[j]) & np.uint8(strong[j] == 0) & np.uint8(share[j] == 0)
        half = image[j] + np.float32(0.5) * (own[j] - image[j])
        out[j] = half if faint else out[j]


@nb.njit(cache=True, nogil=True)
def halve(image, own, replaced, share, corner, limit, around, out):  # type: ignore[no-untyped-def]
    """Put the middle of a block as it is and as it was where it was replaced for at most so much, with nothing beside
    it that was for more; in the part of it that begins at the corner, where its share is 0.

    limit : how much that is at most, at a level; the level from which on it grows, by what share of itself a unit, and
    at most; and what share of what the level lies above is added
    """
    (height, width), (top, left) = image.shape, corner
    row, strong = np.empty(width, np.uint8), np.zeros(image.shape, np.uint8)
    for i in range(height):
        if mark_row(image[i], own[i], replaced[i], limit, row):
            for j in range(width):
                if row[j]:
                    strong[max(i - around, 0) : i + around + 1, max(j - around, 0) : j + around + 1] = 1
    right = left + share.shape[1]
    for i in range(share.shape[0]):
        m = top + i
        within = image[m, left:right], own[m, left:right], replaced[m, left:right], strong[m, left:right]
        halve_row(*within, share[i], out[i])
