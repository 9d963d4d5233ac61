"""What a recipe means for one scene: its bands, where to score, where the background is, and the tiles to work in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from deglint import tiles as tiling
from deglint.errors import BandError, InputError, NoWaterError
from deglint.masks import Roles, WaterRule, water
from deglint.pipeline.overview import block_of, overview_of, role_bands
from deglint.readers.areas import Area, open_area
from deglint.readers.roles import explain_nir, find_band, find_nir
from deglint.readers.text import read_text
from deglint.scene import Scene
from deglint.tiles import Tile

from ..background import Background
from ..local import CELL, WindowRule
from .recipe import Recipe
from .sea_plan import SeaPlan, no_nir, plan_sea, visible_bands, water_of_removal, why_not_sea

Mask = npt.NDArray[np.bool_]
Progress = Callable[[str, int, int], None]
SEA_TILE = 1024
"""Side of the tiles of sea, whose halo is some hundred pixels [pixel]."""
_STRIP_LINES = 64
"""Least lines that are read at a time, where lines are scored one after the other."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A recipe made ready for a scene.

    Bands are 0-based; `nir` counts among `bands`. The background is fitted inside `area` (everywhere where it is None),
    unless it is given; `rule` is that of local RX, `sea` that of a search of the sea.
    """

    scene: Scene
    recipe: Recipe
    bands: tuple[int, ...]
    nir: tuple[int, ...]
    tiles: list[Tile]
    shape: tuple[int, int]
    threads: int
    mask: Masking
    area: Area | None
    given: Background | None
    rule: WindowRule | None
    notes: tuple[str, ...] = ()
    progress: Progress | None = None
    sea: SeaPlan | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bands in use."""
        return tuple(self.scene.names[b] for b in self.bands)

    def note(self, stage: str) -> Callable[[int, int], None] | None:
        """Progress of a stage."""
        tell = self.progress
        return (lambda done, total: tell(stage, done, total)) if tell else None


@dataclass(frozen=True, eq=False)
class Masking:
    """Where to score: everywhere, inside an area, or on water."""

    scene: Scene
    area: Area | None = None
    water: WaterRule | None = None
    water_bands: tuple[int, ...] = ()

    def read(self, tile: Tile) -> Mask | None:
        """Mask of a tile; None for everywhere."""
        if self.area is not None:
            return self.area.read(tile.window)
        if self.water is None:
            return None
        outer = tile.grown(self.water.halo, self.scene.height, self.scene.width)
        found = water(self.scene.source.read(outer.window, list(self.water_bands)), self.water)
        return np.asarray(found[tile.within(outer)])


def make_plan(scene: Scene, recipe: Recipe, threads: int, progress: Progress | None = None) -> Plan:
    """Find out what a recipe needs to know of a scene.

    Raises
    ------
    BandError, InputError, ReadError, NoWaterError
        A band, file or window that cannot be used, or no water where it was asked for.
    """
    recipe, mask, notes = _chosen(scene, recipe, threads)
    given, area = _background(scene, recipe)
    bands = _bands(scene, recipe, given)
    nir = tuple[int, ...]()
    if recipe.method == "residual":
        found = find_nir(scene, list(recipe.nir) or None)
        notes.append(explain_nir(scene, list(recipe.nir) or None))
        if not set(found) <= set(bands):
            raise BandError("residual needs the NIR among the bands in use: name it with -b, too.")
        nir = tuple(bands.index(b) for b in found)
    if mask.water is not None:
        notes.append(mask.water.reason)
    rule = None
    if recipe.method == "local":
        size = (scene.height, scene.width)
        ridge = recipe.ridge if recipe.covariance == "ridge" else 0.0
        rule = WindowRule(*recipe.window, recipe.border, size, recipe.ddof, ridge)
    shape = tiling.tile_shape(scene.height, scene.width, len(bands), block_of(scene))
    if rule is not None:
        shape = _local_shape(shape, scene, threads)
    of_sea = plan_sea(scene, recipe) if recipe.method == "sea" else None
    if of_sea is not None:
        shape = (SEA_TILE, SEA_TILE)
    if recipe.method == "lines":
        shape, threads = (min(max(block_of(scene)[0], _STRIP_LINES), SEA_TILE), scene.width), 1
    everything = tiling.tiles(scene.height, scene.width, shape)
    at_once = tiling.affordable(threads, shape, 2 * len(bands))
    return Plan(
        scene, recipe, bands, nir, everything, shape, at_once, mask, area, given, rule, tuple(notes), progress, of_sea
    )


