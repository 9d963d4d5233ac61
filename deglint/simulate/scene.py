"""Make a synthetic scene and its truth: compute light, facets and optics of each band, then add noise."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..physics import atmosphere, water
from ..physics._checks import Floats
from ..physics.imaging import observe, transform
from ..physics.iops import Iops, case1
from ..physics.sensor import band_means, digitise
from ..physics.surface import Complex, on_rows
from .artefacts import GRID_SHIFT, compress, resample, stripe
from .cover import Cover
from .facets import Facets
from .materials import reflectance
from .setup import Setup, check_one_sea
from .underwater import LEAST_DEPTH, MOST_DEPTH, depth_and_patches, label

Numbers = npt.NDArray[np.integer[Any]]
BandProgress = Callable[[int, int], object]
DEPTH_STEPS = 128  # number of depths at which the light over a bottom is computed, each 5 % deeper than the one before


class Light:
    """Mean light in each band of a setup: irradiances (band,) [W m-2 nm-1] and radiances [W m-2 sr-1 nm-1].

    Irradiances are those of Gregg and Carder (1990) at the mean distance of the sun; for radiances see `physics.water`.
    """

    def __init__(self, setup: Setup) -> None:
        self._wavelength, self._mean = wavelength, mean = band_means(setup.sensor.bands)
        direct, diffuse = atmosphere.irradiance(wavelength, setup.sun_zenith, setup.weather)
        total, share = direct + diffuse, direct / (direct + diffuse)
        angles, sea = (setup.sun_zenith, setup.view_zenith), case1(wavelength, setup.chlorophyll)
        deep = water.deep_reflectance(sea, *angles, (setup.view_azimuth - setup.sun_azimuth) % 360.0)

        def over(depth: Floats | float, albedo: Floats | float) -> Floats:
            """Radiance (band, *depth.shape) over ground at a depth [m]; `albedo` is a number or (wavelength, 1)."""
            column = [np.reshape(a, (-1, *[1] * np.ndim(depth))) for a in (deep, total, share, *sea)]
            seen = water.submerged_reflectance(
                Iops(*column[3:]), column[0], *angles, depth=depth, reflectance=albedo, direct_fraction=column[2]
            )
            return mean(seen * column[1])

        self.direct, self.diffuse = mean(direct), mean(diffuse)  # irradiance of a level plane: by the sun, by the sky
        self.normal = self.direct / np.cos(np.radians(setup.sun_zenith))  # irradiance by the sun of a plane facing it
        self.water = mean(deep * total)  # water-leaving radiance of deep water, (band,)
        objects = [over(o.depth, o.reflectance) for o in setup.objects]
        # water-leaving radiance over each object, (object, band)
        self.objects = np.asarray(objects).reshape(len(objects), len(self.water))
        # depths [m], and water-leaving radiance over materials of the bottom (material, depth, band); empty without it
        self.depths, self.bottom = np.zeros(0), np.zeros(0)
        if setup.bottom is not None:
            self.depths = np.geomspace(LEAST_DEPTH, MOST_DEPTH, DEPTH_STEPS)
            grounds = [reflectance(name, wavelength)[:, None] for name in setup.bottom.materials]
            self.bottom = np.asarray([over(self.depths, ground).T for ground in grounds])

    def matt(self, materials: Sequence[str]) -> Floats:
        """Radiance (material, band) [W m-2 sr-1 nm-1] of horizontal Lambertian surfaces; 0 for the name "" (water)."""
        none = np.zeros(len(self.water))
        rows = [self._mean(reflectance(name, self._wavelength)) if name else none for name in materials]
        return np.asarray(rows) * (self.direct + self.diffuse) / np.pi


@dataclass(frozen=True, eq=False)
class SimulatedScene:
    """A synthetic scene and its truth. Arrays are (band, row, column) by default, radiances [W m-2 sr-1 nm-1].

    Attributes
    ----------
    setup : Setup
        Parameters of the scene.
    light : Light
        Light in each band.
    image : uint16 ndarray
        Digital numbers of the sensor; multiplied by `Sensor.scale`, they are radiance.
    truth : float32 ndarray
        Water-leaving radiance plus reflected sky, blurred by the optics, without sun glint and without noise. It also
        contains land, foam and floating targets.
    truth_water : float32 ndarray
        `truth` without the reflected sky.
    truth_image : uint16 ndarray
        `truth` as digital numbers, with the same noise seeds and artefacts as `image`.
    glint : float32 ndarray
        Radiance of the sun glint alone, blurred by the same optics.
    glint_mask : bool ndarray
        True where `glint` exceeds `setup.glint_threshold` times `truth`.
    objects : (row, column) uint16 ndarray
        Number of the submerged object, from 1 in the order of the setup. It is 0 where there is no object, where the
        object lies below the bottom, and where land, foam or a floating target covers it in any band.
    height, slopes : (row, column) and (2, row, column) float32 ndarray, or None
        Height [m], and slopes towards east and north [1], of the resolved waves at the time of the earliest band, as
        means over each pixel; None unless `simulate` was called with `keep_surface`.
    resolved_slope_variance : (float, float)
        Expected variance of the upwind and crosswind slopes of the resolved waves on this grid [1].
    cover : (band, row, column) uint8 ndarray or None
        0 for open water, 1 land, 2 foam, 3 floating target, at the time of the band; None if the setup has no cover.
    depth : (row, column) float32 ndarray or None
        Depth of the bottom [m]; None if the setup has no bottom.
    """

    setup: Setup
    light: Light = field(repr=False)
    image: Numbers = field(repr=False)
    truth: Floats = field(repr=False)
    truth_image: Numbers = field(repr=False)
    glint: Floats = field(repr=False)
    glint_mask: npt.NDArray[np.bool_] = field(repr=False)
    objects: Numbers = field(repr=False)
    height: Floats | None = field(repr=False)
    slopes: Floats | None = field(repr=False)
    resolved_slope_variance: tuple[float, float]
    truth_water: Floats = field(repr=False)
    cover: Numbers | None = field(repr=False, default=None)
    depth: Floats | None = field(repr=False, default=None)


def simulate(
    setup: Setup, *, workers: int = 1, keep_surface: bool = False, progress: BandProgress | None = None
) -> SimulatedScene:
    """Simulate a scene of the sea, and its truth.

    Raises InputError if the grid cannot hold the waves, or if a value lies outside the range of a model.

    Parameters
    ----------
    setup : Setup
        Parameters of the scene.
    workers : int
        Number of threads; the result does not depend on it.
    keep_surface : bool
        If True, the scene has `height` and `slopes`; else they are None.
    progress : callable, optional
        Called as progress(done, total) after each band; the numbers count bands.

    Returns
    -------
    SimulatedScene
        The same setup gives the same scene to the bit.

    Notes
    -----
    The sea is computed once for bands that are simultaneous. The model has no refraction of the water-leaving light by
    waves, which would distort the outlines of objects, no multiple reflections, and no waves that hide other waves.
    Pixels are squares on the sea also in an oblique view. A facet takes about 60 bytes of memory.

    Examples
    --------
    >>> scene = simulate(Setup(size=(64, 64), wind=3.0, supersample=2))
    >>> scene.image.shape
    (8, 64, 64)
    """
    return simulate_together([setup], workers=workers, keep_surface=keep_surface, progress=progress)[0]


def simulate_together(
    setups: Sequence[Setup], *, workers: int = 1, keep_surface: bool = False, progress: BandProgress | None = None
) -> tuple[SimulatedScene, ...]:
    """Simulate one sea for several sensors, which may differ in optics, noise and band delays.

    Raises InputError as `simulate` does, and if the setups describe different seas.

    Parameters
    ----------
    setups : sequence of Setup
        They may differ only in `sensor`, `misregistration`, `artefacts` and `glint_threshold`; the sensors have the
        same bands, in the same order, and the same ground sampling distance.
    workers, keep_surface, progress
        As in `simulate`; `progress` counts the bands of all setups.

    Returns
    -------
    tuple of SimulatedScene
        Each scene is the same, to the bit, as the result of `simulate` for its setup.

    Notes
    -----
    The random sea is drawn once, computed once for the time of each band, and Fourier-transformed once for all optics.

    Examples
    --------
    >>> from dataclasses import replace
    >>> one = Setup(size=(64, 64), wind=3.0, supersample=2)
    >>> still, slow = simulate_together([replace(one, sensor=one.sensor.delayed(d)) for d in (0.0, 0.06)])
    >>> bool((still.image[0] == slow.image[0]).all()), bool((still.image[1] == slow.image[1]).all())
    (True, False)
    """
    check_one_sea(setups)
    sea, world = Facets(setups[0], workers=workers), _World(setups[0])
    shots = [_Shot(setup, workers) for setup in setups]
    done, total = 0, len(setups) * len(setups[0].sensor.bands)
    for time in sorted({t for s in setups for t in s.times}):
        for _ in _add_bands(shots, world, sea, time, workers):
            done += 1
            if progress:
                progress(done, total)
    surface = _surface(sea, workers) if keep_surface else (None, None)
    return tuple(shot.finished(world, surface, sea.slope_variance) for shot in shots)


class _World:
    """Bottom, submerged objects, and cover (land, foam, floating targets) of a setup; light in each band (`lit`)."""

    def __init__(self, setup: Setup) -> None:
        shape = setup.fine_grid
        self.setup, self.lit = setup, Light(setup)
        self.labels: Numbers = label(setup.objects, shape, setup.facet)  # number of the submerged object, from 1
        self.depth: Floats | None = None
        if setup.bottom is not None:
            seed, width = np.random.SeedSequence(setup.seed, spawn_key=(3,)), setup.size[1] * setup.sensor.gsd
            # patches: mask of the second material of the bottom
            self.depth, self.patches = depth_and_patches(setup.bottom, shape, setup.facet, width, seed)
            buried = np.array([0.0, *(o.depth for o in setup.objects)], np.float32)[self.labels] > self.depth
            self.labels = np.where(buried, np.uint16(0), self.labels)
        self.cover = Cover(setup) if setup.coast or setup.foam or setup.targets else None
        # whether the water-leaving radiance is the same everywhere
        self.is_plain = not setup.objects and self.depth is None and self.cover is None
        # radiance of each material of the cover, (material, band)
        self.matt = self.lit.matt(self.cover.materials) if self.cover else np.zeros((0, 0))

    def leaving(self, band: int, cover: Numbers | None) -> Floats:
        """Radiance of facets (row, column) in a band: of the cover where `cover` (labels) is above 0, else of water."""
        lit = self.lit
        out = np.append(lit.water[band], lit.objects[:, band]).astype(np.float32)[self.labels]
        if self.depth is not None:
            ground, patch = (np.interp(self.depth, lit.depths, table) for table in lit.bottom[:, :, band])
            np.copyto(out, np.where(self.patches, patch, ground), where=self.labels == 0, casting="same_kind")
        if cover is not None:
            np.copyto(out, self.matt[:, band].astype(np.float32)[cover], where=cover > 0)
        return out

    def on_pixels(self, layer: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Sample `layer`, (row, column) of facets, at the centre of each pixel of the image; returns (row, column)."""
        n, (rows, columns) = self.setup.supersample, self.setup.size
        return layer[n // 2 :: n, n // 2 :: n][:rows, :columns].copy()


class _Shot:
    """The radiance images of one setup, before noise and artefacts; `finished` makes its `SimulatedScene` from them.

    `_add_bands` fills the float32 arrays band by band: `water` (band, row, column) becomes `truth_water`; `grids` has
    truth and glint, (2, band, row, column), on the map's grid and, if the image is resampled, on the sensor's grid.
    """

    def __init__(self, setup: Setup, workers: int) -> None:
        self.setup, self.workers = setup, workers
        self.water = np.empty((len(setup.sensor.bands), *setup.size), np.float32)
        # (array, offset [pixel]) on the grid of the map and, if the image is resampled, on that of the sensor
        offsets = (0.0, GRID_SHIFT) if setup.artefacts.resampling else (0.0,)
        self.grids = [(np.empty((2, *self.water.shape), np.float32), offset) for offset in offsets]

    def pixels(self, spectrum: Complex, i: int, off: float = 0.0) -> Floats:
        """Image (row, column) in band i, from the `spectrum` of facets; `off` moves pixels down and right [pixel]."""
        setup = self.setup
        down, right = setup.misregistration[i] if setup.misregistration else (0.0, 0.0)
        wavelength, shift = setup.sensor.bands[i].wavelength, (down + off, right + off)
        factor, workers = setup.supersample, self.workers
        seen = observe(spectrum, setup.sensor, wavelength, factor=factor, shift=shift, workers=workers)
        return seen[: setup.size[0], : setup.size[1]]

    def digitised(self, radiance: Floats) -> Numbers:
        """Digital numbers of radiances (band, row, column), with noise and artefacts; each band has its own seeds."""
        setup, sensor, artefacts = self.setup, self.setup.sensor, self.setup.artefacts
        seeds = np.random.SeedSequence(setup.seed, spawn_key=(2,)).spawn(len(radiance))
        gains = np.random.SeedSequence(setup.seed, spawn_key=(5,)).spawn(len(radiance))
        out = np.empty(radiance.shape, np.uint16)

        def draw(first: int, last: int) -> None:
            for i in range(first, last):
                generator = np.random.default_rng(seeds[i])
                striped = stripe(radiance[i], artefacts.striping, gains[i])
                out[i] = digitise(striped, sensor, sensor.bands[i], generator=generator)
                if artefacts.resampling:
                    out[i] = resample(out[i], artefacts.resampling, sensor.levels)
                if artefacts.jpeg:
                    out[i] = compress(out[i], artefacts.jpeg, sensor.levels)

        on_rows(draw, len(radiance), self.workers)
        return out

    def finished(
        self, world: _World, surface: tuple[Floats | None, Floats | None], variance: tuple[float, float]
    ) -> SimulatedScene:
        """Make the scene after the last band from `surface` (height, slopes) and `variance` (of resolved slopes)."""
        setup, (truth, glint) = self.setup, self.grids[0][0]
        own_truth, own_glint = self.grids[-1][0]  # on the grid of the sensor
        image, truth_image = self.digitised(own_truth + own_glint), self.digitised(own_truth)
        ids, cover = world.on_pixels(world.labels), None
        if world.cover is not None:
            seen = {t: world.cover.kinds(world.on_pixels(world.cover.at(t))) for t in set(setup.times)}
            cover = np.stack([seen[t] for t in setup.times])
            ids[(cover > 0).any(axis=0)] = 0
        depth = None if world.depth is None else world.on_pixels(world.depth)
        mask = glint > setup.glint_threshold * truth
        return SimulatedScene(
            setup, world.lit, image, truth, truth_image, glint, mask, ids, *surface, variance, self.water, cover, depth
        )


def _add_bands(shots: Sequence[_Shot], world: _World, sea: Facets, time: float, workers: int) -> Iterator[None]:
    """Compute the bands that `shots` take at `time` [s] after the earliest band; yield after each band of each shot."""
    density, mirrored = sea.at(time, workers=workers)
    cover = None if world.cover is None else world.cover.at(time)
    if cover is not None:
        density[cover > 0] = mirrored[cover > 0] = 0.0
    density_spectrum, sky_spectrum = transform(density, workers=workers), transform(mirrored, workers=workers)
    del density
    lit = world.lit
    for i in range(len(lit.water)):
        looking = [shot for shot in shots if shot.setup.times[i] == time]
        if not looking:
            continue
        if world.is_plain:
            layer, factor, level = sky_spectrum, lit.diffuse[i], lit.water[i]
        else:  # the water differs from facet to facet
            both = world.leaving(i, cover)
            both += np.float32(lit.diffuse[i]) * mirrored
            layer, factor, level = transform(both, workers=workers), 1.0, 0.0
        sun = lit.normal[i] * sea.glint_factor
        for shot in looking:
            for (truth, glint), offset in shot.grids:
                truth[i] = level + factor * shot.pixels(layer, i, offset)
                glint[i] = np.maximum(sun * shot.pixels(density_spectrum, i, offset), 0.0)
            shot.water[i] = lit.water[i]
            if not world.is_plain:
                shot.water[i] = shot.grids[0][0][0, i] - lit.diffuse[i] * shot.pixels(sky_spectrum, i)
            yield


def _surface(sea: Facets, workers: int) -> tuple[Floats, Floats]:
    """Means over each pixel at time 0: height [m], (row, column); slopes to east and north [1], (2, row, column)."""
    setup = sea.setup
    layers = sea.surface.height(workers=workers), *sea.slopes(workers=workers)
    n, (rows, columns) = setup.supersample, setup.grid
    means = [a.reshape(rows, n, columns, n).mean(axis=(1, 3))[: setup.size[0], : setup.size[1]] for a in layers]
    return means[0], np.stack(means[1:])
