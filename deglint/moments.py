"""Mean and covariance of pixels in one stable, mergeable pass: the statistics kernel of the project.

A block is cut into square cells that are aligned with the *scene's* origin, not with the tile's. Every cell is
reduced by itself, and the cells are merged pairwise in row-major order, so the result is the same to the bit whatever
tiles the scene was read in (as long as tile edges fall on cell edges) and however many threads worked on it.

A cell is reduced in two passes while it is in cache - first its mean, then the moments about that mean - and merged
with the update of Chan, Golub and LeVeque (1983), means held in two doubles. No large sums of squares are ever formed,
so an offset of 1e8 or one extreme pixel costs no digits.

References
----------
Chan, Golub, LeVeque (1983), "Algorithms for computing the sample variance", The American Statistician 37, 242-247,
doi:10.1080/00031305.1983.10483115.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import InputError

Float64 = npt.NDArray[np.float64]
Places = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
_NEAR_MEAN = 0.9
"""Share of the sum of squares about a typical pixel that may be due to its distance from the mean: costs three bits."""
_ROOM = 1 << 18
"""Values worked on at a time, at most, if a cell has fewer."""
CELL = 64
"""Side of a cell [pixel]; tiles that start at multiples of it give bit-identical statistics."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Count, mean, central co-moments and range of pixels of several variables.

    Attributes
    ----------
    n : int
        Pixels in which every variable is finite.
    mean : (variables,) ndarray
    comoment : (variables, variables) ndarray
        Sum over pixels of (x - mean)(x - mean)^T; not finite where values reach beyond some 1e150.
    minimum, maximum : (variables,) ndarray
        +inf and -inf where n is 0.
    rest : (variables,) ndarray
        What rounding took from the mean, so that parts merge without loss.
    """

    n: int
    mean: Float64
    comoment: Float64
    minimum: Float64
    maximum: Float64
    rest: Float64

    def covariance(self, ddof: int = 1) -> Float64:
        """Covariance matrix; NaN where n <= ddof."""
        if self.n <= ddof:
            return np.full_like(self.comoment, np.nan)
        return self.comoment / (self.n - ddof)

    @classmethod
    def merge(cls, parts: Iterable[Moments]) -> Moments:
        """Moments of all pixels of the parts, merged in the order given.

        Raises
        ------
        InputError
            There are no parts, or they differ in their variables.
        """
        return CellMoments.concatenate([CellMoments.from_moments(p) for p in parts]).total()


@dataclass(frozen=True, eq=False)
class CellMoments:
    """Moments of many cells, each with its place in the scene.

    Attributes
    ----------
    keys : (cells, 2) int64 ndarray
        Row and column of each cell, in cells from the scene's origin.
    n : (cells,) ndarray
    mean : (cells, variables) ndarray
    comoment : (cells, variables, variables) ndarray
    minimum, maximum : (cells, variables) ndarray
    rest : (cells, variables) ndarray
        The mean of a cell is mean + rest, held in two doubles.
    """

    keys: Places
    n: Float64
    mean: Float64
    comoment: Float64
    minimum: Float64
    maximum: Float64
    rest: Float64

    @classmethod
    def from_moments(cls, m: Moments) -> CellMoments:
        """One cell, at the origin."""
        return cls(np.zeros((1, 2), np.int64), *(np.array([getattr(m, f)], np.float64) for f in _CELL_FIELDS[1:]))

    @classmethod
    def without_pixels(cls, keys: Places, variables: int) -> CellMoments:
        """Cells at these places, to be filled."""
        n, mean, comoment = (np.zeros((len(keys), *shape)) for shape in ((), (variables,), (variables, variables)))
        return cls(keys, n, mean, comoment, np.full_like(mean, np.inf), np.full_like(mean, -np.inf), mean.copy())

    @classmethod
    def concatenate(cls, parts: Iterable[CellMoments]) -> CellMoments:
        """All cells of the parts; cells may repeat."""
        parts = list(parts)
        if not parts:
            raise InputError("no moments to merge: give at least one part.")
        if len({p.mean.shape[1] for p in parts}) > 1:
            raise InputError("moments of different numbers of variables cannot be merged.")
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in _CELL_FIELDS))

    def by_place(self) -> CellMoments:
        """The same cells in row-major order."""
        return self.where(np.lexsort((self.keys[:, 1], self.keys[:, 0])))

    def joined(self, levels: int) -> CellMoments:
        """Cells of one row merged in groups of 2**levels that follow each other from the scene's edge on; by place.

        Within a group, neighbours are merged first. A group that was merged before stays as it is.
        """
        out = self.by_place()
        for level in range(1, levels + 1):
            out = out._pairs_merged(level)
        return out

    def _pairs_merged(self, level: int) -> CellMoments:
        """Cells in order; of those whose columns differ in the last `level` bits alone, neighbours are merged."""
        groups = self.keys >> np.array([0, level])
        same = np.append((groups[1:] == groups[:-1]).all(axis=1), False)
        places = np.arange(len(same))
        run = places - np.maximum.accumulate(np.where(np.append(True, ~same[:-1]), places, 0))
        first = np.flatnonzero(same & (run % 2 == 0))
        if not len(first):
            return self
        both = self.where(np.stack([first, first + 1], axis=1).ravel())
        n, mean, rest, comoment = _merge_neighbours(both.n, both.mean, both.rest, both.comoment)
        low = np.minimum(both.minimum[::2], both.minimum[1::2])
        high = np.maximum(both.maximum[::2], both.maximum[1::2])
        merged = CellMoments(both.keys[::2], n, mean, comoment, low, high, rest)
        alone = np.ones(len(self.n), np.bool_)
        alone[first] = alone[first + 1] = False
        return CellMoments.concatenate([merged, self.where(alone)]).by_place()

    def where(self, chosen: npt.NDArray[Any]) -> CellMoments:
        """Some of the cells, by index or by mask."""
        return CellMoments(*(getattr(self, name)[chosen] for name in _CELL_FIELDS))

    def total(self) -> Moments:
        """Merge all cells, neighbours in their present order first."""
        if not len(self.n):
            return CellMoments.without_pixels(np.zeros((1, 2), np.int64), self.mean.shape[1]).total()
        n, mean, rest, comoment = self.n, self.mean, self.rest, self.comoment
        with np.errstate(over="ignore", invalid="ignore"):
            while len(n) > 1:
                n, mean, rest, comoment = _merge_neighbours(n, mean, rest, comoment)
        low, high = self.minimum.min(axis=0), self.maximum.max(axis=0)
        return Moments(int(n[0]), mean[0], comoment[0], low, high, rest[0])


_CELL_FIELDS = ("keys", "n", "mean", "comoment", "minimum", "maximum", "rest")


def cell_moments(
    block: npt.NDArray[Any],
    mask: Mask | None = None,
    *,
    origin: tuple[int, int] = (0, 0),
    cell: int = CELL,
    compiled: bool = False,
    part: tuple[int, int] | None = None,
) -> CellMoments:
    """Moments of a block, cell by cell.

    Parameters
    ----------
    block : (variables, rows, columns) ndarray
        Any real dtype; pixels with a NaN or infinity in any variable are left out.
    mask : (rows, columns) bool ndarray, optional
        True where a pixel counts.
    origin : (int, int)
        Row and column of the block's first pixel in the scene [pixel].
    cell : int
        Side of a cell [pixel].
    compiled : bool
        Use the compiled kernel: twice as fast, but it takes half a second to load. The last bits may differ.
    part : (int, int), optional
        First row to use and the row after the last, on edges of cells or of the block: as a slice of the block, which
        would have to be copied.

    Returns
    -------
    CellMoments
        Only cells that hold at least one pixel.

    Notes
    -----
    Assumes nothing of the data. Costs one read of the block and (variables + 1)^2 / 2 multiply-adds a pixel.
    """
    block, mask, (skip, stop) = _checked(block, mask, part)
    if block.dtype not in (np.float32, np.float64) or not block.flags.c_contiguous:
        dtype = block.dtype if block.dtype == np.float32 else np.float64
        block = np.ascontiguousarray(block[:, skip:stop], dtype)
        mask = mask[skip:stop]
        origin, skip, stop = (origin[0] + skip, origin[1]), 0, stop - skip
    first = ((origin[0] + skip) // cell, origin[1] // cell)
    last = (-(-(origin[0] + stop) // cell), -(-(origin[1] + block.shape[2]) // cell))
    shape = (max(last[0] - first[0], 0), max(last[1] - first[1], 0))
    cells = CellMoments.without_pixels(np.argwhere(np.ones(shape, np.bool_)) + np.array(first), len(block))
    if block.size:
        start = (origin[0] - first[0] * cell, origin[1] - first[1] * cell)  # of the block, in the first cell
        reduce = _reduce_cells
        if compiled:
            from ._moments_kernels import reduce_cells as reduce
        reduce(
            block, np.ascontiguousarray(mask), *start, cell, shape[1], *(getattr(cells, f) for f in _CELL_FIELDS[1:])
        )
    used = cells.n > 0
    return cells if used.all() else cells.where(used)


def moments(block: npt.NDArray[Any], mask: Mask | None = None, *, compiled: bool = False) -> Moments:
    """Moments of all valid pixels of a block.

    Parameters
    ----------
    block : (variables, rows, columns) or (variables, pixels) ndarray
    mask : (rows, columns) bool ndarray, optional
        True where a pixel counts.
    compiled : bool
        As `cell_moments`.

    Examples
    --------
    >>> import numpy as np
    >>> float(moments(np.array([[1.0, 2.0, 6.0, np.nan]])).mean[0])
    3.0
    """
    block = np.asarray(block)
    if block.ndim == 2:
        block = block[:, None, :]
        mask = None if mask is None else np.asarray(mask).reshape(1, -1)
    return cell_moments(block, mask, compiled=compiled).total()


def thinned(mask: Mask, origin: tuple[int, int], share: int) -> Mask:
    """One masked pixel in `share`, chosen by a hash of its place in the scene alone: the same in any tiling."""
    if share <= 1:
        return mask
    rows = np.arange(origin[0], origin[0] + mask.shape[0])[:, None]
    columns = np.arange(origin[1], origin[1] + mask.shape[1])
    return np.asarray(mask & in_share(rows, columns, share))


def in_share(rows: npt.NDArray[np.integer], columns: npt.NDArray[np.integer], share: int) -> Mask:
    """Whether `thinned` keeps a pixel of this row and column; of a share that divides another, it keeps all of the
    other's."""
    mixed = rows.astype(np.uint64) * np.uint64(0x9E3779B1) + columns.astype(np.uint64) * np.uint64(0x85EBCA77)
    mixed ^= mixed >> np.uint64(15)
    mixed *= np.uint64(0x2C1B3C6D)
    mixed ^= mixed >> np.uint64(12)
    return np.asarray(mixed % np.uint64(share) == 0)


