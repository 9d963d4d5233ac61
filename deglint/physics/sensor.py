"""Model of a sensor: modulation transfer function, electrons, noise and quantisation.

A `Sensor` describes the optics, the detector and the bands; presets are in `deglint.physics.presets`. Blur is described
by a modulation transfer function (MTF), the product of the MTFs of diffraction, detector, smear and jitter;
`deglint.physics.imaging` applies it to a scene on a grid finer than the pixels.
"""

from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from ..errors import BandError, InputError
from ._checks import Checked, Floats, ranged, within
from .tables import WAVELENGTH_RANGE

PLANCK = 6.62607015e-34  # Planck constant [J s]
LIGHT_SPEED = 299792458.0  # speed of light [m/s]


@dataclass(frozen=True, kw_only=True)
class SensorBand(Checked):
    """One band of a sensor: name, lower and upper edge [nm], full-scale radiance [W m-2 sr-1 nm-1], time offset [s].

    The exposure time is such that the full-scale radiance fills a pixel to its full-well capacity. The time offset
    is counted from the recording of the earliest band. Raises InputError for a value out of range, or if low > high.
    """

    name: str
    low: float = ranged(MISSING, 1.0, 1e6, "nm", "Give nanometres: 550 is green.")
    high: float = ranged(MISSING, 1.0, 1e6, "nm", "Give nanometres: 550 is green.")
    full_scale: float = ranged(MISSING, 1e-9, 1e9, "W m-2 sr-1 nm-1", "Give the radiance that fills the well.")
    time_offset: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.low > self.high:
            raise InputError(f"band {self.name} must have low <= high, got {self.low:g}, {self.high:g} nm. Swap them.")

    @property
    def wavelength(self) -> float:
        """Central wavelength [nm]."""
        return 0.5 * (self.low + self.high)

    @property
    def width(self) -> float:
        """Bandwidth [nm]."""
        return self.high - self.low


@dataclass(frozen=True, kw_only=True)
class Sensor(Checked):
    """Optics, detector and bands of a sensor. Raises InputError for a value out of range, BandError if it has no band.

    `gsd` is the side of a pixel on the sea [m], `pitch` that on the detector [m], `f_number` focal length over aperture
    diameter, `well` the full-well capacity [electrons], `bits` the number of bits of a digital number, 1 to 16. `smear`
    is the motion along the image columns during the exposure [pixel], `jitter` the standard deviation of the line of
    sight along each axis [pixel], `read_noise` that of the read noise [electrons]. `quantum_efficiency` is in electrons
    per photon, `transmission` is that of the optics [1], and `dark_current` is in electrons/s.
    """

    name: str
    bands: tuple[SensorBand, ...]  # in the order of the file
    gsd: float = ranged(MISSING, 1e-3, 1e4, "m", "Give the size of a pixel on the sea.")
    f_number: float = ranged(MISSING, 0.7, 200.0, "", "It is focal length over aperture.")
    pitch: float = ranged(MISSING, 1e-7, 1e-3, "m", "Give the detector pitch in metres: 8e-6 is 8 micrometres.")
    smear: float = ranged(0.5, 0.0, 1e3, "pixels", "Give the motion during the exposure, 0 for none.")
    jitter: float = ranged(0.0, 0.0, 1e3, "pixels", "It is a standard deviation, 0 for none.")
    quantum_efficiency: float = ranged(0.8, 1e-3, 1.0, "", "Give electrons per photon, such as 0.8.")
    transmission: float = ranged(0.8, 1e-3, 1.0, "", "Give the share of light that the optics transmit, such as 0.8.")
    well: float = ranged(100_000.0, 1.0, 1e9, "electrons", "Give the full-well capacity of a pixel.")
    read_noise: float = ranged(12.0, 0.0, 1e9, "electrons", "It is a standard deviation, 0 for none.")
    dark_current: float = ranged(0.0, 0.0, 1e9, "electrons/s", "Give the dark current of a pixel, 0 for none.")
    bits: int = ranged(12, 1, 16, "", "Give the bits of a digital number.", integer=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.bands:
            raise BandError(f"sensor {self.name} has no bands; give at least one")

    @property
    def levels(self) -> int:
        """Largest digital number, ``2**bits - 1``."""
        return (1 << self.bits) - 1

    def band(self, name: str) -> SensorBand:
        """Return the band with this name (case is ignored); raise BandError, which lists all bands, if none has it."""
        for b in self.bands:
            if b.name.casefold() == name.strip().casefold():
                return b
        raise BandError(f"no band {name!r} in {self.name}; it has {', '.join(b.name for b in self.bands)}")

    def exposure(self, band: SensorBand) -> float:
        """Exposure time [s] in which the full-scale radiance of the band fills the full-well capacity.

        Raises InputError if the band has no width.
        """
        if not band.width:
            raise InputError(f"band {band.name} of {self.name} is 0 nm wide, and gets no light. Give low < high.")
        return self.well / float(electrons(band.full_scale, self, band, exposure=1.0))

    def scale(self, band: SensorBand) -> float:
        """Radiance per digital number [W m-2 sr-1 nm-1]."""
        return band.full_scale / self.levels

    def delayed(self, delay: float) -> Self:
        """A copy of the sensor in which each band is recorded `delay` [s] after the band before it in `bands`."""
        return replace(self, bands=tuple(replace(b, time_offset=i * delay) for i, b in enumerate(self.bands)))


def band_means(bands: Sequence[SensorBand]) -> tuple[Floats, Callable[[Floats], Floats]]:
    """Return the wavelengths of all bands in steps of 1 nm, and a function that averages spectra over each band.

    Wavelengths outside 300 to 1000 nm, the range of the tables of light and water, are left out; BandError is raised
    for a band that lies outside this range. The wavelengths, (n,) [nm], are those of the first band, then of the
    second, and so on. The function takes values (n, ...) at them, and returns their mean over each band, (band, ...).

    >>> wavelength, mean = band_means([SensorBand(name="green", low=540, high=542, full_scale=1.0)])
    >>> mean(wavelength).tolist()
    [541.0]
    """
    first, last = WAVELENGTH_RANGE
    ranges = [np.arange(max(b.low, first), min(b.high + 0.5, np.nextafter(last, np.inf))) for b in bands]
    sizes = np.array([steps.size for steps in ranges])
    if outside := ", ".join(b.name for b, size in zip(bands, sizes, strict=True) if not size):
        raise BandError(f"band(s) {outside}: light is known from 300 to 1000 nm only; leave them out of the sensor")
    starts = np.cumsum(sizes) - sizes

    def mean(values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, starts, axis=0) / sizes.reshape(-1, *[1] * (values.ndim - 1)))

    return np.concatenate(ranges), mean


