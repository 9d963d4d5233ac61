"""The compiled twin of `detect.rx.score`, for large arrays of few bands; the tests run over both."""

import numpy as np

from deglint.jit import njit

FEW = 8  # bands up to which a pixel and the whole triangle are held in registers
WIDTH = 256  # pixels scored side by side: they stay in the first-level cache


@njit(nogil=True, cache=True, fastmath={"contract"})
def _add_four(row, other, x, b, z, y):  # type: ignore[no-untyped-def]
    """z += row . x and y += other . x over the bands b..b+3: two rows at a time load x once."""
    a0, a1, a2, a3 = row[b], row[b + 1], row[b + 2], row[b + 3]
    c0, c1, c2, c3 = other[b], other[b + 1], other[b + 2], other[b + 3]
    for c in range(WIDTH):
        x0, x1, x2, x3 = x[b, c], x[b + 1, c], x[b + 2, c], x[b + 3, c]
        z[c] += a0 * x0 + a1 * x1 + a2 * x2 + a3 * x3
        y[c] += c0 * x0 + c1 * x1 + c2 * x2 + c3 * x3


@njit(nogil=True, cache=True, fastmath={"contract"})
def _add_squares(row, other, x, b, z, y, total):  # type: ignore[no-untyped-def]
    """The same for the last four bands, and total += z^2 + y^2."""
    a0, a1, a2, a3 = row[b], row[b + 1], row[b + 2], row[b + 3]
    c0, c1, c2, c3 = other[b], other[b + 1], other[b + 2], other[b + 3]
    for c in range(WIDTH):
        x0, x1, x2, x3 = x[b, c], x[b + 1, c], x[b + 2, c], x[b + 3, c]
        s = z[c] + (a0 * x0 + a1 * x1 + a2 * x2 + a3 * x3)
        t = y[c] + (c0 * x0 + c1 * x1 + c2 * x2 + c3 * x3)
        total[c] += s * s + t * t


@njit(nogil=True, cache=True, fastmath={"contract"})
def squared_lengths(flat, first, mean, rest, matrix, linear, out):  # type: ignore[no-untyped-def]
    """out = |matrix (x - mean - rest)|^2 + linear . (x - mean - rest).

    As many pixels of `flat`, from `first` on, as `out` has room for.
    flat : (bands, pixels); matrix : (rows, columns), an upper triangle, an even number of rows, and of columns at least
    `bands` and a multiple of 4, filled up with zeros; linear : (columns,), or of no length
    """
    bands, pixels, columns = flat.shape[0], out.shape[0], matrix.shape[1]
    x, total = np.zeros((columns, WIDTH)), np.empty(WIDTH)
    z, y = np.empty(WIDTH), np.empty(WIDTH)
    moved = np.zeros(matrix.shape[0])
    for b in range(bands):
        moved += matrix[:, b] * rest[b]
    for start in range(0, pixels, WIDTH):
        count = min(WIDTH, pixels - start)
        for b in range(bands):
            band, target, centre = flat[b, first + start : first + start + count], x[b], mean[b]
            for c in range(count):
                target[c] = band[c] - centre
        total[:] = 0.0
        for b in range(min(bands, linear.shape[0])):
            for c in range(WIDTH):
                total[c] += linear[b] * (x[b, c] - rest[b])
        for i in range(0, matrix.shape[0], 2):
            z[:], y[:] = -moved[i], -moved[i + 1]
            for b in range(i // 4 * 4, columns - 4, 4):
                _add_four(matrix[i], matrix[i + 1], x, b, z, y)
            _add_squares(matrix[i], matrix[i + 1], x, columns - 4, z, y, total)
        target = out[start : start + count]
        for c in range(count):
            target[c] = total[c]


@njit(nogil=True, cache=True, fastmath={"contract"})
def _square_of_eight(a, moved, x0, x1, x2, x3, x4, x5, x6, x7):  # type: ignore[no-untyped-def]
    z = ((a[0] * x0 + a[1] * x1) + (a[2] * x2 + a[3] * x3)) + ((a[4] * x4 + a[5] * x5) + (a[6] * x6 + a[7] * x7))
    return (z - moved) * (z - moved)


@njit(nogil=True, cache=True, fastmath={"contract"})
def _square_of_four(a, moved, x4, x5, x6, x7):  # type: ignore[no-untyped-def]
    z = (a[4] * x4 + a[5] * x5) + (a[6] * x6 + a[7] * x7)
    return (z - moved) * (z - moved)


@njit(nogil=True, cache=True, fastmath={"contract"})
def squared_lengths_of_few(flat, first, mean, matrix, moved, out):  # type: ignore[no-untyped-def]
    """out = |matrix (x - mean) - moved|^2 for at most `FEW` bands, all of which stay in registers.

    mean, moved : tuples of 8; matrix : tuple of 8 tuples of 8, an upper triangle; filled up with zeros
    """
    end, last = first + out.shape[0], flat.shape[0] - 1
    b0, b1 = flat[0, first:end], flat[min(1, last), first:end]  # what fills up is multiplied by 0
    b2, b3 = flat[min(2, last), first:end], flat[min(3, last), first:end]
    b4, b5 = flat[min(4, last), first:end], flat[min(5, last), first:end]
    b6, b7 = flat[min(6, last), first:end], flat[min(7, last), first:end]
    for p in range(out.shape[0]):
        x0, x1, x2, x3 = b0[p] - mean[0], b1[p] - mean[1], b2[p] - mean[2], b3[p] - mean[3]
        x4, x5, x6, x7 = b4[p] - mean[4], b5[p] - mean[5], b6[p] - mean[6], b7[p] - mean[7]
        total = _square_of_eight(matrix[0], moved[0], x0, x1, x2, x3, x4, x5, x6, x7)
        total += _square_of_eight(matrix[1], moved[1], x0, x1, x2, x3, x4, x5, x6, x7)
        total += _square_of_eight(matrix[2], moved[2], x0, x1, x2, x3, x4, x5, x6, x7)
        total += _square_of_eight(matrix[3], moved[3], x0, x1, x2, x3, x4, x5, x6, x7)
        total += _square_of_four(matrix[4], moved[4], x4, x5, x6, x7)
        total += _square_of_four(matrix[5], moved[5], x4, x5, x6, x7)
        total += _square_of_four(matrix[6], moved[6], x4, x5, x6, x7)
        total += _square_of_four(matrix[7], moved[7], x4, x5, x6, x7)
        out[p] = total
