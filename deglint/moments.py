"""Mean and covariance of pixels by a numerically stable algorithm whose partial results can be merged.

The scene is divided into square cells that start at its first pixel. The moments of each cell are computed separately,
and cells are merged in pairs in row-major order. The result is therefore the same to the bit for any tiles in which the
scene is read (if tile edges are cell edges) and for any number of threads.

The moments of a cell are computed in one pass, about a typical pixel. If this pixel is far from the mean, or pixels are
missing, there are two passes: first the mean, then the moments about it. Cells are merged by the formula of Chan, Golub
and LeVeque (1983); means are stored as sums of two doubles. No large sums of squares are formed, so an offset of 1e8 or
one extreme pixel costs no precision.

References
----------
Chan, Golub, LeVeque (1983), "Algorithms for computing the sample variance", The American Statistician 37, 242-247,
doi:10.1080/00031305.1983.10483115.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .errors import InputError

Float64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Crop = tuple[int, int, int, int]  # halo of a block: rows above and below, columns left and right [pixel]
_NEAR_MEAN = 0.9
"""Upper limit for one pass: share [1] of the sum of squares about a typical pixel that is due to the distance of this
pixel from the mean. A share of 0.9 costs three bits of precision."""
CELL = 64  # side of a cell [pixel]; tiles that start at multiples of it give bit-identical statistics


class Moments(NamedTuple):
    """Count, mean, central co-moments and range of pixels with several variables, such as bands.

    Attributes
    ----------
    n : int
        Number of pixels in which every variable is finite.
    mean : (variables,) ndarray
    comoment : (variables, variables) ndarray
        Sum over pixels of (x - mean)(x - mean)^T; not finite for values above about 1e150.
    minimum, maximum : (variables,) ndarray
        Smallest and largest value; +inf and -inf where n is 0.
    rest : (variables,) ndarray
        Rounding error of `mean`, to be added to it; it is kept so that merging parts costs no precision.
    """

    n: int
    mean: Float64
    comoment: Float64
    minimum: Float64
    maximum: Float64
    rest: Float64

    def covariance(self, ddof: int = 1) -> Float64:
        """Covariance matrix, (variables, variables): `comoment` / (n - ddof); all NaN if n <= ddof."""
        return self.comoment / (self.n - ddof if self.n > ddof else np.nan)


class CellMoments(NamedTuple):
    """Moments of the pixels in many square cells: the attributes of `Moments`, with cells along the first axis."""

    keys: npt.NDArray[np.int64]  # (cells, 2), row and column of each cell, in cells from the scene's origin
    n: Float64
    mean: Float64
    comoment: Float64
    minimum: Float64
    maximum: Float64
    rest: Float64

    @classmethod
    def of(cls, keys: npt.ArrayLike, cells: Sequence[Moments]) -> CellMoments:
        """Make an object from `keys`, the row and column of each cell in the grid of cells, and the moments of each."""
        return cls(np.array(keys, np.int64), *(np.array(values, np.float64) for values in zip(*cells, strict=True)))

    @classmethod
    def concatenate(cls, parts: Sequence[CellMoments]) -> CellMoments:
        """All cells of the parts, one after the other, not merged; a cell of the scene may occur in several parts."""
        return cls._make(map(np.concatenate, zip(*parts, strict=True)))

    def by_place(self) -> CellMoments:
        """The same cells in row-major order."""
        return self.where(np.lexsort((self.keys[:, 1], self.keys[:, 0])))

    def joined(self, levels: int) -> CellMoments:
        """In each row of cells, merge groups of 2**levels neighbouring cells, counted from the left edge of the scene.

        No cell may occur twice. Cells of a group are merged in pairs; a single cell is copied. The result is row-major.
        """
        out = self.by_place()
        for level in range(1, levels + 1):  # a group of 2**level columns has at most two cells left
            groups = out.keys >> np.array([0, level])
            first = np.flatnonzero((groups[1:] == groups[:-1]).all(axis=1))
            both = out.where(np.stack([first, first + 1], axis=1).ravel())
            alone = np.delete(np.arange(len(out.n)), [*first, *(first + 1)])
            out = CellMoments.concatenate([both._neighbours_merged(), out.where(alone)]).by_place()
        return out

    def _neighbours_merged(self) -> CellMoments:
        """Merge cells 0 and 1, 2 and 3, ... by the formula of Chan, Golub and LeVeque; an odd last cell is copied."""
        even = len(self.n) // 2 * 2
        a, b = self.where(slice(0, even, 2)), self.where(slice(1, even, 2))
        n = a.n + b.n
        away = (b.mean - a.mean) + (b.rest - a.rest)
        weight = a.n * b.n / n
        comoment = a.comoment + b.comoment + away[:, :, None] * away[:, None, :] * weight[:, None, None]
        mean, rest = _two_sum(a.mean, away * (b.n / n)[:, None] + a.rest)
        low, high = np.minimum(a.minimum, b.minimum), np.maximum(a.maximum, b.maximum)
        merged = CellMoments(a.keys, n, mean, comoment, low, high, rest)
        return merged if even == len(self.n) else CellMoments.concatenate([merged, self.where(slice(even, None))])

    def where(self, chosen: npt.NDArray[Any] | slice) -> CellMoments:
        """Select cells; `chosen` is an array of indexes, a slice, or a mask (cell,)."""
        return CellMoments._make(values[chosen] for values in self)

    def total(self) -> Moments:
        """Moments of all cells together; neighbouring cells, in the current order, are merged first."""
        if not len(self.n):
            return _two_passes(np.empty((self.mean.shape[1], 0)))
        cells = self
        with np.errstate(over="ignore", invalid="ignore"):
            while len(cells.n) > 1:
                cells = cells._neighbours_merged()
        return Moments(int(cells.n[0]), *(values[0] for values in cells[2:]))


def cell_moments(
    block: npt.NDArray[Any], mask: Mask | None = None, *, origin: tuple[int, int] = (0, 0), cell: int = CELL
) -> CellMoments:
    """Moments of the pixels of a block of the scene, separately for each square cell of the scene.

    block : (variable, row, column), any real dtype; pixels with NaN or infinity in any variable are left out
    mask : (row, column), True where a pixel counts; by default everywhere
    origin : row and column of the block's first pixel in the scene [pixel]
    cell : side of a cell [pixel]

    Returns the cells with at least one pixel that counts. The cost is one read of the block and (variables + 1)^2 / 2
    multiply-adds per pixel. Raises InputError if the block is not three-dimensional, or the mask has another shape.
    """
    block = np.asarray(block)
    if block.ndim != 3:
        raise InputError(f"expected a (variable, row, column) array, got shape {block.shape}.")
    if mask is not None and mask.shape != block.shape[1:]:
        raise InputError(f"mask has shape {mask.shape}, but rows and columns of the block are {block.shape[1:]}.")
    edges = [_edges(first, length, cell) for first, length in zip(origin, block.shape[1:], strict=True)]
    keys, found = [(0, 0)], [_two_passes(np.empty((len(block), 0)))]  # an empty cell, for the shapes; left out below
    with np.errstate(over="ignore", invalid="ignore"):  # whoever uses a moment tests whether it is finite
        for row, rows in edges[0]:
            for column, columns in edges[1]:
                keys.append((row, column))
                found.append(_reduced(block[:, rows, columns], None if mask is None else mask[rows, columns]))
    cells = CellMoments.of(keys, found)
    return cells.where(cells.n > 0)


def _edges(first: int, length: int, cell: int) -> list[tuple[int, slice]]:
    """For each cell of an axis: index in the scene, and slice in the block, which has `length` pixels from `first`."""
    numbers = range(first // cell, -(-(first + length) // cell)) if length else range(0)
    return [(k, slice(max(k * cell - first, 0), min((k + 1) * cell - first, length))) for k in numbers]


def thinned(mask: Mask, origin: tuple[int, int], share: int) -> Mask:
    """Keep about one in `share` pixels of a mask, selected by a hash of their row and column in the scene.

    `origin` is the scene's row and column of the first pixel of the mask; the selection does not depend on tiles.
    """
    if share <= 1:
        return mask
    rows = np.arange(origin[0], origin[0] + mask.shape[0])[:, None]
    columns = np.arange(origin[1], origin[1] + mask.shape[1])
    mixed = rows.astype(np.uint64) * np.uint64(0x9E3779B1) + columns.astype(np.uint64) * np.uint64(0x85EBCA77)
    mixed ^= mixed >> np.uint64(15)
    mixed *= np.uint64(0x2C1B3C6D)
    mixed ^= mixed >> np.uint64(12)
    return np.asarray(mask & (mixed % np.uint64(share) == 0))


def _reduced(pixels: npt.NDArray[Any], inside: Mask | None) -> Moments:
    """Moments of finite pixels of a cell (variable, row, column) where `inside` (row, column; None: all) is True."""
    whole = inside is None or inside.all()
    if whole and (one := _one_pass(np.array(pixels, np.float64).reshape(len(pixels), -1))) is not None:
        return one
    x = np.array(pixels, np.float64).reshape(len(pixels), -1)
    valid = np.isfinite(x).all(axis=0)
    return _two_passes(x[:, valid if inside is None else valid & inside.ravel()])


def _one_pass(x: Float64) -> Moments | None:
    """Moments of `x` (variable, pixel) in one pass, or None if they are imprecise or not finite. It overwrites `x`."""
    count = x.shape[1]
    low, high = x.min(axis=1), x.max(axis=1)
    shift = _typical(x)
    x -= shift[:, None]
    total, comoment = x.sum(axis=1), x @ x.T
    centre = total / count
    if not (np.isfinite(high - low) & (total * centre <= _NEAR_MEAN * np.diagonal(comoment))).all():
        return None
    comoment -= total[:, None] * centre
    mean, rest = _two_sum(shift, centre)
    return Moments(count, mean, comoment, low, high, rest)


def _two_passes(x: Float64) -> Moments:
    """Moments of finite `x` (variable, pixel) in two passes: the mean, then moments about it. It overwrites `x`."""
    count = x.shape[1]
    low, high = x.min(axis=1, initial=np.inf), x.max(axis=1, initial=-np.inf)
    if not count:
        return Moments(0, np.zeros(len(x)), np.zeros((len(x), len(x))), low, high, np.zeros(len(x)))
    shift = _typical(x)
    x -= shift[:, None]
    centre = x.mean(axis=1)
    x -= centre[:, None]
    left = x.mean(axis=1)
    mean, rest = _two_sum(shift, centre + left)
    return Moments(count, mean, x @ x.T - count * np.outer(left, left), low, high, rest)


def _typical(x: Float64) -> Float64:
    """Median (variable,) of the first, middle and last pixel of `x` (variable, pixel); robust against one outlier."""
    return np.sort(x[:, [0, x.shape[1] // 2, -1]], axis=1)[:, 1]


def _two_sum(a: Float64, b: Float64) -> tuple[Float64, Float64]:
    """Rounded sum a + b, and its rounding error (Knuth's TwoSum)."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)
