"""Compiled loops of `detect.local`: sums over the ring of pixels around each pixel, and Mahalanobis distances.

A ring is a square window without its centre, the guard. Innermost loops run over pixels: compilers vectorise them.
"""

import numpy as np

from deglint.jit import njit

DONE, DEFICIENT, ASIDE = 0, 1, 255  # states of a pixel, see `distances`
LANES = 64  # pixels whose covariances are factored side by side: they stay in the first-level cache
EPS = 2.220446049250313e-16  # relative spacing of float64 numbers


@njit(nogil=True, cache=True)
def window_sums(values, spare, step, width, out):  # type: ignore[no-untyped-def]
    """Set out[k] to the sum of `width` values that are `step` apart, from values[k] on. All arrays are (n,).
    The last (width - 1) * step elements of `out` are not valid. `values` and working memory `spare` are overwritten.
    """
    done, span = 0, 1  # `values` holds sums of `span` = 1, 2, 4, ... terms
    while True:
        if width & span:
            further = values[done * step :]
            count = len(values) - (done + span - 1) * step
            if done == 0:
                out[:] = values
            else:
                for k in range(count):
                    out[k] += further[k]
            done += span
        if done == width:
            return
        ahead = values[span * step :]
        for k in range(len(values) - (2 * span - 1) * step):
            spare[k] = values[k] + ahead[k]
        values, spare = spare, values
        span *= 2


@njit(nogil=True, cache=True)
def ring_moments(x, inner, bar, out):  # type: ignore[no-untyped-def]
    """Fill `out` with sums of x[i] * x[j], j <= i, over the ring of each pixel: four bars around a square, the guard.

    x : (1 + bands, rows, columns); x[0] is 1 where a pixel is valid, else 0; x[1:] are the bands, 0 where not valid
    inner, bar : side of the guard, and width of the bars around it [pixel]
    out : (pairs, rows - m, columns - m), m = `inner` + 2 `bar` - 1; pairs (i, j) in the order (0, 0), (1, 0), (1, 1)...
    """
    width, size = x.shape[2], x[0].size
    values, again, spare, level = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    side, guard, middle = np.empty(size), np.empty(size), np.empty(size)
    q = 0
    for i in range(len(x)):
        for j in range(i + 1):
            a, b, found = x[i].reshape(size), x[j].reshape(size), out[q]
            for k in range(size):
                values[k] = a[k] * b[k]
                again[k] = a[k] * b[k]
            window_sums(values, spare, 1, bar, side)  # along rows; sums that continue in the next row are not used
            window_sums(again, spare, 1, inner, guard)
            right, inside = side[bar + inner :], guard[bar:]
            for k in range(len(right)):
                values[k] = side[k] + right[k]
                again[k] = values[k] + inside[k]
            window_sums(again, spare, width, bar, level)  # along columns
            window_sums(values, spare, width, inner, middle)
            below, beside = level[(bar + inner) * width :], middle[bar * width :]
            for r in range(found.shape[0]):
                for c in range(found.shape[1]):
                    k = r * width + c
                    found[r, c] = level[k] + below[k] + beside[k]
            q += 1


@njit(nogil=True, cache=True, error_model="numpy")
def _judge(pivot, rest, ring, exact, scale, state):  # type: ignore[no-untyped-def]
    """Fill `scale` with 1 / sqrt(pivot) of a band; where the pivot is lost or inexact, fill in 0 and change `state`.

    All arrays are (pixels,). `pivot` is the sum of squared deviations of the band in the ring, and `rest` the deviation
    of the pixel from the mean of the ring, both without the part that earlier bands explain. `ring` is a tuple: sum,
    mean and sum of squares of the band in the ring, number of pixels in the ring, and deviation of the pixel. A pivot
    is lost if it is at most the sum of squares times `exact`, the relative rounding error, and inexact if it is at most
    1000 times this limit. `state` (see `distances`) becomes DEFICIENT if the pivot is lost and `rest` is only a
    rounding error, else ASIDE. ASIDE is never replaced.
    """
    own, mean, square, count, away = ring
    for c in range(len(pivot)):
        if pivot[c] > 1e3 * exact * square[c]:
            scale[c] = 1.0 / np.sqrt(pivot[c])
            continue
        scale[c] = 0.0
        left, slack = rest[c], 100.0 * exact * (square[c] / count[c] + away[c] * away[c])
        if square[c] - mean[c] * own[c] <= 1e3 * exact * square[c]:  # the band hardly varies: compare with rounding
            left, slack = away[c], (16.0 * EPS) ** 2 * square[c] / count[c]
        if pivot[c] > exact * square[c] or not left * left <= slack:
            state[c] = ASIDE
        elif state[c] != ASIDE:
            state[c] = DEFICIENT


