"""Formulas of wave spectra and of directional spreading about the wind direction.

They are plain functions of frequency [Hz] or wavenumber [rad/m]; `deglint.physics.waves` combines them.
"""

from typing import Literal

import numpy as np

from ._checks import Floats

GRAVITY = 9.81  # acceleration of gravity [m s-2]
SURFACE_TENSION = 0.074 / 1025.0  # surface tension over density of sea water [m3 s-2]
WIND_19_5 = 1.026  # wind speed at a height of 19.5 m divided by wind speed at 10 m [1]
_AGE = 0.84  # inverse wave age of Elfouhaily's fully developed sea [1]
_ECKV_KM = 370.0  # wavenumber of the slowest wave in Elfouhaily's spectrum [rad/m]
_ECKV_CM = 0.23  # phase speed of this wave [m/s]
_FRICTION = float(np.sqrt(1.44e-3))  # friction velocity divided by wind speed at 10 m [1]


def dispersion(wavenumber: Floats) -> Floats:
    """Angular frequency w [rad/s] of deep-water waves: w**2 = g k + T k**3 / rho (surface tension T, density rho)."""
    k = np.asarray(wavenumber, dtype=np.float64)
    return np.sqrt(GRAVITY * k + SURFACE_TENSION * k**3)


def pierson_moskowitz_peak(*, wind_19_5: float) -> float:
    """Peak frequency [Hz] of a fully developed sea: ``0.8772 g / (2 pi U)``, U: wind speed at 19.5 m height [m/s]."""
    return 0.8772 * GRAVITY / (2 * np.pi * wind_19_5)


def pierson_moskowitz(frequency: Floats, *, wind_19_5: float) -> Floats:
    """Pierson-Moskowitz spectrum of the fully developed sea: spectral density of height [m2/Hz].

    ``E(f) = 0.0081 g**2 (2 pi)**-4 f**-5 exp(-5/4 (f/fp)**-4)``, with the peak frequency fp [Hz].

    Parameters
    ----------
    frequency : ndarray
        Frequency [Hz], positive.
    wind_19_5 : float
        Wind speed at a height of 19.5 m [m/s], about 1.026 times the wind speed at 10 m.

    References
    ----------
    Pierson and Moskowitz (1964), doi:10.1029/JZ069i024p05181.

    Examples
    --------
    >>> float(pierson_moskowitz(0.2, wind_19_5=9.0).round(3))
    1.028
    """
    return _gravity_tail(frequency, 0.0081, pierson_moskowitz_peak(wind_19_5=wind_19_5))


def _gravity_tail(frequency: Floats, alpha: float, peak: float) -> Floats:
    """Spectrum of `pierson_moskowitz` [m2/Hz] with `alpha` [1] instead of 0.0081 and a peak frequency `peak` [Hz]."""
    f = np.asarray(frequency, dtype=np.float64)
    with np.errstate(over="ignore", under="ignore"):  # exp(-huge) is 0, as it should be
        return alpha * GRAVITY**2 * (2 * np.pi) ** -4 * f**-5 * np.exp(-1.25 * (f / peak) ** -4)


def jonswap_peak(*, wind: float, fetch: float) -> float:
    """Peak frequency [Hz] of JONSWAP: ``3.5 (g**2 / (U F))**(1/3)``, wind speed U [m/s] at 10 m height, fetch F [m]."""
    return 3.5 * (GRAVITY**2 / (wind * fetch)) ** (1 / 3)


def developed_fetch(wind: float) -> float:
    """Fetch [m] where JONSWAP and Pierson-Moskowitz have equal peak frequencies, for a wind [m/s] at 10 m height."""
    return GRAVITY**2 / wind * (3.5 / pierson_moskowitz_peak(wind_19_5=WIND_19_5 * wind)) ** 3


def jonswap(frequency: Floats, *, wind: float, fetch: float) -> Floats:
    """JONSWAP spectrum of a fetch-limited sea: spectral density of height [m2/Hz].

    ``E(f) = alpha g**2 (2 pi)**-4 f**-5 exp(-5/4 (f/fp)**-4) 3.3**exp(-((f/fp - 1)/s)**2 / 2)``,
    ``alpha = 0.076 (U10**2 / (F g))**0.22``, peak frequency ``fp = 3.5 (g**2 / (U10 F))**(1/3)`` Hz, and s = 0.07
    below the peak and 0.09 above.

    Parameters
    ----------
    frequency : ndarray
        Frequency f [Hz], positive.
    wind : float
        Wind speed U10 at a height of 10 m [m/s].
    fetch : float
        Fetch F [m], at most `developed_fetch`.

    References
    ----------
    Hasselmann et al. (1973), Deutsche Hydrographische Zeitschrift A8 (12).

    Examples
    --------
    >>> float(jonswap(0.3, wind=9.0, fetch=100e3).round(4))
    0.217
    """
    f = np.asarray(frequency, dtype=np.float64)
    alpha = 0.076 * (wind**2 / (fetch * GRAVITY)) ** 0.22
    peak = jonswap_peak(wind=wind, fetch=fetch)
    width = np.where(f <= peak, 0.07, 0.09)
    with np.errstate(under="ignore"):
        enhancement = 3.3 ** np.exp(-0.5 * ((f / peak - 1) / width) ** 2)
    return _gravity_tail(f, alpha, peak) * enhancement


