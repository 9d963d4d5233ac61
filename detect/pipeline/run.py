"""All steps of `rxdetect score`: fit the background, score the tiles, find the threshold, mark objects, write files."""

import logging
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from deglint import __version__
from deglint import tiles as tiling
from deglint.checks import checked_keywords
from deglint.checksum import Checksum
from deglint.cluster import Cluster
from deglint.errors import DeglintError, InputError, NoWaterError
from deglint.pipeline.messages import log_scene
from deglint.pipeline.outputs import versions
from deglint.pipeline.overview import raster_of
from deglint.raster.environment import environment
from deglint.raster.info import open_dataset
from deglint.raster.output import Layout, Scratch, plain, write_json, write_text, writing_all
from deglint.raster.targets import check_images, check_targets
from deglint.readers import open_scene
from deglint.readers.scenes import files_of
from deglint.readers.text import read_json
from deglint.readers.undeclared import settled
from deglint.scene import Scene
from deglint.timing import Reporter

from ..background import Background
from ..local import STATES
from ..sea.model import SEA_WINDOW
from ..threshold import Tail, Threshold
from .features import motions
from .mark import CANDIDATES, Marker, Places, joined
from .plan import UNKNOWN_PIXEL, Plan, Progress, fitted, make_plan
from .recipe import Outputs, Recipe
from .scoring import MEANINGS, PixelCounts, Scoring

log = logging.getLogger(__name__)

READING = ("sensor", "nodata", "bands", "wavelengths", "scale", "offset")  # keywords that go to `open_scene`
FILES = ("p_value", "flags", "objects", "background", "chips")  # keywords of `score_file` that name output files
_MOST_BANDS = 32  # maximum number of bands for which the sidecar contains the covariance
_FEW_PIXELS = 10  # pixels per band below which the error of the estimated covariance raises the scores noticeably


@dataclass(frozen=True)
class Result:
    """Result of `score_file`.

    Attributes
    ----------
    counts : PixelCounts
        Number of scored pixels, and number of pixels without a score for each reason.
    background : Background or None
        The background that was fitted or read; None for methods without one background for the whole scene.
    threshold : Threshold or None
        None if no false-alarm rate was requested.
    objects : int or None
        Number of objects in the file of objects; None without the file.
    sidecar : dict
        Content of the sidecar.
    """

    counts: PixelCounts
    background: Background | None
    threshold: Threshold | None
    objects: int | None
    sidecar: dict[str, Any]

    def __repr__(self) -> str:
        cut = "" if self.threshold is None else f", {self.threshold}"
        marked = "" if self.objects is None else f", {self.objects} objects"
        return f"Result({self.counts.scored} of {self.counts.total} pixels scored{cut}{marked})"


@checked_keywords(*READING, *FILES, "overwrite", "options")
def score_file(
    source: str | Path | Sequence[str | Path],
    image: str | Path,
    recipe: Recipe | None = None,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
    cluster: Cluster | None = None,
    **options: Any,
) -> Result:
    """Score how anomalous every pixel of a raster file is.

    Parameters
    ----------
    source : path or sequence of paths
        GDAL name(s) of the input, as `deglint.open_scene` takes them.
    image : path
        Output, a local GeoTIFF of one float32 band; pixels without a score are NaN. `image`.json is written beside it.
    recipe : Recipe, optional
        By default `Recipe()`, whose method "auto" selects the detector.
    threads : int, optional
        Number of threads, by default all processors. The result does not depend on it.
    progress : callable(stage, done, total), optional
        Called with the name of the stage, the number of tiles that are done, and the number of all tiles.
    cluster : Cluster, optional
        Workers in place of threads, as in `deglint.remove_glint`; the result is the same to the bit.
    **options
        sensor, nodata, bands, wavelengths, scale, offset: see `deglint.open_scene`; p_value, flags, objects,
        background, chips, overwrite, options: see `Outputs`.

    Returns
    -------
    Result

    Raises
    ------
    ReadError, WriteError, InputError, BandError, FitError, NoWaterError
        The message states a remedy. No output is written, and an existing one is not changed.

    Examples
    --------
    >>> score_file("clean.tif", "scores.tif", Recipe(method="local", window=(5, 21)))  # doctest: +SKIP
    """
    recipe = recipe or Recipe()
    reading = {name: options.pop(name) for name in READING if name in options}
    outputs: dict[str, Any] = {k: Path(v) if k in FILES and v else v for k, v in options.items()}
    targets = Outputs(Path(image), **outputs)
    threads = tiling.default_threads(threads)
    targets.check(recipe)
    with environment(), tiling.one_thread_each():
        given = [os.fspath(s) for s in ([source] if isinstance(source, (str, os.PathLike)) else source)]
        files = [file for name in given for file in files_of(name)]
        named = {"--background": recipe.background, "--mask": recipe.mask, "--sensor": str(reading.get("sensor") or "")}
        reads = {"the input": [*given, *files], **{option: [name] for option, name in named.items()}}
        check_targets(targets.every(), reads, overwrite=targets.overwrite)
        check_images(targets.image, targets.flags, targets.p_value)
        checksum = Checksum(files, [recipe.background, recipe.mask])  # before opening: a later change is detected
        scene = settled(open_scene(source, **reading))
        with raster_of(scene):
            return _run(scene, checksum, recipe, targets, threads, progress or Reporter(), cluster)


