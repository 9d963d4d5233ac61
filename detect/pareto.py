"""Generalised Pareto distribution of the highest scores: fit, quantiles, standard error and goodness of fit.

P(excess > y) = (1 + shape y / scale)^(-1/shape); exponential where shape is 0. References stand in `detect.threshold`.
"""

from __future__ import annotations

import math

import numpy as np

from deglint.errors import FitError

from .arrays import Float64


def fit(excess: Float64) -> tuple[float, float, float]:
    """Shape and scale of maximum likelihood, and the shape by probability-weighted moments; `excess` ascends."""
    from scipy.optimize import minimize_scalar

    k, unit = len(excess), float(excess.mean())
    y = excess / unit
    weighted = float((1 - (np.arange(1, k + 1) - 0.35) / k) @ y / k)
    by_moments = 2 - 1 / (1 - 2 * weighted)  # a0 = 1
    highest = float(y[-1])

    def cost(t: float) -> float:  # profile likelihood in theta = shape/scale = (exp(t) - 1) / highest, eq. 2.4
        theta = math.expm1(t) / highest
        if abs(theta) < 1e-9:
            return 1.0  # exponential law: log(mean) + 1
        shape = float(np.log1p(theta * y).mean())
        return math.log(shape / theta) + shape + 1 if shape > -0.999 else math.inf

    grid = np.concatenate([np.linspace(-12, -0.25, 24), np.linspace(-0.2, 12, 48)])
    best = int(np.argmin([cost(t) for t in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    with np.errstate(invalid="ignore"):  # the cost is infinite where there is no law
        t = float(minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-10}).x)
    theta = math.expm1(t) / highest
    if abs(theta) < 1e-9:
        return 0.0, unit, by_moments
    shape = float(np.log1p(theta * y).mean())
    if shape <= -0.5:
        raise FitError(
            f"the scores' tail ends abruptly (shape {shape:.2f}, need more than -0.5): saturated or clipped scores. "
            "Take a threshold by quantile (--threshold empirical)."
        )
    return shape, shape / theta * unit, by_moments


def excess_at(ratio: float, shape: float, scale: float) -> float:
    """Excess that is exceeded by one in `ratio` exceedances."""
    log = math.log(ratio)
    return scale * (math.expm1(shape * log) / shape if abs(shape) > 1e-9 else log)


def standard_error(n: int, k: int, pfa: float, shape: float, scale: float) -> float:
    """Standard error of a threshold: delta method over the fraction k/n, scale and shape (Coles 2001, eq. 4.15)."""
    ratio = k / n / pfa
    power, log = ratio**shape, math.log(ratio)
    by_fraction = scale * power * n / k
    by_scale = excess_at(ratio, shape, 1.0)
    by_shape = scale * (log * power - by_scale) / shape if abs(shape) > 1e-6 else scale * log * log / 2
    fraction = k / n
    variance = (
        by_fraction**2 * fraction * (1 - fraction) / n
        + by_scale**2 * 2 * scale**2 * (1 + shape) / k
        + by_shape**2 * (1 + shape) ** 2 / k
        - 2 * by_scale * by_shape * scale * (1 + shape) / k
    )
    return math.sqrt(max(variance, 0.0))


def kolmogorov(excess: Float64, shape: float, scale: float) -> float:
    """Largest distance between the distributions of scores and of the law; `excess` ascends."""
    y = excess / scale
    survival = np.exp(-y) if abs(shape) < 1e-9 else np.maximum(1 + shape * y, 0) ** (-1 / shape)
    k = len(y)
    ranks = np.arange(k) / k
    return float(max(np.abs(1 - survival - ranks).max(), np.abs(1 - survival - ranks - 1 / k).max()))
