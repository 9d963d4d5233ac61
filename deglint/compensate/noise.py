"""Noise, spread and size of what varies in a band: scalars of a sample."""

from __future__ import annotations

import numpy as np

from ..remove.noise import noise, spread
from .state import Sample

__all__ = ["clump_width", "noise", "spread"]

WIDEST_CLUMP = 32
"""Longest distance at which glint is correlated that is looked for [pixel]."""


def clump_width(sample: Sample, band: int) -> int:
    """Width of a clump of glint [pixel]: twice the lag at which its autocorrelation falls below a half."""
    import cv2
    import scipy.fft

    total = np.zeros(WIDEST_CLUMP)
    for state in sample.states:
        plane = state.raw[band]
        high = plane - cv2.blur(plane, (4 * WIDEST_CLUMP + 1,) * 2)
        power = np.abs(scipy.fft.rfft2(high)) ** 2
        lags = scipy.fft.irfft2(power, s=high.shape)
        n = min(WIDEST_CLUMP, *high.shape)
        total[:n] += lags[0, :n] + lags[:n, 0]
    below = total < total[0] / 2
    return 2 * int(np.argmax(below)) if below.any() else 2 * WIDEST_CLUMP
