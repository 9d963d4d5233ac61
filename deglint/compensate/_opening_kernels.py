"""Compiled: openings of a band, all of them in one pass over its rows.

An opening is a row of small steps, each of which takes the least of three or five pixels of the step before; the
median and the combinations are steps, too (`deglint.compensate.opening` writes them down). All steps run side by
side, a few rows at a time, each some rows behind those it looks at, so that what they pass on stays in the processor's
cache. A dilation is the erosion of the negative: from the median on, steps hold negatives, and the least is all that is
ever looked for.

A row is kept as parts side by side, one for each lane of a vector (`deglint.compensate._whole_lanes`): number j of part
l is number `lanes` j + l in memory. So the neighbour in the row lies a vector away, as the neighbour in the column lies
a row away, and none is loaded across lines of the cache. What lies beyond the ends of a part is the next part, one
number further.

Whole numbers of 16 or 32 bits will do, of which the largest stands for a pixel that is not valid: no erosion takes it,
and as a negative no dilation.
"""

from __future__ import annotations

import numpy as np

from .. import jit as nb
from ._apart import apart
from ._whole_lanes import BYTES, before, behind, count, least, load, most, negative, store, turn

INPUT, ACROSS, DOWN, ACROSS3, ACROSS5, DOWN3, DOWN5, STAR, SQUARE, MEDIAN, CORNERS, OUTLINES = range(12)
"""Kinds of steps: rows as they are; the least of all pixels within reach in the row, in the column; of three or five of
them; of a pixel and the four so far from it; of 3 x 3; the median of 3 x 3, and that or the brightest patch of 2 x 2
that a pixel is in; the brightest of the other openings."""
FEW = 4
"""Numbers left of a row that are not worth a square."""


@nb.njit(cache=True, nogil=True)
def across(x, at, to, reach, five, long, rows):  # type: ignore[no-untyped-def]
    """The least of three pixels so far apart, or of five, side by side."""
    apart()
    lanes = count(x)
    by = reach * lanes
    for u in range(rows):
        a, b = at[u], at[to + u]
        for j in range(0, long, lanes):
            found = least(least(load(x, a + j - by), load(x, a + j)), load(x, a + j + by))
            if five:
                found = least(found, least(load(x, a + j - 2 * by), load(x, a + j + 2 * by)))
            store(x, b + j, found)


@nb.njit(cache=True, nogil=True)
def down(x, at, to, reach, five, long, rows):  # type: ignore[no-untyped-def]
    """The least of three pixels so far apart, or of five, in a column."""
    apart()
    lanes = count(x)
    for u in range(rows):
        a, b, c, d, e = at[u], at[u + reach], at[u + 2 * reach], at[u], at[u]
        if five:
            d, e = at[u + 3 * reach], at[u + 4 * reach]
        for j in range(0, long, lanes):
            found = least(least(load(x, a + j), load(x, b + j)), load(x, c + j))
            if five:
                found = least(found, least(load(x, d + j), load(x, e + j)))
            store(x, at[to + u] + j, found)


@nb.njit(cache=True, nogil=True)
def near_across(x, at, to, reach, long, rows):  # type: ignore[no-untyped-def]
    """The least of all pixels so far to either side, 2 or more; four vectors at a time share most loads."""
    apart()
    lanes = count(x)
    for u in range(rows):
        for place in range(0, long, 4 * lanes):
            j = min(place, long - 4 * lanes)
            a, b = at[u] + j - reach * lanes, at[to + u] + j
            common, other = load(x, a + 3 * lanes), load(x, a + 4 * lanes)
            end = a + (2 * reach + 1) * lanes
            for k in range(a + 5 * lanes, end - lanes, 2 * lanes):
                common, other = least(common, load(x, k)), least(other, load(x, k + lanes))
            four_ends(x, common, other, (a, a + lanes, a + 2 * lanes), (end, end + lanes, end + 2 * lanes),
                      (b, b + lanes, b + 2 * lanes, b + 3 * lanes))  # fmt: skip