def elfouhaily_peak(wind: float) -> float:
    """Wavenumber [rad/m] of the peak of Elfouhaily's spectrum, for a wind speed [m/s] at a height of 10 m."""
    return GRAVITY * (_AGE / wind) ** 2


def elfouhaily(wavenumber: Floats, *, wind: float) -> Floats:
    """Elfouhaily's unified spectrum of long and short waves of a fully developed sea.

    The omnidirectional spectral density of height [m3] is ``S(k) = (B_l + B_h) / k**3``; its integral over k is the
    variance of height. The curvature spectrum B_l of the long waves has the shape of JONSWAP, and the curvature
    spectrum B_h of the short waves peaks at 370 rad/m.

    Parameters
    ----------
    wavenumber : ndarray
        Wavenumber k [rad/m], positive.
    wind : float
        Wind speed at a height of 10 m [m/s].

    Notes
    -----
    The drag coefficient is 1.44e-3. The slope variance exceeds Cox and Munk's by 16 % at 5 m/s and by 1 % at 14 m/s.
    Below about 2.2 m/s the fitted amount of short waves is negative; it is set to zero.

    References
    ----------
    Elfouhaily, Chapron, Katsaros and Vandemark (1997), doi:10.1029/97JC00467.

    Examples
    --------
    >>> float(elfouhaily(1.0, wind=9.0).round(5))
    0.00552
    """
    k = np.asarray(wavenumber, dtype=np.float64)
    peak = elfouhaily_peak(wind)
    ratio = np.sqrt(k / peak)
    long_speed, speed = np.sqrt(GRAVITY / peak), _eckv_speed(k)
    with np.errstate(over="ignore", under="ignore"):
        shape = np.exp(-1.25 * (peak / k) ** 2)
        shape *= 1.7 ** np.exp(-((ratio - 1) ** 2) / (2 * (0.08 * (1 + 4 * _AGE**-3)) ** 2))
        long_cut = np.exp(-_AGE / np.sqrt(10) * (ratio - 1))
        short_cut = np.exp(-0.25 * (k / _ECKV_KM - 1) ** 2)
    friction = np.log(_FRICTION * wind / _ECKV_CM)
    alpha = max(0.01 * (1 + (friction if friction < 0 else 3 * friction)), 0.0)
    b_long = 0.5 * 0.006 * np.sqrt(_AGE) * long_speed / speed * shape * long_cut
    b_short = 0.5 * alpha * _ECKV_CM / speed * shape * short_cut
    return (b_long + b_short) / k**3


def _eckv_speed(k: Floats) -> Floats:
    """Phase speed [m/s] of waves with the wavenumber k [rad/m], with Elfouhaily's constants."""
    return np.sqrt(GRAVITY / k * (1 + (k / _ECKV_KM) ** 2))


def elfouhaily_spread(wavenumber: Floats, *, wind: float) -> Floats:
    """Anisotropy D(k), 0 to 1, in Elfouhaily's directional spreading function ``(1 + D cos 2a) / (2 pi)``.

    a is the angle from the wind; `wavenumber` k is in rad/m; `wind` is the wind speed at a height of 10 m [m/s].
    """
    k = np.asarray(wavenumber, dtype=np.float64)
    speed, long_speed = _eckv_speed(k), wind / _AGE
    short = 0.13 * (_FRICTION * wind) / _ECKV_CM
    return np.tanh(np.log(2) / 4 + 4 * (speed / long_speed) ** 2.5 + short * (_ECKV_CM / speed) ** 2.5)


def spreading_norm(exponent: float, convention: Literal["half-angle", "full-angle"]) -> float:
    """Value of the normalised cos-2s directional spreading function at angle zero [1/rad]; `exponent` is s.

    With the angle a from the wind and the gamma function G, the spreading function is, for `convention` "half-angle",
    ``2**(2s-1)/pi G(s+1)**2/G(2s+1) cos(a/2)**(2s)`` on the full circle, and for "full-angle"
    ``G(s+1)/(sqrt(pi) G(s+1/2)) cos(a)**(2s)`` within 90 degrees of the wind direction.

    References
    ----------
    Longuet-Higgins, Cartwright and Smith (1963), in Ocean Wave Spectra.
    """
    from scipy.special import gammaln

    s = exponent
    if convention == "half-angle":
        return float(np.exp((2 * s - 1) * np.log(2) + 2 * gammaln(s + 1) - gammaln(2 * s + 1)) / np.pi)
    return float(np.exp(gammaln(s + 1) - gammaln(s + 0.5)) / np.sqrt(np.pi))