def mtf_diffraction(frequency: npt.ArrayLike) -> Floats:
    """Diffraction MTF [1] of a perfect circular aperture: ``2/pi (arccos x - x sqrt(1 - x**2))``, and 0 for x above 1.

    `frequency` x is the spatial frequency divided by the cutoff frequency of diffraction, 1 / (wavelength * f-number).

    Examples
    --------
    >>> float(mtf_diffraction(0.5).round(3))
    0.391
    """
    x = np.minimum(np.abs(np.asarray(frequency, dtype=np.float64)), 1.0)
    return np.asarray(2 / np.pi * (np.arccos(x) - x * np.sqrt(1 - x**2)))


def cutoff(sensor: Sensor, wavelength: float) -> float:
    """Cutoff frequency [cycles/pixel] at a wavelength [nm]: the diffraction MTF is 0 at this and higher frequencies."""
    return sensor.pitch / (wavelength * 1e-9 * sensor.f_number)


def mtf(row_frequency: npt.ArrayLike, column_frequency: npt.ArrayLike, sensor: Sensor, wavelength: float) -> Floats:
    """MTF [1] of the whole sensor: diffraction, detector, smear and jitter.

    ``M = mtf_diffraction(|v| / cutoff) sinc(v_r) sinc(v_c) sinc(d v_r) exp(-2 pi**2 s**2 |v|**2)``, with
    ``|v|**2 = v_r**2 + v_c**2``, the smear d and the jitter s in pixels, and ``sinc(x) = sin(pi x) / (pi x)``.
    M is 1 at zero frequency, and may be negative where v_r or v_c is above 1, or v_r above 1 / d [cycles/pixel].

    Parameters
    ----------
    row_frequency, column_frequency : array_like
        Spatial frequencies v_r along a column (in-track) and v_c along a row [cycles/pixel]; they broadcast.
    sensor, wavelength : Sensor, float
        Sensor whose optics and detector blur the image, and the wavelength [nm].

    References
    ----------
    Boreman (2001), Modulation Transfer Function in Optical and Electro-Optical Systems, doi:10.1117/3.419857.
    """
    r, c = np.asarray(row_frequency, dtype=np.float64), np.asarray(column_frequency, dtype=np.float64)
    squared = r**2 + c**2
    out = mtf_diffraction(np.sqrt(squared) / cutoff(sensor, wavelength))
    out = out * np.sinc(r) * np.sinc(c) * np.sinc(sensor.smear * r)
    return np.asarray(out * np.exp(-2 * np.pi**2 * sensor.jitter**2 * squared))


