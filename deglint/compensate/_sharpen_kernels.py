"""Compiled: correlation with sums of columns times rows, and Richardson-Lucy on top of it, eight rows at a time.

A row is kept as 16 parts side by side (`LANES`): number j of part l is number 16 j + l in memory. So the neighbour in
the row lies 16 numbers away, as the neighbour in the column lies a row away, and both are loaded as whole vectors. What
lies beyond the ends of a part is the next part, one number further. Every pixel goes through the same operations on
vectors (`deglint.compensate._lanes`, `_sums`), wherever it lies: a tile gives what the whole gives, to the bit.

All half iterations run side by side, each `radius` rows behind the one before it; of each only the rows that are still
needed are kept, so that they stay in the processor's cache: row i of the image with its margins is row i modulo `depth`
of a ring. All that is kept is in one array, x, as each array that a compiled function is given costs time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .. import jit as nb
from ._apart import apart
from ._lanes import LANES, ahead, fused, if_more, if_same, larger, load, over, plus, smaller, spread, store, times, turn
from ._sums import GROUP, across_sums, down_sums

LEAST_RATIO, MOST_RATIO = np.float32(1e-3), np.float32(1e3)
"""The ratio of what is seen to what is predicted is kept within these; and no share of a kernel counts below."""
NEXT_TO_NOTHING = np.float32(1e-30)
"""What is not positive is taken as this."""
ZERO, ONE, MINUS, NONE, LOWEST = (np.float32(x) for x in (0, 1, -1, np.nan, -np.inf))
PLAIN, SHARE, RATIO, CHANGE = (np.int64(x) for x in range(4))
"""What becomes of a correlation; numbers of this type are not compiled for one by one."""
STEP = 8
"""Rows that a stage makes at a time: the more, the less often a row is loaded, and the more of them are kept."""
TAPS, MID, LINE = 0, 1, 1 + 2 * STEP
"""Rows of x: all taps, (2, 2, product, tap) as in `Products`; rows correlated with two columns; a row as it stands."""


class Plan(NamedTuple):
    """Where things lie in x, (row, column) float32; rings by their first row and their depth."""

    radius: int
    products: int
    stages: int
    pitch: int  # columns of x
    long: int  # numbers in a row of the image
    seen: tuple[int, int]
    valid: tuple[int, int]
    shares: tuple[int, int]  # that of the transpose follows where kernels are lopsided
    kept: tuple[int, int]  # one for each stage


def plan_for(wide: int, radius: int, products: int, stages: int, some: bool, lopsided: bool) -> tuple[Plan, int]:
    """The plan for so many columns, and how many rows x has."""
    length = max(-(-max(wide, 4 * products * (2 * radius + 1)) // LANES), LANES)  # taps are to fit, too
    length += -length % GROUP if products > 2 else 0  # what is added to may not be done twice
    pitch = (length + 2 * radius | 1) * LANES  # odd in vectors: a cache keeps few rows a power of two apart
    seen, share, kept = max(stages - 1, 2) * radius + STEP, (stages - 1) * radius + STEP, 2 * radius + STEP
    valid = LINE + 1 + seen
    shares = valid + seen * some
    stage = shares + share * some * (1 + lopsided)
    rings = (LINE + 1, seen), (valid, seen), (shares, share), (stage, kept)
    return Plan(radius, products, stages, pitch, length * LANES, *rings), stage + stages * kept


@nb.njit(cache=True, nogil=True)
def place(plan, ring, i):  # type: ignore[no-untyped-def]
    """Where row i lies in a ring of rows."""
    return (ring[0] + i % ring[1]) * plan.pitch


@nb.njit(cache=True, nogil=True)
def after(plan, ring, at):  # type: ignore[no-untyped-def]
    """Where the row after one lies."""
    return at + plan.pitch if at < (ring[0] + ring[1] - 1) * plan.pitch else ring[0] * plan.pitch


@nb.njit(cache=True, nogil=True)
def down(x, at, plan, source, i, k, lopsided):  # type: ignore[no-untyped-def]
    """Rows i to i + STEP - 1 of a ring correlated with two columns, tap k the middle of the first, with margins."""
    radius, pitch, long, mid = plan.radius, plan.pitch, plan.long, MID * plan.pitch
    count, margin = 2 * radius + 1, radius * LANES
    at[0] = place(plan, source, i - radius)
    for t in range(1, count + STEP - 1):
        at[t] = after(plan, source, at[t - 1])
    for j in range(0, long, LANES):
        for u in range(0, STEP, GROUP):
            for v, total in enumerate(down_sums(x, at, u + radius, j, k, k + count, radius, lopsided)):
                store(x, mid + (v // GROUP * STEP + v % GROUP + u) * pitch + margin + j, total)
    for far, by in ((margin + long, 1 - long), (0, long - 1)):  # beyond the ends of the parts: the next part
        for row in range(mid + far, mid + far + 2 * STEP * pitch, pitch):
            for j in range(row, row + margin, LANES):
                store(x, j, load(x, j + by))


@nb.njit(cache=True, nogil=True)
def half(x, at, plan, source, i, transpose, p, lopsided, mode, some, beside, share, out):  # type: ignore[no-untyped-def]
    """Rows i to i + STEP - 1 of the correlation of a ring with products p and p + 1 of P or its transpose, added to
    those before, and what becomes of it after the last."""
    apart()
    radius, count, pitch, other = plan.radius, 2 * plan.radius + 1, plan.pitch, STEP * plan.pitch
    mid, last = MID * pitch + radius * LANES, p + 2 == plan.products
    k = TAPS * pitch + (2 * transpose * plan.products + p) * count + radius
    n = k + plan.products * count
    down(x, at, plan, source, i, k, lopsided)
    to, near = place(plan, out, i), place(plan, beside, i)
    part, mark = place(plan, share, i), place(plan, plan.valid, i)
    for m in range(mid, mid + other, pitch):
        for first in range(0, plan.long, GROUP * LANES):
            j = min(first, plan.long - GROUP * LANES)
            for v, total in enumerate(across_sums(x, m + j, m + j + other, n, n + count, radius, lopsided)):
                w = j + v * LANES
                if p > 0:
                    total = plus(load(x, to + w), total)
                if some and last and mode != SHARE:
                    total = times(total, load(x, part + w))
                if mode == RATIO and last:
                    total = over(load(x, near + w), larger(total, spread(NEXT_TO_NOTHING)))
                    total = smaller(larger(total, spread(LEAST_RATIO)), spread(MOST_RATIO))
                    total = times(total, load(x, mark + w)) if some else total
                elif mode == CHANGE and last:
                    total = times(load(x, near + w), larger(total, spread(LEAST_RATIO)))
                store(x, to + w, total)
        to, near = after(plan, out, to), after(plan, beside, near)
        part, mark = after(plan, share, part), after(plan, plan.valid, mark)


@nb.njit(cache=True, nogil=True)
def along(x, k, radius, lopsided, value):  # type: ignore[no-untyped-def]
    """Correlation of even numbers with one column or row, the middle of which is tap k."""
    total = times(spread(x[TAPS, k]), value)
    for t in range(1, radius + 1):
        if lopsided is None:
            total = fused(spread(x[TAPS, k + t]), plus(value, value), total)
        else:
            total = fused(spread(x[TAPS, k + t]), value, fused(spread(x[TAPS, k - t]), value, total))
    return total


@nb.njit(cache=True, nogil=True)
def invert(x, plan, ring, i, transpose, lopsided):  # type: ignore[no-untyped-def]
    """One over shares, in rows i to i + STEP - 1: exactly 1 for a whole one; 1, or NaN, for next to none."""
    apart()
    radius, count, far = plan.radius, 2 * plan.radius + 1, plan.products * (2 * plan.radius + 1)
    one, little, whole = spread(ONE), spread(ONE if plan.stages > 1 else NONE), spread(ZERO)
    k = 2 * transpose * far + radius
    for _ in range(0, plan.products, 2):  # what is whole, by the operations that a pixel goes through
        a = along(x, k + far, radius, lopsided, along(x, k, radius, lopsided, one))
        b = along(x, k + far + count, radius, lopsided, along(x, k + count, radius, lopsided, one))
        whole = plus(whole, plus(a, b))
        k += 2 * count
    to = place(plan, ring, i)
    for _ in range(STEP):
        for j in range(to, to + plan.long, LANES):
            share = load(x, j)
            found = if_more(share, spread(LEAST_RATIO), over(one, share), little)
            store(x, j, if_same(share, whole, one, found))
        to = after(plan, ring, to)


@nb.njit(cache=True, nogil=True)
def mirrored(i, count):  # type: ignore[no-untyped-def]
    """Index of what lies at i where an image is mirrored at its ends, which are not repeated."""
    if count == 1:
        return 0
    i = abs(i) % (2 * count - 2)
    return i if i < count else 2 * count - 2 - i


@nb.njit(cache=True, nogil=True)
def read(band, row, left, wide, x, plan):  # type: ignore[no-untyped-def]
    """A row of the band from column `left` on, mirrored at its ends."""
    columns = band.shape[1]
    first, last = min(max(-left, 0), wide), max(min(columns - left, wide), 0)
    fit = first + max(last - first, 0) // LANES * LANES
    for j in range(first, fit, LANES):
        store(x, LINE * x.shape[1] + j, load(band, row * columns + left + j))
    for j in range(first):
        x[LINE, j] = band[row, mirrored(left + j, columns)]
    for j in range(fit, plan.long):
        x[LINE, j] = band[row, mirrored(left + j, columns)] if j < wide else ONE


@nb.njit(cache=True, nogil=True)
def parted(line, at, x, to, long):  # type: ignore[no-untyped-def]
    """A row as parts side by side."""
    length = long // LANES
    for j in range(0, length, LANES):
        j = min(j, length - LANES)
        turn(line, at + j, length, x, to + j * LANES, LANES)


@nb.njit(cache=True, nogil=True)
def enter(band, top, left, high, wide, rise, x, plan, i, some):  # type: ignore[no-untyped-def]
    """Rows i to i + STEP - 1 come in: raised, nowhere too little, 0 where not valid."""
    apart()
    least, none, one = spread(NEXT_TO_NOTHING if plan.stages > 1 else LOWEST), spread(ZERO), spread(ONE)
    for u in range(i, min(i + STEP, high)):
        row, to, mark = mirrored(top + u, len(band)), place(plan, plan.seen, u), place(plan, plan.valid, u)
        at = row * band.shape[1] + left
        for j in range(at, at + wide, LANES):
            ahead(band, j + STEP * band.shape[1])
        if left >= 0 and left + wide <= band.shape[1] and at + plan.long <= band.size:
            parted(band, at, x, to, plan.long)
        else:
            read(band, row, left, wide, x, plan)
            parted(x, LINE * plan.pitch, x, to, plan.long)
        for j in range(0, plan.long if some or plan.stages > 1 else 0, LANES):
            value = load(x, to + j)
            fine = larger(plus(value, spread(rise)), least)
            if some:
                known = if_same(fused(value, spread(MINUS), value), none, one, none)
                fine = if_same(known, one, fine, none)
                store(x, mark + j, known)
            store(x, to + j, fine)


@nb.njit(cache=True, nogil=True)
def leave(x, plan, ring, first, last, fall, out, begin, end):  # type: ignore[no-untyped-def]
    """Rows of the last stage go out, lowered."""
    apart()
    line, length, halo = LINE * plan.pitch, plan.long // LANES, plan.stages * plan.radius
    fit = (end - begin) // LANES * LANES  # and the rest one by one: beyond it is the next row
    for i in range(first, last):
        at, to = place(plan, ring, i), (i - halo) * out.shape[1] + begin
        for j in range(0, length, LANES):
            j = min(j, length - LANES)
            turn(x, at + j * LANES, LANES, x, line + j, length)
        for j in range(0, fit, LANES):
            ahead(out, to + j + STEP * out.shape[1])
            store(out, to + j, plus(load(x, line + halo + j), spread(fall)))
        for j in range(fit, end - begin):
            out[i - halo, begin + j] = x[LINE, halo + j] + fall


@nb.njit(cache=True, nogil=True)
def sharpen(band, top, left, pedestal, x, plan, lopsided, some, out, begin, end):  # type: ignore[no-untyped-def]
    """Richardson-Lucy, all half iterations side by side; or, planned for one stage, the correlation alone.

    band : (row, column) float32, mirrored at its edges; top, left : of the margins in it; lopsided : None where taps
    are the same from either end; some : not all is finite; out : columns begin to end - 1 of what is within the margins
    """
    radius, stages, at = plan.radius, plan.stages, np.empty(2 * plan.radius + STEP, np.int64)
    halo, shares = stages * radius, 1 if lopsided is None else 2
    high, wide = len(out) + 2 * halo, end - begin + 2 * halo
    for g in range(0, high, STEP):
        enter(band, top, left + begin, high, wide, pedestal, x, plan, g, some)
        for b in range(shares if some else 0):
            share = plan.shares[0] + b * plan.shares[1], plan.shares[1]
            for p in range(0, plan.products, 2):
                half(x, at, plan, plan.valid, g - radius, b, p, lopsided, SHARE, some, plan.valid, share, share)
            invert(x, plan, share, g - radius, b, lopsided)
        before, source = plan.seen, plan.seen
        for s in range(stages):
            i, ring = g - (s + 1) * radius, (plan.kept[0] + s * plan.kept[1], plan.kept[1])
            share = plan.shares[0] + s % shares * plan.shares[1], plan.shares[1]
            if g + STEP > 2 * (s + 1) * radius:  # else no row has all it needs
                mode, beside = (CHANGE, before) if s % 2 else (RATIO if stages > 1 else PLAIN, plan.seen)
                for p in range(0, plan.products, 2):
                    half(x, at, plan, source, i, s % 2, p, lopsided, mode, some, beside, share, ring)
            before, source = ring if s % 2 else before, ring
        if g + STEP > 2 * halo:
            leave(x, plan, source, max(g - halo, halo), min(g + STEP - halo, high - halo), -pedestal, out, begin, end)
