"""Direct and diffuse solar irradiance at the sea surface under a clear sky, as functions of wavelength.

This is the model of Gregg and Carder for maritime air, 300 to 1000 nm. It includes absorption by ozone, oxygen and
water vapour, scattering by molecules, and the three kinds of aerosol of the Navy model, which depend on air mass type,
humidity, wind and visibility. The relative air mass is that of Kasten and Young. The amount of the largest aerosol is
multiplied by 0.05; the paper omits this factor, but every code of the model has it. Clouds are not modelled.

References
----------
Gregg, Carder (1990), "A simple spectral solar irradiance model for cloudless maritime atmospheres", Limnology and
Oceanography 35, 1657-1675, doi:10.4319/lo.1990.35.8.1657. Kasten, Young (1989), "Revised optical air mass tables and
approximation formula", Applied Optics 28, 4735-4738, doi:10.1364/AO.28.004735. Van Heuklon (1979), "Estimating
atmospheric ozone for solar radiation models", Solar Energy 22, 63-68, doi:10.1016/0038-092X(79)90060-4.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from . import sun
from ._checks import Array, Checked, coordinates, day_number, ranged, sun_angle
from .tables import WAVELENGTH_RANGE as WAVELENGTH_RANGE
from .tables import checked_wavelength, interpolate

STANDARD_PRESSURE = 1013.25  # pressure at sea level [hPa]
_SCALE_HEIGHT = 1.0  # scale height of the aerosol [km]
_RADII = np.array([0.1, 1.0, 10.0])  # radii at which a power law is fitted to the size distribution [um]
_MODES = np.array([0.03, 0.24, 2.0])  # mode radii of the three kinds of aerosol [um]


@dataclass(frozen=True)
class Air(Checked):
    """State of the atmosphere.

    Attributes
    ----------
    air_mass_type, visibility : float
        Air mass type, from 1 for air of the open ocean to 10 for continental air; horizontal visibility [km].
    humidity, water_vapour, ozone, pressure : float
        Relative humidity [%], water vapour column [cm], ozone column [DU], pressure at the sea [hPa].
    wind_mean, wind : float
        Mean wind speed of the last 24 hours, and current wind speed, at 10 m [m/s].
    """

    air_mass_type: float = ranged(1.0, 1.0, 10.0, "", "1 is air of the open ocean, 10 that of a continent.")
    humidity: float = ranged(80.0, 0.0, 100.0, "%", "Give relative humidity.")
    water_vapour: float = ranged(1.5, 0.0, 10.0, "cm", "Give precipitable water; 1.5 is usual, 5 tropical.")
    wind_mean: float = ranged(5.0, 0.0, 20.0, "m/s", "Give the mean wind of the last 24 hours.")
    wind: float = ranged(5.0, 0.0, 20.0, "m/s", "Give the current wind at 10 m.")
    visibility: float = ranged(15.0, 1.0, 200.0, "km", "Give the horizontal visibility; 5 is hazy, 40 very clear.")
    ozone: float = ranged(300.0, 0.0, 700.0, "DU", "Give the ozone column in Dobson units, 300 if unknown.")
    pressure: float = ranged(STANDARD_PRESSURE, 500.0, 1100.0, "hPa", "Give hPa: 1 inHg is 33.86 hPa.")


CLEAR_AIR = Air(humidity=80.0, water_vapour=2.5, visibility=40.0)  # the default of plans and simulations


class Aerosol(NamedTuple):
    """Optical parameters of the aerosol [1]; its optical depth is turbidity * (wavelength [um])^-exponent."""

    exponent: float  # Angstrom's alpha
    turbidity: float  # Angstrom's beta: optical depth at 1 um
    asymmetry: float  # mean cosine of the scattering angle
    albedo: float  # share of the extinction that is scattering


class Spectrum(NamedTuple):
    """Solar irradiance above the atmosphere [W m-2 nm-1] and absorption coefficients of gases [1/cm] by wavelength."""

    irradiance: Array  # solar irradiance at the mean distance of the sun [W m-2 nm-1]
    ozone: Array  # absorption coefficients [1/cm], here and below
    oxygen: Array
    water_vapour: Array


class Irradiance(NamedTuple):
    """Irradiance of a horizontal plane just above the sea [W m-2 nm-1]: direct from the sun, diffuse from the sky."""

    direct: Array
    diffuse: Array


def irradiance(
    wavelength: npt.ArrayLike,
    sun_zenith: npt.ArrayLike,
    air: Air | None = None,
    *,
    day: npt.ArrayLike | None = None,
    spectrum: Spectrum | None = None,
    **params: float,
) -> Irradiance:
    """Compute direct and diffuse irradiance just above the sea (Gregg and Carder 1990, eq. 1 to 29).

    Both [W m-2 nm-1] are for a horizontal plane. A plane facing the sun receives direct / cos(sun zenith) from it.

    Parameters
    ----------
    wavelength : array_like
        Wavelength in air [nm], 300 to 1000; broadcasts with `sun_zenith`.
    sun_zenith : array_like
        Zenith angle of the sun [degree], 0 to 90.
    air : Air, optional
        State of the atmosphere; by default ``Air()``.
    day : array_like, optional
        Day of the year, for the distance of the sun; by default the mean distance is used.
    spectrum : Spectrum, optional
        Solar irradiance and absorption by gases at `wavelength`; by default ``table_spectrum(wavelength)``.
    **params
        Fields of `Air` that replace those of `air`, such as ``visibility=23``.

    Examples
    --------
    >>> direct, diffuse = irradiance(550, 30, visibility=15, humidity=80)
    >>> float(direct.round(2)), float(diffuse.round(2))
    (1.04, 0.4)
    """
    air = replace(air or Air(), **params)
    wavelength = checked_wavelength(wavelength)
    spectrum = spectrum or table_spectrum(wavelength)
    incoming = spectrum.irradiance * _cosine(sun_zenith) * (1.0 if day is None else sun.distance_factor(day))
    incoming = incoming * _gases(spectrum, sun_zenith, air)
    aerosol = navy_aerosol(air)
    depth = aerosol.turbidity * (wavelength / 1000.0) ** -aerosol.exponent * air_mass(sun_zenith)
    absorbed, scattered = np.exp((aerosol.albedo - 1.0) * depth), np.exp(-aerosol.albedo * depth)
    path, micrometres = air_mass(sun_zenith) * air.pressure / STANDARD_PRESSURE, wavelength / 1000.0
    molecules = np.exp(-path / (115.6406 * micrometres**4 - 1.335 * micrometres**2))
    forward = forward_share(sun_zenith, aerosol.asymmetry)
    direct = incoming * molecules * absorbed * scattered
    by_molecules = incoming * absorbed * (1.0 - molecules**0.95) * 0.5
    by_aerosol = incoming * absorbed * molecules**1.5 * (1.0 - scattered) * forward
    return Irradiance(direct, by_molecules + by_aerosol)


def table_spectrum(wavelength: npt.ArrayLike) -> Spectrum:
    """Solar irradiance and absorption by gases at wavelengths [nm], interpolated linearly in a table in 1 nm steps."""
    names = ("irradiance_W_m-2_nm-1", "ozone_cm-1", "oxygen_cm-1", "water_vapour_cm-1")
    return Spectrum(*(interpolate("solar_and_gases", name, wavelength) for name in names))


def navy_aerosol(air: Air) -> Aerosol:
    """Exponent, turbidity, asymmetry, albedo of aerosol by the Navy model (Gregg and Carder 1990, eq. 20 to 28 and 36).

    Examples
    --------
    >>> [round(x, 4) for x in navy_aerosol(Air())]
    [0.2174, 0.2289, 0.7892, 0.9928]
    """
    humidity = min(air.humidity, 99.9) / 100.0
    growth = ((2.0 - humidity) / (6.0 * (1.0 - humidity))) ** (1.0 / 3.0)
    small, middle = 2000.0 * air.air_mass_type**2, max(5.866 * (air.wind_mean - 2.2), 0.5)
    amounts = np.array([small, middle, max(0.01527 * (air.wind - 2.2) * 0.05, 1.4e-5)])
    logs = np.log10(np.exp(-(np.log(_RADII[:, None] / (growth * _MODES)) ** 2)) @ amounts / growth)
    exponent = -((logs[2] - logs[0]) / 2.0 + 3.0)
    turbidity = 3.91 / air.visibility * _SCALE_HEIGHT * 0.55**exponent
    asymmetry = 0.82 - 0.1417 * exponent if 0.0 <= exponent <= 1.2 else 0.65 if exponent > 1.2 else 0.82
    albedo = (0.972 - 0.0032 * air.air_mass_type) * np.exp(3.06e-4 * air.humidity)
    return Aerosol(float(exponent), float(turbidity), float(asymmetry), float(albedo))


def air_mass(sun_zenith: npt.ArrayLike) -> Array:
    """Relative air mass [1]: path of the sunlight through the air, relative to a vertical path (Kasten and Young 1989).

    `sun_zenith` is the zenith angle of the sun [degree], 0 to 90.

    Examples
    --------
    >>> float(air_mass(60.0).round(4))
    1.9943
    """
    return 1.0 / (_cosine(sun_zenith) + 0.50572 * (96.07995 - np.asarray(sun_zenith, dtype=np.float64)) ** -1.6364)


def forward_share(sun_zenith: npt.ArrayLike, asymmetry: float) -> Array:
    """Share of the light scattered by aerosol that is scattered downwards [1] (Gregg and Carder 1990, eq. 29 to 32).

    `sun_zenith` is the zenith angle of the sun [degree]; `asymmetry` is the mean cosine of the scattering angle.
    """
    cosine = _cosine(sun_zenith)
    b3 = np.log(1.0 - asymmetry)
    b1 = b3 * (1.459 + b3 * (0.1595 + 0.4129 * b3))
    b2 = b3 * (0.0783 + b3 * (-0.3824 - 0.5874 * b3))
    return 1.0 - 0.5 * np.exp((b1 + b2 * cosine) * cosine)


def ozone(latitude: npt.ArrayLike, longitude: npt.ArrayLike, day: npt.ArrayLike) -> Array:
    """Climatological ozone column [DU] at a place (degrees north and east) on a day of the year (Van Heuklon 1979).

    Examples
    --------
    >>> float(ozone(36.0, -122.0, 185).round(1))
    321.2
    """
    (lat, lon), day = coordinates(latitude, longitude), day_number(day)
    lon = np.where(lon > 180.0, lon - 360.0, lon)
    north = 150.0 + 40.0 * _sine(0.9865 * (day - 30.0)) + 20.0 * _sine(3.0 * (lon + 20.0 * (lon > 0.0)))
    south = 100.0 + 30.0 * _sine(0.9865 * (day + 152.625)) + 20.0 * _sine(2.0 * (lon - 75.0))
    return 235.0 + np.where(lat > 0.0, north * _sine(1.28 * lat) ** 2, south * _sine(1.5 * lat) ** 2)


def _gases(spectrum: Spectrum, sun_zenith: npt.ArrayLike, air: Air) -> Array:
    """Transmittance [1] of ozone, oxygen and water vapour together along the path of the direct sunlight."""
    cosine, path = _cosine(sun_zenith), air_mass(sun_zenith)
    ozone_path = (1.0 + 22.0 / 6370.0) / np.sqrt(cosine**2 + 44.0 / 6370.0)
    oxygen = spectrum.oxygen * path * air.pressure / STANDARD_PRESSURE
    vapour = spectrum.water_vapour * air.water_vapour * path
    depth = spectrum.ozone * air.ozone / 1000.0 * ozone_path + 1.41 * oxygen / (1.0 + 118.3 * oxygen) ** 0.45
    return np.exp(-(depth + 0.2385 * vapour / (1.0 + 20.07 * vapour) ** 0.45))


def _cosine(sun_zenith: npt.ArrayLike) -> Array:
    return np.cos(np.radians(sun_angle(sun_zenith)))


def _sine(angle: npt.ArrayLike) -> Array:
    return np.sin(np.radians(np.asarray(angle, dtype=np.float64)))
