"""The sea surface as facets (cells of a grid), and the sun glint and sky radiance that facets reflect to the sensor.

Waves that the grid resolves tilt each facet; the rest of the slope variance that Cox and Munk measured is unresolved.
A share of the unresolved variance, the sparkle, tilts each facet as a whole and varies in time according to the wave
spectrum; the remainder is a Gaussian distribution of slopes within each facet. Therefore, the mean glint over many
scenes equals the glint of `deglint.physics.glint`. All bands see the same facets, each band at its own time.
"""

import numpy as np
import numpy.typing as npt

from ..physics import fresnel, glint, sky, slopes
from ..physics._checks import Floats
from ..physics.spectra import dispersion
from ..physics.surface import normals, on_rows, realise
from ..physics.waves import SHORTEST_WAVE, Sea, omnidirectional
from .setup import RESOLVED_AT_MOST, Setup

Sparkle = tuple[Floats, npt.NDArray[np.uint16], Floats]  # amplitudes, index, frequencies
LEAST_SLOPE = 0.01  # least standard deviation of the slopes within a facet [1]
TABLE_REACH, TABLE_STEP = 1.5, 0.03  # largest slope, and step of slope, in the table of the reflected sky [1]


class Facets:
    """The facets of one scene, drawn at random. Attributes that are pairs are (upwind, crosswind).

    Notes
    -----
    Sparkle: if a facet has n patches, each of nearly uniform slope, the variance of the facet's relative brightness is
    v = 4 / n. One random slope for each facet, with the share ``sqrt(v / (1 + v))`` of the unresolved variance, has the
    same effect. Linear waves resolved to 1 mm (``python -m benchmarks sparkle``) have little sparkle at pixels of
    25 cm, because every facet contains most of the unresolved slopes.
    """

    def __init__(self, setup: Setup, *, workers: int = 1) -> None:
        waves, sparkle = np.random.SeedSequence(setup.seed).spawn(2)
        self.setup = setup
        self.surface = realise(setup.sea, shape=setup.fine_grid, spacing=setup.facet, seed=waves, workers=workers)
        measured, resolved = np.asarray(setup.slope_variance), np.asarray(self.surface.slope_variance)
        scale = np.minimum(1.0, np.sqrt(RESOLVED_AT_MOST * measured / resolved))
        unresolved = measured - scale**2 * resolved
        about = (1 - sparkle_share(setup.patch, setup.facet)) * unresolved
        about = np.maximum(about, np.minimum(unresolved, LEAST_SLOPE**2))
        self.slope_scale = _pair(scale)  # factors on the slopes of the grid, below 1 where these are too steep
        self.slope_variance = _pair(resolved * scale**2)  # expected variance of the resolved slopes on this grid [1]
        self.sparkle = _pair(unresolved - about)  # slope variance by which unresolved waves tilt facets as a whole
        self.unresolved = _pair(about)  # variance of the slopes within each facet
        facet = glint.facet(setup.sun_zenith, setup.sun_azimuth, setup.view_zenith, setup.view_azimuth)
        self.glinting_slope = _pair(slopes.to_wind_axes(facet.east, facet.north, setup.wind_from))
        # glint radiance per unit of slope density and of irradiance on a plane facing the sun [1/sr]
        self.glint_factor = _glint_factor(setup, facet, self.glinting_slope)
        self._sparkle = _draw_sparkle(setup, self.sparkle, sparkle, workers)
        self._sky = _sky_table(setup, self.unresolved)

    def slopes(self, *, workers: int = 1) -> tuple[Floats, Floats]:
        """Resolved slopes towards east and towards north [1], (row, column) each, at the time of the earliest band."""
        east, north = self.surface.slopes(workers=workers)
        if self.slope_scale == (1.0, 1.0):
            return east, north
        up, cross = slopes.to_wind_axes(east, north, self.setup.wind_from)
        return slopes.from_wind_axes(up * self.slope_scale[0], cross * self.slope_scale[1], self.setup.wind_from)

    def at(self, time: float, *, workers: int = 1) -> tuple[Floats, Floats]:
        """Slope density in facets at `glinting_slope` [1], and reflected sky radiance per diffuse irradiance [1/sr].

        Both are (row, column), at `time` [s] after the earliest band. `glinting_slope` reflects the sun to the sensor.
        """
        from ._kernels import reflect

        packed = self.surface.field(time, slopes=True, workers=workers)
        out = np.empty(packed.shape, np.float32), np.empty(packed.shape, np.float32)
        azimuth = np.radians(self.setup.wind_from)
        wind = (float(np.sin(azimuth)), float(np.cos(azimuth)), *self.slope_scale)
        sparkle, table = (*self._sparkle, time), (self._sky, -TABLE_REACH, TABLE_STEP)
        wanted = (*self.glinting_slope, *self.unresolved)
        on_rows(lambda *rows: reflect(packed, sparkle, out, rows, wind, wanted, table), len(packed), workers)
        return out


