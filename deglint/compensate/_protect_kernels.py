"""Compiled: how well one pixel's spectrum is explained by the shapes of things, and how well by sparkle."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

FLOOR = 0.02
"""Standard deviation in every band, as a share of the brightness of the thing."""
SPREAD = math.log(300.0)
"""Brightness is anything from 0.5 % to 150 %, any factor as likely as any other."""
LEAST, MOST = 0.002, 1.5
"""Reflectance of a thing, over the water."""
HOPELESS = 30.0
"""A shape whose plain chi-square, with bends taken for noise, is above this is not looked into."""


PART = 0.25
"""Of the plain chi-square, what the true one is taken to be at least (in exponents: half of it counts)."""
ROOM = 0.5 * math.log(2 * math.pi) + 1.0
"""Brightness is known to its own size at least, and may be e times what it starts from."""


@nb.njit(cache=True, nogil=True)
def explain(y, variance, water, values, spread, odd, weight, bends, share, least, out, fit):  # type: ignore[no-untyped-def]  # noqa: C901
    """Log-likelihood of the best shape for each pixel, where it exceeds `least`, and its spectrum.

    y, variance, fit : (pixel, band); spread : (shape, 3) of slope, bend, roughness; bends : (2, band);
    share : mean and standard deviation of the part of the water that the thing hides; least, out : (pixel,)
    """
    count = y.shape[1]
    x, u, part = np.empty(count), np.empty((3, count)), np.empty(3)
    d = np.empty(count)
    kinds = values.shape[0]
    side, down, wide = np.empty((count, kinds)), np.zeros(kinds), np.empty(kinds)
    first, chi = np.empty(kinds), np.empty(kinds)
    for k in range(kinds):
        wide[k] = spread[k, 0] ** 2 + spread[k, 1] ** 2 + spread[k, 2] ** 2
        for b in range(count):
            side[b, k] = 0.0 if b == odd[k] else values[k, b]
            down[k] += side[b, k] ** 2
    for i in range(y.shape[0]):
        out[i] = -np.inf
        for b in range(count):
            x[b] = y[i, b] + share[0] * water[b]
        start(x, variance[i], water, side, down, wide, share[1], first, chi)
        for k in range(kinds):
            a = first[k]
            hope = least[i] - math.log(weight[k])
            if not reaches(x, variance[i], values[k], a, chi[k], spread[k, 2], odd[k], hope):
                continue
            for _ in range(2):
                for b in range(count):
                    bright = a * values[k, b]
                    d[b] = variance[i, b] + (spread[k, 2] * bright) ** 2 + (FLOOR * a) ** 2
                    if b == odd[k]:
                        d[b] += a * a
                    u[0, b] = spread[k, 0] * bends[0, b] * bright
                    u[1, b] = spread[k, 1] * bends[1, b] * bright
                    u[2, b] = share[1] * water[b]
                found, a_next = likelihood(x, values[k], d, u, part)
                a = a_next
                if not LEAST < a < MOST:
                    break
            if not LEAST < a < MOST:
                continue
            found += math.log(weight[k]) - math.log(a * SPREAD)
            if found > out[i]:
                out[i] = found
                for b in range(count):
                    bent = part[0] * u[0, b] + part[1] * u[1, b] + part[2] * u[2, b]
                    fit[i, b] = a * values[k, b] + bent - share[0] * water[b]


@nb.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def start(x, variance, water, shapes, down, wide, hidden, a, chi):  # type: ignore[no-untyped-def]
    """A first brightness of every shape, and its plain chi-square; shapes side by side, for the processor's sake.

    shapes : (band, shape), 0 where a band says nothing of a shape; down, wide : (shape,) their squares summed, and
    the variance of slope, bend and roughness together; a, chi : (shape,)
    """
    kinds, count = a.size, x.size
    for k in range(kinds):
        a[k] = 0.0
        chi[k] = 0.0
    for b in range(count):
        for k in range(kinds):
            a[k] += shapes[b, k] * x[b]
    for k in range(kinds):
        a[k] /= down[k]
    for b in range(count):
        fixed = variance[b] + (hidden * water[b]) ** 2
        for k in range(kinds):
            bright = a[k] * shapes[b, k]
            away = x[b] - bright
            narrow = fixed + (FLOOR * a[k]) ** 2 + bright * bright * wide[k]
            chi[k] += away * away / narrow if shapes[b, k] != 0.0 else 0.0


@nb.njit(cache=True, nogil=True)
def reaches(x, variance, shape, a, chi, rough, odd, least):  # type: ignore[no-untyped-def]
    """Whether a shape can reach the log-likelihood `least`.

    It cannot where the noise and roughness alone give less: bends only make the density lower. Bends may follow what
    is amiss, so that of the plain chi-square only a part is held against the shape; the few pixels lost have S near
    its least.
    """
    if not LEAST < a < MOST or chi > HOPELESS:
        return False
    product = 1.0
    for b in range(x.size):
        if b == odd:
            product *= a * a * 1e5
        else:
            product *= (variance[b] + (FLOOR * a) ** 2 + (a * shape[b] * rough) ** 2) * 1e5
    best = -0.5 * (math.log(product) + x.size * (math.log(2 * math.pi) - math.log(1e5))) + ROOM - SPREAD
    return best - PART * chi > least


@nb.njit(cache=True, nogil=True)
def likelihood(x, shape, d, u, part):  # type: ignore[no-untyped-def]
    """Log of the normal density of x with mean a * shape and covariance diag(d) + u' u, over all a; and the best a.

    By the Woodbury identity with a Cholesky factor of 3 x 3; `part` receives the parts of the rows of u.
    """
    xx = xs = ss = 0.0
    product = 1.0
    g00 = g11 = g22 = 1.0
    g10 = g20 = g21 = x0 = x1 = x2 = s0 = s1 = s2 = 0.0
    for b in range(x.size):
        r = 1.0 / d[b]
        product *= d[b] * 1e5  # keeps the product of up to some 20 variances within range
        xx += x[b] * x[b] * r
        xs += x[b] * shape[b] * r
        ss += shape[b] * shape[b] * r
        p, q, w = u[0, b] * r, u[1, b] * r, u[2, b] * r
        g00 += u[0, b] * p
        g10 += u[1, b] * p
        g20 += u[2, b] * p
        g11 += u[1, b] * q
        g21 += u[2, b] * q
        g22 += u[2, b] * w
        x0 += p * x[b]
        x1 += q * x[b]
        x2 += w * x[b]
        s0 += p * shape[b]
        s1 += q * shape[b]
        s2 += w * shape[b]
    l00 = math.sqrt(g00)
    l10, l20 = g10 / l00, g20 / l00
    l11 = math.sqrt(g11 - l10 * l10)
    l21 = (g21 - l20 * l10) / l11
    l22 = math.sqrt(g22 - l20 * l20 - l21 * l21)
    x0, s0 = x0 / l00, s0 / l00
    x1, s1 = (x1 - l10 * x0) / l11, (s1 - l10 * s0) / l11
    x2, s2 = (x2 - l20 * x0 - l21 * x1) / l22, (s2 - l20 * s0 - l21 * s1) / l22
    xx -= x0 * x0 + x1 * x1 + x2 * x2
    xs -= x0 * s0 + x1 * s1 + x2 * s2
    ss -= s0 * s0 + s1 * s1 + s2 * s2
    a = xs / ss
    determinant = 0.5 * (math.log(product) - x.size * math.log(1e5)) + math.log(l00 * l11 * l22)
    part[2] = (x2 - a * s2) / l22
    part[1] = (x1 - a * s1 - l21 * part[2]) / l11
    part[0] = (x0 - a * s0 - l10 * part[1] - l20 * part[2]) / l00
    chi = xx - xs * xs / ss
    return -0.5 * chi - determinant - 0.5 * (x.size - 1) * math.log(2 * math.pi) - 0.5 * math.log(ss), a


@nb.njit(cache=True, nogil=True)
def chain(y, first, following, low, step, unit, out):  # type: ignore[no-untyped-def]
    """Log density of each pixel's spectrum as a Markov chain over bands in the order of time; y is (pixel, band)."""
    last = first.size - 1
    for i in range(y.shape[0]):
        total = 0.0
        before = 0
        for b in range(y.shape[1]):
            z = y[i, b] / unit
            place = min(max(int((math.asinh(z) - low) / step), 0), last)
            total += first[place] if b == 0 else following[b - 1, before, place]
            total -= math.log(unit) + 0.5 * math.log1p(z * z)
            before = place
        out[i] = total
