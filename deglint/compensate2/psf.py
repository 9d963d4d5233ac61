"""The point spread function (PSF) of a band: what the optics, the detector and the motion make of a point of light.

Built from the sensor's optics, or taken from any kernel. Sharpening (`deglint.compensate.sharpen`) works
with it. Arrays only; it never looks at an image.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..physics.sensor import Sensor, SensorBand, cutoff
from ..physics.sensor import psf as sample_psf

Float64Array = npt.NDArray[np.float64]

MOST_TRUNCATED = 0.03
"""Share of the light that the kernel may leave out where no size is asked for."""
MAX_RADIUS = 10
"""Largest radius that is taken where no size is asked for [pixel]."""


@dataclass(frozen=True, eq=False)
class PSF:
    """A point spread function on the grid of the pixels.

    Attributes
    ----------
    wide : (side, side) float64 ndarray
        Share of a point's light in each pixel, the point in the middle of the middle pixel; sums to 1.
    radius : int
        Of `kernel`, the middle of `wide` that the filters work with [pixel].
    truncated : float
        Share of the light that falls outside `kernel`, 0..1.
    """

    wide: Float64Array = field(repr=False)
    radius: int
    truncated: float = 0.0

    def __post_init__(self) -> None:
        side = len(self.wide)
        if self.wide.shape != (side, side) or side % 2 == 0:
            raise InputError(f"a PSF must be square with an odd side; got shape {self.wide.shape}. Pad it with zeros.")
        if not np.isfinite(self.wide).all() or self.wide.min() < 0 or self.wide[side // 2, side // 2] <= 0:
            raise InputError("a PSF must be finite, nowhere negative, and positive in the middle.")
        if not 0 <= self.radius <= side // 2:
            raise InputError(f"radius of the kernel must be 0 to {side // 2}, got {self.radius}.")

    @cached_property
    def kernel(self) -> Float64Array:
        """(2 radius + 1, 2 radius + 1): the middle of the PSF, made to sum to 1."""
        middle = _middle(self.wide, self.radius)
        total = middle.sum()
        return middle if abs(total - 1) < 1e-14 * middle.size else middle / total  # a kernel is its own, to the bit

    @property
    def centre(self) -> float:
        """Share of the light in the middle pixel, 0..1."""
        half = len(self.wide) // 2
        return float(self.wide[half, half])

    def factors(self, rank: int = 1) -> list[tuple[Float64Array, Float64Array]]:
        """Pairs of arrays, down and across, the sum of whose outer products is the nearest to `kernel` of that rank.

        Scaled so that the sum of all is 1.
        """
        left, values, right = np.linalg.svd(self.kernel)
        pairs = [(left[:, i] * values[i], right[i]) for i in range(min(rank, len(values)))]
        if pairs[0][1].sum() < 0:
            pairs[0] = (-pairs[0][0], -pairs[0][1])
        total = sum(down.sum() * across.sum() for down, across in pairs)
        return [(down / total, across) for down, across in pairs]

    @property
    def inseparable(self) -> float:
        """Second over first singular value of `kernel`: 0 where one product is the kernel itself."""
        values = np.linalg.svd(self.kernel, compute_uv=False)
        return float(values[1] / values[0]) if len(values) > 1 else 0.0

    @property
    def iterations(self) -> int:
        """Richardson-Lucy iterations that sharpen without digging pits: 2, 3 where it is blurrier, 4 at most."""
        return 2 if self.centre > 0.4 else 3 if self.centre > 0.28 else 4

    def numbers(self) -> dict[str, Any]:
        """What describes it, as plain numbers, for a sidecar."""
        names = ("radius", "truncated", "centre", "inseparable", "iterations")
        return {name: getattr(self, name) for name in names}


def system_psf(
    wavelength: float,
    *,
    f_number: float,
    pitch: float,
    smear: float = 0.5,
    jitter: float = 0.0,
    size: int | None = None,
) -> PSF:
    """PSF of a band from the sensor's optics, sampled on the grid of the pixels.

    The MTF of `deglint.physics.sensor.mtf` (diffraction, detector, smear and jitter), transformed.

    Parameters
    ----------
    wavelength : float
        Centre of the band [nm].
    f_number : float
        Focal length over aperture.
    pitch : float
        Of the detector [m].
    smear : float
        Motion during the exposure, along the columns of the image [pixel].
    jitter : float
        Standard deviation of the line of sight, each axis [pixel].
    size : int, optional
        Rows and columns of the kernel, odd. By default the smallest that leaves out 3 % of the light or less, and
        21 at most.

    Returns
    -------
    PSF
        Its `truncated` says what the kernel leaves out.

    Raises
    ------
    InputError
        A number outside what the model of the optics knows, or an even size.

    Notes
    -----
    Assumes perfect optics with a round, open aperture, in focus, and one wavelength for the band. The light
    outside radius R falls as ``2 Q / (pi**2 R)``, Q = wavelength f# / pitch, so that some is always left out;
    `truncated` is right to about 1e-4. Cost: 10 to 100 ms, more where the optics
    are sharper than f/4; the last 64 are kept.

    References
    ----------
    Boreman (2001), Modulation Transfer Function in Optical and Electro-Optical Systems, doi:10.1117/3.419857.

    Examples
    --------
    >>> green = system_psf(545.0, f_number=10, pitch=8e-6)
    >>> len(green.kernel), round(green.centre, 3), round(green.truncated, 3)
    (9, 0.722, 0.028)
    """
    given = {"wavelength": wavelength, "f_number": f_number, "pitch": pitch, "smear": smear, "jitter": jitter}
    for name, value in given.items():
        if not (isinstance(value, int | float | np.number) and np.isfinite(value) and value >= 0):
            raise InputError(f"{name} must be a number, not below 0, got {value!r}. See what is known of the sensor.")
    if not 100 <= wavelength <= 20_000:
        raise InputError(f"wavelength must be 100 to 20000 nm, got {wavelength:g}. Give the centre of the band.")
    if size is not None and not (1 <= size <= 257 and size % 2):
        raise InputError(f"size of the kernel must be odd, 1 to 257, got {size}.")
    return _sampled(float(wavelength), float(f_number), float(pitch), float(smear), float(jitter), size)


@lru_cache(maxsize=64)
def _sampled(wavelength: float, f_number: float, pitch: float, smear: float, jitter: float, size: int | None) -> PSF:
    band = SensorBand(name="", low=wavelength, high=wavelength, full_scale=1.0)
    sensor = Sensor(name="", bands=(band,), gsd=1.0, f_number=f_number, pitch=pitch, smear=smear, jitter=jitter)
    blur = 1 / cutoff(sensor, wavelength)  # Q: 1 where diffraction ends at the sampling frequency
    side = max(min(64 * int(np.ceil(blur)), 256), size or 0) | 1
    oversample = int(np.clip(np.ceil(2 / blur), 2, 64))
    # what falls beyond the edges comes in again on the other side, which is right for transforms and not for shares
    wide, wider = (
        np.maximum(sample_psf(sensor, wavelength, size=n, oversample=oversample), 0.0) for n in (side, 2 * side - 1)
    )
    wide /= wide.sum()
    radius = _radius(wider) if size is None else size // 2
    wide.flags.writeable = False  # whoever asks again gets the same one
    return PSF(wide, radius, 1.0 - float(_middle(wider, radius).sum()))


def kernel_psf(kernel: npt.ArrayLike) -> PSF:
    """PSF from a kernel of one's own, as it stands but for its sum, which becomes 1.

    Parameters
    ----------
    kernel : (side, side) array_like
        Odd side, nowhere negative.

    Returns
    -------
    PSF

    Raises
    ------
    InputError
        The kernel is no PSF.

    Examples
    --------
    >>> kernel_psf([[0, 1, 0], [1, 4, 1], [0, 1, 0]]).centre
    0.5
    """
    wide = np.array(kernel, dtype=np.float64, ndmin=2)
    if not wide.size or not np.isfinite(wide).all() or wide.sum() <= 0:
        raise InputError("a PSF must be finite, nowhere negative, and positive in the middle.")
    return PSF(wide / wide.sum(), len(wide) // 2)


def _middle(wide: Float64Array, radius: int) -> Float64Array:
    half = len(wide) // 2
    inside = slice(half - radius, half + radius + 1)
    return wide[inside, inside]


def _radius(wide: Float64Array) -> int:
    """Smallest radius that leaves out little of the light."""
    for radius in range(1, MAX_RADIUS):
        if 1 - _middle(wide, radius).sum() <= MOST_TRUNCATED:
            return radius
    return MAX_RADIUS
