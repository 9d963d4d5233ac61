"""Goodman, Lee and Ustin (2008): subtract the reflectance at 750 nm, without its water-leaving part, from every band.

The water-leaving part is estimated from the difference between 640 and 750 nm, with constants for remote-sensing
reflectance Rrs. `FitRequest.rrs_factor` is the ratio of the values to Rrs; the default is pi, for reflectance. The
method needs bands near 640 and 750 nm and no sample, processes each pixel alone, and works also over bright bottoms.
"""

from dataclasses import replace

from .model import GlintIndex, GlintModel
from .request import FitRequest, linear_model

A = 0.000019  # constant term of the water-leaving part at 750 nm [sr^-1]
B = 0.1  # water-leaving part at 750 nm, without the constant term, over Rrs(640) - Rrs(750)


def fit(request: FitRequest, _stats: None = None) -> GlintModel:
    """Make the model R'_i = R_i - (g - A f), with g = (1 + B) R_750 - B R_640, f the `rrs_factor`, A and B constants.

    Goodman, Lee, Ustin (2008), "Influence of atmospheric and sea-surface corrections on retrieval of bottom depth and
    reflectance using a semi-analytical model: a case study in Kaneohe Bay, Hawaii", Applied Optics 47, F1-F11,
    doi:10.1364/AO.47.0000F1.
    """
    red, infrared = request.nearest(640, 30, "goodman"), request.nearest(750, 20, "goodman")
    index = GlintIndex((red, infrared), (-B, 1 + B))
    request = replace(request, indexes=(index,), follows=(0,) * len(request.correct))
    return linear_model("goodman", request, [A * request.rrs_factor])
