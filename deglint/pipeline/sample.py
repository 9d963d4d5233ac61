"""The sample of a scene: where it lies, training tiles, fits to them, and trials of candidates on them."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..choose import Choice, choose, without_ships
from ..compensate import Background, Chain, ReplaceLevel, Sample, Setting, State, fit_chain
from ..compensate.posterior import WAVES_RESOLVED
from ..compensate.psf import system_psf, typical_psf
from ..errors import FitError
from ..masks import away_from_shore, deep_water, fit_sample, water
from ..masks.find import COARSE_PIXEL
from ..moments import CELL
from ..morphology import grown
from ..readers.areas import open_area, window_area
from ..readers.bands import optics_of
from ..readers.grid import pixel_size
from ..remove import METHODS, FitRequest, GlintModel, SampleTile, fit_pointwise, mixture, wiener
from ..remove.further import more_references
from ..remove.strips import Strips, filled
from ..remove.wiener import SquareKinds
from ..scene import FloatArray, Scene, Window
from ..tiles import Tile
from .overview import OVERVIEW_PIXELS, TILE_SIDE, Overview, on_threads, read_tiles, role_bands, tile_shape_of
from .recipe import Recipe, smallest_object

Mask = npt.NDArray[np.bool_]
Progress = Callable[[str, int, int], None]
LEAST_PERCENTILE = 0.5
"""Percentile of the glint index that is taken as glint-free if glint covers the whole sample [%]: nearly the minimum,
to allow for noise. Otherwise the glint-free value is the median of the pixels without glint."""
HALO = 64  # halo around a training tile, for windows, kernels and clumps of its first stages [pixel]
TRIED, TRIED_SIDE, TRIED_HALO = 8, 128, 32
"""Number and side of the squares on which candidates are tried, and their halo [pixel]. The time of the trials, two to
three seconds on two processors, is proportional to their area."""


@dataclass(frozen=True)
class Job:
    """Input of a fit to one overview of a scene."""

    scene: Scene
    recipe: Recipe
    request: FitRequest
    overview: Overview
    threads: int
    note: Callable[[int, int], None] | None  # called with the number of tiles that are done, and of all
    run: tiling.Run  # function that processes tiles
    want_sample: bool  # return the outline of the sample

    def results(self, tiles: Sequence[Tile], work: Callable[[Tile], Any], halo: int = 0, note: Any = None) -> Any:
        """Iterate over `work(tile)` of each tile, in order, on as many threads as memory allows.

        `halo`: pixels around a tile that `work` reads; `note`: called with the number of tiles done, and of all
        """
        at_once = tiling.affordable(self.threads, (TILE_SIDE + 2 * halo,) * 2, 2 * len(self.scene.bands))
        return on_threads(tiles, work, at_once, note)


@dataclass(frozen=True)
class Sampler:
    """Where the sample of a scene lies."""

    tiles: Sequence[Tile]  # tiles that contain the sample
    mask: Callable[[Any, Sequence[int], Tile], Mask]  # gives its mask for (block, 0-based bands in it, tile)
    bands: tuple[int, ...] = ()  # 0-based bands that `mask` needs
    halo: int = 0  # pixels around a tile that `mask` needs
    numbers: dict[str, Any] = field(default_factory=dict)  # entries of the sidecar
    bounds: Window | None = None  # window around a sample that the user has given

    def squares(self, scene: Scene) -> Sequence[Tile]:
        """Tiles of up to `TILE_SIDE` pixels a side that cover the sample, whatever the blocks of the file are."""
        return self.tiles if self.bounds is None else tiles_over(scene, self.bounds, (TILE_SIDE, TILE_SIDE))


def sampler_of(job: Job) -> Sampler:
    """The `Sampler` for the sample that the recipe of a job requests.

    Raises FitError, InputError, ReadError: no sample was found, or the given one cannot be used.
    """
    scene, sample, overview = job.scene, job.recipe.sample, job.overview
    if sample == "auto":
        if overview.water is None:
            raise FitError(
                "a sample cannot be found without a visible band to tell water by. Pass --sample FILE.geojson, a "
                "window, or --sample all."
            )
        bands = role_bands(overview.roles)
        rule = fit_sample(read_tiles(scene, overview.tiles, bands, job.threads), overview.water)
        numbers = {"rule": rule.numbers(), "tiles": len(overview.tiles)}

        def deep(block: Any, columns: Sequence[int], _tile: Tile) -> Mask:
            return deep_water(block[[columns.index(b) for b in bands]], rule)

        return Sampler(overview.tiles, deep, bands, rule.halo, numbers)
    area = window_area(((0, scene.height), (0, scene.width)))
    if sample != "all":
        # the area of --mask is the sample, too, where no other is given
        area = open_area(sample, scene, "--mask" if sample == job.recipe.mask else "--sample")
    numbers = {"crs": area.note} if area.note else {}
    tiles = tiles_over(scene, area.bounds, tile_shape_of(scene))
    return Sampler(tiles, lambda _block, _columns, tile: area.read(tile.window), numbers=numbers, bounds=area.bounds)


def tiles_over(scene: Scene, bounds: Window, shape: tuple[int, int]) -> list[Tile]:
    """Tiles of this shape (rows, columns) [pixel] that intersect the window `bounds`."""
    (top, bottom), (left, right) = bounds
    return [
        t for t in tiling.tiles(scene.height, scene.width, shape)
        if t.row0 < bottom and t.row1 > top and t.col0 < right and t.col1 > left
    ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Training:
    """A training tile: a part of a scene that is read for a fit, with the halo that stages need."""

    tile: Tile
    outer: Tile  # with the pixels around
    block: FloatArray  # of `outer`, physical values of all bands
    water: Mask  # of `outer`, where it is water
    sample: Mask  # of `tile`: water to learn from, away from shores, or the sample that the user named

    @property
    def inside(self) -> Mask:
        """Mask of the sample in the block, in the shape of `outer`."""
        out = np.zeros(self.outer.shape, np.bool_)
        out[self.tile.within(self.outer)] = self.sample
        return out

    def as_sample(self, image: FloatArray | None = None) -> SampleTile:
        """The tile without its halo, for methods that use neighbouring pixels. `image`: the block after some stages."""
        core = self.tile.within(self.outer)
        block = np.ascontiguousarray((self.block if image is None else image)[core])
        return SampleTile(block, np.ascontiguousarray(self.water[core]), self.sample, (self.tile.row0, self.tile.col0))


def training_reader(job: Job, sampler: Sampler | None, halo: int = 0) -> Callable[[Tile], Training]:
    """Make a function that reads a training tile; its sample comes from `sampler`, or is the water away from shores."""
    scene, rule, every = job.scene, job.overview.water, list(range(len(job.scene.bands)))
    named = rule is None or (sampler is not None and not halo)
    reach = 0 if rule is None or named else rule.halo

    def work(tile: Tile) -> Training:
        outer = tile.grown(halo, scene.height, scene.width)
        wide = outer.grown(reach, scene.height, scene.width)
        read = scene.source.read(wide.window, every)
        place = outer.within(wide)
        block, found = np.ascontiguousarray(read[place]), np.ones(outer.shape, np.bool_)
        if rule is not None and not named:
            found = np.ascontiguousarray(water([read[b] for b in role_bands(job.overview.roles)], rule)[place])
        core = tile.within(outer)
        if sampler is None:
            away = away_from_shore(found)[core]
            sample = away if away.any() else found[core]
        else:
            sample = sampler.mask(block[core], every, tile)
            found[core] = sample if not halo else found[core] | sample
        return Training(tile, outer, block, found, np.ascontiguousarray(sample))

    return work


def strips_of_footprints(scene: Scene, band: int) -> Strips | None:
    """Strips of odd and even detectors from the footprints of a 0-based band; None if not known or of one kind."""
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


def strips_in(job: Job, sampler: Sampler | None, kinds: SquareKinds) -> Strips:
    """Search the whole scene for strips of two kinds; `kinds` finds the kind of each square of a tile."""
    read, (_bands, height, width) = training_reader(job, sampler), job.scene.shape
    known = np.full((-(-height // CELL), -(-width // CELL)), -1, np.int8)
    everything = tiling.tiles(height, width, (TILE_SIDE, TILE_SIDE))
    for places, second in job.results(everything, lambda tile: kinds(read(tile).as_sample())):
        known[places[:, 0] // CELL, places[:, 1] // CELL] = second
    return Strips.of(filled(known))


def setting(job: Job) -> Setting:
    """Properties of the scene that the fit of a chain needs: bands, NIR, PSFs and pixel size."""
    optics, psfs = optics_of(job.scene), None
    wavelengths = [b.wavelength for b in job.scene.bands if b.wavelength and 300 <= b.wavelength <= 2500]
    if len(wavelengths) == len(job.scene.bands):
        known = optics and {"f_number": optics.f_number, "pitch": optics.pitch, "smear": optics.smear}
        psfs = tuple(system_psf(w, **known) if known else typical_psf(w) for w in wavelengths)
    nir = tuple(dict.fromkeys(b for i in job.request.indexes for b in i.bands))
    return Setting(job.scene.bands, nir, psfs, pixel_size(job.scene) or np.inf)


def read_training(job: Job, sampler: Sampler | None, halo: int) -> list[Training]:
    """Read the training tiles, each with a halo [pixel]. If they have more than 2 * `OVERVIEW_PIXELS` pixels, only
    tiles with about `OVERVIEW_PIXELS` pixels are read, evenly spread, whatever the blocks of the file are.
    """
    places: Sequence[Tile] = job.overview.tiles if sampler is None else sampler.squares(job.scene)
    if sum(tile.pixels for tile in places) > 2 * OVERVIEW_PIXELS:
        places = tiling.spread(places, OVERVIEW_PIXELS)
    return list(job.results(places, training_reader(job, sampler, halo), halo, job.note))


def sample_of(training: Sequence[Training]) -> Sample:
    """Training tiles as the sample to which stages are fitted."""
    states = tuple(State.of(t.block, t.water, (t.outer.row0, t.outer.col0)) for t in training)
    return Sample(states, tuple(t.inside & s.water for t, s in zip(training, states, strict=True)))


def fit_removal(job: Job, training: Sequence[Training], method: str, sample: Sample, chain: Chain) -> GlintModel:
    """Fit a removal method to `sample`: the training tiles after the stages `chain.before`."""
    images = [s.image for s in sample.states]
    if not METHODS[method].neighbours:
        return fit_pointwise(method, job.request, images, sample.inside)
    tiles = [t.as_sample(image) for t, image in zip(training, images, strict=True)]
    background = next((stage for stage in reversed(chain.before) if isinstance(stage, Background)), None)
    if background is not None:
        percentile = max(50 * background.clear, LEAST_PERCENTILE)
        replaced = any(isinstance(stage, ReplaceLevel) for stage in chain.before)
        inner = offshore(tiles, background.size)
        return mixture.fit(job.request, inner, percentile, background.cut if replaced else None)
    request = replace(_of_kernels(job), faint=chain.text != "remove")
    if request.faint:  # the posterior mean follows
        request = replace(request, more=more_references(request, tiles))
    return wiener.fit(request, tiles, strips=strips_of_footprints(job.scene, job.request.correct[0]))


def _of_kernels(job: Job) -> FitRequest:
    """The request for a fit of method `wiener`."""
    resolved = (pixel_size(job.scene) or np.inf) < WAVES_RESOLVED
    return replace(job.request, regression="detrended", resolved=resolved)


def offshore(tiles: Sequence[SampleTile], size: int) -> list[SampleTile]:
    """The tiles, without the pixels of their samples that are nearer to land than `size` [pixel]: openings are too dark
    there. If less than half of the pixels would be left, the samples are not changed.
    """
    inner = [replace(t, sample=t.sample & ~grown(~t.water, 2 * size - 1)) for t in tiles]
    enough = 2 * sum(int(t.sample.sum()) for t in inner) >= sum(int(t.sample.sum()) for t in tiles)
    return inner if enough else list(tiles)


def fit_training(
    job: Job, training: Sequence[Training], sampler: Sampler | None, text: str, method: str
) -> tuple[Chain, GlintModel]:
    """Fit a chain and a removal method to training tiles; if `text` is "off", fit kernels (`wiener`) without stages."""
    if text != "off":
        found = fit_chain(text, sample_of(training), setting(job), partial(fit_removal, job, training, method))
        return found.chain, found.model
    strips = strips_of_footprints(job.scene, job.request.correct[0]) or partial(strips_in, job, sampler)
    return Chain(), wiener.fit(_of_kernels(job), [t.as_sample() for t in training], strips=strips)


def chosen(job: Job, training: Sequence[Training]) -> Choice:
    """Try candidates on parts of training tiles; the `TRIED` parts with the largest samples are used."""
    parts = sorted((_part_of(t, job.scene) for t in training), key=lambda p: -int(p.sample.sum()))[:TRIED]
    pixel, rule = pixel_size(job.scene), job.overview.water
    sample, trial = sample_of(parts), replace(job, request=replace(job.request, level_error=False))
    fine = pixel is not None and pixel < COARSE_PIXEL
    if not fine and rule is not None and rule.window == 1:  # pixels do not resolve sparkle
        sample = without_ships(sample)
    width = smallest_object(job.recipe.smallest_object, pixel)
    with ThreadPoolExecutor(job.threads, thread_name_prefix="deglint") as pool:
        return choose(
            sample, setting(job), job.request.correct, lambda method: partial(fit_removal, trial, parts, method),
            width=width, fine=fine, each=pool.map,
        )  # fmt: skip


def _part_of(found: Training, scene: Scene) -> Training:
    """The first `TRIED_SIDE` rows and columns of a training tile, with a halo of `TRIED_HALO` pixels."""
    part = found.tile.split(TRIED_SIDE)[0]
    outer = part.grown(TRIED_HALO, scene.height, scene.width)
    place = outer.within(found.outer)
    block, water = np.ascontiguousarray(found.block[place]), np.ascontiguousarray(found.water[place])
    return Training(part, outer, block, water, np.ascontiguousarray(found.sample[part.within(found.tile)]))
