"""How much light there is in each band: of the sun, of the sky, and out of the water."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..physics import atmosphere, water
from ..physics.sensor import SensorBand
from .bottom import LEAST_DEPTH, MOST_DEPTH
from .materials import reflectance
from .setup import Setup

Array = npt.NDArray[np.floating[Any]]

TABLES = (300.0, 1000.0)
"""Wavelengths that the tables cover [nm]; a band that reaches beyond is averaged over what is inside."""
DEPTHS = 128
"""Depths at which the light over a bottom is worked out; neighbours differ by 5 %."""


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
    depths : (depth,) ndarray
        Depths of the columns of `bottom` [m]; empty without one.
    bottom : (material, depth, band) ndarray
        Radiance out of the water over the two materials of the bottom [W m-2 sr-1 nm-1].
    """

    normal: Array
    direct: Array
    diffuse: Array
    water: Array
    objects: Array
    depths: Array
    bottom: Array


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

    def over(depth: Array | float, reflects: float | str) -> Callable[[Array], Array]:
        def radiance(wavelength: Array) -> Array:
            direct, diffuse = sunlight(wavelength)
            seen = water.object_reflectance(
                wavelength,
                setup.chlorophyll,
                *angles,
                depth=depth,
                reflectance=reflectance(reflects, wavelength) if isinstance(reflects, str) else reflects,
                direct_fraction=direct / (direct + diffuse),
            )
            return np.asarray(seen * (direct + diffuse))

        return radiance

    kinds = {(o.depth, o.reflectance): _means(over(o.depth, o.reflectance), bands) for o in setup.objects}
    things = [kinds[o.depth, o.reflectance] for o in setup.objects]
    direct, diffuse = _means(sunlight, bands).T
    depths, bottom = np.zeros(0), np.zeros((0, 0, len(bands)))
    if setup.bottom is not None:
        depths = np.geomspace(LEAST_DEPTH, MOST_DEPTH, DEPTHS)
        grounds = [_means(over(depths[:, None], name), bands) for name in setup.bottom.materials]
        bottom = np.moveaxis(np.asarray(grounds), 1, 2)
    return Light(
        normal=direct / np.cos(np.radians(setup.sun_zenith)),
        direct=direct,
        diffuse=diffuse,
        water=_means(deep, bands),
        objects=np.asarray(things).reshape(len(things), len(bands)),
        depths=depths,
        bottom=bottom,
    )


def matt(lit: Light, setup: Setup, materials: Sequence[str]) -> Array:
    """Radiance of matt (Lambertian) level surfaces in the light of a setup, (material, band) [W m-2 sr-1 nm-1].

    Parameters
    ----------
    lit : Light
        Of the setup.
    setup : Setup
    materials : sequence of str
        The empty name stands for water: 0.
    """
    bands = setup.sensor.bands
    none = np.zeros(len(bands))
    rows = [_means(partial(reflectance, name), bands) if name else none for name in materials]
    return np.asarray(rows) * (lit.direct + lit.diffuse) / np.pi


def _means(spectrum: Callable[[Array], Array], bands: tuple[SensorBand, ...]) -> Array:
    """Mean over each band at whole nanometres, (band, ...)."""
    ranges = [np.arange(max(b.low, TABLES[0]), min(b.high, TABLES[1]) + 0.5) for b in bands]
    return np.stack([spectrum(w).mean(axis=-1) for w in ranges])
