"""Published methods that subtract from every band a multiple of one glint index above its level.

    L'_i = L_i - b_i (g - g_0)

They differ in the index g, in the slopes b_i and in the level g_0, which is the index of water without glint. Each
function here is the `fit` of a method in `deglint.remove.METHODS`: it takes a `FitRequest` with the bands to correct
and the NIR references, and `SampleStatistics` [unit of the bands] that were gathered with the plan of the method. It
returns a `GlintModel`, or raises FitError if the sample has fewer than 64 pixels or a reference does not vary in it,
and BandError if the scene has no band at a wavelength that the method needs. Each costs one pass over the sample.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .levels import mode
from .model import GlintIndex, GlintModel
from .regression import REGRESSIONS
from .request import FitRequest, check_sample, linear_model
from .statistics import SamplePlan, SampleStatistics

GOODMAN_A, GOODMAN_B = 0.000019, 0.1
"""Offset [sr^-1], and the ratio of the water-leaving part at 750 nm to Rrs(640) - Rrs(750)."""


def hedley(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Slope against the NIR, level at its minimum or at `floor_percentile`: L'_i = L_i - b_i (NIR - min NIR).

    Assumes that glint in every band is proportional to that in the NIR, that water is dark in the NIR, and that at
    least one pixel of the sample is free of glint. Fails where bands are not simultaneous, and where the darkest NIR
    pixel is an outlier (a shadow, a dead detector): then use `floor_percentile`.

    References
    ----------
    Hedley, Harborne, Mumby (2005), "Simple and robust removal of sun glint for mapping shallow-water benthos",
    International Journal of Remote Sensing 26, 2107-2112, doi:10.1080/01431160500034086.
    """
    check_sample(request, stats)
    levels = [darkest.value for darkest in stats.darkest]
    if request.floor_percentile > 0:  # in float64, since between float32 values numpy interpolates in float32
        kept = (stats.index_values(k).astype(np.float64) for k in range(len(levels)))
        levels = [float(np.percentile(values, request.floor_percentile)) for values in kept]
    return _regressed("hedley", request, stats, levels)


