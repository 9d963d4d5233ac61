"""The compiled inner loop of `detect.local`: moments of every pixel's ring, and the distance of the pixel from them.

Sums along a window's rows are made of sums of 1, 4, 16, ... pixels. Sums of those down the window are made of two
runs, one to the end of a block and one from its start (van Herk 1992): blocks are as long as the window and lie at
multiples of it in the scene. So a sum holds the pixels of its window and no others, nothing is ever taken away again,
the cost grows slowly with the window, and any tiling gives the same bits.
The ring is the sum of four bars around the guard, not a difference of two squares.

A loop runs in vector registers only where the compiler can tell quickly that what it writes is not what it reads: where
few rows are written and read in one loop.

References
----------
van Herk (1992), "A fast algorithm for local minimum and maximum filters on rectangular and octagonal kernels", Pattern
Recognition Letters 13, 517-521, doi:10.1016/0167-8655(92)90069-C.
"""

import numpy as np

from deglint.jit import njit

# The same additions in the same order for every pixel, wherever its block lies; only a multiplication may be merged
# with the addition that follows it.
_SAME = {"contract"}
DONE, DEFICIENT, ASIDE = 0, 1, 255
WIDTH = 64  # pixels whose covariances are factored side by side: they stay in the first-level cache
SOME = 3  # channels (count, sums, products) that are summed together
EPS = 2.220446049250313e-16
# Unsigned, so that no loop asks whether an index counts from the end; functions on whole arrays are put where they are
# called, since to hand an array over takes as long as a loop.
ZERO, ONE, TWO, THREE, FOUR, LANES, MANY = (np.uint64(k) for k in (0, 1, 2, 3, 4, WIDTH, SOME))
VALUES, SPARE, OTHER, GUARD, SIDE = (np.uint64(k) for k in range(5))  # what is worked on along a row of pixels,
WHOLE, BESIDE, DOWN = (np.uint64(k) for k in range(3))  # down the columns,
REST, AWAY, PIVOT, ENTRY = LANES, TWO * LANES, THREE * LANES, FOUR * LANES  # and in factoring, after the mean


@njit(nogil=True, cache=True, inline="always")
def _first(w, a, span, many, n, out):  # type: ignore[no-untyped-def]
    """The sum of `many`, 1 to 3, entries of row a that lie `span` apart."""
    if many == ONE:
        for k in range(n):
            w[out, k] = w[a, k]
    elif many == TWO:
        for k in range(n):
            w[out, k] = w[a, k] + w[a, k + span]
    else:
        for k in range(n):
            w[out, k] = (w[a, k] + w[a, k + span]) + w[a, k + TWO * span]


@njit(nogil=True, cache=True, inline="always")
def _further(w, a, start, span, many, n, out):  # type: ignore[no-untyped-def]
    """The same, from `start` on, added to what is there."""
    if many == ONE:
        for k in range(n):
            w[out, k] += w[a, k + start]
    elif many == TWO:
        for k in range(n):
            w[out, k] += w[a, k + start] + w[a, k + start + span]
    else:
        for k in range(n):
            w[out, k] += (w[a, k + start] + w[a, k + start + span]) + w[a, k + start + TWO * span]


@njit(nogil=True, cache=True)
def _windows(w, width, out):  # type: ignore[no-untyped-def]
    """Sums of the values k..k+width-1 for every k that has them, made of sums of 1, 4, 16, ... values."""
    a, b, other, every = VALUES, SPARE, OTHER, np.uint64(w.shape[1])
    done, span = ZERO, ONE
    while True:
        many = width // span % FOUR
        n = every + span - done - many * span
        if many and done == ZERO:
            _first(w, a, span, many, n, out)
        elif many:
            _further(w, a, done, span, many, n, out)
        done += many * span
        if done == width:
            return
        for k in range(every - THREE * span):
            w[b, k] = (w[a, k] + w[a, k + span]) + (w[a, k + TWO * span] + w[a, k + THREE * span])
        span *= FOUR
        a, b, other = b, other, b


