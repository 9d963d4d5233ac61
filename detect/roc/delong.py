"""Standard error of the area under the ROC curve, and test of two areas, for independent pixels.

Pixels of an image are not independent: neighbours share target, glint and sensor. So these intervals are too narrow for
images. They are fast to compute and common in other programs; `bootstrap` over objects and blocks is valid for images.

References
----------
DeLong, DeLong, Clarke-Pearson (1988), Biometrics 44, 837-845, doi:10.2307/2531595. Sun, Xu (2014), "Fast implementation
of DeLong's algorithm", IEEE Signal Processing Letters 21, 1389-1393, doi:10.1109/LSP.2014.2337313: the components come
from ranks, in O(n log n).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Float64, Mask
from .curve import Roc, usable

_Z = 1.959963984540054
"""Half-width of a normal interval of 95 % in standard errors."""


@dataclass(frozen=True)
class AucInterval:
    """An area with its DeLong standard error and interval; NaN where one target or one background pixel carries it."""

    auc: float
    standard_error: float
    low: float
    high: float
    level: float = 0.95


@dataclass(frozen=True)
class Comparison:
    """Difference of two areas on the same pixels, the first less the second, with its interval."""

    auc: tuple[float, float]
    difference: float
    standard_error: float
    z: float  # NaN where the standard error is 0 and the areas are equal
    p: float  # two-sided; 1 there
    low: float
    high: float
    level: float = 0.95
    pixels: int = 0  # valid in both


def auc_interval(roc: Roc) -> AucInterval:
    """Area with DeLong's standard error and its normal interval, cut to 0..1 (DeLong 1988, eq. 6)."""
    error = math.sqrt(_variance(*_components(roc.targets, roc.background, roc)))
    return AucInterval(roc.auc, error, max(roc.auc - _Z * error, 0.0), min(roc.auc + _Z * error, 1.0))


def compare(first: Array, second: Array, truth: Array, valid: Mask | None = None) -> Comparison:
    """DeLong's paired test of two detectors on the same pixels.

    Parameters
    ----------
    first, second : ndarray
        Scores; a pixel counts where both are valid.
    truth : ndarray of the same shape
        A target where it is not 0.
    valid : ndarray of bool, optional

    Raises
    ------
    InputError
        As `Roc.of`.
    """
    first, second, truth = np.asarray(first), np.asarray(second), np.asarray(truth)
    ok = usable(first, truth, valid) & usable(second, truth)
    target, background = ok & (truth != 0), ok & (truth == 0)
    rocs = [Roc.of(scores, truth, ok) for scores in (first, second)]
    v10, v01 = zip(*(_components(s[target], s[background], r) for s, r in zip((first, second), rocs, strict=True)),
                   strict=True)  # fmt: skip
    difference, error = rocs[0].auc - rocs[1].auc, math.sqrt(_variance(v10[0] - v10[1], v01[0] - v01[1]))
    if error > 0:
        z = difference / error
        p = math.erfc(abs(z) / math.sqrt(2))
    elif math.isnan(error):
        z = p = math.nan
    else:  # the same ranks everywhere, or a difference without any spread
        z, p = (math.nan, 1.0) if difference == 0 else (math.inf, 0.0)
    low, high = difference - _Z * error, difference + _Z * error
    pixels = int(np.count_nonzero(ok))
    return Comparison((rocs[0].auc, rocs[1].auc), difference, error, z, p, low, high, pixels=pixels)


def _components(targets: Array, background: Array, roc: Roc) -> tuple[Float64, Float64]:
    """Fraction of the background below each target, and of the targets above each background pixel, ties as halves."""
    below, at_least = (
        (np.searchsorted(others, own, "left") + np.searchsorted(others, own, "right")) / (2 * len(others))
        for own, others in ((targets, roc.background), (background, roc.targets))
    )
    return below, 1 - at_least


def _variance(v10: Float64, v01: Float64) -> float:
    """Variance of an area from its components; NaN where there is a single target or background pixel."""
    if min(len(v10), len(v01)) < 2:
        return math.nan
    return float(v10.var(ddof=1) / len(v10) + v01.var(ddof=1) / len(v01))
