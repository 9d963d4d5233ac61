"""Slopes of the bands against a glint index, with standard errors that allow for correlated pixels.

Neighbouring pixels are correlated: the usual standard error is too small by the square root of the number of correlated
pixels. If the sample spans enough cells, the error is therefore estimated between cells (the cluster-robust estimate of
Liang and Zeger 1986), otherwise from pixels as if independent. A cell with much of the glint dominates the slope, so
that its residuals are too small; they are divided by the share of glint in the other cells, which makes the estimate
the jackknife over cells (CR3 of Bell and McCaffrey 2002; Cameron and Miller 2015, section VI.B).

References
----------
Liang, Zeger (1986), Biometrika 73, 13-22, doi:10.1093/biomet/73.1.13.
Bell, McCaffrey (2002), Survey Methodology 28, 169-181.
Cameron, Miller (2015), Journal of Human Resources 50, 317-372, doi:10.3368/jhr.50.2.317.
Carter, Schnepel, Steigerwald (2017), Review of Economics and Statistics 99, 698-709, doi:10.1162/REST_a_00639.
Huber (1964), Annals of Mathematical Statistics 35, 73-101, doi:10.1214/aoms/1177703732.
Sen (1968), Journal of the American Statistical Association 63, 1379-1389, doi:10.1080/01621459.1968.10480934.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..moments import Float64
from .model import BandFit, GlintModel
from .statistics import SampleStatistics

CLUSTERS = 10
"""Fewest cells for a standard error between cells."""
LEAST_ELSEWHERE = 1e-3
"""Lower limit of the share of glint in other cells, so that errors are finite."""
ROBUST_PIXELS = 50_000
"""Most pixels in the Huber regression."""
PAIRED_PIXELS = 2_000
"""Most pixels in the Theil-Sen regression, which uses all pairs (two million)."""


def least_squares(stats: SampleStatistics) -> Float64:
    """Ordinary least squares: cov(band, index) / var(index), from the moments.

    Used for `ols` and, with moments of detrended values, for `detrended`.
    """
    bands = len(stats.plan.bands)
    return np.asarray(stats.regressed.comoment[:bands, bands:] / np.diag(stats.regressed.comoment)[bands:])


def huber(stats: SampleStatistics) -> Float64:
    """Huber's M-estimate (epsilon 1.35, by scikit-learn) on at most `ROBUST_PIXELS` pixels of the sample."""
    from sklearn.linear_model import HuberRegressor

    def slope_of(x: Float64, y: Float64) -> float:
        if y.min() == y.max():  # whose standard deviation need not be 0
            return 0.0
        scale_x, scale_y = np.std(x), np.std(y)
        fit = HuberRegressor(alpha=0.0, max_iter=1000, tol=1e-8)
        fit.fit(((x - np.mean(x)) / scale_x)[:, None], (y - np.mean(y)) / scale_y)
        return float(fit.coef_[0] * scale_y / scale_x)

    return _pixelwise(stats, slope_of, ROBUST_PIXELS)


def theil_sen(stats: SampleStatistics) -> Float64:
    """Median of the slopes between all pairs (by SciPy) of at most `PAIRED_PIXELS` pixels of the sample."""
    from scipy.stats import theilslopes

    with np.errstate(invalid="ignore"):  # of an interval that is not asked for, where values are tied
        return _pixelwise(stats, lambda x, y: float(theilslopes(y, x).slope), PAIRED_PIXELS)


REGRESSIONS: dict[str, Callable[[SampleStatistics], Float64]] = {
    "ols": least_squares,
    "detrended": least_squares,
    "huber": huber,
    "theil-sen": theil_sen,
}
"""Slopes of each band against each index, (band, index)."""


def standard_error(stats: SampleStatistics, slope: Float64) -> Float64:
    """Standard errors of slopes (bands, indexes): between cells, or as of independent pixels if there are few cells.

    ``sqrt((G - 1) / G sum_c (s_c / (1 - h_c))^2) / S``, with S the index's comoment, h_c the share of it in cell c of
    G, and s_c the cell's score (CR3 of Cameron and Miller 2015, section VI.B, for one regressor).
    """
    bands = len(stats.plan.bands)
    power = np.diag(stats.regressed.comoment)[bands:]
    if len(stats.cells.n) < CLUSTERS:
        unexplained = (1 - explained(stats, slope)) * np.diag(stats.regressed.comoment)[:bands, None]
        return np.sqrt(np.maximum(unexplained, 0) / max(stats.regressed.n - 2, 1) / power)
    cells = stats.cells
    away = (cells.mean - stats.regressed.mean) + (cells.rest - stats.regressed.rest)
    about = cells.comoment + cells.n[:, None, None] * away[:, :, None] * away[:, None, :]
    power_of_cell = np.diagonal(about, axis1=1, axis2=2)[:, None, bands:]
    score = (about[:, :bands, bands:] - slope * power_of_cell) / np.maximum(1 - power_of_cell / power, LEAST_ELSEWHERE)
    count = len(cells.n)
    return np.sqrt((score**2).sum(axis=0) * (count - 1) / count) / power


