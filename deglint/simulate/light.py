"""How much light there is in each band: of the sun, of the sky, and out of the water."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..physics import atmosphere, water
from ..physics.sensor import SensorBand
from .setup import Setup

Array = npt.NDArray[np.floating[Any]]

TABLES = (300.0, 1000.0)
"""Wavelengths that the tables cover [nm]; a band that reaches beyond is averaged over what is inside."""


@dataclass(frozen=True, eq=False)
class Light:
    """Light in each band, mean over the band.

    Attributes
    ----------
    normal : (band,) ndarray
        Irradiance of a plane that faces the sun, by the sun alone [W m-2 nm-1].
    direct, diffuse : (band,) ndarray
        Irradiance of a level plane by the sun and by the sky [W m-2 nm-1].
    water : (band,) ndarray
        Radiance out of the water where it is deep [W m-2 sr-1 nm-1].
    objects : (object, band) ndarray
        Radiance out of the water over each object [W m-2 sr-1 nm-1].
    """

    normal: Array
    direct: Array
    diffuse: Array
    water: Array
    objects: Array


def light(setup: Setup) -> Light:
    """Light in each band of a setup.

    Sun and sky after Gregg and Carder (1990), case-1 water, objects by path length; see `deglint.physics`.
    """
    bands = setup.sensor.bands
    angles = setup.sun_zenith, setup.view_zenith, (setup.view_azimuth - setup.sun_azimuth) % 360.0

    def sunlight(wavelength: Array) -> Array:
        return np.stack(atmosphere.irradiance(wavelength, setup.sun_zenith, setup.weather))

    def deep(wavelength: Array) -> Array:
        reflectance = water.remote_sensing_reflectance(wavelength, setup.chlorophyll, *angles)
        return np.asarray(reflectance * sunlight(wavelength).sum(axis=0))

    def over(depth: float, reflectance: float) -> Callable[[Array], Array]:
        def radiance(wavelength: Array) -> Array:
            direct, diffuse = sunlight(wavelength)
            seen = water.object_reflectance(
                wavelength,
                setup.chlorophyll,
                *angles,
                depth=depth,
                reflectance=reflectance,
                direct_fraction=direct / (direct + diffuse),
            )
            return np.asarray(seen * (direct + diffuse))

        return radiance

    kinds = {(o.depth, o.reflectance): _means(over(o.depth, o.reflectance), bands) for o in setup.objects}
    things = [kinds[o.depth, o.reflectance] for o in setup.objects]
    direct, diffuse = _means(sunlight, bands).T
    return Light(
        normal=direct / np.cos(np.radians(setup.sun_zenith)),
        direct=direct,
        diffuse=diffuse,
        water=_means(deep, bands),
        objects=np.asarray(things).reshape(len(things), len(bands)),
    )


def _means(spectrum: Callable[[Array], Array], bands: tuple[SensorBand, ...]) -> Array:
    """Mean over each band at whole nanometres, (band, ...)."""
    ranges = [np.arange(max(b.low, TABLES[0]), min(b.high, TABLES[1]) + 0.5) for b in bands]
    return np.stack([spectrum(w).mean(axis=-1) for w in ranges])
