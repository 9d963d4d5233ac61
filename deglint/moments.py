"""Mean and covariance of pixels in one stable, mergeable pass: the statistics kernel of the project.

A block is cut into square cells that are aligned with the *scene's* origin, not with the tile's. Every cell is
reduced by itself and the cells are merged in row-major order, so the result is the same to the bit whatever tiles
the scene was read in (as long as tile edges fall on cell edges) and however many threads worked on it.

Inside a cell every row is reduced in two passes while it is in cache - first its mean, then the moments about that
mean - and merged into the cell with the update of Chan, Golub and LeVeque (1983), means held in two doubles. No large
sums of squares are ever formed, so an offset of 1e8 or one extreme pixel costs no digits.

References
----------
Chan, Golub, LeVeque (1983), "Algorithms for computing the sample variance", The American Statistician 37, 242-247,
doi:10.1080/00031305.1983.10483115.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import InputError

Float64 = npt.NDArray[np.float64]
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
        Sum over pixels of (x - mean)(x - mean)^T.
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

    keys: npt.NDArray[np.int64]
    n: Float64
    mean: Float64
    comoment: Float64
    minimum: Float64
    maximum: Float64
    rest: Float64

    @classmethod
    def from_moments(cls, m: Moments) -> CellMoments:
        """One cell, at the origin."""
        return cls(
            np.zeros((1, 2), np.int64),
            np.array([float(m.n)]),
            m.mean[None],
            m.comoment[None],
            m.minimum[None],
            m.maximum[None],
            m.rest[None],
        )

    @classmethod
    def concatenate(cls, parts: Iterable[CellMoments]) -> CellMoments:
        """All cells of the parts; cells may repeat."""
        parts = list(parts)
        if not parts:
            raise InputError("no moments to merge: give at least one part.")
        if len({p.mean.shape[1] for p in parts}) > 1:
            raise InputError("moments of different numbers of variables cannot be merged.")
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in _FIELDS))

    def by_place(self) -> CellMoments:
        """The same cells in row-major order."""
        order = np.lexsort((self.keys[:, 1], self.keys[:, 0]))
        return CellMoments(*(getattr(self, name)[order] for name in _FIELDS))

    def total(self) -> Moments:
        """Merge all cells in their present order."""
        n, mean, rest, comoment, low, high = _kernels()[1](
            self.n, self.mean, self.rest, self.comoment, self.minimum, self.maximum
        )
        return Moments(int(n), mean, comoment, low, high, rest)


_FIELDS = ("keys", "n", "mean", "comoment", "minimum", "maximum", "rest")


def cell_moments(
    block: npt.NDArray[Any],
    mask: npt.NDArray[np.bool_] | None = None,
    *,
    origin: tuple[int, int] = (0, 0),
    cell: int = CELL,
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

    Returns
    -------
    CellMoments
        Only cells that hold at least one pixel.

    Notes
    -----
    Assumes nothing of the data. Costs one read of the block and (variables + 1)^2 / 2 multiply-adds a pixel.
    """
    block = _as_block(block)
    variables, rows, columns = block.shape
    if mask is None:
        mask = np.ones((rows, columns), np.bool_)
    elif mask.shape != (rows, columns):
        raise InputError(f"mask has shape {mask.shape}, but the block has {rows} rows and {columns} columns.")
    first = (origin[0] // cell, origin[1] // cell)
    last = (-(-(origin[0] + rows) // cell), -(-(origin[1] + columns) // cell))
    shape = (max(last[0] - first[0], 0), max(last[1] - first[1], 0))
    count = shape[0] * shape[1]
    n = np.zeros(count)
    mean = np.zeros((count, variables))
    rest = np.zeros((count, variables))
    comoment = np.zeros((count, variables, variables))
    low = np.full((count, variables), np.inf)
    high = np.full((count, variables), -np.inf)
    if block.size:
        _kernels()[0](
            block, np.ascontiguousarray(mask), origin[0] - first[0] * cell, origin[1] - first[1] * cell,
            cell, shape[1], n, mean, rest, comoment, low, high,
        )  # fmt: skip
    keys = np.stack(np.divmod(np.arange(count, dtype=np.int64), max(shape[1], 1)), axis=1) + np.array(first)
    used = n > 0
    return CellMoments(*(x[used] for x in (keys, n, mean, comoment, low, high, rest)))


def moments(block: npt.NDArray[Any], mask: npt.NDArray[np.bool_] | None = None) -> Moments:
    """Moments of all valid pixels of a block.

    Parameters
    ----------
    block : (variables, rows, columns) or (variables, pixels) ndarray
    mask : (rows, columns) bool ndarray, optional
        True where a pixel counts.

    Examples
    --------
    >>> import numpy as np
    >>> moments(np.array([[1.0, 2.0, 4.0, np.nan]])).mean
    array([2.33333333])
    """
    block = np.asarray(block)
    if block.ndim == 2:
        block = block[:, None, :]
        mask = None if mask is None else np.asarray(mask).reshape(1, -1)
    cells = cell_moments(block, mask)
    if not len(cells.n):
        v = block.shape[0]
        return Moments(0, np.zeros(v), np.zeros((v, v)), np.full(v, np.inf), np.full(v, -np.inf), np.zeros(v))
    return cells.total()


def _as_block(block: npt.NDArray[Any]) -> npt.NDArray[Any]:
    block = np.asarray(block)
    if block.ndim != 3:
        raise InputError(f"expected a (band, row, column) array, got shape {block.shape}.")
    if block.dtype not in (np.float32, np.float64):
        block = block.astype(np.float64)
    return np.ascontiguousarray(block)


@cache
def _kernels() -> tuple[Any, Any]:
    """Compile (or load from numba's cache) on first use: importing numba takes half a second."""
    from . import _moments_kernels as kernels

    return kernels.reduce_cells, kernels.merge_cells
