"""The plan of a run, a recipe applied to one scene: bands, mask, tiles, and statistics of the background or water."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from deglint import tiles as tiling
from deglint.checks import from_plain
from deglint.errors import BandError, DeglintError, InputError, NoWaterError
from deglint.masks import WaterRule, water
from deglint.pipeline.overview import block_of, overview_of, roles_of
from deglint.readers.areas import Area, open_area
from deglint.readers.grid import ground_area, pixel_size
from deglint.readers.roles import band_roles, explain_nir, find_band, find_nir
from deglint.readers.text import read_json, read_text
from deglint.scene import Scene, image_bands
from deglint.tiles import Tile

from ..arrays import Array, Mask, Uint8
from ..background import Background, Part, both, sample_share
from ..global_rx import DETECTORS, Detector, detector
from ..local import CELL, WindowRule
from ..sea.model import LEAST_WATER, SeaModel
from ..sea.model import fit as fit_sea
from ..sea.region import WATER, SeaRule, region
from .recipe import Recipe

Progress = Callable[[str, int, int], None]
Water = tuple[WaterRule, tuple[int, ...]]  # rule that finds the water, and 0-based bands that the rule needs
SEA_TILE = 1024  # side of the tiles for "sea": large, because their halo is some hundred pixels [pixel]
_STRIP_LINES = 64  # minimum number of lines that are read at a time for "lines"
_VISIBLE_RANGE = (400.0, 700.0)  # wavelengths of the default bands of "sea" [nm]: a removal leaves glint in the NIR
_NIR = (740.0, 1100.0)  # wavelengths that show glint and almost no light from the water [nm]
_MANY = 16  # number of bands above which a spectrum alone identifies a target
_SAMPLE_BLOCK = 1024  # side of the blocks that the statistics of water are fitted to [pixel]
_BLOCKS = 4  # minimum number of blocks; more are read until their water would fill half of this number of blocks
UNKNOWN_PIXEL = 10.0  # assumed side of a pixel if it is unknown [m]


@dataclass(frozen=True, eq=False)
class Plan:
    """The plan of a run: what the options of a recipe mean for one scene.

    `bands` are 0-based bands of the scene. `nir` are the positions of the NIR bands in `bands` (for `Method.nir`). The
    background is `given` (a saved one), or is fitted to the pixels to score; with `area`, only to those in the area.
    `background`, `ready` (the detector) and `model` (of "sea") are None before the function `fitted` sets them, and for
    methods that do not use them.
    """

    scene: Scene
    recipe: Recipe
    bands: tuple[int, ...]
    nir: tuple[int, ...]
    tiles: list[Tile]
    shape: tuple[int, int]  # rows and columns of a tile
    threads: int  # number of tiles that are processed at a time
    mask: Area | None  # area to score
    water: Water | None  # rule that finds the water to score, in place of `mask`; both None: score everywhere
    area: Area | None
    given: Background | None
    pixel_area: float | None  # [m2]; None where it is not known
    notes: tuple[str, ...]  # reasons of decisions, for the user
    window: WindowRule | None = None  # for "local"
    sea: SeaRule | None = None  # for "sea"
    glint: tuple[int, ...] = ()  # for "sea": 0-based NIR bands of the scene, which measure the glint of a pixel
    background: Background | None = None
    ready: Detector | None = None
    model: SeaModel | None = None

    @property
    def law(self) -> tuple[int, int] | None:
        """Degrees of freedom, and number of background pixels, if scores follow F or chi-squared; else None."""
        if self.window is not None:
            return len(self.bands), self.window.pixels
        if not self.recipe.kind.law or self.ready is None or self.background is None:
            return None
        return len(self.ready.whiten), self.background.n

    @property
    def unbiased(self) -> float:
        """Ratio of the scores to scores from a covariance with the divisor n - 1. The latter follow F with `law`."""
        return 1.0 if self.window is None else (self.window.pixels - self.window.ddof) / (self.window.pixels - 1)

    @property
    def halo(self) -> int:
        """Width of the margin that is read to score a tile [pixel], without the halo of the rule in `water`."""
        return sum(part.halo for part in (self.window, self.sea, self.model) if part is not None)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bands in use."""
        return tuple(self.scene.names[b] for b in self.bands)

    def read_mask(self, tile: Tile) -> Mask | None:
        """Mask of the pixels to score in a tile, (row, column); None: all pixels."""
        if self.mask is not None:
            return self.mask.read(tile.window)
        if self.water is None:
            return None
        rule, bands = self.water
        outer = tile.grown(rule.halo, self.scene.height, self.scene.width)
        return np.asarray(water(self.scene.source.read(outer.window, list(bands)), rule)[tile.within(outer)])


