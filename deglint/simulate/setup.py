"""All parameters of a synthetic scene (`Setup`), and series of setups for experiments."""

from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from itertools import product
from typing import Literal, get_args

import numpy as np

from ..errors import InputError
from ..physics._checks import Checked, check_quantity, one_of, ranged
from ..physics.atmosphere import CLEAR_AIR, Air
from ..physics.presets import preset
from ..physics.sensor import Sensor
from ..physics.sky import SKY_MODELS as SKIES
from ..physics.slopes import variances, wind_at_height
from ..physics.waves import SHORT_WAVES, SPECTRA_WIND_RANGE, Sea, Spreading, WaveSpectrum, slope_variance
from .artefacts import Artefacts
from .materials import SPECTRA
from .underwater import Bottom, SubmergedObject

SlopeModelName = Literal["cox-munk", "cox-munk-gaussian"]

MOST_FACETS = 1 << 26  # largest number of facets of a scene; at 60 bytes each they take 4 GB
LEAST_ENERGY = 0.3  # smallest factor on the energy of damped short waves; `Facets` scales slopes that remain too steep
RESOLVED_AT_MOST = 0.95
"""Largest share of the measured slope variance that waves on the grid may have; short waves are damped accordingly."""
STRONGEST_WIND = 19.6  # largest wind at 10 m [m/s]: it is 20 m/s at 12.5 m, the limit of the slope models
EDGE_MARGIN = 16  # columns added to an image with a coast or a bottom [pixel]; else blur mixes left and right edge

WINDS = (2.0, 5.0, 9.0, 12.0)  # wind speeds of `experiments` [m/s]
DELAYS = (0.0, 0.010, 0.060)  # delays of `experiments` from each band to the next [s]
GEOMETRIES = ((0.0, 0.0), (20.0, 180.0), (40.0, 180.0), (40.0, 90.0), (40.0, 0.0))
"""Viewing geometries of `experiments`: view zenith, and azimuth of the sensor minus azimuth of the sun [degree]."""
F_NUMBERS = (10.0, 30.0)  # f-numbers of `experiments`


@dataclass(frozen=True, kw_only=True)
class FloatingTarget(Checked):
    """A floating boat, swimmer or buoy that moves in a straight line.

    Attributes
    ----------
    right, down : float
        Position of the target's centre at the time of the earliest band, from the upper left corner of the image [m].
    length, width : float
        Size of the hull [m].
    speed, heading : float
        Speed [m/s], and azimuth of the motion and of the bow [degree], clockwise from north (up in the image).
    material, wake : str, float
        Material of the hull, a key of `deglint.simulate.materials.SPECTRA`; length of the foam wake [m].
    """

    right: float = ranged(MISSING, -1e6, 1e6, "m", "Give its position.")
    down: float = ranged(MISSING, -1e6, 1e6, "m", "Give its position.")
    length: float = ranged(8.0, 0.05, 500.0, "m", "Give the size of the hull.")
    width: float = ranged(2.5, 0.05, 500.0, "m", "Give the size of the hull.")
    speed: float = ranged(0.0, 0.0, 50.0, "m/s", "One knot is 0.514 m/s; turn the heading to go back.")
    heading: float = ranged(0.0, -360.0, 360.0, "degrees", "Give an azimuth from north.")
    material: str = one_of("paint", SPECTRA)
    wake: float = ranged(0.0, 0.0, 5000.0, "m", "Give the length of the wake.")