@nb.njit(cache=True, nogil=True)
def four_ends(x, common, other, before, after, to):  # type: ignore[no-untyped-def]
    """The least of four windows that lie one on the next, from that of what is common to them, and their ends."""
    common = least(common, other)
    second, third = load(x, before[2]), load(x, after[0])
    first, fourth = least(load(x, before[1]), second), least(third, load(x, after[1]))
    store(x, to[0], least(common, least(first, load(x, before[0]))))
    store(x, to[1], least(common, least(first, third)))
    store(x, to[2], least(common, least(second, fourth)))
    store(x, to[3], least(common, least(fourth, load(x, after[2]))))


@nb.njit(cache=True, nogil=True)
def near_down(x, at, to, reach, long, rows):  # type: ignore[no-untyped-def]
    """The same in a column, and four rows at a time."""
    apart()
    lanes, last = count(x), 2 * reach
    for u in range(0, rows, 4):
        a, b, c, d, e, f = at[u], at[u + 1], at[u + 2], at[u + last + 1], at[u + last + 2], at[u + last + 3]
        one, two, three, four, g, h = at[to + u], at[to + u + 1], at[to + u + 2], at[to + u + 3], at[u + 3], at[u + 4]
        for j in range(0, long, lanes):
            common, other = load(x, g + j), load(x, h + j)
            for k in range(u + 5, u + last, 2):
                common, other = least(common, load(x, at[k] + j)), least(other, load(x, at[k + 1] + j))
            four_ends(x, common, other, (a + j, b + j, c + j), (d + j, e + j, f + j),
                      (one + j, two + j, three + j, four + j))  # fmt: skip


@nb.njit(cache=True, nogil=True)
def star(x, at, to, reach, long, rows):  # type: ignore[no-untyped-def]
    """The least of a pixel and the four so far from it along the axes."""
    apart()
    lanes = count(x)
    by = reach * lanes
    for u in range(rows):
        a, b, c, out = at[u], at[u + reach], at[u + 2 * reach], at[to + u]
        for j in range(0, long, lanes):
            found = least(least(load(x, a + j), load(x, b + j)), load(x, c + j))
            store(x, out + j, least(found, least(load(x, b + j - by), load(x, b + j + by))))


@nb.njit(cache=True, nogil=True)
def star_near(x, at, to, long, rows):  # type: ignore[no-untyped-def]
    """The same for neighbours; four rows at a time share loads, and so do neighbours in a row."""
    apart()
    lanes = count(x)
    for u in range(0, rows, 4):
        a, b, c, d, e, f = at[u], at[u + 1], at[u + 2], at[u + 3], at[u + 4], at[u + 5]
        one, two, three, four = at[to + u], at[to + u + 1], at[to + u + 2], at[to + u + 3]
        b_left, c_left, d_left, e_left = load(x, b - lanes), load(x, c - lanes), load(x, d - lanes), load(x, e - lanes)
        b_here, c_here, d_here, e_here = load(x, b), load(x, c), load(x, d), load(x, e)
        for j in range(0, long, lanes):
            k = j + lanes
            b_next, c_next, d_next, e_next = load(x, b + k), load(x, c + k), load(x, d + k), load(x, e + k)
            bc, cd, de = least(b_here, c_here), least(c_here, d_here), least(d_here, e_here)
            store(x, one + j, least(least(bc, load(x, a + j)), least(b_left, b_next)))
            store(x, two + j, least(least(bc, d_here), least(c_left, c_next)))
            store(x, three + j, least(least(cd, e_here), least(d_left, d_next)))
            store(x, four + j, least(least(de, load(x, f + j)), least(e_left, e_next)))
            b_left, c_left, d_left, e_left = b_here, c_here, d_here, e_here
            b_here, c_here, d_here, e_here = b_next, c_next, d_next, e_next


