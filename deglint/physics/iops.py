"""Inherent optical properties: absorption and backscattering of case-1 sea water as functions of chlorophyll.

The model includes pure sea water, phytoplankton with other particles, and yellow substance (CDOM), from 300 to 1000 nm.
The amounts of particles and CDOM follow from chlorophyll. The model holds for the open ocean (case 1). For coastal
water, which has sediment and more CDOM, create an `Iops` from your own values.

References
----------
Bricaud, Morel, Babin, Allali, Claustre (1998), "Variations of light absorption by suspended
particles with chlorophyll a concentration in oceanic (case 1) waters", Journal of Geophysical Research 103,
31033-31044, doi:10.1029/98JC02712. Morel, Maritorena (2001), "Bio-optical properties of oceanic waters: a
reappraisal", Journal of Geophysical Research 106, 7163-7180, doi:10.1029/2000JC000319.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ._checks import Array, within
from .tables import WAVELENGTH_RANGE as WAVELENGTH_RANGE
from .tables import checked_wavelength, interpolate

CHLOROPHYLL_RANGE = (0.01, 30.0)  # chlorophyll that the model of case-1 water accepts [mg m-3]


class Iops(NamedTuple):
    """Inherent optical properties [1/m] at wavelengths: total absorption; backscattering by water and by particles."""

    absorption: Array
    water_backscattering: Array
    particle_backscattering: Array

    @property
    def backscattering(self) -> Array:
        """Backscattering of water and particles [1/m]."""
        return self.water_backscattering + self.particle_backscattering


def case1(wavelength: npt.ArrayLike, chlorophyll: npt.ArrayLike) -> Iops:
    """Inherent optical properties of case-1 water.

    C is chlorophyll, a_w and a_p are the absorption of sea water and of particles at the wavelength lambda, and A and E
    are from a table for this wavelength (Bricaud et al. 1998). Total absorption a and particle backscattering b_bp are

        a = a_w + a_p + 0.2 a_p(440) exp(-0.014 (lambda - 440)),  a_p = A C^E,
        b_bp = [0.002 + 0.01 (0.5 - 0.25 log10 C) (lambda / 550)^v] 0.416 C^0.766,
        v = (log10 max(C, 0.02) - 0.3) / 2 for C < 2 mg m-3, else 0

    (Morel and Maritorena 2001, eq. 12 to 14). Of the light that pure water scatters, half is scattered backwards.

    Parameters
    ----------
    wavelength : array_like
        Wavelength [nm], 300 to 1000; broadcasts with `chlorophyll`.
    chlorophyll : array_like
        Chlorophyll concentration [mg m-3], 0.01 to 30.

    Examples
    --------
    >>> water = case1(490, 0.5)
    >>> float(water.absorption.round(5)), float(water.backscattering.round(6))
    (0.04011, 0.003333)
    """
    wavelength, chlorophyll = checked_wavelength(wavelength), _chlorophyll(chlorophyll)
    absorption = interpolate("sea_water", "absorption_m-1", wavelength) + particle_absorption(wavelength, chlorophyll)
    yellow = 0.2 * particle_absorption(440.0, chlorophyll) * np.exp(-0.014 * (wavelength - 440.0))
    molecules = 0.5 * interpolate("sea_water", "scattering_m-1", wavelength)
    log = np.log10(chlorophyll)
    slope = np.where(chlorophyll < 2.0, 0.5 * (np.maximum(log, np.log10(0.02)) - 0.3), 0.0)
    particles = 0.416 * chlorophyll**0.766
    share = 0.002 + 0.01 * (0.5 - 0.25 * log) * (wavelength / 550.0) ** slope
    return Iops(absorption + yellow, molecules, share * particles)


def particle_absorption(wavelength: npt.ArrayLike, chlorophyll: npt.ArrayLike) -> Array:
    """Absorption by all particles, A C^E [1/m] (Bricaud et al. 1998); it is 0 from 720 nm on.

    `wavelength` [nm] and `chlorophyll` C [mg m-3] are as in `case1`. The table's file gives the sources of A and E.

    Examples
    --------
    >>> float(particle_absorption(440, 1.0).round(4))
    0.052
    """
    exponent = interpolate("particle_absorption", "E", wavelength)
    return interpolate("particle_absorption", "A", wavelength) * _chlorophyll(chlorophyll) ** exponent


def _chlorophyll(chlorophyll: npt.ArrayLike) -> Array:
    return within("chlorophyll", chlorophyll, *CHLOROPHYLL_RANGE, "mg m-3", "0.5 is usual on a shelf, 0.05 offshore.")
