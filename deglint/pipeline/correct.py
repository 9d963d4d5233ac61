"""Correct a scene tile by tile: corrected values, flags, counts of pixels, amounts of glint and standard errors.

A compensation is a chain: stages before the removal of glint, the removal, and stages after the removal.
"""

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from .. import compensate
from .. import tiles as tiling
from ..choose.candidates import OF_OBJECT
from ..choose.implants import discs
from ..choose.trial import LARGEST_DISC
from ..compensate import Chain, Posterior, ReplacedError, Sample, Setting, State, apply_chain, with_targets
from ..compensate.state import Float32
from ..compensate.uncertainty import halo as span_halo
from ..errors import FitError, InputError
from ..masks import WaterRule, water
from ..moments import Mask
from ..morphology import eroded
from ..raster.convert import Raw, encode, is_finite, relaid
from ..raster.output import Layout
from ..readers.areas import Area, open_area
from ..readers.grid import pixel_size
from ..readers.roles import find_band
from ..remove import GlintModel, apply
from ..remove.noise import noise
from ..remove.predict import glint
from ..scene import FloatArray, Scene, image_bands
from ..tiles import Tile
from . import flags as bits
from .block import Block, Corrected, CorrectedTile
from .fit import Fitted
from .outputs import Outputs
from .overview import block_of, on_threads, raster_of, tile_shape_of
from .recipe import Recipe, smallest_object
from .sample import Training, sample_of

CHAIN_CELL = tiling.COMPACT
"""Side of the squares (cells) to which a chain is applied one by one [pixel]. The first cell starts at the first pixel
of the scene, however the scene is stored and read, so that the result is the same to the bit."""
STRIP = 4 << 20  # most values in a tile if the file is stored in strips: wide tiles read few strips twice
FEWEST_STEPS = 10.0  # fewer integers between dark and bright pixels show neither water nor glint
ERROR_TILES = 8  # number of tiles from which noise and errors are estimated; few, as each is corrected several times
ERROR_TILE_SIDE = 192  # side of these tiles [pixel]; a trial moves the glint by half a tile


