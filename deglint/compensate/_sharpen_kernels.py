"""Compiled: correlation with sums of columns times rows, and Richardson-Lucy on top of it, row by row.

Every sum is taken in one order, tap by tap, whatever the width of the array and of the processor's registers, and no
product is fused with a sum: a tile gives what the whole gives, to the bit. All stages of an iteration run side by
side, each some rows behind the one before it, so that what they pass on stays in the processor's cache.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from ._apart import apart

LEAST_RATIO, MOST_RATIO = np.float32(1e-3), np.float32(1e3)
"""The ratio of what is seen to what is predicted is kept within these."""
NEXT_TO_NOTHING = np.float32(1e-30)
"""What is not positive is taken as this."""


@nb.njit(cache=True, nogil=True)
def more(a, b, c, d, k, out):  # type: ignore[no-untyped-def]
    """Add four rows times k[0..3] to a row."""
    apart()
    k0, k1, k2, k3 = k[0], k[1], k[2], k[3]
    for j in range(out.size):
        out[j] = out[j] + k0 * a[j] + k1 * b[j] + k2 * c[j] + k3 * d[j]


@nb.njit(cache=True, nogil=True)
def two_more(a, b, k, out):  # type: ignore[no-untyped-def]
    """Add two rows times k[0..1] to a row."""
    apart()
    k0, k1 = k[0], k[1]
    for j in range(out.size):
        out[j] = out[j] + k0 * a[j] + k1 * b[j]


@nb.njit(cache=True, nogil=True)
def begun(a, k, add, out):  # type: ignore[no-untyped-def]
    """A row times k, put down or added."""
    apart()
    if add:
        for j in range(out.size):
            out[j] = out[j] + k * a[j]
    else:
        for j in range(out.size):
            out[j] = k * a[j]


@nb.njit(cache=True, nogil=True)
def row_of(x, first, down, across, left, spare, out):  # type: ignore[no-untyped-def]
    """One row of the correlation of x, a ring of rows, of which `first` is under the topmost tap.

    The leftmost tap of out[0] is on column `left`. down, across : (product, tap); spare : a row of scratch
    """
    apart()
    taps, depth = down.shape[1], len(x)
    wide = out.size + taps - 1
    to = spare[:wide]
    for r in range(len(down)):
        begun(x[first % depth, left : left + wide], down[r, 0], False, to)
        t = 1
        while t + 4 <= taps:
            more(
                x[(first + t) % depth, left : left + wide], x[(first + t + 1) % depth, left : left + wide],
                x[(first + t + 2) % depth, left : left + wide], x[(first + t + 3) % depth, left : left + wide],
                down[r, t:], to,
            )  # fmt: skip
            t += 4
        if t < taps:
            two_more(x[(first + t) % depth, left:], x[(first + t + 1) % depth, left:], down[r, t:], to)
        begun(to, across[r, 0], r > 0, out)
        t = 1
        while t + 4 <= taps:
            more(to[t:], to[t + 1 :], to[t + 2 :], to[t + 3 :], across[r, t:], out)
            t += 4
        if t < taps:
            two_more(to[t:], to[t + 1 :], across[r, t:], out)


@nb.njit(cache=True, nogil=True)
def folded(m, a, b, c, d, e, f, k, add, out):  # type: ignore[no-untyped-def]
    """The middle row and three pairs of rows beside it times k[0..3], put down or added."""
    apart()
    k0, k1, k2, k3 = k[0], k[1], k[2], k[3]
    if add:
        for j in range(out.size):
            out[j] = out[j] + k0 * m[j] + k1 * (a[j] + b[j]) + k2 * (c[j] + d[j]) + k3 * (e[j] + f[j])
    else:
        for j in range(out.size):
            out[j] = k0 * m[j] + k1 * (a[j] + b[j]) + k2 * (c[j] + d[j]) + k3 * (e[j] + f[j])


@nb.njit(cache=True, nogil=True)
def pair(a, b, k, out):  # type: ignore[no-untyped-def]
    """Add a pair of rows times k."""
    apart()
    for j in range(out.size):
        out[j] = out[j] + k * (a[j] + b[j])


@nb.njit(cache=True, nogil=True)
def two_pairs(a, b, c, d, k, out):  # type: ignore[no-untyped-def]
    """Add two pairs of rows times k[0..1]."""
    apart()
    k0, k1 = k[0], k[1]
    for j in range(out.size):
        out[j] = out[j] + k0 * (a[j] + b[j]) + k1 * (c[j] + d[j])


@nb.njit(cache=True, nogil=True)
def folded_both(m, a, b, c, d, e, f, k, q, out, other):  # type: ignore[no-untyped-def]
    """`folded` with two kernels at once, put down."""
    apart()
    k0, k1, k2, k3 = k[0], k[1], k[2], k[3]
    q0, q1, q2, q3 = q[0], q[1], q[2], q[3]
    for j in range(out.size):
        x, y, z = a[j] + b[j], c[j] + d[j], e[j] + f[j]
        out[j] = k0 * m[j] + k1 * x + k2 * y + k3 * z
        other[j] = q0 * m[j] + q1 * x + q2 * y + q3 * z


@nb.njit(cache=True, nogil=True)
def pair_both(a, b, k, q, out, other):  # type: ignore[no-untyped-def]
    """`pair` with two kernels at once."""
    apart()
    for j in range(out.size):
        x = a[j] + b[j]
        out[j] = out[j] + k * x
        other[j] = other[j] + q * x


@nb.njit(cache=True, nogil=True)
def two_pairs_both(a, b, c, d, k, q, out, other):  # type: ignore[no-untyped-def]
    """`two_pairs` with two kernels at once."""
    apart()
    k0, k1, q0, q1 = k[0], k[1], q[0], q[1]
    for j in range(out.size):
        x, y = a[j] + b[j], c[j] + d[j]
        out[j] = out[j] + k0 * x + k1 * y
        other[j] = other[j] + q0 * x + q1 * y


@nb.njit(cache=True, nogil=True)
def across_even(to, k, radius, add, out):  # type: ignore[no-untyped-def]
    """A row times taps that are the same from either end, put down or added; k : from the middle on."""
    apart()
    c = to[radius:]
    folded(c, to[radius - 1 :], c[1:], to[radius - 2 :], c[2:], to[radius - 3 :], c[3:], k, add, out)
    t = 4
    while t < radius:
        two_pairs(to[radius - t :], c[t:], to[radius - t - 1 :], c[t + 1 :], k[t:], out)
        t += 2
    if t == radius:
        pair(to[radius - t :], c[t:], k[t], out)


@nb.njit(cache=True, nogil=True)
def row_of_even(x, first, down, across, left, spare, out):  # type: ignore[no-untyped-def]
    """The same as `row_of` for two products of columns and rows that are the same from either end, of radius 3 or more;
    spare : two rows of scratch."""
    apart()
    radius, depth = down.shape[1] // 2, len(x)
    wide, m = out.size + 2 * radius, first + radius
    end, to, other = left + wide, spare[0, :wide], spare[1, :wide]
    k, q = down[0, radius:], down[1, radius:]
    folded_both(
        x[m % depth, left:end], x[(m - 1) % depth, left:end], x[(m + 1) % depth, left:end],
        x[(m - 2) % depth, left:end], x[(m + 2) % depth, left:end], x[(m - 3) % depth, left:end],
        x[(m + 3) % depth, left:end], k, q, to, other,
    )  # fmt: skip
    t = 4
    while t < radius:
        two_pairs_both(
            x[(m - t) % depth, left:end], x[(m + t) % depth, left:end],
            x[(m - t - 1) % depth, left:end], x[(m + t + 1) % depth, left:end], k[t:], q[t:], to, other,
        )  # fmt: skip
        t += 2
    if t == radius:
        pair_both(x[(m - t) % depth, left:end], x[(m + t) % depth, left:end], k[t], q[t], to, other)
    across_even(to, across[0, radius:], radius, False, out)
    across_even(other, across[1, radius:], radius, True, out)


@nb.njit(cache=True, nogil=True)
def correlate(x, down, across, even, out):  # type: ignore[no-untyped-def]
    """Correlation of x with the sum of columns times rows; what is nearer than the radius to an edge of out is left."""
    spare, radius = np.empty((2, x.shape[1]), np.float32), down.shape[1] // 2
    for i in range(radius, len(x) - radius):
        to = out[i, radius : x.shape[1] - radius]
        if even:
            row_of_even(x, i - radius, down, across, 0, spare, to)
        else:
            row_of(x, i - radius, down, across, 0, spare[0], to)


@nb.njit(cache=True, nogil=True)
def as_ratio(y, share, invalid, out):  # type: ignore[no-untyped-def]
    """What is seen over what is predicted, within limits."""
    apart()
    if share.size:
        for j in range(out.size):
            out[j] = out[j] / share[j]
    for j in range(out.size):
        seen = out[j] if out[j] > NEXT_TO_NOTHING else NEXT_TO_NOTHING
        ratio = y[j] / seen
        ratio = ratio if ratio > LEAST_RATIO else LEAST_RATIO
        out[j] = ratio if ratio < MOST_RATIO else MOST_RATIO
    if share.size:
        for j in range(out.size):
            out[j] = np.float32(0.0) if invalid[j] else out[j]


@nb.njit(cache=True, nogil=True)
def as_estimate(before, share, out):  # type: ignore[no-untyped-def]
    """The estimate before times its change."""
    apart()
    if share.size:
        for j in range(out.size):
            out[j] = out[j] / share[j]
    for j in range(out.size):
        out[j] = before[j] * (out[j] if out[j] > LEAST_RATIO else LEAST_RATIO)


@nb.njit(cache=True, nogil=True)
def iterate(y, start, blur, back, even, iterations, invalid, shares, out):  # type: ignore[no-untyped-def]
    """Richardson-Lucy, all half iterations side by side; out is 2 x iterations x radius smaller on every side.

    y : (row, column) float32, with nothing below `NEXT_TO_NOTHING`; start : the same, 0 where not valid; blur, back :
    columns and rows of P and of its transpose, (2, product, tap); invalid : bool ndarray like y; shares : (2, row,
    column), of the kernels on valid pixels; both empty where all are valid
    """
    taps = blur.shape[2]
    radius, stages, wide = taps // 2, 2 * iterations, y.shape[1]
    kept = np.empty((stages, taps, wide), np.float32)
    spare, some = np.empty((2, wide), np.float32), shares.size > 0
    none, never = np.empty(0, np.float32), np.empty(0, np.bool_)
    for step in range(radius, len(y) - radius + (stages - 1) * radius):
        for s in range(stages):
            i, margin = step - s * radius, (s + 1) * radius  # of the row, in y
            if i < margin or i >= len(y) - margin:
                continue
            x = start if s == 0 else kept[s - 1]
            to = kept[s, i % taps, margin : wide - margin]
            kernel = blur if s % 2 == 0 else back
            if even:
                row_of_even(x, i - radius, kernel[0], kernel[1], margin - radius, spare, to)
            else:
                row_of(x, i - radius, kernel[0], kernel[1], margin - radius, spare[0], to)
            share = shares[s % 2, i, margin : wide - margin] if some else none
            if s % 2 == 0:
                as_ratio(y[i, margin : wide - margin], share, invalid[i, margin : wide - margin] if some else never, to)
            elif s == 1:
                as_estimate(start[i, margin : wide - margin], share, to)
            else:
                as_estimate(kept[s - 2, i % taps, margin : wide - margin], share, to)
            if s == stages - 1:
                for j in range(to.size):
                    out[i - margin, j] = to[j]
