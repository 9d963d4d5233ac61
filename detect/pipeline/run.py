"""All steps of `rxdetect score`: fit the background, score the tiles, find the threshold, mark objects, write files."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from deglint import tiles as tiling
from deglint.checks import checked_keywords
from deglint.checksum import Checksum
from deglint.errors import InputError, NoWaterError
from deglint.pipeline.cluster import Cluster
from deglint.pipeline.outputs import log_scene
from deglint.pipeline.overview import raster_of
from deglint.raster.environment import enter_thread, environment
from deglint.raster.info import open_dataset
from deglint.raster.output import Layout, Scratch, plain, write_json, write_text, writing_all
from deglint.raster.targets import Reads, check_images, check_targets
from deglint.readers.opening import Names, Numbers
from deglint.readers.undeclared import settled
from deglint.scene import Scene
from deglint.tiles import Tile, default_threads
from deglint.timing import Reporter

from .. import sea
from .. import threshold as cutting
from ..background import Background, Part, sample_share
from ..lines import LineScorer
from ..rx import Detector, both, detector
from ..threshold import Tail, Threshold
from .ground import delayed_bands
from .mark import CANDIDATES, Marker, Places, joined
from .plan import Plan, Progress, fit_sea, make_plan
from .recipe import Outputs, Recipe
from .scoring import MEANINGS, Highest, PixelCounts, Scoring
from .sidecar import describe, notes_on, warnings_of

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Result:
    """Result of a run.

    Attributes
    ----------
    tally : PixelCounts
    background : Background or None
    threshold : Threshold or None
    objects : int or None
        Number of marked objects.
    sidecar : dict
        Content of the sidecar.
    """

    tally: PixelCounts
    background: Background | None
    threshold: Threshold | None
    objects: int | None
    sidecar: dict[str, Any] = field(repr=False)

    def __repr__(self) -> str:
        cut = "" if self.threshold is None else f", {self.threshold}"
        marked = "" if self.objects is None else f", {self.objects} objects"
        return f"Result({self.tally.scored} of {self.tally.total} pixels scored{cut}{marked})"


@checked_keywords("p_value", "flags", "objects", "background", "chips", "overwrite", "options")
def score_file(
    source: str | Path | Sequence[str | Path], image: str | Path, recipe: Recipe | None = None, *,
    sensor: str | Path | None = None, nodata: float | str | None = None, bands: Names | None = None,
    wavelengths: Numbers | None = None, scale: Numbers | None = None, offset: Numbers | None = None,
    threads: int | None = None, progress: Progress | None = None, cluster: Cluster | None = None,
    **outputs: Any,
) -> Result:  # fmt: skip
    """Score how anomalous every pixel of a raster file is.

    Parameters
    ----------
    source : path or sequence of paths
        GDAL name(s) of the input, as `deglint.open_scene` takes them.
    image : path
        Output, a local GeoTIFF of one float32 band, NaN where not valid. `image`.json is written beside it.
    recipe : Recipe, optional
        By default "sea" where there is water, else global RX.
    sensor, nodata, bands, wavelengths, scale, offset
        As `deglint.open_scene`.
    threads : int, optional
        All processors by default. The result does not depend on it.
    progress : callable(stage, done, total), optional
    cluster : Cluster, optional
        Workers in place of threads, as `deglint.remove_glint`; the result is the same to the bit.
    **outputs
        p_value, flags, objects, background, chips, overwrite, options: see `Outputs`.

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
    from threadpoolctl import threadpool_limits

    from deglint.readers import open_scene

    recipe = recipe or Recipe()
    files = ("p_value", "flags", "objects", "background", "chips")
    paths: dict[str, Any] = {k: Path(v) if k in files and v else v for k, v in outputs.items()}
    targets = Outputs(Path(image), **paths)
    if threads is not None and threads < 1:
        raise InputError(f"threads: want at least 1, got {threads}.")
    targets.check(recipe)
    with environment(), threadpool_limits(1, user_api="blas"):  # tiles already occupy all threads
        read = _files_read(source, targets, recipe, str(sensor or ""))
        # before the files are opened, so that a change during the run is detected
        checksum = Checksum(read, [recipe.background, recipe.mask])
        scene = settled(open_scene(source, sensor=sensor, nodata=nodata, bands=bands, wavelengths=wavelengths,
                                   scale=scale, offset=offset))  # fmt: skip
        with raster_of(scene):
            return _run(scene, checksum, recipe, targets, threads or default_threads(), progress or Reporter(), cluster)