@dataclass(frozen=True)
class Correction:
    """A function that corrects a tile of a scene, with its settings; immutable, so that threads can share it."""

    scene: Scene
    model: GlintModel
    layout: Layout  # layout of the corrected image
    chain: Chain = field(default_factory=Chain)
    area: Area | None = None  # pixels that may be corrected, if the user has given a mask
    water: WaterRule | None = None  # rule that finds these pixels if `area` is None; None: all pixels
    water_bands: tuple[int, ...] = ()  # 0-based bands that the rule uses
    changed: tuple[int, ...] = ()  # 0-based bands that the removal or the chain may change
    want_amount: bool = False
    noise: tuple[float, ...] | None = None  # standard deviation of noise of bands `changed`, if flags are requested
    want_stderr: bool = False
    replaced: tuple[ReplacedError, ...] = ()  # error variances of each band, for a chain with an opening
    left: Posterior | None = None  # stage that estimates the error of the glint that is left, if the chain has none

    @property
    def amount_bands(self) -> list[int]:
        """0-based bands in the raster of amounts: the bands that may change; if there are none, all (with zeros)."""
        return list(self.changed or range(len(self.scene.bands)))

    @property
    def halo(self) -> int:
        """Margin around a tile that is read together with the tile [pixel]."""
        return self.chain_halo + (self.water.halo if self.water else 0)

    @property
    def chain_halo(self) -> int:
        """Margin around a cell (see `CHAIN_CELL`) that the chain, the removal and standard errors need [pixel]."""
        return self.chain.halo + self.model.halo + span_halo(self.replaced) + (self.left.halo if self.left else 0)

    @property
    def by_cells(self) -> bool:
        """True if a chain is applied or standard errors are computed: both are done cell by cell (`CHAIN_CELL`)."""
        return self.chain.runs or self.want_stderr

    def __call__(self, tile: Tile) -> CorrectedTile:
        """Read a tile, correct it, and convert it to the type of the output."""
        block = self._read(tile)
        done = self._corrected(block)
        raw, negative, clipped = self._encoded(block, done)
        marked = {"saturated": self._saturated(block.own), "negative": negative, "clipped": clipped}
        flags = bits.tile_flags(block, done, **marked)
        amount = classes = None
        if self.want_amount:
            amount = (block.own[self.amount_bands] - done.physical[self.amount_bands]).astype(np.float32)
        if amount is not None and self.noise is not None:
            saturated = (flags & bits.SATURATED) > 0
            classes = bits.glint_classes(amount[: len(self.changed)], np.array(self.noise), saturated, block.where)
        return CorrectedTile(
            raw,
            bits.counted(block, done, flags, classes, **marked),
            valid=self._file_valid(block),
            flags=None if classes is None else np.stack([flags, classes]),
            amount=amount,
            stderr=self._stderr(block, done) if self.want_stderr else None,
        )

    def values(self, tile: Tile) -> tuple[FloatArray, Mask]:
        """Read and correct a tile: physical values (band, row, column), and mask (row, column) of pixels to correct."""
        block = self._read(tile)
        return self._corrected(block).physical, block.where

    def _corrected(self, block: Block) -> Corrected:
        """Correct a tile: apply the chain with its removal; if it has no stages, only subtract the predicted glint."""
        if not (self.changed and block.where.any()):
            return Corrected(block.own)
        done = Corrected(block.own) if self.chain.runs else self._without_glint(block)
        return self._after_chain(block, done) if self.by_cells else done

    def _read(self, tile: Tile) -> Block:
        """Read a tile with its halo, and determine the pixels to correct."""
        source = raster_of(self.scene)
        outer = tile.grown(self.halo, self.scene.height, self.scene.width)
        raw, valid = source.read_raw(outer.window)
        wide = source.to_physical(raw, valid)
        place = tile.within(outer)
        known = np.ones(tile.shape, np.bool_)
        if valid is not None or raw.dtype.kind not in "iu":
            for band in range(len(wide)) if self.chain.runs else self.model.index_bands:
                known &= np.isfinite(wide[place][band])
        water = self._water_in(outer, wide)
        own_valid = None if valid is None else valid[place]
        return Block(tile, outer, raw[place], own_valid, wide, water, known, known & water[place])

    def training(self, tile: Tile) -> Training:
        """Read a tile, uncorrected, as training data for a fit; all water of the tile belongs to the sample."""
        block = self._read(tile)
        return Training(tile, block.outer, block.wide, block.water, np.ones(tile.shape, np.bool_))

    def _water_in(self, tile: Tile, physical: FloatArray) -> Mask:
        """Mask (row, column) of the pixels of a tile that may be corrected; `physical` is (band, row, column)."""
        if self.area is not None:
            return self.area.read(tile.window)
        if self.water is None or self.water.all_water:
            return np.ones(tile.shape, np.bool_)
        return np.asarray(water([physical[b] for b in self.water_bands], self.water))

    def _saturated(self, physical: FloatArray) -> Mask:
        """Mask (band, row, column) of saturated pixels, False in bands without a limit; (band, 1, 1) if all lack it."""
        source = raster_of(self.scene)
        limits = np.array([b.saturation for b in self.scene.bands], np.float64)  # None becomes NaN: no value exceeds it
        if np.isnan(limits).all():
            return np.zeros((len(physical), 1, 1), np.bool_)
        # converted from file values as pixels are, so that both are rounded alike
        stored = (limits - source.info.offsets) / source.info.scales * (1 - 1e-12)
        return np.asarray(physical >= source.to_physical(stored.astype(physical.dtype)[:, None, None]))

    def _without_glint(self, block: Block) -> Corrected:
        """The tile without the glint that the model predicts."""
        changes = {f.band: block.where for f in self.model.fits}
        if not self.model.references:
            return Corrected(apply(block.own, self.model, where=block.where), changes)
        physical, crop = block.own.copy(), block.tile.crop_of(block.outer)
        found, targets = glint(block.wide, self.model, block.water, (block.outer.row0, block.outer.col0), crop)
        for band, amount in found.items():
            np.subtract(physical[band], amount, out=physical[band], where=block.where)
        return Corrected(physical, changes, targets=targets)

    def _after_chain(self, block: Block, done: Corrected) -> Corrected:
        """Apply the chain to a tile, cell by cell, and compute standard errors if they are wanted.
        If the chain has no stages, `done` is the tile after the removal, and only the standard errors are added.
        """
        removed, shape = {f.band for f in self.model.fits}, block.tile.shape
        physical = done.physical.copy() if self.chain.runs else done.physical  # the chain's cells are written into it
        replaced, errors = np.zeros(physical.shape, np.bool_), np.zeros(physical.shape, np.float32)
        targets = np.zeros(shape, np.bool_) if done.targets is None else done.targets.copy()
        changes = {band: np.zeros(shape, np.bool_) for band in self.changed if self.chain.runs}
        for cell in block.tile.split(CHAIN_CELL):
            within = cell.within(block.tile)
            where = block.where[within]
            if not where.any():
                continue
            wide = cell.grown(self.chain_halo, self.scene.height, self.scene.width)
            around, core = wide.within(block.outer), cell.within(wide)
            state = State.of(block.wide[around], block.water[around], (wide.row0, wide.col0))
            state = apply_chain(replace(state, errors=self.want_stderr), self.chain, self.model)
            if self.want_stderr:
                left = self.left.apply(state) if self.left else state
                errors[within] = compensate.stderr(left, self.model, self.replaced)[core]
            if state.targets is not None:
                targets[within] = (state.targets[core] > 0).any(axis=0) & where
            clean = with_targets(state)[core]
            for band, place in changes.items():
                if state.replaced is not None:
                    replaced[within][band] = state.replaced[core][band] & where
                place[within] = where if band in removed else replaced[within][band] | targets[within]
                np.copyto(physical[within][band], clean[band], where=place[within])
        changes = done.changes | {band: place for band, place in changes.items() if place.any()}
        return Corrected(physical, changes, replaced, targets, errors)

    def _stderr(self, block: Block, done: Corrected) -> Float32:
        """Standard errors of the bands that may change, (band, row, column); NaN where nothing was corrected."""
        out = np.zeros(done.physical.shape, np.float32) if done.errors is None else done.errors
        if np.dtype(self.layout.dtype).kind in "iu":  # add the variance of rounding to integers
            steps = np.array(raster_of(self.scene).info.scales, np.float32)
            out = np.sqrt(out**2 + (steps**2 / 12)[:, None, None])
        known = np.isfinite(done.physical) & block.where & bool(done.changes)
        return np.where(known, out, np.nan)[list(self.changed)].astype(np.float32)

    def _encoded(self, block: Block, done: Corrected) -> tuple[Raw, Mask, Mask]:
        """File values of the output, mask of negative values and mask of clipped values, each (band, row, column)."""
        info, layout = raster_of(self.scene).info, self.layout
        raw, clipped = relaid(np.ascontiguousarray(block.raw), block.valid, info.nodatas, layout.dtype, layout.nodata)
        negative = np.zeros(raw.shape, np.bool_)
        for band, place in done.changes.items():
            nodata = info.nodatas[band] if layout.nodata is None else layout.nodata
            negative[band], outside = encode(
                done.physical[band],
                raw[band],
                where=place,
                nodata=nodata,
                scale=info.scales[band],
                offset=info.offsets[band],
            )
            np.copyto(clipped[band], outside, where=place)
        return raw, negative, clipped

    def _file_valid(self, block: Block) -> Mask | None:
        """Mask (row, column) of pixels that are valid in every band; None if the output has no mask."""
        if not self.layout.masked:
            return None
        found = np.ones(block.tile.shape, np.bool_) if block.valid is None else np.asarray(block.valid.all(axis=0))
        if block.raw.dtype.kind == "f" and np.dtype(self.layout.dtype).kind != "f":
            found = found & is_finite(block.raw).all(axis=0)
        return found


