"""Reflection and refraction of light at a flat air-water interface.

References
----------
Mobley (1994), "Light and Water", Academic Press, section 4.2.
"""

import numpy as np
import numpy.typing as npt

from ._checks import Array, within

WATER_INDEX = 1.34  # refractive index of sea water in the visible [1], the usual constant of radiative transfer codes


def reflectance(angle: npt.ArrayLike, index: npt.ArrayLike = WATER_INDEX) -> Array:
    """Fresnel reflectance [1] of a flat water surface for unpolarised light from above.

    It is the power reflectance, 0 to 1: the mean r = (r_s + r_p) / 2 of light polarised perpendicular and parallel to
    the plane of incidence.

    Parameters
    ----------
    angle : array_like
        Angle of incidence in air, from the normal [degree], 0 to 90.
    index : array_like
        Refractive index of water divided by that of air [1], 1.01 to 2.

    Examples
    --------
    >>> reflectance([0, 60]).round(4).tolist()
    [0.0211, 0.061]
    """
    angle = within("angle", angle, 0.0, 90.0, "degrees", "Measure it from the normal of the surface.")
    index = within("index", index, 1.01, 2.0, "", "Give the relative refractive index, 1.34 for sea water.")
    return reflectance_of_cosine(np.cos(np.radians(angle)), index)


def reflectance_of_cosine(cosine: Array, index: Array | float = WATER_INDEX) -> Array:
    """Fresnel reflectance [1] for unpolarised light, from the cosine of the angle of incidence.

    `cosine` is the cosine of the angle of incidence in air, 0 to 1; `index` is as in `reflectance`. This function is
    faster than `reflectance`: arguments are not checked, and the result has the floating-point precision of `cosine`.

    Examples
    --------
    >>> reflectance_of_cosine(np.array([1.0, 0.5])).round(4).tolist()
    [0.0211, 0.061]
    """
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    perpendicular = ((cosine - index * inside) / (cosine + index * inside)) ** 2
    parallel = ((index * cosine - inside) / (index * cosine + inside)) ** 2
    return 0.5 * (perpendicular + parallel)


def refraction_angle(angle: npt.ArrayLike, index: npt.ArrayLike = WATER_INDEX) -> Array:
    """Angle of refraction in the water, from the normal [degree], by Snell's law; arguments are as in `reflectance`.

    Examples
    --------
    >>> float(refraction_angle(30).round(3))
    21.909
    """
    angle = within("angle", angle, 0.0, 90.0, "degrees", "Measure it from the normal of the surface.")
    index = within("index", index, 1.01, 2.0, "", "Give the relative refractive index, 1.34 for sea water.")
    return np.degrees(np.arcsin(np.sin(np.radians(angle)) / index))


def radiance_transmittance(angle: npt.ArrayLike, index: npt.ArrayLike = WATER_INDEX) -> Array:
    """Transmittance from water to air [1]: radiance in air divided by radiance in water, (1 - r) / n^2.

    The surface transmits the share 1 - r of the flux (r: reflectance), and refraction spreads this flux over n^2 times
    the solid angle (n: `index`). `angle` is the angle of the ray in air from the normal [degree].

    Examples
    --------
    >>> float(radiance_transmittance(0).round(4))
    0.5452
    """
    return (1.0 - reflectance(angle, index)) / np.square(np.asarray(index, dtype=np.float64))
