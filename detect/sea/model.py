"""Contrast of a pixel with the water around it, at several scales.

At every scale s, y is the mean of each band over s x s pixels of the sea, so that an object fills this square at one of
the scales. For each band, m is the mean of the water in a large window around the pixel, v is the mean of (y - m)^2
over the same water, z is (y - m) / sqrt(v), and R is the correlation matrix of z over all water. The distance is
sqrt(z' R^-1 z). The distances of each scale are normalised linearly: their median and 99.9 % quantile over the water
become those of the smallest scale. The score is the maximum over the scales, divided by the divisor of the `GlintScale`
if there is one. Pixels of water with a large distance at the largest scale (ships, wakes, slicks, plumes, clouds) are
excluded from the statistics, and the statistics are computed again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Self

import cv2
import numpy as np

from deglint.checks import check_choice
from deglint.errors import NoWaterError
from deglint.morphology import box_sum, grown

from ..arrays import Array, Float32, Float64, Mask
from ..covariance import whitener
from .region import RIM, WATER, Classes

SIDES = ("bright", "both")  # anomalies: only pixels brighter than the water around them, or also darker ones
SEA_WINDOW = 51  # side of the window of local statistics [pixel]: spans several ships; 31 and 101 find fewer in ports
SCALES = (1,)  # sides of the averaging windows [pixel], for pixels as large as a boat: larger windows dilute the boat
_FINE_SCALES = (1, 3, 5)  # the same where pixels are smaller than an object: sparkle is averaged out
_FINE_PIXEL = 5.0  # pixels with a shorter side are smaller than a boat [m]; submerged (dark) objects are searched, too
LEAST_WATER = 100  # minimum number of pixels of water for the statistics
_ROUNDS = 3  # number of times that the statistics are computed
_CUT = 6.0  # pixels above this multiple of the median distance are not in statistics: 1e-11 of normal water (2 bands)
_PRIOR = 30.0  # weight of the whole sea in every local variance [pixel]: a narrow channel has few pixels of water
_FLOOR = 0.1  # smallest local variance, relative to the variance of the whole sea: limits scores in smooth patches
_FAR = 1e4  # values are clipped to this many robust standard deviations: float32 sums over a window stay precise
_RARE = 1e-3  # fraction of water above the upper quantile that normalises the scales
_CLASSES = 32  # number of classes of the NIR; each has 3 % of the pixels: hundreds, even in a small scene
_USUAL = 0.75  # quantile that is the usual score of a class: objects on less than a quarter of it do not change it
_LAST_FACTOR = 0.9
"""Quantile of the NIR above which the divisor of `GlintScale` is constant: objects there are as bright as glint. On a
simulated sea with pixels of 1.24 m, a value of 1 finds no boat, and 0.75 finds two submerged objects fewer than 0.9."""
_REACH = 3  # side of the window of the maximum of the NIR [pixel]: waves move by about a pixel between bands

Blocks = Sequence[tuple[Array, Classes]]  # parts of a scene, (band, row, column), and classes, (row, column)


@dataclass(frozen=True, eq=False)
class GlintScale:
    """Divisors of scores, one for each class of NIR brightness.

    The divisor is the usual score of the water in the class, divided by the usual score of all water. The usual score
    is the 75 % quantile. It grows with residual glint, a heavy-tailed noise. After division, the scores of water are
    similar everywhere, and a submerged object is found where the glint above it is weak. Floating objects are
    themselves bright in the NIR, so the divisor is constant above the 90 % quantile of the NIR.
    """

    centre: Float64  # (band,): median of the NIR over water
    spread: Float64  # (band,): robust standard deviation of the NIR over water
    side: int  # side of the largest averaging window of the scores [pixel]
    glint: Float64  # (class,): median of the standardised NIR of the class, see `nearby`; ascending
    factor: Float64  # (class,): divisor: usual score of the class / usual score of all water; does not decrease

    @classmethod
    def fit(cls, nir: Sequence[Array], scores: Sequence[Array], water: Sequence[Mask], side: int) -> Self:
        """Fit to blocks of NIR, (band, row, column), scores and water, (row, column); `side` is as in `nearby`."""
        values = np.concatenate([np.asarray(n, np.float64)[:, w] for n, w in zip(nir, water, strict=True)], axis=1)
        centre, spread = _robust(np.nan_to_num(values))
        flat = cls(centre, spread, side, np.zeros(1), np.ones(1))
        glint = np.concatenate([flat.nearby(n)[w] for n, w in zip(nir, water, strict=True)])
        scored = np.concatenate([s[w] for s, w in zip(scores, water, strict=True)])
        edges = np.unique(np.quantile(glint, np.linspace(0, 1, _CLASSES + 1)))
        usual = float(np.quantile(scored, _USUAL))
        if len(edges) < 3 or not usual > 0:
            return flat  # too few classes, or scores of 0: all divisors are 1
        at = np.clip(np.searchsorted(edges, glint, side="right") - 1, 0, len(edges) - 2)
        found = [(np.median(glint[at == i]), np.quantile(scored[at == i], _USUAL) / usual) for i in np.unique(at)]
        middle, factor = np.array(found, np.float64).T
        factor = np.maximum.accumulate(np.maximum(factor, 1e-3))
        last = factor[int(_LAST_FACTOR * (len(factor) - 1) + 0.5)]
        return cls(centre, spread, side, middle, np.minimum(factor, last))

    def nearby(self, nir: Array) -> Float32:
        """Standardised NIR, (row, column): maximum over bands and 3 x 3 pixels, then mean of `side` x `side` pixels."""
        centre, spread = self.centre[:, None, None], self.spread[:, None, None]
        standard = (np.nan_to_num(np.asarray(nir, np.float32)) - centre) / spread
        highest = cv2.dilate(standard.max(axis=0).astype(np.float32), np.ones((_REACH, _REACH), np.uint8))
        return np.asarray(cv2.blur(highest, (self.side, self.side)))

    def divided(self, scores: Array, nir: Array) -> Float32:
        """Divide each score, (row, column), by the divisor for the `nir` of its pixel, (band, row, column)."""
        return np.asarray(scores / np.interp(self.nearby(nir), self.glint, self.factor), np.float32)


@dataclass(frozen=True, eq=False)
class SeaModel:
    """Statistics of the water of a scene, with which `score` scores every block of the scene."""

    centre: Float64  # (band,): median of water [unit of the image]
    spread: Float64  # (band,): robust standard deviation of water [unit of the image]
    variance: Float64  # (scale, band): variance of water about its local mean [spread squared]
    whiteners: tuple[Float64, ...]  # (rank, band) of every scale: whitens the correlation (`covariance.whitener`)
    middle: Float64  # (scale,): median of the distance of water
    rare: Float64  # (scale,): 99.9 % quantile of the distance of water, which few pixels exceed
    q90: float  # 90 % quantile of the score over water
    scales: tuple[int, ...]  # sides of the averaging windows [pixel]
    side: str  # one of `SIDES`
    glint: GlintScale | None = None  # divisors of the scores; None with coarse pixels or without NIR

    @property
    def fine(self) -> bool:
        """Whether pixels are smaller than a boat."""
        return len(self.scales) > 1

    @property
    def halo(self) -> int:
        """Width of the margin around a block that its scores depend on [pixel]."""
        return _ROUNDS * (SEA_WINDOW // 2 + self.scales[-1] // 2 + 2)

    def numbers(self) -> dict[str, object]:
        """Numbers of the model, for the sidecar of an output: window, centre, spread, scales, side and q90."""
        return {"window": SEA_WINDOW} | {k: getattr(self, k) for k in ("centre", "spread", "scales", "side", "q90")}


def fit(blocks: Blocks, *, pixel: float = 10.0, side: str | None = None, nir: Sequence[Array] = ()) -> SeaModel:
    """Fit the statistics of the water to pairs: a block of a scene, (band, row, column), and its classes from `region`.

    `pixel` is the side of a pixel [m]. Below 5 m, there are several scales, and `side` (one of `SIDES`) is "both" by
    default. Otherwise there is one scale, and `side` is "bright" by default. `nir`, the NIR of every block before glint
    removal, (band, row, column), is used only below 5 m, because a boat that fills a larger pixel is itself bright in
    the NIR.
    Raises NoWaterError if fewer than 100 pixels are water, and InputError if `side` is not allowed.
    """
    fine = pixel < _FINE_PIXEL
    side = side or ("both" if fine else "bright")
    scales = _FINE_SCALES if fine else SCALES
    check_choice(side, list(SIDES), "side")
    water = [(classes == WATER) & np.isfinite(block).all(axis=0) for block, classes in blocks]
    sample = np.concatenate([np.asarray(b, np.float64)[:, w] for (b, _), w in zip(blocks, water, strict=True)], axis=1)
    bands, pixels = sample.shape
    if pixels < LEAST_WATER:
        raise NoWaterError(f"{pixels} pixels of water are too few to compare with. Check --mask.")
    centre, spread = _robust(sample)
    ones, zeros = np.ones((len(scales), bands)), np.zeros(len(scales))
    model = SeaModel(centre, spread, ones, (np.eye(bands),) * len(scales), zeros, ones[:, 0], 1.0, scales, side)
    parts = [_Block(block, classes, model) for block, classes in blocks]
    used = [part.dim for part in parts]
    model = _learn(parts, used, water, model)
    for _ in range(_ROUNDS - 1):
        used = [part.typical(u, model) for part, u in zip(parts, used, strict=True)]
        model = _learn(parts, used, water, model)
    found = [_combined(part, u, model) for part, u in zip(parts, used, strict=True)]
    if fine and len(nir):
        glint = GlintScale.fit(nir, found, water, scales[-1])
        model = replace(model, glint=glint)
        found = [glint.divided(f, n) for f, n in zip(found, nir, strict=True)]
    scored = np.concatenate([f[w] for f, w in zip(found, water, strict=True)])
    return replace(model, q90=float(np.quantile(scored, 0.9)))


def score(block: Array, classes: Classes, model: SeaModel, nir: Array | None = None) -> Float32:
    """Distance of every sea pixel from the water around it [standard deviation]; NaN at land, `RIM` and invalid pixels.

    `block` and `nir`, (band, row, column), `classes` and the result, (row, column), contain the requested pixels and,
    within the scene, a margin of `model.halo` pixels around them. `nir` is needed if the model was fitted with a NIR.
    """
    part = _Block(block, classes, model)
    used = part.dim
    for _ in range(_ROUNDS - 1):
        used = part.typical(used, model)
    found = _combined(part, used, model)
    if model.glint is not None and nir is not None:
        found = model.glint.divided(found, nir)
    found[(classes == RIM) | ~part.sea] = np.nan
    return found


class _Block:
    """A block `x`, (band, row, column), in robust standard deviations of water, its `means` at every scale, and masks.

    `sea`: water, rim and objects; `water`: water and rim; `dim`: `water` with largest-scale means within +-30.
    """

    def __init__(self, block: Array, classes: Classes, model: SeaModel) -> None:
        valid = np.isfinite(block).all(axis=0)
        self.sea = (classes > 0) & valid
        self.water = ((classes == WATER) | (classes == RIM)) & valid
        with np.errstate(over="ignore"):  # in float64: float32 cannot distinguish large, similar values
            x = np.subtract(block, model.centre[:, None, None], dtype=np.float64) / model.spread[:, None, None]
        self.x = x = np.where(self.sea, np.clip(x, -_FAR, _FAR), 0).astype(np.float32)
        count = {s: np.maximum(box_sum(self.sea.astype(np.float32), s), 1) for s in model.scales}
        self.means = [x if s == 1 else np.stack([box_sum(b, s) for b in x]) / count[s] for s in model.scales]
        self.dim = self.water & (np.abs(self.means[-1]) < 30).all(axis=0)

    def local(self, used: Mask) -> tuple[Array, Array]:
        """Mean of `x` over `used` pixels around each pixel, (band, row, column), and number of these, (row, column)."""
        count = box_sum(used.astype(np.float32), SEA_WINDOW)
        total = np.stack([box_sum(np.where(used, b, 0), SEA_WINDOW) for b in self.x])
        return total / (count + 1), count  # + 1: a pixel with the median of the scene, for windows without water

    def standardised(self, used: Mask, variance: Float64) -> list[Array]:
        """Contrasts z to `used` water, (band, row, column), by scale; `variance`, (scale, band), is for all water."""
        mean, count = self.local(used)
        out = []
        for means, whole in zip(self.means, variance, strict=True):
            d = means - mean
            share = np.stack([box_sum(np.where(used, b * b, 0), SEA_WINDOW) for b in d])
            v = (share + _PRIOR * whole[:, None, None]) / (count + _PRIOR)
            out.append(d / np.sqrt(np.maximum(v, _FLOOR * whole[:, None, None])))
        return out

    def typical(self, used: Mask, model: SeaModel) -> Mask:
        """`water` without the 5 x 5 pixels around pixels whose largest-scale distance from `used` water is large."""
        z = self.standardised(used, model.variance)[-1]
        far = _distance(z, model.whiteners[-1], "both") > _CUT * model.middle[-1]
        return self.water & ~grown(far, 5)


def _distance(z: Array, white: Float64, side: str) -> Float32:
    """Mahalanobis distance |white z|, not squared, (row, column), of contrasts z, (band, row, column).

    `white` is a whitening matrix, (rank, band). For the side "bright", pixels darker than the water get the distance 0.
    """
    flat = white.astype(np.float32) @ z.reshape(len(z), -1)
    d = np.sqrt(np.einsum("ij,ij->j", flat, flat)).reshape(z.shape[1:])
    if side == "bright":
        d[z.sum(axis=0) <= 0] = 0
    return np.asarray(d, np.float32)


def _robust(sample: Float64) -> tuple[Float64, Float64]:
    """Median and robust standard deviation of every band of a sample, (band, pixel)."""
    centre = np.median(sample, axis=1)
    spread = 1.4826 * np.median(np.abs(sample - centre[:, None]), axis=1)
    if (even := spread == 0).any():
        spread[even] = sample[even].std(axis=1)
    return centre, np.where(spread > 0, spread, 1.0)


def _learn(parts: Sequence[_Block], used: Sequence[Mask], water: Sequence[Mask], model: SeaModel) -> SeaModel:
    """Return the model with new statistics at every scale: variance and whitening matrix of pixels in the masks `used`,
    99.9 % quantile of the distance in the masks `water`, and median of the distance in `_Block.water`.
    """
    variance = np.zeros_like(model.variance)
    total = max(sum(int(u.sum()) for u in used), 1)
    for part, u in zip(parts, used, strict=True):
        mean, _count = part.local(u)
        for i, means in enumerate(part.means):
            d = (means - mean)[:, u].astype(np.float64)
            variance[i] += (d * d).sum(axis=1) / total
    variance = np.maximum(variance, 1e-12)
    standard = [part.standardised(u, variance) for part, u in zip(parts, used, strict=True)]
    whiteners, middle, rare = [], [], []
    for scale in zip(*standard, strict=True):
        values = np.concatenate([z[:, u] for z, u in zip(scale, used, strict=True)], axis=1).astype(np.float64)
        white = whitener(values @ values.T / max(values.shape[1], 1))
        whiteners.append(white)
        both = np.concatenate([_distance(z, white, "both")[p.water] for z, p in zip(scale, parts, strict=True)])
        middle.append(float(np.median(both)) or 1.0)
        d = np.concatenate([_distance(z, white, model.side)[w] for z, w in zip(scale, water, strict=True)])
        rare.append(max(float(np.quantile(d, 1 - _RARE)), middle[-1] * (1 + 1e-6)))
    return replace(model, variance=variance, whiteners=tuple(whiteners), middle=np.array(middle), rare=np.array(rare))


def _combined(part: _Block, used: Mask, model: SeaModel) -> Float32:
    """Maximum of the normalised distances over the scales, (row, column), in the unit of the distance at scale 1."""
    scales = zip(part.standardised(used, model.variance), model.whiteners, model.middle, model.rare, strict=True)
    best = reduce(np.maximum, ((_distance(z, w, model.side) - low) / (high - low) for z, w, low, high in scales))
    low, high = float(model.middle[0]), float(model.rare[0])
    return np.asarray(np.maximum(low + (high - low) * best, 0), np.float32)
