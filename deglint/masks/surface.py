"""Water or not: land, clouds, foam and boats are told from water under glint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import BandError, InputError
from ..scene import FloatArray

BoolArray = npt.NDArray[np.bool_]
Votes = npt.NDArray[np.int8]

GLINT_SIZE = 5.0
"""Width of the widest patches that glint makes in the image of a fine sensor [m]: facets of waves, blurred."""
WINDOWS = (1, 3, 5, 7, 9, 13, 17, 21, 25, 33)
"""Sides of the opening that are tried, smallest first [pixel]."""
WIDEST, RARE = 13, 2e-3
"""The same where the size of a pixel is not known [pixel], and the share of isolated bright pixels below which they
are boats and piers at coarse pixels and not glint, which is everywhere in the sea."""
TAIL = 3.0
"""The NIR of water ends within this many times the distance from its median to its 99th percentile. Brightness of
glint falls off exponentially: four in a million pixels lie beyond."""
DARKEST, MAX_SHEET = 10, 8.0
"""Glint and haze lift whole areas above the darkest tenth of the water by up to 8 times the difference between its
visible and its NIR; clouds are brighter."""
LEAST_WATER = 25
"""Water has at least this many pixels, in squares of 5 x 5 [pixel]: less is shadow or a dark roof."""
COMPACT = 0.7
"""Brown water has the colours of a town in units of radiance, but of a town less than this lies in such squares."""
BEYOND = 1.4
"""The gap between water and land is sought up to this many times the distance from the median of the water's NIR to
where as many pixels have the colour of water as have not."""
INTO_GAP = 0.25
"""The threshold lies in the gap, nearer to the water: ships, piers and mixed pixels fill the rest."""
ENOUGH_TO_RANK = 100_000
"""Values that a percentile is determined from; of more, every k-th."""
BINS = 64
"""Bins of the histogram in which the gap between water and land is sought."""


@dataclass(frozen=True, slots=True)
class Roles:
    """Which band of a block (0-based) is what; at least one visible band is needed beside the NIR.

    `swir` is carried for callers; the masks do not need it.
    """

    nir: int
    blue: int | None = None
    green: int | None = None
    red: int | None = None
    swir: int | None = None

    @property
    def visible(self) -> tuple[int, ...]:
        """Indexes of the visible bands there are, the best one to compare the NIR with first."""
        return tuple(b for b in (self.green, self.blue, self.red) if b is not None)

    def check(self, bands: int) -> None:
        """Raise BandError unless a visible band is named and a block of `bands` bands holds all of them."""
        if not self.visible:
            raise BandError("finding water needs a visible band beside the NIR. Name blue, green or red.")
        for name in ("nir", "blue", "green", "red"):
            index = getattr(self, name)
            if index is not None and not 0 <= index < bands:
                raise BandError(f"{name} has band index {index}, but the block has indexes 0..{bands - 1}")


@dataclass(frozen=True, slots=True)
class WaterRule:
    """How water is told from the rest: plain numbers, in the unit of the bands.

    Attributes
    ----------
    roles : Roles
    threshold : float
        Not water where the NIR is above this over a whole square of `window` pixels.
    window : int
        Side of that square [pixel]: 1 at coarse pixels, larger where glint is resolved into bright patches.
    nir_level : float
        Median NIR of the water (NaN: no water).
    contrast : float
        Visible minus NIR of the darkest water (NaN: no water). It does not depend on an offset that all bands share.
    water_fraction : float
        Share of water among the valid pixels of the look, 0..1.
    pixels : int
        Valid pixels of the look.
    """

    roles: Roles
    threshold: float = -np.inf
    window: int = 1
    nir_level: float = np.nan
    contrast: float = np.nan
    water_fraction: float = 0.0
    pixels: int = 0

    @property
    def halo(self) -> int:
        """Pixels that `water` needs around a tile."""
        return self.window - 1

    @property
    def has_water(self) -> bool:
        """Whether there is any water in the look."""
        return self.water_fraction > 0

    @property
    def all_water(self) -> bool:
        """Whether every valid pixel of the look is water, so that the test may be skipped.

        A look that misses an island misses it here too.
        """
        return self.water_fraction == 1.0

    @property
    def reason(self) -> str:
        """What was decided, in one line, fit for a log or a NoWaterError."""
        if not self.pixels:
            return "no valid pixel to look at for water. Check --nodata."
        if not self.has_water:
            return (
                "no water: nowhere is the visible brighter than the NIR over a dark, even area. Check which band is "
                "the NIR (--nir), or pass --mask none (all is water) or --mask FILE (polygons or a raster of it)."
            )
        if self.all_water:
            return f"all of the {self.pixels} pixels looked at are water"
        wide = f" over {self.window} x {self.window} pixels" if self.window > 1 else ""
        return (
            f"{100 * self.water_fraction:.2f} % of {self.pixels} pixels looked at are water; the rest (land, ships, "
            f"clouds, surf: NIR above {self.threshold:.6g}{wide}) is left as it is"
        )

    def numbers(self) -> dict[str, Any]:
        """Everything as plain numbers, for a sidecar."""
        return {**asdict(self), "halo": self.halo, "all_water": self.all_water, "reason": self.reason}


def fit_water(looks: Sequence[FloatArray], roles: Roles, *, pixel: float | None = None) -> WaterRule:
    """Decide from some blocks of a scene how to tell water from land, clouds, foam and ships.

    Water absorbs the NIR, so that it is darker there than in the visible, with glint or without: the sign of the NDWI.
    The sign does not change with the unit or with an offset that all bands share, but it is noisy: roofs and shadows
    have it, and some water has not. So it votes for a threshold of the NIR: the one that parts the two signs with
    the fewest errors, moved into the gap beside it that the fewest pixels lie in.

    At fine pixels glint is sparkle, as bright as land: not water is only what is bright over a whole square. Its side
    is the smallest that leaves no isolated bright pixels of the colour of glint, up to the size of glint's patches.

    Parameters
    ----------
    looks : sequence of (band, row, column) ndarray
        Blocks that stand for the scene, or the whole scene [any unit]; NaN is not valid.
    roles : Roles
        Which band is what.
    pixel : float, optional
        Side of a pixel on the ground [m].

    Returns
    -------
    WaterRule
        `has_water` is False where nothing looks like water; raising is left to the caller.

    Raises
    ------
    BandError
        No visible band is named, or a block lacks a band.
    InputError
        No blocks, or not three-dimensional.

    References
    ----------
    McFeeters, S. K. (1996), "The use of the Normalized Difference Water Index (NDWI) in the delineation of
    open water features", Int. J. Remote Sensing 17, 1425-1432, doi:10.1080/01431169608948714.

    Examples
    --------
    >>> sea = np.stack([np.full((32, 32), 0.05), np.full((32, 32), 0.01)])
    >>> fit_water([sea], Roles(nir=1, green=0)).all_water
    True
    """
    _check_looks(looks, roles)
    view = _View(looks, [valid_for(b, roles) for b in looks], roles)
    nothing = WaterRule(roles, pixels=view.pixels)
    widest = WIDEST if pixel is None else _widest(pixel)
    for brown in (False, True) if view.pixels else ():
        for window in WINDOWS:
            votes = view.votes(window, brown=brown)
            found = _threshold(view.nir(window), view.contrast, view.flat(votes), sparkle=window > 1)
            if found is None or window >= widest:
                break
            if pixel is None and view.sparkle(found.threshold, window, widest, votes) <= RARE:
                break
            if pixel is not None and not view.sparkle(found.threshold, window, widest, None):
                break
        if found is None:
            continue
        solid = view.brighter(found.threshold, window)
        if view.is_water(solid, votes, COMPACT if brown else 0.0):
            other = sum(int(s.sum()) for s in solid)
            return replace(nothing, window=window, water_fraction=1.0 - other / view.pixels, **found._asdict())
    return nothing


def water(block: FloatArray | Sequence[FloatArray], rule: WaterRule) -> BoolArray:
    """Mask of water.

    Parameters
    ----------
    block : (band, row, column) ndarray
        In the unit of the look; NaN is not valid. A tile needs `rule.halo` more pixels on every side.
    rule : WaterRule
        From `fit_water`.

    Returns
    -------
    (row, column) ndarray of bool
        Never True where a band in use is NaN.

    Notes
    -----
    Cost: 2 to 5 ns per pixel.

    Examples
    --------
    >>> scene = np.stack([np.full((8, 8), 0.05), np.full((8, 8), 0.01)])
    >>> scene[:, :, 5:] = [[[0.1]], [[0.3]]]
    >>> int(water(scene, fit_water([scene], Roles(nir=1, green=0))).sum())
    40
    """
    rule.roles.check(len(block))
    valid = valid_for(block, rule.roles)
    if not rule.has_water:
        return np.zeros_like(valid)
    if rule.all_water:
        return valid
    return valid & ~opened(*brightness(block[rule.roles.nir], rule), rule.window)


def brightness(nir: FloatArray, rule: WaterRule) -> tuple[BoolArray, BoolArray]:
    """Where the NIR is too bright for open water, and where it is missing (two (row, column) masks)."""
    return np.asarray(nir > rule.threshold), ~np.isfinite(nir)


def near_water(nir: FloatArray, rule: WaterRule, reach: int) -> BoolArray | None:
    """Pixels within `reach` rows and columns of one whose NIR is that of water; None for all.

    Sparkle is bright, but no water is so bright that none around it is dark: beyond these there is none under sparkle.
    """
    if rule.all_water:
        return None
    dark = np.asarray(nir <= nir.dtype.type(rule.threshold))
    if dark.all():
        return None
    import cv2

    return np.asarray(cv2.dilate(dark.view(np.uint8), _square(2 * reach + 1)).view(np.bool_))


def opened(bright: BoolArray, missing: BoolArray, window: int) -> BoolArray:
    """Bright pixels in a square of `window` bright pixels that lies in the image: what is not water.

    What is missing is neutral. A threshold and a rank filter commute, so the opening runs on bytes. Squares that reach
    over the image's edge do not count: there a few sparkles would fill them.
    """
    if window == 1 or not bright.any():
        return bright & ~missing
    import cv2

    square = _square(window)
    filled = (bright | missing).view(np.uint8)
    core = cv2.erode(filled, square, borderType=cv2.BORDER_CONSTANT, borderValue=0).view(np.bool_) & ~missing
    grown: BoolArray = cv2.dilate(core.view(np.uint8), square).view(np.bool_)
    return grown & ~missing


def _check_looks(looks: Sequence[FloatArray], roles: Roles) -> None:
    if len(looks) == 0:
        raise InputError("no blocks to look at. Give at least one (band, row, column) array.")
    for block in looks:
        if block.ndim != 3:
            raise InputError(f"a block must be (band, row, column); got an array of shape {block.shape}")
        roles.check(len(block))


def valid_for(block: FloatArray | Sequence[FloatArray], roles: Roles) -> BoolArray:
    """Pixels where every band in use is finite."""
    valid = np.isfinite(block[roles.nir])
    for band in roles.visible:
        valid &= np.isfinite(block[band])
    return valid


def thinned(values: FloatArray) -> FloatArray:
    """Every k-th value, such that enough are left to tell a percentile by."""
    return values[:: 1 + values.size // ENOUGH_TO_RANK]


def _square(size: int) -> npt.NDArray[np.uint8]:
    return np.ones((size, size), np.uint8)


def _widest(pixel: float) -> int:
    """Widest window that glint may need [pixel]."""
    return next((w for w in WINDOWS if w >= GLINT_SIZE / pixel), WINDOWS[-1])


class _Found(NamedTuple):
    threshold: float
    nir_level: float
    contrast: float


class _View:
    """The blocks in which water is sought, and which of their pixels are valid."""

    def __init__(self, blocks: Sequence[FloatArray], valid: Sequence[BoolArray], roles: Roles) -> None:
        kept = [(b, v) for b, v in zip(blocks, valid, strict=True) if v.any()]
        self.blocks, self.valid, self.roles = [b for b, _ in kept], [v for _, v in kept], roles
        self.pixels = int(sum(v.sum() for v in self.valid))

    def flat(self, arrays: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """Some of the valid pixels of all blocks, the same ones of every array."""
        return thinned(np.concatenate([a[v] for a, v in zip(arrays, self.valid, strict=True)]))

    @cached_property
    def contrast(self) -> FloatArray:
        """Visible minus NIR."""
        visible = self.roles.visible[0]
        return self.flat([b[visible] - b[self.roles.nir] for b in self.blocks])

    def nir(self, window: int) -> FloatArray:
        """NIR without what is bright and smaller than a window."""
        nir = [b[self.roles.nir] for b in self.blocks]
        return self.flat(
            nir if window == 1 else [_opened_band(b, v, window) for b, v in zip(nir, self.valid, strict=True)]
        )

    def votes(self, window: int, *, brown: bool) -> list[Votes]:
        """What the colour says of each pixel: 1 water, -1 not water, 0 either.

        Water has less NIR than visible. Soil and towns, too, where bands are radiances, and then red is above green,
        as in brown water. Means over a square are compared: bands that are not simultaneous catch sparkle at different
        places.
        """
        roles = self.roles
        found = []
        for block, valid in zip(self.blocks, self.valid, strict=True):
            like = _summed(block[roles.visible[0]] - block[roles.nir], valid, window) > 0
            votes = np.where(like, np.int8(1), np.int8(-1))
            if not brown and roles.red is not None and roles.green is not None:
                votes[like & (_summed(block[roles.red] - block[roles.green], valid, window) > 0)] = 0
            found.append(votes)
        return found

    def brighter(self, threshold: float, window: int) -> list[BoolArray]:
        """Where the NIR is above a threshold all over a window."""
        nir = self.roles.nir
        return [opened(b[nir] > threshold, ~v, window) for b, v in zip(self.blocks, self.valid, strict=True)]

    def sparkle(self, threshold: float, window: int, widest: int, votes: Sequence[Votes] | None) -> float:
        """Share of the sea where a window leaves bright pixels far from what the widest window leaves.

        Where votes are given, only bright pixels of the colour of water under glint.
        """
        solid, left = self.brighter(threshold, widest), self.brighter(threshold, window)
        apart = [b & ~_near(o, widest) for b, o in zip(left, solid, strict=True)]
        if votes is not None:
            apart = [a & (v > 0) for a, v in zip(apart, votes, strict=True)]
        return sum(int(a.sum()) for a in apart) / max(self.pixels - sum(int(o.sum()) for o in solid), 1)

    def is_water(self, solid: Sequence[BoolArray], votes: Sequence[Votes], compact: float) -> bool:
        """Whether the rest has mostly the colour of water and lies together, a share `compact` of it in squares.

        Where compactness is asked for, something must have voted against water, too.
        """
        found = alike = together = 0
        side = min(5, *(n for v in self.valid for n in v.shape))
        for o, vote, v in zip(solid, votes, self.valid, strict=True):
            like = v & ~o & (vote > 0)
            found, alike = found + int((v & ~o).sum()), alike + int(like.sum())
            together += int(opened(like, ~v, side).sum())
        enough = 2 * alike > found and together >= max(min(LEAST_WATER, side * side), compact * found)
        return enough and (not compact or any((o & (a < 0)).any() for o, a in zip(solid, votes, strict=True)))


def _summed(values: FloatArray, valid: BoolArray, side: int) -> FloatArray:
    """Sum of the valid values of a square."""
    values = np.where(valid, values, 0)
    if side == 1:
        return values
    import cv2

    summed = cv2.boxFilter(values, -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(summed, values.dtype)


def _opened_band(band: FloatArray, valid: BoolArray, window: int) -> FloatArray:
    """A band without what is brighter than its surroundings and smaller than a square; what is missing is neutral."""
    import cv2

    square = _square(window)
    low = cv2.erode(np.where(valid, band, band.dtype.type(np.inf)), square)
    return np.asarray(cv2.dilate(np.where(valid, low, band.dtype.type(-np.inf)), square), band.dtype)


def _threshold(nir: FloatArray, contrast: FloatArray, votes: Votes, *, sparkle: bool) -> _Found | None:
    """The threshold that parts the votes with the fewest errors, moved into the gap; None where no water wins."""
    order = np.argsort(nir, kind="stable")
    nir, contrast, votes = nir[order], contrast[order], votes[order]
    won = np.cumsum(votes, dtype=np.int64)
    won[:-1][nir[:-1] == nir[1:]] = -1  # equal values are not parted
    last = nir.size - 1 - int(np.argmax(won[::-1]))
    if won[last] <= 0:
        return None
    few = last // DARKEST + 1
    darkest = float(np.median(contrast[:few]))
    sheet = float(np.median(nir[:few])) + MAX_SHEET * abs(darkest)
    alone, highest = last == nir.size - 1, float(nir[last])  # nothing else is in view
    water = nir[: max(int(np.searchsorted(nir[: last + 1], sheet, "right")), 1)]
    level, end = (float(p) for p in np.percentile(water, (50, 99)))
    tail = level + TAIL * (end - level)
    if sparkle:
        threshold = sheet if alone else min(highest, sheet)
    elif alone:
        threshold = min(tail, sheet)
    else:
        limit = min(level + BEYOND * (highest - level), sheet, tail, float(nir[-1]))
        threshold = _foot(nir, level, limit)
    return _Found(threshold, level, darkest)


def _foot(nir: FloatArray, level: float, high: float) -> float:
    """A quarter into the gap above the water's peak, counted from the foot of the peak, where the density bends.

    The bend is where the logarithm of the density lies farthest below the straight line from its peak to the end, the
    triangle method of Zack, Rogers, Latt (1977), J. Histochem. Cytochem. 25, 741-753, doi:10.1177/25.7.70454.
    """
    if not high > level:
        return high
    counts, edges = np.histogram(nir, BINS, (level, high))
    kernel = np.exp(-0.5 * (np.arange(-4, 5) / 2) ** 2)
    density = np.log(np.convolve(np.pad(counts, 4, "edge"), kernel / kernel.sum(), "valid") + 0.5)
    peak = int(np.argmax(density))
    line = np.linspace(density[peak], density[-1], BINS - peak)
    bend = edges[1:][peak + int(np.argmax(line - density[peak:]))]
    return float(bend + INTO_GAP * (high - bend))


def _near(mask: BoolArray, side: int) -> BoolArray:
    import cv2

    return np.asarray(cv2.dilate(mask.view(np.uint8), _square(2 * side + 1)).view(np.bool_))