def correction(
    scene: Scene,
    fitted: Fitted,
    *,
    mask: str | None = None,
    targets: Outputs | None = None,
    dtype: str | None = None,
    threads: int = 1,
) -> Correction:
    """Make the `Correction` of a scene from the model, the chain and the water rule in `fitted`.

    `mask` and `dtype` replace the mask of the recipe and the data type of the scene. Noise and standard errors that the
    outputs `targets` need are estimated on `threads` threads.
    Raises the errors of `open_area` and, for standard errors, of `_with_stderr`; InputError if the scene lacks a band
    of the recipe; ReadError if tiles cannot be read.
    """
    wanted = fitted.recipe.mask if mask is None else Recipe(mask=mask).mask
    area = None if wanted in ("auto", "none") else open_area(wanted, scene, "--mask")
    layout = bits.image_layout(scene, dtype, targets.options if targets else {})
    _check_type(scene, layout)
    model, chain = fitted.model, fitted.chain
    every = image_bands(scene.bands, model.index_bands) if chain.replaces else sorted(f.band for f in model.fits)
    wanted_bands = {find_band(scene, b) for b in fitted.recipe.bands}
    changed = [b for b in every if b in wanted_bands or not wanted_bands]
    rule, wants = fitted.water if wanted == "auto" else None, bool(targets and (targets.flags or targets.amount))
    work = Correction(scene, model, layout, chain, area, rule, fitted.water_bands, tuple(changed), want_amount=wants)
    if targets and targets.flags:
        work = _with_noise(work, threads)
    if targets and targets.stderr:
        work = _with_stderr(work, threads)
    return replace(work, layout=replace(layout, tile=_tile_shape(work)))


