"""Kutser, Vahtmae and Praks (2009): glint by the depth of the oxygen absorption at 760 nm.

Light that the surface reflects shows the oxygen absorption of the atmosphere; light from a shallow bright bottom shows
it weakly. The glint index is the depth of this absorption, so the method works also where water is not black in the
NIR. It needs narrow bands at 739, 760 and 775 nm (imaging spectrometers) and data before atmospheric correction.
"""

from dataclasses import replace

from ..errors import FitError
from .model import GlintIndex, GlintModel
from .request import FitRequest, check_sample, linear_model
from .statistics import SamplePlan, SampleStatistics


def plan(request: FitRequest) -> SamplePlan:
    """The statistics that `fit` needs: moments, and the pixels with the deepest and the shallowest absorption."""
    return SamplePlan(request.correct, _with_depth(request).indexes)


def fit(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Fit the glint spectrum G to the depth D of the oxygen absorption at 760 nm; R_i is the value of band i.

    R'_i = R_i - G_i D / D_max, with D = (R_739 + R_775) / 2 - R_760 and G_i = R_i(at D_max) - R_i(at D_min).

    Kutser, Vahtmae, Praks (2009), "A sun glint correction method for hyperspectral imagery containing areas with
    non-negligible water leaving NIR signal", Remote Sensing of Environment 113, 2267-2274,
    doi:10.1016/j.rse.2009.06.016.
    """
    request = _with_depth(request)
    check_sample(request, stats)
    shallow, deep = stats.darkest[0], stats.brightest[0]
    if not deep.value > 0:
        raise FitError("no oxygen absorption at 760 nm: take data before atmospheric correction, or another --method.")
    slopes = ((deep.spectrum - shallow.spectrum) / deep.value)[:, None]
    return linear_model("kutser", request, [0.0], stats, slopes)


def _with_depth(request: FitRequest) -> FitRequest:
    """The request with the depth of the oxygen absorption as the only glint index."""
    bands = tuple(request.nearest(w, 5, "kutser") for w in (739, 760, 775))
    depth = GlintIndex(bands, (0.5, -1.0, 0.5))
    return replace(request, indexes=(depth,), follows=(0,) * len(request.correct))