@njit(nogil=True, cache=True, fastmath={"contract"}, error_model="numpy")
def _distances(sums, x, ddof, ridge, root, total, state):  # type: ignore[no-untyped-def]
    """Compute `distances` of `LANES` pixels at the same time, by Cholesky factorisations of their covariances.

    `root`, (bands + 1, bands, pixels), is working memory: rows of the Cholesky factors, then the whitened pixels.
    """
    bands, n = len(x), sums.shape[1]
    exact = 32.0 * bands * EPS
    count, first, z = sums[0], 1, root[bands]
    mean, away, rest, pivot = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for c in range(n):
        total[c], state[c] = 0.0, ASIDE if count[c] <= max(bands, ddof) else DONE
    for i in range(bands):
        own, square = sums[first], sums[first + 1 + i]
        for c in range(n):
            mean[c] = own[c] / count[c]
            away[c] = x[i, c] - mean[c]
            rest[c] = away[c]
            pivot[c] = (square[c] - mean[c] * own[c]) * (1.0 + ridge)
        earlier = 1
        for j in range(i):
            a, product, other, scale, before = root[i, j], sums[first + 1 + j], sums[earlier], root[j, j], z[j]
            for c in range(n):
                a[c] = product[c] - mean[c] * other[c]
            for m in range(j):
                left, right = root[i, m], root[j, m]
                for c in range(n):
                    a[c] -= left[c] * right[c]
            for c in range(n):
                a[c] *= scale[c]
                rest[c] -= a[c] * before[c]
                pivot[c] -= a[c] * a[c]
            earlier += j + 2
        scale, own_z = root[i, i], z[i]
        _judge(pivot, rest, (own, mean, square, count, away), exact, scale, state)
        for c in range(n):
            own_z[c] = rest[c] * scale[c]
            total[c] += own_z[c] * own_z[c]
        first += i + 2
    for c in range(n):
        total[c] *= count[c] - ddof


@njit(nogil=True, cache=True)
def distances(sums, x, ddof, ridge, total, state):  # type: ignore[no-untyped-def]
    """Squared Mahalanobis distances of pixels from their rings; `ddof` and `ridge` are as in `detect.local.local_rx`.

    sums : (pairs, pixels), filled by `ring_moments`; x : (bands, pixels), values of the pixels
    total, state : (pixels,), outputs: the distance, and one of the following states
    DONE: the distance is valid. DEFICIENT: it is valid, but bands that depend linearly on others, in both ring and
    pixel, are left out. ASIDE: it is not valid: the sums are not precise enough, or the ring has too few pixels.
    """
    bands, products = len(x), len(sums)
    root = np.zeros((bands + 1, bands, LANES))
    some_sums, some_x = np.ones((products, LANES)), np.zeros((bands, LANES))
    found, how = np.empty(LANES), np.empty(LANES, np.uint8)
    for start in range(0, len(total), LANES):
        stop = min(start + LANES, len(total))
        some_sums[:, : stop - start] = sums[:, start:stop]
        some_x[:, : stop - start] = x[:, start:stop]
        _distances(some_sums, some_x, ddof, ridge, root, found, how)
        total[start:stop], state[start:stop] = found[: stop - start], how[: stop - start]
