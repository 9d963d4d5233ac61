"""Compiled: what is done pixel by pixel with the levels of the bands, in one pass over the memory each.

Rows are worked on by functions of their own (`deglint.compensate._apart`); no sum is taken in another order than numpy
takes it, so that the results are the same to the bit.
"""

from __future__ import annotations

import numpy as np

from .. import jit as nb
from ._apart import apart

ZERO, ONE = np.float32(0.0), np.float32(1.0)


@nb.njit(cache=True, nogil=True)
def raised(level, limits):  # type: ignore[no-untyped-def]
    """A level with its offset, and by how much glint exceeds that."""
    offset, rise, _full, middle, slope, most, share = limits
    above = max(level - middle, ZERO)
    noise = ONE + min(above * slope, most)
    return level + offset * noise, rise * noise + share * above


@nb.njit(cache=True, nogil=True)
def marked(row, limits, level, hit):  # type: ignore[no-untyped-def]
    """Add the offset to a row of the level, and mark what exceeds it as glint does, or is full, if there is a level."""
    apart()
    for j in range(row.size):
        level[j], rise = raised(level[j], limits)
        hit[j] = ((row[j] > level[j] + rise) | (row[j] >= limits[2])) & (level[j] - level[j] == ZERO)


@nb.njit(cache=True, nogil=True)
def mark(band, limits, level, hit):  # type: ignore[no-untyped-def]
    """The same for a band; level and hit are written."""
    for i in range(len(band)):
        marked(band[i], limits, level[i], hit[i])


@nb.njit(cache=True, nogil=True)
def settled(row, limits, may, level, replaced, out):  # type: ignore[no-untyped-def]
    """Add the offset to a row of the level, which is put out in place of what exceeds it as glint does, or is full."""
    apart()
    for j in range(row.size):
        level[j], rise = raised(level[j], limits)
        hit = ((row[j] > level[j] + rise) | (row[j] >= limits[2])) & (level[j] - level[j] == ZERO) & may[j]
        out[j] = level[j] if hit else row[j]
        replaced[j] = replaced[j] | hit


@nb.njit(cache=True, nogil=True)
def settle(image, limits, may, level, replaced, out):  # type: ignore[no-untyped-def]
    """The same for a Block of bands; limits as `deglint.compensate.state.State` has them, may has rows or is empty."""
    bands, rows, columns = out.shape
    always = np.ones(columns, np.bool_)
    for b in range(bands):
        own = (limits[b, 0], limits[b, 1], limits[b, 2], limits[b, 3], limits[b, 4], limits[b, 5], limits[b, 6])
        for i in range(rows):
            here, at = may[i] if may.size else always, image.band * b + image.row * i
            settled(image.numbers[at : at + columns], own, here, level[b, i], replaced[b, i], out[b, i])


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
