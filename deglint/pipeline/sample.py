"""Fit a removal to the sample of a scene: read training tiles, try candidates on them or fit to them."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from .. import tiles as tiling
from ..choose import Choice, choose, without_ships
from ..compensate import Background, Chain, FitRemoval, ReplaceLevel, Sample, Setting, State, fit_chain
from ..compensate.posterior import WAVES_RESOLVED
from ..compensate.psf import PSF, system_psf, typical_psf
from ..masks import SHORE, water
from ..masks.find import COARSE_PIXEL
from ..moments import CELL, Mask
from ..morphology import grown, opened
from ..readers.areas import collection, to_geojson
from ..readers.bands import optics_of
from ..readers.grid import pixel_size
from ..remove import METHODS, FitRequest, GlintModel, SampleTile, fit_pointwise
from ..remove.further import more_references
from ..remove.statistics import SamplePlan, SampleStatistics, gather, merge
from ..remove.strips import Strips, filled
from ..remove.wiener import SquareKinds
from ..scene import FloatArray, Scene, Window
from ..tiles import Tile
from .messages import log
from .overview import OVERVIEW_PIXELS, TILE_SIDE, Job, Sampler, sampler_of
from .recipe import smallest_object

HALO = 64  # halo around a training tile [pixel]: windows, kernels and clumps of the first stages need it
TRIED, TRIED_SIDE, TRIED_HALO = 8, 128, 32
"""Number and side of the squares on which candidates are tried, and their halo [pixel]; trials take a few seconds."""
AS_LARGE = 0.9  # squares with samples of at least this share of the largest sample are equally suited for trials
KEPT_PIXELS = 1 << 20  # most pixels whose values are kept in memory to compute a percentile or a mode
MOST_CELLS = 1 << 14  # approximate number of cells, or groups of cells, whose moments are kept for standard errors

Place = tuple[Window | None, list[dict[str, object]]]
"""Window of the scene around the sample in a tile (None: no sample); outline of this sample as GeoJSON if requested."""
Sampled = tuple[dict[str, Any], dict[str, object] | None]
"""The sidecar entries of a sample, and its outline as GeoJSON if requested."""


@dataclass(frozen=True, eq=False)
class Training:
    """A training tile: a part of a scene that is read for a fit, with the halo that compensation stages need."""

    tile: Tile
    outer: Tile  # the tile with its halo
    block: FloatArray  # (band, row, column) of `outer`, physical values of all bands
    water: Mask  # (row, column) of `outer`, True for water
    sample: Mask  # (row, column) of `tile`: selected by the user, else water away from shores (if none, all water)

    @property
    def inside(self) -> Mask:
        """Mask of the sample on the tile with its halo, (row, column); False in the halo."""
        out = np.zeros(self.outer.shape, np.bool_)
        out[self.tile.within(self.outer)] = self.sample
        return out

    def as_sample(self, image: FloatArray | None = None) -> SampleTile:
        """The tile without its halo, for methods that use neighbouring pixels; if given, `image` replaces `block`."""
        core = self.tile.within(self.outer)
        block = np.ascontiguousarray((self.block if image is None else image)[core])
        return SampleTile(block, np.ascontiguousarray(self.water[core]), self.sample, (self.tile.row0, self.tile.col0))


def training_reader(job: Job, halo: int = 0, *, with_water: bool = False) -> Callable[[Tile], Training]:
    """Make a function that reads a tile with a halo as a `Training`. If `Recipe.sample` is "auto", the sample of the
    tile is its water away from shores. Else the sample is the area that the recipe selects. The water of the
    tile is then this area and, only if `with_water` is True, also the water that is found.
    """
    scene, sampler, every = job.scene, job.sampler, list(range(len(job.scene.bands)))
    rule = job.overview.water if sampler is None or with_water else None
    reach = rule.halo if rule else 0

    def work(tile: Tile) -> Training:
        outer = tile.grown(halo, scene.height, scene.width)
        wide = outer.grown(reach, scene.height, scene.width)
        read = scene.source.read(wide.window, every)
        place = outer.within(wide)
        block, found = np.ascontiguousarray(read[place]), np.ones(outer.shape, np.bool_)
        if rule is not None:
            found = np.ascontiguousarray(water([read[b] for b in job.overview.bands], rule)[place])
        core = tile.within(outer)
        if sampler is None:
            away = opened(found, SHORE)[core]  # squares of water alone, away from shores
            sample = away if away.any() else found[core]
        else:
            sample = sampler.mask(block[core][list(sampler.bands)], tile)
            found[core] = found[core] | sample if with_water else sample
        return Training(tile, outer, block, found, np.ascontiguousarray(sample))

    return work


def strips_of_footprints(scene: Scene, band: int) -> Strips | None:
    """Map of odd and even detector strips, from the detector footprints of a 0-based band; None unless both occur."""
    if scene.footprints is None:
        return None
    centres = np.minimum(np.arange(CELL // 2, scene.width + CELL // 2, CELL), scene.width - 1)
    known = []
    for row in range(CELL // 2, scene.height + CELL // 2, CELL):
        at = min(row, scene.height - 1)
        line = scene.footprints.read(((at, at + 1), (0, scene.width)), [band])[0, 0, centres]
        known.append(np.where(np.isfinite(line), np.nan_to_num(line) % 2, -1).astype(np.int8))
    second = filled(np.array(known))
    return Strips.of(second) if second.any() and not second.all() else None


def strips_in(job: Job, kinds: SquareKinds) -> Strips:
    """Map the detector strips with opposite band delays in the scene; `kinds` finds the strip kind of each square."""
    read, (_bands, height, width) = training_reader(job), job.scene.shape
    known = np.full((-(-height // CELL), -(-width // CELL)), -1, np.int8)
    everything = tiling.tiles(height, width, (TILE_SIDE, TILE_SIDE))
    for places, second in job.results(everything, lambda tile: kinds(read(tile).as_sample())):
        known[places[:, 0] // CELL, places[:, 1] // CELL] = second
    return Strips.of(filled(known))


def setting(job: Job) -> Setting:
    """Properties of the scene of a job that the fit of a chain needs: bands, NIR, PSFs and pixel size."""
    optics, nir = optics_of(job.scene), tuple(dict.fromkeys(b for i in job.request.indexes for b in i.bands))
    found = Setting(job.scene.bands, nir, pixel=pixel_size(job.scene) or 0.0)
    waves = found.wavelengths[found.images].tolist()
    if not all(300 <= w <= 2500 for w in waves):
        return found
    known = {w: system_psf(w, **optics) if optics else typical_psf(w) for w in waves}
    sharp = PSF(np.ones((1, 1)))  # of bands that are no images
    return replace(found, psfs=tuple(known.get(w, sharp) for w in found.wavelengths.tolist()))


def read_training(job: Job, *, for_chain: bool) -> list[Training]:
    """Read the training tiles; if `for_chain` is True, each with a halo and a mask of all water. If the tiles have more
    than 600,000 pixels in all, only about 300,000 are read, in evenly spread tiles that do not depend on file blocks.
    """
    places: Sequence[Tile] = job.sampler.squares if job.sampler else job.overview.tiles
    if sum(tile.pixels for tile in places) > 2 * OVERVIEW_PIXELS:
        places = tiling.spread(places, OVERVIEW_PIXELS)
    halo = HALO if for_chain else 0
    return list(job.results(places, training_reader(job, halo, with_water=for_chain), halo, job.note))


def sample_of(training: Sequence[Training]) -> Sample:
    """Convert training tiles to a `Sample`, to which the stages of a chain are fitted."""
    states = tuple(State.of(t.block, t.water, (t.outer.row0, t.outer.col0)) for t in training)
    return Sample(states, tuple(t.inside & s.water for t, s in zip(training, states, strict=True)))


def fit_removal(job: Job, training: Sequence[Training], method: str, sample: Sample, chain: Chain) -> GlintModel:
    """Fit a removal method to `sample`, made from the tiles `training` by the stages `chain.before`. If these contain
    `identify-level` (a morphological opening), `Method.after_opening` of the method is fitted, if it has one.
    """
    images, kind = [s.image for s in sample.states], METHODS[method]
    if not kind.neighbours:
        return fit_pointwise(method, job.request, images, sample.inside)
    tiles = [t.as_sample(image) for t, image in zip(training, images, strict=True)]
    background = next((stage for stage in reversed(chain.before) if isinstance(stage, Background)), None)
    if background is not None and kind.after_opening is not None:
        replaced = any(isinstance(stage, ReplaceLevel) for stage in chain.before)
        inner = offshore(tiles, background.size)
        return kind.after_opening(job.request, inner, background.clear, background.cut if replaced else None)
    request = replace(_of_kernels(job), faint_glint=chain.text != "remove")
    if request.faint_glint:  # the fit expects the posterior mean to remove strong glint
        request = replace(request, more=more_references(request, tiles))
    return kind.fit(replace(request, strips=strips_of_footprints(job.scene, job.request.correct[0])), tiles)


def _of_kernels(job: Job) -> FitRequest:
    """The request of a job for a fit, with the options for a method with `Method.neighbours`."""
    pixel = pixel_size(job.scene) or 0.0  # an unknown pixel size is treated like a fine one
    resolved, sparkle = pixel < WAVES_RESOLVED, pixel < COARSE_PIXEL
    return replace(job.request, regression="detrended", resolved=resolved, sparkle=sparkle)


def offshore(tiles: Sequence[SampleTile], size: int) -> list[SampleTile]:
    """Remove from the samples of tiles the pixels that are nearer to land than `size` [pixel], as a morphological
    opening is too dark there. If less than half of the pixels would be left, the samples are not changed.
    """
    inner = [replace(t, sample=t.sample & ~grown(~t.water, 2 * size - 1)) for t in tiles]
    enough = 2 * sum(int(t.sample.sum()) for t in inner) >= sum(int(t.sample.sum()) for t in tiles)
    return inner if enough else list(tiles)


def fit_training(job: Job, training: Sequence[Training], text: str, method: str) -> tuple[Chain, GlintModel, Sampled]:
    """Fit chain `text` with removal `method`, which has `neighbours` if the chain is "off"; return also `Sampled`."""
    if text != "off":
        found = fit_chain(text, sample_of(training), setting(job), partial(fit_removal, job, training, method))
        chain, model = found.chain, found.model
    else:
        strips = strips_of_footprints(job.scene, job.request.correct[0]) or partial(strips_in, job)
        request = replace(_of_kernels(job), strips=strips)
        chain, model = Chain(), METHODS[method].fit(request, [t.as_sample() for t in training])
    pixels = sum(int(np.count_nonzero(t.sample)) for t in training)
    places = [place_of(t.sample, t.tile, job.scene if job.want_sample else None) for t in training]
    return chain, model, describe_sample(job, model, pixels, places)


def chosen(job: Job, training: Sequence[Training]) -> Choice:
    """Choose a candidate by trials on up to 8 squares with a large sample; each square is a part of a training tile."""
    parts = [_part_of(t, job.scene) for t in training]
    pixels = sorted(int(p.sample.sum()) for p in parts)
    least = min(AS_LARGE * pixels[-1], pixels[-TRIED:][0])
    full = [p for p in parts if p.sample.sum() >= least]
    parts = [full[k] for k in np.unique(np.linspace(0, len(full) - 1, TRIED).astype(int))]
    pixel, rule = pixel_size(job.scene), job.overview.water
    sample, trial = sample_of(parts), replace(job, request=replace(job.request, level_error=False))
    fine = pixel is not None and pixel < COARSE_PIXEL
    if not fine and rule is not None and rule.window == 1:  # sparkle is not resolved, or may not be (unknown size)
        sample = without_ships(sample)
    width = smallest_object(job.recipe.smallest_object, pixel)

    def removal(method: str) -> FitRemoval:
        return partial(fit_removal, trial, parts, method)

    return choose(sample, setting(job), job.request.correct, removal, width=width, fine=fine)


def _part_of(found: Training, scene: Scene) -> Training:
    """Part of a tile for trials: the first of the squares at its corners that has sample pixels, else the first."""
    tile, side = found.tile, TRIED_SIDE
    rows, columns = ((low, max(high - side, low)) for low, high in tile.window)
    corners = [Tile(r, r + side, c, c + side).clipped(tile) for r in rows for c in columns]
    part = next((p for p in corners if found.sample[p.within(tile)].any()), corners[0])
    outer = part.grown(TRIED_HALO, scene.height, scene.width)
    place = outer.within(found.outer)
    block, water = np.ascontiguousarray(found.block[place]), np.ascontiguousarray(found.water[place])
    return Training(part, outer, block, water, np.ascontiguousarray(found.sample[part.within(found.tile)]))


def fit_sampled(job: Job, method: str) -> tuple[GlintModel, Sampled, list[str]]:
    """Fit a pointwise method (no neighbouring pixels) to the sample; return the model, its `Sampled` and log lines."""
    sampler = job.sampler or sampler_of(job)
    # pixels of the tile around the sample, if it is known, not of all tiles that it touches
    pixels = sampler.bounds.pixels if sampler.bounds else sum(tile.pixels for tile in sampler.tiles)
    share, levels = max(1, -(-pixels // KEPT_PIXELS)), math.ceil(math.log2(max(pixels / CELL**2 / MOST_CELLS, 1)))
    plan = replace(METHODS[method].plan(job.request), share=share, levels=levels)  # type: ignore[misc]
    read = list(_read(job, sampler, plan))
    stats = merge([part for part, _places in read], plan)
    model = METHODS[method].fit(job.request, stats)
    entries, outline = describe_sample(job, model, stats.moments.n, [p for _part, places in read for p in places])
    note = f"sample ({job.recipe.sample}): {stats.moments.n} pixels, {_place(entries['rows_columns'])}"
    return model, (entries | sampler.numbers, outline), [note]


def _read(job: Job, sampler: Sampler, plan: SamplePlan) -> Iterator[tuple[SampleStatistics, list[Place]]]:
    """Yield, for each row of tiles of the sampler, the statistics of the sample, and its `Place` in each tile."""
    scene, halo = job.scene, plan.halo
    outlined = scene if job.want_sample else None  # `work` must not use `job`: its `note` cannot be sent to workers
    columns = sorted({*plan.read_bands, *sampler.bands})
    rows, reach = [columns.index(b) for b in plan.read_bands], halo + sampler.halo

    def work(tile: Tile) -> tuple[SampleStatistics, Place]:
        outer, middle = (tile.grown(n, scene.height, scene.width) for n in (reach, halo))
        block = scene.source.read(outer.window, columns)
        mask = sampler.mask(block[[columns.index(b) for b in sampler.bands]], outer)
        inner = middle.within(outer)
        mask, block = mask[inner], block[inner][rows]
        part = gather(block, mask, plan, origin=(tile.row0, tile.col0), crop=tile.crop_of(middle))
        return part, place_of(mask[tile.within(middle)], tile, outlined)

    largest = max(sampler.tiles, key=lambda tile: tile.pixels).shape
    at_once = tiling.affordable(job.threads, largest, 4 * len(columns))  # statistics take several copies
    done = job.run(sampler.tiles, work, threads=at_once, progress=job.note)
    return tiling.by_rows(done, lambda row: (merge([part for part, _ in row], plan), [place for _, place in row]))


def place_of(mask: Mask, tile: Tile, outlined: Scene | None) -> Place:
    """The `Place` of the sample in a tile, from its `mask` (row, column); outlined if a scene `outlined` is given."""
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
    """A half-open window as text: "rows 0-10, columns 0-10" for the first ten of both; "nowhere" for None."""
    return "nowhere" if box is None else f"rows {box[0][0]}-{box[0][1]}, columns {box[1][0]}-{box[1][1]}"
