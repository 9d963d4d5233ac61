"""Compiled: the first look at S, as sums of tabled steps; see `deglint.compensate.glance`."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

LANES = 48
"""Shapes in a row of the table of steps, which are added up side by side; at least as many as there are shapes."""
ROWS = 8
"""Rows that are added at once."""
PACKED = 4
"""Sums of 16 bits in one number of 64."""
WORDS = 2
"""Such numbers for each step: one sum for each of WORDS * PACKED groups of shapes."""
ONE_EACH = 0x0001000100010001
SIGNS = -0x7FFF7FFF7FFF8000
"""Ones in each of the packed sums, and the highest bit of each."""


class Block(NamedTuple):
    """A (band, row, column) array for the kernels, of which each row is one piece.

    numbers : all from the first to the last; band, row : how many lie from one to the next
    """

    numbers: npt.NDArray[np.floating]
    band: int
    row: int


class Steps(NamedTuple):
    """What is added up, in units of 1 / `QUARTERS`; see `deglint.compensate.glance`.

    cell, edge : of the search for the bin of a number, by the leading bits of it as float32
    first, start, step : (bin,), (shape,), and flat rows of shapes, one for every (band - 1, bin, bin) and one of zeros;
    shapes are padded to `LANES`
    group_first, group : the most of each group of shapes in (bin,) and in (band - 1, bin, bin), packed in WORDS numbers
    """

    cell: npt.NDArray[np.uint8]
    edge: npt.NDArray[np.float32]
    first: npt.NDArray[np.int16]
    start: npt.NDArray[np.int16]
    step: npt.NDArray[np.int8]
    group_first: npt.NDArray[np.int64]
    group: npt.NDArray[np.int64]


@nb.njit(cache=True, nogil=True)
def row_of(block, band, i, width):  # type: ignore[no-untyped-def]
    """One row of a band."""
    first = band * block.band + i * block.row
    return block.numbers[first : first + width]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def glance(raw, level, bands, scale, noise, limit, steps, least, worth, room, out):  # type: ignore[no-untyped-def]
    """The largest sum of steps of each pixel, where it is above `least`, times `worth` plus `room`; else -infinity.

    NaN where a band is not finite. Looked at are pixels of which two bands exceed the level by more than `limit`
    variances of the noise.

    raw, level : Block of one dtype; scale : (band,) from the unit of the scene to that of the bins; noise : (band, 2),
    both of that dtype; out : (row, column)
    """
    width, count, nothing, missing = out.shape[1], bands.size, np.float32(-np.inf), np.float32(np.nan)
    high, sound, listed = np.empty(width, np.int32), np.empty(width, np.bool_), np.empty(width, np.int64)
    z, place = np.empty(width, np.float32), np.empty((count, width), np.uint8)
    kept, most, totals = np.empty(width, np.int64), np.empty(width, np.int64), np.empty((width, LANES), np.int16)
    for i in range(out.shape[0]):
        stand_out(raw, level, bands, noise, limit, i, high, sound)
        n = 0
        for j in range(width):
            out[i, j] = nothing if sound[j] else missing
            listed[n] = j
            n += sound[j] & (high[j] >= 2)
        for b in range(count):
            seen, water = row_of(raw, bands[b], i, width), row_of(level, bands[b], i, width)
            for m in range(n):
                j = nb.uint64(listed[m])
                z[m] = (seen[j] - water[j]) * scale[b]
            bins(z[:n], steps.cell, steps.edge, place[b])
        some = may_be(place, n, steps, least, kept)
        weigh(place, kept[:some], steps, -least - 1, totals)
        highest(totals, most[:some])
        for k in range(some):
            if most[k] >= 0:
                out[i, listed[kept[k]]] = np.float32(most[k] + least + 1) * worth + room


@nb.njit(cache=True, nogil=True, error_model="numpy")
def stand_out(raw, level, bands, noise, limit, i, high, sound):  # type: ignore[no-untyped-def]
    """In how many bands the pixels of a row exceed the level, and whether all bands are finite."""
    high[:] = 0
    sound[:] = True
    for b in range(bands.size):
        seen, water = row_of(raw, bands[b], i, high.size), row_of(level, bands[b], i, high.size)
        fixed, rising = noise[b, 0], noise[b, 1]
        for j in range(high.size):
            more = seen[j] - water[j]
            high[j] += more * abs(more) > limit * (fixed + rising * max(seen[j], 0))
            sound[j] &= more - more == 0


@nb.njit(cache=True, nogil=True)
def bins(z, cell, edge, out):  # type: ignore[no-untyped-def]
    """Bins of some numbers."""
    bits = z.view(np.int32)
    for m in range(z.size):
        place = nb.int64(cell[nb.uint64((bits[m] >> 20) & 4095)])
        out[m] = place + (z[m] >= edge[nb.uint64(place)])


@nb.njit(cache=True, nogil=True)
def may_be(place, n, steps, least, out):  # type: ignore[no-untyped-def]
    """List those of n pixels of which the sum of some group is above the least; returns how many.

    What a group adds is the most that a shape of it adds, so that no shape's sum is above its group's.
    """
    kept, size, over = 0, steps.first.size, (-least - 1) * ONE_EACH
    for m in range(n):
        before, base = nb.int64(place[0, m]), 0
        u = nb.uint64(WORDS * before)
        a, b = steps.group_first[u] + over, steps.group_first[u + nb.uint64(1)] + over
        for k in range(1, place.shape[0]):
            now = nb.int64(place[k, m])
            u = nb.uint64(WORDS * (base + before * size + now))
            a += steps.group[u]
            b += steps.group[u + nb.uint64(1)]
            before = now
            base += size * size
        out[kept] = m
        kept += ((a | b) & SIGNS) != 0
    return kept


@nb.njit(inline="always")
def add_eight(before, step, rows, begin, more, total):  # type: ignore[no-untyped-def]
    """Add eight rows of the table, in one loop of fixed length without an `if`, so that many are added at once."""
    r0, r1, r2, r3 = rows[begin], rows[begin + 1], rows[begin + 2], rows[begin + 3]
    r4, r5, r6, r7 = rows[begin + 4], rows[begin + 5], rows[begin + 6], rows[begin + 7]
    for k in range(LANES):
        one = step[nb.uint64(r0 + k)] + step[nb.uint64(r1 + k)] + step[nb.uint64(r2 + k)] + step[nb.uint64(r3 + k)]
        two = step[nb.uint64(r4 + k)] + step[nb.uint64(r5 + k)] + step[nb.uint64(r6 + k)] + step[nb.uint64(r7 + k)]
        total[k] = before[k] + one + two + more


@nb.njit(cache=True, nogil=True)
def weigh(place, which, steps, more, totals):  # type: ignore[no-untyped-def]
    """Sum of the steps of every shape for the bins of some pixels, (band, pixel), plus `more`.

    Whole numbers, so that it does not matter in which order they are added. totals : (pixel, shape)
    """
    first, start, step = steps.first, steps.start, steps.step
    size, pairs, rows = first.size, place.shape[0] - 1, np.empty(2 * ROWS, np.int64)
    rows[:] = pairs * size * size * LANES
    for i in range(which.size):
        m, total = which[i], totals[i]
        for k in range(pairs):
            rows[k] = ((k * size + nb.int64(place[k, m])) * size + place[k + 1, m]) * LANES
        add_eight(start, step, rows, 0, first[place[0, m]] + more, total)
        if pairs > ROWS:
            add_eight(total, step, rows, ROWS, 0, total)


@nb.njit(cache=True, nogil=True)
def highest(totals, out):  # type: ignore[no-untyped-def]
    """The largest sum of some pixels, -1 where all are negative."""
    packed = totals.view(np.int64)
    for i in range(out.size):
        signs = SIGNS
        for k in range(packed.shape[1]):
            signs &= packed[i, k]
        out[i] = -1
        if signs != SIGNS:
            for k in range(LANES):
                out[i] = max(out[i], totals[i, k])


@nb.njit(cache=True, nogil=True)
def squares(score, least, threshold, out):  # type: ignore[no-untyped-def]
    """Pixels above `least` in a 3 x 3 square over which these sum up to the threshold; always added in one order.

    Loops without an `if`, so that many are added at once.
    """
    rows, columns = score.shape
    high, reached = np.zeros((3, columns + 2)), np.zeros((rows + 2, columns + 2), np.bool_)
    for i in range(rows + 1):
        below = high[(i + 1) % 3]
        for j in range(columns):
            below[j + 1] = score[i, j] if i < rows and score[i, j] > least else 0.0
        if i == 0:
            continue
        one, two = high[(i - 1) % 3], high[i % 3]
        for j in range(columns):
            total = one[j] + one[j + 1] + one[j + 2] + two[j] + two[j + 1] + two[j + 2]
            reached[i, j + 1] = total + below[j] + below[j + 1] + below[j + 2] >= threshold
    for i in range(rows):
        one, two, three = reached[i], reached[i + 1], reached[i + 2]
        for j in range(columns):
            near = one[j] | one[j + 1] | one[j + 2] | two[j] | two[j + 1] | two[j + 2]
            out[i, j] = (score[i, j] > least) & (near | three[j] | three[j + 1] | three[j + 2])
