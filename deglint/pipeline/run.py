"""Process a file: open it, fit (or use a saved model), correct tile by tile, write the output and its sidecar."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from operator import index
from pathlib import Path
from typing import Any

import numpy as np

from .. import tiles as tiling
from ..checks import as_path, check_kind, checked_keywords, described
from ..checksum import Checksum, fingerprint
from ..cluster import Cluster
from ..compensate import Chain
from ..errors import InputError, NoWaterError
from ..raster.convert import physical_dtype
from ..raster.environment import environment
from ..raster.output import Scratch, plain, write_bytes, write_json, write_text, writing_all
from ..raster.targets import Reads, check_ending, check_images, check_targets
from ..readers.areas import collection
from ..readers.opening import open_scene
from ..readers.scenes import files_of
from ..readers.undeclared import settled
from ..remove import GlintModel
from ..report import before_after
from ..scene import FloatArray, Scene, Window
from ..tiles import Tile
from ..timing import Reporter
from .correct import Correction, correction
from .fit import Fitted, Progress, fit_scene, given_model
from .flags import SkyGlint, beside, glint_numbers, sky_glint
from .outputs import Outputs, PixelCounts, Result, log_result, saved, sidecar
from .overview import raster_of, tiles_over
from .recipe import Recipe

CHAIN_COPIES = 3  # memory that a tile needs with a chain, relative to a removal alone
READING = ("sensor", "nodata", "grid", "bands", "wavelengths", "scale", "offset")
"""Keywords of `remove_glint` for opening the input."""
WRITING = ("model_file", *(f.name for f in fields(Outputs) if f.name not in ("image", "model")))
"""Keywords of `remove_glint` for the outputs."""


@checked_keywords(*READING, "chain", *WRITING)
@tiling.one_thread_each()
def remove_glint(
    source: str | Path | Sequence[str | Path],
    image: str | Path | Outputs,
    recipe: Recipe | None = None,
    *,
    model: GlintModel | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    cluster: Cluster | None = None,
    **options: Any,
) -> Result:
    """Remove glint from a raster file.

    Parameters
    ----------
    source : path or sequence of paths
        GDAL name(s) of the input, as `deglint.open_scene` takes them.
    image : path or Outputs
        Path of the corrected image (a local GeoTIFF), or all outputs. The sidecar is written beside it as `image`.json.
    recipe : Recipe, optional
        Options; by default everything is determined automatically.
    model : GlintModel, optional
        Apply this model instead of fitting one. If a compensation was saved with it, give that as `chain`.
    threads, cluster : int and Cluster, optional
        Number of threads, by default one per processor; or a cluster (`deglint.cluster.connect`), with the same result.
    progress : callable, optional
        Called as progress(step, done, total): name of the step, numbers of finished and of all tiles.
    **options
        sensor, nodata, grid, bands, wavelengths, scale, offset: see `open_scene`; chain: see `model`; flags, amount,
        stderr, sample, picture, overwrite, dtype, options, request, reads, model_file (`Outputs.model`): see `Outputs`.

    Returns
    -------
    Result

    Raises
    ------
    ReadError, WriteError, InputError, BandError, FitError, NoWaterError
        The message has one line and names a remedy. No partial output is left, and existing files are not changed.

    Examples
    --------
    >>> remove_glint("scene.tif", "clean.tif", Recipe(method="hedley"))  # doctest: +SKIP
    """
    reading = {k: v for k, v in options.items() if k in READING}
    writing = {k.removesuffix("_file"): v for k, v in options.items() if k in WRITING}
    targets = replace(image if isinstance(image, Outputs) else Outputs(Path(as_path(image, "image"))), **writing)
    recipe = recipe or Recipe()
    check_kind(recipe, Recipe, "recipe", "Make one: deglint.Recipe(method='hedley').")
    _check_saved(model, options.get("chain"))
    run = Run(tiling.default_threads(threads), progress or Reporter(), cluster)
    with environment():
        files = check_outputs(source, recipe, reading.get("sensor"), targets)
        # it starts before the scene is opened, to notice all later changes
        checksum = Checksum(files, [recipe.sample, recipe.mask, *map(str, targets.reads)])
        scene = settled(open_scene(source, **reading))
        with raster_of(scene):
            fitted, work = prepare(scene, recipe, targets, run, model, options.get("chain"))
            return _correct_and_write(work, fitted, targets, checksum, run)


def _check_saved(model: object, chain: object) -> None:
    """Raise InputError if a given model or chain is of another type, or if a chain comes without its model."""
    if model is not None:
        check_kind(model, GlintModel, "model", "Read a saved one with deglint.pipeline.load_model.")
    if chain is not None:
        check_kind(chain, Chain, "chain", "Read a saved one with deglint.pipeline.load_chain.")
        check_kind(model, GlintModel, "model", "A chain belongs to a saved model; to fit one: Recipe(compensate=...).")


@dataclass(frozen=True)
class Run:
    """Threads or cluster that process the tiles of a run, its `progress` function, and the time of its start."""

    threads: int
    progress: Progress
    cluster: Cluster | None = None
    begun: float = field(default_factory=time.perf_counter)  # [s]


def check_outputs(source: object, recipe: Recipe, sensor: str | Path | None, targets: Outputs) -> list[str]:
    """Return the files of `source`. Raises InputError or WriteError if an output is an input or cannot be written."""
    given = [as_path(p, "source") for p in (source if isinstance(source, (list, tuple)) else [source])]
    files = [file for name in given for file in files_of(name)]
    named = {"--sample": recipe.sample, "--mask": recipe.mask, "--sensor": str(sensor or "")}
    reads: Reads = {"the input": [*given, *files], **{k: [v] for k, v in named.items()}, "an input": targets.reads}
    check_targets(targets.every(), reads, overwrite=targets.overwrite)
    check_images(targets.image, targets.flags, targets.amount, targets.stderr)
    check_ending(targets.picture, "a PNG", ".png")
    check_ending(targets.sample, "GeoJSON", ".geojson", ".json")
    check_ending(targets.model, "JSON", ".json")
    return files


def prepare(
    scene: Scene, recipe: Recipe, targets: Outputs, run: Run, model: GlintModel | None, chain: Chain | None
) -> tuple[Fitted, Correction]:
    """Fit a recipe to a scene, or use a given model and its chain. Return the fit and the correction of the scene.

    Raises the errors of `fit_scene`, `given_model` and `correction`; InputError if there is no sample to write.
    """
    if model is not None:
        fitted = given_model(scene, recipe, model, run.threads, chain)
    else:
        over, want = (run.cluster or tiling).run, targets.sample is not None
        fitted = fit_scene(scene, recipe, threads=run.threads, want_sample=want, progress=run.progress, run=over)
    if targets.sample and fitted.sample is None and fitted.choice and not fitted.model.fits:  # the choice is to copy
        fitted = replace(fitted, sample=collection([], scene))
    if targets.sample and fitted.sample is None:
        raise InputError(f"{fitted.model.method} was not fitted to a sample: leave out --save-sample.")
    work = correction(scene, fitted, targets=targets, dtype=targets.dtype, threads=run.threads)
    if work.area is not None and work.area.note:
        fitted = replace(fitted, notes=(*fitted.notes, work.area.note))
    return fitted, work


def _correct_and_write(work: Correction, fitted: Fitted, targets: Outputs, checksum: Checksum, run: Run) -> Result:
    """Correct a scene; write all `targets`. Raises NoWaterError if a band is to be corrected, but no pixel is."""
    scene = work.scene
    sky = sky_glint(scene) if targets.amount else None
    with Scratch(overwrite=targets.overwrite) as scratch:
        counts = _write_tiles(scratch, work, targets, sky, run)
        if counts.corrected == 0 and fitted.model.fits:
            why = "every pixel is nodata" if counts.nodata == counts.total else "no pixel is water inside the mask"
            raise NoWaterError(f"nothing to correct in {scene.path}: {why}. Check --nodata and --mask.")
        if targets.sample:
            write_json(scratch, targets.sample, fitted.sample)
        if targets.model:
            write_text(scratch, targets.model, saved(fitted) + "\n")
        if targets.picture:
            write_bytes(scratch, targets.picture, before_after(scene, scratch.file(targets.image), fitted.model))
        said = plain(sidecar(scene, fitted, targets, counts, checksum, time.perf_counter() - run.begun))
        if targets.flags:
            noise = {scene.names[b]: n for b, n in zip(work.changed, work.noise or (), strict=True)}
            said |= plain({"sun_glint": glint_numbers(counts, noise)})
        said |= plain({"sky_glint": sky}) if sky else {}
        said |= {"cluster": run.cluster.numbers()} if run.cluster else {}
        if targets.request:
            made = {p.name: fingerprint(scratch.file(p)) for p in targets.every() if p != targets.sidecar}
            said["batch"] = {"request": targets.request, "inputs": checksum.fingerprints(), "outputs": made}
        write_json(scratch, targets.sidecar, said)
    log_result(scene, fitted, said)
    return Result(fitted, counts, said, tuple(said["warnings"]), scene)


def _write_tiles(scratch: Scratch, work: Correction, targets: Outputs, sky: SkyGlint, run: Run) -> PixelCounts:
    """Correct all tiles, write them and the additional rasters, and count pixels; `sky` comes from `sky_glint`."""
    scene, image = work.scene, work.layout
    everything = tiling.tiles(scene.height, scene.width, image.tile)
    at_once = tiling.affordable(run.threads, image.tile, len(scene.bands) * (CHAIN_COPIES if work.by_cells else 1))
    counts = PixelCounts()
    images = {"raw": (targets.image, image)} | beside(scene, image, tuple(work.amount_bands), targets, sky)
    over, progress = (run.cluster or tiling).run, partial(run.progress, "correct")
    with writing_all(scratch, images) as writers:
        for tile, done in over(everything, work, threads=at_once, progress=progress):
            for what, writer in writers.items():
                writer.write(getattr(done, what), tile.window)
            if done.valid is not None:
                writers["raw"].write_mask(done.valid, tile.window)
            counts.add(done.counts)
    return counts


@checked_keywords()
@tiling.one_thread_each()
def correct(scene: Scene, fitted: Fitted, *, window: Window | None = None, mask: str | None = None) -> FloatArray:
    """Correct a scene, or a window of it, in memory, as `remove_glint` does, but without rounding to a file type.

    Parameters
    ----------
    scene : Scene
    fitted : Fitted
        Result of `fit_scene`; its compensation and its water mask are applied, too.
    window : ((row0, row1), (col0, col1)), optional
        Rows and columns to correct, ends excluded, inside the scene (else InputError); the whole scene by default.
    mask : str, optional
        Pixels to correct, as in `Recipe`; by default the mask of the recipe of `fitted`.

    Returns
    -------
    (band, row, column) ndarray
        Physical values, NaN where not valid; the values do not depend on the window.

    Examples
    --------
    >>> clean = correct(scene, fit_scene(scene))  # doctest: +SKIP
    """
    check_kind(scene, Scene, "scene", "Open it with deglint.open_scene.")
    check_kind(fitted, Fitted, "fitted", "Make it with deglint.fit_scene.")
    scene = fitted.undeclared.on(scene)
    try:
        (top, bottom), (left, right) = (map(index, side) for side in window or ((0, scene.height), (0, scene.width)))
    except (TypeError, ValueError):
        raise InputError(f"window: want ((row0, row1), (column0, column1)), got {described(window)}.") from None
    if not (0 <= top < bottom <= scene.height and 0 <= left < right <= scene.width):
        raise InputError(f"window {window} is not inside a scene of {scene.height} x {scene.width} pixels.")
    work = correction(scene, fitted, mask=mask)
    whole = Tile(top, bottom, left, right)
    out = np.empty((len(scene.bands), *whole.shape), physical_dtype(raster_of(scene).info.dtype))
    everything = tiles_over(scene, whole, work.layout.tile)
    progress = partial(Reporter(), "correct")
    for tile, (clean, _where) in tiling.run(everything, work.values, progress=progress):
        part = tile.clipped(whole)
        out[part.within(whole)] = clean[part.within(tile)]
    return out
