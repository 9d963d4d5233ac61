"""Tiles to learn from, what the removal is fitted to there, and the recipes that are tried on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from .. import tiles as tiling
from ..choose import Choice, choose
from ..choose.trial import LEAST_PIXELS
from ..compensate import Background, Chain, FitRemoval, Sample, Setting, State, system_psf, typical_psf
from ..masks.find import COARSE
from ..raster.environment import enter_thread
from ..readers.optics import optics_of, pixel_size
from ..remove import METHODS, FitRequest, GlintModel, combine, gather, levels_for, merge, mixture, wiener
from ..remove.detrend import SIZE as LOCAL_MEAN
from ..remove.further import more_references
from ..remove.noise import spread
from ..scene import Scene
from ..tiles import Tile
from .overview import TILE_SIDE, Overview
from .recipe import Recipe, smallest_object
from .sample import Sampler, Training, some, strips_of_footprints, tiles_of, training_reader

Progress = Callable[[str, int, int], None]
LEAST_PERCENTILE = 1.0
"""Percentile of the prediction that is its level where glint covers all of the sample [%]: the least but for noise. As
many pixels again as have glint beyond doubt are taken to have some that is too faint for that; the middle of the others
is the level."""
SHIP_EDGE, FAR_OUT = 5, 8.0
"""Pixels around ships by which candidates are not judged [pixel]: wakes, and what windows of textures reach; and how
far a ship exceeds its surroundings at least [robust standard deviations]."""
TRIED, TRIED_SIDE, TRIED_HALO = 8, 128, 32
"""Number and side of the tiles that candidates are tried on, and pixels around them [pixel]: enough to rank candidates,
in a second."""


@dataclass(frozen=True)
class Job:
    """What a fit works on."""

    scene: Scene
    recipe: Recipe
    request: FitRequest
    overview: Overview
    threads: int
    notes: tuple[str, ...]
    progress: Progress | None
    run: tiling.Run
    want_sample: bool

    def note(self) -> Any:
        """For `tiling.run`."""
        return None if self.progress is None else partial(self.progress, "fit")


def setting(job: Job) -> Setting:
    """What stages need to know of the scene."""
    optics, wavelengths = optics_of(job.scene), [b.wavelength for b in job.scene.bands]
    psfs = None
    if all(w and 300 <= w <= 2500 for w in wavelengths):
        known = {} if optics is None else {"f_number": optics.f_number, "pitch": optics.pitch, "smear": optics.smear}
        psfs = tuple(system_psf(w, **known) if known else typical_psf(w) for w in wavelengths if w)
    nir = tuple(dict.fromkeys(b for i in job.request.indexes for b in i.bands))
    return Setting(job.scene.bands, nir, psfs)


def read_training(
    job: Job, sampler: Sampler | None, halo: int, places: Sequence[Tile] | None = None, *, quiet: bool = False
) -> list[Training]:
    """Tiles to learn from, in memory."""
    if places is None:
        places = tiles_of(job.scene, sampler) if sampler is not None else some(job.overview.tiles)
    at_once = tiling.affordable(job.threads, (TILE_SIDE + 2 * halo,) * 2, 2 * len(job.scene.bands))
    read = training_reader(job.scene, job.overview, sampler, halo)
    note = None if quiet else job.note()
    return [t for _p, t in tiling.run(places, read, threads=at_once, start=enter_thread, progress=note)]


def sample_of(training: Sequence[Training]) -> Sample:
    """Tiles as stages take them."""
    states = tuple(State.of(t.block, t.water, (t.outer.row0, t.outer.col0)) for t in training)
    return Sample(states, tuple(t.inside & s.water for t, s in zip(training, states, strict=True)))


def removal_of(job: Job, training: Sequence[Training], method: str) -> FitRemoval:
    """What fits a method to tiles, as the stages before the removal leave them."""

    def fit(sample: Sample, chain: Chain) -> GlintModel:
        images = [s.image for s in sample.states]
        if not METHODS[method].neighbours:
            return fit_pointwise(method, job.request, images, sample.inside)
        tiles = [t.as_sample(image) for t, image in zip(training, images, strict=True)]
        covers = [stage.cover for stage in chain.before if isinstance(stage, Background)]
        if covers:
            return mixture.fit(job.request, tiles, max(50 * (1 - 2 * covers[-1]), LEAST_PERCENTILE))
        request = replace(job.request, regression="detrended")
        if chain.text != "remove":  # the posterior mean follows
            request = replace(request, faint=True)
            request = replace(request, more=more_references(request, tiles))
        return wiener.fit(request, tiles, strips=strips_of_footprints(job.scene, job.request.correct[0]))

    return fit


def fit_pointwise(method: str, request: FitRequest, images: Sequence[Any], inside: Sequence[Any]) -> GlintModel:
    """Fit a method of single pixels to blocks in memory."""
    row = METHODS[method]
    if row.plan is None:
        return row.fit(request, None)
    plan = replace(row.plan(request), levels=levels_for(sum(m.size for m in inside)))
    parts = [
        gather(image[list(plan.read_bands)], mask, plan, origin=(0, 0))
        for image, mask in zip(images, inside, strict=True)
    ]
    return row.fit(request, merge([combine(parts, plan)], plan))


def chosen(job: Job, sampler: Sampler | None) -> Choice:
    """Try candidate recipes on sample tiles: those parts of the overview that hold most water."""
    places = tiles_of(job.scene, sampler) if sampler is not None else some(job.overview.tiles)
    parts = [part for t in read_training(job, sampler, 0, places, quiet=True) for part in _parts(t)]
    most = sorted(parts, key=lambda p: -p[1])[:TRIED]
    training = read_training(job, sampler, TRIED_HALO, [tile for tile, _water in most], quiet=True)
    pixel = pixel_size(job.scene)
    width, fine = smallest_object(job.recipe.smallest_object, pixel), pixel is not None and pixel < COARSE

    def removal(method: str) -> FitRemoval:
        return removal_of(job, training, method)

    sample = _without_ships(job, sample_of(training))
    with ThreadPoolExecutor(job.threads, thread_name_prefix="deglint") as pool:
        return choose(sample, setting(job), job.request.correct, removal, width=width, fine=fine, each=pool.map)


def _parts(found: Training) -> list[tuple[Tile, int]]:
    """A tile in squares that candidates are tried on, and how many pixels of the sample each holds."""
    rows, columns = ([*range(0, max(n - TRIED_SIDE, 0) + 1, TRIED_SIDE)] for n in found.tile.shape)
    out = []
    for row in rows:
        for column in columns:
            part = found.sample[row : row + TRIED_SIDE, column : column + TRIED_SIDE]
            first = found.tile.row0 + row, found.tile.col0 + column
            out.append((Tile(first[0], first[0] + part.shape[0], first[1], first[1] + part.shape[1]), int(part.sum())))
    return out


def _without_ships(job: Job, sample: Sample) -> Sample:
    """The sample without what exceeds its surroundings far beyond all else in a band: a recipe is not the better for
    erasing ships. Not where pixels resolve sparkle, which does so, too."""
    import cv2

    few = sum(int(m.sum()) for m in sample.inside) < LEAST_PIXELS
    if few or job.overview.water is None or job.overview.water.window > 1:
        return sample
    side, square = (LOCAL_MEAN,) * 2, np.ones((2 * SHIP_EDGE + 1,) * 2, np.uint8)
    inside = list(sample.inside)
    for band in range(len(job.scene.bands)):
        high = [s.raw[band] - cv2.blur(s.raw[band], side) for s in sample.states]
        limit = FAR_OUT * spread(sample.values(high))
        for n, plane in enumerate(high):
            inside[n] = inside[n] & (cv2.dilate((plane > limit).view(np.uint8), square) == 0)
    return replace(sample, inside=tuple(inside))
