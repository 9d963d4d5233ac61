"""The compiled twin of the inner loop of `deglint.moments`, for large samples; the tests run over both."""

import numpy as np
from numba import njit

# The order of additions may change (so that they run in vector registers), nothing else: NaN and infinity keep
# their meaning, and the same machine code gives the same bits for the same cell.
_FAST = {"reassoc", "contract", "nsz"}


RUN = 512  # pixels reduced at a time: all variables of a run stay in the first-level cache
LANES = 64  # columns of a run whose range is held side by side


@njit(nogil=True, cache=True, fastmath=_FAST)
def _products(x, i, m, out):  # type: ignore[no-untyped-def]
    """Row i of the lower triangle of x x^T over the first m pixels, four columns at a time."""
    a = x[i]
    j = 0
    while j + 4 <= i + 1:
        s0 = s1 = s2 = s3 = 0.0
        b0, b1, b2, b3 = x[j], x[j + 1], x[j + 2], x[j + 3]
        for p in range(m):
            s0 += a[p] * b0[p]
            s1 += a[p] * b1[p]
            s2 += a[p] * b2[p]
            s3 += a[p] * b3[p]
        out[i, j], out[i, j + 1], out[i, j + 2], out[i, j + 3] = s0, s1, s2, s3
        j += 4
    while j < i + 1:
        s = 0.0
        b = x[j]
        for p in range(m):
            s += a[p] * b[p]
        out[i, j] = s
        j += 1


@njit(nogil=True, cache=True, fastmath=_FAST)
def _sum(a, m):  # type: ignore[no-untyped-def]
    s = 0.0
    for p in range(m):
        s += a[p]
    return s


@njit(nogil=True, cache=True, fastmath=_FAST)
def _gather_all(block, r, c0, c1, buffer, start):  # type: ignore[no-untyped-def]
    """Append columns c0..c1 of row r to `buffer` from `start`; returns their sum, finite only where they all are."""
    total = 0.0
    for v in range(block.shape[0]):
        row, target = block[v, r, c0:c1], buffer[v, start : start + c1 - c0]
        for p in range(c1 - c0):
            value = np.float64(row[p])
            total += value
            target[p] = value
    return total


@njit(nogil=True, cache=True)
def _outside(mask, r, c0, c1):  # type: ignore[no-untyped-def]
    """Whether any of columns c0..c1 of row r is masked out."""
    inside = 0
    for c in range(c0, c1):
        inside += mask[r, c]
    return inside < c1 - c0


@njit(nogil=True, cache=True)
def _gather_some(block, mask, r, c0, c1, buffer, start, good):  # type: ignore[no-untyped-def]
    """Append the valid pixels of columns c0..c1 of row r to `buffer` from `start`; return the new length."""
    width = c1 - c0
    for p in range(width):
        good[p] = mask[r, c0 + p]
    for v in range(block.shape[0]):
        row = block[v, r, c0:c1]
        for p in range(width):
            good[p] &= (row[p] - row[p]) == 0
    m = start
    for v in range(block.shape[0]):
        m = start
        for p in range(width):
            if good[p]:
                buffer[v, m] = block[v, r, c0 + p]
                m += 1
    return m


