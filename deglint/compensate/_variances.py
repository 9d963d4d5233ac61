"""Lines through variances."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Float64 = npt.NDArray[np.float64]


def weighted_line(place: Float64, squares: Float64, count: Float64) -> tuple[float, float]:
    """The line through variances of groups, neither part below 0; groups count by their relative errors.

    Parameters
    ----------
    place, squares, count : (group,) float64 ndarray
        Where each group is, its mean square, and of how many numbers that is.
    """
    mean = float((count * squares).sum() / count.sum())
    if mean == 0:
        return 0.0, 0.0
    fixed, growing = mean, 0.0
    for _ in range(4):  # the variance of a mean square goes with the square of the variance
        w = count / np.maximum((fixed + growing * place) / mean, 1e-3) ** 2
        middle, height = (w * place).sum() / w.sum(), (w * squares).sum() / w.sum()
        power = (w * (place - middle) ** 2).sum()
        growing = max(float((w * (place - middle) * (squares - height)).sum() / power), 0.0) if power > 0 else 0.0
        fixed = float(height - growing * middle)
        if fixed < 0:
            fixed, growing = 0.0, float((w * place * squares).sum() / (w * place * place).sum())
    return fixed, growing
