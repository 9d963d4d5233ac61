"""Compiled: whether pixels that score high have one outline, they and what is about them."""

from __future__ import annotations

import math

import numpy as np

from .. import jit as nb

SIDE = 5
"""Of the squares about a thing that nothing brighter than usual may be in, but what is the thing's [pixel]."""
STEPS_OF_POWER = 16
"""Iterations of the power method; what is looked for is within 1e-4 where it is small."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def rigid(score, places, own, threshold, changes, out):  # type: ignore[no-untyped-def]
    """Pixels in a 3 x 3 square that sums up to the threshold, or to more if its outline changes.

    places : (pixel,), where in `out` they are, in order; score : (pixel,); own : (pixel, band), their excess; changes :
    part of the power that one outline need not explain; out : (row, column) of False
    """
    rows, columns = out.shape
    inside, index = np.empty(9, np.int64), np.full((5, columns), -1)  # of all that are in the rows around
    begin = end = 0
    for n in range(places.size):
        i, j = places[n] // columns, places[n] % columns
        while places[begin] < (i - 2) * columns:
            index[places[begin] // columns % 5, places[begin] % columns] = -1
            begin += 1
        while end < places.size and places[end] < (i + 3) * columns:
            index[places[end] // columns % 5, places[end] % columns] = end
            end += 1
        for down in range(max(i - 1, 0), min(i + 2, rows)):
            for right in range(max(j - 1, 0), min(j + 2, columns)):
                total, count = 0.0, 0
                for k in range(max(down - 1, 0), min(down + 2, rows)):
                    for m in range(max(right - 1, 0), min(right + 2, columns)):
                        if index[k % 5, m] >= 0:
                            inside[count] = index[k % 5, m]
                            total += score[inside[count]]
                            count += 1
                if inside[0] != n or total < threshold:  # each square once, with the first of its pixels
                    continue
                rest, power = unexplained(own, inside[:count])
                if total * changes * power < threshold * rest:
                    continue
                for k in inside[:count]:
                    out[places[k] // columns, places[k] % columns] = True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def quiet(raw, level, bands, white, most, besides, out):  # type: ignore[no-untyped-def]
    """Leave out pixels about which there is more than one outline: beside a part of the power, and some more.

    raw, level : Block of all pixels
    """
    around, every = np.empty((SIDE * SIDE, bands.size)), np.empty(SIDE * SIDE, np.int64)
    for n in range(SIDE * SIDE):
        every[n] = n
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            if out[i, j]:
                count = 0
                for k in range(max(i - SIDE // 2, 0), min(i + SIDE // 2 + 1, out.shape[0])):
                    for m in range(max(j - SIDE // 2, 0), min(j + SIDE // 2 + 1, out.shape[1])):
                        count += excess(raw, level, k, m, bands, white, around[count])
                rest, power = unexplained(around, every[:count])
                out[i, j] = rest <= most * power + besides


@nb.njit(cache=True, nogil=True, error_model="numpy")
def excess(raw, level, i, j, bands, white, out):  # type: ignore[no-untyped-def]
    """Excess of a pixel over the level, (band,); returns whether it is finite."""
    sound = True
    for b in range(bands.size):
        seen = raw.numbers[bands[b] * raw.band + i * raw.row + j]
        water = level.numbers[bands[b] * level.band + i * level.row + j]
        out[b] = (np.float64(seen) - np.float64(water)) / white[b]
        sound &= math.isfinite(out[b])
    return sound


@nb.njit(cache=True, nogil=True, error_model="numpy")
def unexplained(own, inside):  # type: ignore[no-untyped-def]
    """Power of some pixels' excess that no one outline, seen in all bands, explains; and their power.

    The largest eigenvalue of the bands' products, by the power method, is what one outline explains.
    """
    count = own.shape[1]
    products, v, w = np.zeros((count, count)), np.empty(count), np.empty(count)
    for n in inside:
        for a in range(count):
            for b in range(count):
                products[a, b] += own[n, a] * own[n, b]
    power = most = 0.0
    for a in range(count):
        power += products[a, a]
        v[a] = 1 / math.sqrt(count)
    for _ in range(STEPS_OF_POWER):
        length = 0.0
        for a in range(count):
            w[a] = 0.0
            for b in range(count):
                w[a] += products[a, b] * v[b]
            length += w[a] * w[a]
        most = math.sqrt(length)
        if most == 0:
            return power, power
        for a in range(count):
            v[a] = w[a] / most
    return power - most, power
