"""Lyzenga, Malinas and Tanis (2006): slope from covariance and variance; the mean NIR is taken as glint-free NIR.

The method assumes that water and glint vary independently over the sample. It preserves the mean of the sample, so the
mean glint stays in the image: differences in a band are correct, absolute values are not. It costs one pass.
"""

from .model import GlintModel
from .request import FitRequest, check_sample, linear_model
from .statistics import SampleStatistics


def fit(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Fit L'_i = L_i - r_ij (L_j - mean L_j), with L_i the values of band i, j the NIR and r_ij = cov(i, j) / var(j).

    Lyzenga, Malinas, Tanis (2006), "Multispectral bathymetry using a simple physically based algorithm", IEEE
    Transactions on Geoscience and Remote Sensing 44, 2251-2259, doi:10.1109/TGRS.2006.872909.
    """
    check_sample(request, stats)
    return linear_model("lyzenga", request, stats.moments.mean[len(request.correct) :].tolist(), stats)