@njit(nogil=True, cache=True, inline="always")
def _take(x, known, p, channels, first, w):  # type: ignore[no-untyped-def]
    """Put `SOME` channels of padded row p side by side: count, bands, products of two."""
    n = np.uint64(x.shape[2])
    for k in range(MANY):
        i, j, to = np.uint64(channels[first + k, 0]), np.uint64(channels[first + k, 1]), k * n
        if channels[first + k, 0] < 0:
            for c in range(n):
                w[VALUES, to + c] = known[p, c]
        elif channels[first + k, 1] < 0:
            for c in range(n):
                w[VALUES, to + c] = x[p, i, c]
        else:
            for c in range(n):
                w[VALUES, to + c] = x[p, i, c] * x[p, j, c]


@njit(nogil=True, cache=True, inline="always")
def _join(w, n, inner, bar, v, columns):  # type: ignore[no-untyped-def]
    """Sums of a window's width, and of what is beside the guard alone."""
    for k in range(MANY):
        side, to = k * n, k * columns
        right, guard = side + bar + inner, side + bar
        for c in range(columns):
            beside = w[SIDE, side + c] + w[SIDE, right + c]
            v[BESIDE, to + c] = beside
            v[WHOLE, to + c] = beside + w[GUARD, guard + c]


@njit(nogil=True, cache=True, inline="always")
def _down(v, row, q, place, fresh, table, prefix):  # type: ignore[no-untyped-def]
    """Sums down the window that ends with this row; called for one row after the other.

    `place` is the row's place in its block; `fresh` for the first row of all. `table` holds the rows of this block so
    far, and below them the sums from there to the end of the block before.
    """
    width, n = np.uint64(table.shape[1]), np.uint64(v.shape[1])
    for c in range(n):
        table[q, place, c] = v[row, c]
    if place == ZERO or fresh:
        for c in range(n):
            prefix[q, c] = 0.0
    if place + ONE < width:
        for c in range(n):
            total = prefix[q, c] + v[row, c]
            prefix[q, c] = total
            v[DOWN, c] = total + table[q, place + ONE, c]
    else:
        for c in range(n):
            v[DOWN, c] = prefix[q, c] + v[row, c]
        for i in range(ONE, width):
            for c in range(n):
                table[q, width - ONE - i, c] += table[q, width - i, c]


@njit(nogil=True, cache=True, inline="always")
def _finish(v, waiting, q, slot, rings):  # type: ignore[no-untyped-def]
    """Put the sum of what waits and what came last into `rings`, (piece, channel, `WIDTH`); the latter waits now."""
    columns = np.uint64(v.shape[1]) // MANY
    for k in range(MANY):
        for piece in range(np.uint64(rings.shape[0])):
            start, channel = k * columns + piece * LANES, q * MANY + k
            for c in range(min(LANES, columns - piece * LANES)):
                rings[piece, channel, c] = waiting[q, slot, start + c] + v[DOWN, start + c]


@njit(nogil=True, cache=True, inline="always")
def _wait(v, waiting, q, slot):  # type: ignore[no-untyped-def]
    for c in range(np.uint64(v.shape[1])):
        waiting[q, slot, c] = v[DOWN, c]


@njit(nogil=True, cache=True, inline="always")
def _add(v, waiting, q, slot):  # type: ignore[no-untyped-def]
    for c in range(np.uint64(v.shape[1])):
        waiting[q, slot, c] += v[DOWN, c]


