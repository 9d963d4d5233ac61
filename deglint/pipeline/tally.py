"""What became of every pixel, counted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..raster.convert import ends
from ..scene import Scene
from .look import raster_of

_PER_BAND = ("replaced", "rewritten", "negative", "clipped", "saturated")


@dataclass
class Tally:
    """Pixels of the whole run; bands in scene order. What was `copied` was not looked at: only its total is known; what
    was `passed` lies in tiles that hold nothing to correct, and was not compensated; what is `calm` is water where no
    glint is, and as it was; `rewritten` counts pixels of bands without a removal that compensation changed."""

    bands: int
    total: int = 0
    copied: bool = False
    nodata: int = 0
    not_water: int = 0
    corrected: int = 0
    protected: int = 0
    usable: int = 0
    passed: int = 0
    calm: int = 0
    replaced: npt.NDArray[np.int64] = field(init=False)
    rewritten: npt.NDArray[np.int64] = field(init=False)
    negative: npt.NDArray[np.int64] = field(init=False)
    clipped: npt.NDArray[np.int64] = field(init=False)
    saturated: npt.NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        for name in _PER_BAND:
            setattr(self, name, np.zeros(self.bands, np.int64))

    def add(self, other: Tally) -> None:
        """Add a tile's counts."""
        counts = ("total", "nodata", "not_water", "usable", "corrected", "protected", "passed", "calm")
        self.copied |= other.copied
        for name in (*counts, *_PER_BAND):
            setattr(self, name, getattr(self, name) + getattr(other, name))


@dataclass(frozen=True, eq=False)
class Saturated:
    """Pixels of each band that are saturated, and where any band is, if that is wanted and there are such."""

    counts: npt.NDArray[np.int64]
    any_band: npt.NDArray[np.bool_] | None = None


def largest_in(scene: Scene, raw: Any, valid: Any) -> npt.NDArray[Any] | None:
    """The largest physical value of each band of small whole numbers that are all valid, 0 counted in, told by the
    numbers themselves, which are less to read; None where they are not such, or no band has a saturation."""
    small = raw.dtype.kind in "iu" and raw.dtype.itemsize <= 2
    if valid is not None or not small or all(band.saturation is None for band in scene.bands):
        return None
    found = raster_of(scene).to_physical(ends(raw).astype(raw.dtype)[:, None])
    return np.asarray(found[:, 0].max(axis=1))


def saturated_in(scene: Scene, physical: Any, wanted: bool, largest: npt.NDArray[Any] | None = None) -> Saturated:
    """Pixels of each band at or above its saturation; `largest` are those of a larger block, where they are known."""
    counts, places = np.zeros(len(scene.bands), np.int64), None
    for i, band in enumerate(scene.bands):
        if band.saturation is None:
            continue
        limit = float(physical.dtype.type(band.saturation))  # as a full number is rounded
        most = physical[i].max(initial=-np.inf) if largest is None else largest[i]
        if not most < limit:  # or some is no number
            full = physical[i] >= limit
            counts[i] = np.count_nonzero(full)
            if wanted and counts[i]:
                places = full if places is None else places | full
    return Saturated(counts, places)
