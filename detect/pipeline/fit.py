"""Fit the statistics that a detector compares with: one background, or the water around each pixel of the sea."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from deglint import tiles as tiling
from deglint.errors import NoWaterError
from deglint.raster.environment import enter_thread
from deglint.tiles import Tile

from .. import sea
from ..arrays import Array, Uint8
from ..background import Background, Part, sample_share
from ..rx import both, detector
from .plan import Plan, Progress, SeaPlan

_SAMPLE_BLOCK = 1024
"""Side of the blocks that the statistics of water are fitted to [pixel]."""
_BLOCKS = 4
"""Number of blocks for the fit; half of their area must be water."""


def fitted(plan: Plan, run: tiling.Run = tiling.run, progress: Progress | None = None) -> Plan:
    """Fit what the detector of a plan compares with; on threads, or by a cluster's `run`."""
    if plan.sea is not None:
        return replace(plan, sea=_fit_sea(plan, plan.sea))
    if plan.recipe.kind.matrices is None:
        return plan
    background = plan.given or fit_background(plan, run, progress)
    ready = detector(plan.recipe.method, background, drop=plan.recipe.drop, nir=plan.nir)
    return replace(plan, background=background, ready=ready)


def fit_background(plan: Plan, run: tiling.Run = tiling.run, progress: Progress | None = None) -> Background:
    """Fit the background of a plan over its tiles."""
    recipe, bands = plan.recipe, plan.bands
    share = sample_share(recipe.covariance, plan.scene.height * plan.scene.width)

    def gather(tile: Tile) -> Part:
        block = plan.scene.source.read(tile.window, list(bands))
        area = None if plan.area is None else plan.area.read(tile.window)
        return Part.of(block, both(plan.mask.read(plan.scene, tile), area), (tile.row0, tile.col0), share)

    told = progress and partial(progress, "fit")
    done = run(plan.tiles, gather, progress=told, threads=plan.threads, start=enter_thread)
    whole = Part.merge(list(tiling.by_rows(done, Part.merge)))
    return whole.background(recipe.covariance, recipe.ridge, plan.names)


def _fit_sea(plan: Plan, search: SeaPlan) -> SeaPlan:
    """Fit the statistics of water; in a large scene, to a sample of blocks with water."""
    scene, blocks, nir = plan.scene, [], []
    everything = tiling.tiles(scene.height, scene.width, (2 * _SAMPLE_BLOCK, 2 * _SAMPLE_BLOCK))
    if len(everything) > 1:
        everything = tiling.tiles(scene.height, scene.width, (_SAMPLE_BLOCK, _SAMPLE_BLOCK))
    held = 0
    for tile in tiling.spread(everything, 16 * _BLOCKS * _SAMPLE_BLOCK**2):
        block, classes = read_sea(plan, search, tile)
        count = int(np.count_nonzero(classes == sea.WATER))
        if not count:
            continue
        blocks.append((block, classes))
        nir.append(read_nir(plan, search, tile))
        held += count
        if held >= _BLOCKS * _SAMPLE_BLOCK**2 // 2 and len(blocks) >= _BLOCKS:
            break
    if not blocks:
        raise NoWaterError(f"no water in {scene.path} to compare with. Check --mask and --nodata, or take --method rx.")
    side = None if plan.recipe.side == "auto" else plan.recipe.side
    return replace(search, model=sea.fit(blocks, pixel=search.pixel, side=side, nir=nir if search.nir else ()))


def read_sea(plan: Plan, search: SeaPlan, tile: Tile) -> tuple[Array, Uint8]:
    """Pixels of a tile, (band, row, column), and their classes, (row, column), from `detect.sea.region`."""
    block = plan.scene.source.read(tile.window, list(plan.bands))
    valid = np.asarray(np.isfinite(block).all(axis=0))
    mask = plan.mask.read(plan.scene, tile)
    water = valid if mask is None else np.logical_and(mask, valid)
    return block, sea.region(water, search.rule, valid)


def read_nir(plan: Plan, search: SeaPlan, tile: Tile) -> Array:
    """NIR of a tile, (band, row, column); no bands where the scene has no NIR."""
    return plan.scene.source.read(tile.window, list(search.nir)) if search.nir else np.zeros((0, *tile.shape))
