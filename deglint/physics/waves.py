"""The wind sea: its wave spectrum, and the variances of slopes that follow from it.

A `Sea` defines spectrum, wind and directional spreading; functions compute its statistics by numerical integration.
`deglint.physics.surface` draws random surfaces of a `Sea`; `deglint.physics.spectra` has the formulas of the spectra.

Wavenumbers are in rad/m, frequencies in Hz. Wind speeds are those at a height of 10 m unless a name says otherwise. The
azimuth of the wind is where it blows from, clockwise from north; waves travel in the opposite direction.
"""

from dataclasses import MISSING, dataclass
from typing import Literal, get_args

import numpy as np

from ..errors import InputError
from . import spectra
from ._checks import Checked, Floats, one_of, ranged
from .spectra import GRAVITY, SURFACE_TENSION, WIND_19_5, dispersion

WaveSpectrum = Literal["elfouhaily", "jonswap", "pierson-moskowitz"]
Spreading = Literal["elfouhaily", "half-angle", "full-angle"]

SPECTRA_WIND_RANGE = (1.0, 20.0)  # range of 10 m winds for which the spectra were fitted [m/s]
SHORTEST_WAVE = 0.003
"""Default shortest wave in slope integrals [m]; Elfouhaily's spectrum is negligible at shorter waves."""
SHORT_WAVES = 10.0  # waves with more than this multiple of the peak wavenumber are "short" (see `Sea.short_gain`)


@dataclass(frozen=True, kw_only=True)
class Sea(Checked):
    """A wind sea: wind, wave spectrum and directional spreading.

    Attributes
    ----------
    wind, wind_from, fetch : float
        Wind speed at a height of 10 m [m/s], 1 to 20; azimuth that the wind blows from [degree]; distance over which
        the wind has blown [m], which only JONSWAP uses.
    spectrum, spreading : str
        Wave spectrum, one of `WaveSpectrum`; directional spreading, one of `Spreading`, by default "elfouhaily" for the
        spectrum of that name, else "half-angle".
    exponent, opposing, short_gain : float
        Exponent s of the cos-2s spreadings "half-angle" and "full-angle"; share of the energy that goes upwind in the
        spreading "elfouhaily", 0 to 0.5; factor on the energy of short waves (see `SHORT_WAVES`) [1].
    """

    wind: float = ranged(MISSING, *SPECTRA_WIND_RANGE, "m/s", "The wave spectra hold in this range only.")
    wind_from: float = ranged(0.0, -720.0, 720.0, "degrees", "Give the azimuth it blows from.")
    spectrum: WaveSpectrum = one_of("elfouhaily", get_args(WaveSpectrum))
    fetch: float = ranged(100e3, 1e3, 2e6, "m", "Give over which distance the wind has blown; it is for JONSWAP only.")
    spreading: Spreading | None = one_of(None, (None, *get_args(Spreading)))
    exponent: float = ranged(2.0, 0.5, 100.0, "", "It is the s of cos-2s; 2 is as wide as Cox and Munk at 9 m/s.")
    opposing: float = ranged(0.0, 0.0, 0.5, "", "It is the share of the energy that Elfouhaily's waves carry upwind.")
    short_gain: float = ranged(1.0, 0.0, 1e3, "", "Give a factor on the energy of short waves; 1: unchanged.")

    @property
    def peak_wavenumber(self) -> float:
        """Wavenumber of the spectral peak [rad/m]."""
        if self.spectrum == "elfouhaily":
            return spectra.elfouhaily_peak(self.wind)
        if self.spectrum == "jonswap":
            peak = spectra.jonswap_peak(wind=self.wind, fetch=self.effective_fetch)
        else:
            peak = spectra.pierson_moskowitz_peak(wind_19_5=WIND_19_5 * self.wind)
        return (2 * np.pi * peak) ** 2 / GRAVITY

    @property
    def effective_fetch(self) -> float:
        """The smaller of `fetch` and the fetch of a fully developed sea [m]."""
        return min(self.fetch, spectra.developed_fetch(self.wind))

    @property
    def peak_wavelength(self) -> float:
        """Wavelength of the spectral peak [m]."""
        return 2 * np.pi / self.peak_wavenumber