def _pair(values: Floats | tuple[Floats, Floats]) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def sparkle_share(patch: float, facet: float) -> float:
    """Share of the unresolved slope variance that tilts a facet as a whole [1].

    `patch` is the size of the patches of nearly uniform slope [m], `facet` the side of a facet [m].

    >>> round(sparkle_share(0.005, 0.0625), 2)
    0.16
    """
    spread = (2 * patch / facet) ** 2
    return float(np.sqrt(spread / (1 + spread)))


def _draw_sparkle(setup: Setup, variance: tuple[float, float], seed: np.random.SeedSequence, workers: int) -> Sparkle:
    """Draw the sparkle at random; return slope amplitudes [1], frequency indices, and angular frequencies [rad/s].

    `variance` is the slope variance of the sparkle (upwind, crosswind). The slope of a facet oscillates in time. The
    amplitudes (row, column, 4) are those of the cosine and of the sine, first for the upwind, then for the crosswind
    slope. The indices (row, column) select each facet's frequency. Both arrays are empty if there is no sparkle.
    """
    if max(variance) <= 0:
        return np.empty((0, 0, 4), np.float32), np.empty((0, 0), np.uint16), np.zeros(1)
    shape, generator = setup.fine_grid, np.random.default_rng(seed)
    amplitudes = normals(generator, (*shape, 4), workers=workers)
    scale = np.sqrt(np.repeat(variance, 2)).astype(np.float32)
    on_rows(lambda a, b: np.multiply(amplitudes[a:b], scale, out=amplitudes[a:b]), shape[0], workers)
    frequencies = sparkle_frequencies(setup.sea, setup.facet)
    return amplitudes, generator.integers(0, len(frequencies), shape, dtype=np.uint16), frequencies


def sparkle_frequencies(sea: Sea, facet: float) -> Floats:
    """Angular frequencies (4096,) [rad/s] for equal shares of slope variance of waves shorter than 2 `facet` [m]."""
    k = np.geomspace(np.pi / facet, 2 * np.pi / min(SHORTEST_WAVE, facet), 4001)
    share = np.cumsum(omnidirectional(k, sea) * k**3)
    return np.interp((np.arange(4096) + 0.5) / 4096, share / share[-1], dispersion(k))


def _glint_factor(setup: Setup, facet: glint.Facet, glinting: tuple[float, float]) -> float:
    """Glint radiance per unit of Gaussian slope density and of irradiance on a plane facing the sun [1/sr].

    `facet` reflects the sun into the sensor, and `glinting` is its slope (upwind, crosswind). The result includes the
    ratio of the density of the slope model to the Gaussian density at this slope; it is 0 if the Gaussian density is 0.
    """
    series = slopes.density(*glinting, slopes.wind_at_height(setup.wind), model=setup.slopes)
    plain = slopes.gaussian(*glinting, *setup.slope_variance)
    factor = glint.radiance(1.0, setup.view_zenith, facet.tilt, facet.incidence)
    return float(factor * series / plain) if plain > 0 else 0.0


def _sky_table(setup: Setup, about: tuple[float, float]) -> Floats:
    """Table (upwind slope, crosswind slope) of the sky radiance that a facet reflects per diffuse irradiance [1/sr].

    The radiance is weighted by the area of the facet that the sensor sees, and smoothed over the slopes within a facet,
    with the variances `about` (upwind, crosswind).
    """
    from scipy.ndimage import gaussian_filter

    axis = np.arange(-TABLE_REACH, TABLE_REACH + TABLE_STEP / 2, TABLE_STEP)
    east, north = slopes.from_wind_axes(axis[:, None], axis[None, :], setup.wind_from)
    level = np.sqrt(1 + east**2 + north**2)
    normal = np.stack([-east, -north, np.ones_like(east)]) / level
    view = np.array(glint.direction(setup.view_zenith, setup.view_azimuth))
    cosine = np.clip(np.tensordot(view, normal, 1), 0.0, 1.0)
    east, north, up = 2 * cosine * normal - view[:, None, None]
    away = np.degrees(np.arccos(np.clip(up, 0.0, 1.0)))  # a ray that is reflected downwards gets the sky at the horizon
    turn = np.degrees(np.arctan2(east, north)) % 360
    seen = sky.radiance(away, turn, setup.sun_zenith, setup.sun_azimuth, model=setup.sky)
    mirrored = fresnel.reflectance(np.degrees(np.arccos(cosine))) * seen * cosine * level / view[2]
    sigma = [float(np.sqrt(v)) / TABLE_STEP for v in about]
    return gaussian_filter(mirrored, sigma, mode="nearest").astype(np.float32)
