"""Compiled: the first look at S, as sums of tabled steps; see `deglint.compensate.glance`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .. import jit as nb
from ._apart import apart
from ._glance_lanes import GROUPS, PIECES, above, add, binned, each, highest, pair, put, row
from ._lanes import LANES, ahead

KINDS = 48
"""Shapes in a row of the table of steps, which are added up side by side; at least as many as there are shapes."""
PART = 128
"""Columns that are looked at together, so that what is worked on stays in the processor's first cache."""
LINE = 16
"""Numbers in a line of the processor's cache."""
SOON = 16
"""Pixels further on that are asked for from memory: they lie here and there, so that the processor cannot guess."""


class Block(NamedTuple):
    """A (band, row, column) array for the kernels, of which each row is one piece.

    numbers : all from the first to the last; band, row : how many lie from one to the next
    """

    numbers: npt.NDArray[np.floating]
    band: int
    row: int


class Steps(NamedTuple):
    """What is added up, in units of 1 / `QUARTERS`; see `deglint.compensate.glance`.

    edge : of the bins, and one more that is not a number; begin, bins : the bin of zero, and bins of a factor e as
    float32 has it, as `binned` wants them
    first, start, step : (bin,), (shape,), and flat rows of shapes, one for every (band - 1, bin, bin);
    shapes are padded to `KINDS`
    group_first, group : the most of each of `GROUPS` groups of shapes, flat rows for (bin,), and as in `step`
    """

    edge: npt.NDArray[np.float32]
    begin: np.float32
    bins: np.float32
    first: npt.NDArray[np.int16]
    start: npt.NDArray[np.int16]
    step: npt.NDArray[np.int8]
    group_first: npt.NDArray[np.int16]
    group: npt.NDArray[np.int8]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def glance(look, sensor, steps, least, missing, found):  # type: ignore[no-untyped-def]
    """List pixels of which the sum of steps of some group of shapes is above `least`; returns how many.

    What a group adds is the most that a shape of it adds, so that no shape's sum is above its group's. Looked at are
    pixels of which two bands exceed the level by more than `limit` variances of the noise.

    look : raw and level, Block of one dtype; sensor : of bands, (band,) from the unit of the scene to that of the bins,
    (band, 2) of noise, limit, all of that dtype; missing : (row, column), where a band is not finite; found : (pixel,)
    of place and (pixel, band - 1) of row in the table
    """
    bands = sensor[0]
    many, listed = np.empty(PART, np.float32), np.empty(PART, np.int64)
    z, pairs = np.empty((bands.size, PART), np.float32), np.empty((bands.size - 1, PART), np.uint16)
    z[:] = 0
    count, columns = nb.int64(0), missing.shape[1]
    for i in range(missing.shape[0]):
        for left in range(0, columns, PART):
            width = min(PART, columns - left)
            stand_out(look, sensor, i, left, z, many[:width], missing[i, left : left + width])
            n = nb.int64(0)
            for j in range(width):
                listed[nb.uint64(n)] = j
                n += many[j] >= 2
            if n > 0:
                pair_up(z, steps, pairs)
            count = may_be(pairs, listed[:n], steps, least, i * columns + left, found, count)
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def stand_out(look, sensor, i, left, z, many, missing):  # type: ignore[no-untyped-def]
    """The excess of a part of a row in the unit of the bins, and in how many bands pixels exceed the level by enough.

    What lies below will be wanted next.
    """
    apart()
    (raw, level), (bands, scale, noise, limit) = look, sensor
    many[:] = 0
    for b in range(bands.size):
        at, under = bands[b] * raw.band + i * raw.row + left, bands[b] * level.band + i * level.row + left
        seen, water, out = raw.numbers[at : at + many.size], level.numbers[under : under + many.size], z[b]
        for j in range(0, many.size, LINE):
            ahead(raw.numbers, at + raw.row + j)
            ahead(level.numbers, under + level.row + j)
        fixed, rising, to_bins = noise[b, 0], noise[b, 1], scale[b]
        for j in range(many.size):
            more = seen[j] - water[j]
            out[j] = more * to_bins
            high = more * abs(more) > limit * (fixed + rising * max(seen[j], 0))
            many[j] += np.float32(high) + np.float32(more - more)  # not a number where that is not finite
    for j in range(many.size):
        missing[j] = many[j] != many[j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def pair_up(z, steps, pairs):  # type: ignore[no-untyped-def]
    """Rows of the tables, for the bins of each band and of the next."""
    for j in range(0, PART, LANES):
        before = binned(z, j, steps.edge, steps.begin, steps.bins)
        for b in range(1, z.shape[0]):
            now = binned(z, b * PART + j, steps.edge, steps.begin, steps.bins)
            pair(before, now, nb.int32((b - 1) * PIECES * PIECES), pairs, (b - 1) * PART + j)
            before = now


@nb.njit(cache=True, nogil=True, error_model="numpy")
def may_be(pairs, listed, steps, least, at, found, count):  # type: ignore[no-untyped-def]
    """Append those of some pixels, which are listed, of which the sum of some group is above the least."""
    places, rows = found
    begin, limit = count, each(nb.int64(least))
    for m in range(listed.size):  # without an `if`, which would often be guessed wrong
        j = nb.uint64(listed[m])
        r = nb.int64(pairs[nb.uint64(0), j])
        total = add(row(steps.group_first, (r // PIECES) * GROUPS), row(steps.group, r * GROUPS))
        for k in range(1, pairs.shape[0]):
            total = add(total, row(steps.group, nb.int64(pairs[nb.uint64(k), j]) * GROUPS))
        places[nb.uint64(count)] = at + nb.int64(j)
        count += above(total, limit)
    for n in range(begin, count):
        for k in range(pairs.shape[0]):
            rows[n, k] = pairs[k, places[n] - at]
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def weigh(count, steps, least, found, totals, most):  # type: ignore[no-untyped-def]
    """Sum of the steps of every shape for those that `glance` has listed, of which it is above `least`; how many.

    Whole numbers, so that it does not matter in which order they are added. found : as of `glance`, and now without
    the others; totals : (pixel, shape); most : (pixel,), of the best shape
    """
    (places, rows), kept = found, nb.int64(0)
    for m in range(count):
        for r in rows[min(m + SOON, count - 1)]:
            ahead(steps.step, nb.int64(r) * KINDS)
            ahead(steps.step, (nb.int64(r) + 1) * KINDS - 1)
        begin = each(nb.int64(steps.first[rows[m, 0] // PIECES]))
        one, two = add(begin, row(steps.start, 0)), add(begin, row(steps.start, GROUPS))
        three = add(begin, row(steps.start, 2 * GROUPS))
        for k in range(rows.shape[1]):
            r = nb.int64(rows[m, k])
            rows[kept, k] = r
            one = add(one, row(steps.step, r * KINDS))
            two = add(two, row(steps.step, r * KINDS + GROUPS))
            three = add(three, row(steps.step, r * KINDS + 2 * GROUPS))
        put(one, totals, kept * KINDS)
        put(two, totals, kept * KINDS + GROUPS)
        put(three, totals, kept * KINDS + 2 * GROUPS)
        places[kept], most[kept] = places[m], max(highest(one), highest(two), highest(three))
        kept += most[kept] > least
    return kept


@nb.njit(cache=True, nogil=True, error_model="numpy")
def squares(places, values, threshold, reached, out):  # type: ignore[no-untyped-def]
    """List those of some pixels, in order of their places, in a 3 x 3 square over which values sum up to the threshold.

    Always added in one order. reached : (row + 2, column + 2), for the squares, and a border of False; returned is how
    many are listed.
    """
    rows, columns = reached.shape[0] - 2, reached.shape[1] - 2
    across, p, count, end = np.zeros((3, columns + 2)), 0, 0, 0  # sums of three in a row
    for i in range(rows + 1):
        below, end = across[(i + 1) % 3], end + columns
        below[:] = 0
        while p < places.size and places[p] < end:
            j = places[p] - end + columns
            below[j] += values[p]
            below[j + 1] += values[p]
            below[j + 2] += values[p]
            p += 1
        if i > 0:
            add_up(across[(i - 1) % 3, 1:], across[i % 3, 1:], below[1:], threshold, reached[i, 1 : columns + 1])
    i = end = 0
    for p in range(places.size):
        while places[p] >= end:
            i, end = i + 1, end + columns
        j, near = places[p] - end + columns, False
        for k in range(i - 1, i + 2):
            near |= reached[k, j] | reached[k, j + 1] | reached[k, j + 2]
        out[count] = p
        count += near
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def add_up(one, two, three, threshold, out):  # type: ignore[no-untyped-def]
    """Whether sums of three rows reach the threshold; without an `if`, so that many are added at once."""
    apart()
    for j in range(out.size):
        out[j] = one[j] + two[j] + three[j] >= threshold
