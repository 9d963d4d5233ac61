"""The compiled inner loop of `detect.local`: moments of every pixel's ring, and the distance of the pixel from them.

Sums over a window are made of two runs, one to the end of a block and one from its start (van Herk 1992): blocks are
as long as the window and lie at multiples of it in the scene. So a sum holds the pixels of its window and no others,
nothing is ever taken away again, the cost does not depend on the window, and any tiling gives the same bits.
The ring is the sum of four bars around the guard, not a difference of two squares.

References
----------
van Herk (1992), "A fast algorithm for local minimum and maximum filters on rectangular and octagonal kernels", Pattern
Recognition Letters 13, 517-521, doi:10.1016/0167-8655(92)90069-C.
"""

import numpy as np
from numba import njit

# The same additions in the same order for every pixel, wherever its block lies; only a multiplication may be merged
# with the addition that follows it.
_SAME = {"contract"}
DONE, DEFICIENT, ASIDE = 0, 1, 255
WIDTH = 32  # pixels whose covariances are factored side by side: they stay in the first-level cache
LANES = 8  # channels that are added side by side along a row: one vector, or two
EPS = 2.220446049250313e-16


@njit(nogil=True, cache=True, fastmath=_SAME)
def _put_row(x, known, p, source, target):  # type: ignore[no-untyped-def]
    """target = source + count, values and products of padded row p; (channel, column) arrays, not the same."""
    bands, columns = x.shape[1], x.shape[2]
    for c in range(columns):
        target[0, c] = source[0, c] + known[p, c]
    k = 1 + bands
    for i in range(bands):
        for c in range(columns):
            target[1 + i, c] = source[1 + i, c] + x[p, i, c]
        for j in range(i + 1):
            for c in range(columns):
                target[k, c] = source[k, c] + x[p, i, c] * x[p, j, c]
            k += 1


@njit(nogil=True, cache=True, fastmath=_SAME)
def _add_row(x, known, p, target):  # type: ignore[no-untyped-def]
    """The same, in place."""
    bands, columns = x.shape[1], x.shape[2]
    for c in range(columns):
        target[0, c] += known[p, c]
    k = 1 + bands
    for i in range(bands):
        for c in range(columns):
            target[1 + i, c] += x[p, i, c]
        for j in range(i + 1):
            for c in range(columns):
                target[k, c] += x[p, i, c] * x[p, j, c]
            k += 1


@njit(nogil=True, cache=True)
def _down(x, known, start, width, place, fresh, suffix, prefix, out):  # type: ignore[no-untyped-def]
    """Sums of the rows start..start+width-1 for every column; called for one start after the other.

    `place` is the start's place in its block; `fresh` for the first start of all. The last of `suffix` stays 0.
    """
    if place == 0 or fresh:
        for i in range(width - 1, place - 1, -1):
            _put_row(x, known, start + i - place, suffix[i + 1], suffix[i])
        prefix[:] = 0.0
        for p in range(start + width - place, start + width - 1):
            _add_row(x, known, p, prefix)
    channels, columns = out.shape
    if place == 0:
        for q in range(channels):
            for c in range(columns):
                out[q, c] = suffix[0, q, c]
        return
    _add_row(x, known, start + width - 1, prefix)
    for q in range(channels):
        for c in range(columns):
            out[q, c] = suffix[place, q, c] + prefix[q, c]


@njit(nogil=True, cache=True)
def _runs(values, width, place0, to_end, from_start):  # type: ignore[no-untyped-def]
    """Sums along a row from each column to the end of its block, and from the block's start to each column.

    (column, lane) arrays: some channels are added side by side.
    """
    columns = values.shape[0]
    for c in range(columns):
        if c == 0 or (place0 + c) % width == 0:
            for q in range(LANES):
                from_start[c, q] = values[c, q]
        else:
            for q in range(LANES):
                from_start[c, q] = from_start[c - 1, q] + values[c, q]
    for c in range(columns - 1, -1, -1):
        if c == columns - 1 or (place0 + c + 1) % width == 0:
            for q in range(LANES):
                to_end[c, q] = values[c, q]
        else:
            for q in range(LANES):
                to_end[c, q] = to_end[c + 1, q] + values[c, q]


@njit(nogil=True, cache=True)
def _windows(values, width, place0, to_end, from_start, sums):  # type: ignore[no-untyped-def]
    """Sums of columns c..c+width-1 for every c where they are all there."""
    _runs(values, width, place0, to_end, from_start)
    for c in range(values.shape[0] - width + 1):
        if (place0 + c) % width == 0:
            for q in range(LANES):
                sums[c, q] = to_end[c, q]
        else:
            last = c + width - 1
            for q in range(LANES):
                sums[c, q] = to_end[c, q] + from_start[last, q]


@njit(nogil=True, cache=True, fastmath=_SAME)
def _less_earlier(rings, i, k, first, count, root, z, work):  # type: ignore[no-untyped-def]
    """Row i of the Cholesky factor, and what the bands before it leave of the pixel and of the pivot."""
    mean, rest, pivot, entry = work[0], work[1], work[3], work[4]
    for j in range(i):
        for c in range(count):
            entry[c] = rings[k + j, first + c] - mean[c] * rings[1 + j, first + c]
        for m in range(j):
            for c in range(count):
                entry[c] -= root[i, m, c] * root[j, m, c]
        for c in range(count):
            a = entry[c] * root[j, j, c]
            root[i, j, c] = a
            rest[c] -= a * z[j, c]
            pivot[c] -= a * a


