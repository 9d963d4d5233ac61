"""How sure an area under the ROC curve is, and whether two of them differ, were pixels independent.

Pixels are not: neighbours share target, glint and sensor, so these intervals are too narrow for images. They are what
other programs print, and cheap; `bootstrap` over objects and blocks is the honest one.

References
----------
DeLong, DeLong, Clarke-Pearson (1988), Biometrics 44, 837-845, doi:10.2307/2531595. Sun, Xu (2014), "Fast implementation
of DeLong's algorithm", IEEE Signal Processing Letters 21, 1389-1393, doi:10.1109/LSP.2014.2337313: the components come
from ranks, in O(n log n).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint.errors import InputError

from .curve import Mask, Roc, Scores, usable

Counts = npt.NDArray[np.int64]


@dataclass(frozen=True)
class AucInterval:
    """An area with its DeLong standard error and interval; NaN where one target or one background pixel carries it."""

    auc: float
    standard_error: float
    low: float
    high: float
    level: float


@dataclass(frozen=True)
class Comparison:
    """Difference of two areas on the same pixels.

    Attributes
    ----------
    auc : (float, float)
    difference : float
        First less second.
    standard_error, z, p : float
        Of the difference; p is two-sided. z is NaN, and p 1, where the standard error is 0 and the areas are equal.
    low, high : float
        Interval of the difference.
    level : float
    pixels : int
        Valid in both.
    """

    auc: tuple[float, float]
    difference: float
    standard_error: float
    z: float
    p: float
    low: float
    high: float
    level: float
    pixels: int


def auc_interval(roc: Roc, level: float = 0.95) -> AucInterval:
    """Area with DeLong's standard error and its normal interval, cut to 0..1.

    The variance is S10/m + S01/n, of the components V10 of m targets and V01 of n background pixels (DeLong 1988,
    eq. 6): V10 is the fraction of the background below a target, V01 that of targets above a background pixel, ties
    as halves. V01 is constant between target scores, so no background pixel is looked at singly.
    """
    z = _normal(level)
    _, counts, below, upto = roc._steps
    m, n = len(roc.targets), len(roc.background)
    v10 = below + upto  # in halves of a pixel: integers lose nothing
    at_least = np.cumsum(counts[::-1])[::-1]
    v01 = np.concatenate([2 * at_least, 2 * at_least - counts, [0]])
    between = np.append(below, n) - np.append(0, upto)
    weight = np.concatenate([between[:-1], upto - below, between[-1:]])
    variance = _variance(v10, counts, m) / m / (2 * n) ** 2 + _variance(v01, weight, n) / n / (2 * m) ** 2
    error = math.sqrt(variance)
    return AucInterval(roc.auc, error, max(roc.auc - z * error, 0.0), min(roc.auc + z * error, 1.0), level)


def compare(
    first: Scores, second: Scores, truth: npt.NDArray[Any], valid: Mask | None = None, *, level: float = 0.95
) -> Comparison:
    """DeLong's paired test of two detectors on the same pixels.

    Parameters
    ----------
    first, second : ndarray
        Scores; a pixel counts where both are valid.
    truth : ndarray of the same shape
        A target where it is not 0.
    valid : ndarray of bool, optional
    level : float
        Of the interval.

    Raises
    ------
    InputError
        As `Roc.of`.
    """
    z_level = _normal(level)
    first, second, truth = np.asarray(first), np.asarray(second), np.asarray(truth)
    ok = usable(first, truth, valid) & usable(second, truth)
    target = truth != 0
    components = [_components(scores, ok & target, ok & ~target) for scores in (first, second)]
    m, n = (len(v) for v in components[0])
    whole = [int(v10.sum()) for v10, _ in components]  # in halves of a pair: integers lose nothing
    auc = (whole[0] / (2 * m * n), whole[1] / (2 * m * n))
    variance = 0.0
    for a, b, unit in zip(*components, (2 * n, 2 * m), strict=True):
        change, ones = a - b, np.ones(len(a), np.int64)
        variance += _variance(change, ones, len(change)) / len(change) / unit**2
    difference, error = (whole[0] - whole[1]) / (2 * m * n), math.sqrt(variance)
    z = difference / error if error > 0 else math.nan if difference == 0 or math.isnan(error) else math.inf
    p = math.erfc(abs(z) / math.sqrt(2)) if not math.isnan(z) else math.nan if math.isnan(error) else 1.0
    low, high = difference - z_level * error, difference + z_level * error
    return Comparison(auc, difference, error, z, p, low, high, level, int(np.count_nonzero(ok)))


def _components(scores: Scores, target: Mask, background: Mask) -> tuple[Counts, Counts]:
    """2 n V10 of every target and 2 m V01 of every background pixel, in the order of the pixels."""
    roc = Roc.of(scores, target, target | background)
    t = scores[target].astype(roc.targets.dtype, copy=False)
    b = scores[background].astype(roc.background.dtype, copy=False)
    v10 = np.searchsorted(roc.background, t, "left") + np.searchsorted(roc.background, t, "right")
    distinct, counts, _, _ = roc._steps
    at_least = np.append(np.cumsum(counts[::-1])[::-1], 0)
    at = np.searchsorted(distinct, b, "left")
    tied = distinct[np.minimum(at, len(distinct) - 1)] == b
    v01 = 2 * at_least[at] - np.append(counts, 0)[at] * tied
    return v10, v01


def _variance(values: Counts, weights: Counts, n: int) -> float:
    """Sample variance of integers that each occur `weights` times; NaN for a single one."""
    if n < 2:
        return math.nan
    middle = round(int(values @ weights) / n)
    away = (values - middle).astype(np.float64)
    left = float(away @ weights) / n
    return float((away - left) ** 2 @ weights) / (n - 1)


def _normal(level: float) -> float:
    """Half-width of a normal interval in standard errors."""
    from scipy.special import ndtri

    if not 0 < level < 1:
        raise InputError(f"level: allowed is above 0 and below 1, got {level}. 0.95 is usual.")
    return float(ndtri(0.5 + level / 2))
