"""What a caller asks of a method, and the steps that the regression methods share."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import BandError, FitError, InputError
from ..scene import Band
from .detrend import SIZE as DETREND_SIZE
from .model import BandFit, GlintIndex, GlintModel
from .regression import REGRESSIONS, Slopes, explained
from .statistics import SamplePlan, SampleStatistics

MIN_PIXELS = 64
"""Fewest pixels that a slope is fitted to."""
FEW_PIXELS = 1000
"""Below this many pixels a fit carries a warning."""
LOW_R2 = 0.3
"""Below this R2 a band carries a warning: the index does not explain it."""
EVEN = 0.55
"""Share of a mixture's variance that lies evenly about its median, above which removal adds more than it takes."""
SIGNIFICANT = 3.0
"""Standard errors by which a slope must exceed zero to count as glint."""


@dataclass(frozen=True, slots=True)
class FitRequest:
    """What is to be fitted.

    Attributes
    ----------
    bands : tuple of Band
        All bands of the scene.
    correct : tuple of int
        0-based bands to correct.
    indexes : tuple of GlintIndex
        The NIR references; their levels are not used.
    follows : tuple of int or None
        For each band of `correct` the index it follows; None: the one with the highest R2.
    regression : str
        Key of `REGRESSIONS`.
    floor_percentile : float
        Percentile of the index that Hedley takes as its level [%]; 0 is the minimum, as published.
    rrs_factor : float
        Physical values are this many times remote-sensing reflectance [sr^-1]; pi for reflectance.
    more : tuple of int
        0-based bands that also serve as references for bands of shorter wavelength
        (`deglint.remove.further.more_references`).
    faint : bool
        Kernels suit faint glint rather than strong glint, of which they leave more: for the posterior mean, which takes
        that from the water beside.
    level_error : bool
        Estimate the standard error of the level of `wiener`: half the time of a fit, not needed to compare fits.
    """

    bands: tuple[Band, ...]
    correct: tuple[int, ...]
    indexes: tuple[GlintIndex, ...]
    follows: tuple[int | None, ...]
    regression: str = "ols"
    floor_percentile: float = 0.0
    rrs_factor: float = math.pi
    more: tuple[int, ...] = ()
    faint: bool = False
    level_error: bool = True

    def __post_init__(self) -> None:
        if self.regression not in REGRESSIONS:
            raise InputError(f"regression {self.regression!r} is not one of {', '.join(REGRESSIONS)}.")
        if not 0 <= self.floor_percentile <= 100:
            raise InputError(f"floor percentile must be 0 to 100 %, got {self.floor_percentile}.")
        if not (math.isfinite(self.rrs_factor) and self.rrs_factor > 0):
            raise InputError(f"rrs factor must be a positive number, got {self.rrs_factor}.")
        if not self.correct:
            raise InputError("no band is left to correct: give -b bands other than the NIR reference.")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all bands of the scene."""
        return tuple(b.name for b in self.bands)

    def nearest(self, wavelength: float, within: float, method: str) -> int:
        """0-based band nearest to a wavelength [nm].

        Raises
        ------
        BandError
            No band lies within the tolerance; the message lists the bands.
        """
        known = [(abs(b.wavelength - wavelength), i) for i, b in enumerate(self.bands) if b.wavelength]
        if not known or min(known)[0] > within:
            listed = ", ".join(f"{b.name} {b.wavelength or '?'} nm" for b in self.bands)
            raise BandError(
                f"{method} needs a band within {within:g} nm of {wavelength:g} nm; the scene has {listed}. "
                "Choose another --method, or name the --sensor if wavelengths are missing."
            )
        return min(known)[1]


def regression_plan(request: FitRequest, *, keep_index: bool) -> SamplePlan:
    """What the regression methods gather; `keep_index` where the level needs single values."""
    robust = request.regression in ("huber", "theil-sen")
    return SamplePlan(
        bands=request.correct,
        indexes=request.indexes,
        detrend_size=DETREND_SIZE if request.regression == "detrended" else 0,
        keep="all" if robust else "index" if keep_index else "nothing",
    )


def regression_model(
    method: str,
    request: FitRequest,
    stats: SampleStatistics,
    level: Callable[[SampleStatistics, int], float],
) -> GlintModel:
    """Slopes by the request's regression, levels by `level(stats, k)` for each index k.

    Raises
    ------
    FitError
        The sample is too small, or an index does not vary in it.
    """
    check_sample(request, stats)
    fits = _band_fits(request, REGRESSIONS[request.regression](stats), stats.regressed.n)
    indexes = tuple(replace(x, level=level(stats, k)) for k, x in enumerate(request.indexes))
    warnings = sample_warnings(stats) + fit_warnings(fits)
    return GlintModel(method, indexes, fits, request.names, request.regression, tuple(warnings))


def fixed_model(
    method: str, request: FitRequest, slopes: npt.ArrayLike, stats: SampleStatistics | None = None
) -> GlintModel:
    """The request's indexes with slopes (bands, indexes) that no regression estimates; R2 where there is a sample."""
    slopes = np.asarray(slopes, np.float64)
    unknown = np.full(slopes.shape, np.nan)
    if stats is None:
        return GlintModel(
            method, request.indexes, _band_fits(request, Slopes(slopes, unknown, unknown), 0), request.names
        )
    fits = _band_fits(request, Slopes(slopes, unknown, explained(stats, slopes)), stats.regressed.n)
    warnings = sample_warnings(stats) + fit_warnings(fits)
    return GlintModel(method, request.indexes, fits, request.names, None, tuple(warnings))