def _reduce_cells(
    block: npt.NDArray[Any], mask: Mask, row0: int, col0: int, cell: int, across: int,
    n: Float64, mean: Float64, comoment: Float64, low: Float64, high: Float64, rest: Float64,
) -> None:  # fmt: skip
    """Fill the per-cell arrays from a block whose first pixel lies at (row0, col0) within the first cell.

    A mask of no size is True everywhere.
    """
    down, right = np.divmod(np.arange(len(n)), across)
    starts = np.stack([down * cell - row0, right * cell - col0], axis=1)
    ends = np.stack([np.maximum(starts, 0), np.minimum(starts + cell, block.shape[1:])], axis=2)
    windows = [(slice(*rows), slice(*columns)) for rows, columns in ends.tolist()]
    whole = np.array([bool(mask[window].all()) for window in windows])
    with np.errstate(over="ignore", invalid="ignore"):  # whoever uses it looks whether it is finite
        each = (n, mean, comoment, low, high, rest)
        for i in [*np.flatnonzero(~whole), *_reduce_quickly(block, ends, np.flatnonzero(whole), each)]:
            x = np.array(block[:, *windows[i]], np.float64).reshape(len(block), -1)
            valid = np.isfinite(x).all(axis=0)
            x = x[:, valid & mask[windows[i]].ravel() if mask.size else valid]
            low[i], high[i] = x.min(axis=1, initial=np.inf), x.max(axis=1, initial=-np.inf)
            count = n[i] = x.shape[1]
            if not count:
                continue
            shift = _typical(x[:, 0], x[:, count // 2], x[:, -1])
            x -= shift[:, None]
            centre = x.mean(axis=1)
            x -= centre[:, None]
            left = x.mean(axis=1)
            mean[i], rest[i] = _two_sum(shift, centre + left)
            comoment[i] = x @ x.T - count * np.outer(left, left)


def _reduce_quickly(block: npt.NDArray[Any], ends: Places, cells: Places, results: tuple[Float64, ...]) -> Places:
    """Fill the per-cell arrays for cells of which every pixel counts, in one pass about a pixel of the cell.

    Returns which cells ask for more care: pixels that are not finite, or a pixel too far from the mean.
    """
    if not len(cells):
        return cells
    ends = ends[cells]
    n, total, comoment, low, high = (np.empty((len(cells), *a.shape[1:])) for a in results[:-1])
    first, middle, last = np.moveaxis(block[:, *_typical_places(ends)].astype(np.float64), 1, 0)
    shift, bands = _typical(first, middle, last).T.copy(), len(block)
    room = np.empty(0)
    for some, rows, columns in _runs(ends.tolist(), max(_ROOM // (bands * CELL * CELL), 1)):
        given = block[:, rows, columns]
        given = given.reshape(bands, given.shape[1], some.stop - some.start, -1).transpose(2, 0, 1, 3)
        room = room if room.size >= given.size else np.empty(given.size)
        x = room[: given.size].reshape(*given.shape[:2], -1)
        np.copyto(x.reshape(given.shape), given)
        n[some] = x.shape[2]
        np.minimum.reduce(x, axis=2, out=low[some])
        np.maximum.reduce(x, axis=2, out=high[some])
        np.subtract(x, shift[some, :, None], out=x)
        np.add.reduce(x, axis=2, out=total[some])
        np.matmul(x, x.transpose(0, 2, 1), out=comoment[some])
    centre = total / n[:, None]
    squares = np.diagonal(comoment, axis1=1, axis2=2)
    bad = ~np.isfinite(high - low) | ~(total * centre <= _NEAR_MEAN * squares)
    comoment -= total[:, :, None] * centre[:, None, :]
    centre, rest = _two_sum(shift, centre)
    for whole, part in zip(results, (n, centre, comoment, low, high, rest), strict=True):
        whole[cells] = part
    return np.asarray(cells[bad.any(axis=1)])


def _runs(ends: list[list[list[int]]], most: int) -> Iterator[tuple[slice, slice, slice]]:
    """At most so many cells that lie side by side and are alike: which, and the rows and columns of all of them.

    Threads hand each other Python's lock at every call of NumPy: few long calls let them work at the same time.
    """
    first = 0
    for i, (rows, (left, right)) in enumerate(ends):
        if i + 1 - first == most or ends[i + 1 : i + 2] != [[rows, [right, 2 * right - left]]]:
            yield slice(first, i + 1), slice(*rows), slice(ends[first][1][0], right)
            first = i + 1


def _typical_places(ends: Places) -> tuple[Places, Places]:
    """Rows and columns of the first, middle and last pixel of each cell, (3, cells)."""
    (top, left), (bottom, right) = ends[:, :, 0].T, ends[:, :, 1].T
    size = (bottom - top) * (right - left)
    rows, columns = np.divmod(np.stack([0 * size, size // 2, size - 1]), right - left)
    return rows + top, columns + left


def _typical(a: Float64, b: Float64, c: Float64) -> Float64:
    """The middle one of three values: exactly that of a constant, and not a single stray pixel."""
    return np.asarray(np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c)))


def _two_sum(a: Float64, b: Float64) -> tuple[Float64, Float64]:
    """a + b, rounded, and what rounding dropped (Knuth)."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def _merge_neighbours(n: Float64, mean: Float64, rest: Float64, comoment: Float64) -> tuple[Float64, ...]:
    """Merge cells 0 and 1, 2 and 3, ... (Chan, Golub and LeVeque); an odd one at the end is left."""
    even = len(n) // 2 * 2
    a, b = slice(0, even, 2), slice(1, even, 2)
    total = n[a] + n[b]
    away = (mean[b] - mean[a]) + (rest[b] - rest[a])
    weight = n[a] * n[b] / total
    merged = comoment[a] + comoment[b] + away[:, :, None] * away[:, None, :] * weight[:, None, None]
    new_mean, new_rest = _two_sum(mean[a], away * (n[b] / total)[:, None] + rest[a])
    ends = ((total, n), (new_mean, mean), (new_rest, rest), (merged, comoment))
    return tuple(np.concatenate([new, old[even:]]) for new, old in ends)


def _checked(
    block: npt.NDArray[Any], mask: Mask | None, part: tuple[int, int] | None
) -> tuple[npt.NDArray[Any], Mask, tuple[int, int]]:
    """Block, mask (of no size: everywhere) and the rows to use, or an InputError."""
    block = np.asarray(block)
    if block.ndim != 3:
        raise InputError(f"expected a (band, row, column) array, got shape {block.shape}.")
    if mask is None:
        mask = np.ones((0, 0), np.bool_)
    elif mask.shape != block.shape[1:]:
        raise InputError(f"mask has shape {mask.shape}, but rows and columns of the block are {block.shape[1:]}.")
    return block, mask, part or (0, block.shape[1])
