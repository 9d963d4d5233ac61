"""Correct one tile: what is valid, what is water, the correction itself, and what became of every pixel."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..masks import WaterRule, opened, valid_for, water
from ..raster.convert import is_valid
from ..raster.encode import encode, retype
from ..raster.info import same_nodata
from ..raster.output import Layout
from ..readers.areas import Area
from ..remove import GlintModel, apply
from ..scene import Scene
from ..tiles import Tile
from .look import core_of, raster_of
from .surroundings import Surroundings

FLAGS = {
    1: "nodata: not valid, passed unchanged",
    2: "not water, or outside the mask: passed unchanged",
    4: "corrected",
    8: "negative after correction, in some band",
    16: "saturated before correction, in some band",
    32: "clipped to the output's integer range (less the number for nodata), in some band",
}
"""Bits of the flag raster."""
NODATA, NOT_WATER, CORRECTED, NEGATIVE, SATURATED, CLIPPED = FLAGS


@dataclass
class Tally:
    """Pixels of the whole run; bands in scene order."""

    bands: int
    total: int = 0
    nodata: int = 0
    not_water: int = 0
    corrected: int = 0
    negative: npt.NDArray[np.int64] = field(init=False)
    clipped: npt.NDArray[np.int64] = field(init=False)
    saturated: npt.NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.negative, self.clipped, self.saturated = (np.zeros(self.bands, np.int64) for _ in range(3))

    def add(self, other: Tally) -> None:
        """Add a tile's counts."""
        for name in ("total", "nodata", "not_water", "corrected", "negative", "clipped", "saturated"):
            setattr(self, name, getattr(self, name) + getattr(other, name))


@dataclass(frozen=True, eq=False)
class Corrected:
    """One corrected tile."""

    raw: npt.NDArray[Any]
    tally: Tally
    valid: npt.NDArray[np.bool_] | None = None
    flags: npt.NDArray[np.uint8] | None = None
    amount: npt.NDArray[np.float32] | None = None


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
    surroundings: Surroundings | None

    def __call__(self, tile: Tile) -> Corrected:
        """Read a tile, correct it, and bring it into the output's type."""
        source = raster_of(self.scene)
        info = source.info
        raw, valid = source.read_raw(tile.window)
        tally = Tally(len(self.scene.bands), total=tile.shape[0] * tile.shape[1])
        physical = source.to_physical(raw, valid)
        known = self._known(physical, valid)
        inside = self._inside(tile, physical)
        where = known if inside is None else inside if known is None else known & inside
        usable = tally.total if where is None else int(np.count_nonzero(where))
        where = None if usable == tally.total else where
        tally.nodata = 0 if known is None else tally.total - int(np.count_nonzero(known))
        tally.not_water = tally.total - usable - tally.nodata
        tally.corrected = usable if self.model.fits else 0
        flags = self._flags(known, where, tile.shape) if self.want_flags else None
        tally.saturated = _saturated(self.scene, physical, flags)
        bands = [f.band for f in self.model.fits]
        before = physical[bands].copy() if self.want_amount else None
        file_valid = self._file_valid(raw, valid)
        raw, lost = self._retyped(raw, valid)
        if tally.corrected:
            if not physical.flags.writeable:
                physical = physical.copy()
            apply(physical, self.model, where=where, out=physical)
            counts = encode(
                physical, raw, bands=bands, scales=info.scales, offsets=info.offsets,
                where=where, nodata=self.layout.nodata, flags=flags, marks=(NEGATIVE, CLIPPED),
            )  # fmt: skip
            tally.negative, tally.clipped = counts.negative, counts.clipped
            if lost is not None:
                lost[bands] &= False if where is None else ~where
        if lost is not None:
            tally.clipped = tally.clipped + np.count_nonzero(lost, axis=(1, 2))
            if flags is not None:
                flags[lost.any(axis=0)] |= CLIPPED
        amount = None if before is None else np.subtract(before, physical[bands], dtype=np.float32)
        return Corrected(raw, tally, file_valid, flags, amount)

    def _file_valid(self, raw: Any, valid: Any) -> npt.NDArray[np.bool_] | None:
        """What the output's mask says of the tile, where it has one: valid in every band."""
        if not self.layout.masked:
            return None
        found = np.ones(raw.shape[1:], np.bool_) if valid is None else np.asarray(valid.all(axis=0))
        if raw.dtype.kind == "f" and np.dtype(self.layout.dtype).kind != "f":
            found = found & np.isfinite(raw).all(axis=0)
        return found

    def _retyped(self, raw: Any, valid: Any) -> tuple[Any, Any]:
        """The tile in the output's type and with the output's nodata; also where a valid number was clipped."""
        dtype, nodata = np.dtype(self.layout.dtype), self.layout.nodata
        lost = None
        own = [self.layout.info.nodatas[b] for b in range(len(raw))]
        hidden = None if nodata is None or all(n is None or same_nodata(n, nodata) for n in own) else is_valid(raw, own)
        if raw.dtype != dtype:
            raw, lost = retype(raw, dtype)
            if lost is not None and valid is not None:
                lost &= valid
        if hidden is not None:
            np.copyto(raw, dtype.type(nodata), where=~hidden)
        return raw, lost

    def _known(self, physical: Any, valid: Any) -> npt.NDArray[np.bool_] | None:
        """Where every index can be computed; None where it can everywhere."""
        if valid is None and raster_of(self.scene).info.dtype.kind in "iu":
            return None
        finite = np.isfinite(physical[self.model.index_bands[0]])
        for band in self.model.index_bands[1:]:
            finite &= np.isfinite(physical[band])
        return None if finite.all() else finite

    def _inside(self, tile: Tile, physical: Any) -> npt.NDArray[np.bool_] | None:
        """Where correction is wanted; None for everywhere."""
        if self.area is not None:
            return self.area.read(tile.window)
        if self.water is None:
            return None
        bands = [physical[b] for b in self.water_bands]
        if self.surroundings is None:
            return water(bands, self.water)
        inside = valid_for(bands, self.water.roles)
        around = self.surroundings.around(tile, bands[self.water.roles.nir])
        if around is None:
            return inside
        found = opened(*around, self.water.window)
        outer = tile.grown(self.water.halo, self.scene.height, self.scene.width)
        return inside & ~found[core_of(tile.crop_of(outer), found.shape)]

    def _flags(self, known: Any, where: Any, shape: tuple[int, int]) -> npt.NDArray[np.uint8]:
        flags = np.full(shape, NOT_WATER, np.uint8)
        flags[... if where is None else where] = CORRECTED
        if known is not None:
            flags[~known] = NODATA
        return flags


def _saturated(scene: Scene, physical: Any, flags: npt.NDArray[np.uint8] | None) -> npt.NDArray[np.int64]:
    """Pixels of each band at or above its saturation, flagged where asked."""
    counts = np.zeros(len(scene.bands), np.int64)
    for i, band in enumerate(scene.bands):
        if band.saturation is not None:
            full = physical[i] >= physical.dtype.type(band.saturation)
            counts[i] = np.count_nonzero(full)
            if flags is not None and counts[i]:
                flags[full] |= SATURATED
    return counts
