"""Compiled: sums over cells of how far a band lies from its level, in whole numbers, so that their order is all one."""

from __future__ import annotations

import numpy as np

from .. import jit as nb
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
def row(block, band, i, first, count):  # type: ignore[no-untyped-def]
    """So many numbers of a row of a Block, from the first that is wanted."""
    at = block.band * band + block.row * i + first
    return block.numbers[at : at + count]


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
def pass_row(left):  # type: ignore[no-untyped-def]
    """Of how many more rows a pixel has something strong beside it: one less."""
    apart()
    for j in range(left.size):
        left[j] -= np.uint8(left[j] > 0)


@nb.njit(cache=True, nogil=True)
def note_row(strong, rows, left):  # type: ignore[no-untyped-def]
    """That many more, where a row is strong or has something beside it that is; its marks begin and end further out."""
    apart()
    for k in range(strong.size - left.size + 1):
        beside = strong[k : k + left.size]
        for j in range(left.size):
            left[j] = rows if beside[j] else left[j]


@nb.njit(cache=True, nogil=True)
def faint_row(replaced, left, calm, out):  # type: ignore[no-untyped-def]
    """Where a row was replaced, with nothing strong beside it, and is to be looked at."""
    apart()
    for j in range(out.size):
        out[j] = np.uint8(replaced[j]) & np.uint8(left[j] == 0) & np.uint8(calm[j])


@nb.njit(cache=True, nogil=True)
def halve_row(image, own, faint, out):  # type: ignore[no-untyped-def]
    """The middle of a row as it is and as it was where it is faint, and the row as it is elsewhere."""
    apart()
    for j in range(out.size):
        half = image[j] + np.float32(0.5) * (own[j] - image[j])
        out[j] = half if faint[j] else image[j]


@nb.njit(cache=True, nogil=True)
def halve(image, own, replaced, calm, shape, corner, bands, limits, around, out):  # type: ignore[no-untyped-def]
    """A part of a block that begins at the corner, and in it the middle of the block as it is and as it was where it is
    calm, and was replaced for at most so much, with nothing beside it that was for more.

    image, own, replaced, out : Block, the last of the part; calm : (row, column) bool; shape : (row, column) of the
    block; limits : (band, 5) of these bands: how much that is at most, at a level; the level from which on it grows, by
    what share of itself a unit, and at most; and what share of what the level lies above is added
    """
    (height, width), (top, first) = shape, corner
    rows, columns = calm.shape
    strong, left = np.zeros(width + 2 * around, np.uint8), np.empty(width, np.uint8)
    faint, line = np.empty(columns, np.uint8), np.empty(columns, out.numbers.dtype)
    for n in range(bands.size):
        b = bands[n]
        left[:] = 0
        for i in range(max(top - around, 0), top + rows + around):
            pass_row(left)
            if i < height:
                seen = row(image, b, i, 0, width), row(own, b, i, 0, width), row(replaced, b, i, 0, width)
                if mark_row(*seen, limits[n], strong[around : around + width]):
                    note_row(strong, np.uint8(2 * around + 1), left)
            m = i - around  # all that is beside it has been seen
            if m >= top:
                faint_row(row(replaced, b, m, first, columns), left[first : first + columns], calm[m - top], faint)
                halve_row(row(image, b, m, first, columns), row(own, b, m, first, columns), faint, line)
                row(out, b, m - top, 0, columns)[:] = line  # which may be the image itself


@nb.njit(cache=True, nogil=True)
def blend_row(made, was, share):  # type: ignore[no-untyped-def]
    """Take back all but a share of what was made of a row; to the bit where that is 0 or 1."""
    apart()
    for j in range(made.size):
        part = was[j] + share[j] * (made[j] - was[j])
        part = was[j] if share[j] == 0 else part
        made[j] = part if share[j] < 1 else made[j]


@nb.njit(cache=True, nogil=True)
def blended(made, was, share, bands):  # type: ignore[no-untyped-def]
    """The same of a block, band by band; made, was : Block."""
    columns = share.shape[1]
    for b in range(bands):
        for i in range(share.shape[0]):
            blend_row(row(made, b, i, 0, columns), row(was, b, i, 0, columns), share[i])
