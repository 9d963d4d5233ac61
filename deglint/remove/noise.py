"""Noise and robust standard deviation of a band."""

from collections.abc import Sequence

import cv2
import numpy as np

from ..moments import Mask
from ..scene import FloatArray
from .detrend import detrend

FAINT = 10.0
"""Glint at which the error that kernels leave, a tenth of the glint, equals the noise [standard deviation of noise]."""
LEAST_NOISE, HIDDEN_NOISE = 1e-6, 0.01
"""Relative to the strongest glint: noise below `LEAST_NOISE` is hidden by rounding (a step of 16 bits is 1.5e-5), and
is set to `HIDDEN_NOISE`, with which the strongest glint has a weight of 0.01 (see `faint_weight`)."""


def spread(values: FloatArray) -> float:
    """Robust standard deviation about zero: 1.4826 times the median absolute value."""
    return 1.4826 * float(np.median(np.abs(values))) if values.size else 0.0


def noise(planes: Sequence[FloatArray], inside: Sequence[Mask]) -> float:
    """Standard deviation of a band's noise [unit of the band], above 0, from second differences along columns.

    planes, inside : finite values of the band and a mask for each tile, (row, column); the masks' darker half is used

    After Immerkaer (1996), Computer Vision and Image Understanding 64, 300-302, doi:10.1006/cviu.1996.0060.
    """
    differences, means = [], []
    for plane, mask in zip(planes, inside, strict=True):
        second = (plane[:-2, 1:-1] + plane[2:, 1:-1] - 2 * plane[1:-1, 1:-1]) / np.float32(np.sqrt(6))
        differences.append(second[mask[1:-1, 1:-1]])
        means.append(cv2.blur(plane, (3, 3))[1:-1, 1:-1][mask[1:-1, 1:-1]])
    second, mean = np.concatenate(differences), np.concatenate(means)
    darker = second[mean <= np.median(mean)] if mean.size else second
    return max(spread(darker), 1e-12)


def faint_weight(nir: FloatArray, sample: Mask) -> FloatArray:
    """Weight (row, column) of each pixel in a fit of kernels: variance of noise divided by variance of the residual.

    .. math:: 1 / (1 + (h / (k s))^2)

    The residual is noise plus an error proportional to the glint h. h is the NIR minus its local mean, s the standard
    deviation of noise in the NIR (`HIDDEN_NOISE` times the largest absolute h if rounding hides the noise), k is
    `FAINT`. Outside the sample the weight is 0.
    """
    high = detrend(nir[None], sample)[0]
    sigma = noise([np.where(sample, nir, 0).astype(np.float32)], (sample,))
    strongest = float(np.nanmax(np.abs(high), initial=0.0))
    sigma = sigma if sigma > LEAST_NOISE * strongest else HIDDEN_NOISE * strongest
    with np.errstate(invalid="ignore"):
        return np.asarray(np.nan_to_num(1 / (1 + (high / (FAINT * sigma)) ** 2)), np.float32)