def _band_fits(request: FitRequest, slopes: Slopes, n: int) -> tuple[BandFit, ...]:
    """A fit for each band, to the index that it follows, or else to the one with the highest R2; NaN is not known."""
    fits = []
    for i, (band, follows) in enumerate(zip(request.correct, request.follows, strict=True)):
        k = int(np.argmax(slopes.r2[i])) if follows is None else follows
        slope, stderr, r2 = (float(x[i, k]) for x in (slopes.slope, slopes.stderr, slopes.r2))
        name = request.bands[band].name
        fits.append(BandFit(band, name, k, slope, _known(stderr), _known(r2), n))
    return tuple(fits)


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value


class Weighted(NamedTuple):
    """What takes glint from one band: its place among the plan's bands, places of its references among the variables,
    their weights, and the share of its variance that they explain."""

    band: int
    references: tuple[int, ...]
    weights: tuple[float, ...]
    r2: float


def slope_weights(request: FitRequest, stats: SampleStatistics) -> Iterator[Weighted]:
    """Each band's index and slope, by the request's regression."""
    check_sample(request, stats)
    slopes = REGRESSIONS[request.regression](stats)
    for i, fit in enumerate(_band_fits(request, slopes, stats.regressed.n)):
        yield Weighted(i, (len(request.correct) + fit.index,), (fit.slope,), float(slopes.r2[i, fit.index]))


def check_sample(request: FitRequest, stats: SampleStatistics) -> None:
    """Refuse a sample that cannot carry a fit."""
    if stats.regressed.n < MIN_PIXELS:
        raise FitError(
            f"sample holds {stats.regressed.n} valid pixels, need at least {MIN_PIXELS} to fit a slope. "
            "Widen the sample's polygon or window, or pass --sample."
        )
    for k in range(len(request.indexes)):
        name = " and ".join(request.bands[b].name for b in request.indexes[k].bands)
        v = len(request.correct) + k
        if stats.moments.minimum[v] == stats.moments.maximum[v]:
            raise FitError(
                f"{name} is constant ({stats.moments.minimum[v]:g}) over the {stats.moments.n} pixels of the "
                "sample, so no slope can be fitted. Choose another --nir, or a --sample where glint varies."
            )
        if stats.regressed.comoment[v, v] == 0 and request.regression == "detrended":
            raise FitError(f"{name} does not vary within windows of the sample; use --regression ols.")
        if not stats.moments.comoment[v, v] > 0:
            raise _beyond_squares(name, stats, v)
    for i, band in enumerate(request.correct):
        if not np.isfinite(stats.moments.comoment[i]).all():
            raise _beyond_squares(request.bands[band].name, stats, i)


def _beyond_squares(name: str, stats: SampleStatistics, v: int) -> FitError:
    low, high = stats.moments.minimum[v], stats.moments.maximum[v]
    return FitError(
        f"{name} goes from {low:g} to {high:g}, squares of which are beyond double precision. Bring it to other "
        "units, or mark what is not valid as nodata."
    )


def sample_warnings(stats: SampleStatistics) -> list[str]:
    """What is doubtful about a sample."""
    warnings = []
    if stats.moments.n < FEW_PIXELS:
        warnings.append(f"small sample: {stats.moments.n} pixels (fewer than {FEW_PIXELS}).")
    for v in range(len(stats.plan.bands), len(stats.moments.mean)):
        spread = float(np.sqrt(stats.moments.covariance()[v, v]))
        middle = abs(float(stats.moments.mean[v]))
        if spread < 0.01 * middle:
            warnings.append(
                f"uniform sample: the NIR varies by {100 * spread / middle:.2g} % of its mean (less than 1 %)."
            )
    return warnings


def fit_warnings(fits: Iterable[BandFit]) -> list[str]:
    """Where the index does not explain a band, or a slope is not to be trusted."""
    warnings = []
    for fit in fits:
        if fit.r2 is not None and fit.r2 < LOW_R2:
            share = f"{max(fit.r2, 0):.0%}"
            warnings.append(f"NIR explains only {share} of {fit.name} in the sample (R2 below {LOW_R2:g}).")
        if fit.stderr is not None and fit.slope < SIGNIFICANT * fit.stderr:
            said = f"{fit.slope:.3g} +- {fit.stderr:.2g}"
            warnings.append(f"the slope of {fit.name}, {said}, is not {SIGNIFICANT:g} standard errors above zero.")
    return warnings
