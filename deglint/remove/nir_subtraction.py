"""Subtract the NIR itself from every band.

Assumes reflectance (or remote-sensing reflectance): there glint is nearly the same in all bands and water is black in
the NIR. Wrong for digital numbers or for radiance; over-corrects turbid and shallow water. Needs no sample and no fit.
"""

from .model import GlintModel
from .request import FitRequest, linear_model


def fit(request: FitRequest, _stats: None = None) -> GlintModel:
    """R'_i = R_i - R_NIR.

    Dierssen, Zimmerman, Leathers, Downes, Davis (2003), "Ocean color remote sensing of seagrass and bathymetry in the
    Bahamas Banks by high-resolution airborne imagery", Limnology and Oceanography 48, 444-455,
    doi:10.4319/lo.2003.48.1_part_2.0444.
    """
    return linear_model("nir-subtraction", request, [0.0] * len(request.indexes))
