"""Fit a recipe to a scene: one pass over the sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..checks import check_kind, checked_keywords
from ..compensate import Chain, State, apply_stages, finish
from ..errors import FitError, NoWaterError
from ..masks import WaterRule, sample_halo
from ..needs import HEAVY_COVER, Needs
from ..raster.environment import enter_thread, environment
from ..readers.areas import Area, collection, open_area, to_geojson
from ..remove import (
    METHODS,
    FitRequest,
    GlintModel,
    SamplePlan,
    SampleStatistics,
    combine,
    gather,
    harmful,
    useless,
    wiener,
)
from ..remove.multiband import PERCENTILE, references
from ..scene import Scene, Window
from ..tiles import Tile, default_threads
from .blocks import Blocks, cleaned
from .compensation import Plan, fit_after, fit_before, may_open, plan
from .log import log_model, log_needs, log_nir, log_sample, log_scene, log_water
from .look import LOOK_SIDE, Look, check_size, core_of, looks, role_bands, where_to_sample
from .recipe import Recipe, make_request
from .sample import Sampler, sample_reader, sampler_of, some, tiles_of
from .strips import strips_finder, strips_of_footprints
from .tolerance import Sampling, short_of
from .undeclared import Undeclared, undeclared
from .warming import warming

Progress = Callable[[str, int, int], None]
HEAVY_FLOOR = 1.0
"""Percentile of the mixture of references as its level where compensation has left much glint [%]."""
FAINT_COVER = 0.2
"""Share of glinted pixels above which faint glint is everywhere, and lies as evenly as noise and the mirrored sky."""


@dataclass(frozen=True)
class Fitted:
    """A fitted scene.

    Attributes
    ----------
    model : GlintModel
    recipe : Recipe
        With every "auto" resolved.
    notes : tuple of str
        What was decided, one line each, for the log.
    numbers : dict
        The same as numbers, for the sidecar.
    sample : dict or None
        The sample as GeoJSON, where it was asked for.
    water : WaterRule or None
        How water is told, where it has to be; `water_bands` are the 0-based scene bands that it looks at.
    needs : Needs
        What the scene needs, and does not.
    chain : Chain
        Stages of compensation around the removal; empty where the scene needs none.
    undeclared : Undeclared
        Nodata and offsets that the pixels have shown.
    """

    model: GlintModel
    recipe: Recipe
    notes: tuple[str, ...] = ()
    numbers: dict[str, Any] = field(default_factory=dict)
    sample: dict[str, Any] | None = None
    water: WaterRule | None = None
    water_bands: tuple[int, ...] = ()
    chain: Chain = field(default_factory=Chain)
    needs: Needs = field(default_factory=Needs)
    undeclared: Undeclared = field(default_factory=Undeclared)

    def __repr__(self) -> str:
        return f"Fitted({self.model!r}, compensation {self.chain.text if self.chain.runs else 'none'})"

    def _repr_html_(self) -> str:
        return self.model._repr_html_()


@checked_keywords()
def fit_scene(
    scene: Scene,
    recipe: Recipe | None = None,
    *,
    threads: int | None = None,
    want_sample: bool = False,
    progress: Progress | None = None,
    run: tiling.Run = tiling.run,
) -> Fitted:
    """Fit a recipe to a scene without correcting it.

    Parameters
    ----------
    scene : Scene
    recipe : Recipe, optional
    threads : int, optional
        All processors by default; the result does not depend on it.
    want_sample : bool
        Return the sample's outline as GeoJSON.
    progress : callable, optional
        Called as progress(stage, done, total).
    run : callable
        What passes over the sample's tiles: threads here, or a cluster's `run`.

    Returns
    -------
    Fitted

    Raises
    ------
    BandError
        No NIR band, or a band that is not there.
    NoWaterError
        Nothing in the scene is water.
    FitError
        The sample cannot carry a fit.

    Examples
    --------
    >>> fitted = fit_scene(open_scene("scene.tif"), Recipe(method="hedley"))  # doctest: +SKIP
    >>> print(fitted.model)  # doctest: +SKIP
    """
    check_kind(scene, Scene, "scene", "Open it with deglint.open_scene.")
    recipe = recipe or Recipe()
    check_kind(recipe, Recipe, "recipe", "Make one: deglint.Recipe(method='hedley').")
    threads = threads or default_threads()
    with environment():
        found = undeclared(scene)
        scene = found.on(scene)
        log_scene(scene)
        check_size(scene, recipe)
        request, notes = make_request(scene, recipe)
        log_nir(scene, [b for i in request.indexes for b in i.bands], notes)
        request = replace(request, regression=_regression(recipe))
        nir = request.indexes[0].bands[0]
        if _is_sampled(recipe):
            recipe = replace(recipe, sample=where_to_sample(scene, recipe, nir, threads))
        wanted = recipe.mask == "auto" or (_is_sampled(recipe) and recipe.sample == "auto")
        with warming(may_open(scene, recipe)):
            for look in looks(scene, nir, threads, wanted=wanted):
                try:
                    fitted = _fit_look(scene, recipe, request, look, notes, threads, want_sample, progress, run)
                    if look.whole or recipe.sample != "auto" or not short_of(fitted.numbers):
                        return replace(fitted, undeclared=found)
                except (NoWaterError, FitError):
                    # a look at a part may have missed the water, or the deep of it: look at more
                    if look.whole or (recipe.sample != "auto" and (look.water is None or look.water.has_water)):
                        raise
    raise AssertionError("unreachable: the last look is at everything")


def _is_sampled(recipe: Recipe) -> bool:
    """Whether the method learns from a sample; `auto` takes one that does."""
    method = METHODS.get(recipe.method)
    return method is None or method.plan is not None or method.neighbours


def _regression(recipe: Recipe) -> str:
    if recipe.regression != "auto":
        return recipe.regression
    return "detrended" if recipe.sample == "auto" else "ols"


def _fit_look(
    scene: Scene, recipe: Recipe, request: FitRequest, look: Look, notes: Sequence[str], threads: int,
    want_sample: bool, progress: Progress | None, run: tiling.Run,
) -> Fitted:  # fmt: skip
    notes = list(notes)
    if look.water is not None:
        if not look.water.has_water:
            raise NoWaterError(look.water.reason)
        notes.append(look.water.reason)
    log_water(look.water, recipe.mask)
    given = sampler_of(scene, recipe, look, threads) if recipe.sample != "auto" else None
    reach = 0 if given else _reach(recipe, request, look)
    todo = plan(scene, recipe, request, look, given, reach, threads)
    log_needs(todo.needs)
    chain, blocks, protection = Chain(), None, None
    if todo.runs:
        chain, blocks, protection = fit_before(scene, recipe, look, todo, threads)
    place = len(notes)
    numbers: dict[str, Any] = {"water": look.water.numbers() if look.water else None, "sample": None}
    name = recipe.method
    if name == "auto":
        name = _compensated_method(request) if todo.runs else "wiener"
    outline = None
    if METHODS[name].neighbours:
        smooth = recipe.method == "auto" and todo.needs.smooth
        model, numbers["sample"], outline = _fit_neighbours(
            scene, recipe, request, look, given, threads, progress, want_sample=want_sample, smooth=smooth
        )
        chosen = replace(recipe, method=name, regression="auto")
    elif METHODS[name].plan is None:
        model = METHODS[name].fit(request, None)
        chosen = replace(recipe, method=model.method, regression="auto")
    else:
        auto = blocks is not None and given is None
        clean = cleaned(scene, look.tiles, chain, blocks, threads) if auto and blocks else None
        sampler = given or sampler_of(scene, recipe, look, threads, clean)
        job = _Job(scene, recipe, request, sampler, chain, name, todo, run, blocks)
        model, said, outline = _fit_sampled(job, threads, want_sample, progress)
        notes += said.pop("notes")
        floor = said.pop("floor_percentile")
        chosen = replace(recipe, method=model.method, regression=model.regression or "auto", floor_percentile=floor)
        numbers["sample"] = said
    log_model(model, notes[place:])
    if blocks is not None and protection is not None:
        chain = replace(fit_after(recipe, todo, chain, blocks, model, threads), protection=protection.result())
        model = replace(model, warnings=(*model.warnings, *_heavy(todo)))
        if todo.after and not chain.after:
            needs = todo.needs.without("second opening", "removal changed no band")
            todo = replace(todo, needs=needs)
    notes[place:place] = todo.needs.lines()
    numbers |= {"needs": todo.needs.numbers(), "compensation": chain.numbers()}
    water = look.water if recipe.mask == "auto" else None
    return Fitted(model, chosen, tuple(notes), numbers, outline, water, role_bands(look.roles), chain, todo.needs)


def _reach(recipe: Recipe, request: FitRequest, look: Look) -> int:
    """Pixels around a tile of a sample that is found by itself that the removal will look at, at most."""
    name = _compensated_method(request) if recipe.method == "auto" else recipe.method
    gathered = METHODS[name].plan
    if gathered is None or look.water is None:
        return 0
    return max(gathered(request).halo, 0) + sample_halo(look.water)


def _fit_neighbours(
    scene: Scene, recipe: Recipe, request: FitRequest, look: Look, given: Sampler | None, threads: int,
    progress: Progress | None, *, want_sample: bool, smooth: bool,
) -> tuple[GlintModel, dict[str, Any], dict[str, Any] | None]:  # fmt: skip
    """A method that looks at neighbours, from tiles of open water that are held in memory."""
    area: Area | None = None if recipe.mask in ("auto", "none") else open_area(recipe.mask, scene, "--mask")
    request = replace(request, regression="detrended")
    read = sample_reader(scene, look, given, area)
    places = tiles_of(scene, given) if given is not None else some(look.tiles)
    at_once = tiling.affordable(threads, (LOOK_SIDE, LOOK_SIDE), 2 * len(scene.bands))
    note = None if progress is None else partial(progress, "fit")
    tiles = [t for _p, t in tiling.run(places, read, threads=at_once, start=enter_thread, progress=note)]
    strips = strips_of_footprints(scene, request.correct[0]) or strips_finder(scene, read, at_once)
    model = wiener.fit(request, tiles, strips=strips)
    if smooth and model.fits:
        model = wiener.without_even(model, request, tiles)
    pixels = sum(int(np.count_nonzero(t.sample)) for t in tiles)
    box = _union([_box(t.sample, place) for t, place in zip(tiles, places, strict=True)])
    log_sample(pixels, _place(box))
    numbers = {
        "kind": recipe.sample,
        "pixels": pixels,
        "rows_columns": box,
        "share_of_scene": pixels / (scene.height * scene.width),
        "r2": {f.name: f.r2 for f in model.fits},
        "slopes": {f.name: f.slope for f in model.fits},
        "glint_level": model.level_interval and model.level_interval[2] - model.level_interval[1],
        "glint_cover": None,
        "left_alone": {},
    }
    if not want_sample:
        return model, numbers, None
    features = [f for t, place in zip(tiles, places, strict=True)
                for f in to_geojson(t.sample, (place.row0, place.col0), scene)]  # fmt: skip
    return model, numbers, collection(features, scene)


def _compensated_method(request: FitRequest) -> str:
    """What removes the rest after compensation: several references where there are several."""
    return "multiband" if max(len(references(request, b)) for b in request.correct) > 1 else "joyce"


def _heavy(todo: Plan) -> list[str]:
    """A warning where there is more glint than compensation is good for."""
    cover = float(np.median(todo.needs.cover)) if todo.needs.cover else 0.0
    if cover <= HEAVY_COVER:
        return []
    return [f"glint covers {cover:.0%} of the middlemost band (more than {HEAVY_COVER:.0%}): much of it will be left."]


def _floor_of(todo: Plan) -> float:
    """Percentile of a mixture of references that is its level once glint is replaced; 0 for that of the method.

    As many pixels again as stand out are taken to have glint too faint for that. The middle of the others is the
    level, as far as there are enough of them.
    """
    if not todo.needs.cover:
        return 0.0
    cover = float(np.median(todo.needs.cover))
    if cover > HEAVY_COVER:
        return HEAVY_FLOOR
    replaced = any(step.name.startswith("replace") for step in todo.before)
    return max(50 * (1 - 2 * cover), PERCENTILE) if replaced else 0.0


def _tells(todo: Plan) -> bool:
    """Whether what lies evenly in the references is no glint: sparkle is resolved, and does not lie everywhere."""
    return bool(todo.needs.cover) and float(np.median(todo.needs.cover)) < FAINT_COVER


@dataclass(frozen=True)
class _Job:
    """What the pass over the sample works on."""

    scene: Scene
    recipe: Recipe
    request: FitRequest
    sampler: Sampler
    chain: Chain
    method: str
    todo: Plan
    run: tiling.Run
    blocks: Blocks | None = None


def _fit_sampled(
    job: _Job, threads: int, want_sample: bool, progress: Progress | None
) -> tuple[GlintModel, dict[str, Any], dict[str, Any] | None]:
    scene, recipe, request, sampler, chain = job.scene, job.recipe, job.request, job.sampler, job.chain
    method = job.method
    if method == "multiband" and recipe.method == "auto":
        request = replace(request, floor_percentile=_floor_of(job.todo))
    plan = METHODS[method].plan(request)  # type: ignore[misc]
    judge = recipe.method == "auto" and not recipe.bands
    sampling = Sampling(scene, sampler, request, method, plan, recipe.tolerance, judge)
    halo = max(plan.halo, 0)
    columns = sorted({*plan.read_bands, *sampler.bands})
    if chain.before:
        columns = list(range(len(scene.bands)))  # a stage may look from band to band
    rows = [columns.index(b) for b in plan.read_bands]

    reach = halo + sampler.halo
    ready = job.blocks if job.blocks and all(job.blocks.image(t, reach) is not None for t in sampling.pool) else None

    def work(plan: SamplePlan, tile: Tile) -> Any:
        outer = tile.grown(reach + (0 if ready else chain.halo_before), scene.height, scene.width)
        middle = tile.grown(halo, scene.height, scene.width)
        block: Any = ready.image(tile, reach) if ready else scene.source.read(outer.window, columns)
        if chain.before and not ready:
            block = finish(apply_stages(State.of(block), chain.before), block)
        mask = sampler.mask(block, columns, outer)
        top, bottom, left, right = middle.crop_of(outer)
        inner = (slice(top, mask.shape[0] - bottom), slice(left, mask.shape[1] - right))
        mask, block = mask[inner], block[(slice(None), *inner)][rows]
        part = gather(block, mask, plan, origin=(tile.row0, tile.col0), crop=tile.crop_of(middle))
        mask = mask[core_of(tile.crop_of(middle), mask.shape)]
        return part, _box(mask, tile), to_geojson(mask, (tile.row0, tile.col0), scene) if want_sample else []

    features, boxes = [], []
    note = (lambda done, total: progress("fit", done, total)) if progress else None
    at_once = tiling.affordable(threads, sampling.largest, 4 * len(columns))  # statistics take several copies
    options: dict[str, Any] = {"threads": at_once, "progress": note, "start": enter_thread}
    run = tiling.run if ready else job.run
    for tiles, plan in sampling:
        for _row, (part, box, found) in run(tiles, partial(work, plan), combine=partial(_row_of, plan), **options):
            sampling.parts.append(part)
            boxes.append(box)
            features += found
    stats = sampling.statistics()
    tolerance, notes, doubts = sampling.said()
    model = METHODS[method].fit(request, stats)
    model = replace(model, warnings=(*model.warnings, *doubts))
    numbers: dict[str, Any] = {"glint_cover": None, "glint_level": None, "left_alone": {}}
    numbers |= {"r2": {f.name: f.r2 for f in model.fits}, "slopes": {f.name: f.slope for f in model.fits}}
    floor = request.floor_percentile
    numbers |= {"tolerance": tolerance} if tolerance else {}
    if recipe.method == "auto":
        model, floor, chosen = _keep_useful(request, stats, model, judge=judge, even=_tells(job.todo))
        notes += chosen.pop("notes")
        numbers |= chosen
    box = _union(boxes)
    log_sample(stats.moments.n, _place(box))
    said = {
        "kind": recipe.sample,
        "pixels": stats.moments.n,
        "rows_columns": box,
        "share_of_scene": stats.moments.n / (scene.height * scene.width),
        **sampler.numbers,
        **numbers,
        "floor_percentile": floor,
        "notes": [*notes, f"sample ({recipe.sample}): {stats.moments.n} pixels, {_place(box)}"],
    }
    return model, said, collection(features, scene) if want_sample else None


def _row_of(
    plan: SamplePlan, tiles: list[tuple[Any, Window | None, list[Any]]]
) -> tuple[Any, Window | None, list[Any]]:
    """What a row of tiles comes to: its part of the statistics, where the sample lies in it, its outlines."""
    parts, boxes, features = zip(*tiles, strict=True)
    return combine(parts, plan), _union(boxes), [f for some in features for f in some]


def _keep_useful(
    request: FitRequest, stats: SampleStatistics, model: GlintModel, *, judge: bool, even: bool
) -> tuple[GlintModel, float, dict[str, Any]]:
    """After compensation the method stands; bands that follow nothing any more are left as they are."""
    model, alone, said = _without_useless(model, judge, stats if even else None)
    if not model.fits:  # the glint was in what has been replaced
        model = replace(model, warnings=tuple(w for w in model.warnings if "no band follows" not in w))
    return model, request.floor_percentile, {"left_alone": alone, "notes": [f"method {model.method}", *said]}


def _without_useless(
    model: GlintModel, judge: bool, stats: SampleStatistics | None = None
) -> tuple[GlintModel, dict[str, str], list[str]]:
    """The model without bands that it would do nothing for, or (as far as a sample tells) harm; why; what to say."""
    alone = {f.name: why for f in model.fits if (why := useless(f))} if judge else {}
    if judge and stats is not None:
        left = (f for f in model.fits if f.name not in alone)
        alone |= {f.name: why for f in left if (why := harmful(model.indexes[f.index], stats))}
    kept = tuple(f for f in model.fits if f.name not in alone)
    warnings = tuple(w for w in model.warnings if not any(f" {name} " in w or f" {name}," in w for name in alone))
    said = [f"left as they are: {', '.join(f'{name} ({why})' for name, why in alone.items())}"] if alone else []
    if not kept:
        why = "there is little glint, or the bands are not taken at the same time"
        warnings = (*warnings, f"no band follows the NIR: {why}. Nothing was corrected.")
    return replace(model, fits=kept, warnings=warnings), alone, said


def _box(mask: npt.NDArray[np.bool_], tile: Tile) -> Window | None:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return None
    return (
        (tile.row0 + int(rows[0]), tile.row0 + int(rows[-1]) + 1),
        (tile.col0 + int(columns[0]), tile.col0 + int(columns[-1]) + 1),
    )


def _union(boxes: Sequence[Window | None]) -> Window | None:
    real = [b for b in boxes if b is not None]
    if not real:
        return None
    return (
        (min(b[0][0] for b in real), max(b[0][1] for b in real)),
        (min(b[1][0] for b in real), max(b[1][1] for b in real)),
    )


def _place(box: Window | None) -> str:
    return "nowhere" if box is None else f"rows {box[0][0]}-{box[0][1]}, columns {box[1][0]}-{box[1][1]}"