@nb.njit(cache=True, nogil=True)
def square(x, at, to, long, rows):  # type: ignore[no-untyped-def]
    """The least of 3 x 3 pixels; four rows at a time share loads, and so do neighbours in a row."""
    apart()
    lanes = count(x)
    for u in range(0, rows, 4):
        a, b, c, d, e, f = at[u], at[u + 1], at[u + 2], at[u + 3], at[u + 4], at[u + 5]
        one, two, three, four = at[to + u], at[to + u + 1], at[to + u + 2], at[to + u + 3]
        left = columns_of(x, a - lanes, b - lanes, c - lanes, d - lanes, e - lanes, f - lanes)
        here = columns_of(x, a, b, c, d, e, f)
        for j in range(0, long, lanes):
            k = j + lanes
            right = columns_of(x, a + k, b + k, c + k, d + k, e + k, f + k)
            store(x, one + j, least(least(left[0], here[0]), right[0]))
            store(x, two + j, least(least(left[1], here[1]), right[1]))
            store(x, three + j, least(least(left[2], here[2]), right[2]))
            store(x, four + j, least(least(left[3], here[3]), right[3]))
            left, here = here, right


@nb.njit(cache=True, nogil=True)
def columns_of(x, a, b, c, d, e, f):  # type: ignore[no-untyped-def]
    """The least of three pixels of a column, four times, each a row further down."""
    third, fourth = load(x, c), load(x, d)
    upper, lower = least(load(x, b), third), least(fourth, load(x, e))
    return least(load(x, a), upper), least(upper, fourth), least(third, lower), least(lower, load(x, f))


@nb.njit(cache=True, nogil=True)
def in_order(x, a, b, c, d):  # type: ignore[no-untyped-def]
    """Three pixels of a column in order of brightness, three that begin with the second, and the least of each two."""
    one, two, three, four = load(x, a), load(x, b), load(x, c), load(x, d)
    low, high, above, below = least(two, three), most(two, three), least(one, two), least(three, four)
    return ((least(one, low), least(most(one, low), high), most(one, high)),
            (least(four, low), least(most(four, low), high), most(four, high)), (above, low, below))  # fmt: skip


@nb.njit(cache=True, nogil=True)
def middle_of(left, here, right):  # type: ignore[no-untyped-def]
    """The median of three columns, each the least, the middle and the largest of three pixels."""
    a = most(most(left[0], here[0]), right[0])
    b = most(least(left[1], here[1]), least(most(left[1], here[1]), right[1]))
    c = least(least(left[2], here[2]), right[2])
    return most(least(a, b), least(most(a, b), c))


@nb.njit(cache=True, nogil=True)
def median(x, at, to, corners, long, rows):  # type: ignore[no-untyped-def]
    """The median of 3 x 3, or with corners the brightest patch of 2 x 2 in which a pixel is, if that is more, as a
    negative."""
    apart()
    lanes = count(x)
    for u in range(0, rows, 2):
        a, b, c, d, one, two = at[u], at[u + 1], at[u + 2], at[u + 3], at[to + u], at[to + u + 1]
        left, here = in_order(x, a - lanes, b - lanes, c - lanes, d - lanes), in_order(x, a, b, c, d)
        before = patches(left[2], here[2])
        for j in range(0, long, lanes):
            k = j + lanes
            right = in_order(x, a + k, b + k, c + k, d + k)
            first, second = middle_of(left[0], here[0], right[0]), middle_of(left[1], here[1], right[1])
            if corners:
                after = patches(here[2], right[2])
                common = most(before[1], after[1])
                first = most(first, most(common, most(before[0], after[0])))
                second = most(second, most(common, most(before[2], after[2])))
                before = after
            store(x, one + j, negative(first))
            store(x, two + j, negative(second))
            left, here = here, right


@nb.njit(cache=True, nogil=True)
def patches(left, right):  # type: ignore[no-untyped-def]
    """The least of 2 x 2 pixels, three times, from the least of each two in two columns."""
    return least(left[0], right[0]), least(left[1], right[1]), least(left[2], right[2])


