"""The request for a fit, and the steps that the regression methods share."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import check_choice, check_number
from ..errors import BandError, FitError, InputError
from ..moments import Float64
from ..scene import Band
from .detrend import LOCAL_MEAN
from .model import BandFit, GlintIndex, GlintModel
from .statistics import REGRESSIONS, SamplePlan, SampleStatistics, explained, standard_error
from .strips import Strips

MIN_PIXELS = 64  # fewest pixels for fitting a slope: its standard error is 13 % where R2 is 0.5
FEW_PIXELS = 1000  # a fit to fewer pixels has a warning: the standard error of a slope exceeds 3 % where R2 is 0.5
LOW_R2 = 0.3  # a band with a smaller R2 has a warning: the index does not explain it
SIGNIFICANT = 3.0  # a slope that exceeds zero by fewer standard errors has a warning


@dataclass(frozen=True, slots=True)
class FitRequest:
    """What to fit: bands to correct, references, options. Raises InputError for a wrong option or empty `correct`."""

    bands: tuple[Band, ...]  # all bands of the scene
    correct: tuple[int, ...]  # 0-based bands to correct
    indexes: tuple[GlintIndex, ...]  # NIR references; their levels are not used
    follows: tuple[int | None, ...]  # position in `indexes` for each band of `correct`; None: the index with highest R2
    regression: str = "ols"  # key of `REGRESSIONS`
    floor_percentile: float = 0.0  # percentile of the index that is its level [%]; 0: the method's own level
    rrs_factor: float = math.pi  # ratio of the values to remote-sensing reflectance [sr]; pi for reflectance
    more: tuple[int, ...] = ()  # 0-based bands that are also references of shorter bands (`deglint.remove.further`)
    faint_glint: bool = False  # optimise kernels for faint glint; a posterior mean then removes strong glint
    resolved: bool = False  # pixels are smaller than waves, so that some have no glint
    sparkle: bool = False  # pixels may resolve sparkle, of which few flashes are very bright
    strips: Strips | Callable[[Any], Strips] | None = None  # map of detector strips, or its maker (see `wiener.fit`)
    level_error: bool = True  # estimate the standard error of the level of `wiener`; it takes half the time of a fit

    def __post_init__(self) -> None:
        check_choice(self.regression, list(REGRESSIONS), "regression")
        check_number(self.floor_percentile, 0, 100, "floor_percentile")
        check_number(self.rrs_factor, 1e-6, 1e6, "rrs_factor")
        if not self.correct:
            raise InputError(
                "no band but the NIR is left to correct: choose others (-b). If none is of shorter wavelength than the "
                "NIR, name the bands in their order (--bands)."
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all bands of the scene."""
        return tuple(b.name for b in self.bands)

    @property
    def nir(self) -> tuple[int, ...]:
        """0-based NIR band for the kernels of each band: the first in its index (in index 0 if `follows` has None)."""
        return tuple(self.indexes[follows or 0].bands[0] for follows in self.follows)

    def nearest(self, wavelength: float, within: float, method: str) -> int:
        """0-based band nearest to `wavelength` [nm]; BandError (about `method`) if none is within `within` nm of it."""
        known = [(abs(b.wavelength - wavelength), i) for i, b in enumerate(self.bands) if b.wavelength]
        if not known or min(known)[0] > within:
            listed = ", ".join(f"{b.name} {b.wavelength or '?'} nm" for b in self.bands)
            raise BandError(
                f"{method} needs a band within {within:g} nm of {wavelength:g} nm; the scene has {listed}. "
                f"Choose another --method{', or name the --sensor' if len(known) < len(self.bands) else ''}."
            )
        return min(known)[1]


def regression_plan(request: FitRequest, *, keep_index: bool = False) -> SamplePlan:
    """Plan moments (about local means for "detrended"), and single pixels if `keep_index` or an option needs them."""
    size = LOCAL_MEAN if request.regression == "detrended" else 0
    index = "index" if keep_index or request.floor_percentile > 0 else "nothing"
    keep = "all" if request.regression in ("huber", "theil-sen") else index
    return SamplePlan(request.correct, request.indexes, size, keep)


