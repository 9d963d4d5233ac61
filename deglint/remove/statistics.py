"""What a fit needs to know of the sample, gathered tile by tile and merged without regard to the tiling.

`gather` looks at one tile and returns a part; `merge` puts the parts together. Everything in the result is the same
to the bit for any tiling on the cells of `deglint.moments` and any number of threads: moments are merged by cell,
single pixels are chosen by their place in the scene, and ties are broken by place.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import FitError
from ..moments import CELL, CellMoments, Float64, Moments, cell_moments, thinned
from ..scene import FloatArray
from .detrend import detrend, detrend_halo
from .model import GlintIndex

Crop = tuple[int, int, int, int]
"""Halo around a tile: rows above and below, columns left and right [pixel]."""
MOST_CELLS = 1 << 14
"""Cells, or groups of them, whose moments are kept one by one, for standard errors; about."""


@dataclass(frozen=True)
class SamplePlan:
    """What to gather.

    Attributes
    ----------
    bands : tuple of int
        0-based bands whose slopes are wanted.
    indexes : tuple of GlintIndex
        Glint indexes to regress on (their levels are not used).
    detrend_size : int
        Side of the window whose mean is taken off before the regression [pixel]; 0 for none.
    keep : {"nothing", "index", "all"}
        Which single pixels to keep: none, their indexes (for percentile and mode), or indexes and bands (for the
        robust regressions).
    share : int
        Keep one pixel in so many, chosen by a hash of row and column.
    levels : int
        Cells of a row are kept in groups of 2**levels.
    """

    bands: tuple[int, ...]
    indexes: tuple[GlintIndex, ...]
    detrend_size: int = 0
    keep: str = "nothing"
    share: int = 1
    levels: int = 0

    @property
    def read_bands(self) -> tuple[int, ...]:
        """0-based bands that `gather` expects in its block, in this order."""
        return tuple(sorted(set(self.bands) | {b for i in self.indexes for b in i.bands}))

    @property
    def halo(self) -> int:
        """Pixels around a tile that `gather` looks at."""
        return detrend_halo(self.detrend_size)


@dataclass(frozen=True, eq=False)
class Extreme:
    """The pixel with the smallest (or largest) index: its value, place and spectrum."""

    value: float
    place: tuple[int, int]
    spectrum: Float64


@dataclass(frozen=True, eq=False)
class SamplePart:
    """What one tile contributes; variables are the plan's bands, then its indexes."""

    cells: CellMoments
    detrended: CellMoments | None
    darkest: tuple[Extreme | None, ...]
    brightest: tuple[Extreme | None, ...]
    places: npt.NDArray[np.int64]
    values: FloatArray


@dataclass(frozen=True, eq=False)
class SampleStatistics:
    """What a whole sample says; variables are the plan's bands, then its indexes.

    Attributes
    ----------
    plan : SamplePlan
    moments : Moments
    cells : CellMoments
        Of the values that the slopes are fitted to (detrended where the plan says so), in groups as the plan says.
    regressed : Moments
        Their total.
    darkest, brightest : tuple of Extreme
        One an index.
    values : (variables or indexes, pixels) ndarray
        The kept pixels, in row-major order.
    """

    plan: SamplePlan
    moments: Moments
    cells: CellMoments
    regressed: Moments
    darkest: tuple[Extreme, ...]
    brightest: tuple[Extreme, ...]
    values: FloatArray

    def index_values(self, k: int) -> FloatArray:
        """Kept values of index k, shape (pixels,)."""
        first = len(self.plan.bands) if self.plan.keep == "all" else 0
        return self.values[first + k]

    def mixture(self, index: GlintIndex) -> Float64:
        """Kept values of a mixture of the plan's indexes (or of one of them), shape (pixels,)."""
        first = len(self.plan.bands) if self.plan.keep == "all" else 0
        places = {(i.bands, i.weights): first + k for k, i in enumerate(self.plan.indexes)}
        own = places.get((index.bands, index.weights))
        if own is not None:
            return self.values[own].astype(np.float64)
        rows = [places[(band,), (1.0,)] for band in index.bands]
        return np.asarray(index.weights) @ self.values[rows].astype(np.float64)


