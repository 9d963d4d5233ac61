"""Fit a pointwise method (without neighbouring pixels) to a sample; with a tolerance, to as much of it as is needed.

With a tolerance, tiles spread over the scene are read in batches, until the relative standard error of the glint in
each corrected band (`deglint.remove.glint_error`) is at most the tolerance, or all tiles are read. The batches depend
only on the pixels of the scene, not on blocks of the file or on threads.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..errors import FitError
from ..moments import CELL
from ..raster.environment import enter_thread
from ..readers.areas import collection, to_geojson
from ..remove import METHODS, GlintModel, SamplePlan, SampleStatistics, gather, glint_error, merge
from ..scene import Scene, Window
from ..tiles import Tile
from .outputs import log
from .overview import OVERVIEW_PIXELS
from .sample import Job, Sampler

KEPT_PIXELS = 1 << 20  # most single pixels that are kept in memory for a percentile or a mode
MOST_CELLS = 1 << 14  # approximate number of cells, or groups of cells, whose moments are kept for standard errors
LEAST_CELLS = 40
"""Least effective number of cells (see `glint_error`) for a reliable standard error. In simulated seas with fewer than
25, where a few clumps of sparkle contain most of the glint, real errors were up to 24 times the estimated errors; with
more than 40, up to 1.3 times."""
GROWTH = 1.25, 4.0  # least and largest increase of the sample by the next batch, as a factor
READ_MARGIN = 1.1
"""Safety factor on the pixels to read, computed as if the error fell with the square root of their number."""

Place = tuple[Window | None, list[Any]]
"""Bounding window of the sample in a tile, and its outline as GeoJSON features if requested."""
Sampled = tuple[dict[str, Any], dict[str, Any] | None]
"""The sidecar entries of a sample, and its outline as GeoJSON if requested."""


def fit_sampled(job: Job, sampler: Sampler, method: str) -> tuple[GlintModel, Sampled, list[str]]:
    """Fit a pointwise method to its sample, in batches if there is a tolerance; also returns notes on the sample."""
    tolerance, plan = job.recipe.tolerance, METHODS[method].plan(job.request)  # type: ignore[misc]
    pool = sampler.squares(job.scene) if tolerance else sampler.tiles
    model: GlintModel | None = None
    read: list[tuple[SampleStatistics, list[Place]]] = []
    done, wanted, worst = set[Tile](), OVERVIEW_PIXELS, math.inf
    while len(done) < len(pool) and worst > tolerance:
        batch = [tile for tile in (tiling.spread(pool, wanted) if tolerance else pool) if tile not in done]
        if not batch:
            wanted = int(wanted * GROWTH[0])
            continue
        done.update(batch)
        taken = pixels = sum(tile.pixels for tile in done)
        if sampler.bounds and not tolerance:  # the area itself
            pixels = math.prod(high - low for low, high in sampler.bounds)
        share = max(1, -(-pixels // KEPT_PIXELS))
        if tolerance:  # a power of two: each share divides the later ones
            share = 1 << (share - 1).bit_length()
        plan = replace(plan, share=share, levels=math.ceil(math.log2(max(pixels / CELL**2 / MOST_CELLS, 1))))
        read += _read(job, sampler, plan, batch)
        stats = merge([part for part, _places in read], plan)
        if tolerance:
            model, errors, cells = _errors(job, method, stats)
            worst = max(errors.values(), default=0.0) if cells >= LEAST_CELLS else math.inf
            grows = READ_MARGIN * (worst / tolerance) ** 2 if math.isfinite(worst) else GROWTH[1]
            wanted = int(taken * min(max(grows, GROWTH[0]), GROWTH[1]))
    model = model or METHODS[method].fit(job.request, stats)
    notes, numbers = list[str](), dict(sampler.numbers)
    if tolerance:
        whole = job.scene.height * job.scene.width if sampler.bounds is None else sum(tile.pixels for tile in pool)
        numbers["tolerance"], note, doubts = _reached(tolerance, errors, cells, taken, whole)
        notes, model = [note], replace(model, warnings=(*model.warnings, *doubts))
    places = [place for _part, some in read for place in some]
    entries, outline = describe_sample(job, model, stats.moments.n, places)
    notes.append(f"sample ({job.recipe.sample}): {stats.moments.n} pixels, {_place(entries['rows_columns'])}")
    return model, (entries | numbers, outline), notes


def _read(
    job: Job, sampler: Sampler, plan: SamplePlan, batch: Sequence[Tile]
) -> Iterator[tuple[SampleStatistics, list[Place]]]:
    """Statistics of the sample in each row of tiles of a batch, and the place of the sample in each tile."""
    scene, halo = job.scene, max(plan.halo, 0)
    outlined = scene if job.want_sample else None  # workers of a cluster get no job
    columns = sorted({*plan.read_bands, *sampler.bands})
    rows, reach = [columns.index(b) for b in plan.read_bands], halo + sampler.halo

    def work(tile: Tile) -> Any:
        outer, middle = (tile.grown(n, scene.height, scene.width) for n in (reach, halo))
        block: Any = scene.source.read(outer.window, columns)
        mask = sampler.mask(block, columns, outer)
        inner = middle.within(outer)
        mask, block = mask[inner], block[inner][rows]
        part = gather(block, mask, plan, origin=(tile.row0, tile.col0), crop=tile.crop_of(middle))
        return part, place_of(mask[tile.within(middle)], tile, outlined)

    largest = max(batch, key=lambda tile: tile.pixels).shape
    at_once = tiling.affordable(job.threads, largest, 4 * len(columns))  # statistics take several copies
    done = job.run(batch, work, threads=at_once, progress=job.note, start=enter_thread)
    return tiling.by_rows(done, lambda row: (merge([part for part, _ in row], plan), [place for _, place in row]))


def _errors(job: Job, method: str, stats: SampleStatistics) -> tuple[GlintModel | None, dict[str, float], float]:
    """A fit, its relative error in each band, and the effective number of cells; None, {} and 0 if a fit fails."""
    try:
        model = METHODS[method].fit(job.request, stats)
    except FitError:
        return None, {}, 0.0
    found = {fit.name: glint_error(stats, model, fit) for fit in model.fits}
    return model, {name: error for name, (error, _) in found.items()}, min(cells for _, cells in found.values())


def _reached(
    tolerance: float, errors: dict[str, float], cells: float, taken: int, whole: int
) -> tuple[dict[str, Any], str, list[str]]:
    """Sidecar entries, log line and warnings on the tolerance, after `taken` of `whole` pixels were read."""
    worst = max(errors.values(), default=0.0)
    met = cells >= LEAST_CELLS and worst <= tolerance
    numbers = {
        "wanted": tolerance,
        "met": met,
        "relative_standard_error": errors,
        "effective_cells": cells,
        "least_effective_cells": LEAST_CELLS,
        "pixels_read": taken,
        "pixels_skipped": whole - taken,
    }
    note = f"tolerance {tolerance:g} of the slopes: reached {worst:.2g} with {taken} of {whole} pixels read"
    known = f"the slopes' error is {worst:.2g}"
    if cells < LEAST_CELLS:
        known = f"most of the sample's glint is in {cells:.0f} squares of 64 pixels, too few to know the error by"
    return numbers, note, [] if met else [f"the tolerance {tolerance:g} was not reached: {known}."]


def place_of(mask: npt.NDArray[np.bool_], tile: Tile, outlined: Scene | None) -> Place:
    """Place of the sample in a tile, from its mask (row, column); with an outline if a scene is given."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return None, []
    top, left = tile.row0 + int(rows[0]), tile.col0 + int(columns[0])
    box = (top, tile.row0 + int(rows[-1]) + 1), (left, tile.col0 + int(columns[-1]) + 1)
    return box, to_geojson(mask, (tile.row0, tile.col0), outlined) if outlined else []


