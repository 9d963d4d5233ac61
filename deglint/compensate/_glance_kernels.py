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
        n = nb.int64(0)
        for j in range(width):
            out[i, j] = nothing if sound[j] else missing
            listed[n] = j
            n += sound[j] & (high[j] >= 2)
        for b in range(count):
            at, under = bands[b] * raw.band + i * raw.row, bands[b] * level.band + i * level.row
            for m in range(n):
                j = listed[m]
                z[m] = (raw.numbers[nb.uint64(at + j)] - level.numbers[nb.uint64(under + j)]) * scale[b]
            bins(z, n, b, steps.cell, steps.edge, place)
        some = may_be(place, n, steps, least, kept)
        weigh(place, kept, some, steps, -least - 1, totals)
        highest(totals, some, most)
        for k in range(some):
            if most[k] >= 0:
                out[i, listed[kept[k]]] = np.float32(most[k] + least + 1) * worth + room


@nb.njit(cache=True, nogil=True, error_model="numpy")
def stand_out(raw, level, bands, noise, limit, i, high, sound):  # type: ignore[no-untyped-def]
    """In how many bands the pixels of a row exceed the level, and whether all bands are finite."""
    for j in range(high.size):
        high[j], sound[j] = 0, True
    for b in range(bands.size):
        at, under = bands[b] * raw.band + i * raw.row, bands[b] * level.band + i * level.row
        seen, water = raw.numbers[at : at + high.size], level.numbers[under : under + high.size]
        fixed, rising = noise[b, 0], noise[b, 1]
        for j in range(high.size):
            more = seen[j] - water[j]
            high[j] += more * abs(more) > limit * (fixed + rising * max(seen[j], 0))
            sound[j] &= more - more == 0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def bins(z, count, b, cell, edge, out):  # type: ignore[no-untyped-def]
    """Bins of some numbers of a band, into (band, pixel)."""
    bits = z.view(np.int32)
    for m in range(count):
        place = nb.int64(cell[nb.uint64((bits[m] >> 20) & 4095)])
        out[b, m] = place + (z[m] >= edge[nb.uint64(place)])


@nb.njit(cache=True, nogil=True, error_model="numpy")
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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def weigh(place, which, count, steps, more, totals):  # type: ignore[no-untyped-def]
    """Sum of the steps of every shape for the bins of some pixels, (band, pixel), plus `more`.

    Whole numbers, so that it does not matter in which order they are added. totals : (pixel, shape)
    """
    first, step, size, pairs = steps.first, steps.step, steps.first.size, place.shape[0] - 1
    rows = np.empty(2 * ROWS, np.int64)
    for k in range(2 * ROWS):
        rows[k] = pairs * size * size * LANES
    for i in range(count):
        m, total, before = which[i], totals[i], steps.start
        for k in range(pairs):
            rows[k] = ((k * size + nb.int64(place[k, m])) * size + place[k + 1, m]) * LANES
        for k in range(0, pairs, ROWS):
            r0, r1, r2, r3 = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
            r4, r5, r6, r7 = rows[k + 4], rows[k + 5], rows[k + 6], rows[k + 7]
            begin = first[place[0, m]] + more if k == 0 else 0
            for n in range(LANES):  # of fixed length and without an `if`, so that many are added at once
                one = step[nb.uint64(r0 + n)] + step[nb.uint64(r1 + n)] + step[nb.uint64(r2 + n)]
                two = step[nb.uint64(r3 + n)] + step[nb.uint64(r4 + n)] + step[nb.uint64(r5 + n)]
                total[n] = before[n] + one + two + step[nb.uint64(r6 + n)] + step[nb.uint64(r7 + n)] + begin
            before = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def highest(totals, count, out):  # type: ignore[no-untyped-def]
    """The largest sum of some pixels, -1 where all are negative."""
    packed = totals.view(np.int64)
    for i in range(count):
        signs = SIGNS
        for k in range(packed.shape[1]):
            signs &= packed[i, k]
        out[i] = -1
        if signs != SIGNS:
            for k in range(totals.shape[1]):
                out[i] = max(out[i], totals[i, k])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def squares(score, least, threshold, out):  # type: ignore[no-untyped-def]
    """Whether the pixels above `least` in 3 x 3 sum up to the threshold; always added in one order.

    Loops without an `if`, so that many are added at once.
    """
    rows, columns = score.shape
    high = np.zeros((3, columns + 2))
    for i in range(rows + 1):
        one, two, three = high[(i - 1) % 3], high[i % 3], high[(i + 1) % 3]
        for j in range(columns):
            three[j + 1] = score[i, j] if i < rows and score[i, j] > least else 0.0
        for j in range(columns if i > 0 else 0):
            total = one[j] + one[j + 1] + one[j + 2] + two[j] + two[j + 1] + two[j + 2]
            out[i - 1, j] = total + three[j] + three[j + 1] + three[j + 2] >= threshold
