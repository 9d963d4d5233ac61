"""Skylight reflected by the wind-roughened sea: its mean, and the share of facets brighter than a limit.

A facet is a small plane part of the surface. Both quantities are sums over facets (Fink 2014, eq. 2.26 and 2.27),
weighted by the share of the sea that each facet covers as seen by the sensor. Both vary slowly, so they are computed at
`ZENITHS` x `AZIMUTHS` viewing geometries and interpolated to all others. Facets that reflect the sea do not contribute.
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..physics import fresnel, sky, slopes
from ..physics._checks import Floats

Vector = tuple[npt.NDArray[Any], npt.NDArray[Any], float]  # upwind, crosswind, up
ZENITHS, AZIMUTHS = 21, 72  # number of zenith angles and azimuths at which the facets are summed
FACETS, FACET_REACH = 40, 4.5  # number of facets along each wind axis, and largest slope [standard deviations]
LEVELS = np.geomspace(2e-3, 2.0, 120)
"""Values of reflected radiance per diffuse irradiance [1/sr] for which the share of brighter facets is tabulated."""


class Wind(NamedTuple):
    """Wind for a slope model: speed at its reference height [m/s], azimuth from which it blows [degree], model name."""

    speed: float
    blows_from: float
    model: str

    @property
    def options(self) -> dict[str, Any]:
        """The wind as keyword arguments of `deglint.physics.glint.sun_glint`."""
        return {"wind": self.speed, "wind_from": self.blows_from, "model": self.model}


class Skylight:
    """Reflected skylight on a grid of zenith angles and azimuths of the sensor, for one position of the sun [degree].

    `sun` is (zenith angle, azimuth), `model` the sky model. `mean` differs by up to 1 % from `sky.reflectance`, which
    does not interpolate. One azimuth of the sums is opposite the sun, where the bright reflection of the sky is narrow.
    """

    def __init__(self, zenith: Floats, azimuth: Floats, sun: tuple[float, float], wind: Wind, *, model: str) -> None:
        nodes = np.linspace(0.0, max(float(zenith[-1]), 20.0), ZENITHS)
        step, opposite = 360.0 / AZIMUTHS, sun[1] + 180.0
        around = opposite + step * np.arange(AZIMUTHS)
        mean, brighter = _facet_sums(nodes, around - wind.blows_from, (sun[0], sun[1] - wind.blows_from), wind, model)
        down, across = (zenith - nodes[0]) / (nodes[1] - nodes[0]), (azimuth - opposite) % 360.0 / step
        # radiance per unit of diffuse irradiance, mean over the sea, (zenith, azimuth) [1/sr]
        self.mean = _interpolated(_interpolated(mean, down, 0, nodes=4), across, 1, nodes=4, periodic=True)
        # share of the sea whose facets reflect more than each of `LEVELS`, (level, zenith, azimuth) [1]; linear, since
        # cubic interpolation (4 nodes) could make the share rise with the level
        self.brighter = _interpolated(_interpolated(brighter, down, 1, nodes=2), across, 2, nodes=2, periodic=True)

    def share_above(self, level: Floats) -> Floats:
        """Share of the sea [1] whose facets reflect more than `level`; both are (band, zenith, azimuth).

        `level` is radiance per diffuse irradiance [1/sr]; it is limited to the range of `LEVELS`.
        """
        step = np.log(LEVELS[1] / LEVELS[0])
        with np.errstate(divide="ignore"):
            place = np.log(level / LEVELS[0]) / step
        place = np.clip(place, 0.0, LEVELS.size - 1.000001)
        low = place.astype(np.intp)
        below, above = (np.take_along_axis(self.brighter, low + k, axis=0) for k in (0, 1))
        return np.asarray(below + (above - below) * (place - low))


def _interpolated(values: Floats, place: Floats, axis: int, *, nodes: int, periodic: bool = False) -> Floats:
    """Interpolate values, given at equal steps along an axis, to the positions `place` [step] on this axis.

    Each result follows from the nearest `nodes`, 2 (linear) or 4 (cubic), by Lagrange's formula. If `periodic`, the
    first value follows the last. BLAS is not called, because its threads block each other on a busy machine.
    """
    count, reach = values.shape[axis], nodes // 2 - 1
    first = np.floor(place).astype(int)
    first = (first if periodic else np.clip(first, reach, count - 2 - reach)) - reach
    shape = [-1 if k == axis else 1 for k in range(values.ndim)]
    x = place - first  # the nodes that are used are at 0 to `nodes` - 1
    weights = [np.prod([(x - j) / (i - j) for j in range(nodes) if j != i], axis=0) for i in range(nodes)]
    return sum(
        np.take(values, (first + i) % count, axis=axis) * weight.astype(np.float32).reshape(shape)
        for i, weight in enumerate(weights)
    )


def _facet_sums(
    zeniths: Floats, azimuths: Floats, sun: tuple[float, float], wind: Wind, model: str
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Mean reflected skylight per diffuse irradiance [1/sr]; share of the sea that reflects more than each of `LEVELS`.

    The mean is (zenith, azimuth), the share (level, zenith, azimuth). `zeniths` and `azimuths` are zenith angles and
    azimuths of the sensor, `sun` is (zenith angle, azimuth) [degree]. All azimuths are relative to that of the wind.
    """
    variances = [float(v) for v in slopes.variances(wind.speed, model=wind.model)]
    facets = _Facets(wind, variances)
    to_sun = _unit(*sun)
    mean = np.empty((zeniths.size, azimuths.size), np.float32)
    count = np.empty((zeniths.size, azimuths.size, LEVELS.size))
    for i, zenith in enumerate(zeniths):
        weight, mirrored = facets.reflected_sky(float(zenith), azimuths, to_sun, sun[0], model)
        mean[i] = (weight * mirrored).sum(axis=1)
        count[i] = _histogram(weight, mirrored)
    cosine2 = np.cos(np.radians(azimuths)) ** 2
    # 1 + Lambda: (hidden and visible area of the sea) / (visible area), see `slopes.hidden`
    shadowing = 1.0 + slopes.hidden(zeniths[:, None], variances[0] * cosine2 + variances[1] * (1.0 - cosine2))
    brighter = np.cumsum(count[..., ::-1], axis=-1)[..., ::-1] / shadowing[..., None]
    # of the facets counted at a level, half are above it
    brighter[..., 1:] -= 0.5 * count[..., 1:] / shadowing[..., None]
    return (mean / shadowing).astype(np.float32), np.moveaxis(brighter, -1, 0).astype(np.float32)


