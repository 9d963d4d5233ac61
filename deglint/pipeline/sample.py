"""Where the sample is: found in the scene, drawn by hand, a window, or everywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..errors import FitError
from ..masks import away_from_shore, deep_water, fit_sample, water
from ..moments import CELL
from ..raster.environment import enter_thread
from ..readers.areas import open_area
from ..remove import SampleTile
from ..remove.strips import Strips, filled
from ..remove.wiener import StripFinder
from ..scene import FloatArray, Scene, Window
from ..tiles import Tile
from .overview import OVERVIEW_PIXELS, TILE_SIDE, Overview, core_of, place_in, read_overview, role_bands, tile_shape_of
from .recipe import Recipe

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Sampler:
    """Where the sample is: tiles to read, a mask for a block of some bands, and rows and columns that hold it all."""

    tiles: Sequence[Tile]
    mask: Callable[[Any, Sequence[int], Tile], npt.NDArray[np.bool_]]
    bands: tuple[int, ...] = ()
    halo: int = 0
    pixels: int = 0
    numbers: dict[str, Any] = field(default_factory=dict)
    bounds: Window | None = None


def sampler_of(scene: Scene, recipe: Recipe, overview: Overview, threads: int) -> Sampler:
    """The sampler that a recipe asks for.

    Raises
    ------
    FitError, InputError, ReadError
        No sample can be found, or the one that was named cannot be used.
    """
    if recipe.sample == "auto":
        return _auto_sampler(scene, overview, threads)
    shape = tile_shape_of(scene)
    if recipe.sample == "all":
        everything = tiling.tiles(scene.height, scene.width, shape)
        window = (0, scene.height), (0, scene.width)
        pixels = scene.height * scene.width
        return Sampler(everything, lambda _b, _c, t: np.ones(t.shape, np.bool_), pixels=pixels, bounds=window)
    area = open_area(recipe.sample, scene, "--sample")
    (top, bottom), (left, right) = area.bounds
    inside = tiles_over(scene, area.bounds, shape)
    note = getattr(area, "note", "")
    numbers = {"crs": note} if note else {}
    pixels = (bottom - top) * (right - left)
    return Sampler(inside, lambda _b, _c, t: area.read(t.window), pixels=pixels, numbers=numbers, bounds=area.bounds)


def tiles_over(scene: Scene, bounds: Window, shape: tuple[int, int]) -> list[Tile]:
    """Tiles of a shape that hold some of a window."""
    (top, bottom), (left, right) = bounds
    return [
        t for t in tiling.tiles(scene.height, scene.width, shape)
        if t.row0 < bottom and t.row1 > top and t.col0 < right and t.col1 > left
    ]  # fmt: skip


def _auto_sampler(scene: Scene, overview: Overview, threads: int) -> Sampler:
    if overview.water is None:
        raise FitError(
            "a sample cannot be found without a visible band to tell water by. Pass --sample FILE.geojson, a window, "
            "or --sample all."
        )
    rule = fit_sample(read_overview(scene, overview.tiles, overview.roles, threads), overview.water)
    numbers = {"rule": rule.numbers(), "tiles": len(overview.tiles)}
    bands = role_bands(overview.roles)

    def mask(block: Any, columns: Sequence[int], _tile: Tile) -> Mask:
        return deep_water(block[[columns.index(b) for b in bands]], rule)

    pixels = sum(t.shape[0] * t.shape[1] for t in overview.tiles)
    return Sampler(overview.tiles, mask, bands, rule.halo, pixels, numbers)


@dataclass(frozen=True, eq=False)
class Training:
    """A tile of a scene to learn from, with the pixels around it that stages need.

    Attributes
    ----------
    tile, outer : Tile
        Without and with these pixels.
    block : (band, row, column) ndarray
        Of `outer`, physical values of all bands.
    water : (row, column) bool ndarray
        Of `outer`, where it is water.
    sample : (row, column) bool ndarray
        Of `tile`: water to learn from, away from shores, or the sample that the user named.
    """

    tile: Tile
    outer: Tile
    block: FloatArray
    water: Mask
    sample: Mask

    @property
    def core(self) -> tuple[slice, slice]:
        """Where the tile lies in the block."""
        return core_of(self.tile.crop_of(self.outer), self.outer.shape)

    @property
    def inside(self) -> Mask:
        """The sample, in the block."""
        out = np.zeros(self.outer.shape, np.bool_)
        out[self.core] = self.sample
        return out

    def as_sample(self, image: FloatArray | None = None) -> SampleTile:
        """For methods that look at neighbours: the tile, or what stages have made of the block."""
        block = np.ascontiguousarray((self.block if image is None else image)[(slice(None), *self.core)])
        return SampleTile(block, np.ascontiguousarray(self.water[self.core]), self.sample,
                          (self.tile.row0, self.tile.col0))  # fmt: skip


def training_reader(
    scene: Scene, overview: Overview, sampler: Sampler | None, halo: int = 0
) -> Callable[[Tile], Training]:
    """What reads a tile to learn from, with so many pixels around it.

    Parameters
    ----------
    scene : Scene
    overview : Overview
    sampler : Sampler, optional
        The sample that the user named; all open water by default.
    halo : int
    """
    rule, every = overview.water, list(range(len(scene.bands)))
    named = rule is None or (sampler is not None and not halo)
    reach = 0 if rule is None or named else rule.halo

    def work(tile: Tile) -> Training:
        outer = tile.grown(halo, scene.height, scene.width)
        wide = outer.grown(reach, scene.height, scene.width)
        read = scene.source.read(wide.window, every)
        place = place_in(outer, wide)
        block, found = np.ascontiguousarray(read[place]), np.ones(outer.shape, np.bool_)
        if rule is not None and not named:
            found = np.ascontiguousarray(water([read[b] for b in role_bands(overview.roles)], rule)[place[1:]])
        core = core_of(tile.crop_of(outer), outer.shape)
        if sampler is None:
            away = away_from_shore(found)[core]
            sample = away if away.any() else found[core]
        else:
            sample = sampler.mask(block[(slice(None), *core)], every, tile)
            found[core] = sample if not halo else found[core] | sample
        return Training(tile, outer, block, found, np.ascontiguousarray(sample))

    return work


def tiles_of(scene: Scene, sampler: Sampler) -> list[Tile]:
    """So many tiles of a sample as an overview may hold; the same ones however the file is stored."""
    if sampler.bounds is None:
        return some(sampler.tiles)
    return some(tiles_over(scene, sampler.bounds, (TILE_SIDE, TILE_SIDE)))


def some(tiles: Sequence[Tile]) -> list[Tile]:
    """So many of the tiles as an overview may hold."""
    if sum(t.shape[0] * t.shape[1] for t in tiles) <= 2 * OVERVIEW_PIXELS:
        return list(tiles)
    return tiling.spread(tiles, OVERVIEW_PIXELS)


def strips_of_footprints(scene: Scene, band: int) -> Strips | None:
    """Strips by the footprints of a band's detectors, odd and even; None where there are none, or of one kind alone."""
    if scene.footprints is None:
        return None
    centres = np.minimum(np.arange(CELL // 2, scene.width + CELL // 2, CELL), scene.width - 1)
    known = []
    for row in range(CELL // 2, scene.height + CELL // 2, CELL):
        at = min(row, scene.height - 1)
        line = scene.footprints.read(((at, at + 1), (0, scene.width)), [band])[0, 0, centres]
        known.append(np.where(np.isfinite(line), np.nan_to_num(line) % 2, -1).astype(np.int8))
    second = filled(np.array(known))
    return Strips.of(second) if second.any() and not second.all() else None


def strips_finder(scene: Scene, read: Callable[[Tile], Training], threads: int) -> Callable[[StripFinder], Strips]:
    """What looks at all of a scene for strips, square by square, once a sample has shown that there are some."""

    def find(finder: StripFinder) -> Strips:
        known = np.full((-(-scene.height // CELL), -(-scene.width // CELL)), -1, np.int8)
        everything = tiling.tiles(scene.height, scene.width, (TILE_SIDE, TILE_SIDE))
        found = tiling.run(everything, lambda tile: finder(read(tile).as_sample()), threads=threads, start=enter_thread)
        for _tile, (places, second) in found:
            known[places[:, 0] // CELL, places[:, 1] // CELL] = second
        return Strips.of(filled(known))

    return find
