"""Sky radiance as a function of direction, and its reflection by the wind-roughened sea.

There are three models: a uniform sky, a cardioidal sky (brightest at the zenith, as under a heavy overcast), and the
clear sky of Harrison and Coombes (brightest around the sun and near the horizon). Each sky is normalised so that a
horizontal plane receives exactly the given diffuse irradiance. The solar disk is not part of the sky.

References
----------
Moon, Spencer (1942), "Illumination from a non-uniform sky", Illuminating Engineering 37, 707-726.
Harrison, Coombes (1988), "An opaque cloud cover model of sky short wavelength radiance", Solar Energy 41,
387-392, doi:10.1016/0038-092X(88)90035-7.
"""

from functools import cache

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from ..checks import check_choice
from . import fresnel, slopes
from ._checks import Array, sun_angle, view_angle, within

SKY_MODELS = ("uniform", "cardioidal", "harrison-coombes")  # names of the sky models
NODES = 100  # number of nodes on each slope axis in the integral of `reflectance`; its relative error is below 5e-4
_gauss_legendre = cache(np.polynomial.legendre.leggauss)  # nodes and weights of the quadrature by number of nodes


def radiance(
    zenith: npt.ArrayLike,
    azimuth: npt.ArrayLike,
    sun_zenith: npt.ArrayLike = 0.0,
    sun_azimuth: npt.ArrayLike = 0.0,
    *,
    model: str = "uniform",
) -> Array:
    """Radiance of the sky in a direction, per unit of diffuse irradiance of a horizontal plane [1/sr].

    Uniform: 1 / pi. Cardioidal: (1 + 2 cos(theta)) / (pi (1 + 4 / 3)), with the zenith angle theta of the direction.
    Harrison and Coombes (1988), at an angle psi [radian] from the sun with the zenith angle theta_s: proportional to

        (1.63 + 53.7 exp(-5.49 psi) + 2.04 cos^2(psi) cos(theta_s)) (1 - exp(-0.19 / cos(theta))).

    Parameters
    ----------
    zenith, azimuth : array_like
        Direction, zenith angle 0 to 90 and azimuth [degree].
    sun_zenith, sun_azimuth : array_like
        Direction of the sun, zenith angle 0 to 90 and azimuth [degree]; only Harrison and Coombes use it.
    model : str
        One of `SKY_MODELS`.

    Examples
    --------
    >>> float(radiance(0, 0, 30, 180, model="harrison-coombes").round(4))
    0.2694
    """
    check_choice(model, list(SKY_MODELS), "model")
    zenith = within("zenith", zenith, 0.0, 90.0, "degrees", "Directions below the horizon see no sky.")
    turn = np.radians(np.asarray(azimuth, dtype=np.float64) - np.asarray(sun_azimuth, dtype=np.float64))
    cosine, turn = np.broadcast_arrays(np.cos(np.radians(zenith)), turn)
    sun_zenith = sun_angle(sun_zenith)
    towards = _from_sun(cosine, np.cos(np.radians(sun_zenith)), turn)
    return radiance_of_cosines(cosine, towards, sun_zenith, model=model)


def radiance_of_cosines(cosine: Array, towards: Array, sun_zenith: npt.ArrayLike, *, model: str) -> Array:
    """Radiance of the sky as in `radiance`; arguments are not checked, and the result has the precision of `cosine`.

    `cosine` is the cosine of the direction's zenith angle, and `towards` the cosine of its angle to the sun.
    `sun_zenith` [degree] and `model` are as in `radiance`.
    """
    if model == "uniform":
        return 1.0 / np.pi + 0.0 * cosine
    if model == "cardioidal":
        return (1.0 + 2.0 * cosine) / (np.pi * (1.0 + 4.0 / 3.0))
    total = chebyshev.chebval(np.asarray(sun_zenith) / 45.0 - 1.0, _clear_fit())
    sun_cosine, total = (np.asarray(a, cosine.dtype) for a in (np.cos(np.radians(sun_zenith)), total))
    return _glow(cosine, towards, sun_cosine) / total


def reflectance(
    view_zenith: npt.ArrayLike,
    view_azimuth: npt.ArrayLike,
    sun_zenith: npt.ArrayLike = 0.0,
    sun_azimuth: npt.ArrayLike = 0.0,
    *,
    wind: npt.ArrayLike,
    wind_from: npt.ArrayLike,
    model: str = "uniform",
) -> Array:
    """Sky radiance reflected by the sea into the sensor, per unit of diffuse irradiance [1/sr].

    The result is the integral of w r L_sky over the slopes of facets, by Gauss-Legendre quadrature, with the Fresnel
    reflectance r and the sky radiance L_sky per diffuse irradiance. The weight w of a facet is its share of the sea as
    the sensor sees it, p cos(incidence) / [cos(tilt) cos(view zenith) (1 + Lambda)], with the probability density p of
    slopes and Smith's Lambda (`slopes.hidden`). Facets that face away from the sensor, or reflect the sea instead of
    the sky, add nothing. For a uniform sky the effective reflectance of the sea is pi times the result.

    Parameters
    ----------
    view_zenith, view_azimuth : array_like
        Zenith angle, 0 to 89, and azimuth of the sensor from the target [degree].
    sun_zenith, sun_azimuth, model
        Direction of the sun and model of the sky; see `radiance`.
    wind, wind_from : array_like
        Wind speed at 12.5 m [m/s], 0.1 to 20, and azimuth that it blows from [degree], for the slopes of Cox and Munk.

    Examples
    --------
    >>> float((np.pi * reflectance(40, 90, wind=9.0, wind_from=0.0)).round(4))
    0.0272
    """
    geometry = view_angle(view_zenith), view_azimuth, sun_zenith, sun_azimuth
    return np.asarray(np.vectorize(_reflected, otypes=[np.float64])(*geometry, wind, wind_from, model))