def psf(sensor: Sensor, wavelength: float, *, size: int = 33, oversample: int = 8) -> Floats:
    """Point spread function (PSF): share [1] of the light of a point source that each pixel receives, (size, size).

    The source is at the centre of the central pixel. Light beyond an edge is added at the opposite edge: the sum is 1.

    Parameters
    ----------
    sensor, wavelength : Sensor, float
        Sensor whose optics and detector blur the image, and the wavelength [nm].
    size : int
        Number of rows and of columns of the result, odd, 3 to 1023; an even number is increased by 1.
    oversample : int
        The MTF is used up to the frequency oversample / 2 [cycles/pixel]; 2 to 64.

    Examples
    --------
    >>> from deglint.physics.presets import preset
    >>> float(psf(preset("thesis"), 545.0)[16, 16].round(3))
    0.722
    """
    within("size", size, 3, 1023, "", "Give an odd number of pixels.")
    within("oversample", oversample, 2, 64, "", "8 is enough for f/2.8.")
    size |= 1
    count = size * oversample
    frequency = np.arange(count // 2 + 1) / size  # an MTF is symmetric: a quarter of it is enough
    away = np.arange(size // 2 + 1)
    waves = np.cos(2 * np.pi / size * (away[:, None] * np.arange(len(frequency)) % size))
    weight = np.where((frequency > 0) & (2 * np.arange(len(frequency)) < count), 2.0, 1.0) / size
    quarter = mtf(frequency[:, None], frequency[None, :], sensor, wavelength)
    both = np.concatenate([away[:0:-1], away])
    return ((waves * weight) @ quarter @ (waves * weight).T)[np.ix_(both, both)]


def electrons(radiance: npt.ArrayLike, sensor: Sensor, band: SensorBand, *, exposure: float | None = None) -> Floats:
    """Electrons in a pixel, in the shape of `radiance`, not limited to the full-well capacity (Fink 2014, eq. 2.23).

    ``N = pi A t QE tau L lambda dlambda / (4 f#**2 h c)``: detector area A, exposure time t, quantum efficiency QE,
    transmission tau, central wavelength lambda, bandwidth dlambda, f-number f#, Planck constant h, speed of light c.

    Parameters
    ----------
    radiance : array_like
        Radiance L at the central wavelength of the band [W m-2 sr-1 nm-1].
    sensor, band : Sensor, SensorBand
        The sensor, and one of its bands.
    exposure : float, optional
        Exposure time [s]; by default `Sensor.exposure` of the band.
    """
    exposure = sensor.exposure(band) if exposure is None else exposure
    photon_energy = PLANCK * LIGHT_SPEED / (band.wavelength * 1e-9)
    in_band = np.asarray(radiance, dtype=np.float64) * band.width
    efficiency = sensor.quantum_efficiency * sensor.transmission / (4 * sensor.f_number**2)
    return np.asarray(np.pi * sensor.pitch**2 * exposure * efficiency * in_band / photon_energy)


def noise(signal: npt.ArrayLike, sensor: Sensor, *, exposure: float) -> Floats:
    """Standard deviation s of the noise of a pixel [electrons]: shot, dark, read and quantisation noise.

    ``s**2 = N + N_dark + s_read**2 + (well / levels)**2 / 12``, with the `signal` N, the dark signal N_dark in the
    time `exposure` [s], and the standard deviation s_read of the read noise, all in electrons.
    """
    fixed = sensor.dark_current * exposure + sensor.read_noise**2 + (sensor.well / sensor.levels) ** 2 / 12
    return np.sqrt(np.asarray(signal, dtype=np.float64) + fixed)


def noise_equivalent_radiance(
    radiance: npt.ArrayLike, sensor: Sensor, band: SensorBand, *, exposure: float | None = None
) -> Floats:
    """Noise as a radiance [W m-2 sr-1 nm-1], ``L s / N``, at the given `radiance` L [W m-2 sr-1 nm-1].

    N is the result of `electrons`, s that of `noise`. `exposure` [s] is by default `Sensor.exposure` of the band.
    """
    exposure = sensor.exposure(band) if exposure is None else exposure
    per_radiance = electrons(1.0, sensor, band, exposure=exposure)
    return np.asarray(noise(per_radiance * np.asarray(radiance), sensor, exposure=exposure) / per_radiance)


def digitise(
    radiance: npt.ArrayLike, sensor: Sensor, band: SensorBand, *, generator: np.random.Generator | None = None
) -> npt.NDArray[np.uint16]:
    """Convert radiance to the digital numbers of a band, with noise and quantisation; the dark signal is subtracted.

    `radiance` [W m-2 sr-1 nm-1] is already blurred by optics and detector. `generator` draws shot, dark and read
    noise; without it, there is only quantisation. Digital numbers are 0 to ``2**bits - 1``, in the shape of `radiance`.
    Multiplied by `Sensor.scale`, they are radiance again. Radiance above the full-scale radiance is clipped.
    """
    count = np.asarray(np.maximum(electrons(radiance, sensor, band), 0.0))
    if generator is not None:
        dark = sensor.dark_current * sensor.exposure(band)
        count = np.asarray(generator.poisson(np.minimum(count, 8 * sensor.well) + dark) - dark)
        count += sensor.read_noise * generator.standard_normal(count.shape)
    count *= sensor.levels / sensor.well
    return np.rint(np.clip(count, 0, sensor.levels, out=count), out=count).astype(np.uint16)
