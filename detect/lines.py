"""RX line by line: each line is compared with the lines before, in bounded memory, for push-broom sensors.

Mean and covariance are exponential averages over the previous lines. A line is scored first, and then added to the
averages without its pixels with high scores (see `_OUT`), so that a target does not become part of the background. If
at least half of the pixels of a line have high scores, the background has changed, and the whole line is added.
"""

from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from deglint.errors import InputError

from .arrays import Float32
from .background import check_range
from .covariance import ridged, whitener

LINES = 64  # default time constant of the statistics [line]
_FIRST = 4  # minimum number of pixels per band in the statistics, before a line is scored
_OUT = 5.0  # squared distance per band above which pixels are excluded: 5e-4 of normal pixels with 4 bands
_LINE_RIDGE = 1e-6  # fraction of each band's variance that is added, as collinear bands have a singular covariance


class LineScorer:
    """RX scorer for successive lines of an image; it stores the mean and covariance of the lines before.

    Parameters
    ----------
    lines : int
        Time constant of the averages [line], 1 or more: a new line multiplies all older weights by 1 - 1 / `lines`.

    Examples
    --------
    >>> scorer = LineScorer()
    >>> lines = np.random.default_rng(0).normal(50, 2, (100, 4, 200))
    >>> lines[80, :, 30] += 40
    >>> scores = np.stack([scorer.score(line) for line in lines])
    >>> tuple(int(i) for i in np.unravel_index(np.nanargmax(scores), scores.shape))
    (80, 30)
    """

    def __init__(self, lines: int = LINES) -> None:
        if not lines >= 1:
            raise InputError(f"lines: allowed is 1 or more, got {lines}.")
        self._keep = 1 - 1 / lines
        self._weight = 0.0
        self._mean, self._second = np.zeros(0), np.zeros((0, 0))

    def score(self, line: npt.ArrayLike) -> Float32:
        """Score a line relative to the lines before; then add it to the averages, except pixels with high scores.

        Parameters
        ----------
        line : (band, column) array
            NaN, infinity, or hidden in a numpy masked array, in any band, where a pixel is not valid.

        Returns
        -------
        (column,) ndarray of float32
            Squared Mahalanobis distances. NaN where not valid, and until the averages contain 4 pixels per band.

        Raises
        ------
        InputError
            The line is not (band, column), the number of bands changes, or a value of a valid pixel is beyond +-1e150.
        """
        values = np.ma.filled(np.ma.asarray(line, np.float64), np.nan)
        if values.ndim != 2 or len(self._mean) not in (0, len(values)):
            raise InputError(f"line must be (band, column), always of the same bands, got shape {values.shape}.")
        if not len(self._mean):
            self._mean, self._second = np.zeros(len(values)), np.zeros((len(values), len(values)))
        valid = np.isfinite(values).all(axis=0)
        out = np.full(values.shape[1], np.nan, np.float32)
        taken = values if valid.all() else values[:, valid]
        check_range(taken)
        if self._weight >= _FIRST * len(values):
            white = whitener(ridged(self._second, _LINE_RIDGE)) @ (taken - self._mean[:, None])
            with np.errstate(over="ignore"):  # infinity becomes the largest score
                found = np.einsum("ij,ij->j", white, white)
            out[valid] = np.minimum(found, np.finfo(np.float32).max)
            inside = found <= _OUT * len(values)
            if not inside.all() and 2 * np.count_nonzero(inside) > inside.size:  # else the background has changed
                taken = taken[:, inside]
        if count := taken.shape[1]:
            centre = taken.mean(axis=1)
            away = taken - centre[:, None]
            second = away @ away.T / count
            self._weight *= self._keep
            share = count / (self._weight + count)
            step = centre - self._mean
            self._mean = self._mean + share * step
            self._second = (1 - share) * (self._second + share * np.outer(step, step)) + share * second
            self._weight += count
        return out


def score_lines(lines: Iterable[npt.ArrayLike], memory: int = LINES) -> Iterator[Float32]:
    """Yield the scores, (column,), of successive lines; see `LineScorer.score`.

    Parameters
    ----------
    lines : iterable of (band, column) array
    memory : int
        Time constant of the exponential averages [line].
    """
    yield from map(LineScorer(memory).score, lines)
