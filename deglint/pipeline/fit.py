"""Fit a recipe to a scene: look at some of it, choose what to do where the recipe leaves that open, fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..checks import check_kind, checked_keywords
from ..choose import Choice
from ..compensate import Chain, fit_chain
from ..errors import FitError, NoWaterError
from ..masks import WaterRule
from ..raster.environment import enter_thread, environment
from ..readers.areas import collection, to_geojson
from ..readers.undeclared import Undeclared, undeclared
from ..remove import METHODS, FitRequest, GlintModel, SamplePlan, combine, gather, wiener
from ..scene import Scene, Window
from ..tiles import Tile, default_threads
from .log import log_choice, log_compensation, log_model, log_nir, log_sample, log_scene, log_water
from .overview import TILE_SIDE, check_size, core_of, overviews, role_bands, where_to_sample
from .recipe import Recipe, make_request
from .sample import Sampler, Training, sampler_of, strips_finder, strips_of_footprints, training_reader
from .tolerance import Sampling, short_of
from .training import HALO, Job, Progress, chosen, read_training, removal_of, sample_of, setting


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
        How water is distinguished, where it has to be; `water_bands` are the 0-based scene bands that it looks at.
    chain : Chain
        Stages of compensation around the removal; empty where there are none.
    choice : Choice, optional
        The recipes that were tried on sample tiles, where the recipe left the choice open.
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
    choice: Choice | None = None
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
        nir = request.indexes[0].bands[0]
        if _is_sampled(recipe):
            recipe = replace(recipe, sample=where_to_sample(scene, recipe, nir, threads))
        wanted = recipe.mask == "auto" or (_is_sampled(recipe) and recipe.sample == "auto")
        usual = "detrended" if recipe.sample == "auto" else "ols"
        request = replace(request, regression=usual if recipe.regression == "auto" else recipe.regression)
        for overview in overviews(scene, nir, threads, wanted=wanted):
            job = Job(scene, recipe, request, overview, threads, tuple(notes), progress, run, want_sample)
            try:
                fitted = _fit(job)
                if overview.whole or recipe.sample != "auto" or not short_of(fitted.numbers):
                    return replace(fitted, undeclared=found)
            except (NoWaterError, FitError):
                # an overview of a part may have missed the water, or the deep of it: look at more
                if overview.whole or (recipe.sample != "auto" and (not overview.water or overview.water.has_water)):
                    raise
    raise AssertionError("unreachable: the last overview is of everything")


def _is_sampled(recipe: Recipe) -> bool:
    """Whether the method learns from a sample; `auto` takes one that does."""
    method = METHODS.get(recipe.method)
    return method is None or method.plan is not None or method.neighbours or recipe.chain != "off"


def _fit(job: Job) -> Fitted:
    scene, recipe, overview = job.scene, job.recipe, job.overview
    notes = list(job.notes)
    if overview.water is not None:
        if not overview.water.has_water:
            raise NoWaterError(overview.water.reason)
        notes.append(overview.water.reason)
    log_water(overview.water, recipe.mask)
    sampler = sampler_of(scene, recipe, overview, job.threads) if recipe.sample != "auto" else None
    method, text, choice, training = recipe.method, recipe.chain, None, None
    if method == "auto" and text == "auto":
        training = read_training(job, sampler, HALO)
        job = replace(job, progress=None)  # the tiles have been counted
        choice = chosen(job, training)
        method, text = choice.best.method, choice.best.chain
        notes += choice.lines()
        log_choice(choice)
    method = "wiener" if method == "auto" else method
    log_compensation(text)
    chain = Chain()
    if method == "copy":
        model, sample, outline = _nothing(job.request, choice), None, None
    elif text != "off":
        chain, model, sample, outline = _fit_chain(job, training or read_training(job, sampler, HALO), text, method)
    elif METHODS[method].neighbours:
        model, sample, outline = _fit_neighbours(job, sampler)
    elif METHODS[method].plan is None:
        model, sample, outline = METHODS[method].fit(job.request, None), None, None
    else:
        model, sample, outline = _fit_sampled(job, sampler, method)
    notes += (sample or {}).pop("notes", [])
    log_model(model, notes[len(job.notes) :])
    floor = 0.0 if choice else recipe.floor_percentile
    regression = "auto" if METHODS.get(method) is None or METHODS[method].neighbours else model.regression or "auto"
    resolved = replace(recipe, method="auto" if method == "copy" else model.method, regression=regression,
                       floor_percentile=floor, compensate=text, smallest_object="")  # fmt: skip
    numbers = {
        "water": overview.water.numbers() if overview.water else None,
        "sample": sample,
        "choice": choice.numbers() if choice else None,
        "compensation": chain.numbers(),
    }
    water = overview.water if recipe.mask == "auto" else None
    return Fitted(model, resolved, tuple(notes), numbers, outline, water, role_bands(overview.roles), chain, choice)


def _nothing(request: FitRequest, choice: Choice | None) -> GlintModel:
    """A model that corrects nothing."""
    why = "" if choice is None else choice.why_copied
    return GlintModel("wiener", request.indexes, (), request.names, warnings=(f"{why}. Nothing was corrected.",))


def _fit_chain(
    job: Job, training: Sequence[Training], text: str, method: str
) -> tuple[Chain, GlintModel, dict[str, Any], dict[str, Any] | None]:
    """Stages and a removal, from tiles that are held in memory."""
    found = fit_chain(text, sample_of(training), setting(job), removal_of(job, training, method))
    return found.chain, found.model, *_said(job, training, found.model)


def _fit_neighbours(job: Job, sampler: Sampler | None) -> tuple[GlintModel, dict[str, Any], dict[str, Any] | None]:
    """A method that looks at neighbours, from tiles of open water that are held in memory."""
    training = read_training(job, sampler, 0)
    read = training_reader(job.scene, job.overview, sampler)
    at_once = tiling.affordable(job.threads, (TILE_SIDE, TILE_SIDE), 2 * len(job.scene.bands))
    strips = strips_of_footprints(job.scene, job.request.correct[0]) or strips_finder(job.scene, read, at_once)
    request = replace(job.request, regression="detrended")
    model = wiener.fit(request, [t.as_sample() for t in training], strips=strips)
    return model, *_said(job, training, model)


def _said(job: Job, training: Sequence[Training], model: GlintModel) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Numbers of a sample that was held in memory, and its outline where that is wanted."""
    pixels = sum(int(np.count_nonzero(t.sample)) for t in training)
    box = _union([_box(t.sample, t.tile) for t in training])
    log_sample(pixels, _place(box))
    numbers = {
        "kind": job.recipe.sample,
        "pixels": pixels,
        "rows_columns": box,
        "share_of_scene": pixels / (job.scene.height * job.scene.width),
        "r2": {f.name: f.r2 for f in model.fits},
        "slopes": {f.name: f.slope for f in model.fits},
        "glint_level": model.level_interval and model.level_interval[2] - model.level_interval[1],
    }
    if not job.want_sample:
        return numbers, None
    features = [f for t in training for f in to_geojson(t.sample, (t.tile.row0, t.tile.col0), job.scene)]
    return numbers, collection(features, job.scene)