def gather(
    block: FloatArray,
    mask: npt.NDArray[np.bool_],
    plan: SamplePlan,
    *,
    origin: tuple[int, int] = (0, 0),
    crop: Crop = (0, 0, 0, 0),
) -> SamplePart:
    """Look at the sample's pixels in one tile.

    Parameters
    ----------
    block : (len(plan.read_bands), rows, columns) ndarray
        Physical values of the tile and its halo, NaN where not valid.
    mask : (rows, columns) bool ndarray
        True where a pixel belongs to the sample (in the halo too).
    plan : SamplePlan
    origin : (int, int)
        Row and column in the scene of the tile's first pixel, not counting the halo.
    crop : (int, int, int, int)
        How much of the block is halo.

    Returns
    -------
    SamplePart
    """
    variables = _variables(block, plan)
    mask = mask & np.isfinite(variables).all(axis=0)
    inner = (slice(crop[0], mask.shape[0] - crop[1]), slice(crop[2], mask.shape[1] - crop[3]))
    detrended = None
    if plan.detrend_size:
        local = detrend(variables, mask, plan.detrend_size)[(slice(None), *inner)]
        detrended = cell_moments(local, mask[inner], origin=origin)
    variables, mask = variables[(slice(None), *inner)], mask[inner]
    first = len(plan.bands)
    kept = thinned(mask, origin, plan.share) if plan.keep != "nothing" else np.zeros_like(mask)
    rows, columns = np.nonzero(kept)
    number = range(len(plan.indexes))
    return SamplePart(
        cells=cell_moments(variables, mask, origin=origin),
        detrended=detrended,
        darkest=tuple(_extreme(variables, mask, first + k, first, origin, 1) for k in number),
        brightest=tuple(_extreme(variables, mask, first + k, first, origin, -1) for k in number),
        places=np.stack([rows + origin[0], columns + origin[1]]),
        values=variables[0 if plan.keep == "all" else first :, rows, columns],
    )


def levels_for(pixels: int) -> int:
    """How many cells of a row are to be grouped (2**levels), so that what is kept of so many pixels is bounded."""
    return max(math.ceil(math.log2(max(pixels / CELL**2 / MOST_CELLS, 1))), 0)


def combine(parts: Sequence[SamplePart], plan: SamplePlan) -> SamplePart:
    """One part in place of those of some tiles: a row of tiles in a reduction."""
    real = [p for p in parts if len(p.cells.n)] or list(parts[:1])
    local = [p.detrended for p in real if p.detrended is not None]
    number = range(len(plan.indexes))
    return SamplePart(
        cells=CellMoments.concatenate([p.cells for p in real]).joined(plan.levels),
        detrended=CellMoments.concatenate(local).joined(plan.levels) if local else None,
        darkest=tuple(_most([p.darkest[k] for p in real], 1.0) for k in number),
        brightest=tuple(_most([p.brightest[k] for p in real], -1.0) for k in number),
        places=np.concatenate([p.places for p in real], axis=1),
        values=np.concatenate([p.values for p in real], axis=1),
    )


def merge(parts: Iterable[SamplePart], plan: SamplePlan) -> SampleStatistics:
    """Put the tiles' parts together.

    Raises
    ------
    FitError
        No tile holds a pixel of the sample.
    """
    parts = [p for p in parts if len(p.cells.n)]
    if not parts:
        raise FitError("the sample holds no valid pixel. Pass --sample with a polygon or window over open water.")
    whole = combine(parts, plan)
    total = whole.cells.total()
    regressed_cells, regressed = whole.cells, total
    if whole.detrended is not None:
        regressed_cells, regressed = whole.detrended, whole.detrended.total()
    order = np.lexsort((whole.places[1], whole.places[0]))
    return SampleStatistics(
        plan=plan,
        moments=total,
        cells=regressed_cells,
        regressed=regressed,
        darkest=tuple(e for e in whole.darkest if e is not None),
        brightest=tuple(e for e in whole.brightest if e is not None),
        values=whole.values[:, order],
    )


def _variables(block: FloatArray, plan: SamplePlan) -> FloatArray:
    """The plan's bands, then its indexes, as one (variable, row, column) array."""
    row = {b: i for i, b in enumerate(plan.read_bands)}
    out = np.empty((len(plan.bands) + len(plan.indexes), *block.shape[1:]), block.dtype)
    for i, band in enumerate(plan.bands):
        out[i] = block[row[band]]
    for k, index in enumerate(plan.indexes, start=len(plan.bands)):
        out[k] = index_of([block[row[b]] for b in index.bands], index)
    return out


def index_of(bands: Sequence[FloatArray], index: GlintIndex) -> FloatArray:
    """The glint index from its bands, any shape, computed in float64."""
    total = np.zeros(bands[0].shape)
    for weight, band in zip(index.weights, bands, strict=True):
        total += weight * band.astype(np.float64, copy=False)
    return total.astype(bands[0].dtype, copy=False)


def _extreme(
    variables: FloatArray, mask: npt.NDArray[np.bool_], k: int, bands: int, origin: tuple[int, int], sign: int
) -> Extreme | None:
    """The masked pixel where `sign` times variable k is smallest, the first in row-major order."""
    if not mask.any():
        return None
    ordered = np.where(mask, variables[k] if sign > 0 else -variables[k], np.inf)
    row, column = (int(i) for i in np.unravel_index(int(np.argmin(ordered)), mask.shape))
    spectrum = variables[:bands, row, column].astype(np.float64)
    return Extreme(float(variables[k, row, column]), (row + origin[0], column + origin[1]), spectrum)


def _most(candidates: Iterable[Extreme | None], sign: float) -> Extreme | None:
    return min((c for c in candidates if c is not None), key=lambda c: (sign * c.value, c.place), default=None)
