"""Gaussian smoothing of small tables, without loading a library of filters for it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

TRUNCATED = 4.0
"""Standard deviations after which the kernel is cut off."""


def gaussian(values: npt.NDArray[np.float64], sigma: float) -> npt.NDArray[np.float64]:
    """Smoothed along every axis; beyond the edges values go on as they are there.

    Parameters
    ----------
    values : ndarray
    sigma : float
        Standard deviation [cell].

    Returns
    -------
    ndarray
        What `scipy.ndimage.gaussian_filter` gives with mode "nearest", to the bit: pairs of cells are added from the
        farthest inwards.

    Examples
    --------
    >>> gaussian(np.array([0.0, 0.0, 1.0, 0.0, 0.0]), 0.5).round(3).tolist()
    [0.0, 0.107, 0.787, 0.107, 0.0]
    """
    reach = int(TRUNCATED * sigma + 0.5)
    away = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 / (sigma * sigma) * away**2)
    weights /= weights.sum()
    out = np.asarray(values, np.float64)
    for axis in range(out.ndim):
        along = np.moveaxis(out, axis, -1)
        padded = np.concatenate([along[..., :1]] * reach + [along] + [along[..., -1:]] * reach, axis=-1)
        size = along.shape[-1]
        total = along * weights[reach]
        for i in range(reach):
            total += (padded[..., i : i + size] + padded[..., 2 * reach - i : 2 * reach - i + size]) * weights[i]
        out = np.moveaxis(total, -1, axis)
    return np.ascontiguousarray(out)
