"""Compiled: how well one pixel's spectrum is explained by the shapes of things, and how well by sparkle."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

FLOOR = 0.02
"""Standard deviation in every band, as a share of the brightness of the thing."""
LEAST, MOST = 0.002, 1.5
"""Reflectance of a thing, over the water."""
SPREAD = math.log(300.0)
"""Brightness is anything from 0.5 % to 150 %, any factor as likely as any other."""
HOPELESS = 30.0
"""A shape whose chi-square at first sight, with bends taken for noise, is above this is none."""
SIDE = 5
"""Of the squares about a thing that nothing brighter than usual may be in, but what is the thing's [pixel]."""
STEPS_OF_POWER = 16
"""Iterations of the power method; what is looked for is within 1e-4 where it is small."""
LANES = 16
"""Shapes that are added up side by side."""
QUIET, INVALID = -32768, -32767
"""What `glance` says of a pixel that does not stand out, and of one that is not valid."""


class Steps(NamedTuple):
    """What `glance` adds up, in units of 1 / `QUARTERS`; see `deglint.compensate.glance`.

    cell, edge : of the search for the bin of a number, by the leading bits of it as float32
    start, first, step : (shape,), (bin,) and (step, shape) whole numbers, a step for every (band - 1, bin, bin); shapes
    are padded to a multiple of `LANES`
    """

    cell: npt.NDArray[np.uint8]
    edge: npt.NDArray[np.float32]
    start: npt.NDArray[np.int16]
    first: npt.NDArray[np.int16]
    step: npt.NDArray[np.int8]


@nb.njit(cache=True, nogil=True)
def weigh(z, bits, steps, rows, total):  # type: ignore[no-untyped-def]
    """Sum of the steps of every shape for reflectances z (band,) in the unit of the bins; `bits` is z seen as integers.

    Whole numbers, so that it does not matter in which order they are added; whole rows in loops without an `if`, so
    that many are added at once. rows : (band,) of int64, for scratch
    """
    before, bins, count, kinds = 0, steps.first.size, z.size, nb.uint64(total.size)
    for b in range(count):
        place = nb.int64(steps.cell[nb.uint64((bits[b] >> 20) & 4095)])
        place += z[b] >= steps.edge[nb.uint64(place)]
        rows[b] = place if b == 0 else ((b - 1) * bins + before) * bins + place
        before = place
    begin, start, step = steps.first[rows[0]], steps.start, steps.step
    for k in range(kinds):
        total[k] = start[k] + begin
    for b in range(1, count):
        row = nb.uint64(rows[b])
        for k in range(kinds):
            total[k] += step[row, k]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def glance(raw, level, bands, scale, noise, away, steps, out):  # type: ignore[no-untyped-def]
    """The largest sum of steps of each pixel, out (row, column), where two bands exceed the level by `away` deviations.

    `QUIET` where not, and `INVALID` where a band is not finite. raw, level : (band, row, column) of one dtype; scale :
    (band,) from the unit of the scene to that of the bins; noise : (band, 2), both of that dtype
    """
    count, width = bands.size, raw.shape[2]
    high, sound = np.empty(width, np.int32), np.empty(width, np.bool_)
    z, rows, total = np.empty(count, np.float32), np.empty(count, np.int64), np.empty(steps.start.size, np.int16)
    bits, limit = z.view(np.int32), away * away
    for i in range(raw.shape[1]):
        high[:] = 0
        sound[:] = True
        for b in range(count):
            seen, water, fixed, rising = raw[bands[b], i], level[bands[b], i], noise[b, 0], noise[b, 1]
            for j in range(width):
                more = seen[j] - water[j]
                high[j] += more * abs(more) > limit * (fixed + rising * max(seen[j], 0))
                sound[j] &= more - more == 0
        for j in range(width):
            if not sound[j]:
                out[i, j] = INVALID
            elif high[j] < 2:
                out[i, j] = QUIET
            else:
                for b in range(count):
                    z[b] = (raw[bands[b], i, j] - level[bands[b], i, j]) * scale[b]
                weigh(z, bits, steps, rows, total)
                most = total[0]
                for k in range(total.size):
                    most = max(most, total[k])
                out[i, j] = most