@dataclass(frozen=True, kw_only=True)
class Setup(Checked):
    """All parameters of a synthetic scene. Raises InputError if a value is not allowed, or does not fit the others.

    Attributes
    ----------
    sensor : Sensor
        Sensor with its bands, their time offsets and the ground sampling distance.
    size : (int, int)
        Rows and columns of the image [pixel].
    wind, wind_from : float
        Wind speed at 10 m [m/s], and azimuth that the wind blows from [degree].
    spectrum, fetch, spreading, exponent, opposing
        Parameters of the waves; see `deglint.physics.waves.Sea`.
    slopes : {"cox-munk", "cox-munk-gaussian"}
        Slope distribution of the mean glint: by Cox and Munk, with or without ("-gaussian") its Gram-Charlier series.
    sun_zenith, sun_azimuth, view_zenith, view_azimuth : float
        Zenith angles and azimuths of the sun and of the sensor, as seen from the sea surface [degree].
    sky : {"uniform", "cardioidal", "harrison-coombes"}
        Model of the sky radiance. Only the clear sky, "harrison-coombes", has a glow around the sun; the reflection of
        this glow in the sea looks like sun glint.
    air : Air, optional
        State of the atmosphere; by default humidity 80 %, visibility 40 km, water vapour 2.5 cm, winds equal to `wind`.
    chlorophyll : float
        Chlorophyll of the case-1 water [mg m-3].
    objects, bottom : tuple of SubmergedObject, Bottom, optional
        Objects under water, and the bottom; by default there are none, and the water is deep.
    coast : float
        Mean width of the land along the right edge of the image [m]; 0 for no land.
    foam : float
        Share of the sea that whitecaps cover [1]; `deglint.simulate.whitecaps` computes it from a wind.
    targets : tuple of FloatingTarget
        Boats, swimmers and buoys; a moving target has another position in each band that is delayed.
    supersample : int
        Number of facets, the grid points at which the sea is computed, per pixel along each axis.
    patch : float
        Size of the patches of nearly uniform slope that unresolved waves make [m]; larger patches give more sparkle, 0
        gives none. The value 0.005 fits surfaces simulated on a grid of 1 mm; with 0.06, whole facets of 6 cm flash.
    misregistration : tuple of (float, float)
        For each band, displacement (down, right) of its pixels relative to the pixels of the image [pixel]; empty for
        none. The truth of the band is displaced, too.
    artefacts : Artefacts
        Striping, resampling and JPEG; `SimulatedScene.truth` has none of them.
    glint_threshold : float
        The glint mask is True where glint exceeds this share of the radiance without glint [1].
    domain : float, optional
        Least side of the sea that is simulated [m]; by default one peak wavelength. The image always lies within it.
    seed : int
        Seed of all random numbers: the same seed gives the same scene to the bit.
    """

    sensor: Sensor = field(default_factory=lambda: preset("thesis"))
    size: tuple[int, int] = ranged((512, 512), 8, 16384, "pixels", "Simulate several scenes instead.", integer=True)
    wind: float = ranged(5.0, SPECTRA_WIND_RANGE[0], STRONGEST_WIND, "m/s", "The models hold in this range only.")
    wind_from: float = 30.0
    spectrum: WaveSpectrum = "elfouhaily"
    fetch: float = 100e3
    spreading: Spreading | None = None
    exponent: float = 2.0
    opposing: float = 0.0
    slopes: SlopeModelName = one_of("cox-munk", get_args(SlopeModelName))
    sun_zenith: float = ranged(40.0, 0.0, 80.0, "degrees", "Choose another time of day.")
    sun_azimuth: float = ranged(135.0, -720.0, 720.0, "degrees", "Give an azimuth from north.")
    view_zenith: float = ranged(0.0, 0.0, 70.0, "degrees", "Beyond 70 degrees waves shadow each other.")
    view_azimuth: float = ranged(0.0, -720.0, 720.0, "degrees", "Give an azimuth from north.")
    sky: str = one_of("cardioidal", SKIES)
    air: Air | None = None
    chlorophyll: float = ranged(0.5, 0.01, 30.0, "mg m-3", "0.5 is usual on a shelf, 0.05 offshore.")
    objects: tuple[SubmergedObject, ...] = ()
    bottom: Bottom | None = None
    coast: float = 0.0
    foam: float = ranged(0.0, 0.0, 0.5, "", "It is a share: whitecaps cover 0.01 of the sea at 10 m/s.")
    targets: tuple[FloatingTarget, ...] = ()
    supersample: int = ranged(4, 2, 32, "", "4 facets per pixel do for most scenes.", integer=True)
    patch: float = ranged(0.005, 0.0, 1.0, "m", "It is some centimetres at most; 0 leaves the sparkle out.")
    misregistration: tuple[tuple[float, float], ...] = ()
    artefacts: Artefacts = field(default_factory=Artefacts)
    glint_threshold: float = ranged(0.25, 0.0, 1e6, "", "Give a share of the radiance without glint, such as 0.25.")
    domain: float | None = ranged(None, 0.0, 1e7, "m", "Give the least side of the sea.")
    seed: int = ranged(0, 0, 2**63, "", "Any integer that is not negative will do.", integer=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        height, width = (side * self.sensor.gsd for side in self.size)
        check_quantity("coast", self.coast, 0.0, 0.9 * width, "m", "Leave some of the image to the sea.")
        if self.misregistration and len(self.misregistration) != len(self.sensor.bands):
            raise InputError(
                f"misregistration must hold one (down, right) per band ({len(self.sensor.bands)}),"
                f" got {len(self.misregistration)}; give (0, 0) for bands that are in place"
            )
        most = max(self.size)
        for shift in (s for band in self.misregistration for s in band):
            check_quantity("misregistration", shift, -most, most, "pixels", "Give (down, right) per band.")
        for target in self.objects:
            target.check_inside(height, width)
        count = self.fine_grid[0] * self.fine_grid[1]
        if count > MOST_FACETS:
            raise InputError(
                f"facets must be at most {MOST_FACETS}, got {count}: the image and one peak wave"
                f" ({self.sea.peak_wavelength:.3g} m) take {self.grid[0]} x {self.grid[1]} pixels of"
                f" {self.supersample} x {self.supersample}; lower size, supersample or wind"
            )
        extent = min(self.grid) * self.sensor.gsd
        span, limit = max(self.times), extent / float(np.sqrt(9.81 / self.sea.peak_wavenumber))
        if not span <= limit:
            raise InputError(
                f"time offsets of the bands must span at most {limit:.3g} s, in which the peak wave crosses"
                f" the simulated sea, got {span:g} s; give a larger size, or shorter delays (in seconds)"
            )

    @property
    def times(self) -> tuple[float, ...]:
        """Time of each band after the earliest band [s]."""
        start = min(b.time_offset for b in self.sensor.bands)
        return tuple(b.time_offset - start for b in self.sensor.bands)

    @property
    def facet(self) -> float:
        """Side of a facet [m]."""
        return self.sensor.gsd / self.supersample

    @property
    def fine_grid(self) -> tuple[int, int]:
        """Rows and columns of the simulated sea [facet]."""
        return self.grid[0] * self.supersample, self.grid[1] * self.supersample

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of the simulated sea [pixel], suited to a fast FFT; the image is its upper left part."""
        from scipy.fft import next_fast_len

        least = self.sea.peak_wavelength if self.domain is None else self.domain
        need = int(np.ceil(least / self.sensor.gsd))
        margin = EDGE_MARGIN if self.coast or self.bottom else 0
        rows, columns = (2 * next_fast_len(-(-max(n, need) // 2)) for n in (self.size[0], self.size[1] + margin))
        return rows, columns

    @property
    def weather(self) -> Air:
        """State of the atmosphere: `air`, or the default if it is None."""
        return self.air or replace(CLEAR_AIR, wind=float(self.wind), wind_mean=float(self.wind))

    @property
    def slope_variance(self) -> tuple[float, float]:
        """Variance of the upwind and crosswind slope [1] of waves of all lengths, as Cox and Munk measured it."""
        up, cross = variances(wind_at_height(self.wind), model=self.slopes)
        return float(up), float(cross)

    @property
    def sea(self) -> Sea:
        """Waves of the scene; short waves are damped if the grid resolves too large a share of the slope variance."""
        waves = ("wind", "wind_from", "spectrum", "fetch", "spreading", "exponent", "opposing")
        sea = Sea(**{name: getattr(self, name) for name in waves})
        split = sea.peak_wavelength / SHORT_WAVES
        shortest = np.sqrt(2) * self.facet  # in the corners of the grid of wavenumbers
        if shortest >= split:
            return sea
        long = slope_variance(sea, shortest=split)
        short = slope_variance(sea, longest=split, shortest=shortest)
        gains = [(RESOLVED_AT_MOST * all_ - a) / b for all_, a, b in zip(self.slope_variance, long, short, strict=True)]
        return replace(sea, short_gain=min(1.0, max(LEAST_ENERGY, min(gains))))


def check_one_sea(setups: Sequence[Setup]) -> None:
    """Check that setups differ only in artefacts, misregistration, glint threshold, and sensor, but not bands or gsd.

    Raises InputError if a setup differs from the first one in another parameter, which the message names.
    """
    first, own = setups[0], {"sensor", "misregistration", "artefacts", "glint_threshold"}
    names = [f.name for f in fields(Setup) if f.name not in own]
    for n, other in enumerate(setups[1:], start=2):
        unlike = [name for name in names if getattr(first, name) != getattr(other, name)]
        if [(b.low, b.high) for b in first.sensor.bands] != [(b.low, b.high) for b in other.sensor.bands]:
            unlike.append("bands of the sensor")
        if first.sensor.gsd != other.sensor.gsd:
            unlike.append("gsd of the sensor")
        if unlike:
            raise InputError(f"setups 1 and {n} differ in {', '.join(unlike)}; simulate seas that differ one by one")


def experiments(
    base: Setup, *, winds: Sequence[float] = WINDS, delays: Sequence[float] = DELAYS
) -> Iterator[tuple[str, Setup]]:
    """Yield a name and a setup for every combination of wind, viewing geometry, delay between bands, and f-number.

    `winds` are in [m/s], `delays` are from each band to the next [s]; viewing geometries are `GEOMETRIES`, f-numbers
    `F_NUMBERS`. The seed varies, too; all other parameters are those of `base`. A name holds wind [m/s], delay [ms],
    viewing geometry [degree] and f-number. Setups that differ only in delay or f-number have the same seed and sea.

    >>> [name for name, _ in experiments(Setup(), winds=[9.0], delays=[0.06])][:2]
    ['wind09_delay060_view00_000_f10', 'wind09_delay060_view00_000_f30']
    """
    for place, (wind, (zenith, turn)) in enumerate(product(winds, GEOMETRIES)):
        azimuth, seed = (base.sun_azimuth + turn) % 360, base.seed + place
        for delay, f_number in product(delays, F_NUMBERS):
            ms = f"{1000 * delay:013.9f}".rstrip("0").rstrip(".")  # such as 060 or 000.25
            name = f"wind{wind:02g}_delay{ms}_view{zenith:02g}_{turn:03g}_f{f_number:g}"
            sensor = replace(base.sensor.delayed(delay), f_number=f_number)
            yield name, replace(base, wind=wind, view_zenith=zenith, view_azimuth=azimuth, seed=seed, sensor=sensor)
