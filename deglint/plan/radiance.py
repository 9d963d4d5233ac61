"""Light in each band and viewing geometry: of the sun, out of the deep water, and out of the water over the object.

All means over a band are those of 1 nm steps, and exact: the angular model of the water is linear in a few
spectra, so these are averaged once and combined for all directions. No sum here is left to the library of linear
algebra, whose threads wait for each other for seconds where a machine is busy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..physics import atmosphere, water
from ..physics.sensor import band_means
from .mission import Mission

Array = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Light:
    """Mean light in each band.

    Attributes
    ----------
    direct, diffuse : (band,) ndarray
        Irradiance of a level plane by the sun and by the sky [W m-2 nm-1].
    normal : (band,) ndarray
        Irradiance of a plane that faces the sun, by the sun alone [W m-2 nm-1].
    background, target : (band, zenith, azimuth) ndarray
        Radiance out of the deep water, and out of the water over the object [W m-2 sr-1 nm-1].
    """

    direct: Array
    diffuse: Array
    normal: Array
    background: Array
    target: Array


def light(mission: Mission, zenith: Array, azimuth: Array) -> Light:
    """Light for all viewing geometries of a grid.

    Parameters
    ----------
    mission : Mission
    zenith, azimuth : (zenith,) and (azimuth,) ndarray
        Of the sensor from the target [degree].

    Notes
    -----
    Deep water after Lee et al. (2011), beyond the table (sun 75, view 70 degrees) with the coefficients of its
    edge; the object after `water.submerged_reflectance` or `water.absorption_only_reflectance`.
    """
    wavelength, mean = band_means(mission.channels)
    sun_zenith, sun_azimuth = mission.sun
    direct, diffuse = atmosphere.irradiance(wavelength, sun_zenith, mission.weather, day=mission.day)
    sea = water.case1(wavelength, mission.chlorophyll)
    terms = [term * (direct + diffuse) for term in water.lee_2011_terms(sea)]
    angular = water.lee_2011_grid(sun_zenith, zenith, azimuth - sun_azimuth)
    background = np.einsum("tb,tza->bza", [mean(term) for term in terms], angular)
    kept, shine = _through(mission, sea, zenith, direct / (direct + diffuse))
    target = np.einsum("tbz,tza->bza", [mean(term[:, None] * kept) for term in terms], angular)
    target += mean(shine * (direct + diffuse)[:, None])[..., None]
    sun = mean(direct)
    return Light(sun, mean(diffuse), sun / np.cos(np.radians(sun_zenith)), background, target)


def _through(mission: Mission, sea: water.Iops, zenith: Array, direct_fraction: Array) -> tuple[Array, Array]:
    """Share of the deep water's light that is left over the object, and the object's own (wavelength, zenith)."""
    column = water.Iops(*(np.asarray(part)[:, None] for part in sea))
    sun, depth, reflectance, fraction = mission.sun[0], mission.depth, mission.reflectance, direct_fraction[:, None]
    if mission.water == "absorption":
        shine = water.absorption_only_reflectance(
            column, sun, zenith, depth=depth, reflectance=reflectance, direct_fraction=fraction
        )
        return np.ones_like(shine), shine
    # the reflectance over an object is linear in that of the deep water: its two parts, each by itself
    kept = water.submerged_reflectance(column, 1.0, sun, zenith, depth=depth, reflectance=0.0, direct_fraction=fraction)
    shine = water.submerged_reflectance(
        column, 0.0, sun, zenith, depth=depth, reflectance=reflectance, direct_fraction=fraction
    )
    return kept, shine
