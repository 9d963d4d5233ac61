"""Correct one tile: what is valid, what is water, the correction itself, and what became of every pixel."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..compensate import Chain, State, apply_stages, finish
from ..compensate.evidence import REACH, grown
from ..compensate.faint import SKIRT
from ..compensate.presence import Cells, blend
from ..compensate.protect import Things, lifted, put, things
from ..compensate.sharpen import all_finite
from ..compensate.uncertainty import REACH as LEVEL_REACH
from ..compensate.uncertainty import Parts, Uncertainty, stderr
from ..masks import WaterRule, near_water, water
from ..raster.convert import all_clear, ends
from ..raster.encode import encode, relaid
from ..raster.output import Layout
from ..readers.areas import Area
from ..remove import GlintModel, apply
from ..remove.model import removed
from ..remove.predict import glint
from ..scene import Scene
from ..tiles import Tile
from .compensated import Begun, Compensated, Shown, changed_bands, shown_in
from .look import core_of, place_in, raster_of
from .tally import Saturated, Tally, largest_in, saturated_in

FLAGS = {
    1: "nodata: not valid, copied",
    2: "not water, or outside the mask: copied",
    4: "corrected",
    8: "negative after correction, in some band",
    16: "saturated before correction, in some band",
    32: "clipped to the output's integer range (less the number for nodata), in some band",
    64: "replaced: glint of one instant, in some band, by the water beside it",
    128: "protected: stands out in a way that glint does not, and kept as it was",
}
"""Bits of the flag raster."""
BESIDE = 32
"""Pixels from a pixel that is as dark as water within which compensation may find more water under sparkle."""
NODATA, NOT_WATER, CORRECTED, NEGATIVE, SATURATED, CLIPPED, REPLACED, PROTECTED = FLAGS


@dataclass(frozen=True, eq=False)
class Corrected:
    """One corrected tile."""

    raw: npt.NDArray[Any]
    tally: Tally
    valid: npt.NDArray[np.bool_] | None = None
    flags: npt.NDArray[np.uint8] | None = None
    amount: npt.NDArray[np.float32] | None = None
    stderr: npt.NDArray[np.float32] | None = None
    parts: Parts | None = None


@dataclass(frozen=True, eq=False)
class _Read:
    """A tile before it is corrected."""

    raw: Any  # None where compensation has rewritten all of it, and it was let go
    valid: Any
    physical: Any  # None where compensation has all that is wanted of it
    saturated: Saturated
    after: Compensated | None
    known: npt.NDArray[np.bool_] | None
    where: npt.NDArray[np.bool_] | None
    tally: Tally
    glint: dict[int, Any]  # by band, where the removal looks at neighbours
    exceeds: npt.NDArray[np.bool_] | None  # water whose reference exceeds its surroundings by more than glint does


@dataclass(frozen=True)
class Correction:
    """All that correcting a tile needs, as a function of the tile; shared by the threads, never changed."""

    scene: Scene
    model: GlintModel
    want_flags: bool
    want_amount: bool
    layout: Layout
    area: Area | None
    water: WaterRule | None
    water_bands: tuple[int, ...]
    chain: Chain = field(default_factory=Chain)
    only: tuple[int, ...] = ()
    want_stderr: bool = False
    uncertainty: Uncertainty | None = None

    @property
    def changed(self) -> list[int]:
        """0-based bands that may change."""
        return changed_bands(self.scene, self.model, self.chain, self.only)

    @property
    def told(self) -> list[int]:
        """0-based bands of which the amount is told: those that may change, or all, with zeros, where none may."""
        return self.changed or list(range(len(self.scene.bands)))

    @property
    def reach(self) -> int:
        """Pixels around a tile that may be looked at."""
        return self._halo

    def on(self, scene: Scene) -> Correction:
        """The same for another source of the scene's pixels."""
        return replace(self, scene=scene)

    def __call__(self, tile: Tile) -> Corrected:
        """Read a tile, correct it, and bring it into the output's type."""
        if self.copies:
            return self._copied(tile)
        read = self._read(tile, self.want_amount or self.want_stderr)
        raw, valid, physical, where, known = read.raw, read.valid, read.physical, read.where, read.known
        tally, source = read.tally, raster_of(self.scene)
        flags = self._flags(known, where, tile.shape) if self.want_flags else None
        tally.saturated = read.saturated.counts
        if flags is not None and read.saturated.any_band is not None:
            flags[read.saturated.any_band] |= SATURATED
        before = physical[self.told].copy() if self.want_amount else None
        whole = physical.astype(np.float32) if self.want_stderr else None
        corrected = physical if read.after is None else read.after.clean
        least = self._least(corrected, raw, read)
        finite = least is not None and bool(np.isfinite(least).all())
        if raw is None:
            raw = corrected if finite else source.read_raw(tile.window)[0]
        file_valid = self._file_valid(raw, valid)
        raw, lost = relaid(raw, valid, self.layout.info.nodatas, self.layout.dtype, self.layout.nodata)
        if where is None and finite and raw.dtype == np.float32:
            raw = corrected
        for bands, place in self._work(read, flags):
            counts = encode(
                corrected, raw, bands=bands, scales=source.info.scales, offsets=source.info.offsets,
                where=place, nodata=self.layout.nodata, flags=flags, marks=(NEGATIVE, CLIPPED), least=least,
                compiled=self.chain.runs,
            )  # fmt: skip
            tally.negative, tally.clipped = tally.negative + counts.negative, tally.clipped + counts.clipped
            if lost is not None:
                lost[bands] &= False if place is None else ~place
        if lost is not None:
            tally.clipped = tally.clipped + np.count_nonzero(lost, axis=(1, 2))
            if flags is not None:
                flags[lost.any(axis=0)] |= CLIPPED
        amount = None if before is None else np.subtract(before, physical[self.told], dtype=np.float32)
        parts = None if whole is None else self._parts(whole, physical, where, read.after)
        if parts is None or self.uncertainty is None:
            return Corrected(raw, tally, file_valid, flags, amount, None, parts)
        error = stderr(parts, self.uncertainty, steps=self._steps)
        return Corrected(raw, tally, file_valid, flags, amount, error)

    def _least(self, corrected: Any, raw: Any, read: _Read) -> npt.NDArray[np.float64] | None:
        """The least number of each band, NaN where some is not finite, if what compensation has made of a tile can be
        written as it is where all are: elsewhere it is the input's own, to the bit. Else None."""
        whole = read.after is not None and read.valid is None and corrected.dtype == np.float32
        if not (whole and self._plain and (raw is None or raw.dtype == np.float32)):
            return None
        found = ends(corrected)
        return np.where(np.isfinite(found).all(axis=1), found[:, 0], np.nan)

    @property
    def _plain(self) -> bool:
        """Numbers in the file are physical values, and every band may change."""
        info = raster_of(self.scene).info
        return set(info.scales) == {1.0} and set(info.offsets) == {0.0} and len(self.changed) == len(self.scene.bands)

    @property
    def _rewrites(self) -> bool:
        """What compensation makes of a tile that is water everywhere is all that is written of it."""
        return self._plain and not self.layout.masked and self.layout.nodata is None and self.layout.dtype == "float32"

    @property
    def copies(self) -> bool:
        """No band may change and nothing is to be said of single pixels: nothing is looked at either."""
        return not self.changed and not (self.want_flags or self.want_amount)

    def _copied(self, tile: Tile) -> Corrected:
        """A tile as it is, in the output's type."""
        raw, valid = raster_of(self.scene).read_raw(tile.window)
        file_valid = self._file_valid(raw, valid)
        raw, lost = relaid(raw, valid, self.layout.info.nodatas, self.layout.dtype, self.layout.nodata)
        tally = Tally(len(self.scene.bands), total=tile.shape[0] * tile.shape[1], copied=True)
        if lost is not None:
            tally.clipped = np.count_nonzero(lost, axis=(1, 2))
        return Corrected(raw, tally, file_valid)

    def _parts(self, before: Any, physical: Any, where: Any, after: Compensated | None) -> Parts:
        """What the standard error of the tile is told by."""
        place = np.ones(before.shape[1:], np.bool_) if where is None else where
        clean = np.asarray(physical, np.float32)
        if after is None:
            return Parts(before, clean, place)
        kept = None if after.held is None else grown(after.held, REACH)
        return Parts(before, clean, place, after.replaced, kept, after.level, after.removed_level, after.inner)

    @property
    def _steps(self) -> tuple[float, ...]:
        """Of the output's whole numbers, as physical values; none where it has fractions."""
        whole = np.dtype(self.layout.dtype).kind in "iu"
        return tuple(abs(s) for s in raster_of(self.scene).info.scales) if whole else ()

    def physical(self, tile: Tile) -> npt.NDArray[Any]:
        """Read a tile and correct it: physical values of all bands."""
        read = self._read(tile, True)
        self._work(read, None)
        return read.physical

    def _read(self, tile: Tile, keep: bool) -> _Read:
        """A tile as it is, what compensation makes of it, and where it is to be corrected.

        keep : physical values are wanted where compensation has changed them, too
        """
        source = raster_of(self.scene)
        outer = tile.grown(self._halo, self.scene.height, self.scene.width)
        raw, valid = source.read_raw(outer.window)
        found = ends(raw) if valid is None and raw.dtype.kind == "f" else None
        clear = found is not None and all_clear(found)
        physical: Any = source.to_physical(raw, valid, clear=clear)
        if physical is not raw:
            clear, found = False, None
        largest = largest_in(self.scene, raw, valid) if found is None else found[:, 1]
        after, exceeds, predicted = None, None, dict[int, Any]()
        if self.chain.runs:
            place = (slice(None), *core_of(tile.crop_of(outer), outer.shape))
            sound = valid is None and (raw.dtype.kind in "iu" or clear or all_finite(physical))
            known = None if sound else self._known(physical[place], None if valid is None else valid[place])
            saturated = saturated_in(self.scene, physical[place], self.want_flags, largest)
            near = self._near(physical, known, tile, outer)
            begun = self._begun(physical, tile, outer, sound) if near is None or near.any() else None
            valid = None if valid is None else valid[place]
            ours = begun is not None and physical is raw and raw.flags.writeable  # and is let go with the tile
            own: Any = raw[place] if ours else raw[place].copy()
            physical = physical[place].copy() if keep else None
            del raw  # the block around is let go
            if begun is not None:
                begun.own, begun.alone = own, ours and sound and near is None and self._rewrites
                del own
                after = self._compensated(begun, tile, outer)
                own = begun.own
            inside = near if after is None or after.inside is None else after.inside & (True if near is None else near)
        else:
            place = (slice(None), *core_of(tile.crop_of(outer), outer.shape))
            around = self._water_in(outer, physical)
            if self.model.halo:
                everywhere = np.ones(outer.shape, np.bool_) if around is None else around
                origin = outer.row0, outer.col0
                predicted, exceeds = glint(physical, self.model, everywhere, origin, tile.crop_of(outer))
            inside = None if around is None else around[place[1:]]
            if outer != tile:
                same = clear and physical is raw  # then the tile is corrected where it stands
                own, valid = np.ascontiguousarray(raw[place]), None if valid is None else valid[place]
                physical = own if same else np.ascontiguousarray(physical[place])
            else:
                own = raw
            known = None if clear else self._known(physical, valid)
            saturated = saturated_in(self.scene, physical, self.want_flags, largest)
        where = known if inside is None else inside if known is None else known & inside
        tally = Tally(len(self.scene.bands), total=tile.shape[0] * tile.shape[1])
        tally.usable = tally.total if where is None else int(np.count_nonzero(where))
        tally.nodata = 0 if known is None else tally.total - int(np.count_nonzero(known))
        tally.passed = tally.total if self.chain.runs and after is None else 0
        tally.not_water = tally.total - tally.usable - tally.nodata
        if physical is not None and not physical.flags.writeable:
            physical = physical.copy()
        where = None if tally.usable == tally.total else where
        return _Read(own, valid, physical, saturated, after, known, where, tally, predicted, exceeds)

    def _work(self, read: _Read, flags: Any) -> list[tuple[list[int], Any]]:
        """Correct `read.physical`, where there is one; which bands changed, and where (None: everywhere)."""
        removed, physical, after, where, tally = self.changed, read.physical, read.after, read.where, read.tally
        if not tally.usable or not (removed or after):
            return []
        if after is None:
            if read.glint:
                self._subtract(read, flags)
            else:
                apply(physical, self.model, where=where, out=physical)
            tally.corrected = tally.usable
            return [(removed, where)]
        done = self._done(after, where, tally, flags)
        for bands, place in done if physical is not None else ():
            for band in bands:
                np.copyto(
                    physical[band], after.clean[band], where=True if place is None else place, casting="same_kind"
                )
        return done

    def _done(self, after: Compensated, where: Any, tally: Tally, flags: Any) -> list[tuple[list[int], Any]]:
        """Which bands compensation and removal changed, and where (None: everywhere); counted and flagged."""
        removed = [f.band for f in self.model.fits]
        changed, replaced = self.changed, after.replaced
        others = [b for b in range(len(replaced)) if b not in changed]
        if where is not None or others:
            replaced = replaced & (True if where is None else where)
            replaced[others] = False
        calm = None if after.share is None else after.share == 0
        any_band = np.empty(0, np.bool_) if removed and flags is None and calm is None else replaced.any(axis=0)
        if calm is not None:
            calm &= ~any_band if where is None else ~any_band & where
            tally.calm = int(np.count_nonzero(calm))
        held = after.held if after.held is None or where is None else after.held & where
        tally.protected = 0 if held is None else int(np.count_nonzero(held))
        tally.replaced = np.array([np.count_nonzero(band) for band in replaced])
        tally.corrected = tally.usable - tally.calm if removed else int(np.count_nonzero(any_band))
        if flags is not None:
            flags[any_band] |= REPLACED
            if held is not None:
                flags[held] |= PROTECTED
            as_it_was = calm if removed else ~any_band
            if as_it_was is not None:
                flags[as_it_was] &= np.uint8(0xFF ^ CORRECTED)
        removed = [b for b in removed if b in changed]
        done: list[tuple[list[int], Any]] = [(removed, where)] if removed else []
        alone = [b for b in changed if b not in removed]
        beside = grown(held, REACH) if alone and held is not None and held.any() else None
        touched = ((b, replaced[b] if beside is None else replaced[b] | beside) for b in alone)
        rewritten = [(b, place) for b, place in touched if place.any()]
        for band, place in rewritten:
            tally.rewritten[band] = np.count_nonzero(place)
        return done + [([b], place) for b, place in rewritten]

    def _subtract(self, read: _Read, flags: Any) -> None:
        """Take the predicted glint off the tile; ships and surf, that lose that of the water around, are flagged."""
        for band, amount in read.glint.items():
            np.subtract(
                read.physical[band], amount, out=read.physical[band], where=True if read.where is None else read.where
            )
        if read.exceeds is not None:
            beside = read.exceeds if read.where is None else read.exceeds & read.where
            read.tally.protected = int(np.count_nonzero(beside))
            if flags is not None:
                flags[beside] |= PROTECTED

    def _water_in(self, outer: Tile, physical: Any) -> npt.NDArray[np.bool_] | None:
        """Where a tile with its halo is to be corrected; None for everywhere."""
        if self.area is not None:
            return self.area.read(outer.window)
        if self.water is None:
            return None
        return np.asarray(water([physical[b] for b in self.water_bands], self.water))

    @property
    def _halo(self) -> int:
        """Pixels around a tile that are read with it."""
        if not self.chain.runs:
            return self.model.halo + self._water_halo
        reach = LEVEL_REACH if self.want_stderr else 0
        known = self.chain.presence
        shown, skirt = (0, 0) if known is None else (known.halo + reach, SKIRT)
        reach = max(reach, skirt, max(BESIDE, shown) - self.chain.halo_before)
        return self.chain.halo_before + max(self.chain.halo_after, self._water_halo, self.chain.protection.halo, reach)

    def _near(self, around: Any, known: Any, tile: Tile, outer: Tile) -> npt.NDArray[np.bool_] | None:
        """Known pixels of a tile that may be water, by a look at the bands as they stand; None for all."""
        near = None
        if self.area is not None:
            near = self.area.read(tile.window)
        elif self.water is not None:
            wide = near_water(around[self.water_bands[self.water.roles.nir]], self.water, BESIDE)
            near = None if wide is None else wide[core_of(tile.crop_of(outer), outer.shape)]
        if near is None or near.all():
            return known
        return np.asarray(near if known is None else near & known)

    def _begun(self, around: Any, tile: Tile, outer: Tile, sound: bool) -> Begun:
        """What compensation of a block begins with, which it leaves as it is.

        sound : every number is known to be finite
        """
        shown = shown_in(self.chain.presence, around, tile, outer)
        state = State.on(around) if self.chain.in_place else State.of(around)
        state.sound, state.keep = sound, self.chain.protection.possible or self.want_stderr
        looked = tile.grown(self.chain.protection.halo, self.scene.height, self.scene.width)
        raw = around[place_in(looked, outer)] if self.chain.protection.possible else None
        return Begun(state, raw, looked, None if state.image is around else around, shown)

    def _middle(self, tile: Tile) -> Tile:
        """A tile with what the removal and all that comes after it look at."""
        return tile.grown(self._halo - self.chain.halo_before, self.scene.height, self.scene.width)

    def _compensated(self, begun: Begun, tile: Tile, outer: Tile) -> Compensated:
        """The tile after the chain. Each stage sees no more of the halo than the stages after it need."""
        state, begun.state = begun.state, None
        assert state is not None
        middle = self._middle(tile)
        apply_stages(state, self.chain.before, middle.crop_of(outer))
        state.take()
        clean, replaced = state.image, state.replaced
        if begun.block is not None:
            clean = finish(state, begun.block[place_in(middle, outer)])
        level, units, within = state.water, state.units, place_in(tile, middle)
        found = None if level is None else self._things(begun, level[place_in(begun.looked, middle)], tile)
        values = None if found is None or level is None else lifted(level[within], found)
        inner = (within[1], within[2])
        levels = self._levels(units, level, inner, begun.shown.cells, middle)
        inside, left = self._water_of(clean, inner), State(clean)
        if begun.alone and (inside is None or inside.all()):
            begun.own = None
        left.sound, left.outlined = state.sound, state.outlined
        state.hand_over()
        del level, clean  # each a tile of memory
        clean, replaced = self._where_shown(left, replaced, begun.shown, tile, middle)
        share = begun.shown.share
        if found is None or values is None:
            return Compensated(inside, clean, replaced, None, *levels, share)
        put(clean, found, values)
        if found.places.size:
            replaced &= ~found.mask
        return Compensated(inside, clean, replaced, found.mask, *levels, share)

    def _where_shown(self, state: State, replaced: Any, shown: Shown, tile: Tile, middle: Tile) -> tuple[Any, Any]:
        """What removal and the stages after it make of a block, where glint shows, and what has been replaced."""
        within = place_in(tile, middle)
        if shown.share is None:
            return self._rest(state, replaced[within], tile, middle)
        first, before = shown.opened(state.image, replaced, self.chain.spreads, middle), replaced[within]
        clean, replaced = first, before
        if shown.share.any():
            clean, replaced = self._rest(state, before, tile, middle)
            blend(clean, first, shown.share)
            replaced = before if replaced is before else (replaced & (shown.share > 0)) | before
        if shown.quiet is not None:
            blend(clean, shown.own, shown.quiet)
            replaced = replaced & (shown.quiet > 0)
        return clean, replaced

    def _rest(self, state: State, replaced: Any, tile: Tile, middle: Tile) -> tuple[Any, Any]:
        """What removal and the stages after it make of a block, and what has been replaced."""
        sound, outlined, within = state.sound, state.outlined, place_in(tile, middle)
        clean = state.hand_over()
        if self.model.fits:
            clean = removed(clean, self.model)
        if not self.chain.after:
            return clean[within], replaced
        state, block = State.own(clean), None
        if state.image is not clean:
            block = clean[within]
        del clean  # the stages cut the image
        state.sound, state.keep, state.outlined = sound, False, outlined
        apply_stages(state, self.chain.after, tile.crop_of(middle))
        clean = state.image if block is None else finish(state, block)
        every = state.replaced
        every |= replaced
        return clean, every

    def _things(self, begun: Begun, level: Any, tile: Tile) -> Things | None:
        """Small things in the tile that the level has lost; the block's own values are let go."""
        raw, begun.raw = begun.raw, None
        if raw is None:
            return None
        found = things(raw, level, self.chain.protection)
        return found.cropped(core_of(tile.crop_of(begun.looked), begun.looked.shape))

    def _levels(
        self, units: Any, level: Any, inner: tuple[slice, slice], cells: Cells | None, middle: Tile
    ) -> tuple[Any, Any, tuple[slice, slice]]:
        """The level before and after removal, where a standard error is wanted, and where the tile lies in it."""
        if level is None or not self.want_stderr:
            return None, None, inner
        level = level * units.astype(np.float32)[:, None, None]
        if not self.model.fits:
            return level, level, inner
        after, share = apply(level, self.model), None if cells is None else cells.share(*middle.window)
        if share is not None:
            blend(after, level, share)
        return level, after, inner

    def _water_of(self, block: Any, inner: tuple[slice, slice]) -> npt.NDArray[np.bool_] | None:
        """Where water is, told by compensated bands, where it is to be told: sparkle is no boat there."""
        if self.area is not None or self.water is None:
            return None  # `_near` has said all
        return np.asarray(water([block[b] for b in self.water_bands], self.water)[inner])

    @property
    def _water_halo(self) -> int:
        return self.water.halo if self.water is not None and self.area is None else 0

    def _file_valid(self, raw: Any, valid: Any) -> npt.NDArray[np.bool_] | None:
        """What the output's mask says of the tile, where it has one: valid in every band."""
        if not self.layout.masked:
            return None
        found = np.ones(raw.shape[1:], np.bool_) if valid is None else np.asarray(valid.all(axis=0))
        if raw.dtype.kind == "f" and np.dtype(self.layout.dtype).kind != "f":
            found = found & np.isfinite(raw).all(axis=0)
        return found

    def _known(self, physical: Any, valid: Any) -> npt.NDArray[np.bool_] | None:
        """Where every index can be computed; None where it can everywhere."""
        if valid is None and raster_of(self.scene).info.dtype.kind in "iu":
            return None
        bands = self.model.index_bands
        finite = np.isfinite(physical[bands[0]])
        for band in bands[1:]:
            finite &= np.isfinite(physical[band])
        return None if finite.all() else finite

    def _flags(self, known: Any, where: Any, shape: tuple[int, int]) -> npt.NDArray[np.uint8]:
        flags = np.full(shape, NOT_WATER, np.uint8)
        flags[... if where is None else where] = CORRECTED if self.changed else 0
        if known is not None:
            flags[~known] = NODATA
        return flags
