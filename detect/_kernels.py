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

_CONTRACT = {"contract"}
DONE, DEFICIENT, ASIDE = 0, 1, 255


@njit(nogil=True, cache=True, fastmath=_CONTRACT)
def _add_row(x, good, p, source, target):  # type: ignore[no-untyped-def]
    """target = source + count, values and products of padded row p."""
    columns, bands = x.shape[1], x.shape[2]
    for c in range(columns):
        to, base, v = target[c], source[c], x[p, c]
        if good[p, c]:
            to[0] = base[0] + 1.0
            k = 1 + bands
            for i in range(bands):
                a = v[i]
                to[1 + i] = base[1 + i] + a
                for j in range(i + 1):
                    to[k + j] = base[k + j] + a * v[j]
                k += i + 1
        else:
            for q in range(to.shape[0]):
                to[q] = base[q]


@njit(nogil=True, cache=True)
def _down(x, good, start, width, place, fresh, suffix, prefix, nothing, out):  # type: ignore[no-untyped-def]
    """Sums of the rows start..start+width-1 for every column; called for one start after the other.

    `place` is the start's place in its block; `fresh` for the first start of all.
    """
    if place == 0 or fresh:
        for i in range(width - 1, place - 1, -1):
            _add_row(x, good, start + i - place, nothing if i == width - 1 else suffix[i + 1], suffix[i])
        prefix[:] = 0.0
        for p in range(start + width - place, start + width - 1):
            _add_row(x, good, p, prefix, prefix)
    if place == 0:
        out[:] = suffix[0]
        return
    _add_row(x, good, start + width - 1, prefix, prefix)
    columns, channels = out.shape
    for c in range(columns):
        for q in range(channels):
            out[c, q] = suffix[place, c, q] + prefix[c, q]


@njit(nogil=True, cache=True)
def _runs(values, width, place0, to_end, from_start):  # type: ignore[no-untyped-def]
    """Sums along a row from each column to the end of its block, and from the block's start to each column."""
    columns, channels = values.shape
    for c in range(columns):
        if c == 0 or (place0 + c) % width == 0:
            from_start[c] = values[c]
        else:
            for q in range(channels):
                from_start[c, q] = from_start[c - 1, q] + values[c, q]
    for c in range(columns - 1, -1, -1):
        if c == columns - 1 or (place0 + c + 1) % width == 0:
            to_end[c] = values[c]
        else:
            for q in range(channels):
                to_end[c, q] = to_end[c + 1, q] + values[c, q]


@njit(nogil=True, cache=True)
def _add_window(to_end, from_start, start, width, place, ring):  # type: ignore[no-untyped-def]
    """Add the sums of columns start..start+width-1 to `ring`."""
    a, b = to_end[start], from_start[start + width - 1]
    if place == 0:
        for q in range(ring.shape[0]):
            ring[q] += a[q]
    else:
        for q in range(ring.shape[0]):
            ring[q] += a[q] + b[q]


@njit(nogil=True, cache=True, fastmath=_CONTRACT)
def _distance(ring, x, ddof, ridge, exact, near, root, z):  # type: ignore[no-untyped-def]
    """Squared Mahalanobis distance of x from a ring's moments, and how it was found.

    DONE; DEFICIENT: without bands that follow from others in the ring, as they do in x; ASIDE: not to be told from
    these moments. A pivot is lost where it is below `exact`, and inexact below `near`, times the sum of squares that
    it was taken from.
    """
    bands = x.shape[0]
    n = ring[0]
    if n <= bands:
        return 0.0, ASIDE
    state = DONE
    total = 0.0
    k = 1 + bands
    for i in range(bands):
        si = ring[1 + i] / n
        square = ring[k + i]
        rest = x[i] - si
        away = rest
        for j in range(i):
            a = ring[k + j] - si * ring[1 + j]
            for m in range(j):
                a -= root[i, m] * root[j, m]
            a *= root[j, j]
            root[i, j] = a
            rest -= a * z[j]
        pivot = (square - si * ring[1 + i]) * (1.0 + ridge)
        for m in range(i):
            pivot -= root[i, m] * root[i, m]
        k += i + 1
        if pivot <= exact * square:
            if rest * rest > 100.0 * exact * (square / n + away * away):
                return 0.0, ASIDE
            state = DEFICIENT
            root[i, i] = 0.0
            z[i] = 0.0
        elif pivot <= near * square:
            return 0.0, ASIDE
        else:
            root[i, i] = 1.0 / np.sqrt(pivot)
            z[i] = rest * root[i, i]
            total += z[i] * z[i]
    return total * (n - ddof), state


@njit(nogil=True, cache=True)
def ring_scores(x, good, origin, inner, outer, ddof, ridge, scores, states):  # type: ignore[no-untyped-def]
    """Score a block against rings: `inner` is the guard's side, `outer` the window's.

    x, good : (rows + outer - 1, columns + outer - 1, bands) float64, 0 where not good; and bool
    origin : row and column of the padded block's first pixel in the scene, not negative
    scores, states : (rows, columns), filled where the pixel is good; states 255 are left to the caller
    """
    rows, columns = scores.shape
    bands, padded = x.shape[2], x.shape[1]
    half, bar = outer // 2, (outer - inner) // 2
    channels = 1 + bands + bands * (bands + 1) // 2
    exact = 32.0 * bands * 2.220446049250313e-16
    near = 1e3 * exact
    nothing = np.zeros((padded, channels))
    bar_suffix, bar_prefix = np.empty((bar, padded, channels)), np.empty((padded, channels))
    mid_suffix, mid_prefix = np.empty((inner, padded, channels)), np.empty((padded, channels))
    apart = bar + inner  # rows from the bar above the guard to the one below
    bars = np.empty((apart + 1, padded, channels))
    middle, ends = np.empty((padded, channels)), np.empty((padded, channels))
    ends_to, ends_from = np.empty((padded, channels)), np.empty((padded, channels))
    mid_to, mid_from = np.empty((padded, channels)), np.empty((padded, channels))
    ring, root, z = np.empty(channels), np.zeros((bands, bands)), np.empty(bands)
    for k in range(rows + apart):
        place = (origin[0] + k) % bar
        _down(x, good, k, bar, place, k == 0, bar_suffix, bar_prefix, nothing, bars[k % (apart + 1)])
        r = k - apart
        if r < 0:
            continue
        start = r + bar
        _down(x, good, start, inner, (origin[0] + start) % inner, r == 0, mid_suffix, mid_prefix, nothing, middle)
        above, below = bars[r % (apart + 1)], bars[k % (apart + 1)]
        for c in range(padded):
            for q in range(channels):
                ends[c, q] = above[c, q] + below[c, q]
        _runs(ends, outer, origin[1], ends_to, ends_from)
        _runs(middle, bar, origin[1], mid_to, mid_from)
        for c in range(columns):
            if not good[r + half, c + half]:
                continue
            ring[:] = 0.0
            _add_window(ends_to, ends_from, c, outer, (origin[1] + c) % outer, ring)
            _add_window(mid_to, mid_from, c, bar, (origin[1] + c) % bar, ring)
            right = c + apart
            _add_window(mid_to, mid_from, right, bar, (origin[1] + right) % bar, ring)
            value, state = _distance(ring, x[r + half, c + half], ddof, ridge, exact, near, root, z)
            scores[r, c] = value
            states[r, c] = state
