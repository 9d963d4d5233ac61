"""Puts a synthetic scene together: light, facets and optics band by band, then noise; and its truth."""

from __future__ import annotations

from collections.abc import Callable
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
from .setup import Setup

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
    lit, sea = light(setup), facets(setup, workers=workers)
    count = len(setup.sensor.bands)
    truth, glint = np.empty((count, *setup.size), np.float32), np.empty((count, *setup.size), np.float32)
    labels = _labels(setup)
    done = 0
    for time in sorted(set(setup.times)):
        bands = [i for i, t in enumerate(setup.times) if t == time]
        for i, clean, bright in _look(setup, lit, sea, labels, time, bands, workers):
            truth[i], glint[i] = clean, bright
            done += 1
            if progress:
                progress(done, count)
    image, truth_image = _digitise(setup, truth + glint, workers), _digitise(setup, truth, workers)
    height, slopes = _surface(sea, workers) if keep_surface else (None, None)
    half = setup.supersample // 2
    ids = labels[half :: setup.supersample, half :: setup.supersample][: setup.size[0], : setup.size[1]].copy()
    mask = glint > setup.glint_threshold * truth
    variance = sea.slope_variance
    return SimulatedScene(setup, lit, image, truth, truth_image, glint, mask, ids, height, slopes, variance)


def _labels(setup: Setup) -> Numbers:
    shape = setup.grid[0] * setup.supersample, setup.grid[1] * setup.supersample
    if not setup.objects:
        return np.broadcast_to(np.uint16(0), shape)
    return label(setup.objects, shape, setup.facet)


def _look(setup: Setup, lit: Light, sea: Facets, labels: Numbers, time: float, bands: list[int], workers: int) -> Any:
    """Yield (band, truth, glint) on the pixels for the bands that look at one time."""
    density, mirrored = sea.at(time, workers=workers)
    density_spectrum = transform(density, workers=workers)
    del density
    plain = None if setup.objects else transform(mirrored, workers=workers)
    for i in bands:
        spectrum, factor, level = plain, lit.diffuse[i], lit.water[i]
        if spectrum is None:  # the water differs from facet to facet
            out_of_water = np.append(lit.water[i], lit.objects[:, i]).astype(np.float32)[labels]
            out_of_water += np.float32(factor) * mirrored
            spectrum, factor, level = transform(out_of_water, workers=workers), 1.0, 0.0
        truth = level + factor * _pixels(spectrum, setup, i, workers)
        bright = lit.normal[i] * sea.glint_factor * _pixels(density_spectrum, setup, i, workers)
        yield i, truth, np.maximum(bright, 0.0)


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
