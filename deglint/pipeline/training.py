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
from ..compensate import Background, Chain, FitRemoval, Sample, Setting, State, system_psf, typical_psf
from ..masks.find import COARSE_PIXEL
from ..raster.environment import enter_thread
from ..readers.optics import optics_of, pixel_size
from ..remove import METHODS, FitRequest, GlintModel, fit_pointwise, mixture, wiener
from ..remove.further import more_references
from ..scene import Scene
from ..tiles import Tile
from .overview import TILE_SIDE, Overview, place_in
from .recipe import Recipe, smallest_object
from .sample import Sampler, Training, some, strips_of_footprints, tiles_of, training_reader

Progress = Callable[[str, int, int], None]
LEAST_PERCENTILE = 1.0
"""Percentile of the prediction that is its level where glint covers all of the sample [%]: the least but for noise. As
many pixels again as have glint beyond doubt are taken to have some that is too faint for that; the middle of the others
is the level."""
HALO = 64
"""Pixels around a tile that are read with it, and which its first stages look at: windows, kernels, clumps [pixel]."""
TRIED, TRIED_SIDE, TRIED_HALO = 8, 128, 32
"""Number and side of the squares that candidates are tried on, and pixels around them [pixel]: the time of a trial, two
to three seconds on two processors, grows with them."""


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


def read_training(job: Job, sampler: Sampler | None, halo: int) -> list[Training]:
    """Tiles to learn from, in memory."""
    places = tiles_of(job.scene, sampler) if sampler is not None else some(job.overview.tiles)
    at_once = tiling.affordable(job.threads, (TILE_SIDE + 2 * halo,) * 2, 2 * len(job.scene.bands))
    read = training_reader(job.scene, job.overview, sampler, halo)
    return [t for _p, t in tiling.run(places, read, threads=at_once, start=enter_thread, progress=job.note())]


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


def chosen(job: Job, training: Sequence[Training]) -> Choice:
    """Try candidate recipes on parts of those tiles that hold most of the sample."""
    parts = sorted((_part_of(t, job.scene) for t in training), key=lambda p: -int(p.sample.sum()))[:TRIED]
    pixel, rule = pixel_size(job.scene), job.overview.water

    def removal(method: str) -> FitRemoval:
        return removal_of(job, parts, method)

    with ThreadPoolExecutor(job.threads, thread_name_prefix="deglint") as pool:
        return choose(
            sample_of(parts), setting(job), job.request.correct, removal,
            width=smallest_object(job.recipe.smallest_object, pixel),
            fine=pixel is not None and pixel < COARSE_PIXEL,
            coarse=rule is not None and rule.window == 1,
            each=pool.map,
        )  # fmt: skip


def _part_of(found: Training, scene: Scene) -> Training:
    """The first rows and columns of a tile, with fewer pixels around them."""
    tile = found.tile
    last = min(tile.row0 + TRIED_SIDE, tile.row1), min(tile.col0 + TRIED_SIDE, tile.col1)
    part = Tile(tile.row0, last[0], tile.col0, last[1])
    outer = part.grown(TRIED_HALO, scene.height, scene.width)
    place = place_in(outer, found.outer)
    block, water = np.ascontiguousarray(found.block[place]), np.ascontiguousarray(found.water[place[1:]])
    return Training(part, outer, block, water, np.ascontiguousarray(found.sample[: part.shape[0], : part.shape[1]]))
