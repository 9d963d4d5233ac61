"""Reflectance spectra of materials other than water.

The values are rounded and typical of Lambertian surfaces. They are interpolated linearly between the wavelengths of the
table, and constant beyond them. Values of sand and algae follow Lee et al. (1999), fig. 2, and Hochberg et al. (2003),
doi:10.1016/S0034-4257(02)00201-8. Foam is 0.5 in the visible, less in NIR: Frouin et al. (1996), doi:10.1029/96JC00629.
"""

import numpy as np
import numpy.typing as npt

from ..physics._checks import Floats

WAVELENGTHS = (400, 450, 500, 550, 600, 650, 700, 750, 850, 1000)  # wavelengths of the columns of `SPECTRA` [nm]
SPECTRA = {
    "sand": (0.20, 0.24, 0.28, 0.32, 0.36, 0.39, 0.41, 0.43, 0.45, 0.47),
    "algae": (0.02, 0.02, 0.03, 0.06, 0.05, 0.04, 0.10, 0.30, 0.35, 0.35),
    "coral": (0.04, 0.05, 0.07, 0.11, 0.13, 0.13, 0.20, 0.35, 0.40, 0.40),
    "vegetation": (0.04, 0.05, 0.06, 0.10, 0.07, 0.06, 0.16, 0.42, 0.47, 0.48),
    "rock": (0.10, 0.12, 0.15, 0.18, 0.22, 0.25, 0.28, 0.30, 0.33, 0.36),
    "foam": (0.50, 0.50, 0.50, 0.50, 0.49, 0.48, 0.46, 0.43, 0.35, 0.28),
    "paint": (0.38, 0.40, 0.41, 0.42, 0.42, 0.42, 0.42, 0.42, 0.41, 0.40),
    "skin": (0.18, 0.20, 0.25, 0.27, 0.33, 0.43, 0.48, 0.52, 0.55, 0.45),
    "orange": (0.05, 0.05, 0.06, 0.12, 0.45, 0.60, 0.65, 0.68, 0.70, 0.70),
}
"""Reflectance [1] of each material at `WAVELENGTHS`."""


def reflectance(name: str, wavelength: npt.ArrayLike) -> Floats:
    """Reflectance [1] of a material, a key of `SPECTRA`, at wavelengths [nm].

    >>> reflectance("sand", [475.0, 900.0]).round(3).tolist()
    [0.26, 0.457]
    """
    return np.asarray(np.interp(np.asarray(wavelength, np.float64), WAVELENGTHS, SPECTRA[name]))
