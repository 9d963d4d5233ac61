"""Error against the truth, and ROC curves of global RX."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import background
from ..roc import Roc
from ..rx import detector, score

Float64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

VISIBLE_BANDS = 5  # COASTAL to RED: the bands whose error counts


def rms_error(image: npt.NDArray[Any], truth: npt.NDArray[Any], columns: slice = slice(None)) -> float:
    """Root mean square over the visible bands of RMSE / median(truth), in percent of the water level.

    Parameters
    ----------
    image, truth : (band, row, column) ndarray
        In the same unit; the first `VISIBLE_BANDS` bands count.
    columns : slice
        Columns in which the error is computed. The water level, median(truth), is computed from all columns.

    Examples
    --------
    >>> level = np.full((5, 4, 4), 2.0)
    >>> rms_error(1.1 * level, level).__round__(6)
    10.0
    """
    truth = np.asarray(truth, np.float64)[:VISIBLE_BANDS]
    away = (np.asarray(image, np.float64)[:VISIBLE_BANDS] - truth)[:, :, columns]
    level = np.median(truth, axis=(1, 2))
    each = np.sqrt((away**2).mean(axis=(1, 2))) / level
    return float(100 * np.sqrt((each**2).mean()))


def rx_scores(image: npt.NDArray[Any], sample: Mask, covariance: str = "empirical") -> Float64:
    """Squared Mahalanobis distance of every pixel from the pixels of the mask `sample`, over all bands."""
    image = np.asarray(image, np.float64)
    found = background.fit(image, mask=sample, covariance=covariance, threads=1)
    return np.asarray(score(image, detector("rx", found)), np.float64)


def curves(scores: Float64, kinds: npt.NDArray[np.integer[Any]], numbers: Sequence[int]) -> list[Roc]:
    """ROC curve of each kind in `numbers` against the background; `kinds`: 0 for background, below 0 does not count."""
    return [Roc.of(scores, kinds == n, (kinds == 0) | (kinds == n)) for n in numbers]