@nb.njit(cache=True, nogil=True)
def squares(score, least, threshold, out):  # type: ignore[no-untyped-def]
    """Pixels above `least` in a 3 x 3 square over which these sum up to the threshold; always added in one order."""
    rows, columns = score.shape
    sums = np.zeros((rows + 2, columns + 2))
    for i in range(rows):
        for j in range(columns):
            if score[i, j] > least:
                for down in range(3):
                    for right in range(3):
                        sums[i + down, j + right] += score[i, j]
    for i in range(rows):
        for j in range(columns):
            out[i, j] = False
            if score[i, j] > least:
                for down in range(max(i, 1), min(i + 3, rows + 1)):
                    for right in range(max(j, 1), min(j + 3, columns + 1)):
                        out[i, j] |= sums[down, right] >= threshold


@nb.njit(cache=True, nogil=True)
def rigid(score, place, own, least, threshold, changes, out):  # type: ignore[no-untyped-def]
    """Pixels above `least` in a 3 x 3 square that sums up to the threshold, or to more if its outline changes.

    place : (row, column), where in `own` a pixel is; own : (pixel, band), its excess; changes : part of the power that
    one outline need not explain
    """
    rows, columns = score.shape
    inside = np.empty(9, np.int64)
    for i in range(rows):
        for j in range(columns):
            out[i, j] = False
    for i in range(rows):
        for j in range(columns):
            total, count = 0.0, 0
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    if score[k, m] > least:
                        total += score[k, m]
                        inside[count] = place[k, m]
                        count += 1
            if total < threshold:
                continue
            rest, power = unexplained(own, inside[:count])
            if total * changes * power < threshold * rest:
                continue
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    out[k, m] |= score[k, m] > least


@nb.njit(cache=True, nogil=True)
def quiet(beside, most, besides, out):  # type: ignore[no-untyped-def]
    """Leave out pixels about which there is more than one outline: beside a part of the power, and some more.

    beside : excess of all pixels as (raw, level, bands, white)
    """
    around, every = np.empty((SIDE * SIDE, beside[2].size)), np.arange(SIDE * SIDE)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            if out[i, j]:
                rest, power = unexplained(around, every[: surroundings(beside, i, j, around)])
                out[i, j] = rest <= most * power + besides


