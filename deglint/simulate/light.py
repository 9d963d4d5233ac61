"""Light in each band: irradiance by sun and sky, and water-leaving radiance."""

from collections.abc import Sequence

import numpy as np

from ..physics import atmosphere, water
from ..physics._checks import Floats
from ..physics.iops import Iops, case1
from ..physics.sensor import band_means
from .materials import reflectance
from .setup import Setup
from .underwater import LEAST_DEPTH, MOST_DEPTH

DEPTH_STEPS = 128  # number of depths at which the light over a bottom is computed; neighbouring values differ by 5 %


class Light:
    """Mean light in each band of a setup: irradiances (band,) [W m-2 nm-1] and radiances [W m-2 sr-1 nm-1].

    Sun and sky: Gregg and Carder (1990). Water: case 1. Deep water and objects: models of `deglint.physics.water`.
    """

    def __init__(self, setup: Setup) -> None:
        self._wavelength, self._mean = wavelength, mean = band_means(setup.sensor.bands)
        direct, diffuse = atmosphere.irradiance(wavelength, setup.sun_zenith, setup.weather)
        total, share = direct + diffuse, direct / (direct + diffuse)
        angles, sea = (setup.sun_zenith, setup.view_zenith), case1(wavelength, setup.chlorophyll)
        deep = water.deep_reflectance(sea, *angles, (setup.view_azimuth - setup.sun_azimuth) % 360.0)

        def over(depth: Floats | float, albedo: Floats | float) -> Floats:
            """Water-leaving radiance over a flat Lambertian ground of a reflectance [1] at a depth [m], (band, ...)."""
            column = [np.reshape(a, (-1, *[1] * np.ndim(depth))) for a in (deep, total, share, *sea)]
            seen = water.submerged_reflectance(
                Iops(*column[3:]), column[0], *angles, depth=depth, reflectance=albedo, direct_fraction=column[2]
            )
            return mean(seen * column[1])

        self.direct, self.diffuse = mean(direct), mean(diffuse)  # irradiance of a level plane: by the sun, by the sky
        self.normal = self.direct / np.cos(np.radians(setup.sun_zenith))  # irradiance by the sun of a plane facing it
        self.water = mean(deep * total)  # water-leaving radiance of deep water, (band,)
        objects = [over(o.depth, o.reflectance) for o in setup.objects]
        # water-leaving radiance over each object, (object, band)
        self.objects = np.asarray(objects).reshape(len(objects), len(self.water))
        # depths [m], and water-leaving radiance over materials of the bottom (material, depth, band); empty without it
        self.depths, self.bottom = np.zeros(0), np.zeros(0)
        if setup.bottom is not None:
            self.depths = np.geomspace(LEAST_DEPTH, MOST_DEPTH, DEPTH_STEPS)
            grounds = [reflectance(name, wavelength)[:, None] for name in setup.bottom.materials]
            self.bottom = np.asarray([over(self.depths, ground).T for ground in grounds])

    def matt(self, materials: Sequence[str]) -> Floats:
        """Radiance of level Lambertian surfaces, (material, band) [W m-2 sr-1 nm-1]; 0 for the name "" (water)."""
        none = np.zeros(len(self.water))
        rows = [self._mean(reflectance(name, self._wavelength)) if name else none for name in materials]
        return np.asarray(rows) * (self.direct + self.diffuse) / np.pi
