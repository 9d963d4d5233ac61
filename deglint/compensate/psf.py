"""The point spread function (PSF) of a band: the image of a point source, blurred by optics, detector and motion."""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from ..errors import InputError
from ..moments import Float64
from ..physics._checks import check_quantity
from ..physics.sensor import Sensor, SensorBand, cutoff
from ..physics.sensor import psf as sample_psf

MOST_TRUNCATED = 0.03
"""Largest share of the light outside the kernel: it has less effect than an error of 5 % in the f-number."""
MAX_RADIUS = 10  # largest radius of a kernel [pixel]: the light outside decreases as 1 / radius, while the cost grows

TYPICAL = 6.0, 8e-6
"""f-number and detector pitch [m] of typical optics. The diffraction cutoff in the red is twice the sampling frequency;
in cameras of satellites, aircraft and drones it is one to two times the sampling frequency."""


@dataclass(frozen=True, eq=False)
class PSF:
    """A point spread function on the grid of the pixels.

    The kernel (side, side) is the share of light in each pixel, for a point source at the centre of the central pixel.
    Raises InputError unless the kernel is square, odd-sided, finite, >= 0, > 0 in the middle, and sums to 1 within 3 %.
    """

    kernel: Float64 = field(repr=False)

    def __post_init__(self) -> None:
        side, shape = len(self.kernel), self.kernel.shape
        if shape != (side, side) or side % 2 == 0:
            raise InputError(f"a PSF must be square with an odd side, such as (9, 9), got {shape}. Pad it with zeros.")
        if not np.isfinite(self.kernel).all() or self.kernel.min() < 0 or self.kernel[side // 2, side // 2] <= 0:
            raise InputError("a PSF must be finite, nowhere negative, and positive in the middle.")
        if abs((total := float(self.kernel.sum())) - 1) > MOST_TRUNCATED:
            raise InputError(f"a PSF must sum to 1, got {total:.3g}. Divide the kernel by its sum.")

    @property
    def radius(self) -> int:
        """Radius of the kernel [pixel]: ``(side - 1) / 2``."""
        return len(self.kernel) // 2

    @cached_property
    def factors(self) -> list[tuple[Float64, Float64]]:
        """Pairs of vectors (down, across), (side,) each, whose outer products add up to the kernel; the largest first.

        The first n pairs are the least-squares approximation of the kernel by n outer products.
        """
        left, values, right = np.linalg.svd(self.kernel)
        return list(zip((left * values).T, right, strict=True))


def system_psf(wavelength: float, *, f_number: float, pitch: float, smear: float = 0.5) -> PSF:
    """PSF of a band from the sensor's optics: the Fourier transform of its MTF (`deglint.physics.sensor.mtf`).

    wavelength : centre of the band [nm]
    f_number : focal length divided by the diameter of the aperture
    pitch : distance between the centres of neighbouring detector elements [m]
    smear : motion during the exposure, along the columns of the image [pixel]

    Returns the smallest kernel with at most 3 % of the light outside it, but at most 21 pixels wide. The optics are
    assumed to be perfect and in focus, with a round, unobstructed aperture, and the band to have one wavelength. The
    share of the light outside radius R [pixel] is about ``2 Q / (pi**2 R)`` with Q = wavelength * f_number / pitch.

    Raises InputError if a number is outside the range of the model of the optics.

    Boreman (2001), Modulation Transfer Function in Optical and Electro-Optical Systems, doi:10.1117/3.419857.

    Examples
    --------
    >>> green = system_psf(545.0, f_number=10, pitch=8e-6)
    >>> green.kernel.shape
    (9, 9)
    """
    check_quantity("wavelength", wavelength, 100, 20_000, "nm", "Give the centre of the band.")
    band = SensorBand(name="", low=wavelength, high=wavelength, full_scale=1.0)
    return _sampled(Sensor(name="", bands=(band,), gsd=1.0, f_number=f_number, pitch=pitch, smear=smear))


def typical_psf(wavelength: float) -> PSF:
    """PSF for unknown optics, for a band with its centre at `wavelength` [nm].

    The typical PSF is narrow, as a PSF that is too wide causes ringing (see `richardson_lucy`). It is still too wide if
    the true PSF is narrower by a third or more. For seven seas, simulated with f/10 and f/30, the error after
    sharpening with the typical PSF is 13 % larger than with the true PSF; without sharpening it is 39 % larger.
    """
    return system_psf(wavelength, f_number=TYPICAL[0], pitch=TYPICAL[1])


@lru_cache(maxsize=64)
def _sampled(sensor: Sensor) -> PSF:
    """The PSF that `system_psf` returns, for a sensor with one band; results are cached."""
    wavelength = sensor.bands[0].wavelength
    blur = 1 / cutoff(sensor, wavelength)  # Q: 1 where diffraction ends at the sampling frequency
    side = 2 * min(64 * int(np.ceil(blur)), 256) + 1  # light from beyond wraps around; it is negligible
    oversample = int(np.clip(np.ceil(2 / blur), 2, 64))
    wide = np.maximum(sample_psf(sensor, wavelength, size=side, oversample=oversample), 0.0)
    for radius in range(1, MAX_RADIUS + 1):
        middle = slice(side // 2 - radius, side // 2 + radius + 1)
        kernel = wide[middle, middle]
        if kernel.sum() >= 1 - MOST_TRUNCATED:
            break
    kernel = kernel / kernel.sum()
    kernel.flags.writeable = False  # the next caller gets the same array
    return PSF(kernel)
