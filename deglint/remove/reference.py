"""The reference (NIR or SWIR) of a band, with ships, surf and land replaced by the water around them.

A ship is as bright in the NIR as glint, and would be removed with it. Glint has nearly the same strength all over the
sea. So a pixel that exceeds the mean of the water around it by more than glint does elsewhere is not glint, and is
replaced by that mean. Land, nodata and the mixed pixels along their edges are replaced, too.

Local means are computed from sums of integers, which are exact: any division into tiles gives the same result.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..moments import CELL, Float64, Mask
from ..morphology import box_sum, grown, squares
from ..scene import FloatArray
from .detrend import LOCAL_MEAN
from .noise import noise

LEAST_OPEN = 0.15  # least share of open water in a square of `CELL` pixels that is used for a fit
QUARTILE, FACTOR = 25, 2.5
"""A pixel may exceed its local mean by `FACTOR` times the `QUARTILE`-th percentile, over squares, of the largest excess
in each. Ships increase the maxima of few squares, those of a port, while a long tail of sparkle is in every square."""
OFTEN = 99.0
"""Percentile of the excess over the local mean. Above it are more pixels than ships have, even in a port. If it exceeds
the limit, the bright pixels are glint in a part of the scene."""
LEAST_LOCAL = 8  # fewest pixels of water for a local mean with which a pixel is compared [pixel]
NOISE_SIDE = 5  # side of the squares whose variance is compared with that of noise [pixel]: as the largest kernel
GRAINS = 65535  # largest quantised value (grain), for exact sums; the sum of 225 of them stays below 2^31


@dataclass(frozen=True, slots=True)
class ReferenceRule:
    """Rule that says which pixels of a reference band exceed the water around them by more than glint does."""

    band: int  # 0-based band that serves as reference
    limit: float  # largest excess of glint above the mean of the water around it [unit of the band]
    least: float  # smaller values cannot exceed the water around them by more than `limit` [unit of the band]
    low: float  # for local means, values are quantised: (value - low) / step as integers [unit of the band]
    step: float  # quantisation step, see `low` [unit of the band]
    edge: int = 1  # width of the mixed pixels around anything that is not open water [pixel]
    noise: float = 0.0  # standard deviation of the noise that `clean` reduces [unit of the band]; 0: not reduced

    @property
    def halo(self) -> int:
        """Pixels that `clean` needs beside a tile: for 3 local means, for 3 times `edge`, and for the noise filter."""
        return 3 * (LOCAL_MEAN // 2) + 3 * self.edge + (NOISE_SIDE // 2 if self.noise else 0)


def fit_reference(
    tiles: Iterable[tuple[FloatArray, Mask]], band: int, *, edge: int = 1, sparkle: bool = False, smooth: bool = False
) -> ReferenceRule:
    """Make the rule of a reference: measure on open water by how much glint exceeds the mean of the water around it.

    tiles : values and mask of open water away from shores, (row, column); if no water is wide enough, no limit is set
    band : 0-based band of the reference
    edge : width of the mixed pixels along shores and ships [pixel]; 2 for a band of half the resolution
    sparkle : True if pixels may resolve sparkle, with few very bright flashes (`largest_glint`)
    smooth : whether `clean` reduces the noise of the reference (`_smoothed`)
    """
    tiles = [(values, sample & np.isfinite(values)) for values, sample in tiles]
    found = [values[sample] for values, sample in tiles if sample.any()]
    low = min((float(v.min()) for v in found), default=0.0)
    high = max((float(v.max()) for v in found), default=0.0)
    rule = ReferenceRule(band, np.inf, np.inf, low, (high - low) / GRAINS or 1.0, edge)
    tops, means, excesses = [], [], []
    for values, sample in tiles:
        mean, count = _local_means(_grains(values, rule), sample, rule)
        excess = np.where(sample & (count >= LEAST_LOCAL), values - mean, -np.inf)
        excesses.append(excess[np.isfinite(excess)])
        means.append(float(mean[sample].min(initial=np.inf)))
        tops += [top for s in open_squares(sample) if np.isfinite(top := float(excess[s].max()))]
    if not tops:
        return rule
    limit = largest_glint(tops, np.concatenate(excesses), sparkle=sparkle)
    s = noise([np.where(i, v, 0).astype(np.float32) for v, i in tiles], [i for _, i in tiles]) if smooth else 0.0
    return ReferenceRule(band, limit, min(means) + limit, low, rule.step, edge, s)


def largest_glint(tops: Sequence[float], excess: FloatArray, *, sparkle: bool) -> float:
    """Largest excess of glint over the local mean, from the excess of pixels (pixel,) and the maxima `tops` (square,).

    See `QUARTILE`. With `sparkle`, or if only a part of the scene has glint (`OFTEN`), it is at least the excess of one
    pixel in a million, by a power law through the 99th and 99.9th percentile of the excess.
    """
    limit = FACTOR * float(np.percentile(tops, QUARTILE))
    often, seldom = np.maximum(np.percentile(excess, [OFTEN, 99.9]), np.finfo(np.float32).tiny)
    if sparkle or often > limit:
        limit = max(limit, min(float(seldom * (seldom / often) ** 3), float(np.finfo(np.float32).max)))
    return limit


def open_squares(sample: Mask) -> Iterator[tuple[slice, slice]]:
    """Yield (row, column) slices of the squares, `CELL` pixels wide, that the sample fills by `LEAST_OPEN` or more."""
    return (square for square in squares(sample.shape, CELL) if sample[square].mean() >= LEAST_OPEN)


def clean(values: FloatArray, water: Mask, rule: ReferenceRule) -> tuple[FloatArray, Mask | None]:
    """Replace pixels of a reference that are no open water, or too bright for glint, by the mean of the water around.
    The noise of the reference is then reduced if `rule.noise` is not 0 (`_smoothed`).

    values : (row, column), the band of the reference, not modified; a tile needs `rule.halo` more pixels on every side
    water : (row, column), True over water; ships may be True or False

    Returns the new reference, (row, column), or `values` itself if nothing is changed; it is 0 where there is no water
    around. Also returns a mask of open water too bright for glint, with the pixels next to it; None if there is none.
    """
    out, over = _replaced(values, water, rule)
    return _smoothed(out, rule) if rule.noise else out, over


def _smoothed(values: FloatArray, rule: ReferenceRule) -> FloatArray:
    r"""Shift a reference R, (row, column), toward its local mean m, and fully where it varies no more than noise does.

    .. math:: R' = m + \max(0, 1 - s^2 / v) (R - m)

    m and v are mean and variance in `NOISE_SIDE` x `NOISE_SIDE` pixels, s is `rule.noise`. Without this, kernels
    add the noise of the NIR to the bands where water has no glint; or they suppress the noise, and leave more glint.

    Lee (1980), IEEE Transactions on Pattern Analysis and Machine Intelligence 2, 165-168,
    doi:10.1109/TPAMI.1980.4766994.
    """
    grains, side = _grains(values, rule), (NOISE_SIDE, NOISE_SIDE)
    mean = cv2.boxFilter(grains, cv2.CV_32S, side, normalize=False) / NOISE_SIDE**2
    variance = np.maximum(cv2.sqrBoxFilter(grains, cv2.CV_64F, side) - mean**2, 1.0)  # that of rounding is below 1
    weight = np.maximum(1 - (rule.noise / rule.step) ** 2 / variance, 0).astype(values.dtype)
    mean = (mean * rule.step + rule.low).astype(values.dtype)
    return mean + weight * (values - mean)


def _replaced(values: FloatArray, water: Mask, rule: ReferenceRule) -> tuple[FloatArray, Mask | None]:
    """The result of `clean`, which has the same arguments, before its noise is reduced."""
    water = water & np.isfinite(values)
    bright = water & (values > rule.least)
    everywhere = bool(water.all())
    if everywhere and not bright.any():
        return values, None
    kept = inner = water if everywhere else water & ~grown(~water, 2 * rule.edge + 1)
    grains, over = _grains(values, rule), None
    bright &= inner
    for _ in range(2 if bright.any() else 0):  # again without these pixels: a ship brightens the mean around itself
        mean, count = _local_means(grains, kept, rule, bright)
        found = np.zeros_like(bright)
        found[bright] = (count >= LEAST_LOCAL) & (values[bright] > mean + rule.limit)
        if not found.any():  # then nothing is found in the second round
            break
        over = grown(found, 2 * rule.edge + 1) & inner
        kept = inner & ~over
    if everywhere and over is None:
        return values, None
    away, out = ~kept, values.copy()
    mean, count = _local_means(grains, kept, rule, away)
    around = np.where(count > 0, mean, 0)
    if not count.all():  # narrow water is all edge: its mean includes the edge
        mean, wider = _local_means(grains, water, rule, away)
        around = np.where((count == 0) & (wider > 0), mean, around)
    out[away] = around
    return out, over


def _grains(values: FloatArray, rule: ReferenceRule) -> npt.NDArray[np.uint16]:
    """Values of a reference, quantised to integers by the rule's `low` and `step`; undefined where not finite."""
    counted = values - values.dtype.type(rule.low)
    counted /= values.dtype.type(rule.step)
    with np.errstate(invalid="ignore"):
        return np.rint(np.clip(counted, 0, GRAINS, out=counted), out=counted).astype(np.uint16)


def _local_means(
    grains: npt.NDArray[np.uint16], kept: Mask, rule: ReferenceRule, at: Mask | slice = slice(None)
) -> tuple[Float64, npt.NDArray[np.int32]]:
    """Mean [unit of the band] of the `kept` pixels in the square around each pixel, and the number of these pixels, for
    the pixels that the mask `at` selects (all by default). The mean of no pixels is `rule.low`.
    """
    total = box_sum(grains if kept.all() else grains * kept, LOCAL_MEAN)[at]
    count = box_sum(kept.view(np.uint8), LOCAL_MEAN)[at]
    return np.asarray(total / np.maximum(count, 1) * rule.step + rule.low), count
