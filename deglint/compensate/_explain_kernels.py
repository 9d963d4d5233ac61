"""Compiled: how well pixels' spectra are explained by the shapes of things, and how well by sparkle.

Pixels, each with a few shapes, are worked on band by band, so that many are reckoned side by side.
"""

from __future__ import annotations

import math

import numpy as np

from .. import jit as nb
from ._glance_kernels import SOON
from ._lanes import ahead

FLOOR = 0.02
"""Standard deviation in every band, as a share of the brightness of the thing."""
LEAST, MOST = 0.002, 1.5
"""Reflectance of a thing, over the water."""
SPREAD = math.log(300.0)
"""Brightness is anything from 0.5 % to 150 %, any factor as likely as any other."""
HOPELESS = 30.0
"""A shape whose chi-square at first sight, with bends taken for noise, is above this is none."""
BATCH = 64
"""Pairs of a pixel and a shape that are worked on together."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def gather(look, places, sensor, y, deviation, x, variance):  # type: ignore[no-untyped-def]
    """Excess of some pixels over the level and the noise, and that of a thing over black, the variance with texture.

    look : raw and level as Block, and how many columns they have; sensor : (band,) of bands, of white, (band, 2) of
    noise, water that a thing leaves, texture; all others : (band, pixel)
    """
    (raw, level, columns), (bands, white, noise, left, texture) = look, sensor
    for q in range(-SOON if places.size else 0, places.size):
        row, column = divmod(places[min(q + SOON, places.size - 1)], columns)
        for b in range(bands.size):
            ahead(raw.numbers, bands[b] * raw.band + row * raw.row + column)
            ahead(level.numbers, bands[b] * level.band + row * level.row + column)
        row, column = divmod(places[max(q, 0)], columns)
        for b in range(bands.size if q >= 0 else 0):
            y[b, q] = raw.numbers[nb.uint64(bands[b] * raw.band + row * raw.row + column)]
            x[b, q] = level.numbers[nb.uint64(bands[b] * level.band + row * level.row + column)]
    for b in range(bands.size):
        fixed, rising = noise[b, 0], noise[b, 1]
        for q in range(places.size):
            deviation[b, q] = math.sqrt(fixed + rising * max(y[b, q], 0.0)) / white[b]
            variance[b, q] = deviation[b, q] * deviation[b, q] + texture[b]
            y[b, q] = (y[b, q] - x[b, q]) / white[b]
            x[b, q] = y[b, q] + left[b]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def in_turn(totals, which, kinds, least, pairs):  # type: ignore[no-untyped-def]
    """Some pixels with each of their shapes of which the sum is above the least, round from that of the largest.

    pairs : (pair, 3) of pixel, shape and sum, more than there are; returned is how many
    """
    count, high = 0, np.empty(kinds, np.int64)
    for q in range(which.size):
        soon = which[min(q + SOON, which.size - 1)] * totals.shape[1]
        ahead(totals, soon)
        ahead(totals, soon + kinds)
        likely, some, total = 0, nb.int64(0), totals[which[q]]
        for k in range(kinds):
            high[nb.uint64(some)] = k
            some += total[k] > least
        for n in range(some):
            likely = n if total[high[n]] > total[high[likely]] else likely
        for n in range(some):
            k = high[n + likely if n + likely < some else n + likely - some]
            pairs[count, 0], pairs[count, 1], pairs[count, 2] = q, k, total[k]
            count += 1
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def choose(pairs, tried, lasts, y, kinds, smooth, limits, found):  # type: ignore[no-untyped-def]
    """S of pixels by their best shapes, the spectrum of that, and what is left of the excess, relative to it.

    tried : (6, pair) as by `shaped`; lasts : (pixel,) log density of sparkle; kinds : values (shape, band), (shape, 3)
    of slope, bend, roughness, log weight; smooth : bends (2, band), water that a thing leaves and that it may hide;
    limits : ln that a step is worth, how much S may be above the sum of these, S that matters; found : (pixel,),
    (pixel, band), (pixel,)
    """
    (values, spread, weight), (bends, left, hidden), (worth, room, least) = kinds, smooth, limits
    best, fit, away = found
    for p in range(len(pairs)):
        q, k = pairs[p, 0], pairs[p, 1]
        if pairs[p, 2] * worth + room <= max(best[q], least):
            continue
        score = tried[0, p] + (weight[k] - lasts[q])
        if score > best[q]:
            best[q] = score
            for b in range(y.shape[0]):
                bright = tried[1, p] * values[k, b]
                bent = tried[3, p] * (spread[k, 0] * bends[0, b] * bright)
                bent += tried[4, p] * (spread[k, 1] * bends[1, b] * bright)
                fit[q, b] = tried[2, p] * values[k, b] + (bent + tried[5, p] * hidden[b]) - left[b]
    for q in range(best.size):
        rest = whole = 0.0
        for b in range(y.shape[0]):
            rest += (y[b, q] - fit[q, b]) ** 2
            whole += y[b, q] ** 2
        away[q] = math.sqrt(rest) / math.sqrt(whole)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def shaped(x, variance, pairs, kinds, bends, hidden, out):  # type: ignore[no-untyped-def]
    """Log-likelihood of pixels by shapes, and their brightness, in two rounds; minus infinity where no thing has it.

    kinds : values (shape, band), (shape, 3) of slope, bend, roughness, odd band; out : (6, pair) of log-likelihood,
    brightness of the first and of the second round, and the parts of the bends
    """
    data, how, kept = np.empty((x.shape[0], 3, BATCH)), np.empty((5, BATCH)), np.empty(BATCH, np.int64)
    for first in range(0, len(pairs), BATCH):
        count = min(len(pairs) - first, BATCH)
        for p in range(count):
            kept[p], out[0, first + p] = first + p, -np.inf
        take(x, variance, kept, count, pairs, kinds, data, how)
        chi = plainly(data, hidden, count, how)
        some = nb.int64(0)
        for p in range(count):
            out[1, first + p], kept[some] = how[4, p], first + p
            some += not (chi[p] > HOPELESS) and LEAST < how[4, p] < MOST
        take(x, variance, kept, some, pairs, kinds, data, how)
        for p in range(some):
            how[4, p] = out[1, kept[p]]
        solved(data, bends, hidden, some, how)
        for p in range(some):
            out[1, kept[p]] = how[4, p]
        found = solved(data, bends, hidden, some, how)
        for p in range(some):
            k, a = kept[p], how[4, p]
            if LEAST < out[1, k] < MOST and LEAST < a < MOST:
                density = likelihood(found[0, p], found[1, p], found[2, p], found[3, p], x.shape[0])
                out[0, k], out[2, k] = density - math.log(a * SPREAD), a
                out[3, k], out[4, k], out[5, k] = found[4, p], found[5, p], found[6, p]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def take(x, variance, kept, count, pairs, kinds, data, how):  # type: ignore[no-untyped-def]
    """Of some pairs the pixel and its variance and the shape, (band, 3, pair), and how the shape may differ."""
    values, spread, odd = kinds
    for p in range(count):
        q, k = pairs[kept[p], 0], pairs[kept[p], 1]
        for b in range(data.shape[0]):
            data[b, 0, p], data[b, 1, p], data[b, 2, p] = x[b, q], variance[b, q], values[k, b]
        how[0, p], how[1, p], how[2, p], how[3, p] = spread[k, 0], spread[k, 1], spread[k, 2], odd[k]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def plainly(data, hidden, count, how):  # type: ignore[no-untyped-def]
    """A first brightness of a shape, and the chi-square that it leaves, with bends and hidden water taken for noise."""
    work = np.zeros((3, BATCH))
    for b in range(data.shape[0]):
        for p in range(count):
            counts = 1.0 if how[3, p] != b else 0.0
            work[0, p] += counts * (data[b, 2, p] * data[b, 0, p])
            work[1, p] += counts * (data[b, 2, p] * data[b, 2, p])
    for p in range(count):
        how[4, p] = work[0, p] / work[1, p]
    for b in range(data.shape[0]):
        for p in range(count):
            bright, wide = how[4, p] * data[b, 2, p], how[0, p] ** 2 + how[1, p] ** 2 + how[2, p] ** 2
            noise = data[b, 1, p] + hidden[b] ** 2 + (FLOOR * how[4, p]) ** 2
            rest = (data[b, 0, p] - bright) ** 2 / (noise + bright * bright * wide)
            work[2, p] += rest if how[3, p] != b else 0.0
    return work[2]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def solved(data, bends, hidden, count, how):  # type: ignore[no-untyped-def]
    """The normal density of x with mean a * shape and covariance diag(d) + u' u, over all a, from a first a in `how`.

    By the Woodbury identity with a Cholesky factor of 3 x 3. The best a goes into `how`; returned are its chi-square,
    its weight, the determinant as two products, of the factor and of d, and the parts of the rows of u.
    """
    work = np.zeros((16, BATCH))
    for p in range(count):
        work[3, p], work[4, p], work[7, p], work[9, p] = 1.0, 1.0, 1.0, 1.0
    for b in range(data.shape[0]):
        for p in range(count):
            x, s, a = data[b, 0, p], data[b, 2, p], how[4, p]
            bright = a * s
            d = data[b, 1, p] + (how[2, p] * bright) ** 2 + (FLOOR * a) ** 2
            d += a * a if how[3, p] == b else 0.0
            u, v, w = how[0, p] * bends[0, b] * bright, how[1, p] * bends[1, b] * bright, hidden[b]
            r = 1.0 / d
            i, j, k = u * r, v * r, w * r
            work[0, p] += x * x * r
            work[1, p] += x * s * r
            work[2, p] += s * s * r
            work[3, p] *= d * 1e5  # keeps the product of up to some 20 variances within range
            work[4, p] += u * i
            work[5, p] += v * i
            work[6, p] += w * i
            work[7, p] += v * j
            work[8, p] += w * j
            work[9, p] += w * k
            work[10, p] += i * x
            work[11, p] += j * x
            work[12, p] += k * x
            work[13, p] += i * s
            work[14, p] += j * s
            work[15, p] += k * s
    for p in range(count):
        l00 = math.sqrt(work[4, p])
        l10, l20 = work[5, p] / l00, work[6, p] / l00
        l11 = math.sqrt(work[7, p] - l10 * l10)
        l21 = (work[8, p] - l20 * l10) / l11
        l22 = math.sqrt(work[9, p] - l20 * l20 - l21 * l21)
        x0, s0 = work[10, p] / l00, work[13, p] / l00
        x1, s1 = (work[11, p] - l10 * x0) / l11, (work[14, p] - l10 * s0) / l11
        x2, s2 = (work[12, p] - l20 * x0 - l21 * x1) / l22, (work[15, p] - l20 * s0 - l21 * s1) / l22
        xx = work[0, p] - (x0 * x0 + x1 * x1 + x2 * x2)
        xs = work[1, p] - (x0 * s0 + x1 * s1 + x2 * s2)
        ss = work[2, p] - (s0 * s0 + s1 * s1 + s2 * s2)
        a = xs / ss
        two = (x2 - a * s2) / l22
        one = (x1 - a * s1 - l21 * two) / l11
        work[4, p] = (x0 - a * s0 - l10 * one - l20 * two) / l00
        work[5, p], work[6, p], how[4, p] = one, two, a
        work[0, p], work[1, p], work[2, p] = xx - xs * xs / ss, ss, l00 * l11 * l22
    return work


@nb.njit(cache=True, nogil=True, error_model="numpy")
def likelihood(chi, weight, factor, product, count):  # type: ignore[no-untyped-def]
    """Logarithm of what `solved` found for `count` bands."""
    root = math.log(product * weight * (factor * factor)) - count * math.log(1e5)
    return -0.5 * (chi + root) - 0.5 * (count - 1) * math.log(2 * math.pi)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def chain(y, rows, which, first, following, unit, out):  # type: ignore[no-untyped-def]
    """Log density of spectra (band, pixel) as a Markov chain over bands in the order of time.

    rows : (pixel, band - 1), in `following` as (row,), of which some are taken; first : (bin,)
    """
    for q in range(out.size):
        row = rows[which[q]]
        stretch, total = 1.0, first[row[0] // first.size]
        for b in range(y.shape[0]):
            stretch *= 1.0 + (y[b, q] / unit) ** 2
        for b in range(row.size):
            total += following[row[b]]
        out[q] = total - 0.5 * math.log(stretch) - y.shape[0] * math.log(unit)