def _files_read(
    source: str | Path | Sequence[str | Path], targets: Outputs, recipe: Recipe, sensor: str
) -> list[str]:  # fmt: skip
    """List the files of the input, and check that no output is also an input, or exists without `overwrite`."""
    from deglint.readers.stac import files_of

    given = [os.fspath(s) for s in ([source] if isinstance(source, (str, os.PathLike)) else source)]
    read = [file for name in given for file in files_of(name)]
    reads: Reads = {
        "the input": [*given, *read], "--background": [recipe.background], "--mask": [recipe.mask],
        "--sensor": [sensor],
    }  # fmt: skip
    check_targets(targets.every(), reads, overwrite=targets.overwrite)
    check_images(targets.image, targets.flags, targets.p_value)
    return read


def _run(
    scene: Scene, checksum: Checksum, recipe: Recipe, targets: Outputs, threads: int, progress: Progress | None,
    cluster: Cluster | None,
) -> Result:  # fmt: skip
    """Fit, score, mark objects and write all files of an open scene."""
    begun = time.perf_counter()
    log_scene(scene)
    if recipe.method == "auto" and (targets.p_value or targets.background):
        recipe = replace(recipe, method="rx")  # the default detector that has both outputs
    if recipe.moving:
        delayed_bands(scene)  # raises before the long work if the times of the bands are not known
    plan = make_plan(scene, recipe, threads)
    for note in plan.notes:
        log.info("%s", note)
    recipe = plan.recipe
    targets.check(recipe)
    if cluster and recipe.method == "lines":
        raise InputError("lines are scored in the order in which they come: leave out --workers and --cluster.")
    background = None
    if plan.sea is not None:
        plan = replace(plan, sea=fit_sea(plan))
    elif plan.rule is None and recipe.method != "lines":
        background = plan.given or fit_background(plan, cluster.run if cluster else tiling.run, progress)
    notes = notes_on(plan, background)
    for note in notes:
        log.info("%s", note)
    ready = detector(recipe.method, background, drop=recipe.drop, nir=plan.nir) if background else None
    law = _law(plan, ready, background)
    with Scratch(overwrite=targets.overwrite) as scratch:
        work = _scoring(plan, targets, ready, law)
        tally, tail, beside = _write_tiles(scratch, work, targets, cluster, progress)
        if not tally.scored:
            raise NoWaterError(f"nothing to score in {scene.path}: {_why_nothing(tally)}. Check --nodata and --mask.")
        threshold, found = None, None
        if tail is not None:
            with open_dataset(str(scratch.file(targets.image))) as scores:
                marker = Marker(plan, targets, scores, tail, beside)
                threshold = marker.threshold() if plan.sea else _threshold(recipe, tail, law)
                found = marker.write(threshold, scratch, progress)
        if targets.background and background:
            write_text(scratch, targets.background, replace(background, names=plan.names).to_json() + "\n")
        said = plain(
            {
                **describe(plan, targets, background, threshold, tally, checksum),
                "objects": found,
                "notes": [*scene.notes, *plan.notes, *notes],
                "warnings": warnings_of(plan, background, threshold, tally),
                "seconds": round(time.perf_counter() - begun, 3),
            }
        )
        if cluster:
            said["cluster"] = cluster.numbers()
        write_json(scratch, targets.sidecar, said)
    _log_result(targets, tally, threshold, found, said)
    return Result(tally, background, threshold, found, said)


def _log_result(
    targets: Outputs, tally: PixelCounts, threshold: Threshold | None, found: int | None, said: dict[str, Any]
) -> None:
    if threshold is not None:
        log.info("%s", threshold)
    for warning in said["warnings"]:
        log.warning("%s", warning)
    marked = "" if found is None else f", {found} objects"
    log.info("%s: %d of %d pixels scored%s in %.2f s", targets.image, tally.scored, tally.total, marked,
             said["seconds"])  # fmt: skip


def fit_background(plan: Plan, run: tiling.Run = tiling.run, progress: Progress | None = None) -> Background:
    """Fit the background of a plan over its tiles, on threads or by a cluster's `run`."""
    recipe, bands = plan.recipe, plan.bands
    pixels = sum(t.shape[0] * t.shape[1] for t in plan.tiles)
    share = sample_share(recipe.covariance, pixels)

    def gather(tile: Tile) -> Part:
        block = plan.scene.source.read(tile.window, list(bands))
        area = None if plan.area is None else plan.area.read(tile.window)
        return Part.of(block, both(plan.mask.read(plan.scene, tile), area), (tile.row0, tile.col0), share)

    told = progress and partial(progress, "fit")
    done = run(plan.tiles, gather, progress=told, threads=plan.threads, start=enter_thread)
    whole = Part.merge(list(tiling.by_rows(done, Part.merge)))
    return whole.background(recipe.covariance, ridge=recipe.ridge, names=plan.names)


