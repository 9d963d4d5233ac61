"""Goodman, Lee and Ustin (2008): subtract the reflectance at 750 nm, less a part that is estimated from 640 nm.

The method assumes remote-sensing reflectance (give `rrs_factor` for other units: pi for reflectance), and that the
water-leaving part at 750 nm follows from the difference between 640 and 750 nm. It works pixel by pixel without a
sample, also over bright bottoms, and needs bands near 640 and 750 nm.
"""

from dataclasses import replace

from .model import GlintIndex, GlintModel
from .request import FitRequest, linear_model

A = 0.000019  # constant term of the water-leaving part at 750 nm [sr^-1]
B = 0.1  # increase of the water-leaving part at 750 nm with Rrs(640) - Rrs(750)


def fit(request: FitRequest, _stats: None = None) -> GlintModel:
    """Make the model R'_i = R_i - (g - A), with the glint index g = (1 + B) R_750 - B R_640, constants A (level) and B.

    Goodman, Lee, Ustin (2008), "Influence of atmospheric and sea-surface corrections on retrieval of bottom depth and
    reflectance using a semi-analytical model: a case study in Kaneohe Bay, Hawaii", Applied Optics 47, F1-F11,
    doi:10.1364/AO.47.0000F1.
    """
    red, infrared = request.nearest(640, 30, "goodman"), request.nearest(750, 20, "goodman")
    index = GlintIndex((red, infrared), (-B, 1 + B))
    request = replace(request, indexes=(index,), follows=(0,) * len(request.correct))
    return linear_model("goodman", request, [A * request.rrs_factor])