def _run(
    scene: Scene,
    checksum: Checksum,
    recipe: Recipe,
    targets: Outputs,
    threads: int,
    progress: Progress,
    cluster: Cluster | None,
) -> Result:
    """Do all steps of `score_file` for an open scene: fit, score, mark objects, and write the files `targets`."""
    begun = time.perf_counter()
    log_scene(scene, pixel=False)  # for sea, `_notes_on` states it
    plan = make_plan(scene, recipe, threads, single=bool(targets.p_value or targets.background))
    if recipe.moving:
        motions(
            scene, plan.bands, plan.pixel_area, []
        )  # raises before the long work if times or the size of a pixel are unknown
    for note in plan.notes:
        log.info("%s", note)
    recipe = plan.recipe
    targets.check(recipe)
    if cluster and recipe.method == "lines":
        raise InputError("lines are scored in the order in which they come: leave out --workers and --cluster.")
    run = cluster.run if cluster else tiling.run
    plan = fitted(plan, run, progress)
    notes = _notes_on(plan)
    for note in notes:
        log.info("%s", note)
    with Scratch(overwrite=targets.overwrite) as scratch:
        counts, tail, beside = _write_tiles(scratch, plan, targets, run, progress)
        if not counts.scored:
            outside = "every pixel is nodata" if counts.masked_out < counts.total else "no pixel lies inside the mask"
            why = "no ring holds two valid pixels" if counts.too_few else outside
            if recipe.method == "lines":
                why = "no line has 4 valid pixels per band in the lines before it (use --method rx for few lines)"
            raise NoWaterError(f"nothing to score in {scene.path}: {why}. Check --nodata and --mask.")
        threshold, found = None, None
        if tail is not None:
            with open_dataset(str(scratch.file(targets.image))) as scores:
                marker = Marker(plan, scores, tail, beside)
                threshold = marker.threshold()
                found = marker.write(threshold, targets, scratch)
            log.info("%s", threshold)
        if targets.background and plan.background:
            write_text(scratch, targets.background, replace(plan.background, names=plan.names).to_json() + "\n")
        warnings = _warnings_of(plan, threshold, counts)
        for warning in warnings:
            log.warning("%s", warning)
        seconds = round(time.perf_counter() - begun, 3)
        said = _describe(plan, targets, threshold, counts, checksum)
        said |= {"objects": found, "notes": [*scene.notes, *plan.notes, *notes], "warnings": warnings}
        said = plain(said | {"seconds": seconds} | ({"cluster": cluster.numbers()} if cluster else {}))
        write_json(scratch, targets.sidecar, said)
    marked = "" if found is None else f", {found} objects"
    log.info("%s: %d of %d pixels scored%s in %.2f s", targets.image, counts.scored, counts.total, marked, seconds)
    return Result(counts, plan.background, threshold, found, said)


def _write_tiles(
    scratch: Scratch, plan: Plan, targets: Outputs, run: tiling.RunTiles, progress: Progress
) -> tuple[PixelCounts, Tail | None, dict[int, Places]]:
    """Score and write tiles; return counts, highest scores (None: no threshold), pixels attached to land (by class)."""
    recipe, pixels = plan.recipe, plan.scene.height * plan.scene.width
    rate = max(recipe.pfa or 0.0, CANDIDATES if plan.sea else 0.0)
    keep = Tail.keep_for(rate, pixels) if recipe.thresholded else 0
    work = Scoring(plan, keep, bool(targets.p_value), bool(targets.flags))
    counts, tails, beside = PixelCounts(), list[Tail](), list[dict[int, Places]]()
    with writing_all(scratch, _images(plan, targets)) as writers:
        told = partial(progress, "score")
        for tile, scored in run(plan.tiles, work, threads=plan.threads, progress=told):
            for what, writer in writers.items():
                writer.write(getattr(scored, what), tile.window)
            counts.add(scored.counts)
            beside += [scored.beside] if scored.beside else []
            tails += [scored.tail] if scored.tail else []
            if sum(len(tail.values) for tail in tails) > 2 * keep:
                tails = [Tail.merge(tails)]
    attached = {which: joined([each[which] for each in beside]) for which in (beside[0] if beside else ())}
    return counts, Tail.merge(tails) if tails else None, attached