def _law(plan: Plan, ready: Detector | None, background: Background | None) -> tuple[int, int] | None:
    """Degrees of freedom of the scores of a normal background, and number of pixels in the statistics."""
    if not plan.recipe.kind.law:
        return None
    if ready is not None and background is not None:
        return ready.rank, background.n
    inner, outer = plan.recipe.window
    return len(plan.bands), outer * outer - inner * inner


def _threshold(recipe: Recipe, tail: Tail, law: tuple[int, int] | None) -> Threshold:
    """Threshold for the requested false-alarm rate, with the observed rate."""
    pfa = float(recipe.pfa or 0)
    if recipe.threshold in ("chi2", "f") and law:
        found = cutting.from_chi2(pfa, law[0]) if recipe.threshold == "chi2" else cutting.from_f(pfa, *law)
        return found.measured(tail.above(found.value), tail.n)
    return (cutting.from_quantile if recipe.threshold == "empirical" else cutting.from_tail)(tail, pfa)


def _scoring(plan: Plan, targets: Outputs, ready: Detector | None, law: tuple[int, int] | None) -> Scoring:
    """Scorer of tiles; it keeps as many of the highest scores as the threshold needs."""
    recipe, pixels = plan.recipe, plan.scene.height * plan.scene.width
    rate = max(recipe.pfa or 0.0, CANDIDATES if plan.sea else 0.0)
    highest = Highest(Tail.keep_for(rate, pixels)) if recipe.thresholded else None
    lines = LineScorer() if recipe.method == "lines" else None
    return Scoring(plan, ready, law, highest, bool(targets.p_value), bool(targets.flags), lines)


def _write_tiles(
    scratch: Scratch, work: Scoring, targets: Outputs, cluster: Cluster | None, progress: Progress | None
) -> tuple[PixelCounts, Tail | None, dict[int, Places]]:
    """Score and write all tiles; return counts, the highest scores, and the pixels attached to land by class."""
    plan, highest, tally = work.plan, work.highest, PixelCounts()
    beside: dict[int, list[Places]] = {sea.ALONGSIDE: [], sea.ATTACHED: []}
    images = _images(plan, targets)
    run = cluster.run if cluster else tiling.run
    told = progress and partial(progress, "score")
    with writing_all(scratch, images) as writers:
        for tile, scored in run(plan.tiles, work, threads=plan.threads, progress=told, start=enter_thread):
            for what, writer in writers.items():
                if (block := getattr(scored, what)) is not None:
                    writer.write(block, tile.window)
            tally.add(scored.tally)
            for which, places in scored.beside.items():
                beside[which].append(places)
            if highest and scored.tail:
                highest.add(scored.tail)
    return tally, highest.total() if highest else None, {k: joined(v) for k, v in beside.items()}


def _images(plan: Plan, targets: Outputs) -> dict[str, tuple[Path, Layout]]:
    """File and layout of each raster, by the fields of `Scored`."""
    info = raster_of(plan.scene).info
    options = dict(targets.options)
    if info.compression == "deflate" and "compress" not in map(str.lower, options):
        options = {"ZLEVEL": "1", **options}  # scores are noise: a higher level doubles the time, not the compression
    info = replace(info, band_tags=({},) * info.count)  # a score has no wavelength
    base = Layout(
        info, (0,), "float32", float("nan"), options, scaled=False, names=(plan.recipe.method,), tile=plan.shape
    )
    images = {"scores": (targets.image, base)}
    if targets.p_value:
        images["p_values"] = targets.p_value, replace(base, names=("p-value",))
    if targets.flags:
        images["flags"] = targets.flags, replace(base, dtype="uint8", nodata=None, names=("flags",), flags=MEANINGS)
    return images


def _why_nothing(tally: PixelCounts) -> str:
    """Why no pixel has a score."""
    if tally.too_few:
        return "no ring holds two valid pixels"
    return "every pixel is nodata" if tally.masked_out < tally.total else "no pixel lies inside the mask"