@njit(nogil=True, cache=True, inline="always")
def _entry(sums, k, j, root, a, b, work):  # type: ignore[no-untyped-def]
    """Entry j of a row of centred products less what the bands before j have of it.

    The row's factors begin at a in `root`, those of row j at b.
    """
    many, p, q = j % FOUR, ONE + j, k + j
    if many == ZERO:
        for c in range(LANES):
            work[ENTRY + c] = sums[q, c] - work[c] * sums[p, c]
    elif many == ONE:
        for c in range(LANES):
            work[ENTRY + c] = sums[q, c] - work[c] * sums[p, c] - root[a + c] * root[b + c]
    elif many == TWO:
        for c in range(LANES):
            less = sums[q, c] - work[c] * sums[p, c] - root[a + c] * root[b + c]
            work[ENTRY + c] = less - root[a + LANES + c] * root[b + LANES + c]
    else:
        for c in range(LANES):
            less = sums[q, c] - work[c] * sums[p, c] - root[a + c] * root[b + c]
            less = less - root[a + LANES + c] * root[b + LANES + c]
            work[ENTRY + c] = less - root[a + TWO * LANES + c] * root[b + TWO * LANES + c]
    for m in range(many * LANES, j * LANES, FOUR * LANES):
        p, q = a + m, b + m
        for c in range(LANES):
            less = work[ENTRY + c] - root[p + c] * root[q + c] - root[p + LANES + c] * root[q + LANES + c]
            less = less - root[p + TWO * LANES + c] * root[q + TWO * LANES + c]
            work[ENTRY + c] = less - root[p + THREE * LANES + c] * root[q + THREE * LANES + c]


@njit(nogil=True, cache=True, inline="always")
def _less_earlier(sums, i, k, root, z, work):  # type: ignore[no-untyped-def]
    """Row i of the Cholesky factor, and what the bands before it leave of the pixel and of the pivot."""
    row = i * (i + ONE) // TWO * LANES
    for j in range(i):
        b = j * (j + ONE) // TWO * LANES
        _entry(sums, k, j, root, row, b, work)
        left, scale, earlier = row + j * LANES, b + j * LANES, j * LANES
        for c in range(LANES):
            a = work[ENTRY + c] * root[scale + c]
            root[left + c] = a
            work[REST + c] -= a * z[earlier + c]
            work[PIVOT + c] -= a * a


@njit(nogil=True, cache=True, error_model="numpy")
def _doubt(sums, squares, work, near, exact, states):  # type: ignore[no-untyped-def]
    """Mark the pixels whose pivot is lost or inexact."""
    for c in range(LANES):
        pivot, rest, away, square = work[PIVOT + c], work[REST + c], work[AWAY + c], sums[squares, c]
        slack = 100.0 * exact * (square / sums[ZERO, c] + away * away)
        if pivot > near * square:
            continue
        if pivot > exact * square or not rest * rest <= slack:
            states[c] = ASIDE
        elif states[c] != ASIDE:
            states[c] = DEFICIENT


@njit(nogil=True, cache=True, fastmath=_SAME, error_model="numpy")
def _distances(sums, x, ddof, ridge, root, z, work, total, states):  # type: ignore[no-untyped-def]
    """Squared Mahalanobis distances of `WIDTH` pixels x from their rings' moments, and how each was found.

    DONE; DEFICIENT: without bands that follow from others in the ring, as they do in x; ASIDE: not to be determined
    from these moments. A pivot is lost where it is below `exact`, and inexact below `near`, times the sum of squares
    that it was taken from.
    """
    bands = np.uint64(x.shape[0])
    exact = 32.0 * bands * EPS
    near = 1e3 * exact
    k = ONE + bands
    for c in range(LANES):
        total[c] = 0.0
        states[c] = ASIDE if sums[ZERO, c] <= bands else DONE
    for i in range(bands):
        added, scale, own = ONE + i, i * (i + THREE) // TWO * LANES, i * LANES
        squares = k + i
        for c in range(LANES):
            mean = sums[added, c] / sums[ZERO, c]
            away = x[i, c] - mean
            work[c] = mean
            work[AWAY + c] = away
            work[REST + c] = away
            work[PIVOT + c] = (sums[squares, c] - mean * sums[added, c]) * (1.0 + ridge)
        _less_earlier(sums, i, k, root, z, work)
        lost = 0
        for c in range(LANES):
            fine = work[PIVOT + c] > near * sums[squares, c]
            root[scale + c] = 1.0 / np.sqrt(work[PIVOT + c]) if fine else 0.0
            lost += not fine
        for c in range(LANES):
            z[own + c] = work[REST + c] * root[scale + c]
            total[c] += z[own + c] * z[own + c]
        if lost:
            _doubt(sums, squares, work, near, exact, states)
        k += i + ONE
    for c in range(LANES):
        total[c] *= sums[ZERO, c] - ddof


