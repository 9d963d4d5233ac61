"""False alarms of the sea: per pixel for a requested rate, and per square kilometre for an object's score.

Clutter is heavy-tailed, and the ships themselves sit in the tail. What is larger and brighter than clutter can be is
taken out first; a generalised Pareto law is fitted to what remains. Small unconfirmed objects stay: nobody can
distinguish them from clutter, and to count them as false alarms is the safe side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint.errors import FitError, InputError

from .. import pareto
from ..objects import Object
from ..threshold import Tail, Threshold, from_tail

Scores = npt.NDArray[Any]
LOW = 1.5
"""Candidates exceed this many 90 % quantiles of water: one to three percent of the sea."""
_CONFIRMED = (9.0, 3.0)
"""90 % quantiles that a peak must exceed to be no clutter: at coarse pixels, where wakes and clouds reach half of it,
and at pixels finer than a boat."""
_LARGE_OBJECTS = (40, 12)
"""Least pixels of what is confirmed, likewise: a ship of 100 m by 30 m at 10 m, with its blur; a boat. Waves and
sparkle are smaller."""
_BODY = 60
"""Pixels of a candidate that is no clutter whatever its peak, where pixels are finer than a boat: noise that is
averaged over 5 by 5 pixels has clumps of up to some 50."""
_SMALLEST_KEPT = 12.6
"""Area that it has at least there, whatever its peak [m2]: what removal leaves of a clump of glint is narrower than the
smallest object that removal keeps, a disc of 4 m."""
_LEAST = 50
"""Least peaks to fit a law to."""
_MOST_RATE = 1e6
"""Expected false objects per km2 of what is not worth a number."""


@dataclass(frozen=True, eq=False)
class Clutter:
    """The tail of what is not confirmed as an object.

    Attributes
    ----------
    tail : Tail
        Scores of clutter pixels.
    low : float
        Score from which on peaks are counted.
    peaks : (objects,) ndarray
        `score_top` of unconfirmed candidates, ascending.
    area : float
        Of the sea that was searched [km2]; NaN where pixels have no size.
    confirmed, confirmed_pixels : int
        Objects that were taken out, and their pixels.
    shape, scale : float
        Of the generalised Pareto law of the peaks above `low`, which extrapolates beyond the highest of them; NaN where
        they are too few or too alike.
    large : (int, float)
        Pixels and peak score from which on an object is confirmed where it has a ship's shape, too.
    large_share : float
        Share of the unconfirmed candidates that are as large.
    """

    tail: Tail
    low: float
    peaks: npt.NDArray[np.float64]
    area: float
    confirmed: int
    confirmed_pixels: int
    shape: float
    scale: float
    large: tuple[int, float] = (1, math.inf)
    large_share: float = 1.0

    @property
    def fitted(self) -> bool:
        """Whether a law describes the peaks; else their own ranks are used."""
        return math.isfinite(self.shape)

    def false_per_km2(self, score: float, pixels: int = 1) -> float:
        """Expected false objects per km2 whose `score_top` is at least so high.

        Of these only the share of large candidates is as large as an object that is large and bright: give its pixels
        where it has a ship's shape (slicks, shoals and clouds are large, too, and are no clutter of pixels).
        """
        rate = self._of_peak(score)
        return rate * self.large_share if pixels >= self.large[0] and score > self.large[1] else rate

    def _of_peak(self, score: float) -> float:
        if not self.area > 0:
            return math.nan
        above = len(self.peaks) - int(np.searchsorted(self.peaks, score, side="left"))
        if score <= self.low and above == len(self.peaks):
            return _MOST_RATE
        if above or not self.fitted:
            return max(above, 1) / self.area  # every candidate that is not confirmed counts as false
        y, least = ((x - self.low) / self.scale for x in (score, self.peaks[-1]))
        ratio = (1 + self.shape * y) / (1 + self.shape * least) if abs(self.shape) > 1e-9 else 0.0
        share = ratio ** (-1 / self.shape) if ratio > 0 else math.exp(least - y)
        return min(share, 1.0) / self.area

    def score_at(self, false_per_km2: float) -> float:
        """`score_top` that so many false objects per km2 are expected to exceed.

        Raises
        ------
        InputError
            The area of the sea is not known, or the rate is not positive.
        """
        if not false_per_km2 > 0:
            raise InputError(f"false-per-km2: allowed is above 0, got {false_per_km2}.")
        if not self.area > 0:
            raise InputError("false-per-km2 needs the size of a pixel, and the scene has no CRS. Give --pfa.")
        count = len(self.peaks)
        wanted = false_per_km2 * self.area
        if wanted >= count:
            return self.low
        if wanted >= 1 or not self.fitted:
            return float(self.peaks[count - 1 - math.floor(wanted)])
        y = (self.peaks[-1] - self.low) / self.scale
        if abs(self.shape) < 1e-9:
            return float(self.peaks[-1] - self.scale * math.log(wanted))
        return float(self.low + self.scale * ((1 + self.shape * y) * wanted**-self.shape - 1) / self.shape)

    def threshold(self, pfa: float) -> Threshold:
        """Score that a share `pfa` of the clutter exceeds."""
        note = f"large, bright objects are left out of the fit: {self.confirmed} ({self.confirmed_pixels} pixels)"
        found = from_tail(self.tail, pfa)
        if pfa * self.tail.n < 1:
            one = f"less than one pixel of {self.tail.n}"
            found = replace(found, notes=(*found.notes, f"the rate is extrapolated: {pfa:g} is {one}"))
        return replace(found, notes=(*found.notes, note)) if self.confirmed else found


def clutter_of(tail: Tail, candidates: Sequence[Object], q90: float, *, area: float, fine: bool = False) -> Clutter:
    """Separate clutter from what is confirmed, and fit its tail.

    Parameters
    ----------
    tail : Tail
        Scores of the searched sea.
    candidates : sequence of Object
        Connected pixels above `LOW` times `q90`.
    q90 : float
        90 % quantile of water.
    area : float
        Of the searched sea [km2].
    fine : bool
        Whether pixels are finer than a boat.
    """
    peak = _CONFIRMED[fine] * q90
    kept = _SMALLEST_KEPT * tail.n / (1e6 * area) if fine and area > 0 else 0.0
    large, body = max(_LARGE_OBJECTS[fine], kept), max(_BODY, kept) if fine else math.inf
    sure = [(o.size >= large and o.score_max > peak) or o.size >= body for o in candidates]
    taken = [o.scores for o, known in zip(candidates, sure, strict=True) if known]
    pixels = sum(len(s) for s in taken)
    if pixels:
        tail = _without(tail, np.concatenate(taken))
    low = LOW * q90
    peaks = np.sort([o.score_top for o, known in zip(candidates, sure, strict=True) if not known]).astype(np.float64)
    shape = scale = math.nan
    if len(peaks) > _LEAST:
        excess = peaks[peaks > low] - low
        with suppress(FitError):
            if excess[0] < excess[-1]:
                shape, scale, _moments = pareto.fit(excess)
    rest = [o.size >= _LARGE_OBJECTS[fine] for o, known in zip(candidates, sure, strict=True) if not known]
    share = (sum(rest) + 1) / (len(rest) + 1)
    return Clutter(tail, low, peaks, area, sum(sure), pixels, shape, scale, (_LARGE_OBJECTS[fine], peak), share)


def _without(tail: Tail, taken: Scores) -> Tail:
    """The tail less some of its scores, each once."""
    kept = taken[taken >= tail.values[-1]] if len(tail.values) else taken[:0]
    values, counts = np.unique(np.concatenate([tail.values, kept.astype(tail.values.dtype)]), return_counts=True)
    of_taken = np.zeros(len(values), np.int64)
    where, gone = np.unique(kept.astype(tail.values.dtype), return_counts=True)
    of_taken[np.searchsorted(values, where)] = gone
    left = np.repeat(values, np.maximum(counts - 2 * of_taken, 0))[::-1]
    return Tail(tail.n - len(taken), left, tail.keep)
