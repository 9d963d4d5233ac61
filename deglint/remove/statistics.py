"""Statistics of the sample for a fit, gathered tile by tile and merged; the result does not depend on tiles.

`gather` processes one tile and returns a part; `merge` combines the parts. The result is the same to the bit for any
tiles aligned with the cells of `deglint.moments` and any number of threads: moments are merged by cell, single pixels
are selected by their position in the scene, and ties are broken by position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..moments import CellMoments, Float64, Mask, Moments, cell_moments, in_share, thinned
from ..scene import FloatArray
from .detrend import detrend
from .model import GlintIndex


@dataclass(frozen=True)
class SamplePlan:
    """Statistics to gather."""

    bands: tuple[int, ...]  # 0-based bands to fit
    indexes: tuple[GlintIndex, ...]  # glint indexes to regress on; their levels are not used
    detrend_size: int = 0  # side of the window whose mean is subtracted before the regression [pixel]; 0 for none
    keep: str = "nothing"  # which single pixels: "nothing", "index" (for the level), or "all" (for robust regressions)
    share: int = 1  # keep one pixel in `share`, selected by a hash of row and column
    levels: int = 0  # cells of a row are kept in groups of 2**levels

    @property
    def read_bands(self) -> tuple[int, ...]:
        """0-based bands that `gather` expects in its block, in this order."""
        return tuple(sorted(set(self.bands) | {b for i in self.indexes for b in i.bands}))

    @property
    def halo(self) -> int:
        """Pixels around a tile that `gather` needs."""
        return self.detrend_size // 2


@dataclass(frozen=True, eq=False)
class Extreme:
    """The pixel with the smallest (or largest) index: its value, position and spectrum."""

    value: float
    place: tuple[int, int]
    spectrum: Float64


@dataclass(frozen=True, eq=False)
class SampleStatistics:
    """Statistics of a sample, or of its part in a tile; variables are the plan's bands, then its indexes."""

    plan: SamplePlan
    raw: CellMoments  # of the values
    cells: CellMoments  # of the values to which slopes are fitted (detrended if planned), in groups if planned
    darkest: tuple[Extreme, ...]  # one per index; empty without a pixel
    brightest: tuple[Extreme, ...]
    places: npt.NDArray[np.int64]  # (2, pixels): row and column of the kept pixels, in a whole sample in this order
    values: FloatArray  # (variables or indexes, pixels): the kept pixels

    @cached_property
    def moments(self) -> Moments:
        """Total of `raw`."""
        return self.raw.total()

    @cached_property
    def regressed(self) -> Moments:
        """Total of `cells`."""
        return self.cells.total()

    def index_values(self, k: int) -> FloatArray:
        """Kept values of index k, shape (pixels,)."""
        first = len(self.plan.bands) if self.plan.keep == "all" else 0
        return self.values[first + k]


def gather(
    block: FloatArray,
    mask: Mask,
    plan: SamplePlan,
    *,
    origin: tuple[int, int] = (0, 0),
    crop: tuple[int, int, int, int] = (0, 0, 0, 0),
) -> SampleStatistics:
    """Statistics of the sample's pixels in one tile.

    block : (len(plan.read_bands), rows, columns), physical values of the tile and its halo, NaN where not valid
    mask : (rows, columns), True where a pixel belongs to the sample (in the halo too)
    origin : row and column in the scene of the tile's first pixel, not counting the halo [pixel]
    crop : halo of the block: rows above and below, columns left and right [pixel]
    """
    planes = dict(zip(plan.read_bands, block, strict=True))
    first = len(plan.bands)
    found = [*(planes[b] for b in plan.bands), *(index.of(planes) for index in plan.indexes)]
    variables: FloatArray = np.stack(found, dtype=block.dtype, casting="same_kind")
    mask = mask & np.isfinite(variables).all(axis=0)
    inner = slice(crop[0], mask.shape[0] - crop[1]), slice(crop[2], mask.shape[1] - crop[3])
    cells = None
    if plan.detrend_size:
        cells = cell_moments(detrend(variables, mask, plan.detrend_size)[:, *inner], mask[inner], origin=origin)
    variables, mask = variables[:, *inner], mask[inner]
    kept = thinned(mask, origin, plan.share) if plan.keep != "nothing" else np.zeros_like(mask)
    rows, columns = np.nonzero(kept)
    raw = cell_moments(variables, mask, origin=origin)
    return SampleStatistics(
        plan,
        raw,
        raw if cells is None else cells,
        darkest=_extremes(variables, mask, first, origin, 1),
        brightest=_extremes(variables, mask, first, origin, -1),
        places=np.stack([rows + origin[0], columns + origin[1]]),
        values=variables[0 if plan.keep == "all" else first :, rows, columns],
    )


def merge(parts: Sequence[SampleStatistics], plan: SamplePlan) -> SampleStatistics:
    """Merge the statistics of some tiles; the result is the same to the bit for any order of the parts.

    parts : at least one, gathered by this plan or one that keeps more single pixels
    plan : which single pixels to keep, and which cells to group
    """
    some = [p for p in parts if len(p.raw.n)] or parts[:1]
    raw = CellMoments.concatenate([p.raw for p in some]).joined(plan.levels)
    cells = CellMoments.concatenate([p.cells for p in some]).joined(plan.levels) if plan.detrend_size else raw
    places, values = (np.concatenate([getattr(p, name) for p in some], axis=1) for name in ("places", "values"))
    order = np.argsort((places[0] << 32) + places[1], kind="stable")  # fast, as rows of a tile are in order
    if any(p.plan.share != plan.share for p in some):
        order = order[in_share(places[0, order], places[1, order], plan.share)]
    darkest, brightest = _first(1, [p.darkest for p in some]), _first(-1, [p.brightest for p in some])
    return SampleStatistics(plan, raw, cells, darkest, brightest, places[:, order], values[:, order])


def _first(sign: int, extremes: Sequence[tuple[Extreme, ...]]) -> tuple[Extreme, ...]:
    """For each index the extreme with the smallest value times `sign`; of equal ones the first in the scene."""
    return tuple(min(some, key=lambda e: (sign * e.value, e.place)) for some in zip(*extremes, strict=True))


def _extremes(variables: FloatArray, mask: Mask, bands: int, origin: tuple[int, int], sign: int) -> tuple[Extreme, ...]:
    """For each index the first masked pixel where its value times `sign` is smallest."""
    among, out = np.flatnonzero(mask), []
    for values in variables[bands:] if among.size else ():
        row, column = divmod(int(among[np.argmin(sign * values[mask])]), mask.shape[1])
        spectrum = variables[:bands, row, column].astype(np.float64)
        out.append(Extreme(float(values[row, column]), (row + origin[0], column + origin[1]), spectrum))
    return tuple(out)
