"""Where the sample is: found in the scene, drawn by hand, a window, or everywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..errors import FitError
from ..masks import away_from_shore, deep_water, fit_sample, water
from ..readers.areas import open_area
from ..remove import SampleTile
from ..scene import FloatArray, Scene, Window
from ..tiles import Tile
from .look import LOOK_PIXELS, LOOK_SIDE, Look, core_of, read_looks, role_bands, tile_shape_of
from .recipe import Recipe


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


def sampler_of(
    scene: Scene, recipe: Recipe, look: Look, threads: int, clean: Sequence[FloatArray] | None = None
) -> Sampler:
    """The sampler that a recipe asks for; with the look's tiles as the stages before the removal leave them, of those.

    Raises
    ------
    FitError, InputError, ReadError
        No sample can be found, or the one that was named cannot be used.
    """
    if recipe.sample == "auto":
        return _auto_sampler(scene, look, threads, clean)
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


def _auto_sampler(scene: Scene, look: Look, threads: int, clean: Sequence[FloatArray] | None) -> Sampler:
    if look.water is None:
        raise FitError(
            "a sample cannot be found without a visible band to tell water by. Pass --sample FILE.geojson, a window, "
            "or --sample all."
        )
    wanted = list(role_bands(look.roles))
    blocks = read_looks(scene, look.tiles, look.roles, threads) if clean is None else [c[wanted] for c in clean]
    rule = fit_sample(blocks, look.water)
    if clean is not None:
        # what is left of the glint is faint everywhere: where it is strongest, its level is too bright
        rule = replace(rule, least_variance=0.0, level=np.inf)
    numbers = {"rule": rule.numbers(), "looked_at_tiles": len(look.tiles)}
    bands = role_bands(look.roles)

    def mask(block: Any, columns: Sequence[int], _tile: Tile) -> npt.NDArray[np.bool_]:
        return deep_water(block[[columns.index(b) for b in bands]], rule)

    pixels = sum(t.shape[0] * t.shape[1] for t in look.tiles)
    return Sampler(look.tiles, mask, bands, rule.halo, pixels, numbers)


def sample_reader(scene: Scene, look: Look, sampler: Sampler | None) -> Callable[[Tile], SampleTile]:
    """What reads a tile with all bands and its open water, for methods that look at neighbours.

    Parameters
    ----------
    scene : Scene
    look : Look
    sampler : Sampler, optional
        The sample that the user named; all open water by default.
    """
    rule = look.water if sampler is None else None
    halo, every = 0 if rule is None else rule.halo, list(range(len(scene.bands)))

    def work(tile: Tile) -> SampleTile:
        outer, origin = tile.grown(halo, scene.height, scene.width), (tile.row0, tile.col0)
        inner = core_of(tile.crop_of(outer), outer.shape)
        wide = scene.source.read(outer.window, every)
        block = np.ascontiguousarray(wide[(slice(None), *inner)])
        if sampler is not None:
            found = np.ascontiguousarray(sampler.mask(block, every, tile))
        elif rule is None:
            found = np.ones(tile.shape, np.bool_)
        else:
            found = np.ascontiguousarray(water([wide[b] for b in role_bands(look.roles)], rule)[inner])
        away = away_from_shore(found)
        return SampleTile(block, found, away if away.any() else found, origin)

    return work


def tiles_of(scene: Scene, sampler: Sampler) -> list[Tile]:
    """So many tiles of a sample as a look may hold; the same ones however the file is stored."""
    if sampler.bounds is None:
        return some(sampler.tiles)
    return some(tiles_over(scene, sampler.bounds, (LOOK_SIDE, LOOK_SIDE)))


def some(tiles: Sequence[Tile]) -> list[Tile]:
    """So many of the tiles as a look may hold."""
    if sum(t.shape[0] * t.shape[1] for t in tiles) <= 2 * LOOK_PIXELS:
        return list(tiles)
    return tiling.spread(tiles, LOOK_PIXELS)
