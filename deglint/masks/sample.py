"""Find the deep-water sample: dark, even water with the strongest glint, far from all that is not water."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import NamedTuple, Self

import numpy as np

from ..errors import FitError, NoWaterError
from ..moments import Float64, Mask
from ..morphology import box_sum, grown, opened
from ..scene import FloatArray
from .surface import Roles, WaterRule, thinned, valid_for, water

SIZE = 15  # side of the square for local statistics of water [pixel], as of local means in the fit (`LOCAL_MEAN`)
DISTANCES = (10, 5, 2, 0)
"""Distances of the sample from everything that is not water [pixel]; the first that leaves `ENOUGH` pixels is used."""
SHARES, ENOUGH = (0.25, 0.5, 1.0), 3000
"""Shares of the dark, even water, taken from the strongest glint; the first that gives `ENOUGH` pixels is used."""
MAX_RESIDUAL = 3.0
"""Upper limit of the local visible variance that the NIR does not explain, as a multiple of its typical value."""
BIMODAL = 0.8  # separability (see `_otsu`) from which on there are two kinds of water (a normal distribution has 0.64)
MANY = 50_000  # most squares (one around each pixel) that determine the limits; they overlap, so more add nothing
SHORE = 9
"""A pixel must lie in a square of water of this side, so that shores, ships and mixed pixels are excluded [pixel]."""
CLEANING = 7  # window of the morphological opening that makes the sample compact [pixel]
REMEDY = "Pass --sample, or --mask FILE, with a piece of deep water."


@dataclass(frozen=True, slots=True)
class SampleRule:
    """Criteria of the deep-water sample, as plain numbers.

    The NIR, and a weighted sum of the visible bands (the visible sum), are converted to integers, (value - centre) /
    step, rounded. The unit of these integers is called a grain. Their sums over squares are exact, and so do not depend
    on the tile. If `r_squared` is near 0, the bands share no glint (calm water, or bands that are not simultaneous).
    """

    water: WaterRule
    weights: tuple[float, ...]  # of each band of `roles.visible` in the visible sum [1/unit]
    centre: tuple[float, float]  # of the NIR [unit of the NIR] and of the visible sum [1]
    step: tuple[float, float]  # of the NIR [unit of the NIR] and of the visible sum [1]
    distance: int = 0  # from everything that is not water [pixel]
    slope: float = 0.0  # of the visible sum against the NIR, to subtract glint from local means [grain/grain]
    level: float = np.inf  # upper limit of the local mean of the visible sum, glint subtracted [grain]
    residual: float = np.inf  # typical local variance of the visible sum that the NIR does not explain [grain^2]
    variance: float = 1.0  # typical local variance of the NIR [grain^2]
    least_variance: float = 0.0  # lower limit of the local NIR variance [grain^2]
    r_squared: float = np.nan  # share of the local visible variance in the sample that the NIR explains, 0..1
    glint: float = np.nan  # local standard deviation of the NIR in the sample [unit of the NIR]
    pixels: int = 0  # sample pixels in the fitted blocks
    share: float = 0.0  # sample pixels over valid pixels in these blocks, 0..1

    @property
    def halo(self) -> int:
        """Width of the margin that `deep_water` needs around a tile [pixel]."""
        return self.water.halo + max(self.distance, SIZE // 2) + CLEANING - 1

    def numbers(self) -> dict[str, object]:
        """Values for the JSON sidecar of an output: the halo, and every field except `water`."""
        return {k: v for k, v in asdict(self).items() if k != "water"} | {"halo": self.halo}


class _Local(NamedTuple):
    """Statistics of water in a square around each pixel, (row, column) or (pixel,) [step of `SampleRule`]."""

    enough: Mask  # True over water, if at least half of the square is water
    nir: Float64  # mean of the NIR
    level: Float64  # mean of the visible sum
    variance: Float64  # of the NIR
    covariance: Float64  # of the NIR and the visible sum
    visible: Float64  # variance of the visible sum

    def pick(self, chosen: Mask | slice) -> Self:
        """The statistics of the pixels that a mask or a slice selects, (pixel,)."""
        return type(self)._make(values[chosen] for values in self)

    @property
    def residual(self) -> Float64:
        """Variance of the visible sum (see `SampleRule`) that a regression on the NIR does not explain [step^2]."""
        return np.maximum(self.visible - self.covariance**2 / np.maximum(self.variance, 1e-9), 0.0)


def fit_sample(blocks: Sequence[FloatArray], rule: WaterRule) -> SampleRule:
    """Determine from some blocks of a scene which water is a good sample for glint slopes.

    A water pixel is in the sample if (1) it is over 10 pixels (5, 2, 0 if too few are left) from valid pixels that are
    not water, and if the square of 15 x 15 pixels around it meets three criteria. (2) It is dark: while visible means
    of squares form two clear classes, Otsu's threshold excludes the brighter class; glint is then subtracted, brighter
    classes are excluded again, and so is the brighter half of the rest. (3) It is even: the variance of the visible
    bands that the NIR does not explain is not unusually large. (4) It is in the quarter of the dark, even squares with
    the largest NIR variance (strongest glint), or in half or all of them if these are too few. Then the mask is opened
    (`CLEANING`). Strong glint is preferred, as noise in the NIR reduces fitted slopes by the factor

    .. math:: var(glint) / (var(glint) + var(noise))

    blocks : blocks (band, row, column), as for `fit_water`; NaN is not valid
    rule : rule of water, from `fit_water`

    Raises FitError if there is no water, no square that is half water, no dark, even area, or if the NIR is constant.

    The sample is meant for a regression on values from which a local mean is subtracted (`deglint.remove.detrend`):
    slow changes of colour inside the sample are allowed. Cost: 250 ns and 100 bytes per pixel.

    Otsu, N. (1979), "A threshold selection method from gray-level histograms", IEEE Trans. Systems, Man, and
    Cybernetics 9, 62-66, doi:10.1109/TSMC.1979.4310076.
    """
    valid = sum(int(valid_for(b, rule.roles).sum()) for b in blocks)
    if not (pairs := [(b, m) for b in blocks if (m := water(b, rule)).any()]):
        raise NoWaterError(f"no deep-water sample: {rule.reason}")
    blocks, masks = [b for b, _ in pairs], [m for _, m in pairs]
    sample = _quantisation(blocks, masks, rule)
    local = [_local(b, m, sample) for b, m in zip(blocks, masks, strict=True)]
    sample, candidates = _choose_distance(blocks, masks, local, sample)
    for share in SHARES:
        sample = _choose_limits(candidates, sample, share)
        found = [_select(b, m, s, sample) for b, m, s in zip(blocks, masks, local, strict=True)]
        if sum(int(f.sum()) for f in found) >= ENOUGH:
            break
    kept = _gather(local, found)
    if not (pixels := int(kept.enough.size)):
        raise FitError(f"no deep-water sample: no dark, even water with glint was found. {REMEDY}")
    total = float(kept.visible.sum()) * float(kept.variance.sum())
    r_squared = max(float(kept.covariance.sum()), 0.0) ** 2 / total if total > 0 else 0.0
    glint = float(np.sqrt(np.mean(kept.variance))) * sample.step[0]
    return replace(sample, r_squared=r_squared, glint=glint, pixels=pixels, share=pixels / valid)


def deep_water(block: FloatArray, rule: SampleRule) -> Mask:
    """Mask (row, column), True in the deep-water sample. Cost: 90 ns per pixel, much less without water.

    block : (band, row, column) as for `fit_sample`; NaN marks invalid pixels. A tile needs `rule.halo` more pixels.
    """
    mask = water(block, rule.water)
    return _select(block, mask, _local(block, mask, rule), rule) if mask.any() else mask


def _visible_sum(block: FloatArray, roles: Roles, weights: Sequence[float]) -> Float64:
    """Weighted sum (row, column) of the visible bands of a block; `weights` are in the order of `roles.visible`."""
    return np.sum([block[i] * np.float64(w) for i, w in zip(roles.visible, weights, strict=True)], axis=0)


def _middle_and_range(values: FloatArray) -> tuple[float, float]:
    """Median of `values`, and the difference of their 95th and 5th percentiles (if it is 0, the standard deviation)."""
    low, middle, high = (float(p) for p in np.percentile(thinned(values), (5, 50, 95)))
    return middle, (high - low) or float(np.std(values, dtype=np.float64))


def _quantisation(blocks: Sequence[FloatArray], masks: Sequence[Mask], rule: WaterRule) -> SampleRule:
    """A rule with 1024 grains (see `SampleRule`) from percentile 5 to 95 of water; FitError if the NIR is constant."""

    def over_water(band: int) -> FloatArray:
        return np.concatenate([b[band][m] for b, m in zip(blocks, masks, strict=True)])

    middles = [_middle_and_range(over_water(band))[0] for band in rule.roles.visible]
    weights = tuple(1.0 / m if m > 0 else 1.0 / rule.contrast for m in middles)
    sums = [_visible_sum(b, rule.roles, weights)[m] for b, m in zip(blocks, masks, strict=True)]
    nir, nir_range = _middle_and_range(over_water(rule.roles.nir))
    visible, visible_range = _middle_and_range(np.concatenate(sums))
    if not nir_range > 0:
        raise FitError(f"no deep-water sample: the NIR is {nir:.6g} all over the water. Give another --nir or --mask.")
    return SampleRule(rule, weights, (nir, visible), (nir_range / 1024, (visible_range or 1.0) / 1024))


def _local(block: FloatArray, mask: Mask, rule: SampleRule) -> _Local:
    """Statistics of the water (`mask`) in the square of side `SIZE` around each pixel, from exact sums of integers."""

    def grains(values: Float64, k: int) -> Float64:
        counted = np.rint((values - rule.centre[k]) / rule.step[k])
        return np.where(mask, np.clip(counted, -(2**20), 2**20), 0.0)

    roles, box = rule.water.roles, partial(box_sum, side=SIZE)
    nir = grains(block[roles.nir].astype(np.float64), 0)
    visible = grains(_visible_sum(block, roles, rule.weights), 1)
    count = box(mask.astype(np.float64))
    inverse: Float64 = 1.0 / np.maximum(count, 1.0)
    mean_nir, mean_visible = box(nir) * inverse, box(visible) * inverse
    return _Local(
        mask & (count >= SIZE * SIZE / 2),
        mean_nir,
        mean_visible,
        box(nir * nir) * inverse - mean_nir * mean_nir,
        box(nir * visible) * inverse - mean_nir * mean_visible,
        box(visible * visible) * inverse - mean_visible * mean_visible,
    )


def _gather(local: Sequence[_Local], masks: Sequence[Mask]) -> _Local:
    """Join the statistics of all blocks, (pixel,): those of the pixels that each block's mask (row, column) selects."""
    return _Local(*map(np.concatenate, zip(*(s.pick(m) for s, m in zip(local, masks, strict=True)), strict=True)))