def linear_model(
    method: str,
    request: FitRequest,
    levels: Sequence[float],
    stats: SampleStatistics | None = None,
    slopes: Float64 | None = None,
) -> GlintModel:
    """Make the model of a method from the glint-free level of each index, `levels`, and the slopes, (band, index).

    If `slopes` is None, the regression that the request names determines the slopes and their standard errors from the
    statistics of the sample. If there is no sample (`stats` is None), all slopes are 1.
    """
    shape = len(request.correct), len(request.indexes)
    regression, n, errors, r2 = None, 0, np.full(shape, np.nan), np.full(shape, np.nan)
    if stats is None:
        slopes = np.ones(shape)
    else:
        if slopes is None:
            regression, slopes = request.regression, REGRESSIONS[request.regression](stats)
            errors = standard_error(stats, slopes)
        n, r2 = stats.regressed.n, explained(stats, slopes)
    fits = []
    for i, (band, follows) in enumerate(zip(request.correct, request.follows, strict=True)):
        k = int(np.argmax(r2[i])) if follows is None else follows
        error, share = (None if np.isnan(x[i, k]) else float(x[i, k]) for x in (errors, r2))
        fits.append(BandFit(band, request.bands[band].name, k, float(slopes[i, k]), error, share, n))
    warnings = () if stats is None else warnings_of(stats, fits)
    indexes = tuple(replace(x, level=float(level)) for x, level in zip(request.indexes, levels, strict=True))
    return GlintModel(method, indexes, tuple(fits), request.names, regression, warnings)


def check_sample(request: FitRequest, stats: SampleStatistics) -> None:
    """Raise FitError if the sample has too few pixels, the NIR does not vary, or squared values over- or underflow."""
    if stats.regressed.n < MIN_PIXELS:
        raise FitError(
            f"the sample has {stats.regressed.n} valid pixels; {MIN_PIXELS} are needed to fit a slope. Select more by "
            "--sample, take a larger image, or apply a saved --model."
        )
    moments, first = stats.moments, len(request.correct)
    used = [*((b,) for b in request.correct), *(index.bands for index in stats.plan.indexes)]
    nir = {b for index in request.indexes for b in index.bands}
    for v in (*range(first, len(used)), *range(first)):
        name, power = " and ".join(request.bands[b].name for b in used[v]), moments.comoment[v]
        reference = v >= first and nir.issuperset(used[v])  # other references may be constant
        if reference and moments.minimum[v] == moments.maximum[v]:
            raise FitError(
                f"{name} is constant ({moments.minimum[v]:g}) over the {moments.n} pixels of the sample, so no slope "
                "can be fitted. Choose another --nir, or a --sample where glint varies."
            )
        if reference and stats.regressed.comoment[v, v] == 0 and request.regression == "detrended":
            raise FitError(f"{name} does not vary within windows of the sample; use --regression ols.")
        if not (power[v] > 0 if reference else np.isfinite(power).all()):
            raise FitError(
                f"{name}: squares of {moments.minimum[v]:g} to {moments.maximum[v]:g} leave the range of double "
                "precision. Rescale the band (--scale), or declare invalid values as nodata (--nodata)."
            )


def warnings_of(stats: SampleStatistics, fits: Iterable[BandFit]) -> tuple[str, ...]:
    """Texts that warn of a small or uniform sample, a band that the index explains badly, or an uncertain slope."""
    warnings = []
    if stats.moments.n < FEW_PIXELS:
        warnings.append(f"small sample: {stats.moments.n} pixels (fewer than {FEW_PIXELS}).")
    for v in range(len(stats.plan.bands), len(stats.moments.mean)):
        spread, middle = float(np.sqrt(stats.moments.covariance()[v, v])), abs(float(stats.moments.mean[v]))
        if spread < 0.01 * middle:
            share = f"{100 * spread / middle:.2g} %"
            warnings.append(f"uniform sample: the NIR varies by {share} of its mean (less than 1 %).")
    for fit in fits:
        if fit.r2 is not None and fit.r2 < LOW_R2:
            share = f"{max(fit.r2, 0):.0%}"
            warnings.append(f"NIR explains only {share} of {fit.name} in the sample (R2 below {LOW_R2:g}).")
        if fit.stderr is not None and fit.slope < SIGNIFICANT * fit.stderr:
            said = f"{fit.slope:.3g} +- {fit.stderr:.2g}"
            warnings.append(f"the slope of {fit.name}, {said}, is not {SIGNIFICANT:g} standard errors above zero.")
    return tuple(warnings)
