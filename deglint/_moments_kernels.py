"""The compiled twin of the inner loop of `deglint.moments`, for large samples; the tests run over both."""

import numpy as np

from .jit import njit

# The order of additions may change (so that they run in vector registers), nothing else: NaN and infinity keep
# their meaning, and the same machine code gives the same bits for the same cell.
_FAST = {"reassoc", "contract", "nsz"}


RUN = 512  # pixels reduced at a time: all variables of a run stay in the first-level cache
LANES = 64  # columns of a run whose range is held side by side
GATHERED = 128  # values of a row that are gathered before the next row: cells times variables, so that memory streams


@njit(nogil=True, cache=True, fastmath=_FAST)
def _products(x, i, j, m, out):  # type: ignore[no-untyped-def]
    """Rows i..i+3, columns j..j+3 of x x^T over the first m pixels: sixteen sums stay in registers."""
    a0, a1, a2, a3 = x[i], x[i + 1], x[i + 2], x[i + 3]
    b0, b1, b2, b3 = x[j], x[j + 1], x[j + 2], x[j + 3]
    s00 = s01 = s02 = s03 = s10 = s11 = s12 = s13 = s20 = s21 = s22 = s23 = s30 = s31 = s32 = s33 = 0.0
    for p in range(m):
        u0, u1, u2, u3 = a0[p], a1[p], a2[p], a3[p]
        v0, v1, v2, v3 = b0[p], b1[p], b2[p], b3[p]
        s00, s01, s02, s03 = s00 + u0 * v0, s01 + u0 * v1, s02 + u0 * v2, s03 + u0 * v3
        s10, s11, s12, s13 = s10 + u1 * v0, s11 + u1 * v1, s12 + u1 * v2, s13 + u1 * v3
        s20, s21, s22, s23 = s20 + u2 * v0, s21 + u2 * v1, s22 + u2 * v2, s23 + u2 * v3
        s30, s31, s32, s33 = s30 + u3 * v0, s31 + u3 * v1, s32 + u3 * v2, s33 + u3 * v3
    out[i, j], out[i, j + 1], out[i, j + 2], out[i, j + 3] = s00, s01, s02, s03
    out[i + 1, j], out[i + 1, j + 1], out[i + 1, j + 2], out[i + 1, j + 3] = s10, s11, s12, s13
    out[i + 2, j], out[i + 2, j + 1], out[i + 2, j + 2], out[i + 2, j + 3] = s20, s21, s22, s23
    out[i + 3, j], out[i + 3, j + 1], out[i + 3, j + 2], out[i + 3, j + 3] = s30, s31, s32, s33


@njit(nogil=True, cache=True)
def _gather(block, r, c0, c1, values, start):  # type: ignore[no-untyped-def]
    """Put columns c0..c1 of row r into `values` from `start`."""
    for v in range(block.shape[0]):
        if c1 - c0 == LANES:  # as wide as a cell most often is: a known number of vectors
            row, target = block[v, r, c0 : c0 + LANES], values[v, start : start + LANES]
            for p in range(LANES):
                target[p] = row[p]
        else:
            for p in range(c1 - c0):
                values[v, start + p] = block[v, r, c0 + p]


@njit(nogil=True, cache=True)
def _inside(mask, r0, r1, c0, c1):  # type: ignore[no-untyped-def]
    """How many pixels of some rows and columns are masked in."""
    count = 0
    for r in range(r0, r1):
        for c in range(c0, c1):
            count += mask[r, c]
    return count


@njit(nogil=True, cache=True)
def _packed(values, mask, r0, r1, c0, c1):  # type: ignore[no-untyped-def]
    """Move the valid ones of the gathered pixels to the front; returns how many. A mask of no size is True."""
    count, p = 0, 0
    for r in range(r0, r1):
        for c in range(c0, c1):
            good = mask.size == 0 or mask[r, c]
            for v in range(values.shape[0]):
                good &= (values[v, p] - values[v, p]) == 0
            if good:
                for v in range(values.shape[0]):
                    values[v, count] = values[v, p]
                count += 1
            p += 1
    return count


@njit(nogil=True, cache=True)
def _lower(a, b):  # type: ignore[no-untyped-def]
    return a if a < b else b


@njit(nogil=True, cache=True)
def _higher(a, b):  # type: ignore[no-untyped-def]
    return a if a > b else b


@njit(nogil=True, cache=True, fastmath=_FAST)
def _range(row, m, low, high):  # type: ignore[no-untyped-def]
    """Widen a range to hold the first m entries; it is held in lanes, which run in vector registers."""
    done = m // (4 * LANES) * 4 * LANES
    for s in range(0, done, 4 * LANES):
        for q in range(s, s + LANES):
            a, b, c, d = row[q], row[q + LANES], row[q + 2 * LANES], row[q + 3 * LANES]
            low[q - s] = _lower(_lower(_lower(a, b), _lower(c, d)), low[q - s])
            high[q - s] = _higher(_higher(_higher(a, b), _higher(c, d)), high[q - s])
    for p in range(done, m):
        low[0], high[0] = _lower(row[p], low[0]), _higher(row[p], high[0])


