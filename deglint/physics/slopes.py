"""Probability distributions of the slopes of the wind-roughened sea surface.

The module gives the probability density of facet slopes, per unit of upwind and crosswind slope, as a function of wind.
Models are those of Cox and Munk (Gram-Charlier series, anisotropic or isotropic Gaussian), and of Breon and Henriot. A
truncated Gram-Charlier series is negative at large slopes in strong wind; by default, the density is set to 0 there.

Axes: a positive upwind slope rises towards where the wind comes from; the crosswind axis points 90 degrees clockwise of
upwind. The windward side of a wave is less steep, so the most frequent upwind slope is slightly negative.

References
----------
Cox, Munk (1954), "Measurement of the roughness of the sea surface from photographs of the sun's
glitter", Journal of the Optical Society of America 44, 838-850, doi:10.1364/JOSA.44.000838. Breon, Henriot
(2006), "Spaceborne observations of ocean glint reflectance and modeling of wave slope distributions", Journal
of Geophysical Research 111, C06005, doi:10.1029/2005JC003343.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from ..checks import check_choice
from ._checks import Array, within

WIND_RANGE = (0.1, 20.0)  # range of wind speeds of the models [m/s]; Cox and Munk measured at 1 to 14
_DRAG = 1.3e-3  # drag coefficient at 10 m [1], for the logarithmic profile of the wind
_KARMAN = 0.4  # von Karman constant [1]
_ERFC = np.vectorize(math.erfc, otypes=[float])  # scipy.special takes long to import


@dataclass(frozen=True)
class SlopeModel:
    """A model of the slopes of the sea surface: variances and Gram-Charlier coefficients as functions of wind."""

    height: float  # reference height of the wind above the sea [m]
    upwind: tuple[float, float]  # variance of upwind slope: constant [1], and increase with wind [s/m]
    crosswind: tuple[float, float]  # variance of crosswind slope, in the same way
    skewness: Callable[[Array], tuple[Array, Array]] | None = None  # gives c21, c03 for a wind [m/s]; None: Gaussian
    peakedness: tuple[float, float, float] = (0.0, 0.0, 0.0)  # coefficients c40 (crosswind), c22, c04 (upwind)


def _skewness_cox_munk(wind: Array) -> tuple[Array, Array]:
    return 0.01 - 0.0086 * wind, 0.04 - 0.033 * wind


def _skewness_breon_henriot(wind: Array) -> tuple[Array, Array]:
    return -9e-4 * wind**2, -0.45 / (1.0 + np.exp(7.0 - wind))


MODELS: dict[str, SlopeModel] = {
    "cox-munk": SlopeModel(12.5, (0.0, 3.16e-3), (0.003, 1.92e-3), _skewness_cox_munk, (0.40, 0.12, 0.23)),
    "cox-munk-gaussian": SlopeModel(12.5, (0.0, 3.16e-3), (0.003, 1.92e-3)),
    "cox-munk-isotropic": SlopeModel(12.5, (0.0015, 2.56e-3), (0.0015, 2.56e-3)),
    "breon-henriot": SlopeModel(10.0, (0.001, 3.16e-3), (0.003, 1.85e-3), _skewness_breon_henriot, (0.30, 0.12, 0.40)),
}
"""The slope models by name."""


def density(
    upwind: npt.ArrayLike, crosswind: npt.ArrayLike, wind: npt.ArrayLike, *, model: str = "cox-munk", clip: bool = True
) -> Array:
    """Probability density of the slopes of the sea surface for a wind, per unit of slope along both axes [1].

    With X = upwind / sigma_u, Y = crosswind / sigma_c (sigma: standard deviations of the slopes) and the coefficients c
    of the model, the density, whose integral is 1, is (Cox and Munk 1954, eq. 18)

        p = exp(-(X^2 + Y^2) / 2) / (2 pi sigma_u sigma_c)
            [1 - c21 (Y^2 - 1) X / 2 - c03 (X^3 - 3 X) / 6 + c40 (Y^4 - 6 Y^2 + 3) / 24
               + c22 (X^2 - 1)(Y^2 - 1) / 4 + c04 (X^4 - 6 X^2 + 3) / 24].

    Parameters
    ----------
    upwind, crosswind : array_like
        Slope along the two axes of the wind [1].
    wind : array_like
        Wind speed [m/s], 0.1 to 20, at the reference height of the model, `SlopeModel.height`; see `wind_at_height`.
    model : str
        One of `MODELS`.
    clip : bool
        If True, negative values are set to 0, and the density is normalised again; if False, negative values remain.

    Examples
    --------
    >>> float(density(0, 0, 9.0).round(3))
    7.348
    """
    variance_u, variance_c = variances(wind, model=model)
    plain = gaussian(upwind, crosswind, variance_u, variance_c)
    chosen = MODELS[model]
    if chosen.skewness is None:
        return plain
    wind = np.asarray(wind, dtype=np.float64)
    x = np.asarray(upwind, dtype=np.float64) / np.sqrt(variance_u)
    y = np.asarray(crosswind, dtype=np.float64) / np.sqrt(variance_c)
    series = _series(x, y, *chosen.skewness(wind), *chosen.peakedness)
    if not clip:
        return plain * series
    return plain * np.maximum(series, 0.0) / (1.0 + np.interp(wind, *_negative_mass(model)))


def gaussian(
    upwind: npt.ArrayLike, crosswind: npt.ArrayLike, variance_upwind: npt.ArrayLike, variance_crosswind: npt.ArrayLike
) -> Array:
    """Gaussian probability density of slopes with given variances, per unit of slope along both axes [1].

    Parameters
    ----------
    upwind, crosswind : array_like
        Difference of the slope from its mean, along the two axes of the wind [1].
    variance_upwind, variance_crosswind : array_like
        Variances of slope along the two axes [1], above 0.

    Examples
    --------
    >>> float(gaussian(0, 0, 0.02, 0.02).round(3))
    7.958
    """
    remedy = "Give the variance of slope, not its root; a flat sea has no density."
    u = within("variance_upwind", variance_upwind, 1e-12, 10.0, "", remedy)
    c = within("variance_crosswind", variance_crosswind, 1e-12, 10.0, "", remedy)
    x, y = np.asarray(upwind, dtype=np.float64), np.asarray(crosswind, dtype=np.float64)
    return np.exp(-0.5 * (x**2 / u + y**2 / c)) / (2.0 * np.pi * np.sqrt(u * c))


def variances(wind: npt.ArrayLike, *, model: str = "cox-munk") -> tuple[Array, Array]:
    """Variances of the upwind and of the crosswind slope of the sea surface [1] for a wind.

    `wind` is the wind speed at the reference height of the model [m/s], 0.1 to 20; `model` is one of `MODELS`.

    Examples
    --------
    >>> [float(v.round(5)) for v in variances(9.0)]
    [0.02844, 0.02028]
    """
    check_choice(model, list(MODELS), "model")
    wind = within("wind", wind, *WIND_RANGE, "m/s", "The slope models hold in this range only.")
    up, cross = MODELS[model].upwind, MODELS[model].crosswind
    return up[0] + up[1] * wind, cross[0] + cross[1] * wind


def to_wind_axes(east: npt.ArrayLike, north: npt.ArrayLike, wind_from: npt.ArrayLike) -> tuple[Array, Array]:
    """Convert slopes towards east and north to slopes (upwind, crosswind) along the axes of the wind [1].

    `wind_from` is the azimuth that the wind blows from, clockwise from north [degree].

    Examples
    --------
    >>> [float(v) for v in to_wind_axes(0.1, 0.2, 0.0)]
    [0.2, 0.1]
    """
    azimuth = np.radians(np.asarray(wind_from, dtype=np.float64))
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    east, north = np.asarray(east, dtype=np.float64), np.asarray(north, dtype=np.float64)
    return east * sine + north * cosine, east * cosine - north * sine


def from_wind_axes(upwind: npt.ArrayLike, crosswind: npt.ArrayLike, wind_from: npt.ArrayLike) -> tuple[Array, Array]:
    """Convert upwind and crosswind slopes [1] to slopes (east, north) [1]; this is the inverse of `to_wind_axes`."""
    return to_wind_axes(upwind, crosswind, wind_from)  # the conversion is a reflection, which is its own inverse


def hidden(zenith: npt.ArrayLike, variance: npt.ArrayLike) -> Array:
    """Smith's shadowing function Lambda [1]: hidden area of the sea divided by visible area, seen from a direction.

        Lambda = [exp(-v^2) - v sqrt(pi) erfc(v)] / (2 v sqrt(pi)),  v = cot(zenith) / sqrt(2 variance)

    The visible share of the sea is 1 / (1 + Lambda). The share that is both visible and sunlit is 1 / (1 + Lambda_v +
    Lambda_s), with Lambda of the sensor and of the sun.

    Parameters
    ----------
    zenith : array_like
        Zenith angle of the direction [degree], 0 to 89.9.
    variance : array_like
        Variance of the slopes along the azimuth of the direction [1], above 0.

    Examples
    --------
    >>> hidden([40, 80], 0.02).round(4).tolist()
    [0.0, 0.0408]
    """
    zenith = within("zenith", zenith, 0.0, 89.9, "degrees", "At 90 degrees all waves are hidden.")
    variance = within("variance", variance, 1e-12, 10.0, "", "Give the variance of slope, not its root.")
    angle = np.radians(np.maximum(zenith, 1e-6))
    v = np.minimum(1.0 / (np.tan(angle) * np.sqrt(2.0 * variance)), 25.0)
    return (np.exp(-(v**2)) - v * np.sqrt(np.pi) * _ERFC(v)) / (2.0 * v * np.sqrt(np.pi))


def wind_at_height(wind: npt.ArrayLike, *, measured_at: float = 10.0, wanted_at: float = 12.5) -> Array:
    """Convert a wind speed [m/s] to the height `wanted_at`, by the logarithmic profile for neutral stability.

        U(z) = U(10) [1 + sqrt(C) / 0.4 ln(z / 10)],  with the drag coefficient C = 1.3e-3 and the height z [m].

    Parameters
    ----------
    wind : array_like
        Wind speed at the height `measured_at` [m/s], 0 to 100.
    measured_at, wanted_at : float
        Heights above the sea [m], 1 to 100.

    Examples
    --------
    >>> float(wind_at_height(10.0).round(2))
    10.2
    """
    wind = within("wind", wind, 0.0, 100.0, "m/s", "Give the wind speed.")
    heights = within("measured_at and wanted_at", [measured_at, wanted_at], 1.0, 100.0, "m", "Give the mast's height.")
    measured, wanted = 1.0 + np.sqrt(_DRAG) / _KARMAN * np.log(heights / 10.0)
    return np.asarray(wind * (wanted / measured))


def _series(x: Array, y: Array, c21: Array, c03: Array, c40: float, c22: float, c04: float) -> Array:
    """Gram-Charlier series, the bracket in `density`; `x` is upwind and `y` crosswind slope in standard deviations."""
    x2, y2 = x * x, y * y
    skew = c21 * (y2 - 1.0) * x / 2.0 + c03 * (x2 - 3.0) * x / 6.0
    peak = c40 * (y2 * y2 - 6.0 * y2 + 3.0) / 24.0 + c22 * (x2 - 1.0) * (y2 - 1.0) / 4.0
    return 1.0 - skew + peak + c04 * (x2 * x2 - 6.0 * x2 + 3.0) / 24.0


@cache
def _negative_mass(model: str) -> tuple[Array, Array]:
    """Winds (n,) [m/s], and for each wind the integral of -p over slopes where the density p is negative (n,) [1].

    Linear interpolation between winds is accurate to 1e-5. `model` must have a Gram-Charlier series.
    """
    chosen = MODELS[model]
    assert chosen.skewness is not None
    winds = np.append(0.0, np.arange(0.5, WIND_RANGE[1] + 0.25, 0.5))
    axis = np.linspace(-7.5, 7.5, 151)
    x, y = axis[:, None], axis[None, :]
    weight = np.exp(-0.5 * (x**2 + y**2)) / (2.0 * np.pi) * (axis[1] - axis[0]) ** 2
    mass = [-np.sum(weight * np.minimum(_series(x, y, *chosen.skewness(u), *chosen.peakedness), 0.0)) for u in winds]
    return winds, np.array(mass)
