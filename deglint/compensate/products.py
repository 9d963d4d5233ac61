"""A PSF as a sum of columns times rows, which is correlated with many times faster than with the whole of it.

Arrays only: (row, column), one band. A tile with its halo gives to the bit what the whole image gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import Window
from .psf import PSF

Float32Array = npt.NDArray[np.float32]

UNEVEN = 1e-6
"""Sums are taken in pairs where taps differ by no more from either end, of the largest."""
WIDEST = 1024
"""Most columns that are worked on at a time, so that the rows that are kept stay in the processor's cache."""
CACHE_LINE = 64
"""Rows begin with one [byte]: vectors that lie across two are loaded at half the speed."""


@dataclass(frozen=True, eq=False)
class Products:
    """P and its transpose, each a sum of columns times rows.

    Attributes
    ----------
    taps : (2, 2, product, tap) float32 ndarray
        Of P and of its transpose: columns and rows. The products are an even number, the last of them perhaps 0.
    lopsided : bool
        Taps are not the same from either end, and sums cannot be taken in pairs.
    """

    taps: Float32Array
    lopsided: bool

    @property
    def radius(self) -> int:
        """Of the taps [pixel]."""
        return self.taps.shape[3] // 2


@lru_cache(maxsize=256)
def products(psf: PSF, rank: int = 2) -> Products:
    """The nearest sum of so many products to a PSF, as that of each band is used for tile after tile."""
    factors = np.stack(psf.factors(rank), axis=1)
    factors = np.pad(factors, ((0, 0), (0, factors.shape[1] % 2), (0, 0)))
    turned = factors[..., ::-1]
    uneven, largest = (np.abs(some).max(axis=(1, 2)) for some in (factors - turned, factors))
    lopsided = bool((uneven > UNEVEN * largest).any())
    both = [turned, factors] if lopsided else [(factors + turned) / 2] * 2
    return Products(np.stack(both).astype(np.float32), lopsided)


def by_products(
    band: npt.NDArray[Any],
    kernels: Products,
    iterations: int,
    within: Window,
    *,
    pedestal: float = 0.0,
    sound: bool = False,
    out: Float32Array | None = None,
) -> Float32Array:
    """Richardson-Lucy (`deglint.compensate.sharpen`) with a sum of products; or, of no iterations, correlation with P.

    Parameters
    ----------
    band : (row, column) ndarray
        Mirrored at its edges; what is not finite has no share. It stays what it is, or, of no iterations, is NaN.
    kernels : Products
    iterations : int
        0 for the correlation alone.
    within : ((row0, row1), (col0, col1))
        The rows and columns that are wanted; what lies around them is looked at.
    pedestal : float
        Added before and taken off after; 0 of no iterations.
    sound : bool
        Every number is known to be finite, and is not looked at for that.
    out : (row, column) float32 ndarray, optional
        For the result, contiguous.

    Returns
    -------
    (row, column) ndarray of float32
    """
    from ._sharpen_kernels import TAPS, plan_for, sharpen

    (row, rows), (column, columns) = ((first, last - first) for first, last in within)
    found = np.empty((rows, columns), np.float32) if out is None else out
    if not found.size:
        return found
    stages = max(2 * iterations, 1)
    halo = stages * kernels.radius
    top = max(row - halo, 0)
    part = np.ascontiguousarray(band[top : row + rows + halo], np.float32).view()
    part.flags.writeable = False  # as it may be or not, and there would be compiled code for either
    some, lopsided = not (sound or all_finite(part)), kernels.lopsided
    wide = -(-columns // -(-columns // WIDEST))  # strips that are alike: each is worked on in full
    plan, height = plan_for(wide + 2 * halo, kernels.radius, kernels.taps.shape[2], stages, some, lopsided)
    room = _room(height, plan.pitch)
    room[TAPS, : kernels.taps.size] = kernels.taps.ravel()
    for begin in range(0, columns, wide):
        sharpen(
            part, row - halo - top, column - halo, np.float32(pedestal), room, plan, True if lopsided else None, some,
            found, begin, min(begin + wide, columns),
        )  # fmt: skip
    if some:
        original = np.asarray(band[row : row + rows, column : column + columns], np.float32)
        np.copyto(found, original if iterations else np.float32(np.nan), where=~np.isfinite(original))
    return found


def all_finite(block: npt.NDArray[np.float32]) -> bool:
    """Every number is finite; a sum tells, unless it overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(block.sum()) or np.isfinite(block).all())


def _room(rows: int, columns: int) -> Float32Array:
    """An array, not set, that begins with a line of the processor's cache."""
    whole = np.empty(rows * columns + CACHE_LINE // 4, np.float32)
    first = -whole.ctypes.data % CACHE_LINE // 4
    return whole[first : first + rows * columns].reshape(rows, columns)
