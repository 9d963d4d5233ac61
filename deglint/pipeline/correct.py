"""Correct one tile: valid pixels, water, the correction itself, flags and counts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..compensate import Chain, Posterior, ReplacedError, State, apply_chain, stderr, with_targets
from ..compensate.uncertainty import halo as span_halo
from ..masks import WaterRule, water
from ..raster.encode import encode, relaid
from ..raster.output import Layout
from ..readers.areas import Area
from ..remove import GlintModel, apply
from ..remove.predict import glint
from ..scene import Scene
from ..tiles import Tile
from . import flags as bits
from .outputs import PixelCounts
from .overview import raster_of

CHAIN_CELL = tiling.COMPACT
"""Side of the cells to which a chain is applied, counted from the first pixel of the scene [pixel]. The cells do not
depend on how the scene is stored and read, so the result is the same to the bit."""
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Corrected:
    """One corrected tile."""

    raw: npt.NDArray[Any]
    tally: PixelCounts
    valid: Mask | None = None
    flags: npt.NDArray[np.uint8] | None = None
    amount: npt.NDArray[np.float32] | None = None
    stderr: npt.NDArray[np.float32] | None = None


@dataclass(eq=False)
class _Block:
    """A tile as read, with the halo that the correction needs, and the results so far."""

    tile: Tile
    outer: Tile
    raw: Any
    valid: Any
    wide: Any  # physical values, with the pixels around
    water: Mask | None  # where it may be corrected, with the pixels around; None: everywhere
    known: Mask  # where the tile is valid
    where: Mask  # where it is to be corrected: valid water
    removed: list[int] = field(default_factory=list)  # bands that are corrected there
    rewritten: dict[int, Mask] = field(default_factory=dict)  # bands without a removal, where the chain changed them
    replaced: Mask | None = None  # (band, row, column), with a chain
    targets: Mask | None = None
    errors: Any = None  # (band, row, column) standard errors, with a chain

    @property
    def own(self) -> Any:
        """Physical values of the tile."""
        return self.wide[self.tile.within(self.outer)]

    @property
    def part(self) -> Mask | None:
        """Pixels to correct; None for all, as numpy and OpenCV then need no mask."""
        return None if self.where.all() else self.where

    @property
    def corrected(self) -> bool:
        """Whether any band was changed."""
        return bool(self.removed or self.rewritten)


@dataclass(frozen=True)
class Correction:
    """The correction of a scene as a function of the tile; immutable, shared by the threads."""

    scene: Scene
    model: GlintModel
    layout: Layout
    chain: Chain = field(default_factory=Chain)
    area: Area | None = None
    water: WaterRule | None = None
    water_bands: tuple[int, ...] = ()
    only: tuple[int, ...] = ()
    want_flags: bool = False
    want_amount: bool = False
    noise: tuple[float, ...] = ()  # of the bands that may change, for the classes of sun glint
    want_stderr: bool = False
    replaced: tuple[ReplacedError, ...] = ()  # errors of pixels that an opening has replaced, and of the others
    left: Posterior | None = None  # of what a removal alone leaves

    @property
    def changed(self) -> list[int]:
        """0-based bands that may change: those of the removal, and those in which a chain replaces glint."""
        if not self.chain.replaces:
            return sorted({f.band for f in self.model.fits})
        return sorted(self.only or range(len(self.scene.bands)))

    @property
    def amount_bands(self) -> list[int]:
        """0-based bands in the raster of amounts: those that may change, or all, with zeros, if there are none."""
        return self.changed or list(range(len(self.scene.bands)))

    @property
    def halo(self) -> int:
        """Pixels around a tile that are read with it."""
        return self.chain_halo + (self.water.halo if self.water and self.area is None else 0)

    @property
    def chain_halo(self) -> int:
        """Pixels around a cell that the chain and the removal need."""
        return self.chain.halo + self.model.halo + span_halo(self.replaced) + (self.left.halo if self.left else 0)

    @property
    def by_cells(self) -> bool:
        """Whether the tile is computed in cells of the scene."""
        return self.chain.runs or self.want_stderr

    def __call__(self, tile: Tile) -> Corrected:
        """Read a tile, correct it, and convert it to the output's type."""
        if not (self.changed or self.want_flags or self.want_amount):
            return self._copied(tile)
        block = self._read(tile)
        wanted = self.amount_bands if self.want_amount else self.changed
        before = block.own[wanted] if self.want_flags or self.want_amount else None
        saturated = self._saturated(block.own)
        full = np.asarray(saturated.any(axis=0))
        physical = self._corrected(block)
        flags = self._flags(block, full)
        tally = _counted(block, flags, saturated)
        error = self._stderr(block, physical) if self.want_stderr else None
        out = self._encoded(block, physical, flags if self.want_flags else None, tally)
        valid = self._file_valid(block.raw, block.valid)
        done = Corrected(out, tally, valid, stderr=error)
        if before is None:
            return done
        amount = np.subtract(before, physical[wanted], dtype=np.float32)
        if self.want_flags:
            classes = bits.glint_classes(amount[: len(self.changed)], np.array(self.noise), full, block.where)
            tally.glint = np.bincount(classes.ravel(), minlength=len(bits.GLINT_CLASSES))
            done = replace(done, flags=np.stack([flags, classes]))
        return replace(done, amount=amount) if self.want_amount else done

    def corrected(self, tile: Tile) -> tuple[npt.NDArray[Any], Mask]:
        """Read a tile and correct it; return physical values of all bands, and the mask of pixels to correct."""
        block = self._read(tile)
        return self._corrected(block), block.where

    def _corrected(self, block: _Block) -> npt.NDArray[Any]:
        """Physical values of the tile after the correction; the block records which bands and pixels changed."""
        physical = np.ascontiguousarray(block.own)
        if not physical.flags.writeable or np.shares_memory(physical, block.raw):
            physical = physical.copy()
        if self.changed and block.where.any():
            if self.chain.runs:
                self._compensate(block, physical)
            else:
                self._remove(block, physical)
        return physical

    def _copied(self, tile: Tile) -> Corrected:
        """A tile in which no band may change, in the output's type."""
        raw, valid = raster_of(self.scene).read_raw(tile.window)
        file_valid = self._file_valid(raw, valid)
        raw, lost = relaid(raw, valid, self.layout.info.nodatas, self.layout.dtype, self.layout.nodata)
        clipped = 0 if lost is None else np.count_nonzero(lost, axis=(1, 2))
        return Corrected(raw, PixelCounts(total=tile.pixels, copied=1, clipped=clipped), file_valid)

    def _read(self, tile: Tile) -> _Block:
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
        water_there = self.water_in(outer, wide)
        where = known if water_there is None else known & water_there[place]
        own_valid = None if valid is None else valid[place]
        return _Block(tile, outer, raw[place], own_valid, wide, water_there, known, where)

    def water_in(self, tile: Tile, physical: Any) -> Mask | None:
        """Pixels of a tile that may be corrected, from its physical values; None for all."""
        if self.area is not None:
            return self.area.read(tile.window)
        if self.water is None or self.water.all_water:
            return None
        return np.asarray(water([physical[b] for b in self.water_bands], self.water))

    def _saturated(self, physical: Any) -> npt.NDArray[np.bool_]:
        """Mask of saturated pixels, (band, row, column); False for bands without a known saturation."""
        limits = [(i, b.saturation) for i, b in enumerate(self.scene.bands) if b.saturation is not None]
        out = np.zeros(physical.shape if limits else (len(physical), 1, 1), np.bool_)
        for i, limit in limits:
            limit = float(physical.dtype.type(limit))  # as a saturated value is rounded
            np.greater_equal(physical[i], limit, out=out[i])
        return out

    def _remove(self, block: _Block, physical: Any) -> None:
        """Subtract the glint that the model predicts from `physical`."""
        if self.model.references:
            origin, crop = (block.outer.row0, block.outer.col0), block.tile.crop_of(block.outer)
            water = np.ones(block.outer.shape, np.bool_) if block.water is None else block.water
            found, block.targets = glint(block.wide, self.model, water, origin, crop)
            part = True if block.part is None else block.part
            for band, amount in found.items():
                np.subtract(physical[band], amount, out=physical[band], where=part)
        else:
            apply(physical, self.model, where=block.part, out=physical)
        block.removed = [f.band for f in self.model.fits]

    def _compensate(self, block: _Block, physical: Any) -> None:
        """Apply the chain cell by cell, and store the result in `physical`."""
        removed = {f.band for f in self.model.fits}
        block.replaced = np.zeros(physical.shape, np.bool_)
        block.errors = np.zeros(physical.shape if self.want_stderr else 0, np.float32)
        block.targets = np.zeros(physical.shape[1:], np.bool_)
        for state, core, within in self._states(block):
            where = block.where[within]
            clean = with_targets(state)[core]
            if self.want_stderr:
                block.errors[within] = self._stderr_of(state)[core]
            if state.replaced is not None:
                block.replaced[within] = state.replaced[core] & where
            if state.targets is not None:
                block.targets[within] = (state.targets[core] > 0).any(axis=0) & where
            for band in self.changed:
                place = where if band in removed else block.replaced[within][band] | block.targets[within]
                np.copyto(physical[within][band], clean[band], where=place, casting="same_kind")
        block.removed = sorted(removed & set(self.changed))
        rewritten = {b: block.replaced[b] | block.targets for b in self.changed if b not in removed}
        block.rewritten = {band: place for band, place in rewritten.items() if place.any()}

    def _states(self, block: _Block) -> Iterator[tuple[State, Any, Any]]:
        """The state of each cell with its halo after the chain; the slices of the cell in it, and in the tile."""
        tile, outer = block.tile, block.outer
        for cell in tile.split(CHAIN_CELL):
            within = cell.within(tile)
            if not block.where[within].any():
                continue
            wide = cell.grown(self.chain_halo, self.scene.height, self.scene.width)
            around = wide.within(outer)
            water = None if block.water is None else block.water[around]
            state = State.of(block.wide[around], water, (cell.row0, cell.col0))
            yield apply_chain(state, self.chain, self.model), cell.within(wide), within

    def _stderr(self, block: _Block, physical: Any) -> npt.NDArray[np.float32]:
        """Standard errors of the bands that may change; NaN where nothing was corrected."""
        out = block.errors
        if out is None:
            out = np.zeros(physical.shape, np.float32)
            for state, core, within in self._states(block):
                out[within] = self._stderr_of(state)[core]
        if np.dtype(self.layout.dtype).kind in "iu":  # rounded to integers of the file
            steps = np.array(raster_of(self.scene).info.scales, np.float32)
            out = np.sqrt(out**2 + (steps**2 / 12)[:, None, None])
        known = np.isfinite(physical) & block.where & block.corrected
        return np.where(known, out, np.nan)[self.changed].astype(np.float32)

    def _stderr_of(self, state: State) -> npt.NDArray[np.float32]:
        """Standard errors of all bands of a block after the chain."""
        return stderr(self.left.apply(state) if self.left else state, self.model, self.replaced)

    def _flags(self, block: _Block, saturated: Mask) -> npt.NDArray[np.uint8]:
        """Flags of a tile, without those that `encode` sets."""
        flags = np.full(block.tile.shape, bits.NOT_WATER, np.uint8)
        flags[block.where] = bits.CORRECTED if block.corrected else 0
        if block.replaced is not None:
            flags[block.replaced.any(axis=0) & block.where] |= bits.REPLACED
        if block.targets is not None:
            flags[block.targets & block.where] |= bits.PROTECTED
        flags[~block.known] = bits.NODATA
        flags |= np.where(saturated, np.uint8(bits.SATURATED), np.uint8(0))
        return flags

    def _encoded(self, block: _Block, physical: Any, flags: Any, tally: PixelCounts) -> npt.NDArray[Any]:
        """The tile in the output's type; negative and clipped values are counted."""
        info = raster_of(self.scene).info
        raw = np.ascontiguousarray(block.raw)
        raw = raw if raw.flags.writeable and raw is not block.wide else raw.copy()
        raw, lost = relaid(raw, block.valid, self.layout.info.nodatas, self.layout.dtype, self.layout.nodata)
        changes: list[tuple[list[int], Mask | None]] = [(block.removed, block.part)] if block.removed else []
        changes += [([band], place) for band, place in block.rewritten.items()]
        for bands, place in changes:
            negative, clipped = encode(
                physical, raw, bands=bands, scales=info.scales, offsets=info.offsets, where=place,
                nodata=self.layout.nodata,
            )  # fmt: skip
            counts = np.zeros((2, len(raw)), np.int64)
            counts[:, bands] = np.count_nonzero([negative, clipped], axis=(2, 3))
            tally.negative, tally.clipped = tally.negative + counts[0], tally.clipped + counts[1]
            if flags is not None:
                flags[negative.any(axis=0)] |= bits.NEGATIVE
                flags[clipped.any(axis=0)] |= bits.CLIPPED
            if lost is not None:
                lost[bands] &= False if place is None else ~place
        if lost is not None:
            tally.clipped = tally.clipped + np.count_nonzero(lost, axis=(1, 2))
            if flags is not None:
                flags[lost.any(axis=0)] |= bits.CLIPPED
        return raw

    def _file_valid(self, raw: Any, valid: Any) -> Mask | None:
        """The output's mask for the tile, if it has one: valid in every band."""
        if not self.layout.masked:
            return None
        found = np.ones(raw.shape[1:], np.bool_) if valid is None else np.asarray(valid.all(axis=0))
        if raw.dtype.kind == "f" and np.dtype(self.layout.dtype).kind != "f":
            found = found & np.isfinite(raw).all(axis=0)
        return found


def _counted(block: _Block, flags: npt.NDArray[np.uint8], saturated: npt.NDArray[np.bool_]) -> PixelCounts:
    """Count the pixels of a tile by their flags."""
    kinds = {"nodata": bits.NODATA, "not_water": bits.NOT_WATER, "corrected": bits.CORRECTED,
             "protected": bits.PROTECTED}  # fmt: skip
    counts: dict[str, Any] = {name: int(np.count_nonzero(flags & bit)) for name, bit in kinds.items()}
    if block.replaced is not None:
        counts["replaced"] = np.count_nonzero(block.replaced, axis=(1, 2))
    counts["rewritten"] = np.zeros(len(saturated), np.int64)
    for band, place in block.rewritten.items():
        counts["rewritten"][band] = np.count_nonzero(place)
    return PixelCounts(total=block.tile.pixels, saturated=saturated.sum(axis=(1, 2)), **counts)
