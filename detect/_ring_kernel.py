"""The compiled rings one by one of `detect.local`, for pixels whose moments do not tell enough.

The ring's own pixels, less their mean, are brought to a triangle (modified Gram-Schmidt with pivots), so that no digits
are lost to squares.

References
----------
Bjorck (1967), "Solving linear least squares problems by Gram-Schmidt orthogonalization", BIT 7, 1-21,
doi:10.1007/BF01934122.
"""

import numpy as np

from deglint.jit import njit

# The order of additions may change (so that they run in vector registers): the same code does every pixel.
_FAST = {"reassoc", "contract", "nsz"}
FINE, DEFICIENT, TOO_FEW, ASIDE = 0, 1, 2, 255


@njit(nogil=True, cache=True)
def _collect(x, known, r, c, inner, outer, ring):  # type: ignore[no-untyped-def]
    """Put the pixels of the ring whose window starts at (r, c) into `ring`, (band, pixel); returns how many."""
    first = (outer - inner) // 2
    last = first + inner
    n = 0
    for i in range(outer):
        for j in range(outer):
            if (first <= i < last and first <= j < last) or known[r + i, c + j] == 0:
                continue
            for b in range(x.shape[1]):
                ring[b, n] = x[r + i, b, c + j]
            n += 1
    return n


@njit(nogil=True, cache=True, fastmath=_FAST)
def _product(a, b, n):  # type: ignore[no-untyped-def]
    """Sum of products of the first n entries."""
    s = 0.0
    for p in range(n):
        s += a[p] * b[p]
    return s


@njit(nogil=True, cache=True, fastmath=_FAST)
def _centred(row, n):  # type: ignore[no-untyped-def]
    """Take the mean away from the first n entries, the first entry first of all; returns it."""
    shift, s = row[0], 0.0
    for p in range(n):
        row[p] -= shift
        s += row[p]
    mean = s / n
    for p in range(n):
        row[p] -= mean
    return shift + mean


@njit(nogil=True, cache=True, fastmath=_FAST)
def _less(row, q, share, n):  # type: ignore[no-untyped-def]
    """row -= share q."""
    for p in range(n):
        row[p] -= share * q[p]


@njit(nogil=True, cache=True)
def _triangle(ring, n, lower, order, squares):  # type: ignore[no-untyped-def]
    """Rows of `ring` as lower . (orthonormal rows), the longest of what is left first; `squares` of what was left."""
    bands = ring.shape[0]
    for k in range(bands):
        order[k] = k
    for k in range(bands):
        best, squares[k] = k, -1.0
        for i in range(k, bands):
            square = _product(ring[order[i]], ring[order[i]], n)
            if square > squares[k]:
                best, squares[k] = i, square
        order[k], order[best] = order[best], order[k]
        for j in range(k):
            lower[k, j], lower[best, j] = lower[best, j], lower[k, j]
        if squares[k] == 0:
            squares[k:] = 0.0
            return
        lower[k, k] = np.sqrt(squares[k])
        q = ring[order[k]]
        for p in range(n):
            q[p] /= lower[k, k]
        for i in range(k + 1, bands):
            lower[i, k] = _product(ring[order[i]], q, n)
            _less(ring[order[i]], q, lower[i, k], n)


@njit(nogil=True, cache=True)
def _of_lower_rank(lower, rank, away):  # type: ignore[no-untyped-def]
    """d^T (L L^T)^+ d for the first `rank` columns of L: with L = Q R it is |R^-1 Q^T d|^2."""
    columns = lower[:, :rank].T.copy()
    length = away.shape[0]
    upper, z = np.zeros((rank, rank)), np.zeros(max(rank, 1))
    for k in range(rank):
        q = columns[k]
        upper[k, k] = np.sqrt(_product(q, q, length))
        for b in range(length):
            q[b] /= upper[k, k]
        z[k] = _product(q, away, length)
        _less(away, q, z[k], length)
        for j in range(k + 1, rank):
            upper[k, j] = _product(q, columns[j], length)
            _less(columns[j], q, upper[k, j], length)
    total = 0.0
    for i in range(rank - 1, -1, -1):
        for j in range(i + 1, rank):
            z[i] -= upper[i, j] * z[j]
        z[i] /= upper[i, i]
        total += z[i] * z[i]
    return total


@njit(nogil=True, cache=True)
def _inverse_form(ring, n, away, least):  # type: ignore[no-untyped-def]
    """d^T (R R^T)^+ d for a ring R, (band, pixel), less its mean; and whether R R^T has full rank."""
    bands = ring.shape[0]
    own, squares, right = np.empty(bands), np.empty(bands), np.empty(bands)
    for b in range(bands):
        own[b] = _product(ring[b], ring[b], n)
    lower, order = np.zeros((bands, bands)), np.empty(bands, np.int64)
    _triangle(ring, n, lower, order, squares)
    full, rank, total = True, 0, 0.0
    for k in range(bands):
        right[k] = away[order[k]]
        full &= squares[k] > least * bands * own[order[k]]
        rank += squares[k] > least * bands * own.sum()
    if not full:
        return _of_lower_rank(lower, rank, right), False
    for i in range(bands):
        right[i] = (right[i] - _product(lower[i], right, i)) / lower[i, i]
        total += right[i] * right[i]
    return total, True


@njit(nogil=True, cache=True)
def score_rings(x, known, inner, outer, ddof, ridge, least, scores, states):  # type: ignore[no-untyped-def]
    """Score the pixels whose state is 255, one by one; arrays as `detect._kernels.ring_scores` takes them.

    least : what is left of a band below this share of its sum of squares, times the bands, is rounding
    """
    bands, half = x.shape[1], outer // 2
    ring, away = np.empty((bands, outer * outer + bands)), np.empty(bands)
    for r in range(scores.shape[0]):
        for c in range(scores.shape[1]):
            if states[r, c] != ASIDE:
                continue
            n = _collect(x, known, r, c, inner, outer, ring)
            if n < 2 or n <= ddof:
                scores[r, c], states[r, c] = np.nan, TOO_FEW
                continue
            ring[:, n : n + bands] = 0.0
            for b in range(bands):
                away[b] = x[r + half, b, c + half] - _centred(ring[b], n)
                ring[b, n + b] = np.sqrt(ridge * _product(ring[b], ring[b], n))  # adds to this band's variance alone
            value, full = _inverse_form(ring, n + bands if ridge > 0 else n, away, least)
            scores[r, c], states[r, c] = value * (n - ddof), FINE if full else DEFICIENT