def glint_error(stats: SampleStatistics, model: GlintModel, fit: BandFit) -> tuple[float, float]:
    """Relative standard error of the glint that a model predicts in a band, and its reliability.

    .. math:: \\sqrt{\\mathrm{tr}(V C) / w^T C w}, \\quad s_c = (C_{ri,c} - C_{rr,c} w) / (1 - p_c),
        \\quad V = C^{-1} \\Big( \\frac{G - 1}{G} \\sum_c s_c s_c^T \\Big) C^{-1}

    with w the weights of the references, C their comoments, s_c the score of cell c, of G, and p_c its share of the
    glint: the cluster-robust covariance V of w (CR3 of Bell and McCaffrey 2002, with the leverage of the mixture in
    place of that of each reference), relative to the standard deviation of the mixture. For one reference it is the
    slope's standard error over the slope.

    The error is infinite if the sample spans fewer than `CLUSTERS` cells or the mixture does not vary. The reliability
    is the effective number of cells, (sum p)^2 / sum p^2: if a few clumps of sparkle contain most of the glint, the
    error does not represent others (after Carter, Schnepel and Steigerwald 2017).
    """
    cells, band, (rows, w) = stats.cells, stats.plan.bands.index(fit.band), _references(stats, model, fit)
    power = stats.regressed.comoment[np.ix_(rows, rows)]
    removed = float(w @ power @ w)
    count = len(cells.n)
    if count < CLUSTERS or not removed > 0:
        return math.inf, 0.0
    away = cells.mean - stats.regressed.mean
    about = cells.comoment + cells.n[:, None, None] * away[:, :, None] * away[:, None, :]
    mixed = about[:, rows][:, :, rows] @ w
    share = mixed @ w / removed
    score = (about[:, rows, band] - mixed) / np.maximum(1 - share, LEAST_ELSEWHERE)[:, None]
    scale = np.sqrt(np.diag(power))  # references of any unit
    scaled = power / np.outer(scale, scale)
    half = np.linalg.pinv(scaled, hermitian=True) @ (score / scale).T
    spread = half @ half.T * (count - 1) / count
    return math.sqrt(max(float(np.trace(spread @ scaled)), 0.0) / removed), float(1 / (share @ share))


def _references(stats: SampleStatistics, model: GlintModel, fit: BandFit) -> tuple[list[int], Float64]:
    """References of a band as variables of its sample, and their weights: one index of the plan, or a mixture."""
    index, planned = model.indexes[fit.index], [(i.bands, i.weights) for i in stats.plan.indexes]
    one = (index.bands, index.weights) in planned
    parts = [(index.bands, index.weights)] if one else [((band,), (1.0,)) for band in index.bands]
    return [len(stats.plan.bands) + planned.index(p) for p in parts], np.array([fit.slope] if one else index.weights)


def explained(stats: SampleStatistics, slope: Float64) -> Float64:
    """R2 of each band for slopes (bands, indexes); 0 for a band that does not vary."""
    bands = len(stats.plan.bands)
    comoment = stats.regressed.comoment
    total, cross, power = np.diag(comoment)[:bands, None], comoment[:bands, bands:], np.diag(comoment)[bands:]
    rest = total - 2 * slope * cross + slope**2 * power
    return np.where(total > 0, 1 - rest / np.where(total > 0, total, 1), 0.0)


def _pixelwise(stats: SampleStatistics, slope_of: Callable[[Float64, Float64], float], most: int) -> Float64:
    bands, indexes = len(stats.plan.bands), len(stats.plan.indexes)
    step = -(-stats.values.shape[1] // most)
    values = stats.values[:, ::step].astype(np.float64)
    return np.array([[slope_of(values[bands + k], values[i]) for k in range(indexes)] for i in range(bands)])