def _unit(zenith: float, turn: npt.ArrayLike) -> Vector:
    """Unit vector (upwind, crosswind, up) towards a zenith angle and an azimuth relative to the wind [degree]."""
    z, a = np.radians(zenith), np.radians(turn)
    level = np.sin(z)
    return np.asarray(level * np.cos(a), np.float32), np.asarray(level * np.sin(a), np.float32), float(np.cos(z))


class _Facets:
    """Facets of the sea: slopes [1], share of the horizontal area [1], vertical component of the unit normal [1]."""

    def __init__(self, wind: Wind, variances: list[float]) -> None:
        axis = (np.arange(FACETS) + 0.5) * (2.0 * FACET_REACH / FACETS) - FACET_REACH
        along, across = (axis * np.sqrt(v) for v in variances)
        upwind, crosswind = (a.ravel() for a in np.meshgrid(along, across, indexing="ij"))
        area = (along[1] - along[0]) * (across[1] - across[0])
        density = slopes.density(upwind, crosswind, wind.speed, model=wind.model) * area
        up = 1.0 / np.sqrt(1.0 + upwind**2 + crosswind**2)
        self.upwind, self.crosswind, self.share, self.up = (
            np.asarray(a, np.float32) for a in (upwind, crosswind, density, up)
        )
        self.step = float(np.sqrt(area))  # mean distance of the slopes of neighbouring facets [1]

    def reflected_sky(
        self, zenith: float, azimuths: Floats, to_sun: Vector, sun_zenith: float, model: str
    ) -> tuple[Floats, Floats]:
        """Share of the sea that each facet covers as the sensor sees it [1], and sky radiance that it reflects [1/sr].

        Both are (azimuth, facet), for one zenith angle and several azimuths of the sensor relative to the wind
        [degree]. Radiance is per diffuse irradiance. `to_sun` is the unit vector (upwind, crosswind, up) to the sun.
        """
        x, y, cosine = _unit(zenith, azimuths[:, None])
        slant = cosine - x * self.upwind - y * self.crosswind  # cos(incidence) / cos(tilt)
        incidence = np.clip(slant * self.up, 1e-6, 1.0)
        twice = 2.0 * incidence * self.up
        up = twice - np.float32(cosine)
        sun_cosine = up * to_sun[2]
        sun_cosine += (-twice * self.upwind - x) * to_sun[0]
        sun_cosine += (-twice * self.crosswind - y) * to_sun[1]
        light = sky.radiance_of_cosines(np.clip(up, 0.0, 1.0), sun_cosine, sun_zenith, model=model)
        light *= fresnel.reflectance_of_cosine(incidence)
        # a facet stands for a range of slopes, of which a part may reflect the sky: its weight fades at the horizon
        edge = np.float32(max(2.0 * self.step * np.sin(np.radians(zenith)), 1e-3))
        weight = np.maximum(slant, 0.0) * np.clip(up / edge + 0.5, 0.0, 1.0)
        weight *= self.share / np.float32(cosine)
        return weight, light


def _histogram(weight: Floats, light: Floats) -> npt.NDArray[Any]:
    """Histogram (geometry, level) of `light` (geometry, facet); `weight` is split between the two nearest `LEVELS`."""
    place = np.log(light) - np.float32(np.log(LEVELS[0]))
    place *= np.float32(1.0 / np.log(LEVELS[1] / LEVELS[0]))
    np.clip(place, 0.0, LEVELS.size - 1.001, out=place)
    low = place.astype(np.int32)
    upper = weight * (place - low)
    low += np.arange(len(light), dtype=np.int32)[:, None] * LEVELS.size
    size = len(light) * LEVELS.size
    count = np.bincount(low.ravel(), (weight - upper).ravel(), size)
    count[1:] += np.bincount(low.ravel(), upper.ravel(), size)[:-1]
    return count.reshape(len(light), LEVELS.size)