def make_plan(
    scene: Scene, recipe: Recipe, threads: int, given: Background | None = None, *, single: bool = False
) -> Plan:
    """Choose detector, bands, mask and tiles for a scene, without fitting; `given` replaces `recipe.background`.

    If `single` (an output needs one background for the whole scene) or `given` is set, "auto" does not select "sea".
    """
    recipe, mask, sea_mask, why = _chosen(scene, recipe, threads, single or given is not None)
    notes = [why] if why else []
    if given and recipe.kind.matrices is None:
        raise InputError(f"{recipe.method} has a background of its own for every pixel: leave out the one given.")
    given, area = (given, None) if given else _background(scene, recipe)
    bands = _bands(scene, recipe, given)
    nir = tuple[int, ...]()
    if recipe.kind.nir:
        found = find_nir(scene, list(recipe.nir) or None)
        notes.append(explain_nir(scene, list(recipe.nir) or None))
        if not set(found) <= set(bands):
            raise BandError(f"{recipe.method} needs the NIR among the bands in use: name it with -b, too.")
        nir = tuple(bands.index(b) for b in found)
    notes += [sea_mask[0].reason] if sea_mask else []
    size = (scene.height, scene.width)
    # from georeferencing, the tag GSD_M, or the sensor
    pixel_area = ground_area(scene.transform, scene.crs, *size) or (pixel_size(scene) or 0) ** 2 or None
    shape, own = tiling.tile_shape(*size, len(bands), block_of(scene)), dict[str, Any]()
    if recipe.method == "local":
        rows, columns = (-(-side // CELL) for side in shape)  # cells of a tile: few enough to occupy all threads
        while math.prod(size) < 2 * threads * rows * columns * CELL**2 and rows * columns > 1:
            rows, columns = (rows // 2, columns) if rows >= columns else (rows, columns // 2)
        shape = rows * CELL, columns * CELL
        ridge = recipe.ridge if recipe.covariance == "ridge" else 0.0
        own = {"window": WindowRule(*recipe.window, size, recipe.border, recipe.ddof, ridge)}
    elif recipe.method == "sea":
        shape = SEA_TILE, SEA_TILE
        if pixel_area is None and recipe.false_per_km2 is not None:
            raise InputError(f"false-per-km2 needs the size of a pixel, and {scene.path} has no CRS. Give --pfa.")
        rule = SeaRule(math.sqrt(pixel_area or UNKNOWN_PIXEL**2), *recipe.largest_object)
        own = {"sea": rule, "glint": _between(scene, *_NIR)}
    elif recipe.method == "lines":
        shape, threads = (min(max(block_of(scene)[0], _STRIP_LINES), SEA_TILE), scene.width), 1
    cells, at_once = tiling.tiles(*size, shape), tiling.affordable(threads, shape, 2 * len(bands))
    said = tuple(notes)
    return Plan(scene, recipe, bands, nir, cells, shape, at_once, mask, sea_mask, area, given, pixel_area, said, **own)


def _chosen(scene: Scene, recipe: Recipe, threads: int, single: bool) -> tuple[Recipe, Area | None, Water | None, str]:
    """Replace "auto" in a recipe; return recipe, `Plan.mask`, `Plan.water`, and reason ("" if `method` was set)."""
    if recipe.method != "auto":
        return *_masked(scene, recipe, threads), ""
    method, why = _without_sea(scene, recipe, single)
    if not why:
        try:
            searched = replace(recipe, method="sea")
            said = "water was found" if recipe.mask in ("auto", "water") else "--mask gives the water"
            return *_masked(scene, searched, threads), f"method auto: sea ({said})"
        except (InputError, NoWaterError) as error:
            if recipe.mask not in ("auto", "water"):
                raise
            why = re.split(r"; |\. |, so that", str(error))[0]
    if recipe.false_per_km2 is not None:
        raise InputError(
            f"--false-per-km2 needs method sea; auto chose {method} ({why}). Give --pfa, or the water: --mask."
        )
    return *_masked(scene, replace(recipe, method=method), threads), f"method auto: {method} ({why})"


def _background(scene: Scene, recipe: Recipe) -> tuple[Background | None, Area | None]:
    """Open `recipe.background`; return (saved background, None), (None, area to fit in), or (None, None) for ""."""
    if not (name := recipe.background):
        return None, None
    if name.lower().endswith(".json"):
        text = read_text(name, "--background")
        if '"covariance"' in text:
            return Background.from_json(text), None
    return None, open_area(name, scene, "--background")


def _bands(scene: Scene, recipe: Recipe, given: Background | None) -> tuple[int, ...]:
    """0-based bands to use: those that the saved background `given` names, in its order; else `recipe.bands`; else for
    "sea" the visible bands, if at least two are known; else all images (`image_bands`). Raises BandError if `given` and
    recipe do not match.
    """
    own = tuple(scene.index(name) for name in given.names) if given else ()
    bands = own or tuple(image_bands(scene.bands, ()))
    if recipe.bands:
        bands = tuple(dict.fromkeys(find_band(scene, b) for b in recipe.bands))
    elif not own and recipe.method == "sea":
        roles = band_roles(scene)
        colours = tuple(sorted({i for r in ("blue", "green", "red") if (i := roles[r]) is not None}))
        bands = next((b for b in (_between(scene, *_VISIBLE_RANGE), colours) if len(b) > 1), bands)
    if given is not None and (len(bands) != given.bands or (own and set(own) != set(bands))):
        raise BandError(
            f"the saved background has {given.bands} bands{': ' * bool(own)}{', '.join(given.names)}; the scene is "
            f"to be used with {len(bands)}: {', '.join(scene.names[b] for b in bands)}. Name the same bands with -b."
        )
    return own or bands


def _masked(scene: Scene, recipe: Recipe, threads: int) -> tuple[Recipe, Area | None, Water | None]:
    """Replace the mask "auto" of a recipe; return the recipe, and the values of `Plan.mask` and `Plan.water`."""
    if recipe.mask == "auto":
        recipe = replace(recipe, mask="water" if recipe.method == "sea" else "none")
    if recipe.mask == "none":
        return recipe, None, None
    if recipe.mask != "water":
        return recipe, open_area(recipe.mask, scene, "--mask"), None
    nir = find_nir(scene, list(recipe.nir) or None)[0]
    if (known := water_of_removal(scene, nir)) is not None:
        return recipe, None, known
    overview = overview_of(scene, nir, threads)
    if overview.water is None:
        raise InputError("water cannot be determined without a band below 750 nm. Give --mask FILE, or --mask none.")
    if not overview.water.has_water:
        raise NoWaterError(overview.water.reason)
    return recipe, None, (overview.water, overview.bands)


def _without_sea(scene: Scene, recipe: Recipe, single: bool) -> tuple[str, str]:
    """Method to use in place of "sea", and the reason, which is "" if "sea" is possible. `single`: see `make_plan`."""
    bands, pixels = len(recipe.bands or scene.bands), scene.height * scene.width
    others = {option: name for name, kind in DETECTORS.items() if name != "sea" for option in kind.options}
    for name, method in (others | {"background": "rx", "covariance": "rx"}).items():
        if getattr(recipe, name) != getattr(Recipe, name):
            return method, f"--{name} is for {method}"
    if recipe.threshold in ("chi2", "f"):
        return "rx", f"--threshold {recipe.threshold} is for rx scores"
    reasons = (
        (single, "one background for all pixels is needed"),
        (bands > _MANY, f"{bands} bands distinguish targets by their spectrum"),
        (pixels < LEAST_WATER, f"{pixels} pixels are too few for statistics of water"),
    )
    return "rx", next((why for holds, why in reasons if holds), "")


def _between(scene: Scene, low: float, high: float) -> tuple[int, ...]:
    """0-based bands whose wavelength is known and lies in the range from `low` to `high` [nm]."""
    return tuple(i for i, b in enumerate(scene.bands) if b.wavelength is not None and low <= b.wavelength <= high)


def water_of_removal(scene: Scene, nir: int) -> Water | None:
    """Read the rule that finds the water, and the bands that it needs, from the sidecar of `deglint remove`.

    The result is None if the scene has no such sidecar, if the rule found no water, or if its NIR band is not `nir`.
    The rule was made before the removal, but is still valid: it uses mostly the NIR, which the removal does not change.
    """
    _roles, bands = roles_of(scene, nir)
    try:
        numbers = dict(read_json(f"{scene.path}.json", "sidecar")["water"])
        rule: WaterRule = from_plain(WaterRule, {k: v for k, v in numbers.items() if v is not None})  # null: not finite
    except (DeglintError, KeyError, TypeError, ValueError):
        return None
    roles = rule.roles
    same = max(roles.nir, *roles.visible) < len(bands) and bands[roles.nir] == nir
    return (rule, bands) if rule.has_water and same else None


def fitted(plan: Plan, run: tiling.RunTiles = tiling.run, progress: Progress | None = None) -> Plan:
    """Return the plan with fitted background and detector, or model for "sea"; `run` is as in `fit_background`."""
    if plan.sea is not None:
        model = _fit_sea(plan, plan.sea)
        return replace(plan, model=model, glint=plan.glint if model.glint else ())
    if plan.recipe.kind.matrices is None:
        return plan
    background = plan.given or fit_background(plan, run, progress)
    ready = detector(plan.recipe.method, background, drop=plan.recipe.drop, nir=plan.nir)
    return replace(plan, background=background, ready=ready)


def fit_background(plan: Plan, run: tiling.RunTiles = tiling.run, progress: Progress | None = None) -> Background:
    """Fit the background of a plan tile by tile; `run` processes the tiles, on threads or on a cluster."""
    recipe, bands = plan.recipe, plan.bands
    share = sample_share(recipe.covariance, plan.scene.height * plan.scene.width)

    def inside(tile: Tile) -> Mask | None:
        return both(plan.read_mask(tile), None if plan.area is None else plan.area.read(tile.window))

    def count(tile: Tile) -> int:
        mask = inside(tile)
        return math.prod(tile.shape) if mask is None else int(np.count_nonzero(mask))

    def gather(tile: Tile) -> Part:
        block = plan.scene.source.read(tile.window, list(bands))
        return Part.of(block, inside(tile), (tile.row0, tile.col0), share)

    if share > 1:
        counts = run(plan.tiles, count, threads=plan.threads)
        share = sample_share(recipe.covariance, sum(n for _tile, n in counts))
    told = progress and partial(progress, "fit")
    done = run(plan.tiles, gather, progress=told, threads=plan.threads)
    whole = Part.merge(list(tiling.by_rows(done, Part.merge)))
    return whole.background(recipe.covariance, recipe.ridge, plan.names)


def _fit_sea(plan: Plan, rule: SeaRule) -> SeaModel:
    """Fit the statistics of the water to a scene, or to blocks from all parts of the water if the scene is large."""
    scene, blocks, nir = plan.scene, [], []
    block_side = _SAMPLE_BLOCK if max(scene.height, scene.width) > 2 * _SAMPLE_BLOCK else 2 * _SAMPLE_BLOCK
    everything, held = tiling.tiles(scene.height, scene.width, (block_side, block_side)), 0
    places = tiling.spread(everything, 16 * _BLOCKS * _SAMPLE_BLOCK**2)
    for i in np.random.default_rng(0).permutation(len(places)):  # in order, the first blocks are the upper edge alone
        block, classes, shown = read_sea(plan, rule, places[i])
        if count := int(np.count_nonzero(classes == WATER)):
            blocks.append((block, classes))
            nir.append(shown)
            held += count
        if held >= _BLOCKS * _SAMPLE_BLOCK**2 // 2 and len(blocks) >= _BLOCKS:
            break
    if not blocks:
        raise NoWaterError(f"no water in {scene.path} to compare with. Check --mask and --nodata, or take --method rx.")
    side = None if plan.recipe.side == "auto" else plan.recipe.side
    return fit_sea(blocks, pixel=rule.pixel, side=side, nir=nir if plan.glint else ())


def read_sea(plan: Plan, rule: SeaRule, tile: Tile) -> tuple[Array, Uint8, Array]:
    """Read a tile: bands in use, (band, row, column), `sea.region` classes, (row, column), NIR, (band, row, column)."""
    values = plan.scene.source.read(tile.window, [*plan.bands, *plan.glint])
    block, nir = np.split(values, [len(plan.bands)])
    valid = np.asarray(np.isfinite(block).all(axis=0))
    mask = plan.read_mask(tile)
    water = valid if mask is None else np.logical_and(mask, valid)
    return block, region(water, rule, valid), nir