def _fit_sampled(
    job: Job, given: Sampler | None, method: str
) -> tuple[GlintModel, dict[str, Any], dict[str, Any] | None]:
    """A method of single pixels, by one pass over its sample."""
    scene, request, outlined = job.scene, job.request, job.want_sample
    sampler = given or sampler_of(scene, job.recipe, job.overview, job.threads)
    plan = METHODS[method].plan(request)  # type: ignore[misc]
    sampling = Sampling(scene, sampler, request, method, plan, job.recipe.tolerance)
    halo = max(plan.halo, 0)
    columns = sorted({*plan.read_bands, *sampler.bands})
    rows, reach = [columns.index(b) for b in plan.read_bands], halo + sampler.halo

    def work(plan: SamplePlan, tile: Tile) -> Any:
        outer = tile.grown(reach, scene.height, scene.width)
        middle = tile.grown(halo, scene.height, scene.width)
        block: Any = scene.source.read(outer.window, columns)
        mask = sampler.mask(block, columns, outer)
        inner = core_of(middle.crop_of(outer), mask.shape)
        mask, block = mask[inner], block[(slice(None), *inner)][rows]
        part = gather(block, mask, plan, origin=(tile.row0, tile.col0), crop=tile.crop_of(middle))
        mask = mask[core_of(tile.crop_of(middle), mask.shape)]
        return part, _box(mask, tile), to_geojson(mask, (tile.row0, tile.col0), scene) if outlined else []

    features, boxes = [], []
    at_once = tiling.affordable(job.threads, sampling.largest, 4 * len(columns))  # statistics take several copies
    options: dict[str, Any] = {"threads": at_once, "progress": job.note(), "start": enter_thread}
    for tiles, plan in sampling:
        for _row, (part, box, found) in job.run(tiles, partial(work, plan), combine=partial(_row_of, plan), **options):
            sampling.parts.append(part)
            boxes.append(box)
            features += found
    stats = sampling.statistics()
    tolerance, notes, doubts = sampling.said()
    model = METHODS[method].fit(request, stats)
    model = replace(model, warnings=(*model.warnings, *doubts))
    box = _union(boxes)
    log_sample(stats.moments.n, _place(box))
    numbers = {
        "kind": job.recipe.sample,
        "pixels": stats.moments.n,
        "rows_columns": box,
        "share_of_scene": stats.moments.n / (scene.height * scene.width),
        **sampler.numbers,
        "r2": {f.name: f.r2 for f in model.fits},
        "slopes": {f.name: f.slope for f in model.fits},
        "glint_level": None,
        "notes": [*notes, f"sample ({job.recipe.sample}): {stats.moments.n} pixels, {_place(box)}"],
    }
    numbers |= {"tolerance": tolerance} if tolerance else {}
    return model, numbers, collection(features, scene) if job.want_sample else None


def _row_of(
    plan: SamplePlan, tiles: list[tuple[Any, Window | None, list[Any]]]
) -> tuple[Any, Window | None, list[Any]]:
    """What a row of tiles comes to: its part of the statistics, where the sample lies in it, its outlines."""
    parts, boxes, features = zip(*tiles, strict=True)
    return combine(parts, plan), _union(boxes), [f for some in features for f in some]


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
