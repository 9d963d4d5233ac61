"""Take the local mean off the bands, so that a slope sees waves and not the colour of the water.

Over deep water the slope of a band on the NIR is set by glint, but slow changes of colour leak into it. The
same slope fitted after a local mean is taken off every band is nearly the same all over the sea. Arrays only.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..scene import FloatArray

Float64Array = npt.NDArray[np.float64]

SIZE = 15
"""Side of the square over which the mean is taken, by default [pixel]."""


_VELTKAMP = 2.0**27 + 1


def detrend_halo(size: int = SIZE) -> int:
    """Pixels that `detrend` needs around a tile."""
    return size // 2


def detrend(block: FloatArray, mask: npt.NDArray[np.bool_] | None = None, size: int = SIZE) -> Float64Array:
    """Subtract from every band its mean over the sample pixels in a square around each sample pixel.

    .. math:: y_i = x_i - \\frac{\\sum_{j \\in W(i)} m_j x_j}{\\sum_{j \\in W(i)} m_j}

    Parameters
    ----------
    block : (band, row, column) ndarray
        Any unit; NaN is not valid. A tile needs `size // 2` pixels around it, cropped afterwards.
    mask : (row, column) ndarray of bool, optional
        The sample; all pixels by default. Pixels where any band is not finite are left out.
    size : int
        Side of the square, odd, 3 or more [pixel].

    Returns
    -------
    (band, row, column) ndarray of float64
        NaN outside the sample; 0 where a sample pixel has no neighbour.

    Raises
    ------
    InputError
        `size` is even or below 3, or the shapes do not match.

    Notes
    -----
    A sum over 15 pixels is put together from sums over 8, 4, 2 and 1 of them, always the same ones for the same pixel:
    it does not drift as a running sum does, and a tile gives to the bit what the whole image gives. The sum is taken
    off as many times the pixel as it has terms, and divided then; float64 goes in two halves of its bits. So nothing is
    rounded but the result where the values of a square differ less than some 2^20 times: an offset of 1e8 costs no
    digits. Cost: some 40 ns per pixel and band, twice that for float64.

    Examples
    --------
    >>> ramp = np.arange(25.0).reshape(1, 1, 25)
    >>> float(detrend(ramp, size=3)[0, 0, 12])
    0.0
    """
    if block.ndim != 3:
        raise InputError(f"a block must be (band, row, column); got an array of shape {block.shape}")
    if size < 3 or size % 2 == 0:
        raise InputError(f"size of the detrending square must be odd and at least 3; got {size}")
    if mask is not None and mask.shape != block.shape[1:]:
        raise InputError(f"the mask has shape {mask.shape}, the bands have {block.shape[1:]}")
    sample = np.isfinite(block).all(axis=0)
    if mask is not None:
        sample &= mask
    out = np.empty(block.shape)
    padded = np.zeros((block.shape[1] + 2 * (size // 2), block.shape[2] + 2 * (size // 2)))
    inner = padded[size // 2 : size // 2 + block.shape[1], size // 2 : size // 2 + block.shape[2]]
    inner[...] = sample
    count = np.maximum(_box_sum(padded, size), 1.0)
    outside = ~sample
    for band, result in zip(block, out, strict=True):
        np.copyto(inner, band)
        inner[outside] = 0.0
        low = _lower_bits(padded) if block.dtype == np.float64 else None
        np.subtract(inner * count, _box_sum(padded, size), out=result)
        if low is not None:
            inside = low[size // 2 : size // 2 + block.shape[1], size // 2 : size // 2 + block.shape[2]]
            result += inside * count - _box_sum(low, size)
        result /= count
        result[outside] = np.nan
    return out


def _lower_bits(values: Float64Array) -> Float64Array:
    """Take the lower half of the bits off values, which keep 26 of them (Veltkamp's split), and return it."""
    with np.errstate(over="ignore", invalid="ignore"):
        apart = values * _VELTKAMP
        upper = apart - (apart - values)
    low = values - upper
    values[...] = upper
    return np.asarray(low)


def _box_sum(padded: Float64Array, size: int) -> Float64Array:
    """Sums over size x size pixels, for each place where the square fits."""
    down = _run_sum(padded, size)
    return _run_sum(down.T, size).T


def _run_sum(values: Float64Array, size: int) -> Float64Array:
    """Sums over `size` neighbours along the first axis, from sums over powers of two."""
    length = len(values) - size + 1
    total: Float64Array | None = None
    offset, power, part = 0, 1, values
    while True:
        if size & power:
            piece = part[offset : offset + length]
            total = piece.copy() if total is None else np.add(total, piece, out=total)
            offset += power
        if 2 * power > size:
            assert total is not None  # size is odd
            return total
        part = part[:-power] + part[power:]
        power *= 2