@nb.njit(cache=True, nogil=True)
def outlines(x, at, guide, diamond, to, long, rows):  # type: ignore[no-untyped-def]
    """The opening by an octagon, grown by a cross under the guide, or the one by a diamond; all are negatives."""
    apart()
    lanes = count(x)
    for u in range(rows):
        up, here, below, under, tilted = at[u], at[u + 1], at[u + 2], at[guide + u], at[diamond + u]
        for j in range(0, long, lanes):
            found = least(load(x, here + j - lanes), load(x, here + j + lanes))
            found = least(found, least(load(x, up + j), load(x, below + j)))
            found = least(most(found, load(x, under + j)), load(x, here + j))
            store(x, at[to + u] + j, least(found, load(x, tilted + j)))


@nb.njit(cache=True, nogil=True)
def turned(x, at, step, to, stride, length):  # type: ignore[no-untyped-def]
    """A row into parts side by side, or back; rows of squares, which may overlap, in this many places, and a few one by
    one."""
    apart()
    lanes = count(x)
    few = length % lanes if length > lanes and length % lanes <= FEW else 0
    for first in range(0, length - few, lanes):
        j = max(min(first, length - few - lanes), 0)
        if stride == lanes:
            turn(x, at + j, step, to + j * lanes, stride)
        else:
            turn(x, at + j * lanes, step, to + j, stride)
    for j in range(length - few, length):
        for part in range(lanes):
            if stride == lanes:
                x[to + j * lanes + part] = x[at + part * step + j]
            else:
                x[to + part * stride + j] = x[at + j * lanes + part]


@nb.njit(cache=True, nogil=True)
def taken(row, x, at):  # type: ignore[no-untyped-def]
    """A row into the array."""
    apart()
    out = x[at : at + row.size]
    for j in range(row.size):
        out[j] = row[j]


@nb.njit(cache=True, nogil=True)
def given(x, at, out):  # type: ignore[no-untyped-def]
    """The negative of a row of the array."""
    apart()
    row = x[at : at + out.size]
    for j in range(out.size):
        out[j] = -row[j]


@nb.njit(cache=True, nogil=True)
def widen(x, at, to, long, part, last, by, rows):  # type: ignore[no-untyped-def]
    """Beyond the ends of the parts put the next part, and beyond those of the row its first and its last pixel, which
    is in this part and place."""
    apart()
    lanes = count(x)
    for u in range(rows):
        row = at[to + u]
        one, end = load(x, row), row + last + part
        for j in range(row - lanes, row - (by + 1) * lanes, -lanes):
            store(x, j, before(load(x, j + long), one))
        for j in range(end + lanes, min(end + (by + 1) * lanes, row + long + part), lanes):
            x[j] = x[end]
        for j in range(row + long, row + long + by * lanes, lanes):
            store(x, j, behind(load(x, j - long), x[end], part))


@nb.njit(cache=True, nogil=True)
def look(at, to, row, rows, height, newest, slot, first, keep, line):  # type: ignore[no-untyped-def]
    """Where so many rows of a step lie, from this one on; beyond the first and the last row is that row again."""
    place = slot - newest + min(max(row, 0), height - 1)
    place += keep if place < 0 else 0
    here, size = first + place * line, keep * line
    if row >= 0 and row + rows <= height:
        for r in range(rows):
            at[to + r] = here - (size if here >= first + size else 0)
            here += line
        return
    for r in range(row, row + rows):
        at[to + r - row] = here - (size if here >= first + size else 0)
        here += line if 0 <= r < height - 1 else 0


@nb.njit(cache=True, nogil=True, inline="always")
def work(x, at, to, some, kind, reach, long, rows):  # type: ignore[no-untyped-def]
    """What a step does, but the first; rows of what it looks at are so many places apart in `at`."""
    if kind == STAR and reach == 1:
        star_near(x, at, to, long, rows)
    elif kind == STAR:
        star(x, at, to, reach, long, rows)
    elif kind == ACROSS:
        near_across(x, at, to, reach, long, rows)
    elif kind == DOWN:
        near_down(x, at, to, reach, long, rows)
    elif kind in (MEDIAN, CORNERS):
        median(x, at, to, kind == CORNERS, long, rows)
    elif kind == SQUARE:
        square(x, at, to, long, rows)
    elif kind == OUTLINES:
        outlines(x, at, some, 2 * some, to, long, rows)
    elif kind in (ACROSS3, ACROSS5):
        across(x, at, to, reach, kind == ACROSS5, long, rows)
    else:
        down(x, at, to, reach, kind == DOWN5, long, rows)


