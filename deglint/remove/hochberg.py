"""Hochberg, Andrefouet and Tyler (2003): slope between the brightest and the darkest NIR pixel.

The method assumes that these two pixels differ only in glint. As it depends on two pixels, one boat in the sample makes
it fail: select the sample with care. It costs one pass over the sample.
"""

import numpy as np

from .model import GlintModel
from .request import FitRequest, check_sample, linear_model
from .statistics import SamplePlan, SampleStatistics


def plan(request: FitRequest) -> SamplePlan:
    """The statistics that `fit` needs: moments, and the brightest and darkest pixel of every NIR reference."""
    return SamplePlan(request.correct, request.indexes)


def fit(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Fit L'_i = L_i - f (L_i(p) - L_i(q)), with f = (NIR - NIR(q)) / (NIR(p) - NIR(q)).

    L_i is the value of band i, L'_i the result; p is the pixel with the largest NIR, q the one with the smallest.

    Hochberg, Andrefouet, Tyler (2003), "Sea surface correction of high spatial resolution Ikonos images to improve
    bottom mapping in near-shore environments", IEEE Transactions on Geoscience and Remote Sensing 41, 1724-1729,
    doi:10.1109/TGRS.2003.815408.
    """
    check_sample(request, stats)
    ends = list(zip(stats.darkest, stats.brightest, strict=True))
    slopes = np.array([(b.spectrum - d.spectrum) / (b.value - d.value) for d, b in ends]).T
    return linear_model("hochberg", request, [d.value for d, _ in ends], stats, slopes)
