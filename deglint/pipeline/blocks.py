"""The sample that a compensation is fitted to: some tiles with their halos, read once and worked on stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..compensate import Chain, Sample, State, apply_stages, finish
from ..compensate.chain import Crop
from ..masks import water
from ..raster.environment import enter_thread
from ..scene import FloatArray, Scene
from ..tiles import Tile
from .look import Look, core_of, role_bands
from .recipe import Recipe
from .sample import Sampler

Mask = npt.NDArray[np.bool_]
Result = TypeVar("Result")


@dataclass(eq=False)
class Blocks:
    """Tiles of a sample with so much of a halo as every stage together looks at.

    Attributes
    ----------
    scene : Scene
    tiles : tuple of Tile
        Without their halos.
    sample : Sample
        What the stages so far have made of them.
    halo : int
        Pixels around a tile that are still what they would be in the whole scene.
    read : int
        Pixels around a tile that were read.
    """

    scene: Scene
    tiles: tuple[Tile, ...]
    sample: Sample
    halo: int
    read: int

    def grown(self) -> list[Tile]:
        """The tiles as they were read."""
        return [t.grown(self.read, self.scene.height, self.scene.width) for t in self.tiles]

    def cores(self) -> list[tuple[slice, slice]]:
        """Where each tile lies in its block."""
        return [core_of(t.crop_of(o), o.shape) for t, o in zip(self.tiles, self.grown(), strict=True)]

    def margins(self, halo: int) -> list[Crop]:
        """By how much each block exceeds its tile with a halo."""
        height, width = self.scene.height, self.scene.width
        return [t.grown(halo, height, width).crop_of(o) for t, o in zip(self.tiles, self.grown(), strict=True)]

    def image(self, tile: Tile, halo: int) -> FloatArray | None:
        """A tile with a halo as the stages so far left it; None where there is no such tile, or too little halo."""
        if halo > self.halo or tile not in self.tiles:
            return None
        wide = tile.grown(self.read, self.scene.height, self.scene.width)
        inner = core_of(tile.grown(halo, self.scene.height, self.scene.width).crop_of(wide), wide.shape)
        found: FloatArray = self.sample.states[self.tiles.index(tile)].image[(slice(None), *inner)]
        return found


def inside(block: FloatArray, cut: Crop) -> FloatArray:
    """A block without some rows above and below, columns left and right."""
    return block[(slice(None), *core_of(cut, block.shape[1:]))]


def read_blocks(
    scene: Scene, recipe: Recipe, look: Look, tiles: Sequence[Tile], sampler: Sampler | None, halo: int, threads: int
) -> Blocks:
    """Read tiles with halos, and which of their pixels are water (or in the sample that was named)."""
    halo = max(halo, 0 if look.water is None else look.water.halo)
    everything = list(range(len(scene.bands)))

    def work(tile: Tile) -> tuple[State, Mask]:
        outer = tile.grown(halo, scene.height, scene.width)
        block = scene.source.read(outer.window, everything)
        core = np.zeros(outer.shape, np.bool_)
        core[core_of(tile.crop_of(outer), outer.shape)] = True
        return State.own(block), core & _wanted(block, tile, outer, recipe, look, sampler)

    at_once = tiling.affordable(threads, (512, 512), 4 * len(everything))
    parts = [p for _t, p in tiling.run(tiles, work, threads=at_once, start=enter_thread)]
    return Blocks(scene, tuple(tiles), Sample([s for s, _ in parts], [m for _, m in parts]), halo, halo)


def _wanted(block: Any, tile: Tile, outer: Tile, recipe: Recipe, look: Look, sampler: Sampler | None) -> Mask:
    valid = np.asarray(np.isfinite(block).all(axis=0))
    if sampler is not None and recipe.sample != "auto":
        mask = np.zeros(outer.shape, np.bool_)
        inner = core_of(tile.crop_of(outer), outer.shape)
        mask[inner] = sampler.mask(block[(slice(None), *inner)], list(range(len(block))), tile)
        return mask & valid
    if look.water is None or not look.water.has_water:
        return valid
    return valid & water([block[b] for b in role_bands(look.roles)], look.water)


def cleaned(scene: Scene, tiles: Sequence[Tile], chain: Chain, blocks: Blocks, threads: int) -> list[FloatArray]:
    """Tiles after the stages before the removal: those of the blocks, or else read once more."""
    ready = [blocks.image(t, 0) for t in tiles]
    if all(r is not None for r in ready):
        return [r for r in ready if r is not None]

    def work(tile: Tile) -> FloatArray:
        outer = tile.grown(chain.halo_before, scene.height, scene.width)
        block = scene.source.read(outer.window, range(len(scene.bands)))
        clean = finish(apply_stages(State.of(block), chain.before), block)
        return clean[(slice(None), *core_of(tile.crop_of(outer), outer.shape))]

    largest = max(tiles, key=lambda t: t.shape[0] * t.shape[1])
    at_once = tiling.affordable(threads, largest.shape, 8 * len(scene.bands))
    return [block for _t, block in tiling.run(tiles, work, threads=at_once, start=enter_thread)]


def aside(work: Callable[[], Result]) -> Future[Result]:
    """Do some work on a thread of its own."""
    pool = ThreadPoolExecutor(1, thread_name_prefix="deglint-aside")
    try:
        return pool.submit(work)
    finally:
        pool.shutdown(wait=False)


@contextmanager
def workers(threads: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """Something like `map` that works on blocks on threads, OpenCV on one each."""
    with one_thread_each(True), ThreadPoolExecutor(threads, thread_name_prefix="deglint") as pool:
        yield pool.map


@contextmanager
def one_thread_each(wanted: bool) -> Iterator[None]:
    """OpenCV on one thread, where the tiles are on several already."""
    if not wanted:
        yield
        return
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