def _reflected(
    zenith: float, azimuth: float, sun_zenith: float, sun_azimuth: float, wind: float, wind_from: float, model: str
) -> float:
    """Reflected sky radiance per diffuse irradiance [1/sr], as `reflectance`, for one viewing geometry."""
    variance_u, variance_c = slopes.variances(wind)
    cosine2 = np.cos(np.radians(azimuth - wind_from)) ** 2
    variance_along = variance_u * cosine2 + variance_c * (1.0 - cosine2)
    variance_across = variance_c * cosine2 + variance_u * (1.0 - cosine2)
    along, across, weight = _nodes(zenith, variance_along, variance_across)
    slant, incidence, up, turn = _mirror(zenith, along, across)
    mirrored = radiance(up, azimuth + turn, sun_zenith, sun_azimuth, model=model)
    density = slopes.density(*slopes.to_wind_axes(across, along, wind_from - azimuth), wind)
    share = density * slant / np.cos(np.radians(zenith)) * fresnel.reflectance(incidence)
    return float(np.sum(weight * share * mirrored) / (1.0 + slopes.hidden(zenith, variance_along)))


def _nodes(zenith: float, variance_along: Array, variance_across: Array) -> tuple[Array, Array, Array]:
    """Return nodes (slopes along and across the sensor's azimuth) and weights of an integral over these slopes [1].

    The shapes are (`NODES`, `NODES`), (`NODES`, 1) and (`NODES`, `NODES`). The range is 5 standard deviations, limited
    to slopes that reflect the sky: there, the integrand is smooth. `zenith` is the sensor's zenith angle [degree].
    """
    x, w = _gauss_legendre(NODES)
    reach, reach_across = 5.0 * np.sqrt(variance_along), 5.0 * np.sqrt(variance_across)
    tangent, across = np.tan(np.radians(zenith)), x[:, None] * reach_across
    edge = np.sqrt(np.maximum(tangent**2 + 1.0 - across**2, 0.0))
    low, high = np.maximum(-reach, -tangent - edge), np.minimum(reach, edge - tangent)
    half = np.maximum(0.5 * (high - low), 0.0)
    return 0.5 * (high + low) + half * x, across, half * w * w[:, None] * reach_across


def _mirror(zenith: float, along: Array, across: Array) -> tuple[Array, Array, Array, Array]:
    """Reflect the line of sight at facets, given by slopes towards the sensor's azimuth and 90 degrees clockwise of it.

    Returns cos(incidence) / cos(tilt) [1], the angle of incidence [degree], the zenith angle of the reflected ray
    [degree], and its azimuth minus that of the sensor [degree]. `zenith` is the zenith angle of the sensor [degree].
    """
    slant = np.cos(np.radians(zenith)) - along * np.sin(np.radians(zenith))
    length = 1.0 + along**2 + across**2
    up = _arccos(2.0 * slant / length - np.cos(np.radians(zenith)))
    forth = -2.0 * slant / length * along - np.sin(np.radians(zenith))
    turn = np.degrees(np.arctan2(-2.0 * slant / length * across, forth))
    return slant, _arccos(slant / np.sqrt(length)), up, turn


def _arccos(cosine: Array) -> Array:
    return np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0)))


def _from_sun(cosine: Array, sun_cosine: Array, turn: Array) -> Array:
    """Cosine of the angle between direction and sun, from zenith angle cosines and the azimuth difference [radian]."""
    return cosine * sun_cosine + np.sqrt((1.0 - cosine**2) * (1.0 - sun_cosine**2)) * np.cos(turn)


def _glow(cosine: Array, towards: Array, sun_cosine: Array) -> Array:
    """Sky radiance of Harrison and Coombes before normalisation, without a factor that normalisation cancels.

    Arguments are cosines: of the zenith angle of a direction, of its angle to the sun, and of the sun zenith angle.
    """
    towards = np.clip(towards, -1.0, 1.0)
    glow = 1.63 + 53.7 * np.exp(-5.49 * np.arccos(towards)) + 2.04 * towards**2 * sun_cosine
    return glow * (1.0 - np.exp(-0.19 / np.maximum(cosine, 1e-9)))


@cache
def _clear_fit() -> Array:
    """Chebyshev coefficients (15,) of the integral over the sky of `_glow` times cos(zenith angle).

    The variable of the polynomial is (sun zenith angle [degree]) / 45 - 1. The integral is computed by Gauss-Legendre
    quadrature over the cosine of the zenith angle, and by the trapezoidal rule over azimuth.
    """
    x = chebyshev.chebpts1(15)
    nodes, weights = _gauss_legendre(64)
    cosine, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    turn = np.linspace(0.0, np.pi, 97)
    around = np.full(97, 2.0 * np.pi / 96.0)
    around[[0, -1]] *= 0.5
    sun_cosine = np.cos(np.radians(45.0 * (x + 1.0)))[:, None, None]
    light = _glow(cosine[:, None], _from_sun(cosine[:, None], sun_cosine, turn), sun_cosine)
    total = np.einsum("...ij,i,j", light, weights * cosine, around)
    return np.asarray(chebyshev.chebfit(x, total, 14), dtype=np.float64)
