"""What is right, in long double: two passes, sums about the mean, and nothing of the code that is measured.

On x86-64 a long double holds 19 digits, so that 16 of them are sure after a thousand additions; where it is a double
(`WIDE` is false), digits above about 13 say as much of the reference as of the code.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from .stress_cases import NIR, Block, Case

Wide = npt.NDArray[np.longdouble]
PERCENTILE = 5.0
WIDE = np.finfo(np.longdouble).nmant >= 63


@dataclass(frozen=True, eq=False)
class Truth:
    """What is right of one block, each computed once."""

    case: Case

    @cached_property
    def pixels(self) -> Wide:
        """(band, pixel) of the pixels that are finite in every band."""
        return pixels(self.case.block)

    @cached_property
    def _moments(self) -> tuple[Wide, Wide]:
        return mean_and_covariance(self.pixels)

    @property
    def mean(self) -> npt.NDArray[np.float64]:
        """(band,)."""
        return self._moments[0].astype(np.float64)

    @property
    def covariance(self) -> npt.NDArray[np.float64]:
        """(band, band); what is too small for float64 is 0."""
        with np.errstate(under="ignore"):
            return self._moments[1].astype(np.float64)

    @cached_property
    def slopes(self) -> list[Any]:
        """Of each band on the NIR, by least squares."""
        return [slope(self.pixels, band, NIR) for band in range(NIR)]

    @cached_property
    def scores(self) -> tuple[Wide, Wide]:
        """RX of every pixel, and what its errors are relative to: it, or the mean score, whichever is more."""
        found = rx_scores(self.case.block, self.case.independent)
        return found, np.fmax(found, len(self.case.independent))

    @cached_property
    def percentile(self) -> Any:
        """The fifth of the NIR."""
        return percentile(self.pixels[NIR], PERCENTILE)

    def corrected(self, slopes: Any, level: Any) -> tuple[Wide, Wide]:
        """Bands less slopes times what the NIR stands above a level; and the larger of that and the bands."""
        wide = np.asarray(self.case.block, np.longdouble)
        glint = wide[NIR] - np.longdouble(level)
        with np.errstate(invalid="ignore"):
            right = wide[:NIR] - np.asarray(slopes, np.longdouble)[:, None, None] * glint
            return right, np.fmax(np.abs(right), np.abs(wide[:NIR]))


def pixels(block: Block) -> Wide:
    """(band, pixel) of the pixels that are finite in every band."""
    flat = block.reshape(len(block), -1)
    return np.asarray(flat[:, np.isfinite(flat).all(axis=0)], np.longdouble)


def halved(x: Wide) -> tuple[Wide, Wide]:
    """Bands divided by a power of two, so that denormals have squares and nothing is rounded; and the powers."""
    size = np.ldexp(np.ones(len(x), np.longdouble), np.frexp(np.abs(x).max(axis=1))[1])
    return x / size[:, None], size


def centred(x: Wide) -> tuple[Wide, Wide]:
    """Mean, and pixels less the mean."""
    mean = x.mean(axis=1)
    away = x - mean[:, None]
    left = away.mean(axis=1)
    away -= left[:, None]
    return mean + left, away


def mean_and_covariance(x: Wide, ddof: int = 1) -> tuple[Wide, Wide]:
    """Mean (band,) and covariance (band, band) of (band, pixel)."""
    mean, away = centred(x)
    out = np.empty((len(x), len(x)), np.longdouble)
    for i, a in enumerate(away):
        for j in range(i + 1):
            out[i, j] = out[j, i] = (a * away[j]).sum() / (x.shape[1] - ddof)
    return mean, out


def distances(x: Wide, mean: Wide, covariance: Wide) -> Wide:
    """Squared Mahalanobis distances of (band, pixel), by Cholesky."""
    rest = (x - mean[:, None]).astype(np.longdouble)
    matrix, total = covariance.copy(), np.zeros(x.shape[1], np.longdouble)
    for i in range(len(matrix)):
        total += rest[i] * rest[i] / matrix[i, i]
        share = matrix[i + 1 :, i] / matrix[i, i]
        rest[i + 1 :] -= share[:, None] * rest[i]
        matrix[i + 1 :, i + 1 :] -= share[:, None] * matrix[i, i + 1 :]
    return total


def rx_scores(block: Block, independent: tuple[int, ...]) -> Wide:
    """RX of every pixel, from the bands that do not follow from the others; NaN where a band is not finite."""
    chosen = list(independent)
    flat = block.reshape(len(block), -1)
    out = np.full(flat.shape[1], np.nan, np.longdouble)
    good = np.isfinite(flat).all(axis=0)
    x = np.asarray(flat[:, good], np.longdouble)[chosen]
    x, _ = halved(x - x[:, :1])  # a mean of 1e8 would have three digits less than the pixels about it
    out[good] = distances(x, *mean_and_covariance(x))
    return out.reshape(block.shape[1:])


def local_scores(block: Block, independent: tuple[int, ...], inner: int, outer: int, places: Block) -> Wide:
    """Local RX of some pixels (places: (pixel, 2)), each against its ring; all of it must lie in the block."""
    found = []
    for row, column in places:
        window = block[:, row - outer // 2 : row + outer // 2 + 1, column - outer // 2 : column + outer // 2 + 1]
        ring = np.ones(window.shape[1:], np.bool_)
        guard = slice(outer // 2 - inner // 2, outer // 2 + inner // 2 + 1)
        ring[guard, guard] = False
        own = np.asarray(block[:, row, column], np.longdouble)
        x = np.asarray(window[:, ring], np.longdouble)
        x, own = x[:, np.isfinite(x).all(axis=0)][list(independent)], own[list(independent)]
        first = x[:, :1].copy()
        x, size = halved(x - first)
        own = (own - first[:, 0]) / size
        found.append(distances(own[:, None], *mean_and_covariance(x))[0] if np.isfinite(own).all() else np.nan)
    return np.array(found, np.longdouble)


def slope(x: Wide, band: int, index: int) -> Any:
    """Least squares slope of a band on another."""
    x, size = halved(x)
    away = centred(x)[1]
    return (away[band] * away[index]).sum() / (away[index] * away[index]).sum() * size[band] / size[index]


def detrended(block: Block, size: int) -> Wide:
    """(band, pixel): valid pixels less the mean of the valid pixels in a square around each."""
    wide = np.asarray(block, np.longdouble)
    valid: npt.NDArray[np.bool_] = np.asarray(np.isfinite(block).all(axis=0))
    wide = np.where(valid, wide - wide[:, valid][:, :1, None], 0)
    half = size // 2
    total, count = np.zeros_like(wide), np.zeros(block.shape[1:])
    rows, columns = block.shape[1:]
    for down in range(-half, half + 1):
        for across in range(-half, half + 1):
            to = tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in ((down, rows), (across, columns)))
            of = tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in ((down, rows), (across, columns)))
            total[(slice(None), *to)] += wide[(slice(None), *of)]
            count[to] += valid[of]
    return np.asarray((wide - total / np.maximum(count, 1))[:, valid])


def percentile(values: Wide, percent: float) -> Any:
    """Linear between the two nearest order statistics."""
    ordered = np.sort(values.ravel())
    at = np.longdouble(percent) / 100 * (len(ordered) - 1)
    low = int(at)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (ordered[high] - ordered[low]) * (at - low)


def theil_sen(x: Wide, band: int, index: int) -> Any:
    """Median of the slopes between all pairs of pixels."""
    first, second = np.triu_indices(x.shape[1], 1)
    run = x[index, second] - x[index, first]
    rise = x[band, second] - x[band, first]
    slopes = np.sort(rise[run != 0] / run[run != 0])
    middle = len(slopes) // 2
    return slopes[middle] if len(slopes) % 2 else (slopes[middle - 1] + slopes[middle]) / 2


def huber(x: Wide, band: int, index: int, start: float, epsilon: float = 1.35) -> Any:
    """Slope of Huber's regression with concomitant scale, by Newton's steps from a slope that is nearly right.

    Minimises the sum of s + H((y - b x - a) / s) s over a, b and s (Owen 2007, "A robust hybrid of lasso and ridge
    regression", Contemporary Mathematics 443, 59-71), which is scikit-learn's objective without a penalty.
    """
    x, size = halved(x)
    away = centred(x)[1]
    spread = np.sqrt((away**2).mean(axis=1))
    if not spread[band] > 0:
        return np.longdouble(0)
    u, v = away[index] / spread[index], away[band] / spread[band]
    unit = spread[band] * size[band] / (spread[index] * size[index])
    a, b = np.longdouble(0), np.longdouble(start) / unit
    s = np.sqrt(((v - b * u) ** 2).mean())
    for _ in range(400):
        if not 0 < s < np.inf:
            return np.longdouble(np.nan)
        rest = v - b * u - a
        inner = np.abs(rest) <= epsilon * s
        ends = np.where(inner, 0, epsilon * s * np.sign(rest))
        # given who is inside: least squares for a, b; then the scale
        w = inner.astype(np.longdouble)
        suu, su, n = (w * u * u).sum(), (w * u).sum(), w.sum()
        p, q = (w * u * v).sum() + (u * ends).sum(), (w * v).sum() + ends.sum()
        before = (a, b, s)
        b, a = (n * p - su * q) / (n * suu - su * su), (suu * q - su * p) / (n * suu - su * su)
        rest = v - b * u - a
        inner = np.abs(rest) <= epsilon * s
        within = len(v) - epsilon**2 * (~inner).sum()
        s = np.sqrt((rest[inner] ** 2).sum() / within) if within > 0 else np.longdouble(np.nan)
        if max(abs(a - before[0]), abs(b - before[1]), abs(s - before[2])) < 1e-18:
            break
    return b * unit
