"""Sun glint in closed form: the facet that reflects the sun into the sensor, its probability, and the glint radiance.

The solar disk is assumed to be small; only single reflections are modelled; waves do not hide each other. The normal
of the facet that glints then bisects the angle between the directions to sun and sensor. The glinting share of a pixel
follows from the probability density of slopes, without a sum over facets. `sun_glint` computes this density from the
wind; `probability` and `radiance` take it as an argument. Angles of sun and sensor are as seen from the target.

References
----------
Cox, Munk (1954), doi:10.1364/JOSA.44.000838; see `deglint.physics.slopes`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import fresnel, slopes, sun
from ._checks import VIEW_LIMIT as VIEW_LIMIT
from ._checks import Array, sun_angle, view_angle, within


class Facet(NamedTuple):
    """Slopes and angles of the facet that reflects the sun into the sensor."""

    east: Array  # slope towards east [1]
    north: Array  # slope towards north [1]
    incidence: Array  # angle between its normal and the sun [degree]
    tilt: Array  # angle between its normal and the zenith [degree]


class Glint(NamedTuple):
    """Sun glint from `sun_glint`; each array has the broadcast shape of the angles and the wind."""

    radiance: Array  # glint radiance per unit of irradiance on a plane facing the sun [1/sr]
    probability: Array  # share of the pixel, as the sensor sees it, that reflects a part of the solar disk [1]
    density: Array  # probability density of slopes at the slopes of the facet that glints [1]
    incidence: Array  # angle between the normal of this facet and the sun [degree]
    tilt: Array  # angle between the normal of this facet and the zenith [degree]


def direction(zenith: ArrayLike, azimuth: ArrayLike) -> tuple[Array, Array, Array]:
    """Unit vector (east, north, up) that points to a zenith angle and an azimuth [degree]."""
    z, a = (np.radians(np.asarray(angle, dtype=np.float64)) for angle in (zenith, azimuth))
    return np.sin(z) * np.sin(a), np.sin(z) * np.cos(a), np.cos(z)


def facet(sun_zenith: ArrayLike, sun_azimuth: ArrayLike, view_zenith: ArrayLike, view_azimuth: ArrayLike) -> Facet:
    """Compute the facet that reflects the sun into the sensor.

    With the unit vectors s to the sun and v to the sensor, the normal of the facet is ``h = (s + v) / |s + v|``. Its
    slopes (east, north) are ``(-h_x / h_z, -h_y / h_z)``, where x points east, y north and z up.

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


def probability(density: ArrayLike, view_zenith: ArrayLike, tilt: ArrayLike, solid_angle: ArrayLike) -> Array:
    """Share of the pixel, as seen by the sensor, that mirrors a light source of a given solid angle into the sensor.

        P = p Omega / (4 cos(view zenith) cos^4(tilt))

    Parameters
    ----------
    density : array_like
        Probability density p of slopes, at the slopes of the facet that glints [1].
    view_zenith, tilt : array_like
        Zenith angle of the sensor, 0 to 89, and tilt of the facet [degree].
    solid_angle : array_like
        Solid angle Omega of the source [sr]: `sun.solid_angle` for the solar disk, `cone` for a disk of any size.

    Returns
    -------
    ndarray
        Share [1]; it may exceed 1 for a large source.

    Examples
    --------
    >>> float(probability(7.348, 20.5, 0.0, 6.8e-5).round(7))
    0.0001334
    """
    cosine_view = np.cos(np.radians(view_angle(view_zenith)))
    cosine_tilt = np.cos(np.radians(np.asarray(tilt, dtype=np.float64)))
    return np.asarray(density) * np.asarray(solid_angle) / (4.0 * cosine_view * cosine_tilt**4)


def radiance(density: ArrayLike, view_zenith: ArrayLike, tilt: ArrayLike, incidence: ArrayLike) -> Array:
    """Glint radiance per unit of irradiance on a plane facing the sun [1/sr].

        L / E_n = r(incidence) p / (4 cos(view zenith) cos^4(tilt))        (Cox and Munk 1954)

    r is the Fresnel reflectance, p is `density`. The glint reflectance is L / E_n times pi / cos(sun zenith).

    Parameters
    ----------
    density, view_zenith, tilt : array_like
        As in `probability`.
    incidence : array_like
        Angle between the normal of the facet and the sun [degree].

    Examples
    --------
    >>> float(radiance(7.348, 20.5, 0.0, 20.5).round(5))
    0.04181
    """
    return fresnel.reflectance(incidence) * probability(density, view_zenith, tilt, 1.0)


def cone(half_angle: ArrayLike) -> Array:
    """Solid angle [sr] of a cone, 2 pi (1 - cos a); `half_angle` a is the angle from axis to edge [degree], 0 to 90.

    Examples
    --------
    >>> float(cone(0.2665).round(8))
    6.797e-05
    """
    angle = within("half_angle", half_angle, 0.0, 90.0, "degrees", "The solar disk has 0.27.")
    return 4.0 * np.pi * np.sin(np.radians(angle) / 2.0) ** 2


def sun_glint(
    sun_zenith: ArrayLike,
    sun_azimuth: ArrayLike,
    view_zenith: ArrayLike,
    view_azimuth: ArrayLike,
    *,
    wind: ArrayLike,
    wind_from: ArrayLike,
    model: str = "cox-munk",
) -> Glint:
    """Compute sun glint from angles and wind. `Glint.probability` is for the solar disk at mean distance.

    Parameters
    ----------
    sun_zenith, sun_azimuth, view_zenith, view_azimuth : array_like
        Zenith angles and azimuths of the sun and of the sensor, from the target [degree]; see `facet`.
    wind : array_like
        Wind speed [m/s], 0.1 to 20, at the reference height in `slopes.MODELS` of `model`; see `slopes.wind_at_height`.
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