def omnidirectional(wavenumber: Floats, sea: Sea) -> Floats:
    """Omnidirectional spectral density of height [m3] of `sea` at wavenumbers [rad/m], with its `short_gain`.

    A frequency spectrum E(f) is converted by ``S(k) = E(f) dw/dk / (2 pi)``, with the result w(k) of `dispersion`.
    """
    k = np.asarray(wavenumber, dtype=np.float64)
    if sea.spectrum == "elfouhaily":
        density = spectra.elfouhaily(k, wind=sea.wind)
    else:
        w = dispersion(k)
        f = w / (2 * np.pi)
        if sea.spectrum == "jonswap":
            energy = spectra.jonswap(f, wind=sea.wind, fetch=sea.effective_fetch)
        else:
            energy = spectra.pierson_moskowitz(f, wind_19_5=WIND_19_5 * sea.wind)
        density = energy * (GRAVITY + 3 * SURFACE_TENSION * k**2) / (2 * w) / (2 * np.pi)
    return np.where(k > SHORT_WAVES * sea.peak_wavenumber, sea.short_gain, 1.0) * density


def spread_convention(sea: Sea) -> Spreading:
    """Name of the directional spreading function of `sea`: its `spreading`, or the default for its spectrum."""
    return sea.spreading or ("elfouhaily" if sea.spectrum == "elfouhaily" else "half-angle")


def anisotropy(wavenumber: Floats, sea: Sea) -> Floats:
    """Energy-weighted mean of cos(2a) over the waves of a wavenumber [rad/m]; a is the angle between wave and wind.

    The mean is 0 for isotropic waves, and 1 if all waves travel along the wind. It is `spectra.elfouhaily_spread` / 2
    for the spreading "elfouhaily", ``s (s-1) / ((s+1)(s+2))`` for "half-angle", and ``s / (s+1)`` for "full-angle".
    """
    k = np.asarray(wavenumber, dtype=np.float64)
    convention, s = spread_convention(sea), sea.exponent
    if convention == "elfouhaily":
        return 0.5 * spectra.elfouhaily_spread(k, wind=sea.wind)
    return np.full_like(k, s * (s - 1) / ((s + 1) * (s + 2)) if convention == "half-angle" else s / (s + 1))


def wavenumbers(sea: Sea, *, longest: float | None = None, shortest: float = SHORTEST_WAVE) -> Floats:
    """Wavenumbers (4001,) [rad/m] in even logarithmic steps for integrals over the waves between two wavelengths [m].

    `longest` is by default ten times the peak wavelength. Raises InputError if `shortest` is not in (0, `longest`).
    """
    low = sea.peak_wavenumber / 10 if longest is None else 2 * np.pi / longest
    if not shortest > 0 or 2 * np.pi / shortest <= low:
        raise InputError(f"shortest must be above 0 m and below {2 * np.pi / low:.3g} m, got {shortest:g} m")
    return np.geomspace(low, 2 * np.pi / shortest, 4001)


def slope_variance(sea: Sea, *, longest: float | None = None, shortest: float = SHORTEST_WAVE) -> tuple[float, float]:
    """Variances of upwind and crosswind slope [1] due to waves from `shortest` to `longest` [m], as in `wavenumbers`.

    Examples
    --------
    >>> up, cross = slope_variance(Sea(wind=9.0), shortest=0.2)
    >>> round(up + cross, 3)
    0.028
    """
    from scipy.integrate import trapezoid  # numpy has it from version 2.0 on

    k = wavenumbers(sea, longest=longest, shortest=shortest)
    density = omnidirectional(k, sea) * k**3
    total = float(trapezoid(density, np.log(k)))
    excess = float(trapezoid(density * anisotropy(k, sea), np.log(k)))
    return 0.5 * (total + excess), 0.5 * (total - excess)
