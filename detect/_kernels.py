"""The compiled inner loop of `detect.local`: moments of every pixel's ring, and the distance of the pixel from them.

Sums down a window are made of two runs, one to the end of a block and one from its start (van Herk 1992): blocks are
as long as the window and lie at multiples of it in the scene. Sums along its rows are made of sums of 1, 4, 16, ...
pixels. So a sum holds the pixels of its window and no others, nothing is ever taken away again, the cost grows
slowly with the window, and any tiling gives the same bits.
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
WIDTH = 64  # pixels whose covariances are factored side by side: they stay in the first-level cache
SOME = 3  # channels whose sums along a row are made together
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


# Each loop is a function of its own: the compiler then sees that what is read and what is written do not overlap.
@njit(nogil=True, cache=True)
def _two(a, b, n, out):  # type: ignore[no-untyped-def]
    for k in range(n):
        out[k] = a[k] + b[k]


@njit(nogil=True, cache=True)
def _three(a, b, c, n, out):  # type: ignore[no-untyped-def]
    for k in range(n):
        out[k] = (a[k] + b[k]) + c[k]


@njit(nogil=True, cache=True)
def _four(a, step, n, out):  # type: ignore[no-untyped-def]
    b, c, d = a[step:], a[2 * step :], a[3 * step :]
    for k in range(n):
        out[k] = (a[k] + b[k]) + (c[k] + d[k])


@njit(nogil=True, cache=True)
def _first(a, step, many, n, out):  # type: ignore[no-untyped-def]
    """The sum of `many`, 1 to 3, entries of `a` that lie `step` apart."""
    if many == 1:
        out[:n] = a[:n]
    elif many == 2:
        _two(a, a[step:], n, out)
    else:
        _three(a, a[step:], a[2 * step :], n, out)


@njit(nogil=True, cache=True)
def _further(a, step, many, n, out):  # type: ignore[no-untyped-def]
    """The same, added to what is there."""
    b, c = a[step:], a[2 * step :]
    if many == 1:
        for k in range(n):
            out[k] += a[k]
    elif many == 2:
        for k in range(n):
            out[k] += a[k] + b[k]
    else:
        for k in range(n):
            out[k] += (a[k] + b[k]) + c[k]


@njit(nogil=True, cache=True)
def _windows(values, spare, n, width, sums):  # type: ignore[no-untyped-def]
    """Sums of entries k..k+width-1 for every k that has them: of sums of 1, 4, 16, ... entries, as width needs them.

    `values` and `spare` are overwritten.
    """
    done, span = 0, 1
    while True:
        many = width // span % 4
        if many and done == 0:
            _first(values, span, many, n - many * span + span, sums)
        elif many:
            _further(values[done:], span, many, n - done - many * span + span, sums)
        done += many * span
        if done == width:
            return
        _four(values, span, n - 3 * span, spare)
        span *= 4
        values, spare = spare, values


@njit(nogil=True, cache=True)
def _rings(above, below, beside, inner, bar, piece, work, rings):  # type: ignore[no-untyped-def]
    """Sums over the rings of a row, from sums down the bars above and below the guard, and down what is beside it.

    Flat arrays of one padded row a channel; a piece is some whole channels. What lies at a row's end, where windows
    reach into the next, is of no use.
    """
    apart = bar + inner
    values, spare, middle, sides = work[0], work[1], work[2], work[3]
    for first in range(0, rings.shape[0], piece):
        n = min(piece, rings.shape[0] - first)
        a, b = above[first:], below[first:]
        _two(a, b, n, values)
        _windows(values, spare, n, inner, middle)  # columns of the guard
        _three(a, b, beside[first:], n, values)
        _windows(values, spare, n, bar, sides)
        _three(sides, sides[apart:], middle[bar:], n - apart, rings[first:])


@njit(nogil=True, cache=True, fastmath=_SAME)
def _less_earlier(sums, i, k, root, z, work):  # type: ignore[no-untyped-def]
    """Row i of the Cholesky factor, and what the bands before it leave of the pixel and of the pivot."""
    mean, rest, pivot, entry = work[0], work[1], work[3], work[4]
    for j in range(i):
        product, total, scale, earlier, left = sums[k + j], sums[1 + j], root[j, j], z[j], root[i, j]
        for c in range(WIDTH):
            entry[c] = product[c] - mean[c] * total[c]
        for m in range(j):
            a, b = root[i, m], root[j, m]
            for c in range(WIDTH):
                entry[c] -= a[c] * b[c]
        for c in range(WIDTH):
            a = entry[c] * scale[c]
            left[c] = a
            rest[c] -= a * earlier[c]
            pivot[c] -= a * a


@njit(nogil=True, cache=True, fastmath=_SAME, error_model="numpy")
def _distances(sums, x, ddof, ridge, root, z, work, total, states):  # type: ignore[no-untyped-def]
    """Squared Mahalanobis distances of `WIDTH` pixels x from their rings' moments, and how each was found.

    DONE; DEFICIENT: without bands that follow from others in the ring, as they do in x; ASIDE: not to be told from
    these moments. A pivot is lost where it is below `exact`, and inexact below `near`, times the sum of squares that
    it was taken from.
    """
    bands = x.shape[0]
    exact = 32.0 * bands * EPS
    near = 1e3 * exact
    mean, rest, away, pivot, n = work[0], work[1], work[2], work[3], sums[0]
    for c in range(WIDTH):
        total[c] = 0.0
        states[c] = ASIDE if n[c] <= bands else DONE
    k = 1 + bands
    for i in range(bands):
        added, squares, scale, own = sums[1 + i], sums[k + i], root[i, i], z[i]
        for c in range(WIDTH):
            mean[c] = added[c] / n[c]
            away[c] = x[i, c] - mean[c]
            rest[c] = away[c]
            pivot[c] = (squares[c] - mean[c] * added[c]) * (1.0 + ridge)
        _less_earlier(sums, i, k, root, z, work)
        lost = 0
        for c in range(WIDTH):
            fine = pivot[c] > near * squares[c]
            scale[c] = 1.0 / np.sqrt(pivot[c]) if fine else 0.0
            own[c] = rest[c] * scale[c]
            total[c] += own[c] * own[c]
            lost += not fine
        for c in range(WIDTH if lost else 0):
            slack = 100.0 * exact * (squares[c] / n[c] + away[c] * away[c])
            if pivot[c] > near * squares[c]:
                continue
            if pivot[c] > exact * squares[c] or not rest[c] * rest[c] <= slack:
                states[c] = ASIDE
            elif states[c] != ASIDE:
                states[c] = DEFICIENT
        k += i + 1
    for c in range(WIDTH):
        total[c] *= n[c] - ddof


@njit(nogil=True, cache=True)
def _copy(source, first, count, target):  # type: ignore[no-untyped-def]
    """Put `count` columns from `first` on into a narrower array; what lies beyond in it stays."""
    for k in range(source.shape[0]):
        row, out = source[k, first : first + count], target[k]
        for c in range(count):
            out[c] = row[c]


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
    flat_bars, flat_middle, piece = bars.reshape(apart + 1, -1), middle.reshape(-1), SOME * padded
    work, rings = np.zeros((4, piece)), np.zeros((channels, padded))
    root, z, rows_of = np.zeros((bands, bands, WIDTH)), np.empty((bands, WIDTH)), np.empty((5, WIDTH))
    sums, own = np.ones((channels, WIDTH)), np.zeros((bands, WIDTH))
    total, state = np.empty(WIDTH), np.empty(WIDTH, np.uint8)
    for k in range(rows + apart):
        place = (origin[0] + k) % bar
        _down(x, known, k, bar, place, k == 0, bar_suffix, bar_prefix, bars[k % (apart + 1)])
        r = k - apart
        if r < 0:
            continue
        start = r + bar
        _down(x, known, start, inner, (origin[0] + start) % inner, r == 0, mid_suffix, mid_prefix, middle)
        above, below = flat_bars[r % (apart + 1)], flat_bars[k % (apart + 1)]
        _rings(above, below, flat_middle, inner, bar, piece, work, rings.reshape(-1))
        row = x[r + half, :, half : half + columns]
        for first in range(0, columns, WIDTH):
            count = min(WIDTH, columns - first)
            _copy(rings, first, count, sums)
            _copy(row, first, count, own)
            _distances(sums, own, ddof, ridge, root, z, rows_of, total, state)
            for c in range(count):
                if known[r + half, half + first + c] > 0:
                    scores[r, first + c] = total[c]
                    states[r, first + c] = state[c]
