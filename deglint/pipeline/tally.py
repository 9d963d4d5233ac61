"""What became of every pixel, counted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import Scene

_PER_BAND = ("replaced", "rewritten", "negative", "clipped", "saturated")


@dataclass
class Tally:
    """Pixels of the whole run; bands in scene order. What was `copied` was not computed: only its total is known;
    `rewritten` counts pixels of bands without a removal that compensation changed."""

    bands: int
    total: int = 0
    copied: bool = False
    nodata: int = 0
    not_water: int = 0
    corrected: int = 0
    protected: int = 0
    usable: int = 0
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
        counts = ("total", "nodata", "not_water", "usable", "corrected", "protected")
        self.copied |= other.copied
        for name in (*counts, *_PER_BAND):
            setattr(self, name, getattr(self, name) + getattr(other, name))


@dataclass(frozen=True, eq=False)
class Saturated:
    """Pixels of each band that are saturated, and where any band is, if that is wanted and there are such."""

    counts: npt.NDArray[np.int64]
    any_band: npt.NDArray[np.bool_] | None = None


def saturated_in(scene: Scene, physical: Any, wanted: bool) -> Saturated:
    """Pixels of each band at or above its saturation."""
    counts, places = np.zeros(len(scene.bands), np.int64), None
    for i, band in enumerate(scene.bands):
        if band.saturation is None:
            continue
        full = physical[i] >= float(physical.dtype.type(band.saturation))  # as a saturated value is rounded
        counts[i] = np.count_nonzero(full)
        if wanted and counts[i]:
            places = full if places is None else places | full
    return Saturated(counts, places)
