"""Multiband: regression of every band on all longer bands; the level is a low percentile of the prediction.

Several longer bands together predict glint better than the NIR alone. Least squares finds the best combination,

    L'_i = L_i - (p_i - p_i0),    p_i = sum_r w_ir L_r,    w_i = (C_rr + ridge diag C_rr)^-1 C_ri

with L_i the values of band i, C the covariance in the sample, and p_i0 the 5th percentile of p_i, or the percentile
`floor_percentile` if that is above 0. The references r are the bands of longer wavelength than band i, from 640 nm to
1050 nm, or to the longest NIR if that is longer. If there are none, or if wavelengths of band i or the NIR are not
known, the references are the other NIR bands. One reference, no ridge and percentile 0 give the method of Hedley.

The method assumes that deep water is black, or uniform, in the references. Over shoals the red bands show the bottom,
and bright bottoms become too dark. The ridge prevents large opposite weights of collinear references. The method fails
where bands are not simultaneous. It costs one pass over the sample, and a multiplication per pixel, band and reference.
"""

import numpy as np

from ..moments import Float64
from .model import BandFit, GlintIndex, GlintModel
from .request import FitRequest, check_sample, warnings_of
from .statistics import SamplePlan, SampleStatistics

REFERENCE_RIDGE = 1e-4  # ridge, relative to the variance of each reference
PERCENTILE = 5.0  # default percentile of the prediction that is its level [%]
SHORTEST_REFERENCE = 640.0  # shortest wavelength of a reference [nm]


def references(request: FitRequest, band: int) -> tuple[int, ...]:
    """0-based bands on which a band is regressed: longer bands, or the other NIR bands if there are none."""
    waves = [b.wavelength or 0.0 for b in request.bands]
    nir = {b for index in request.indexes for b in index.bands}
    known = all(waves[b] for b in (band, *nir))
    above, longest = max(waves[band], SHORTEST_REFERENCE - 1e-9), max(1050.0, *(waves[b] for b in nir))
    return tuple([b for b, w in enumerate(waves) if known and above < w <= longest] or sorted(nir - {band}))


def plan(request: FitRequest) -> SamplePlan:
    """The statistics that `fit` needs: moments of bands and references, and single pixels for the percentile."""
    used = {r for b in request.correct for r in references(request, b)}
    indexes = tuple(GlintIndex((r,), (1.0,)) for r in sorted(used))
    return SamplePlan(request.correct, indexes, keep="index")


def fit(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Fit L'_i = L_i - (p_i - p_i0), with p_i the ridge regression of band i on longer bands, p_i0 a percentile of p_i.

    Hedley, Harborne, Mumby (2005), International Journal of Remote Sensing 26, 2107-2112,
    doi:10.1080/01431160500034086 (one reference); Hoerl, Kennard (1970), Technometrics 12, 55-67,
    doi:10.1080/00401706.1970.10488634 (ridge regression).
    """
    check_sample(request, stats)
    indexes, fits, first = [], [], len(stats.plan.bands)
    place = {index.bands[0]: k for k, index in enumerate(stats.plan.indexes)}
    for i, band in enumerate(request.correct):
        used = references(request, band)
        weights, r2 = _ridge(stats, i, [first + place[r] for r in used])
        kept = stats.values[[place[r] for r in used]].astype(np.float64)
        level = np.percentile(weights @ kept, request.floor_percentile or PERCENTILE)
        indexes.append(GlintIndex(used, tuple(map(float, weights)), float(level)))
        fits.append(BandFit(band, request.bands[band].name, i, 1.0, None, r2, stats.regressed.n))
    return GlintModel("multiband", tuple(indexes), tuple(fits), request.names, None, warnings_of(stats, fits))


def _ridge(stats: SampleStatistics, band: int, references: list[int]) -> tuple[Float64, float]:
    """Weights (reference,) and R2 of the ridge regression of a band; bands are given as indices of variables."""
    comoment = stats.regressed.comoment
    power = comoment[np.ix_(references, references)]
    cross, total = comoment[references, band], float(comoment[band, band])
    scale = np.sqrt(np.maximum(np.diag(power), np.finfo(np.float64).tiny))
    ridged = power / np.outer(scale, scale) + REFERENCE_RIDGE * np.eye(len(references))
    weights = np.linalg.solve(ridged, cross / scale) / scale
    rest = total - 2 * float(weights @ cross) + float(weights @ power @ weights)
    return weights, 1 - rest / total if total > 0 else 0.0