def _choose_distance(
    blocks: Sequence[FloatArray], masks: Sequence[Mask], local: Sequence[_Local], sample: SampleRule
) -> tuple[SampleRule, _Local]:
    """Set the distance of the sample from all that is not water: the first of `DISTANCES` [pixel] that leaves at least
    `ENOUGH` pixels, else the last. Also return the statistics of these pixels. Raises FitError if there are none.
    """
    other = [valid_for(b, sample.water.roles) & ~m for b, m in zip(blocks, masks, strict=True)]
    for distance in DISTANCES:
        kept = [s.enough & ~grown(o, 2 * distance + 1) for s, o in zip(local, other, strict=True)]
        if (count := sum(int(k.sum()) for k in kept)) >= ENOUGH:
            break
    if not count:
        pixels = sum(int(m.sum()) for m in masks)
        raise NoWaterError(
            f"no deep-water sample: no {SIZE} x {SIZE} square is half water ({pixels} pixels are). {REMEDY}"
        )
    return replace(sample, distance=distance), _gather(local, kept)


def _choose_limits(local: _Local, sample: SampleRule, share: float) -> SampleRule:
    """The rule with limits that accept, among dark, even pixels of `local`, the `share` with the strongest glint."""
    local = local.pick(slice(None, None, 1 + local.level.size // MANY))
    local = local.pick(_darker_kind(local.level))
    total = float(local.variance.sum())
    slope = max(float(local.covariance.sum()) / total, 0.0) if total > 0 else 0.0
    level = local.level - slope * local.nir
    kind = _darker_kind(level)
    local, level = local.pick(kind), level[kind]
    limit = float(np.median(level))
    local = local.pick(level <= limit)
    variance = max(float(np.median(local.variance)), 1.0)
    residual = float(np.median(local.residual))
    sample = replace(sample, slope=slope, level=limit, residual=residual, variance=variance)
    least = float(np.quantile(local.variance[_even(local, sample)], 1.0 - share, method="lower"))
    return replace(sample, least_variance=max(least, 1e-6))


def _even(local: _Local, rule: SampleRule) -> Mask:
    """Mask, True where the residual is at most `MAX_RESIDUAL` times the usual residual at the same NIR variance."""
    usual = rule.residual * np.maximum(local.variance / rule.variance, 1.0)
    return np.asarray(local.residual <= MAX_RESIDUAL * usual)


def _darker_kind(level: Float64) -> Mask:
    """Mask (pixel,) of the darkest class of `level`: Otsu's threshold splits it up to 3 times while classes differ."""
    dark = np.ones(level.shape, bool)
    for _ in range(3):
        threshold, separability = _otsu(level[dark])
        darker = dark & (level <= threshold)
        if separability < BIMODAL or darker.sum() < 0.05 * level.size:
            break
        dark = darker
    return dark


def _otsu(values: Float64) -> tuple[float, float]:
    """Otsu's threshold, which maximises the variance between two classes; and this variance over the total, 0..1."""
    low, high = np.percentile(values, (0.1, 99.9))
    if not high > low:
        return float(high), 0.0
    counts, edges = np.histogram(np.clip(values, low, high), 256)
    centres = (edges[:-1] + edges[1:]) / 2
    weight = np.cumsum(counts)[:-1] / values.size  # between 0 and 1, as the first and the last bin have values
    moment = np.cumsum(counts * centres) / values.size
    mean = moment[-1]
    variance = np.sum(counts * (centres - mean) ** 2) / values.size
    between = (mean * weight - moment[:-1]) ** 2 / (weight * (1 - weight))
    best = int(np.argmax(between))
    return float(edges[best + 1]), float(between[best] / variance)


def _select(block: FloatArray, mask: Mask, local: _Local, rule: SampleRule) -> Mask:
    """Mask (row, column), True in the sample: water (`mask`) whose statistics `local` meet all limits of `rule`, after
    a morphological opening that ignores invalid pixels.
    """
    valid = valid_for(block, rule.water.roles)
    chosen = local.enough & (local.variance >= rule.least_variance)
    chosen &= local.level - rule.slope * local.nir <= rule.level
    chosen &= _even(local, rule)
    chosen &= ~grown(valid & ~mask, 2 * rule.distance + 1)
    return opened(chosen | ~valid, CLEANING) & chosen