@nb.njit(cache=True, nogil=True)
def surroundings(beside, i, j, out):  # type: ignore[no-untyped-def]
    """Excess of the valid pixels of a square about a place, (pixel, band); returns how many."""
    raw, level, bands, white = beside
    count = 0
    for k in range(max(i - SIDE // 2, 0), min(i + SIDE // 2 + 1, raw.shape[1])):
        for m in range(max(j - SIDE // 2, 0), min(j + SIDE // 2 + 1, raw.shape[2])):
            sound = True
            for n in range(bands.size):
                out[count, n] = (np.float64(raw[bands[n], k, m]) - np.float64(level[bands[n], k, m])) / white[n]
                sound &= math.isfinite(out[count, n])
            count += sound
            if count == len(out):
                return count
    return count


@nb.njit(cache=True, nogil=True)
def unexplained(own, inside):  # type: ignore[no-untyped-def]
    """Power of some pixels' excess that no one outline, seen in all bands, explains; and their power.

    The largest eigenvalue of the bands' products, by the power method, is what one outline explains.
    """
    count = own.shape[1]
    products, v = np.zeros((count, count)), np.full(count, 1 / math.sqrt(count))
    for n in inside:
        for a in range(count):
            for b in range(count):
                products[a, b] += own[n, a] * own[n, b]
    power = most = 0.0
    for a in range(count):
        power += products[a, a]
    for _ in range(STEPS_OF_POWER):
        w = np.zeros(count)
        for a in range(count):
            for b in range(count):
                w[a] += products[a, b] * v[b]
        most = math.sqrt((w * w).sum())
        if most == 0:
            return power, power
        v = w / most
    return power - most, power


@nb.njit(cache=True, nogil=True)
def explain(y, variance, water, kinds, bends, share, steps, limits, sparkle, out, fit):  # type: ignore[no-untyped-def]
    """S of each pixel by its best shape, and the spectrum of that.

    y, variance, fit : (pixel, band); kinds : values (shape, band), (shape, 3) of slope, bend, roughness, odd band, log
    weight; bends : (2, band); share : mean and standard deviation of the part of the water that the thing hides;
    limits : unit of the bins, ln that a step is worth, how much S may be above the sum of these, S that matters;
    sparkle, out : (pixel,)
    """
    unit, worth, room, least = limits
    count, weight = y.shape[1], kinds[3]
    x, d, u, part = np.empty(count), np.empty(count), np.empty((3, count)), np.empty(3)
    z, rows, total = np.empty(count, np.float32), np.empty(count, np.int64), np.empty(steps.start.size, np.int16)
    bits = z.view(np.int32)
    for i in range(y.shape[0]):
        out[i] = -np.inf
        for b in range(count):
            x[b] = y[i, b] + share[0] * water[b]
            z[b] = y[i, b] / unit
        weigh(z, bits, steps, rows, total)
        likely = np.argmax(total)
        for n in range(weight.size):
            k = (n + likely) % weight.size
            if total[k] * worth + room <= max(out[i], least):
                continue
            found, a = shaped(x, variance[i], water, kinds, k, bends, share[1], d, u, part)
            found += weight[k] - sparkle[i]
            if found > out[i]:
                out[i] = found
                for b in range(count):
                    bent = part[0] * u[0, b] + part[1] * u[1, b] + part[2] * u[2, b]
                    fit[i, b] = a * kinds[0][k, b] + bent - share[0] * water[b]


@nb.njit(cache=True, nogil=True)
def shaped(x, variance, water, kinds, k, bends, hidden, d, u, part):  # type: ignore[no-untyped-def]
    """Log-likelihood of x by shape k, and its brightness, in two rounds; minus infinity for one that no thing has."""
    values, spread, odd = kinds[0][k], kinds[1][k], kinds[2][k]
    a, chi = plainly(x, variance, water, values, spread, odd, hidden)
    found = -np.inf
    if chi > HOPELESS:
        return found, a
    for _ in range(2):
        if not LEAST < a < MOST:
            return -np.inf, a
        for b in range(x.size):
            bright = a * values[b]
            d[b] = variance[b] + (spread[2] * bright) ** 2 + (FLOOR * a) ** 2
            if b == odd:
                d[b] += a * a
            u[0, b] = spread[0] * bends[0, b] * bright
            u[1, b] = spread[1] * bends[1, b] * bright
            u[2, b] = hidden * water[b]
        found, a = likelihood(x, values, d, u, part)
    if not LEAST < a < MOST:
        return -np.inf, a
    return found - math.log(a * SPREAD), a


@nb.njit(cache=True, nogil=True)
def plainly(x, variance, water, values, spread, odd, hidden):  # type: ignore[no-untyped-def]
    """A first brightness of a shape, and the chi-square that it leaves, with bends and hidden water taken for noise."""
    up = down = chi = 0.0
    for b in range(x.size):
        if b != odd:
            up += values[b] * x[b]
            down += values[b] * values[b]
    a, wide = up / down, spread[0] ** 2 + spread[1] ** 2 + spread[2] ** 2
    for b in range(x.size):
        if b != odd:
            bright = a * values[b]
            noise = variance[b] + (hidden * water[b]) ** 2 + (FLOOR * a) ** 2
            chi += (x[b] - bright) ** 2 / (noise + bright * bright * wide)
    return a, chi


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
