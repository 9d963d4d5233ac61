"""The f-number of the optics from the image itself, where nobody has written it down.

Sparkle is smaller than a pixel, so the spectrum of the image falls off as the optics' MTF does, down to the noise. How
far it falls grows with wavelength, and by that the optics are told from the size of the sparkle, which is the same in
all bands. Works from a few sampled tiles. Arrays only.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..physics.sensor import mtf_diffraction
from .psf import Float64Array

CELL = 32
"""Side of the squares whose spectra are taken [pixel]."""
LOWEST = 0.15
"""Frequencies below this are left to waves and clouds [cycles/pixel]."""
COPIES = 2
"""Aliases are counted up to so many sampling frequencies away."""
BLURS = (0.25, 5.0)
"""Wavelength times f-number over pitch that is looked for, of the longest wavelength."""
STEEPEST = 4.0
"""Largest exponent with which the spectrum of the glint itself may fall."""
LEAST_CELLS = 16
WORST = 0.15
"""Relative standard error above which the f-number cannot be told."""
LEAST_SIGNAL = 0.5
"""Glint over noise at the lowest frequencies in use, below which there is no glint to tell anything by."""


@dataclass(frozen=True, eq=False)
class Spectra:
    """Power spectra of squares of the image; those of several tiles may be merged.

    Attributes
    ----------
    power : (cell, band, 32, 17) float64 ndarray
        Each divided by its own mean above the lowest frequency in use.
    """

    power: Float64Array

    @classmethod
    def merge(cls, parts: Iterable[Spectra]) -> Spectra:
        """The squares of all parts.

        Raises
        ------
        InputError
            There are no parts, or they differ in their bands.
        """
        parts = list(parts)
        if not parts or len({p.power.shape[1] for p in parts}) > 1:
            raise InputError("spectra to merge must be at least one, all of the same bands.")
        return cls(np.concatenate([p.power for p in parts]))


@dataclass(frozen=True)
class OpticsEstimate:
    """What the image tells of the optics.

    Attributes
    ----------
    f_number : float, optional
        Focal length over aperture; None where it cannot be told.
    error : float
        Its standard error (NaN where there is none).
    exponent, exponent_error : float
        With which the glint's own spectrum falls with frequency, 0 for points, and its standard error.
    cells : int
        Squares of 32 x 32 pixels that were used.
    reason : str
        What was found, or why nothing, in one line.
    """

    f_number: float | None
    error: float
    exponent: float
    exponent_error: float
    cells: int
    reason: str

    def numbers(self) -> dict[str, Any]:
        """Everything as plain numbers, for a sidecar."""
        return asdict(self)


def glint_spectra(block: npt.NDArray[Any]) -> Spectra:
    """Power spectra of the squares of a tile.

    Parameters
    ----------
    block : (band, row, column) ndarray
        Any unit; NaN is not valid, and squares that hold any are left out.

    Returns
    -------
    Spectra

    Notes
    -----
    Squares of 32 x 32 pixels under a Hann window. Cost: about 60 ns a pixel and band.
    """
    if block.ndim != 3:
        raise InputError(f"a block must be (band, row, column); got an array of shape {block.shape}")
    down, across = (n // CELL for n in block.shape[1:])
    cells = block[:, : down * CELL, : across * CELL].reshape(len(block), down, CELL, across, CELL)
    cells = cells.transpose(1, 3, 0, 2, 4).reshape(down * across, len(block), CELL, CELL).astype(np.float64)
    cells = cells[np.isfinite(cells).all(axis=(1, 2, 3))]
    window = np.hanning(CELL + 2)[1:-1]
    cells -= cells.mean(axis=(2, 3), keepdims=True)
    power = np.abs(np.fft.rfft2(cells * np.outer(window, window))) ** 2
    level = power[:, :, _grid()[2]].mean(axis=2)
    told = (level > 0).all(axis=1)
    return Spectra(power[told] / level[told][:, :, None, None])


def estimate_optics(
    spectra: Spectra, wavelengths: Sequence[float], *, pitch: float, smear: float = 0.5
) -> OpticsEstimate:
    """The f-number that explains how the spectra of all bands fall off, by maximum likelihood.

    .. math:: S_b(v) = A_b \\sum_k |M_b(v + k)|^2 |v + k|^{-g} + N_b

    with M the MTF of the sensor, k whole sampling frequencies (aliases), g the same for all bands. Minimises Whittle's
    ``sum(I / S + log S)`` over the f-number, g, and A and N of every band, with S as it is expected under the window
    (Sykulski et al. 2019).

    Parameters
    ----------
    spectra : Spectra
        Of sampled tiles with glint.
    wavelengths : sequence of float
        Of the bands [nm].
    pitch : float
        Of the detector [m]. If it is not known, any value gives a PSF that is right in pixels.
    smear : float
        Motion during the exposure, along the columns [pixel].

    Returns
    -------
    OpticsEstimate
        `f_number` is None where the glint does not stand out of the noise, where the bands' blur cannot be told
        from the size of the sparkle, or where the standard error is above 15 %.

    Raises
    ------
    InputError
        Wavelengths that are not one a band, or a number out of range.

    Notes
    -----
    The standard error is that of the Fisher information with the scatter between squares (sandwich), since sparkle is
    far from Gaussian; with fewer than 40 squares it is too large by up to a half. The power law is not quite the
    glint's: f-numbers came out 2 to 10 % too small on simulated seas at 2 to 12 m/s, which is not in the error. Assumes
    perfect optics and sparkle of the same kind in all bands; defocus and resampled products raise the f-number. Sharp
    optics (wavelength times f-number well below the pitch) cannot be told, and need not be known. Cost: below 1 s.

    References
    ----------
    Whittle, P. (1953), "Estimation and information in stationary time series", Ark. Mat. 2, 423-434,
    doi:10.1007/BF02590998. Sykulski, A. M. et al. (2019), "The debiased Whittle likelihood", Biometrika 106, 251-266,
    doi:10.1093/biomet/asy071.
    """
    if len(wavelengths) != spectra.power.shape[1]:
        raise InputError(
            f"{len(wavelengths)} wavelengths are given for {spectra.power.shape[1]} bands; give one a band"
        )
    if not all(100 <= w <= 20_000 for w in wavelengths) or not pitch > 0 or not 0 <= smear < 100:
        raise InputError(
            f"wavelengths must be 100 to 20000 nm, pitch above 0 m, smear 0 to 100 pixels; got "
            f"{', '.join(f'{w:g}' for w in wavelengths)}; {pitch:g}; {smear:g}."
        )
    cells = len(spectra.power)
    if cells < LEAST_CELLS:
        return _untold(cells, f"{cells} squares of {CELL} x {CELL} px are too few: {LEAST_CELLS} are needed")
    used = _grid()[2]
    power = spectra.power[:, :, used]
    fitted = _Falloff(power.mean(axis=0), np.asarray(wavelengths, float), smear)
    place = fitted.best()
    signal, noise = fitted.levels(place)
    error, exponent_error = np.sqrt(np.maximum(np.diag(fitted.covariance(place, power))[:2], 0))
    f_number = float(np.exp(place[0])) * pitch / (max(wavelengths) * 1e-9)
    if np.median(signal / (signal + noise)) < LEAST_SIGNAL / (1 + LEAST_SIGNAL):
        return _untold(cells, "no glint that stands out of the noise")
    if not fitted.inside(place):
        return _untold(cells, "the blur of the optics and the size of the sparkle look alike here")
    if not error < WORST:
        return _untold(cells, f"f/{f_number:.3g} with a standard error of {100 * error:.0f} % is not known well enough")
    reason = f"f/{f_number:.3g} +- {error * f_number:.2g} for a pitch of {1e6 * pitch:.3g} um"
    return OpticsEstimate(f_number, float(error * f_number), float(place[1]), float(exponent_error), cells, reason)


def _untold(cells: int, why: str) -> OpticsEstimate:
    return OpticsEstimate(None, np.nan, np.nan, np.nan, cells, f"cannot be told: {why}")


def _grid() -> tuple[Float64Array, Float64Array, npt.NDArray[np.bool_]]:
    """Frequencies down and across, and which of the half plane are in use."""
    down, across = np.meshgrid(np.fft.fftfreq(CELL), np.fft.rfftfreq(CELL), indexing="ij")
    return down, across, np.hypot(down, across) >= LOWEST


class _Falloff:
    """Whittle's likelihood of mean spectra; levels of glint and noise are found for each place (log Q, exponent)."""

    def __init__(self, mean: Float64Array, wavelengths: Float64Array, smear: float) -> None:
        _, across, self.used = _grid()
        self.mean = mean
        self.relative = wavelengths / wavelengths.max()
        self.weight = np.where((across == 0) | (across == 0.5), 0.5, 1.0)[self.used]  # the others stand for two
        side = 2 * CELL
        copies = np.arange(-COPIES, COPIES + 1)
        r = (np.fft.fftfreq(side)[:, None] + copies).reshape(side, 1, -1, 1)
        c = (np.fft.rfftfreq(side)[:, None] + copies).reshape(1, CELL + 1, 1, -1)
        self.radius = np.hypot(r, c)
        self.detector = (np.sinc(r) * np.sinc(c) * np.sinc(smear * r)) ** 2
        window = np.hanning(CELL + 2)[1:-1]
        lags = np.fft.irfft(np.abs(np.fft.rfft(window / np.linalg.norm(window), side)) ** 2, side)
        self.lags = np.outer(lags, lags)

    def shapes(self, place: Float64Array) -> Float64Array:
        """(band, frequency): spectrum of the glint with A = 1, as the window shows it."""
        glint = self.detector * (np.maximum(self.radius, LOWEST / 3) / 0.3) ** -place[1]
        blur = np.exp(place[0]) * self.relative
        full = np.stack([self._passed(glint, q) for q in blur])
        seen = np.fft.rfft2(np.fft.irfft2(full, s=self.lags.shape) * self.lags).real
        return np.asarray(seen[:, ::2, ::2][:, self.used])

    def _passed(self, glint: Float64Array, blur: float) -> Float64Array:
        """What the optics leave of the glint, aliases and all; beyond the cutoff that is nothing."""
        frequency, out = self.radius * blur, np.zeros_like(glint)
        inside = frequency < 1.0
        if 3 * np.count_nonzero(inside) > inside.size:  # to pick them out would take longer than it saves
            return np.asarray((glint * mtf_diffraction(frequency) ** 2).sum(axis=(2, 3)))
        out[inside] = glint[inside] * mtf_diffraction(frequency[inside]) ** 2
        return np.asarray(out.sum(axis=(2, 3)))

    def levels(self, place: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Glint, where it is strongest among the frequencies in use, and noise of every band."""
        shapes = self.shapes(place)
        signal, noise = self._solve(shapes)
        return signal * shapes.max(axis=1), noise

    def _solve(self, shapes: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Least squares weighted by 1 / S**2, with S from the step before: Fisher scoring, none below 0."""
        spectrum = 0.5 * (self.mean.mean(axis=1, keepdims=True) + self.mean)
        for _ in range(12):
            w = self.weight / spectrum**2
            aa, an, nn = (w * shapes**2).sum(axis=1), (w * shapes).sum(axis=1), w.sum(axis=1)
            ya, yn = (w * shapes * self.mean).sum(axis=1), (w * self.mean).sum(axis=1)
            determinant = np.maximum(aa * nn - an**2, 1e-300)
            signal, noise = (ya * nn - yn * an) / determinant, (yn * aa - ya * an) / determinant
            noise = np.where(signal < 0, yn / nn, noise)
            signal = np.where(noise < 1e-6, ya / aa, np.maximum(signal, 0.0))
            noise = np.maximum(noise, 1e-6)
            spectrum = signal[:, None] * shapes + noise[:, None]
        return signal, noise

    def cost(self, place: Float64Array) -> float:
        """Whittle's -log likelihood of a square, with glint and noise at the levels that suit best."""
        shapes = self.shapes(place)
        signal, noise = self._solve(shapes)
        spectrum = signal[:, None] * shapes + noise[:, None]
        return float((self.weight * (self.mean / spectrum + np.log(spectrum))).sum())

    def best(self) -> Float64Array:
        """Where the likelihood is greatest."""
        from scipy.optimize import minimize

        bounds = [tuple(np.log(BLURS)), (-1.0, STEEPEST)]
        starts = [(np.log(q), g) for q in (0.5, 1.0, 2.0, 3.5) for g in (0.0, 1.5)]
        start = min(starts, key=lambda p: self.cost(np.array(p)))
        options = {"xatol": 1e-4, "fatol": 1e-7}
        return np.asarray(minimize(self.cost, start, method="Nelder-Mead", bounds=bounds, options=options).x)

    def inside(self, place: Float64Array) -> bool:
        """Whether it is no edge of what was looked for."""
        low, high = np.log(BLURS)
        return bool(low + 0.01 < place[0] < high - 0.01 and -0.99 < place[1] < STEEPEST - 0.01)

    def covariance(self, place: Float64Array, power: Float64Array) -> Float64Array:
        """Of (log Q, exponent, A of every band, N of every band): H^-1 J H^-1."""
        shapes = self.shapes(place)
        signal, noise = self._solve(shapes)
        spectrum = signal[:, None] * shapes + noise[:, None]
        bands = len(shapes)
        slopes = np.zeros((2 + 2 * bands, *shapes.shape))
        for i, step in enumerate(np.eye(2) * 1e-4):
            slopes[i] = signal[:, None] * (self.shapes(place + step) - self.shapes(place - step)) / 2e-4
        for b in range(bands):
            slopes[2 + b, b] = shapes[b]
            slopes[2 + bands + b, b] = 1.0
        relative = (slopes / spectrum).reshape(len(slopes), -1)
        weight = np.broadcast_to(self.weight, shapes.shape).ravel()
        information = (relative * weight) @ relative.T
        away = ((power - self.mean) / spectrum).reshape(len(power), -1)
        scores = away @ (relative * weight).T
        inverse = np.linalg.pinv(information, hermitian=True)
        scatter = scores.T @ scores / (len(power) * (len(power) - 1))
        return np.asarray(inverse @ scatter @ inverse)