@njit(nogil=True, cache=True, fastmath=_FAST)
def _centred(values, m, row):  # type: ignore[no-untyped-def]
    """Put the first m values, less their mean, into a row; returns the mean in two parts, and what rounding left.

    All are finite where what is left is.
    """
    first, middle, last = np.float64(values[0]), np.float64(values[m // 2]), np.float64(values[m - 1])
    shift = max(min(first, middle), min(max(first, middle), last))  # of a constant, that; never one stray pixel
    total, left = 0.0, 0.0
    for p in range(m):
        row[p] = values[p] - shift
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
        mean[:], rest[:] = mean_b, rest_b
        for i in range(mean.shape[0]):
            for j in range(i + 1):
                comoment[i, j] = comoment[j, i] = comoment_b[i, j]
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
def _reduce_run(values, m, x, mean, rest, comoment):  # type: ignore[no-untyped-def]
    """Two-pass moments of the first m pixels of `values`, (variable, pixel); returns whether all are finite.

    x : room for the pixels less their mean; its rows beyond the variables are 0
    """
    variables = values.shape[0]
    left, total = np.empty(variables), 0.0
    for v in range(variables):
        shift, centre, left[v] = _centred(values[v], m, x[v])
        mean[v], rest[v] = _two_sum(shift, centre + left[v])
        total += left[v]
    if total - total != 0:
        return False
    for i in range(0, variables, 4):
        for j in range(0, i + 1, 4):
            _products(x, i, j, m, comoment)
    for i in range(variables):
        for j in range(i + 1):
            comoment[i, j] -= m * left[i] * left[j]
    return True


@njit(nogil=True, cache=True)
def _reduce_valid(values, mask, r0, r1, c0, c1, x, mean, rest, comoment):  # type: ignore[no-untyped-def]
    """The same of the valid ones among the gathered pixels, which are moved to the front; returns how many."""
    m = max(r1 - r0, 0) * (c1 - c0)
    whole = m > 0 and (mask.size == 0 or _inside(mask, r0, r1, c0, c1) == m)
    if not (whole and _reduce_run(values, m, x, mean, rest, comoment)):
        m = _packed(values, mask, r0, r1, c0, c1)
        if m > 0:
            _reduce_run(values, m, x, mean, rest, comoment)
    return m


@njit(nogil=True, cache=True)
def reduce_cells(block, mask, row0, col0, cell, across, n, mean, comoment, low, high, rest):  # type: ignore[no-untyped-def]
    """Fill the per-cell arrays from a block whose first pixel lies at (row0, col0) within the first cell.

    A run is some rows of a cell. Runs of cells beside each other are gathered together: memory is read in long pieces.
    """
    variables, rows, columns = block.shape
    beside, step, filled = max(min(across, GATHERED // variables), 1), max(RUN // cell, 1), -(-variables // 4) * 4
    values, x = np.empty((beside, variables, step * cell), block.dtype), np.zeros((filled, step * cell))
    run_mean, run_rest, run_comoment = np.empty(variables), np.empty(variables), np.empty((filled, filled))
    least = np.empty((beside, variables, LANES), block.dtype)
    most = np.empty_like(least)
    for first in range(0, n.shape[0], across):
        top = first // across * cell - row0
        for k in range(0, across, beside):
            count = min(beside, across - k)
            least[:], most[:] = np.inf, -np.inf
            for start in range(top, min(top + cell, rows), step):
                r0, r1 = max(start, 0), min(start + step, top + cell, rows)
                for r in range(r0, r1):
                    for g in range(count):
                        left = (k + g) * cell - col0
                        c0, c1 = max(left, 0), min(left + cell, columns)
                        _gather(block, r, c0, c1, values[g], (r - r0) * (c1 - c0))
                for g in range(count):
                    i, left = first + k + g, (k + g) * cell - col0
                    c0, c1 = max(left, 0), min(left + cell, columns)
                    m = _reduce_valid(values[g], mask, r0, r1, c0, c1, x, run_mean, run_rest, run_comoment)
                    if m > 0:
                        for v in range(variables):
                            _range(values[g, v], m, least[g, v], most[g, v])
                        n[i] = _merge(n[i], mean[i], rest[i], comoment[i], float(m), run_mean, run_rest, run_comoment)
            for g in range(count):
                for v in range(variables):
                    low[first + k + g, v], high[first + k + g, v] = least[g, v].min(), most[g, v].max()
