"""Sun glint in closed form: the facet that reflects the sun into the sensor, its probability, and its radiance.

For a small solar disk and single reflections, the facet that glints has the normal that bisects the directions to the
sun and to the sensor. Its share of the pixel follows from the probability density of slopes, and no sum over facets is
needed. Angles of sun and sensor are as seen from the target. Except in `sun_glint`, the density of slopes is an
argument.

References
----------
Cox, Munk (1954), doi:10.1364/JOSA.44.000838; see `deglint.physics.slopes`.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from . import fresnel, slopes, sun
from ._checks import VIEW_LIMIT as VIEW_LIMIT
from ._checks import Array, sun_angle, view_angle, within


class Facet(NamedTuple):
    """The facet that reflects the sun into the sensor."""

    east: Array  # slope [1]
    north: Array  # slope [1]
    incidence: Array  # angle between its normal and the sun [degree]
    tilt: Array  # angle between its normal and the zenith [degree]


class Glint(NamedTuple):
    """Sun glint for one geometry and wind."""

    radiance: Array  # per unit of irradiance on a plane facing the sun [1/sr]
    probability: Array  # share of the pixel, as the sensor sees it, that mirrors a part of the disk [1]
    density: Array  # of slopes at the facet that glints [1]
    incidence: Array  # of that facet [degree]
    tilt: Array


def direction(zenith: npt.ArrayLike, azimuth: npt.ArrayLike) -> tuple[Array, Array, Array]:
    """Unit vector (east, north, up) of a zenith angle and an azimuth [degree]."""
    z, a = (np.radians(np.asarray(angle, dtype=np.float64)) for angle in (zenith, azimuth))
    return np.sin(z) * np.sin(a), np.sin(z) * np.cos(a), np.cos(z)


def facet(
    sun_zenith: npt.ArrayLike, sun_azimuth: npt.ArrayLike, view_zenith: npt.ArrayLike, view_azimuth: npt.ArrayLike
) -> Facet:
    """Facet that reflects the sun into the sensor.

    With s and v the unit vectors to the sun and the sensor, h = (s + v) / |s + v| is its normal and
    (-h_x / h_z, -h_y / h_z) are its slopes.

    Parameters
    ----------
    sun_zenith, view_zenith : array_like
        Zenith angle of the sun, 0 to 90, and of the sensor, 0 to 89, from the target [degree].
    sun_azimuth, view_azimuth : array_like
        Azimuth of the sun and of the sensor from the target [degree].

    Examples
    --------
    >>> float(facet(20.5, 270.2, 0.0, 0.0).tilt.round(2))
    10.25
    """
    to_sun = direction(sun_angle(sun_zenith), sun_azimuth)
    to_sensor = direction(view_angle(view_zenith), view_azimuth)
    x, y, z = (a + b for a, b in zip(to_sun, to_sensor, strict=True))
    apart = np.sqrt(sum((a - b) ** 2 for a, b in zip(to_sun, to_sensor, strict=True)))
    level = np.hypot(x, y)
    incidence = np.degrees(np.arctan2(apart, np.hypot(level, z)))
    return Facet(-x / z, -y / z, incidence, np.degrees(np.arctan2(level, z)))


def probability(
    density: npt.ArrayLike, view_zenith: npt.ArrayLike, tilt: npt.ArrayLike, solid_angle: npt.ArrayLike
) -> Array:
    """Share of the pixel, as seen by the sensor, that reflects a source of a given solid angle.

        P = p Omega / (4 cos(view zenith) cos^4(tilt))

    Parameters
    ----------
    density : array_like
        Density of slopes p at the facet that glints [1].
    view_zenith, tilt : array_like
        Of the sensor and of the facet [degree].
    solid_angle : array_like
        Of the source [sr]: `sun.solid_angle`, or `cone` for a tolerance.

    Returns
    -------
    ndarray
        Share [1]; may exceed 1 for a source that is not small.

    Examples
    --------
    >>> float(probability(7.348, 20.5, 0.0, 6.8e-5).round(7))
    0.0001334
    """
    cosine_view = np.cos(np.radians(view_angle(view_zenith)))
    cosine_tilt = np.cos(np.radians(np.asarray(tilt, dtype=np.float64)))
    return np.asarray(density) * np.asarray(solid_angle) / (4.0 * cosine_view * cosine_tilt**4)


def radiance(
    density: npt.ArrayLike, view_zenith: npt.ArrayLike, tilt: npt.ArrayLike, incidence: npt.ArrayLike
) -> Array:
    """Glint radiance per unit of irradiance on a plane facing the sun [1/sr].

        L / E_n = r(incidence) p / (4 cos(view zenith) cos^4(tilt))        (Cox and Munk 1954)

    Times pi / cos(sun zenith) it is the glint reflectance.

    Parameters
    ----------
    density, view_zenith, tilt : array_like
        See `probability`.
    incidence : array_like
        Angle between facet and sun [degree].

    Examples
    --------
    >>> float(radiance(7.348, 20.5, 0.0, 20.5).round(5))
    0.04181
    """
    return fresnel.reflectance(incidence) * probability(density, view_zenith, tilt, 1.0)


def cone(half_angle: npt.ArrayLike) -> Array:
    """Solid angle of a cone, 2 pi (1 - cos a) [sr].

    Parameters
    ----------
    half_angle : array_like
        Tolerance around the sun's centre [degree], 0 to 90.

    Examples
    --------
    >>> float(cone(0.2665).round(8))
    6.797e-05
    """
    angle = within("half_angle", half_angle, 0.0, 90.0, "degrees", "The solar disk has 0.27.")
    return 4.0 * np.pi * np.sin(np.radians(angle) / 2.0) ** 2


def sun_glint(
    sun_zenith: npt.ArrayLike,
    sun_azimuth: npt.ArrayLike,
    view_zenith: npt.ArrayLike,
    view_azimuth: npt.ArrayLike,
    *,
    wind: npt.ArrayLike,
    wind_from: npt.ArrayLike,
    model: str = "cox-munk",
) -> Glint:
    """Sun glint from angles and wind, for the mean solar disk; for another source call `probability`.

    Parameters
    ----------
    sun_zenith, sun_azimuth, view_zenith, view_azimuth : array_like
        Of the sun and of the sensor, from the target [degree]; see `facet`.
    wind : array_like
        Speed at the reference height of the model [m/s]; see `slopes.wind_at_height`.
    wind_from : array_like
        Azimuth that the wind blows from [degree].
    model : str
        One of `slopes.MODELS`.

    Examples
    --------
    >>> float(sun_glint(20.5, 270.2, 0.0, 0.0, wind=9.0, wind_from=0.0).radiance.round(5))
    0.01571
    """
    east, north, incidence, tilt = facet(sun_zenith, sun_azimuth, view_zenith, view_azimuth)
    density = slopes.density(*slopes.to_wind_axes(east, north, wind_from), wind, model=model)
    share = probability(density, view_zenith, tilt, sun.MEAN_SOLID_ANGLE)
    return Glint(radiance(density, view_zenith, tilt, incidence), share, density, incidence, tilt)