def _check_type(scene: Scene, layout: Layout) -> None:
    """Raise InputError if an integer type of the output can hold almost none of the values in a few tiles of a scene,
    or if rounding leaves almost nothing of them (such as of reflectance from 0 to 1).
    """
    source, out = raster_of(scene), np.dtype(layout.dtype)
    if out.kind == "f" or out == source.info.dtype:
        return
    parts = [source.read_raw(tile.window) for tile in _tiles_of(scene)]
    known = [raw[is_finite(raw) & (True if valid is None else valid)] for raw, valid in parts]
    if not (values := np.concatenate(known)).size:
        return
    low, high = np.percentile(values, [1, 99])
    outside = low > np.iinfo(out).max or high < np.iinfo(out).min
    if outside or (source.info.dtype.kind == "f" and high - low < FEWEST_STEPS):
        said = f"holds numbers from {low:.3g} to {high:.3g}, and {out} would keep almost nothing of them"
        raise InputError(f"{scene.path} {said}. Leave out --dtype, or multiply the image first.")


def _tile_shape(work: Correction) -> tuple[int, int]:
    """Rows and columns of the tiles in which a scene is corrected; whole cells (`CHAIN_CELL`) if `by_cells` is True."""
    scene, bands = work.scene, len(work.scene.bands)
    shape = tile_shape_of(scene)
    if work.by_cells:
        cells = max(STRIP // (CHAIN_CELL * bands) // CHAIN_CELL, 1) if shape[1] >= scene.width else 1
        return CHAIN_CELL, cells * CHAIN_CELL
    if work.halo:
        return tiling.compact(shape, block_of(scene), bands, work.halo)
    return shape


def _with_stderr(work: Correction, threads: int) -> Correction:
    """Copy of `work` that also computes standard errors. Raises InputError if no band is corrected, or if the stages of
    the chain allow no standard errors; FitError if the tiles that are read have no pixel to correct.
    """
    if not work.changed:
        raise InputError("no band is corrected, so it has no standard error: leave out --stderr, or name --method.")
    names = [stage.name for stage in work.chain.before]
    opens = "identify-level" in names and any(compensate.STAGES[n].replaces in ("glint", "level") for n in names)
    if work.chain.replaces and not opens:
        raise InputError("--stderr needs identify-level and replace-level before remove, or --compensate off.")
    every = sample_of(list(on_threads(_tiles_of(work.scene), work.training, threads)))
    chosen = [part for part in zip(every.states, every.inside, strict=True) if part[1].any()]
    if not chosen:
        raise FitError("no pixel is corrected in the sample tiles: leave out --stderr.")
    before = Sample(*map(tuple, zip(*chosen, strict=True)))
    run = partial(apply_chain, chain=work.chain, model=work.model)
    after = replace(before, states=tuple(map(run, before.states)))
    if opens:
        errors = compensate.fit_replaced(before, after, _objects(work, after), run)
        return replace(work, want_stderr=True, replaced=errors)
    if any(isinstance(stage, Posterior) and stage.resolved for stage in work.chain.after):
        return replace(work, want_stderr=True)
    left = compensate.fit_removed(after, Setting(work.scene.bands, tuple(work.model.index_bands) or (0,)), work.model)
    return replace(work, want_stderr=True, left=left)


def _objects(work: Correction, after: Sample) -> list[npt.NDArray[np.float32]]:
    """For each block of the compensated sample `after`, an image of discs (band, row, column) to add to it. Discs are
    as wide as the smallest object that is kept by default, at most `LARGEST_DISC`; but not narrower than the smallest
    object that the morphological opening in the chain keeps.
    """
    window = next(s.size for s in work.chain.before if isinstance(s, compensate.Background))
    width = max(min(smallest_object(None, pixel_size(work.scene)), LARGEST_DISC), window / OF_OBJECT)
    bands = work.scene.bands
    level = np.array([np.median(after.values([s.image[b] for s in after.states])) for b in range(len(bands))], "f4")
    return [discs(m, bands, level, width, n) for n, m in enumerate(after.inside)]


def _with_noise(work: Correction, threads: int) -> Correction:
    """Copy of `work` with the field `noise`, estimated from corrected pixels; rounding to integers is included."""
    done, inside = zip(*on_threads(_tiles_of(work.scene), work.values, threads), strict=True)
    steps = np.array(raster_of(work.scene).info.scales) * (np.dtype(work.layout.dtype).kind in "iu")
    own = []
    for band in work.changed:  # noise is estimated from 3 x 3 pixels
        known = [i & eroded(np.isfinite(p[band]), 3) for p, i in zip(done, inside, strict=True)]
        own.append(noise([np.nan_to_num(p[band]) for p in done], known))
    return replace(work, noise=tuple(np.hypot(own, steps[list(work.changed)] / 12**0.5).tolist()))


def _tiles_of(scene: Scene) -> list[Tile]:
    """Tiles of a scene from which noise and standard errors are estimated."""
    every = tiling.tiles(scene.height, scene.width, (ERROR_TILE_SIDE, ERROR_TILE_SIDE))
    return tiling.spread(every, ERROR_TILES * ERROR_TILE_SIDE**2)