@njit(nogil=True, cache=True, fastmath=_SAME, error_model="numpy")
def _distances(rings, x, first, count, ddof, ridge, root, z, work, total, states):  # type: ignore[no-untyped-def]
    """Squared Mahalanobis distances of some columns of x from their rings' moments, and how each was found.

    DONE; DEFICIENT: without bands that follow from others in the ring, as they do in x; ASIDE: not to be told from
    these moments. A pivot is lost where it is below `exact`, and inexact below `near`, times the sum of squares that
    it was taken from.
    """
    bands = x.shape[0]
    exact = 32.0 * bands * EPS
    near = 1e3 * exact
    mean, rest, away, pivot = work[0], work[1], work[2], work[3]
    for c in range(count):
        total[c] = 0.0
        states[c] = ASIDE if rings[0, first + c] <= bands else DONE
    k = 1 + bands
    for i in range(bands):
        for c in range(count):
            mean[c] = rings[1 + i, first + c] / rings[0, first + c]
            away[c] = x[i, first + c] - mean[c]
            rest[c] = away[c]
            pivot[c] = (rings[k + i, first + c] - mean[c] * rings[1 + i, first + c]) * (1.0 + ridge)
        _less_earlier(rings, i, k, first, count, root, z, work)
        for c in range(count):
            square = rings[k + i, first + c]
            if pivot[c] > near * square:
                scale = 1.0 / np.sqrt(pivot[c])
                root[i, i, c] = scale
                z[i, c] = rest[c] * scale
                total[c] += z[i, c] * z[i, c]
                continue
            root[i, i, c] = 0.0
            z[i, c] = 0.0
            slack = 100.0 * exact * (square / rings[0, first + c] + away[c] * away[c])
            if pivot[c] > exact * square or not rest[c] * rest[c] <= slack:
                states[c] = ASIDE
            elif states[c] != ASIDE:
                states[c] = DEFICIENT
        k += i + 1
    for c in range(count):
        total[c] *= rings[0, first + c] - ddof


@njit(nogil=True, cache=True)
def _rings(above, below, middle, origin, inner, bar, lanes, rings):  # type: ignore[no-untyped-def]
    """Sums over the rings of a row: the bars above and below the guard, and beside it; (channel, column) arrays."""
    channels, padded = above.shape
    apart = bar + inner
    values, to_end, from_start, ends, sides = lanes[0], lanes[1], lanes[2], lanes[3], lanes[4]
    for first in range(0, channels, LANES):
        count = min(LANES, channels - first)
        for q in range(count):
            for c in range(padded):
                values[c, q] = above[first + q, c] + below[first + q, c]
        _windows(values, inner + 2 * bar, origin, to_end, from_start, ends)
        for q in range(count):
            for c in range(padded):
                values[c, q] = middle[first + q, c]
        _windows(values, bar, origin, to_end, from_start, sides)
        for q in range(count):
            for c in range(rings.shape[1]):
                rings[first + q, c] = ends[c, q] + (sides[c, q] + sides[c + apart, q])


@njit(nogil=True, cache=True)
def ring_scores(x, known, origin, inner, outer, ddof, ridge, scores, states):  # type: ignore[no-untyped-def]
    """Score a block against rings: `inner` is the guard's side, `outer` the window's.

    x, known : (rows + outer - 1, bands, columns + outer - 1), 0 where not valid; and 1 where valid, both float64
    origin : row and column of the padded block's first pixel in the scene, not negative
    scores, states : (rows, columns), filled where the pixel is valid; states 255 are left to the caller
    """
    rows, columns = scores.shape
    bands, padded = x.shape[1], x.shape[2]
    half, bar = outer // 2, (outer - inner) // 2
    channels = 1 + bands + bands * (bands + 1) // 2
    bar_suffix, bar_prefix = np.zeros((bar + 1, channels, padded)), np.empty((channels, padded))
    mid_suffix, mid_prefix = np.zeros((inner + 1, channels, padded)), np.empty((channels, padded))
    apart = bar + inner  # rows from the bar above the guard to the one below
    bars, middle = np.empty((apart + 1, channels, padded)), np.empty((channels, padded))
    lanes, rings = np.zeros((5, padded, LANES)), np.empty((channels, columns))
    root, z, work = np.zeros((bands, bands, WIDTH)), np.empty((bands, WIDTH)), np.empty((5, WIDTH))
    total, state = np.empty(WIDTH), np.empty(WIDTH, np.uint8)
    for k in range(rows + apart):
        place = (origin[0] + k) % bar
        _down(x, known, k, bar, place, k == 0, bar_suffix, bar_prefix, bars[k % (apart + 1)])
        r = k - apart
        if r < 0:
            continue
        start = r + bar
        _down(x, known, start, inner, (origin[0] + start) % inner, r == 0, mid_suffix, mid_prefix, middle)
        above, below = bars[r % (apart + 1)], bars[k % (apart + 1)]
        _rings(above, below, middle, origin[1], inner, bar, lanes, rings)
        row = x[r + half, :, half : half + columns]
        for first in range(0, columns, WIDTH):
            count = min(WIDTH, columns - first)
            _distances(rings, row, first, count, ddof, ridge, root, z, work, total, state)
            for c in range(count):
                if known[r + half, half + first + c] > 0:
                    scores[r, first + c] = total[c]
                    states[r, first + c] = state[c]