@njit(nogil=True, cache=True)
def _take_row(x, known, p, origin, inner, channels, tables, w, v, rings):  # type: ignore[no-untyped-def]
    """Add padded row p to the sums of the windows that hold it, and finish the rings of which it is the last row.

    A ring waits from the end of its upper bar on: first what is beside the guard is added, then the lower bar, which
    is at the same time the upper bar of the ring that waits next in its place.
    """
    bars, bars_prefix, middle, middle_prefix, waiting = tables
    bar, apart, n = np.uint64(bars.shape[1]), np.uint64(waiting.shape[1]), np.uint64(x.shape[2])
    at = origin + p
    for q in range(np.uint64(bars.shape[0])):
        _take(x, known, p, channels, q * MANY, w)
        _windows(w, inner, GUARD)
        _windows(w, bar, SIDE)
        _join(w, n, inner, bar, v, np.uint64(v.shape[1]) // MANY)
        _down(v, WHOLE, q, at % bar, p == ZERO, bars, bars_prefix)
        upper = p + ONE - bar  # the pixel row whose ring has got so far, where there is one
        if p + ONE >= bar:
            if upper >= apart:
                _finish(v, waiting, q, upper % apart, rings)
            _wait(v, waiting, q, upper % apart)
        if p >= bar:
            _down(v, BESIDE, q, at % inner, p == bar, middle, middle_prefix)
        if p + ONE >= apart:
            _add(v, waiting, q, (p + ONE - apart) % apart)


@njit(nogil=True, cache=True)
def _channels(bands):  # type: ignore[no-untyped-def]
    """Which bands are multiplied for each channel, -1 for none, up to a multiple of `SOME`."""
    count = 1 + bands + bands * (bands + 1) // 2
    out = np.full((-(-count // SOME) * SOME, 2), -1, np.int64)
    k = 1 + bands
    for i in range(bands):
        out[1 + i, 0] = i
        for j in range(i + 1):
            out[k, 0], out[k, 1] = i, j
            k += 1
    return out


@njit(nogil=True, cache=True)
def ring_scores(x, known, origin, inner, outer, ddof, ridge, scores, states):  # type: ignore[no-untyped-def]
    """Score a block against rings: `inner` is the guard's side, `outer` the window's.

    x, known : (rows + outer - 1, bands, columns + outer - 1), 0 where not valid; and 1 where valid, both float64
    origin : row of the padded block's first pixel in the scene, not negative
    scores, states : (rows, columns), filled where the pixel is valid; states 255 are left to the caller
    """
    rows, columns = scores.shape
    bands, half, bar = x.shape[1], outer // 2, (outer - inner) // 2
    channels = _channels(bands)
    some, n = len(channels) // SOME, SOME * columns
    bars, bars_prefix = np.zeros((some, bar, n)), np.zeros((some, n))
    middle, middle_prefix = np.zeros((some, inner, n)), np.zeros((some, n))
    tables = bars, bars_prefix, middle, middle_prefix, np.zeros((some, bar + inner, n))
    w, v = np.zeros((5, SOME * x.shape[2])), np.zeros((3, n))
    rings = np.ones((-(-columns // WIDTH), len(channels), WIDTH))
    own, z, root = np.zeros((bands, WIDTH)), np.empty(bands * WIDTH), np.zeros((bands * (bands + 1) // 2 + 4) * WIDTH)
    factoring, total, state = np.empty(5 * WIDTH), np.empty(WIDTH), np.empty(WIDTH, np.uint8)
    for p in range(rows + outer - 1):
        _take_row(x, known, np.uint64(p), np.uint64(origin), np.uint64(inner), channels, tables, w, v, rings)
        r = p - outer + 1
        for piece in range(rings.shape[0] if r >= 0 else 0):
            first = piece * WIDTH
            count = min(WIDTH, columns - first)
            for b in range(bands):
                for c in range(count):
                    own[b, c] = x[r + half, b, half + first + c]
            _distances(rings[piece], own, ddof, ridge, root, z, factoring, total, state)
            for c in range(count):
                if known[r + half, half + first + c] > 0:
                    scores[r, first + c] = total[c]
                    states[r, first + c] = state[c]
