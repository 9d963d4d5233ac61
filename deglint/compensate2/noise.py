"""Noise, spread and size of what varies in a band: scalars of a sample."""

from __future__ import annotations

import numpy as np

from .state import Float32, Mask, Sample

WIDEST_CLUMP = 32
"""Longest distance at which glint is correlated that is looked for [pixel]."""


def spread(values: Float32) -> float:
    """Robust standard deviation about zero: 1.4826 times the median absolute value."""
    return 1.4826 * float(np.median(np.abs(values))) if values.size else 0.0


def noise(planes: list[Float32], inside: tuple[Mask, ...]) -> float:
    """Standard deviation of a band's noise at the radiance of water.

    From second differences down the columns in the darker half (after Immerkaer 1996,
    doi:10.1006/cviu.1996.0060).
    """
    import cv2

    differences, means = [], []
    for plane, mask in zip(planes, inside, strict=True):
        second = (plane[:-2, 1:-1] + plane[2:, 1:-1] - 2 * plane[1:-1, 1:-1]) / np.float32(np.sqrt(6))
        differences.append(second[mask[1:-1, 1:-1]])
        means.append(cv2.blur(plane, (3, 3))[1:-1, 1:-1][mask[1:-1, 1:-1]])
    second, mean = np.concatenate(differences), np.concatenate(means)
    return max(spread(second[mean <= np.median(mean)]), 1e-12)


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
