"""Puts a synthetic scene together: light, facets and optics band by band, then noise; and its truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..physics.imaging import observe, transform
from ..physics.sensor import digitise
from ..physics.surface import by_rows
from .facets import Facets, facets
from .light import Light, light
from .objects import label
from .setup import Setup, check_one_sea

Array = npt.NDArray[np.floating[Any]]
Numbers = npt.NDArray[np.integer[Any]]
Progress = Callable[[int, int], object]


@dataclass(frozen=True, eq=False)
class SimulatedScene:
    """A scene and the truth about it. Arrays are (band, row, column), radiances [W m-2 sr-1 nm-1].

    Attributes
    ----------
    setup : Setup
        All that it depends on.
    light : Light
        Light in each band.
    image : uint16 ndarray
        Digital numbers of the sensor; times `Sensor.scale` they are radiance.
    truth : float32 ndarray
        Radiance without glint and without noise, through the same optics.
    truth_image : uint16 ndarray
        The same as digital numbers, with noise from the same draw.
    glint : float32 ndarray
        Radiance of the glint alone, through the same optics.
    glint_mask : bool ndarray
        Where glint exceeds the setup's share of `truth`.
    objects : (row, column) uint16 ndarray
        Number of the object, from 1; 0 where there is none.
    height, slopes : float32 ndarray or None
        Height [m] and (east, north) slope of the resolved waves, mean over each pixel, at the first time.
    resolved_slope_variance : (float, float)
        Of the resolved waves upwind and crosswind, expected on this grid.
    """

    setup: Setup
    light: Light = field(repr=False)
    image: Numbers = field(repr=False)
    truth: Array = field(repr=False)
    truth_image: Numbers = field(repr=False)
    glint: Array = field(repr=False)
    glint_mask: npt.NDArray[np.bool_] = field(repr=False)
    objects: Numbers = field(repr=False)
    height: Array | None = field(repr=False)
    slopes: Array | None = field(repr=False)
    resolved_slope_variance: tuple[float, float]


def simulate(
    setup: Setup, *, workers: int = 1, keep_surface: bool = False, progress: Progress | None = None
) -> SimulatedScene:
    """Simulate a scene.

    Parameters
    ----------
    setup : Setup
        What to simulate.
    workers : int
        Threads; they never show in the result.
    keep_surface : bool
        Keep height and slopes of the sea, too.
    progress : callable, optional
        Called with how many bands are done and how many there are.

    Returns
    -------
    SimulatedScene
        The same to the bit for the same setup.

    Raises
    ------
    InputError
        The grid cannot hold the waves, or a value lies outside the range of a model.

    Notes
    -----
    Bands that look at the same time share the work on the sea. Waves bend neither the light that leaves the
    water nor the outlines of objects; whitecaps, multiple reflections and hiding of waves are left out. Seen
    at an angle, the pixels are squares on the sea. About 60 bytes of memory per facet.

    Examples
    --------
    >>> scene = simulate(Setup(size=(64, 64), wind=3.0, supersample=2))
    >>> scene.image.shape
    (8, 64, 64)
    """
    return simulate_together([setup], workers=workers, keep_surface=keep_surface, progress=progress)[0]


def simulate_together(
    setups: Sequence[Setup], *, workers: int = 1, keep_surface: bool = False, progress: Progress | None = None
) -> tuple[SimulatedScene, ...]:
    """Simulate what several sensors see of one sea: they may differ in optics, noise and when their bands look.

    Parameters
    ----------
    setups : sequence of Setup
        Alike but for `sensor`, `misregistration` and `glint_threshold`; the sensors have the same bands, in the same
        order, and the same ground sampling distance.
    workers, keep_surface, progress
        As for `simulate`; the bands are those of all setups.

    Returns
    -------
    tuple of SimulatedScene
        Each the same to the bit as `simulate` of its setup.

    Raises
    ------
    InputError
        As `simulate`; setups that are not of one sea.

    Notes
    -----
    The sea is drawn once, moved once to each time at which any band looks, and transformed once for all optics.

    Examples
    --------
    >>> from dataclasses import replace
    >>> one = Setup(size=(64, 64), wind=3.0, supersample=2)
    >>> still, slow = simulate_together([replace(one, sensor=one.sensor.delayed(d)) for d in (0.0, 0.06)])
    >>> bool((still.image[0] == slow.image[0]).all()), bool((still.image[1] == slow.image[1]).all())
    (True, False)
    """
    check_one_sea(setups)
    # how fast sparkle changes is drawn only where something moves
    moving = max(setups, key=lambda s: max(s.times))
    lit, sea, labels = light(moving), facets(moving, workers=workers), _labels(moving)
    shape = len(moving.sensor.bands), *moving.size
    truths, glints = ([np.empty(shape, np.float32) for _ in setups] for _ in range(2))
    done, total = 0, len(setups) * shape[0]
    for time in sorted({t for s in setups for t in s.times}):
        for n, i, clean, bright in _look(setups, lit, sea, labels, time, workers):
            truths[n][i], glints[n][i] = clean, bright
            done += 1
            if progress:
                progress(done, total)
    surface = _surface(sea, workers) if keep_surface else (None, None)
    return tuple(
        _finished(setup, lit, sea, labels, truths[n], glints[n], surface, workers) for n, setup in enumerate(setups)
    )


def _finished(
    setup: Setup, lit: Light, sea: Facets, labels: Numbers, truth: Array, glint: Array,
    surface: tuple[Array | None, Array | None], workers: int,
) -> SimulatedScene:  # fmt: skip
    image, truth_image = _digitise(setup, truth + glint, workers), _digitise(setup, truth, workers)
    half = setup.supersample // 2
    ids = labels[half :: setup.supersample, half :: setup.supersample][: setup.size[0], : setup.size[1]].copy()
    mask = glint > setup.glint_threshold * truth
    return SimulatedScene(setup, lit, image, truth, truth_image, glint, mask, ids, *surface, sea.slope_variance)


def _labels(setup: Setup) -> Numbers:
    shape = setup.grid[0] * setup.supersample, setup.grid[1] * setup.supersample
    if not setup.objects:
        return np.broadcast_to(np.uint16(0), shape)
    return label(setup.objects, shape, setup.facet)


def _look(
    setups: Sequence[Setup], lit: Light, sea: Facets, labels: Numbers, time: float, workers: int
) -> Iterator[tuple[int, int, Array, Array]]:
    """Yield (setup, band, truth, glint) on the pixels for the bands that look at one time."""
    density, mirrored = sea.at(time, workers=workers)
    density_spectrum = transform(density, workers=workers)
    del density
    plain = None if setups[0].objects else transform(mirrored, workers=workers)
    for i in range(len(lit.water)):
        looking = [n for n, s in enumerate(setups) if s.times[i] == time]
        if not looking:
            continue
        spectrum, factor, level = plain, lit.diffuse[i], lit.water[i]
        if spectrum is None:  # the water differs from facet to facet
            out_of_water = np.append(lit.water[i], lit.objects[:, i]).astype(np.float32)[labels]
            out_of_water += np.float32(factor) * mirrored
            spectrum, factor, level = transform(out_of_water, workers=workers), 1.0, 0.0
        for n in looking:
            truth = level + factor * _pixels(spectrum, setups[n], i, workers)
            bright = lit.normal[i] * sea.glint_factor * _pixels(density_spectrum, setups[n], i, workers)
            yield n, i, truth, np.maximum(bright, 0.0)


def _pixels(spectrum: Any, setup: Setup, i: int, workers: int) -> Array:
    shift = setup.misregistration[i] if setup.misregistration else (0.0, 0.0)
    wavelength = setup.sensor.bands[i].wavelength
    seen = observe(spectrum, setup.sensor, wavelength, factor=setup.supersample, shift=shift, workers=workers)
    return seen[: setup.size[0], : setup.size[1]]


def _digitise(setup: Setup, radiance: Array, workers: int) -> Numbers:
    """Digital numbers; each band draws its noise from a seed of its own, the same for image and truth."""
    seeds = np.random.SeedSequence(setup.seed, spawn_key=(2,)).spawn(len(radiance))
    out = np.empty(radiance.shape, np.uint16)

    def draw(first: int, last: int) -> None:
        for i in range(first, last):
            generator = np.random.default_rng(seeds[i])
            out[i] = digitise(radiance[i], setup.sensor, setup.sensor.bands[i], generator=generator)

    by_rows(draw, len(radiance), workers)
    return out


def _surface(sea: Facets, workers: int) -> tuple[Array, Array]:
    """Height and slopes at the first time, mean over each pixel."""
    setup = sea.setup
    layers = sea.surface.height(workers=workers), *sea.slopes(workers=workers)
    n, (rows, columns) = setup.supersample, setup.grid
    means = [a.reshape(rows, n, columns, n).mean(axis=(1, 3))[: setup.size[0], : setup.size[1]] for a in layers]
    return means[0], np.stack(means[1:])