def _chosen(scene: Scene, recipe: Recipe, threads: int) -> tuple[Recipe, Masking, list[str]]:
    """The recipe with its detector and mask chosen, where to score, and why."""
    if recipe.method != "auto":
        mask = recipe.mask if recipe.mask != "auto" else "water" if recipe.method == "sea" else "none"
        recipe = replace(recipe, mask=mask)
        return recipe, _masking(scene, recipe, threads), []
    why = why_not_sea(scene, recipe)
    if not why:
        try:
            searched = replace(recipe, method="sea", mask="water" if recipe.mask == "auto" else recipe.mask)
            return searched, _masking(scene, searched, threads), ["auto: sea, since there is water to compare with"]
        except BandError as error:
            why = no_nir(error)
        except (InputError, NoWaterError) as error:
            if recipe.mask not in ("auto", "water"):
                raise
            why = str(error).split(".", 1)[0]
    if recipe.false_per_km2 is not None:
        raise InputError(f"false-per-km2 needs the sea, and auto takes rx: {why}. Give --pfa, or --mask FILE.")
    recipe = replace(recipe, method="rx", mask="none" if recipe.mask == "auto" else recipe.mask)
    return recipe, _masking(scene, recipe, threads), [f"auto: rx, since {why}"]


def _background(scene: Scene, recipe: Recipe) -> tuple[Background | None, Area | None]:
    """What --background names: a background that was saved, or an area."""
    name = recipe.background
    if not name:
        return None, None
    if name.lower().endswith(".json"):
        text = read_text(name, "--background")
        if '"background"' in text and '"covariance"' in text:
            try:
                return Background.from_json(text), None
            except InputError as error:
                raise InputError(f"{name} (--background): {error}") from error
    return None, open_area(name, scene, "--background")


def _bands(scene: Scene, recipe: Recipe, given: Background | None) -> tuple[int, ...]:
    """0-based bands to use, in the order of a saved background where there is one."""
    if recipe.bands:
        bands = tuple(dict.fromkeys(find_band(scene, b) for b in recipe.bands))
    elif given is not None and given.names:
        bands = tuple(scene.index(name) for name in given.names)
    elif recipe.method == "sea":
        bands = visible_bands(scene)
    else:
        bands = tuple(range(len(scene.bands)))
    if given is not None and len(bands) != given.bands:
        raise BandError(
            f"the saved background has {given.bands} bands, the scene is to be used with {len(bands)}. "
            "Name the same bands with -b."
        )
    return bands


def _masking(scene: Scene, recipe: Recipe, threads: int) -> Masking:
    if recipe.mask == "none":
        return Masking(scene)
    if recipe.mask != "water":
        return Masking(scene, open_area(recipe.mask, scene, "--mask"))
    nir = find_nir(scene, list(recipe.nir) or None)[0]
    if (known := water_of_removal(scene, nir)) is not None:
        return Masking(scene, None, *known)
    look = overview_of(scene, nir, threads, wanted=True)
    if look.water is None:
        raise InputError("water cannot be told without a visible band. Give --mask FILE, or --mask none.")
    if not look.water.has_water:
        raise NoWaterError(look.water.reason)
    roles: Roles = look.roles
    return Masking(scene, None, look.water, role_bands(roles))


def _local_shape(shape: tuple[int, int], scene: Scene, threads: int) -> tuple[int, int]:
    """Tiles of whole cells of local RX, and enough of them for all threads."""
    rows, columns = (-(-side // CELL) for side in shape)
    while -(-scene.height // (rows * CELL)) * -(-scene.width // (columns * CELL)) < 2 * threads and rows * columns > 1:
        rows, columns = (rows // 2, columns) if rows >= columns else (rows, columns // 2)
    return rows * CELL, columns * CELL
