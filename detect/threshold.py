"""Thresholds on anomaly scores for a requested false-alarm rate, each with the observed rate.

A pixel is detected where its score is greater than the threshold; NaN is ignored. Real backgrounds are not Gaussian:
for a threshold by chi-squared or F, check the observed rate. `Tail` keeps the highest scores of a scene that is too
large for the memory; tails of tiles can be merged in any order. No file is opened here.

References
----------
Grimshaw (1993), "Computing maximum likelihood estimates for the generalized Pareto distribution", Technometrics 35,
185-191, doi:10.1080/00401706.1993.10485040. Coles (2001), "An Introduction to Statistical Modeling of Extreme Values",
ch. 4, doi:10.1007/978-1-4471-3675-0.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from deglint.errors import FitError, InputError

from .arrays import Array, Float64

THRESHOLDS = ("gpd", "empirical", "f", "chi2")  # by a fit to the tail, by rank, by two laws for a normal background
KEEP = 1 << 18  # default number of highest scores that a `Tail` keeps
_LEAST_EXCEEDANCES = 50  # minimum number of scores that a distribution is fitted to
_TAIL = 0.01  # fraction of the scores that a distribution is fitted to; larger for high rates and for few scores
_ENOUGH = 10  # minimum number of scores above a quantile that replaces the fit: fewer may all be pixels of one object
_POOR_FIT = 0.05  # Kolmogorov distance from which a fitted tail is called poor


@dataclass(frozen=True, eq=False)
class Tail:
    """The highest scores of a scene and the number of all its scores, for a threshold at a low false-alarm rate.

    Attributes
    ----------
    n : int
        Number of valid scores.
    values : (kept,) ndarray
        The highest scores in descending order; all n scores where n <= keep.
    keep : int
        Maximum number of `values`.
    """

    n: int
    values: Array
    keep: int = KEEP

    @classmethod
    def of(cls, scores: Array, keep: int = KEEP) -> Self:
        """The tail of scores in an array of any shape. Raises InputError if a score is infinite.

        NaN is ignored, and so are the masked elements of a numpy masked array.
        """
        valid = np.ma.asanyarray(scores).compressed()
        valid = valid[~np.isnan(valid)]
        n = valid.size
        if n > keep:
            valid = np.partition(valid, n - keep)[n - keep :]
        values = np.sort(valid)[::-1]
        if n and not (np.isfinite(values[0]) and np.isfinite(values[-1])):
            raise InputError("scores hold infinity; allowed are finite numbers, and NaN where a pixel is not valid.")
        return cls(n, values, keep)

    @classmethod
    def merge(cls, parts: Iterable[Self]) -> Self:
        """Merge the tails of the parts of a scene. The result does not depend on their order or boundaries."""
        parts = list(parts)
        keep = min(part.keep for part in parts)
        whole = cls.of(np.concatenate([part.values for part in parts]), keep)
        return cls(sum(part.n for part in parts), whole.values, keep)

    @staticmethod
    def keep_for(pfa: float, pixels: int) -> int:
        """Number of scores that a tail must keep for a threshold at the rate `pfa` in a scene of `pixels` pixels."""
        return max(KEEP, math.ceil(2 * pfa * pixels) + 1)

    def above(self, value: float) -> int | None:
        """Number of scores greater than `value`; None if scores that are not kept may be greater, too."""
        if len(self.values) < self.n and not (len(self.values) and value >= self.values[-1]):
            return None
        with np.errstate(over="ignore"):  # a value beyond float32 becomes infinity: no score is greater
            return int(np.count_nonzero(self.values > value))


@dataclass(frozen=True)
class Threshold:
    """A threshold on scores: a pixel is detected where its score is greater than `value`.

    Attributes
    ----------
    value : float
        In the unit of the scores (squared Mahalanobis distance for RX).
    method : str
        "chi2", "f", "quantile" or "gpd" (`from_chi2`, `from_f`, ...); "peaks" for a rate per km2 (`Clutter.score_at`).
    pfa_requested : float
        Requested false-alarm rate per background pixel; for "peaks" the observed rate.
    pfa_observed : float or None
        Observed rate: fraction of the scores greater than `value`; None where it is not known. Scores of targets count,
        too; only a threshold of a `Clutter` leaves out the scores of confirmed objects.
    n : int
        Number of scores; for "f" the number of pixels from which mean and covariance are computed; 0 for "chi2".
    standard_error : float or None
        Standard error of `value` ("gpd" only) if scores were independent; as neighbours are correlated, it is too low.
    numbers : mapping
        Parameters and quality of the fit ("gpd"), by name; the requested false_per_km2 ("peaks").
    notes : tuple of str
        Warnings for the user.
    """

    value: float
    method: str
    pfa_requested: float
    pfa_observed: float | None = None
    n: int = 0
    standard_error: float | None = None
    numbers: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def measured(self, above: int | None, n: int) -> Self:
        """A copy with the observed rate `above` / `n` of scores above `value`; the same object if `above` is None."""
        return self if above is None else replace(self, pfa_observed=above / n if n else None)

    def __str__(self) -> str:
        error = "" if self.standard_error is None else f" +- {self.standard_error:.2g}"
        got = "not measured" if self.pfa_observed is None else f"{self.pfa_observed:.3g}"
        said = f"Pfa requested {self.pfa_requested:.3g}, observed {got}"
        if self.method == "peaks":  # --false-per-km2 requests no rate per pixel
            rate = self.numbers.get("false_per_km2", math.nan)
            said = f"requested {rate:g} false objects per km2, observed Pfa {got}"
        return f"threshold {self.value:.6g}{error} ({self.method}): {said}"


def from_chi2(pfa: float, bands: int) -> Threshold:
    """Threshold for squared Mahalanobis distances D of a Gaussian background whose mean and covariance are known.

    D follows chi-squared with `bands` degrees of freedom; D exceeds the threshold with the probability `pfa` (Reed and
    Yu 1990, eq. 46-47, doi:10.1109/29.60107).
    """
    from scipy.special import chdtri

    _check(pfa, bands)
    return Threshold(float(chdtri(bands, pfa)), "chi2", pfa)


def from_f(pfa: float, bands: int, n: int) -> Threshold:
    """Threshold for squared Mahalanobis distances D of Gaussian pixels from the mean of n other Gaussian pixels.

    With the covariance divided by n - 1, D n (n - bands) / ((n^2 - 1) bands) ~ F(bands, n - bands): Hotelling's T^2
    of one new observation (Anderson 2003, "An Introduction to Multivariate Statistical Analysis", sec. 5.2). D exceeds
    the threshold with the probability `pfa`. For large n, the threshold approaches that of `from_chi2`.
    """
    from scipy.special import betainccinv, betaincinv

    _check(pfa, bands, n)
    # z / rest = F bands/(n-bands) and z + rest = 1; both are computed, because 1 - z is imprecise where z is near to 1
    z, rest = betainccinv(bands / 2, (n - bands) / 2, pfa), betaincinv((n - bands) / 2, bands / 2, pfa)
    return Threshold(float((n * n - 1) / n * z / rest), "f", pfa, n=n)


def p_value(scores: Array, bands: int, n: int | None = None) -> Float64:
    """Probability that a pixel of a Gaussian background has at least this score; same shape as `scores`.

    Scores are squared Mahalanobis distances. They follow chi-squared with `bands` degrees of freedom, or the law in
    `from_f` if `n`, the number of pixels in the statistics, is given. NaN where a score is NaN. The relative error is
    up to 1e-8 for n up to 1e8.
    """
    from scipy.special import chdtrc, fdtrc

    _check(0.5, bands, n)
    distance = np.maximum(np.asarray(scores, np.float64), 0)
    if n is None:
        return np.asarray(chdtrc(bands, distance))
    return np.asarray(fdtrc(bands, n - bands, distance * (n * (n - bands) / ((n * n - 1) * bands))))


def from_quantile(scores: Array | Tail, pfa: float) -> Threshold:
    """Threshold by rank: the lowest score that is exceeded by at most the fraction `pfa` of all scores.

    Raises InputError if `pfa` is outside 0 to 1, scores are infinite or fewer than 1 / `pfa`, or a tail keeps too few.
    """
    _check(pfa)
    tail = _tail(scores, pfa)
    if (allowed := math.floor(pfa * tail.n * (1 + 1e-12))) < 1:
        raise InputError(
            f"pfa: {pfa:g} of {tail.n} valid scores is less than one pixel. Give {1.05 / tail.n:.2g} or more, or a "
            "scene with more pixels."  # rounding to two digits takes up to 5 %
        )
    if allowed >= len(tail.values):
        raise InputError(f"pfa: {pfa:g} of {tail.n} scores is {allowed}, the tail keeps {len(tail.values)}. Keep more.")
    value = float(tail.values[allowed])
    notes = () if allowed >= _ENOUGH else (f"only {allowed} scores lie above the threshold: it is uncertain",)
    return Threshold(value, "quantile", pfa, n=tail.n, notes=notes).measured(tail.above(value), tail.n)


def from_tail(scores: Array | Tail, pfa: float) -> Threshold:
    """Threshold by `from_gpd`, or by `from_quantile` if the distribution cannot be fitted or the tail contains objects.

    A fitted shape of 1 or more (no mean exists) shows that the tail contains objects. Even then, the fit is kept if
    fewer than 10 scores would exceed the threshold. Raises InputError as `from_gpd` or, if used, `from_quantile` does.
    """
    try:
        found = from_gpd(scores, pfa)
        if found.numbers["shape"] < 1 or pfa * found.n < _ENOUGH:
            return found
        reason = f"objects disturb the fit of the tail (shape {found.numbers['shape']:.2f}: no mean)"
    except FitError as error:
        reason = str(error).split(". ", 1)[0]
    found = from_quantile(scores, pfa)
    return replace(found, notes=(*found.notes, f"{reason}: the quantile of the scores is used"))


def from_gpd(scores: Array | Tail, pfa: float) -> Threshold:
    """Threshold from a generalised Pareto distribution fitted to the highest scores, also for a rate below 1 / n.

    k of n scores x exceed u, the start of the tail: P(x > u + y) = (k/n) (1 + shape y / scale)^(-1/shape). Shape and
    scale are maximum-likelihood estimates (Grimshaw 1993). The threshold is u + scale/shape ((n pfa / k)^(-shape) - 1);
    its standard error comes from the delta method (Coles 2001, eq. 4.12-4.15). `Threshold.numbers` holds the
    parameters and the Kolmogorov distance of distribution and scores. Raises InputError if no score is valid, one is
    infinite, or `pfa` is outside 0 to k / n; FitError if too few scores differ, the tail ends abruptly or a value
    overflows.
    """
    _check(pfa)
    tail = _tail(scores, pfa)
    wanted = math.ceil(tail.n * max(_TAIL, 2 * pfa))
    k = min(max(wanted, _LEAST_EXCEEDANCES), len(tail.values) - 1, tail.n // 2)
    u = float(tail.values[k]) if k > 0 else math.nan
    excess = tail.values[: max(k, 0)].astype(np.float64) - u
    excess = excess[excess > 0][::-1]
    k = len(excess)
    if k < _LEAST_EXCEEDANCES or excess[0] == excess[-1]:
        raise FitError("the tail has too few different scores for a fit. Take more pixels, or --threshold empirical.")
    if k / tail.n < pfa:
        raise InputError(
            f"pfa: {pfa:g} lies inside the scores, not in their tail. Take a threshold by quantile "
            "(--threshold empirical)."
        )
    shape, scale = fit_pareto(excess)
    try:
        value = u + excess_at(k / tail.n / pfa, shape, scale)
        error = _standard_error(tail.n, k, pfa, shape, scale)
    except OverflowError as beyond:
        raise FitError(f"the threshold for pfa {pfa:g} is beyond double precision. Take a higher rate.") from beyond
    away = 1 - survival(excess, shape, scale) - np.arange(k) / k
    distance = float(max(np.abs(away).max(), np.abs(away - 1 / k).max()))  # of Kolmogorov
    notes = [] if distance < _POOR_FIT else [f"poor fit of the tail: its distribution is off by up to {distance:.0%}"]
    if shape >= 0.5:
        notes.append(f"the tail is heavy (shape {shape:.2f}): a few objects or stray pixels may have set it")
    numbers = {"start": u, "exceedances": k, "shape": shape, "shape_error": (1 + shape) / math.sqrt(k)}
    numbers |= {"scale": scale, "kolmogorov": distance}
    found = Threshold(value, "gpd", pfa, n=tail.n, standard_error=error, numbers=numbers, notes=tuple(notes))
    return found.measured(tail.above(value), tail.n)


def fit_pareto(excess: Float64) -> tuple[float, float]:
    """Maximum-likelihood shape [1] and scale [unit of `excess`] of a generalised Pareto distribution.

    P(excess > y) = (1 + shape y / scale)^(-1/shape); exponential where shape is 0. `excess` holds the scores minus the
    start of the tail: positive, in ascending order. Raises FitError if the shape is -0.5 or less.
    """
    from scipy.optimize import minimize_scalar

    unit = float(excess.mean())
    y = excess / unit
    highest = float(y[-1])

    def cost(t: float) -> float:  # profile likelihood in theta = shape/scale = (exp(t) - 1) / highest, eq. 2.4
        theta = math.expm1(t) / highest
        if abs(theta) < 1e-9:
            return 1.0  # exponential distribution: log(mean) + 1
        shape = float(np.log1p(theta * y).mean())
        return math.log(shape / theta) + shape + 1 if shape > -0.999 else math.inf

    grid = np.concatenate([np.linspace(-12, -0.25, 24), np.linspace(-0.2, 12, 48)])
    best = int(np.argmin([cost(t) for t in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    with np.errstate(invalid="ignore"):  # the cost is infinite where there is no distribution
        t = float(minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-10}).x)
    theta = math.expm1(t) / highest
    if abs(theta) < 1e-9:
        return 0.0, unit
    shape = float(np.log1p(theta * y).mean())
    if shape <= -0.5:
        raise FitError(
            f"the scores' tail ends abruptly (shape {shape:.2f}, need more than -0.5): saturated or clipped scores. "
            "Take a threshold by quantile (--threshold empirical)."
        )
    return shape, shape / theta * unit


def survival(excess: Float64, shape: float, scale: float) -> Float64:
    """Fraction of a generalised Pareto tail that exceeds each `excess` (score minus start of the tail)."""
    y = excess / scale
    # a distribution with a negative shape ends at y = -1 / shape: nothing exceeds a higher score
    return np.asarray(np.exp(-y) if abs(shape) < 1e-9 else np.maximum(1 + shape * y, 0) ** (-1 / shape))


def excess_at(ratio: float, shape: float, scale: float) -> float:
    """Excess (score minus start of the tail) exceeded by the fraction 1 / `ratio` of a generalised Pareto tail."""
    log = math.log(ratio)
    return scale * (math.expm1(shape * log) / shape if abs(shape) > 1e-9 else log)


def _standard_error(n: int, k: int, pfa: float, shape: float, scale: float) -> float:
    """Standard error of the threshold of `from_gpd` (delta method; Coles, eq. 4.15), for k of n scores in the tail."""
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


def _tail(scores: Array | Tail, pfa: float) -> Tail:
    """The tail of scores, long enough for `pfa`, or the given `Tail` itself. Raises InputError if no score is valid."""
    if not isinstance(scores, Tail):
        scores = Tail.of(scores, Tail.keep_for(pfa, np.asarray(scores).size))
    if scores.n == 0:
        raise InputError("scores hold no valid pixel: all are NaN or masked.")
    return scores


def _check(pfa: float, bands: int = 1, n: int | None = None) -> None:
    if not 0 < pfa < 1:
        raise InputError(f"pfa: allowed is above 0 and below 1, got {pfa}. 1e-3 is one false alarm in 1000 pixels.")
    if bands < 1:
        raise InputError(f"bands: allowed is 1 or more, got {bands}.")
    if n is not None and n <= bands:
        raise InputError(f"n: allowed is more than the {bands} bands, got {n}. Take statistics from more pixels.")
