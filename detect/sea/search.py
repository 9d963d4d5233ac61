"""Search the sea for objects; compute the threshold for a false-alarm rate, and the number of false objects per km2.

Clutter, such as waves, has heavy-tailed scores, and the ships are in the tail. Candidates are connected pixels of high
score. Those larger and brighter than clutter are confirmed objects; a generalised Pareto distribution is fitted to the
others. Small objects cannot be distinguished from clutter, and count as false alarms: rates are not underestimated.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from deglint.errors import FitError

from ..arrays import Array, Float32, Float64, Mask
from ..background import as_image
from ..objects import Object, find, find_among, label
from ..threshold import Tail, Threshold, excess_at, fit_pareto, from_tail, survival
from .model import SeaModel, fit, score
from .region import ALONGSIDE, ATTACHED, ELONGATION, Classes, SeaRule, hull, rectangle, region

LOW = 1.5  # candidates exceed this multiple of the 90 % score quantile of water, as 1 to 3 % of the sea do
_CONFIRMED = (9.0, 3.0)
"""A confirmed object has a peak above this multiple of the 90 % quantile of water. The first is for coarse pixels,
where wakes and clouds reach half of it; the second is for pixels smaller than a boat."""
_LARGE_OBJECTS = (40, 12)
"""Minimum size of a confirmed object [pixel]. The first is for coarse pixels: a blurred ship of 100 m by 30 m, with
pixels of 10 m. The second is for pixels smaller than a boat: one boat. Waves and sparkle are smaller."""
_BODY = 60
"""With pixels smaller than a boat, a candidate of at least this size is confirmed, also with a low peak [pixel]. Noise
that is averaged over 5 by 5 pixels has clumps of up to about 50 pixels."""
_SMALLEST_KEPT = 12.6  # minimum area of a confirmed object, where pixels are smaller than a boat [m2]: a disc of 4 m
_WIDE = 4.0
"""Minimum width of a round object at half of its peak [pixel]. The blur makes a boat 2 to 3 pixels wide there. A ship
that is wider is several times as long as wide."""
_CONTOURS = (1 / 2, 1 / 4, 1 / 8)
"""Fractions of the peak at which a round object is not elongated. A ship is elongated at one of them: at the first if
it is evenly bright, at a lower one if it has a bright superstructure or a wake."""
_LEAST = 50  # a distribution is fitted to more than this number of peaks above `Clutter.low`
_LEAST_SURVIVAL = 1e-200  # lower limit of the fitted fraction of peaks above the highest peak, which is a divisor
_MOST_RATE = 1e6  # false objects per km2 that are reported for a score too low for a candidate (at most `Clutter.low`)


@dataclass(frozen=True, eq=False)
class Clutter:
    """Scores of the sea without confirmed objects, and the distribution of the peaks of unconfirmed candidates.

    A generalised Pareto distribution of the peaks above `low` extrapolates beyond the highest peak.
    """

    tail: Tail  # highest scores of the sea without the pixels of confirmed objects
    low: float  # score that the pixels of candidates exceed
    peaks: Float64  # (objects,): `Object.score_top` of unconfirmed candidates, ascending
    area: float  # area of the searched sea [km2]; NaN where the size of a pixel is not known
    confirmed: int  # number of confirmed objects
    confirmed_pixels: int  # number of their pixels
    shape: float  # shape of the distribution [1]; NaN where no distribution could be fitted
    scale: float  # scale of the distribution [unit of the scores]
    large: tuple[int, float]  # large objects have at least so many pixels, and exceed this score
    large_share: float  # (n + 1) / (all + 1): n of all unconfirmed candidates have at least `large[0]` pixels
    clouds: frozenset[tuple[int, int]]  # peaks (row, column) of round candidates, see `_round`

    @property
    def fitted(self) -> bool:
        """Whether a distribution is fitted to the peaks; if not, their ranks are used."""
        return math.isfinite(self.shape)

    def false_per_km2(self, score: float, pixels: int = 1) -> float:
        """Expected number of false objects per km2 with a `score_top` of at least `score`; NaN if `area` is NaN.

        Few false objects are large. If `pixels` is at least `large[0]` and `score` exceeds `large[1]`, the number is
        multiplied by `large_share`. Pass `pixels`, the size of the object, only if the object has the shape of a ship,
        because slicks, shoals and clouds are large, too. By default the size is ignored.
        """
        if not self.area > 0:
            return math.nan
        if pixels >= self.large[0] and score > self.large[1]:
            return self.large_share * self.false_per_km2(score)
        above = len(self.peaks) - int(np.searchsorted(self.peaks, score, side="left"))
        if score <= self.low and above == len(self.peaks):
            return _MOST_RATE
        if above or not self.fitted:
            return max(above, 1) / self.area  # every candidate that is not confirmed counts as false
        highest, this = survival(np.array([self.peaks[-1], score]) - self.low, self.shape, self.scale).tolist()
        return min(this / max(highest, _LEAST_SURVIVAL), 1.0) / self.area

    def score_at(self, false_per_km2: float) -> float:
        """The `score_top` that `false_per_km2` false objects per km2 exceed; `area` must not be NaN."""
        count = len(self.peaks)
        wanted = false_per_km2 * self.area
        if wanted >= count:
            return self.low
        if wanted >= 1 or not self.fitted:
            return float(self.peaks[count - 1 - math.floor(wanted)])
        highest = max(float(survival(self.peaks[-1] - self.low, self.shape, self.scale)), _LEAST_SURVIVAL)
        return self.low + excess_at(1 / (wanted * highest), self.shape, self.scale)

    def threshold(self, pfa: float) -> Threshold:
        """Threshold on scores that the fraction `pfa` of the clutter pixels exceeds, from `from_tail`."""
        found = from_tail(self.tail, pfa)
        notes, left_out = [*found.notes], f"{self.confirmed} ({self.confirmed_pixels} pixels)"
        if pfa * self.tail.n < 1:
            notes.append(f"the rate is extrapolated: {pfa:g} is less than one pixel of {self.tail.n}")
        if self.confirmed:
            notes.append(f"large, bright objects are left out of the threshold's fit, not of the results: {left_out}")
        return replace(found, notes=tuple(notes))


def clutter_of(tail: Tail, candidates: Sequence[Object], q90: float, *, area: float, fine: bool = False) -> Clutter:
    """Separate confirmed objects from clutter, and fit a distribution to the clutter.

    `tail` holds the highest scores of the searched sea; `area` is its area [km2]. Candidates are connected pixels above
    `LOW` times `q90`, the 90 % quantile of the score over water; large, bright ones are confirmed (see `_CONFIRMED`,
    `_LARGE_OBJECTS`, `_BODY`). If `fine` (pixels smaller than a boat) is False, round candidates are not clutter.
    """
    peak = _CONFIRMED[fine] * q90
    kept = _SMALLEST_KEPT * tail.n / (1e6 * area) if fine and area > 0 else 0.0
    large, body = max(_LARGE_OBJECTS[fine], kept), max(_BODY, kept) if fine else math.inf
    sure, rest = list[Object](), list[Object]()
    for o in candidates:
        (sure if (o.size >= large and o.score_max > peak) or o.size >= body else rest).append(o)
    if sure:
        tail = _without(tail, np.concatenate([o.scores for o in sure]))
    low, pixels = LOW * q90, sum(o.size for o in sure)
    clouds = frozenset(o.peak for o in candidates if not fine and _round(o, low))
    rest = [o for o in rest if o.peak not in clouds]
    peaks = np.sort([o.score_top for o in rest]).astype(np.float64)
    shape = scale = math.nan
    excess = peaks[peaks > low] - low
    if len(excess) > _LEAST and excess[0] < excess[-1]:
        with suppress(FitError):
            shape, scale = fit_pareto(excess)
    share = (sum(o.size >= _LARGE_OBJECTS[fine] for o in rest) + 1) / (len(rest) + 1)
    return Clutter(tail, low, peaks, area, len(sure), pixels, shape, scale, (_LARGE_OBJECTS[fine], peak), share, clouds)


def _round(found: Object, low: float) -> bool:
    """Whether a candidate is wide, and not elongated, at each contour (`_CONTOURS`); False if all lie below `low`."""
    if found.score_max * max(_CONTOURS) <= low:
        return False
    values = np.zeros(found.footprint.shape)
    values[found.footprint] = found.scores
    for share in _CONTOURS:
        parts = label(values > share * found.score_max)
        length, width, _angle = rectangle(parts == parts.flat[values.argmax()])
        if width < _WIDE or length >= ELONGATION * width:
            return False
    return True


def _without(tail: Tail, taken: Array) -> Tail:
    """The tail without the scores `taken`: each is removed as often as it occurs; `n` decreases by their number."""
    ascending = tail.values[::-1]
    gone = np.sort(taken[taken > ascending[0]]).astype(ascending.dtype)
    at = np.searchsorted(ascending, gone) + np.arange(len(gone)) - np.searchsorted(gone, gone)
    return Tail(tail.n - len(taken), np.delete(ascending, at)[::-1], tail.keep)


class Rated(NamedTuple):
    """An object with measures of its reliability."""

    found: Object
    kind: str  # "afloat", "round" or "alongside" a quay; "anomaly" for detectors that do not distinguish them
    rate: float  # expected number of false objects per km2 that are as conspicuous; NaN if not known
    real: float  # probability that the object is real; NaN if not known


def rated_objects(found: Sequence[Object], clutter: Clutter, strata: int = 1) -> list[Rated]:
    """`Rated` objects by ascending `rate`; each rate is multiplied by `strata`, the number of kinds of objects.

    A "round" object may be a cloud, so all other round candidates (`Clutter.clouds`) count as false in its rate.
    """
    found = sorted(found, key=lambda o: -o.score_top)
    kinds = ["round" if o.peak in clutter.clouds else "afloat" for o in found]
    sizes = [o.size if hull(*rectangle(o.footprint)[:2], o.size) else 1 for o in found]
    rates = np.array([clutter.false_per_km2(o.score_top, size) for o, size in zip(found, sizes, strict=True)])
    rates += [(len(clutter.clouds) - 1) / clutter.area * (kind == "round") for kind in kinds]
    order = np.argsort(rates, kind="stable").tolist()
    # q-value: smallest fraction of false objects at a threshold that includes the object (Storey 2002,
    # doi:10.1111/1467-9868.00346)
    false = np.minimum(rates[order] * clutter.area / np.arange(1, len(rates) + 1), 1.0)
    real = 1 - np.minimum.accumulate(false[::-1])[::-1]
    return [Rated(found[i], kinds[i], strata * float(rates[i]), p) for i, p in zip(order, real.tolist(), strict=True)]


@dataclass(frozen=True, eq=False)
class Search:
    """Result of a search of the sea.

    Attributes
    ----------
    scores : (row, column) ndarray of float32
        Distance from the water around a pixel [standard deviation]; NaN on land, next to land, and where not valid.
    classes : (row, column) ndarray of uint8
        Class of each pixel, from `detect.sea.region`.
    objects : list of dict
        One per object, highest score first: label, score, pixels, area_m2, row, column (mean of pixels), false_per_km2.
    threshold, clutter, model : Threshold, Clutter, SeaModel
        Threshold of the scores for the requested rate; `clutter` converts a score to the expected number of false
        objects per km2; `model` holds the statistics of the water.
    """

    scores: Float32
    classes: Classes
    objects: list[dict[str, Any]]
    threshold: Threshold
    clutter: Clutter
    model: SeaModel


def score_scene(
    image: Array, water: Mask | None = None, *, pixel: float = 10.0, pfa: float = 1e-4, side: str | None = None
) -> Search:
    """Search the sea in an image for ships, boats and swimmers.

    Parameters
    ----------
    image : (band, row, column) array
        NaN, or hidden in a numpy masked array, where not valid. The visible bands of a deglinted scene give the best
        results.
    water : (row, column) array of bool, optional
        Water mask, False on land and at floating objects; by default, all valid pixels are water.
    pixel : float
        Side of a pixel [m].
    pfa : float
        Requested false-alarm rate per pixel.
    side : str, optional
        Anomalies to find: "bright" or "both" (bright and dark); by default "both" if `pixel` is below 5 m.

    Returns
    -------
    Search
        Scores and objects. Ships alongside a quay, and holes of the mask next to land or an edge, are no objects.

    Raises
    ------
    InputError
        Shape or type of the image, the shape of the mask, `pixel`, `pfa` or `side` is not allowed.
    NoWaterError
        The image has fewer than 100 pixels of water.

    Examples
    --------
    >>> sea = np.random.default_rng(0).normal(100, 3, (3, 200, 200))
    >>> sea[:, 50:53, 60:70] += 60
    >>> [(round(o["row"]), round(o["column"])) for o in score_scene(sea).objects[:1]]
    [(51, 65)]
    """
    values, shown = as_image(image)
    values = values if shown is None else np.where(shown, values, np.nan)
    _, inside = as_image(values, water)
    valid = np.asarray(np.isfinite(values).all(axis=0))
    mask = valid if inside is None else inside & valid
    classes = region(mask, SeaRule(pixel), valid)
    model = fit([(values, classes)], pixel=pixel, side=side)
    scores = score(values, classes, model)
    searched = np.where(classes == ALONGSIDE, np.float32(np.nan), scores)
    tail = Tail.of(searched, Tail.keep_for(max(pfa, 0.04), searched.size))
    candidates = find(searched > LOW * model.q90, scores)
    clutter = clutter_of(tail, candidates, model.q90, area=tail.n * (pixel * pixel) / 1e6, fine=model.fine)
    threshold = clutter.threshold(pfa)
    searched[classes == ATTACHED] = np.nan
    rows, columns = np.nonzero(searched > min(LOW * model.q90, threshold.value))
    found = find_among(rows, columns, searched[rows, columns], above=threshold.value, pixel_area=pixel * pixel)
    records = [
        {"label": o.label, "score": o.score_max} | o.measures | {"false_per_km2": rate}
        for o, _kind, rate, _real in sorted(rated_objects(found, clutter), key=lambda r: r.found.label)
    ]
    return Search(scores, classes, records, threshold, clutter, model)