@nb.njit(cache=True, nogil=True)
def room(steps, band):  # type: ignore[no-untyped-def]
    """Numbers for all rows that are kept, where those of each step begin, the length of its rows, and room for one."""
    lanes = BYTES // band.itemsize
    length = max(-(-band.shape[1] // lanes), 4)
    lines = ((max(length, lanes) + 2 * steps.widen) | 1) * lanes  # odd in vectors: a cache keeps few a power of 2 apart
    ends = np.cumsum(steps.keep * lines)
    x = np.empty(ends[-1] + length * lanes + lanes * lanes, band.dtype)
    origin = (-(x.ctypes.data // band.itemsize)) % lanes  # rows begin where lines of the cache do
    return x, origin + ends - steps.keep * lines + steps.widen * lanes, lines, origin + ends[-1], length


@nb.njit(cache=True, nogil=True)
def run(band, steps, corner, level, outline):  # type: ignore[no-untyped-def]
    """All steps on all rows of a band; `steps` is `deglint.compensate.opening.Steps`.

    level and outline, which begin at this corner of the band, are written; minus the largest number where nothing is
    within reach.
    """
    (height, width), (top, left) = band.shape, corner
    x, first, lines, spare, length = room(steps, band)
    lanes = count(x)
    long, part, last = length * lanes, (width - 1) // length, (width - 1) % length * lanes
    newest, slot = np.full(len(first), -1), np.full(len(first), -1)
    rows = steps.at_once
    some = 3 * rows + 4 * steps.reach.max()
    at, to = np.empty(4 * some, np.int64), 3 * some
    for now in range(0, height + steps.behind.max(), rows):
        for n in range(len(first)):
            i, kind, keep = now - steps.behind[n], steps.kind[n], steps.keep[n]
            if i + rows <= 0 or i >= height:
                continue
            for k in range(steps.sources[n]):
                s = steps.source[n, k]
                look(at, k * some, i - steps.up[n, k], steps.rows[n, k], height, newest[s], slot[s], first[s],
                     steps.keep[s], lines[s])  # fmt: skip
            newest[n] = i + rows - 1
            slot[n] = slot[n] + rows - (keep if slot[n] + rows >= keep else 0)
            for u in range(rows):
                back = slot[n] - rows + 1 + u
                at[to + u] = first[n] + (back if back >= 0 else back + keep) * lines[n]
            if kind == INPUT:
                for u in range(max(-i, 0), min(rows, height - i)):
                    taken(band[i + u], x, spare)
                    turned(x, spare, length, at[to + u], lanes, length)
            else:
                work(x, at, to, some, kind, steps.reach[n], long, rows)
            if steps.widen[n]:
                widen(x, at, to, long, part, last, steps.widen[n], rows)
            if n == steps.level or kind == OUTLINES:
                out = level if n == steps.level else outline
                for u in range(max(top - i, 0), min(rows, top + len(out) - i)):
                    turned(x, at[to + u], lanes, spare, length, length)
                    given(x, spare + left, out[i + u - top])


@nb.njit(cache=True, nogil=True)
def lay(band, corners, wide, out):  # type: ignore[no-untyped-def]
    """Squares of a band side by side, row by row."""
    across = out.shape[1] // wide
    for k in range(len(corners)):
        top, left, row, column = corners[k, 0], corners[k, 1], k // across * wide, k % across * wide
        for i in range(wide):
            out[row + i, column : column + wide] = band[top + i, left : left + wide]


@nb.njit(cache=True, nogil=True)
def pick(laid, corners, halo, side, out):  # type: ignore[no-untyped-def]
    """What lies within the halo of each, back to where it belongs."""
    wide = side + 2 * halo
    across = laid.shape[1] // wide
    for k in range(len(corners)):
        top, left, row, column = corners[k, 0], corners[k, 1], k // across * wide + halo, k % across * wide + halo
        for i in range(side):
            out[top + i, left : left + side] = laid[row + i, column : column + side]
