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
    Sums are float64, taken afresh for every pixel in a fixed order, not carried along: they do not drift, and
    a tile gives to the bit what the whole image gives. Rounding is below 1e-14 of the values: 1e-6 at an
    offset of 1e8. Cost: 15 ns per pixel and band in rows that hold a sample pixel, next to none elsewhere.

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
    from ._detrend_kernel import subtract_local_mean

    values = block if block.dtype in (np.float32, np.float64) else np.asarray(block, np.float64)
    out = np.empty(block.shape, np.float64)
    subtract_local_mean(values, sample, size // 2, out)
    return out
