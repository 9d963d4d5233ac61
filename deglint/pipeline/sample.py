"""Where the sample is: found in the scene, drawn by hand, a window, or everywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..errors import FitError
from ..masks import deep_water, fit_sample
from ..readers.areas import open_area
from ..scene import FloatArray, Scene, Window
from ..tiles import Tile
from .look import Look, read_looks, role_bands, tile_shape_of
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
    pixels = (bottom - top) * (right - left)
    return Sampler(inside, lambda _b, _c, t: area.read(t.window), pixels=pixels, bounds=area.bounds)


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