@njit(nogil=True, cache=True, fastmath=_FAST)
def _range(row, m, low, high):  # type: ignore[no-untyped-def]
    """Widen a range to hold the first m entries; it is held in lanes, which run in vector registers."""
    for start in range(0, m - LANES + 1, LANES):
        part = row[start : start + LANES]
        for q in range(LANES):
            low[q] = part[q] if part[q] < low[q] else low[q]
            high[q] = part[q] if part[q] > high[q] else high[q]
    for p in range(m // LANES * LANES, m):
        low[0], high[0] = min(low[0], row[p]), max(high[0], row[p])


@njit(nogil=True, cache=True, fastmath=_FAST)
def _centred(row, m):  # type: ignore[no-untyped-def]
    """Take the mean away from the first m entries; returns it in two parts, and the mean that rounding has left."""
    first, middle, last = row[0], row[m // 2], row[m - 1]
    shift = max(min(first, middle), min(max(first, middle), last))  # of a constant, that; never one stray pixel
    total, left = 0.0, 0.0
    for p in range(m):
        row[p] -= shift
        total += row[p]
    centre = total / m
    for p in range(m):
        row[p] -= centre
        left += row[p]
    return shift, centre, left / m


@njit(nogil=True, cache=True)
def _two_sum(a, b):  # type: ignore[no-untyped-def]
    """a + b, rounded, and what rounding dropped (Knuth)."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@njit(nogil=True, cache=True)
def _merge(n, mean, rest, comoment, nb, mean_b, rest_b, comoment_b):  # type: ignore[no-untyped-def]
    """Chan, Golub and LeVeque's update of (n, mean + rest, comoment) in place; returns the new n.

    A mean is carried in two doubles, so that the difference of two means keeps its digits under a large offset.
    """
    if n == 0:
        mean[:], rest[:], comoment[:] = mean_b, rest_b, comoment_b
        for i in range(mean.shape[0]):
            for j in range(i):
                comoment[j, i] = comoment[i, j]
        return nb
    total = n + nb
    weight = n * nb / total
    variables = mean.shape[0]
    for i in range(variables):
        di = (mean_b[i] - mean[i]) + (rest_b[i] - rest[i])
        for j in range(i + 1):
            dj = (mean_b[j] - mean[j]) + (rest_b[j] - rest[j])
            value = comoment[i, j] + comoment_b[i, j] + di * dj * weight
            comoment[i, j] = value
            comoment[j, i] = value
    for i in range(variables):
        step = ((mean_b[i] - mean[i]) + (rest_b[i] - rest[i])) * (nb / total) + rest[i]
        mean[i], rest[i] = _two_sum(mean[i], step)
    return total


@njit(nogil=True, cache=True)
def _reduce_run(buffer, m, mean, rest, comoment, low, high):  # type: ignore[no-untyped-def]
    """Two-pass moments of the first m entries of `buffer`, which is centred in place."""
    variables = mean.shape[0]
    left = np.empty(variables)
    for v in range(variables):
        _range(buffer[v], m, low[v], high[v])
        shift, centre, left[v] = _centred(buffer[v], m)
        mean[v], rest[v] = _two_sum(shift, centre + left[v])
    for i in range(variables):
        _products(buffer, i, m, comoment)
        for j in range(i + 1):
            comoment[i, j] -= m * left[i] * left[j]


@njit(nogil=True, cache=True)
def reduce_cells(block, mask, row0, col0, cell, across, n, mean, comoment, low, high, rest):  # type: ignore[no-untyped-def]
    """Fill the per-cell arrays from a block whose first pixel lies at (row0, col0) within the first cell."""
    variables, rows, columns = block.shape
    buffer = np.empty((variables, RUN + cell))
    good = np.empty(cell, np.bool_)
    run_mean, run_rest = np.empty(variables), np.empty(variables)
    run_comoment = np.empty((variables, variables))
    least, most = np.empty((variables, LANES)), np.empty((variables, LANES))
    for i in range(n.shape[0]):
        top, left = (i // across) * cell - row0, (i % across) * cell - col0
        r1, c0, c1 = min(top + cell, rows), max(left, 0), min(left + cell, columns)
        least[:], most[:] = np.inf, -np.inf
        m = 0
        for r in range(max(top, 0), r1):
            total = np.nan if _outside(mask, r, c0, c1) else _gather_all(block, r, c0, c1, buffer, m)
            if total - total == 0:  # finite, and no sum of finite numbers that overflowed
                m += c1 - c0
            else:
                m = _gather_some(block, mask, r, c0, c1, buffer, m, good)
            if m > 0 and (m >= RUN or r == r1 - 1):
                _reduce_run(buffer, m, run_mean, run_rest, run_comoment, least, most)
                n[i] = _merge(n[i], mean[i], rest[i], comoment[i], float(m), run_mean, run_rest, run_comoment)
                m = 0
        for v in range(variables):
            low[i, v], high[i, v] = least[v].min(), most[v].max()