def _images(plan: Plan, targets: Outputs) -> dict[str, tuple[Path, Layout]]:
    """File and layout of each output raster; keys are the names of fields of `detect.pipeline.scoring.Scored`."""
    info = raster_of(plan.scene).info
    options = dict(targets.options)
    if info.compression == "deflate" and "compress" not in map(str.lower, options):
        options = {"ZLEVEL": "1", **options}  # scores are noise: a higher level doubles the time, not the compression
    info = replace(info, band_tags=({},) * info.count)  # the band of scores has no wavelength
    names = (plan.recipe.method,)
    base = Layout(info, (0,), "float32", float("nan"), options, scaled=False, names=names, tile=plan.shape)
    images = {"scores": (targets.image, base)}
    if targets.p_value:
        images["p_values"] = targets.p_value, replace(base, names=("p-value",))
    if targets.flags:
        images["flags"] = targets.flags, replace(base, dtype="uint8", nodata=None, names=("flags",), flags=MEANINGS)
    return images


def _describe(
    plan: Plan, targets: Outputs, threshold: Threshold | None, counts: PixelCounts, checksum: Checksum
) -> dict[str, Any]:
    """Versions, inputs, options and results, for the sidecar; `_run` adds objects, notes, warnings and time."""
    recipe = asdict(plan.recipe) | {"bands": plan.names, "nir": [plan.names[b] for b in plan.nir]}
    if plan.window is not None:
        recipe["ring_pixels"] = plan.window.pixels
    numbers = plan.background.numbers() if plan.background else None
    if numbers and len(plan.bands) > _MOST_BANDS:
        numbers["covariance"] = "left out: --save-background writes it"
    return {
        "detect": __version__,
        "versions": versions(),
        "input": checksum.result(),
        "product": plan.scene.product,
        "output": str(targets.image),
        "flags": {"file": str(targets.flags), "bits": MEANINGS} if targets.flags else None,
        "recipe": recipe,
        "background": numbers,
        "water": plan.water[0].numbers() if plan.water else None,
        "sea": plan.model.numbers() if plan.model else None,
        "threshold": asdict(threshold) if threshold else None,
        "pixels": asdict(counts),
    }


def _notes_on(plan: Plan) -> list[str]:
    """Notes on the decisions of a run, one line each."""
    notes = [f"{plan.recipe.method} on {len(plan.bands)} band{'s' * (len(plan.bands) != 1)}: {', '.join(plan.names)}"]
    if plan.sea and plan.model:
        unknown = f"of unknown size, taken as {UNKNOWN_PIXEL:g} m (--sensor FILE.toml states it)"
        size = f"{plan.sea.pixel:.3g} m" if plan.pixel_area else unknown
        what = "brighter or darker" if plan.model.side == "both" else "brighter"
        even = ", relative to water of the same NIR" if plan.model.glint else ""
        notes.append(f"sea: pixels {size}; ships of up to {plan.sea.length:g} m by {plan.sea.width:g} m")
        notes.append(f"sea: searched for what is {what} than the water within {SEA_WINDOW} pixels{even}")
    if background := plan.background:
        where = "read from a file" if plan.given else f"{background.n} pixels"
        shrunk = f", {background.rule} {background.shrinkage:.3g}" if background.shrinkage else ""
        notes.append(f"background: {where}, rank {background.rank} of {background.bands}{shrunk}")
    return notes


def _warnings_of(plan: Plan, threshold: Threshold | None, counts: PixelCounts) -> list[str]:
    """Warnings about the reliability of the scores, one line each."""
    said = []
    if background := plan.background:
        if extra := background.bands - background.rank:
            said.append(f"{extra} of {background.bands} bands are constant or combine others: they add nothing")
        usual = plan.recipe.covariance == "empirical" and plan.recipe.threshold != "f"
        if usual and background.n < _FEW_PIXELS * background.bands:
            said.append(f"few pixels in the background, {background.n}: use --covariance ledoit-wolf, or --threshold f")
    for count, state in zip((counts.deficient, counts.too_few), STATES, strict=True):
        if count:
            said.append(f"{count} of {counts.total} pixels: {STATES[state]}")
    if threshold is not None:
        said += threshold.notes
    if line := _removal_without_effect(plan):
        said.append(line)
    return said


def _removal_without_effect(plan: Plan) -> str | None:
    """Warning that the scores are the same as without glint removal; None if they differ, or if this is not known.

    RX and similar detectors give the same scores after a linear removal, if its NIR bands are among the bands in use.
    """
    if not plan.recipe.kind.invariant or plan.recipe.covariance not in ("empirical", "mcd"):
        return None
    try:
        made = read_json(f"{plan.scene.path}.json", "sidecar")
        model, method = made["model"], made["model"]["method"]
        kept = {model["band_names"][b] for index in model["indexes"] for b in index["bands"]} <= set(plan.names)
        pointwise = not made["compensation"]["chain"] and not any(index["offsets"] for index in model["indexes"])
        affine = pointwise and bool(model["fits"]) and not made["pixels"]["protected"]
    except (DeglintError, KeyError, TypeError, IndexError):
        return None
    if not (affine and kept):
        return None
    return (
        f"{plan.recipe.method} scores do not change under {method} as long as the NIR is among the bands: "
        "these are the scores before glint removal. Choose bands without the NIR with -b"
    )
