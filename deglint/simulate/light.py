"""Light in each band: irradiance of sun and sky, and water-leaving radiance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..physics import atmosphere, water
from ..physics._checks import Floats
from ..physics.iops import Iops, case1
from ..physics.sensor import band_means
from .bottom import LEAST_DEPTH, MOST_DEPTH
from .materials import reflectance
from .setup import Setup

DEPTH_STEPS = 128
"""Number of depths at which the light over a bottom is computed; neighbouring values differ by 5 %."""


@dataclass(frozen=True, eq=False)
class Light:
    """Mean light in each band: irradiances [W m-2 nm-1] and radiances [W m-2 sr-1 nm-1]."""

    normal: Floats  # irradiance of a plane that faces the sun, by the sun alone, (band,)
    direct: Floats  # irradiance of a level plane by the sun, (band,)
    diffuse: Floats  # irradiance of a level plane by the sky, (band,)
    water: Floats  # radiance out of the water where it is deep, (band,)
    objects: Floats  # radiance out of the water over each object, (object, band)
    depths: Floats  # of the columns of `bottom` [m], (depth,); empty without one
    bottom: Floats  # radiance out of the water over the two materials of the bottom, (material, depth, band)


def light(setup: Setup) -> Light:
    """Light in each band of a setup.

    Sun and sky follow Gregg and Carder (1990); water is case 1; for objects see `deglint.physics.water`.
    """
    wavelength, mean = band_means(setup.sensor.bands)
    direct, diffuse = atmosphere.irradiance(wavelength, setup.sun_zenith, setup.weather)
    total, share = direct + diffuse, direct / (direct + diffuse)
    angles, sea = (setup.sun_zenith, setup.view_zenith), case1(wavelength, setup.chlorophyll)
    deep = water.deep_reflectance(sea, *angles, (setup.view_azimuth - setup.sun_azimuth) % 360.0)

    def over(depth: Floats | float, albedo: Floats | float) -> Floats:
        """Radiance over a flat Lambertian ground at a depth, (band, ...)."""
        column = [np.reshape(a, (-1, *[1] * np.ndim(depth))) for a in (deep, total, share, *sea)]
        seen = water.submerged_reflectance(
            Iops(*column[3:]), column[0], *angles, depth=depth, reflectance=albedo, direct_fraction=column[2]
        )
        return mean(seen * column[1])

    kinds = {(o.depth, o.reflectance): over(o.depth, o.reflectance) for o in setup.objects}
    objects = [kinds[o.depth, o.reflectance] for o in setup.objects]
    depths, bottom = np.zeros(0), []
    if setup.bottom is not None:
        depths = np.geomspace(LEAST_DEPTH, MOST_DEPTH, DEPTH_STEPS)
        bottom = [over(depths, reflectance(name, wavelength)[:, None]).T for name in setup.bottom.materials]
    sun = mean(direct)
    return Light(
        normal=sun / np.cos(np.radians(setup.sun_zenith)),
        direct=sun,
        diffuse=mean(diffuse),
        water=mean(deep * total),
        objects=np.asarray(objects).reshape(len(objects), len(sun)),
        depths=depths,
        bottom=np.asarray(bottom),
    )


def matt(lit: Light, setup: Setup, materials: Sequence[str]) -> Floats:
    """Radiance of horizontal Lambertian surfaces in the light of a setup, (material, band) [W m-2 sr-1 nm-1].

    For an empty name (water) it is 0.
    """
    wavelength, mean = band_means(setup.sensor.bands)
    rows = [mean(reflectance(name, wavelength)) if name else np.zeros(len(lit.water)) for name in materials]
    return np.asarray(rows) * (lit.direct + lit.diffuse) / np.pi
