"""Remote-sensing reflectance of deep water, and of a flat Lambertian object under water.

Remote-sensing reflectance is water-leaving radiance over irradiance, both just above the surface [1/sr]; reflection at
the surface is not included. Deep water follows Lee et al. (2011), whose table depends on sun and view angles; outside
that table Lee et al. (1999), which does not depend on the view angle. The light of an object follows Lee et al. (1999),
with path lengths along the rays of sun and sensor; the object is assumed to be wide compared to its depth.

`relative_azimuth` is the azimuth of the sensor minus that of the sun, both seen from the target: 0 puts the sensor on
the side of the sun, 180 opposite, where the glint is.

References
----------
Lee, Du, Voss, Zibordi, Lubac, Arnone, Weidemann (2011), "An inherent-optical-property-centered
approach to correct the angular effects in water-leaving radiance", Applied Optics 50, 3155-3167,
doi:10.1364/AO.50.003155. Lee, Carder, Mobley, Steward, Patch (1999), "Hyperspectral remote sensing for
shallow waters: 2. Deriving bottom depths and water properties by optimization", Applied Optics 38, 3831-3843,
doi:10.1364/AO.38.003831.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from . import fresnel
from ._checks import Array, choice, sun_angle, within
from .iops import Iops, case1, particle_absorption
from .tables import load

__all__ = [
    "WATER_MODELS", "Iops", "absorption_only_reflectance", "case1", "deep_reflectance", "lee_1999", "lee_2011",
    "lee_2011_grid", "lee_2011_terms", "object_reflectance", "particle_absorption", "remote_sensing_reflectance",
    "submerged_reflectance",
]  # fmt: skip

WATER_MODELS = ("auto", "lee-2011", "lee-1999")
"""Models of deep water; "auto" is Lee et al. (2011) inside its table and Lee et al. (1999) outside."""
LEE_SUN_LIMIT, LEE_VIEW_LIMIT = 75.0, 70.0
"""Largest sun and view zenith angles of the table of Lee et al. (2011) [degree]."""
_SKY_REFLECTANCE = 0.066  # of a calm sea for diffuse light
_TURNED_BACK = 0.48  # share of upwelling light that the surface throws back


def remote_sensing_reflectance(
    wavelength: npt.ArrayLike,
    chlorophyll: npt.ArrayLike,
    sun_zenith: npt.ArrayLike,
    view_zenith: npt.ArrayLike,
    relative_azimuth: npt.ArrayLike,
    *,
    model: str = "auto",
) -> Array:
    """Remote-sensing reflectance of deep case-1 water [1/sr].

    Raises InputError: a value is out of range, or there is no such model.

    Parameters
    ----------
    wavelength : array_like
        [nm], 300 to 1000; all arguments broadcast with each other.
    chlorophyll : array_like
        [mg m-3], 0.01 to 30.
    sun_zenith, view_zenith : array_like
        In air [degree], 0 to 90.
    relative_azimuth : array_like
        Azimuth of the sensor minus that of the sun, from the target [degree].
    model : str
        One of `WATER_MODELS`.

    Examples
    --------
    >>> float(remote_sensing_reflectance(490, 0.5, 30, 0, 0).round(5))
    0.004
    """
    return deep_reflectance(case1(wavelength, chlorophyll), sun_zenith, view_zenith, relative_azimuth, model=model)


def object_reflectance(
    wavelength: npt.ArrayLike,
    chlorophyll: npt.ArrayLike,
    sun_zenith: npt.ArrayLike,
    view_zenith: npt.ArrayLike,
    relative_azimuth: npt.ArrayLike,
    *,
    depth: npt.ArrayLike,
    reflectance: npt.ArrayLike,
    direct_fraction: npt.ArrayLike = 0.7,
    model: str = "auto",
) -> Array:
    """Remote-sensing reflectance over a Lambertian object in case-1 water [1/sr].

    Raises InputError: a value is out of range, or there is no such model.

    Parameters
    ----------
    wavelength, chlorophyll, sun_zenith, view_zenith, relative_azimuth, model
        See `remote_sensing_reflectance`.
    depth : array_like
        Of the object [m], not below 0.
    reflectance : array_like
        Of the object, 0 to 1 [1].
    direct_fraction : array_like
        Direct over total irradiance above the surface, 0 to 1 [1].

    Examples
    --------
    >>> float(object_reflectance(490, 0.5, 30, 0, 0, depth=6.0, reflectance=0.15).round(4))
    0.0161
    """
    water = case1(wavelength, chlorophyll)
    deep = deep_reflectance(water, sun_zenith, view_zenith, relative_azimuth, model=model)
    return submerged_reflectance(
        water, deep, sun_zenith, view_zenith, depth=depth, reflectance=reflectance, direct_fraction=direct_fraction
    )


def deep_reflectance(
    water: Iops,
    sun_zenith: npt.ArrayLike,
    view_zenith: npt.ArrayLike,
    relative_azimuth: npt.ArrayLike,
    *,
    model: str = "auto",
) -> Array:
    """Remote-sensing reflectance of deep water with given properties [1/sr].

    Raises InputError: a value is out of range, or there is no such model.

    Parameters
    ----------
    water : Iops
    sun_zenith, view_zenith, relative_azimuth, model
        See `remote_sensing_reflectance`.
    """
    choice("model", model, WATER_MODELS)
    sun = sun_angle(sun_zenith)
    view = within("view_zenith", view_zenith, 0.0, 90.0, "degrees", "A sensor above the sea has 0 to 90.")
    if model == "lee-1999":
        return lee_1999(water) + 0.0 * (sun + view + np.asarray(relative_azimuth, dtype=np.float64))
    if model == "lee-2011":
        return lee_2011(water, sun, view, relative_azimuth)
    inside = ~((sun > LEE_SUN_LIMIT) | (view > LEE_VIEW_LIMIT))
    angular = lee_2011(water, np.minimum(sun, LEE_SUN_LIMIT), np.minimum(view, LEE_VIEW_LIMIT), relative_azimuth)
    return angular if inside.all() else np.where(inside, angular, lee_1999(water))


def lee_2011(
    water: Iops, sun_zenith: npt.ArrayLike, view_zenith: npt.ArrayLike, relative_azimuth: npt.ArrayLike
) -> Array:
    """Deep water by the table of Lee et al. (2011), interpolated linearly between its angles [1/sr].

        Rrs = (Gw0 + Gw1 b_bw / k) b_bw / k + (Gp0 + Gp1 b_bp / k) b_bp / k,  k = a + b_bw + b_bp

    Raises InputError: an angle is outside the table.

    Parameters
    ----------
    water : Iops
    sun_zenith, view_zenith : array_like
        In air [degree], 0 to 75 and 0 to 70.
    relative_azimuth : array_like
        See `remote_sensing_reflectance` [degree].
    """
    remedy = "Beyond the table of Lee et al. (2011) use model lee-1999."
    sun = within("sun_zenith", sun_zenith, 0.0, LEE_SUN_LIMIT, "degrees", remedy)
    view = within("view_zenith", view_zenith, 0.0, LEE_VIEW_LIMIT, "degrees", remedy)
    g = _coefficients(sun, view, relative_azimuth)
    u, u2, v, v2 = lee_2011_terms(water)
    return g[0] * u + g[1] * u2 + g[2] * v + g[3] * v2


def lee_2011_terms(water: Iops) -> tuple[Array, Array, Array, Array]:
    """Terms that the coefficients of Lee et al. (2011) multiply: u, u^2, v, v^2 with u = b_bw / k and v = b_bp / k."""
    k = water.absorption + water.backscattering
    u, v = water.water_backscattering / k, water.particle_backscattering / k
    return u, u * u, v, v * v


def lee_2011_grid(sun_zenith: float, view_zenith: npt.ArrayLike, relative_azimuth: npt.ArrayLike) -> Array:
    """Coefficients of Lee et al. (2011) on a grid of viewing geometries; outside the table, those at its edge.

    Parameters
    ----------
    sun_zenith, view_zenith, relative_azimuth : float, (zenith,) array_like, (azimuth,) array_like
        See `remote_sensing_reflectance` [degree].

    Returns
    -------
    (4, zenith, azimuth) ndarray
        Gw0, Gw1, Gp0, Gp1 [1/sr]; times `lee_2011_terms` and summed they are the reflectance of deep water.
    """
    view = np.minimum(np.asarray(view_zenith, dtype=np.float64), LEE_VIEW_LIMIT)
    return _coefficients(np.asarray(min(sun_zenith, LEE_SUN_LIMIT)), view[:, None], relative_azimuth)


def lee_1999(water: Iops) -> Array:
    """Deep water by Lee et al. (1999), for sun and sensor near the zenith [1/sr].

    r = (0.084 + 0.170 u) u below the surface, u = b_b / (a + b_b), and 0.52 r / (1 - 1.7 r) above.
    """
    u = water.backscattering / (water.absorption + water.backscattering)
    below = (0.084 + 0.170 * u) * u
    return 0.52 * below / (1.0 - 1.7 * below)


def submerged_reflectance(
    water: Iops,
    deep: npt.ArrayLike,
    sun_zenith: npt.ArrayLike,
    view_zenith: npt.ArrayLike,
    *,
    depth: npt.ArrayLike,
    reflectance: npt.ArrayLike,
    direct_fraction: npt.ArrayLike = 0.7,
    index: float = fresnel.WATER_INDEX,
) -> Array:
    """Remote-sensing reflectance over a Lambertian object in water with given properties [1/sr].

    With R the object's reflectance, H its depth, angles in water, k = a + b_b and u = b_b / k,

        Rrs = deep [1 - exp(-(1 / cos s + D_C / cos v) k H)]
              + T_d T_u R / pi exp(-(1 / cos s + D_B / cos v) k H) / (1 - 0.48 R exp(-2 k H)),

    D_C = 1.03 (1 + 2.4 u)^0.5 and D_B = 1.04 (1 + 5.4 u)^0.5 (Lee et al. 1999, eq. 9), T_d and T_u the transmittances
    of the surface.

    Raises InputError: a value is out of range.

    Parameters
    ----------
    water : Iops
    deep : array_like
        Remote-sensing reflectance of the water without the object [1/sr].
    sun_zenith, view_zenith : array_like
        In air [degree], 0 to 90.
    depth, reflectance, direct_fraction
        See `object_reflectance`.
    index : float
        Refractive index of water [1].

    Notes
    -----
    Against a Monte Carlo of 288 cases to 14 m the root mean square error is 1.4 %. The adjacency effect at small
    objects (light scattered in from their surroundings) is not modelled.
    """
    depth, albedo = _object(depth, reflectance)
    k = water.absorption + water.backscattering
    u = water.backscattering / k
    sun_path, view_path = _path(sun_zenith, index), _path(view_zenith, index)
    column = np.exp(-(sun_path + 1.03 * np.sqrt(1.0 + 2.4 * u) * view_path) * k * depth)
    bottom = np.exp(-(sun_path + 1.04 * np.sqrt(1.0 + 5.4 * u) * view_path) * k * depth)
    again = 1.0 - _TURNED_BACK * albedo * np.exp(-2.0 * k * depth)
    surface = _both_ways(sun_zenith, view_zenith, direct_fraction, index)
    return np.asarray(deep) * (1.0 - column) + surface * albedo / np.pi * bottom / again


def absorption_only_reflectance(
    water: Iops,
    sun_zenith: npt.ArrayLike,
    view_zenith: npt.ArrayLike,
    *,
    depth: npt.ArrayLike,
    reflectance: npt.ArrayLike,
    direct_fraction: npt.ArrayLike = 0.7,
    index: float = fresnel.WATER_INDEX,
) -> Array:
    """Light of a Lambertian object through water that absorbs but does not scatter [1/sr], for comparison.

        T_d T_u R / pi exp(-(1 / cos s + 1 / cos v) a H),  angles in water

    The fast model of Fink (2014), section 2.5. Parameters are those of `submerged_reflectance`; backscattering of the
    water is not included.

    Raises InputError: a value is out of range.

    Notes
    -----
    Against the Monte Carlo of `submerged_reflectance` the contrast of the object with the water is 27 % too high on
    average; the error grows with depth.
    """
    depth, albedo = _object(depth, reflectance)
    paths = _path(sun_zenith, index) + _path(view_zenith, index)
    surface = _both_ways(sun_zenith, view_zenith, direct_fraction, index)
    return surface * albedo / np.pi * np.exp(-paths * water.absorption * depth)


def _object(depth: npt.ArrayLike, reflectance: npt.ArrayLike) -> tuple[Array, Array]:
    """Depth and reflectance of an object, checked."""
    depth = within("depth", depth, 0.0, 1000.0, "m", "Give metres below the surface, positive down.")
    return depth, within("reflectance", reflectance, 0.0, 1.0, "", "Give a share, not per cent.")


def _path(zenith: npt.ArrayLike, index: float) -> Array:
    """Path length of a ray under water over depth, from its zenith angle in air."""
    return 1.0 / np.cos(np.radians(fresnel.refraction_angle(zenith, index)))


def _both_ways(sun_zenith: npt.ArrayLike, view_zenith: npt.ArrayLike, direct: npt.ArrayLike, index: float) -> Array:
    """Transmittance of the surface for irradiance into the water times that for radiance out of it, T_d T_u."""
    direct = within("direct_fraction", direct, 0.0, 1.0, "", "Give direct over total irradiance.")
    downward = direct * (1.0 - fresnel.reflectance(sun_zenith, index)) + (1.0 - direct) * (1.0 - _SKY_REFLECTANCE)
    return downward * fresnel.radiance_transmittance(view_zenith, index)


@cache
def _grid() -> tuple[tuple[Array, Array, Array], Array]:
    """Axes of the table of Lee et al. (2011), and its coefficients (4, suns, views, azimuths)."""
    table = load("reflectance_lee_2011")
    sun, view, turn = (np.unique(table[name]) for name in ("sun_zenith", "view_zenith", "relative_azimuth"))
    values = np.array([table[name] for name in ("Gw0", "Gw1", "Gp0", "Gp1")])
    return (sun, view, turn), values.reshape(4, sun.size, view.size, turn.size)


def _coefficients(sun: Array, view: Array, relative_azimuth: npt.ArrayLike) -> Array:
    """Coefficients (4, ...) at given angles, by linear interpolation of the table."""
    axes, values = _grid()
    turn = np.abs((np.asarray(relative_azimuth, dtype=np.float64) + 180.0) % 360.0 - 180.0)
    corners = []
    for axis, angle in zip(axes, np.broadcast_arrays(sun, view, turn), strict=True):
        low = np.clip(np.searchsorted(axis, angle, side="right") - 1, 0, axis.size - 2)
        share = (angle - axis[low]) / (axis[low + 1] - axis[low])
        corners.append(((low, 1.0 - share), (low + 1, share)))
    return sum(
        (values[:, i, j, k] * (a * b * c) for i, a in corners[0] for j, b in corners[1] for k, c in corners[2]),
        start=np.zeros(1),
    )
