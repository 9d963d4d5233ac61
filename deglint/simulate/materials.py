"""Reflectance spectra of materials other than water.

The values are rounded and typical of Lambertian surfaces. They are interpolated linearly between the wavelengths of the
table, and constant beyond them. Values of sand and algae follow Lee et al. (1999), fig. 2, and Hochberg et al. (2003),
doi:10.1016/S0034-4257(02)00201-8. Foam is 0.5 in the visible, less in NIR: Frouin et al. (1996), doi:10.1029/96JC00629.
"""

import numpy as np
import numpy.typing as npt

from ..physics._checks import Floats
from ..physics.tables import load

SPECTRA = {name: tuple(values.tolist()) for name, values in load("materials").items()}
"""Reflectance [1] of each material at `WAVELENGTHS`."""
WAVELENGTHS = SPECTRA.pop("wavelength_nm")  # wavelengths of the values in `SPECTRA` [nm]


def reflectance(name: str, wavelength: npt.ArrayLike) -> Floats:
    """Reflectance [1] of a material, a key of `SPECTRA`, at wavelengths [nm].

    >>> reflectance("sand", [475.0, 900.0]).round(3).tolist()
    [0.26, 0.457]
    """
    return np.asarray(np.interp(np.asarray(wavelength, np.float64), WAVELENGTHS, SPECTRA[name]))
