"""Statistics of the sample for a fit, gathered tile by tile and merged, and the regression of the bands with them.

The result is the same to the bit for any tiles aligned with the cells (squares of pixels) of `deglint.moments` and any
number of threads: moments are merged by cell, pixels are selected by position, and the first of equal pixels is taken.

Neighbouring pixels are correlated. If the sample spans enough cells, standard errors are therefore estimated between
cells (the cluster-robust estimate of Liang and Zeger 1986), else between pixels as if they were independent. A cell
with much of the glint dominates the slope, so that its residuals are too small. So residuals are divided by the share
of glint in the other cells (CR3 of Bell and McCaffrey 2002, the jackknife; Cameron and Miller 2015, section VI.B).

References
----------
Liang, Zeger (1986), Biometrika 73, 13-22, doi:10.1093/biomet/73.1.13.
Bell, McCaffrey (2002), Survey Methodology 28, 169-181.
Cameron, Miller (2015), Journal of Human Resources 50, 317-372, doi:10.3368/jhr.50.2.317.
Huber (1964), Annals of Mathematical Statistics 35, 73-101, doi:10.1214/aoms/1177703732.
Sen (1968), Journal of the American Statistical Association 63, 1379-1389, doi:10.1080/01621459.1968.10480934.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..errors import FitError
from ..moments import CellMoments, Crop, Float64, Mask, Moments, cell_moments, thinned
from ..scene import FloatArray
from .detrend import detrend
from .model import GlintIndex

CLUSTERS = 10  # fewest cells for a standard error between cells
LEAST_ELSEWHERE = 1e-3  # lower limit of the share of glint in other cells, so that errors are finite
ROBUST_PIXELS = 50_000  # most pixels in the Huber regression
PAIRED_PIXELS = 2_000  # most pixels in the Theil-Sen regression, which uses all pairs (two million)


@dataclass(frozen=True)
class SamplePlan:
    """Which statistics of a sample `gather` computes: for which bands and glint indexes, and with which options."""

    bands: tuple[int, ...]  # 0-based bands to fit
    indexes: tuple[GlintIndex, ...]  # glint indexes to regress on; their levels are not used
    detrend_size: int = 0  # side of the window whose mean is subtracted before the regression [pixel]; 0 for none
    keep: str = "nothing"  # values kept of single pixels: "nothing", "index" (for the level), or "all" (all variables)
    share: int = 1  # one in this many pixels is kept, selected by a hash of row and column
    levels: int = 0  # 2**levels neighbouring cells of a row are merged into one

    @property
    def read_bands(self) -> tuple[int, ...]:
        """0-based bands that the block given to `gather` must contain, in this order."""
        return tuple(sorted(set(self.bands) | {b for i in self.indexes for b in i.bands}))

    @property
    def halo(self) -> int:
        """Number of pixels that `gather` needs on every side of a tile."""
        return self.detrend_size // 2


@dataclass(frozen=True, eq=False)
class Extreme:
    """The pixel of a sample with the smallest, or with the largest, value of a glint index."""

    value: float  # glint index
    place: tuple[int, int]  # row and column in the scene
    spectrum: Float64  # (band,), in the order of the plan's bands


@dataclass(frozen=True, eq=False)
class SampleStatistics:
    """Statistics of a sample, or of its part in a tile; variables are the bands, then the indexes, of the plan."""

    plan: SamplePlan
    raw: CellMoments  # moments of the variables
    cells: CellMoments  # moments of the variables to which slopes are fitted: detrended if the plan says so, else `raw`
    darkest: tuple[Extreme, ...]  # pixel with the smallest value of each index; empty if the sample has no pixel
    brightest: tuple[Extreme, ...]  # the same with the largest value
    places: npt.NDArray[np.int64]  # (2, pixel): row and column of the kept pixels in the scene; `merge` sorts them
    values: FloatArray  # of the kept pixels: (variable, pixel) if the plan keeps "all", else (index, pixel)

    @cached_property
    def moments(self) -> Moments:
        """Moments of the variables over the whole sample; local means are not subtracted."""
        return self.raw.total()

    @cached_property
    def regressed(self) -> Moments:
        """Moments of `cells` over the whole sample; local means are subtracted if the plan says so."""
        return self.cells.total()

    def index_values(self, k: int) -> FloatArray:
        """Values of glint index k in the single pixels that are kept, (pixel,)."""
        return self.values[k + (len(self.plan.bands) if self.plan.keep == "all" else 0)]


def gather(
    block: FloatArray, mask: Mask, plan: SamplePlan, *, origin: tuple[int, int] = (0, 0), crop: Crop = (0, 0, 0, 0)
) -> SampleStatistics:
    """Statistics of the sample's pixels in one tile.

    block : (band, row, column), values of the tile with its halo in the bands `plan.read_bands`, NaN where not valid
    mask : (row, column), True where a pixel belongs to the sample (in the halo too)
    origin : row and column in the scene of the tile's first pixel, not counting the halo [pixel]
    crop : halo of the block: rows above and below, columns left and right [pixel]
    """
    planes = dict(zip(plan.read_bands, block, strict=True))
    first = len(plan.bands)
    found = [*(planes[b] for b in plan.bands), *(index.of(planes) for index in plan.indexes)]
    variables: FloatArray = np.stack(found, dtype=block.dtype, casting="same_kind")
    mask = mask & np.isfinite(variables).all(axis=0)
    inner = slice(crop[0], mask.shape[0] - crop[1]), slice(crop[2], mask.shape[1] - crop[3])
    raw = cells = cell_moments(variables[:, *inner], mask[inner], origin=origin)
    if plan.detrend_size:
        cells = cell_moments(detrend(variables, mask, plan.detrend_size)[:, *inner], mask[inner], origin=origin)
    variables, mask = variables[:, *inner], mask[inner]
    darkest, brightest = (_extremes(variables, mask, first, origin, sign) for sign in (1, -1))
    kept = thinned(mask, origin, plan.share) if plan.keep != "nothing" else np.zeros_like(mask)
    rows, columns = np.nonzero(kept)
    places = np.stack([rows + origin[0], columns + origin[1]])
    values = variables[0 if plan.keep == "all" else first :, rows, columns]
    return SampleStatistics(plan, raw, cells, darkest, brightest, places, values)


def merge(parts: Sequence[SampleStatistics], plan: SamplePlan) -> SampleStatistics:
    """Merge the statistics of several tiles; the result is the same to the bit for any order of the parts.

    parts : at least one, gathered with this plan
    plan : its `levels` say how many neighbouring cells are merged into one
    """
    some = [p for p in parts if len(p.raw.n)] or parts[:1]
    raw = CellMoments.concatenate([p.raw for p in some]).joined(plan.levels)
    cells = CellMoments.concatenate([p.cells for p in some]).joined(plan.levels) if plan.detrend_size else raw
    places, values = (np.concatenate([getattr(p, name) for p in some], axis=1) for name in ("places", "values"))
    order = np.argsort((places[0] << 32) + places[1], kind="stable")  # fast, as rows of a tile are in order
    darkest, brightest = _first(1, [p.darkest for p in some]), _first(-1, [p.brightest for p in some])
    return SampleStatistics(plan, raw, cells, darkest, brightest, places[:, order], values[:, order])


def _first(sign: int, extremes: Sequence[tuple[Extreme, ...]]) -> tuple[Extreme, ...]:
    """Darkest (`sign` 1) or brightest (-1) pixel of several tiles in each index; if pixels are equal, the first one."""
    return tuple(min(some, key=lambda e: (sign * e.value, e.place)) for some in zip(*extremes, strict=True))


def _extremes(variables: FloatArray, mask: Mask, bands: int, origin: tuple[int, int], sign: int) -> tuple[Extreme, ...]:
    """Darkest (`sign` 1) or brightest (-1) pixel of a mask in each index, `variables[bands:]`; if equal, the first."""
    among, out = np.flatnonzero(mask), []
    for values in variables[bands:] if among.size else ():
        row, column = divmod(int(among[np.argmin(sign * values[mask])]), mask.shape[1])
        spectrum = variables[:bands, row, column].astype(np.float64)
        out.append(Extreme(float(values[row, column]), (row + origin[0], column + origin[1]), spectrum))
    return tuple(out)


def least_squares(stats: SampleStatistics) -> Float64:
    """Slopes (band, index) by least squares, cov(band, index) / var(index), from `SampleStatistics.regressed`."""
    bands = len(stats.plan.bands)
    return np.asarray(stats.regressed.comoment[:bands, bands:] / np.diag(stats.regressed.comoment)[bands:])


def huber(stats: SampleStatistics) -> Float64:
    """Slopes (band, index) by Huber's M-estimator (epsilon 1.35, scikit-learn) from at most `ROBUST_PIXELS` pixels."""
    from sklearn.linear_model import HuberRegressor

    def slope_of(x: Float64, y: Float64) -> float:
        if y.min() == y.max():  # rounding may give y a standard deviation above 0
            return 0.0
        scale_x, scale_y = np.std(x), np.std(y)
        fit = HuberRegressor(alpha=0.0, max_iter=1000, tol=1e-8)
        fit.fit(((x - np.mean(x)) / scale_x)[:, None], (y - np.mean(y)) / scale_y)
        return float(fit.coef_[0] * scale_y / scale_x)

    return _pixelwise(stats, slope_of, ROBUST_PIXELS)


