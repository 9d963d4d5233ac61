"""Fit a recipe to a scene: read an overview, choose a candidate if the recipe leaves the choice open, and fit it."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from .. import tiles as tiling
from ..checks import check_kind, checked_keywords
from ..choose import Choice
from ..compensate import Chain
from ..errors import FitError, InputError, NoWaterError
from ..masks import WaterRule
from ..moments import CELL
from ..raster.environment import environment
from ..readers.roles import find_band
from ..readers.undeclared import Undeclared, undeclared
from ..remove import METHODS, GlintModel
from ..remove.request import MIN_PIXELS
from ..scene import Scene
from .messages import log, log_model, log_scene, log_water, why
from .overview import Job, Progress, overview_of, overviews, sampler_of
from .recipe import Recipe, make_request
from .sample import Sampled, Training, chosen, fit_sampled, fit_training, read_training

OTHER_UNITS = 100.0
"""Ratio of the NIR of a scene to the glint-free NIR of a given model from which on units may differ: under strong glint
it is about 30, and reflectance is stored in units of 1/10,000."""
SMALLEST_SCENE = 256  # fewest pixels of a scene in which a sample is searched for


@dataclass(frozen=True)
class Fitted:
    """Result of fitting a recipe to a scene.

    Attributes
    ----------
    model : GlintModel
    recipe : Recipe
        The options, with the method, compensation and regression that were chosen.
    notes : tuple of str
        The decisions, as lines for the log.
    sampled : dict or None
        Size, position and statistics of the sample; None if the fit used no sample.
    sample : dict or None
        Outline of the sample as GeoJSON; None if it was not requested.
    water, water_bands : WaterRule or None, tuple of int
        The rule by which water was found (None if it was not searched for), and 0-based scene bands that masks use.
    chain : Chain
        Stages of compensation around the removal; empty if there are none.
    choice : Choice, optional
        The candidates that were tried on sample tiles, if the recipe left the choice open.
    undeclared : Undeclared
        Nodata values, offsets and wavelengths that are not declared but were recognised in the pixels.
    """

    model: GlintModel
    recipe: Recipe
    notes: tuple[str, ...] = ()
    sampled: dict[str, Any] | None = None
    sample: dict[str, object] | None = None
    water: WaterRule | None = None
    water_bands: tuple[int, ...] = ()
    chain: Chain = field(default_factory=Chain)
    choice: Choice | None = None
    undeclared: Undeclared = field(default_factory=Undeclared)

    def __repr__(self) -> str:
        return f"Fitted({self.model!r}, compensation {self.chain.text if self.chain.runs else 'none'})"


@checked_keywords()
@tiling.one_thread_each()
def fit_scene(
    scene: Scene,
    recipe: Recipe | None = None,
    *,
    threads: int | None = None,
    want_sample: bool = False,
    progress: Progress | None = None,
    run: tiling.RunTiles = tiling.run,
) -> Fitted:
    """Fit a recipe to a scene without correcting it.

    Parameters
    ----------
    scene : Scene
    recipe : Recipe, optional
    threads : int, optional
        All processors by default; the result does not depend on the number.
    want_sample : bool
        Set `Fitted.sample` to the outline of the sample as GeoJSON.
    progress : callable, optional
        Called as progress(step, done, total): name of the step, numbers of finished and of all tiles.
    run : callable
        Function that processes the sample tiles for a pointwise method (no neighbours): `tiles.run` or `Cluster.run`.

    Returns
    -------
    Fitted

    Raises
    ------
    InputError, ReadError, BandError, NoWaterError, FitError
        In this order: wrong option; unreadable file; no NIR or selected band; no water; the sample allows no fit.

    Examples
    --------
    >>> fitted = fit_scene(open_scene("scene.tif"), Recipe(method="hedley"))  # doctest: +SKIP
    >>> print(fitted.model)  # doctest: +SKIP
    """
    check_kind(scene, Scene, "scene", "Open it with deglint.open_scene.")
    recipe = recipe or Recipe()
    check_kind(recipe, Recipe, "recipe", "Make one: deglint.Recipe(method='hedley').")
    threads = tiling.default_threads(threads)
    with environment():
        found = undeclared(scene)
        return replace(_fit_overviews(found.on(scene), recipe, threads, want_sample, progress, run), undeclared=found)


def _fit_overviews(
    scene: Scene, recipe: Recipe, threads: int, want_sample: bool, progress: Progress | None, run: tiling.RunTiles
) -> Fitted:
    """Fit to an overview, which is a part of the scene. If it has no water, or the fit to an automatic sample fails,
    fit to a larger part; the last part is the whole scene.
    """
    log_scene(scene)
    if recipe.sample == "auto" and (pixels := scene.height * scene.width) < SMALLEST_SCENE:
        hedley = ", or take --method hedley --sample all" if pixels >= MIN_PIXELS else ""
        raise NoWaterError(
            f"{scene.path}: {scene.height} x {scene.width} pixels are too few for a fit, which needs {SMALLEST_SCENE}. "
            f"Take a larger image, apply the saved model of one (--model){hedley}."
        )
    request, of_nir = make_request(scene, recipe)
    said, *doubts = of_nir.split("; warning: ", 1)
    log.info("%s", said)
    for doubt in doubts:
        log.warning("%s", doubt)
    nir = request.indexes[0].bands[0]
    method = METHODS.get(recipe.method)  # None: "auto", which selects a method that learns from a sample
    sampled = method is None or method.plan is not None or method.neighbours or recipe.chain != "off"
    if sampled and recipe.sample == "auto" and recipe.mask != "auto":
        # without --sample, the sample is the area of --mask; for "none", it is the water or, without water, all pixels
        sample = recipe.mask
        if sample == "none":
            water = overview_of(scene, nir, threads).water
            sample = "auto" if water is not None and water.has_water else "all"
        recipe = replace(recipe, sample=sample)
    found = recipe.sample == "auto"
    usual = "detrended" if found else "ols"
    request = replace(request, regression=usual if recipe.regression == "auto" else recipe.regression)
    note = partial(progress, "fit") if progress else None
    for overview in overviews(scene, nir, threads, wanted=recipe.mask == "auto" or (sampled and found)):
        try:
            return _fit(Job(scene, recipe, request, overview, threads, note, run, want_sample), of_nir)
        except FitError:
            # an overview of a part may have missed the deep part of the water, or all water
            may_help = found or (overview.water and not overview.water.has_water)
            if overview.whole or not may_help:
                raise
    raise AssertionError("unreachable: the last overview is of everything")


def _fit(job: Job, of_nir: str) -> Fitted:
    """Fit a recipe to one overview of a scene; `of_nir`, the note on the NIR bands, is put first in `Fitted.notes`."""
    recipe, overview = job.recipe, job.overview
    notes = [of_nir, *log_water(overview.water, recipe.mask)]
    if recipe.sample != "auto":
        job = replace(job, sampler=sampler_of(job))
    method, text, choice, training = _decide(job)
    log.info("compensation: %s", "none" if text == "off" else text)
    chain, of_sample = Chain(), list[str]()
    sampled: Sampled | tuple[None, None] = None, None
    if choice is not None and method == "copy":
        warnings = (f"{choice.why_copied}. Nothing was corrected.",)
        model = GlintModel("wiener", job.request.indexes, (), job.request.names, warnings=warnings)
    elif text != "off" or METHODS[method].neighbours:
        if training is None or text == "off":
            note = None if choice else job.note  # progress on these tiles was reported before the trials
            training = read_training(replace(job, note=note), for_chain=text != "off")
        chain, model, sampled = fit_training(job, training, text, method)
    elif METHODS[method].plan is None:
        model = METHODS[method].fit(job.request, None)
    else:
        model, sampled, of_sample = fit_sampled(job, method)
    log_model(model, of_sample)
    used = "auto" if method == "copy" else model.method
    resolved = replace(recipe, method=used, compensate=text, smallest_object="", regression=model.regression or "auto")
    every, water = (*notes, *(choice.lines() if choice else ()), *of_sample), (overview.water, overview.bands)
    return Fitted(model, resolved, every, sampled[0], sampled[1], *water, chain, choice)


def _decide(job: Job) -> tuple[str, str, Choice | None, list[Training] | None]:
    """Method, chain text, `Choice`, training tiles of a job; the last two are None unless `Recipe.chain` is "auto"."""
    method, text = job.recipe.method, job.recipe.chain
    if text != "auto":
        return "wiener" if method == "auto" else method, text, None, None
    training = read_training(job, for_chain=True)
    choice = chosen(job, training)
    first, *others = choice.lines() or ["wiener, without trials: too little water, or values too large"]
    log.info("%s", first)
    why(others)
    return choice.best.method, choice.best.chain, choice, training


def given_model(scene: Scene, recipe: Recipe, model: GlintModel, threads: int, chain: Chain | None) -> Fitted:
    """Make a `Fitted` for this scene from a saved model and its `chain`, with which it was fitted (None: no stages).

    Only `recipe.bands` (empty: all bands of model and chain) are corrected. Raises InputError if the model
    or chain does not suit this scene or the bands, NIR, method or stages of the recipe; NoWaterError if the mask is
    "auto" and no water is found. All other options of the recipe are ignored and not copied to `Fitted.recipe`.
    """
    log_scene(scene)
    chain = chain or Chain()
    if recipe.method not in ("auto", model.method) or recipe.chain not in ("auto", chain.text or "off"):
        own = f"{model.method} with {f'stages {chain.text}' if chain.text else 'no stages'}"
        raise InputError(f"the given model is {own}: leave out --method and --compensate.")
    if chain.runs and [n.casefold() for n in model.band_names] != [n.casefold() for n in scene.names]:
        raise InputError(
            f"the compensation was fitted to bands {', '.join(model.band_names)} in this order; the scene has "
            f"{', '.join(scene.names)}. Fit it to a scene like this one."
        )
    model = model.for_bands(scene.names)
    squares = -(-scene.height // CELL), -(-scene.width // CELL)
    if model.strips is not None and (len(model.strips.rows), len(model.strips.rows[0])) != squares:
        raise InputError("the model holds the detector strips of another scene: fit it to this one.")
    nir, wanted = ({find_band(scene, b) for b in some} for some in (recipe.nir, recipe.bands))
    if nir and nir != set(model.index_bands):
        own = ", ".join(scene.names[b] for b in model.index_bands)
        raise InputError(f"the model takes the glint from {own}: leave out --nir, or fit without --model.")
    if wanted and not chain.replaces:
        if missing := ", ".join(scene.names[b] for b in sorted(wanted - {f.band for f in model.fits})):
            raise InputError(f"the model does not correct {missing}: leave it out of -b, or fit without --model.")
        if not chain.runs:  # stages use all bands
            model = replace(model, fits=tuple(f for f in model.fits if f.band in wanted))
    used = Recipe(mask=recipe.mask, nir=recipe.nir, bands=recipe.bands, compensate=chain.text or "off")
    resolved = replace(used, method=model.method, regression=model.regression or "auto", sample="none")
    fitted = Fitted(model, resolved, chain=chain)
    if recipe.mask == "auto":
        overview = overview_of(scene, model.indexes[0].bands[0], threads)  # the NIR, as in a fit
        fitted = replace(fitted, water=overview.water, water_bands=overview.bands)
    note, of_water = f"model {model.method}, fitted before", log_water(fitted.water, recipe.mask)
    level, found = model.indexes[0].level, fitted.water.nir_level if fitted.water else 0.0
    if level > 0 and fitted.water and not 1 / OTHER_UNITS < found / level < OTHER_UNITS:
        said = "the NIR of the water is about %.3g, and the glint-free NIR of the model %.3g: units may differ"
        log.warning(said, found, level)
    log.info("compensation: %s", chain.text or "none")  # as after a fit
    log_model(model, [note])
    return replace(fitted, notes=(note, *of_water))
