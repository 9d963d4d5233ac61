"""Subtract the NIR itself from every band.

The method assumes (remote-sensing) reflectance, in which glint is nearly equal in all bands and water is black in the
NIR. It is wrong for digital numbers and radiance, over-corrects turbid and shallow water, and needs no sample.
"""

from .model import GlintModel
from .request import FitRequest, linear_model


def fit(request: FitRequest, _stats: None = None) -> GlintModel:
    """Make the model R'_i = R_i - R_NIR, with R_i the reflectance of band i.

    Dierssen, Zimmerman, Leathers, Downes, Davis (2003), "Ocean color remote sensing of seagrass and bathymetry in the
    Bahamas Banks by high-resolution airborne imagery", Limnology and Oceanography 48, 444-455,
    doi:10.4319/lo.2003.48.1_part_2.0444.
    """
    return linear_model("nir-subtraction", request, [0.0] * len(request.indexes))
