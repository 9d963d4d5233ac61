"""Compiled: what is done pixel by pixel with the levels of the bands, in one pass over the memory each.

Rows are worked on by functions of their own (`deglint.compensate._apart`); no sum is taken in another order than numpy
takes it, so that the results are the same to the bit.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from ._apart import apart

ZERO = np.float32(0.0)


@nb.njit(cache=True, nogil=True)
def marked(row, offset, rise, full, level, hit):  # type: ignore[no-untyped-def]
    """Add the offset to a row of the level, and mark what exceeds it by `rise`, or is full, where there is a level."""
    apart()
    for j in range(row.size):
        level[j] = level[j] + offset
        known = level[j] - level[j] == ZERO
        hit[j] = ((row[j] > level[j] + rise) | (row[j] >= full)) & known


@nb.njit(cache=True, nogil=True)
def mark(band, offset, rise, full, level, hit):  # type: ignore[no-untyped-def]
    """The same for a band; level and hit are written."""
    for i in range(len(band)):
        marked(band[i], offset, rise, full, level[i], hit[i])


@nb.njit(cache=True, nogil=True)
def settled(row, offset, rise, full, may, level, replaced):  # type: ignore[no-untyped-def]
    """Add the offset to a row of the level, and put that in place of what exceeds it by `rise`, or is full."""
    apart()
    for j in range(row.size):
        level[j] = level[j] + offset
        hit = ((row[j] > level[j] + rise) | (row[j] >= full)) & (level[j] - level[j] == ZERO) & may[j]
        row[j] = level[j] if hit else row[j]
        replaced[j] = replaced[j] | hit


@nb.njit(cache=True, nogil=True)
def settle(image, limits, may, level, replaced):  # type: ignore[no-untyped-def]
    """The same for a block of bands; limits are offset, rise and full of each, may has rows or is empty."""
    always = np.ones(image.shape[2], np.bool_)
    for b in range(len(image)):
        offset, rise, full = limits[b]
        for i in range(image.shape[1]):
            here = may[i] if may.size else always
            settled(image[b, i], offset, rise, full, here, level[b, i], replaced[b, i])


@nb.njit(cache=True, nogil=True)
def put(values, hit, row, replaced):  # type: ignore[no-untyped-def]
    """Put values into a row where it is hit, and note it."""
    apart()
    for j in range(row.size):
        row[j] = values[j] if hit[j] else row[j]
        replaced[j] = replaced[j] | hit[j]


@nb.njit(cache=True, nogil=True)
def put_all(values, hit, image, replaced):  # type: ignore[no-untyped-def]
    """The same for a block of bands."""
    for b in range(len(image)):
        for i in range(image.shape[1]):
            put(values[b, i], hit[b, i], image[b, i], replaced[b, i])