def lyzenga(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Slope against the NIR, level at its mean: L'_i = L_i - r_ij (L_j - mean L_j), r_ij = cov(i, j) / var(j).

    Assumes that water and glint vary independently over the sample. The mean of the sample is preserved, so the mean
    glint stays in the image: differences within a band are correct, absolute values are not.

    References
    ----------
    Lyzenga, Malinas, Tanis (2006), "Multispectral bathymetry using a simple physically based algorithm", IEEE
    Transactions on Geoscience and Remote Sensing 44, 2251-2259, doi:10.1109/TGRS.2006.872909.
    """
    check_sample(request, stats)
    return _regressed("lyzenga", request, stats, stats.moments.mean[len(request.correct) :].tolist())


def joyce(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Slope against the NIR, level at its mode (`deglint.remove.levels.mode`): L'_i = L_i - b_i (NIR - mode NIR).

    Assumes that most pixels of the sample are free of glint, so that the mode of the NIR is that of water; this fails
    above a fraction of glint pixels of about 60 %. The most robust of the three regressions if there is little glint.
    Sorts the NIR values of the sample once.

    References
    ----------
    Joyce (2004), "A method for mapping live coral cover using remote sensing", PhD thesis, The University of
    Queensland; as given by Kay, Hedley, Lavender (2009), Remote Sensing 1, 697-730, doi:10.3390/rs1040697, section
    3.2.
    """
    check_sample(request, stats)
    return _regressed("joyce", request, stats, [mode(stats.index_values(k)) for k in range(len(request.indexes))])


def _regressed(method: str, request: FitRequest, stats: SampleStatistics, levels: list[float]) -> GlintModel:
    """Model with slopes by the request's regression."""
    slopes = REGRESSIONS[request.regression](stats)
    return linear_model(method, request, slopes, levels, stats, regression=request.regression)


def hochberg_plan(request: FitRequest) -> SamplePlan:
    """Statistics to gather: moments, and the brightest and darkest pixel of every NIR reference."""
    return SamplePlan(request.correct, request.indexes)


def hochberg(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Slope between the brightest and the darkest NIR pixel, level at the darkest.

    L'_i = L_i - f (L_i(brightest) - L_i(darkest)) with f = (NIR - min NIR) / (max NIR - min NIR).

    Assumes that these two pixels differ only in glint, so one boat in the sample makes it fail: select the sample with
    care.

    References
    ----------
    Hochberg, Andrefouet, Tyler (2003), "Sea surface correction of high spatial resolution Ikonos images to improve
    bottom mapping in near-shore environments", IEEE Transactions on Geoscience and Remote Sensing 41, 1724-1729,
    doi:10.1109/TGRS.2003.815408.
    """
    check_sample(request, stats)
    ends = list(zip(stats.darkest, stats.brightest, strict=True))
    slopes = np.array([(b.spectrum - d.spectrum) / (b.value - d.value) for d, b in ends]).T
    return linear_model("hochberg", request, slopes, [d.value for d, _ in ends], stats)


def kutser_plan(request: FitRequest) -> SamplePlan:
    """Statistics to gather: moments, and the pixels with the deepest and the shallowest oxygen absorption."""
    return SamplePlan(request.correct, _with_depth(request).indexes)


def kutser(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Glint spectrum G against the depth D of the oxygen absorption band at 760 nm, level 0.

    R'_i = R_i - G_i D / D_max with D = (R_739 + R_775) / 2 - R_760 and G = R(at D_max) - R(at D_min).

    Light reflected at the surface has the oxygen absorption of the atmosphere, which is weak in light from shallow
    bright bottoms. So the method works where water is not black in the NIR. Needs narrow bands at 739, 760 and 775 nm
    (imaging spectrometers) and data that are not corrected for the atmosphere.

    References
    ----------
    Kutser, Vahtmae, Praks (2009), "A sun glint correction method for hyperspectral imagery containing areas with
    non-negligible water leaving NIR signal", Remote Sensing of Environment 113, 2267-2274,
    doi:10.1016/j.rse.2009.06.016.
    """
    request = _with_depth(request)
    check_sample(request, stats)
    shallow, deep = stats.darkest[0], stats.brightest[0]
    slopes = ((deep.spectrum - shallow.spectrum) / deep.value)[:, None]
    return linear_model("kutser", request, slopes, [0.0], stats)


def _with_depth(request: FitRequest) -> FitRequest:
    bands = tuple(request.nearest(w, 5, "kutser") for w in (739, 760, 775))
    return _with_index(request, GlintIndex(bands, (0.5, -1.0, 0.5)))


def _with_index(request: FitRequest, index: GlintIndex) -> FitRequest:
    """The request with one index for all bands."""
    return replace(request, indexes=(index,), follows=(0,) * len(request.correct))


def goodman(request: FitRequest, _stats: SampleStatistics | None = None) -> GlintModel:
    """Reflectance at 750 nm minus an offset that depends on 640 nm: R'_i = R_i - R_750 + A + B (R_640 - R_750).

    Its index is (1 + B) R_750 - B R_640, its level A, and every slope 1. Assumes remote-sensing reflectance (give
    `rrs_factor` for other units: pi for reflectance), and that the water-leaving part at 750 nm follows from the
    difference between 640 and 750 nm. Works pixel by pixel without a sample, also over bright bottoms.

    References
    ----------
    Goodman, Lee, Ustin (2008), "Influence of atmospheric and sea-surface corrections on retrieval of bottom depth and
    reflectance using a semi-analytical model: a case study in Kaneohe Bay, Hawaii", Applied Optics 47, F1-F11,
    doi:10.1364/AO.47.0000F1.
    """
    red, infrared = request.nearest(640, 30, "goodman"), request.nearest(750, 20, "goodman")
    request = _with_index(request, GlintIndex((red, infrared), (-GOODMAN_B, 1 + GOODMAN_B)))
    return linear_model("goodman", request, np.ones((len(request.correct), 1)), [GOODMAN_A * request.rrs_factor])


def nir_subtraction(request: FitRequest, _stats: SampleStatistics | None = None) -> GlintModel:
    """The NIR itself: R'_i = R_i - R_NIR.

    Assumes reflectance (or remote-sensing reflectance): there glint is nearly the same in all bands and water is black
    in the NIR. Wrong for digital numbers or for radiance; over-corrects turbid and shallow water. Needs no sample.

    References
    ----------
    Dierssen, Zimmerman, Leathers, Downes, Davis (2003), "Ocean color remote sensing of seagrass and bathymetry in the
    Bahamas Banks by high-resolution airborne imagery", Limnology and Oceanography 48, 444-455,
    doi:10.4319/lo.2003.48.1_part_2.0444.
    """
    count = len(request.indexes)
    return linear_model("nir-subtraction", request, np.ones((len(request.correct), count)), [0.0] * count)
