"""Compiled: openings of a band, all of them in one pass over its rows.

An opening is a row of small steps, each of which takes the least of three or five pixels of the step before; the
median and the combinations are steps, too (`deglint.compensate.opening` writes them down). All steps run side by
side, each some rows behind those it looks at, so that what they pass on stays in the processor's cache. A dilation is
the erosion of the negative: from the median on, steps hold negatives, and the least is all that is ever looked for.

Any type of number will do, of which `nothing` is the largest and stands for a pixel that is not valid: no erosion takes
it, and as a negative no dilation. Numbers of 16 bits (`deglint.compensate.codes`) take half the time of float32.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from ._apart import apart

LANES = 32
"""Rows are worked on in so many columns at a time, some of them beyond the edge."""
INPUT, LEAST, MEDIAN, CORNERS, OUTLINES = range(5)
"""Kinds of steps."""


@nb.njit(cache=True, nogil=True)
def least3(rows, a, b, c, to, width):  # type: ignore[no-untyped-def]
    """The least of three pixels; all are places in one array."""
    apart()
    x, y, z, out = rows[a : a + width], rows[b : b + width], rows[c : c + width], rows[to : to + width]
    for j in range(width):
        least = x[j] if x[j] < y[j] else y[j]
        out[j] = least if least < z[j] else z[j]


@nb.njit(cache=True, nogil=True)
def least5(rows, a, b, c, d, e, to, width):  # type: ignore[no-untyped-def]
    """The least of five pixels."""
    apart()
    x, y, z, out = rows[a : a + width], rows[b : b + width], rows[c : c + width], rows[to : to + width]
    v, w = rows[d : d + width], rows[e : e + width]
    for j in range(width):
        one = x[j] if x[j] < y[j] else y[j]
        two = v[j] if v[j] < w[j] else w[j]
        one = one if one < two else two
        out[j] = one if one < z[j] else z[j]


@nb.njit(cache=True, nogil=True)
def in_order(rows, a, b, c, to, apart_by, width):  # type: ignore[no-untyped-def]
    """Three rows in order of brightness, into three rows."""
    apart()
    x, y, z = rows[a : a + width], rows[b : b + width], rows[c : c + width]
    low, middle = rows[to : to + width], rows[to + apart_by : to + apart_by + width]
    high = rows[to + 2 * apart_by : to + 2 * apart_by + width]
    for j in range(width):
        less, more = (x[j], y[j]) if x[j] < y[j] else (y[j], x[j])
        most = more if more > z[j] else z[j]
        more = z[j] if more > z[j] else more
        low[j], middle[j] = (less, more) if less < more else (more, less)
        high[j] = most


@nb.njit(cache=True, nogil=True)
def median9(rows, at, apart_by, to, width, nothing):  # type: ignore[no-untyped-def]
    """The median of three by three pixels from rows in order, as a negative."""
    apart()
    low, middle = rows[at - 1 : at + width + 1], rows[at + apart_by - 1 : at + apart_by + width + 1]
    high, out = rows[at + 2 * apart_by - 1 : at + 2 * apart_by + width + 1], rows[to : to + width]
    for j in range(width):
        x, y, z = low[j], low[j + 1], low[j + 2]
        a = x if x > y else y
        a = a if a > z else z
        x, y, z = middle[j], middle[j + 1], middle[j + 2]
        less, more = (x, y) if x < y else (y, x)
        more = more if more < z else z
        b = less if less > more else more
        x, y, z = high[j], high[j + 1], high[j + 2]
        c = x if x < y else y
        c = c if c < z else z
        less, more = (a, b) if a < b else (b, a)
        more = more if more < c else c
        more = less if less > more else more
        out[j] = more if more == nothing else -more


@nb.njit(cache=True, nogil=True)
def corners(rows, up, here, to, width, nothing):  # type: ignore[no-untyped-def]
    """No less than the brightest patch of 2 x 2 that a pixel is in; `to` is a negative, the patches are not."""
    apart()
    above, above_left, own = rows[up : up + width], rows[up - 1 : up + width], rows[here : here + width]
    left, out = rows[here - 1 : here + width], rows[to : to + width]
    for j in range(width):
        one = above[j] if above[j] > above_left[j] else above_left[j]
        two = own[j] if own[j] > left[j] else left[j]
        one = one if one > two else two
        least = -one if -one < out[j] else out[j]
        out[j] = nothing if (one == nothing) | (out[j] == nothing) else least


@nb.njit(cache=True, nogil=True)
def outlines(rows, octagon, guide, diamond, out):  # type: ignore[no-untyped-def]
    """The opening by an octagon, grown by a cross under the guide, or the one by a diamond; all are negatives."""
    apart()
    up, here, down = octagon
    width = out.size
    above, own, below = rows[up : up + width], rows[here - 1 : here + width + 1], rows[down : down + width]
    under, tilted = rows[guide : guide + width], rows[diamond : diamond + width]
    for j in range(width):
        most = own[j] if own[j] < own[j + 2] else own[j + 2]
        most = most if most < above[j] else above[j]
        most = most if most < below[j] else below[j]
        most = most if most > under[j] else under[j]
        most = most if most < own[j + 1] else own[j + 1]
        most = most if most < tilted[j] else tilted[j]
        out[j] = -most


@nb.njit(cache=True, nogil=True)
def widen(rows, at, width, by):  # type: ignore[no-untyped-def]
    """Repeat the first and the last pixel of a row beyond its ends."""
    for j in range(by):
        rows[at - 1 - j] = rows[at]
        rows[at + width + j] = rows[at + width - 1]


@nb.njit(cache=True, nogil=True)
def copied(row, out):  # type: ignore[no-untyped-def]
    """A row into another."""
    apart()
    for j in range(out.size):
        out[j] = row[j]


@nb.njit(cache=True, nogil=True)
def negative(row, out):  # type: ignore[no-untyped-def]
    """The negative of a row into another."""
    apart()
    for j in range(out.size):
        out[j] = -row[j]


@nb.njit(cache=True, nogil=True)
def run(band, nothing, steps, corner, level, outline):  # type: ignore[no-untyped-def]
    """All steps on all rows of a band; `steps` is `deglint.compensate.opening.Steps`.

    level and outline, which begin at this corner of the band, are written; -nothing where nothing is within reach.
    """
    count, (height, width), (top, left) = steps.kind.size, band.shape, corner
    margin, wide = -(-(steps.widen.max() + 1) // LANES) * LANES, -(-width // LANES) * LANES
    line = wide + 2 * margin
    rows = np.empty((steps.keep.sum() + 3) * line + LANES, band.dtype)
    newest, slot, at = np.full(count, -1), np.full(count, -1), np.zeros(5, np.int64)
    first = margin + (np.cumsum(steps.keep) - steps.keep) * line
    first += (-(rows.ctypes.data // band.itemsize + margin)) % LANES  # rows begin where lines of the cache do
    spare = first[count - 1] + steps.keep[count - 1] * line
    for now in range(height + steps.behind.max()):
        for n in range(count):
            i, kind = now - steps.behind[n], steps.kind[n]
            if i < 0 or i >= height:
                continue
            for k in range(steps.points[n]):  # beyond the last row is the last row again
                source = steps.source[n, k]
                back = newest[source] - min(max(i + steps.down[n, k], 0), height - 1)
                place = slot[source] - back if slot[source] >= back else slot[source] - back + steps.keep[source]
                at[k] = first[source] + place * line + steps.right[n, k]
            newest[n], slot[n] = i, slot[n] + 1 if slot[n] + 1 < steps.keep[n] else 0
            to, wanted = first[n] + slot[n] * line, top <= i < top + len(level)
            if kind == INPUT:
                copied(band[i], rows[to : to + width])
            elif kind == LEAST and steps.points[n] == 3:
                least3(rows, at[0], at[1], at[2], to, wide)
            elif kind == LEAST:
                least5(rows, at[0], at[1], at[2], at[3], at[4], to, wide)
            elif kind == OUTLINES:
                if wanted:
                    at += left
                    outlines(rows, (at[0], at[1], at[2]), at[3], at[4], outline[i - top])
            else:
                in_order(rows, at[0] - 1, at[1] - 1, at[2] - 1, spare - 1, line, wide + 2)
                median9(rows, spare, line, to, wide, nothing)
                if kind == CORNERS:
                    corners(rows, at[3], at[4], to, wide, nothing)
            if n == steps.level and wanted:
                negative(rows[to + left :], level[i - top])
            widen(rows, to, width, steps.widen[n])