def describe_sample(job: Job, model: GlintModel, pixels: int, places: Sequence[Place]) -> Sampled:
    """Sidecar entries and outline of the sample to which a model was fitted; its size and position are logged."""
    boxes, box = np.array([box for box, _ in places if box is not None]), None
    if len(boxes):
        (top, left), (bottom, right) = boxes[:, :, 0].min(axis=0).tolist(), boxes[:, :, 1].max(axis=0).tolist()
        box = (top, bottom), (left, right)
    log.info("sample: %d pixels, %s", pixels, _place(box))
    numbers = {
        "kind": job.recipe.sample,
        "pixels": pixels,
        "rows_columns": box,
        "share_of_scene": pixels / (job.scene.height * job.scene.width),
        "r2": {f.name: f.r2 for f in model.fits},
        "slopes": {f.name: f.slope for f in model.fits},
        "glint_level": model.level_interval and model.level_interval[2] - model.level_interval[1],
    }
    features = [feature for _, some in places for feature in some]
    return numbers, collection(features, job.scene) if job.want_sample else None


def _place(box: Window | None) -> str:
    """A window as text; "nowhere" without a window."""
    return "nowhere" if box is None else f"rows {box[0][0]}-{box[0][1]}, columns {box[1][0]}-{box[1][1]}"