def theil_sen(stats: SampleStatistics) -> Float64:
    """Slopes (band, index): median of the slopes of all pairs (SciPy) among at most `PAIRED_PIXELS` pixels."""
    from scipy.stats import theilslopes

    with np.errstate(invalid="ignore"):  # from a confidence interval that is not used
        return _pixelwise(stats, lambda x, y: float(theilslopes(y, x).slope), PAIRED_PIXELS)


REGRESSIONS: dict[str, Callable[[SampleStatistics], Float64]] = {
    "ols": least_squares,
    "detrended": least_squares,
    "huber": huber,
    "theil-sen": theil_sen,
}
"""Estimators of slopes, (band, index). "detrended": least squares after local means are subtracted (`SamplePlan`)."""


def standard_error(stats: SampleStatistics, slope: Float64) -> Float64:
    """Standard errors of slopes (band, index), from differences between cells, or between pixels if cells are few.

    Between G cells the error is ``sqrt((G - 1) / G sum_c (s_c / (1 - h_c))^2) / S``, with S the sum of the squared
    deviations of the glint index from its mean, h_c the share of cell c in S, and s_c the sum over the cell of the
    deviation of the index times the residual of the band.
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


def explained(stats: SampleStatistics, slope: Float64) -> Float64:
    """R2 (band, index): share of a band's variance that given slopes (band, index) explain; 0 if a band is constant."""
    bands = len(stats.plan.bands)
    comoment = stats.regressed.comoment
    total, cross, power = np.diag(comoment)[:bands, None], comoment[:bands, bands:], np.diag(comoment)[bands:]
    rest = total - 2 * slope * cross + slope**2 * power
    return np.where(total > 0, 1 - rest / np.where(total > 0, total, 1), 0.0)


def _pixelwise(stats: SampleStatistics, slope_of: Callable[[Float64, Float64], float], most: int) -> Float64:
    """Slopes (band, index): `slope_of(index values, band values)` of every n-th kept pixel, at most `most` pixels."""
    bands, indexes = len(stats.plan.bands), len(stats.plan.indexes)
    step = -(-stats.values.shape[1] // most)
    values = stats.values[:, ::step].astype(np.float64)
    if (values[bands:].min(axis=1) == values[bands:].max(axis=1)).any():
        raise FitError(f"the NIR is constant in the {values.shape[1]} pixels of this regression; use --regression ols.")
    return np.array([[slope_of(values[bands + k], values[i]) for k in range(indexes)] for i in range(bands)])
