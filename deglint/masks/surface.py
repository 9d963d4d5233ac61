"""Water or not: land, clouds, foam and boats are told from water under glint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import BandError, InputError
from ..scene import FloatArray

BoolArray = npt.NDArray[np.bool_]

MAX_RATIO, MAX_RATIO_RED = 0.9, 1.1
"""NIR over visible (green or blue; red alone) at and above which the darkest thing in view is not taken for
water. Under glint water has 0.2 to 0.8 in green; soil, plants and towns have 1 to 6, clouds about 1."""
SURE_RATIO = 0.6
"""Between this and the limit it is water only if red is no brighter than green (not turbid, but glint)."""
SLICK_SHARE = 0.03
"""A second, brighter common ground of the colour of water under glint counts as water from this share on."""
MIN_JUMP = 0.6
"""What is not water is brighter in the NIR than water by at least this many dark visible levels."""
MAX_GLINT = 3.0
"""A threshold above this many visible levels would miss land: sparkle must be opened away first."""
WINDOWS = (1, 3, 5, 7, 9, 13, 17, 21, 25, 33)
"""Sides of the opening that are tried, smallest first [pixel]."""
MAX_LOSS, MAX_LOSS_SHARE = 0.003, 0.03
"""An opening is large enough when the next size takes no more than this from the bright pixels (share of all
pixels; share of the bright ones): sparkle is lost to an opening, land is not. Sizes up to the width of what may be lost
in sparkle are worth it for the share of the bright ones: few pixels may be the brightest of all."""
SPARKLE_MARGIN = 2.0
"""Where there is sparkle the threshold is raised by this factor: what it leaves of itself in the opened NIR lies within
1.5 thresholds (2.4 at most) in scenes of 2 to 12 m/s, land at ten and more."""
ENOUGH_TO_RANK = 100_000
"""Values that a percentile is told by; of more, every k-th."""
BIN = 0.05
"""Bins of the histogram of log NIR; it is smoothed by a Gaussian of two bins."""


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
        Not water where the opened NIR is above this.
    window : int
        Side of the square opening [pixel]: 1 at coarse pixels, larger where there is sparkle to pass over.
    nir_level, visible_level : float
        Usual NIR of the water, and dark level of the first visible band (10th percentile of the look).
    ratio : float
        NIR over visible of the darkest common ground (NaN: nothing to judge).
    water_fraction : float
        Share of water among the valid pixels of the look, 0..1.
    pixels : int
        Valid pixels of the look.
    bright_ratio : float
        NIR over visible of what is brighter than water, opened (NaN: nothing is).
    """

    roles: Roles
    threshold: float
    window: int
    nir_level: float
    visible_level: float
    ratio: float
    water_fraction: float
    pixels: int
    bright_ratio: float = np.nan

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
            return "no valid pixel to look at for water. Check --nodata, or widen --mask."
        if not self.visible_level > 0:
            return "no water can be found: the visible band is nowhere above 0. Check the bands, or pass --mask."
        if not self.has_water:
            return (
                f"no water: the darkest ground in view has NIR/visible {self.ratio:.2f}, water has less than "
                f"{_max_ratio(self.roles):.1f}. Check which band is the NIR and that no band has an "
                "offset, or pass --mask."
            )
        share = 100 * self.water_fraction
        said = f"{share:.2f} % of {self.pixels} pixels are water: NIR <= {self.threshold:.6g}"
        if self.water_fraction > 1 - SLICK_SHARE or not self.bright_ratio < _max_ratio(self.roles):
            return said
        return (
            f"{said}; the rest is as blue as water under dense glint, or cloud (NIR/visible {self.bright_ratio:.2f}): "
            "--mask none takes it for water, too"
        )

    def numbers(self) -> dict[str, Any]:
        """Everything as plain numbers, for a sidecar."""
        return {**asdict(self), "halo": self.halo, "all_water": self.all_water, "reason": self.reason}


def fit_water(looks: Sequence[FloatArray], roles: Roles, *, lost: int = 0) -> WaterRule:
    """Decide from some blocks of a scene how to tell water from land, clouds, foam and boats.

    Water is the darkest common ground in the NIR: the histogram of log(NIR + level / 5), with `level` the
    dark level of the visible, gives its mode m and the foot where it ends, and

    .. math:: T = max(foot, m + 0.6 level)

    Glint is bright in the NIR too, but at fine pixels it is sparkle: an opening (minimum, then maximum over
    a square) removes it, and not land. The square is the smallest for which the next size would change
    little: 1 pixel at coarse pixels, where small boats and piers stay apart from the water; where it is larger, T is
    doubled. Where what is brighter has the colour of water under glint, a square of `lost` pixels must change
    little: blurred or dense, sparkle is wide itself. (Of single pixels the colour within 3 x 3 counts, too: a flash
    that the NIR alone has caught has none.) The candidate is
    water if its NIR/visible ratio is that of water (NDWI positive). A second, brighter peak is water as well if
    it has the colour of water under glint.

    Parameters
    ----------
    looks : sequence of (band, row, column) ndarray
        Blocks that stand for the scene, or the whole scene [any unit]; NaN is not valid. Pixels that are 0 in
        NIR and visible are not counted (undeclared nodata).
    roles : Roles
        Which band is what.
    lost : int
        Side of the squares up to which bright things pass for sparkle where there is some [pixel].

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

    Notes
    -----
    Assumes that glint does not lift whole coarse pixels above three times the dark visible level, and that the
    look shows what the scene holds. Thin cloud over a good part of the scene passes for glint; and beside land, dense
    glint that ends within the scene may pass for land. Cost: 50 ns per
    pixel of the look, up to 300 where there is sparkle.

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
    visible = roles.visible[0]
    valid = [valid_for(b, roles) & ((b[roles.nir] != 0) | (b[visible] != 0)) for b in looks]
    pixels = int(sum(v.sum() for v in valid))
    level = _positive_level(np.concatenate([b[visible][v] for b, v in zip(looks, valid, strict=True)]))
    rule = WaterRule(roles, np.inf, 1, np.nan, level, np.nan, 0.0, pixels)
    if level <= 0:
        return rule
    window, mode, threshold, bright = _choose_window(looks, valid, roles, level, lost)
    if window > 1:
        threshold *= SPARKLE_MARGIN
        bright = _bright_share(looks, valid, roles, threshold, window)
    ground = _Ground(looks, valid, roles, window)
    ratio, beyond = (ground.ratio(chosen) for chosen in (ground.nir <= threshold, ground.nir > threshold))
    rule = replace(rule, threshold=threshold, window=window, nir_level=mode, ratio=ratio, bright_ratio=beyond)
    return replace(rule, water_fraction=1.0 - bright) if ground.like_water(ground.nir <= threshold) else rule


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


def _max_ratio(roles: Roles) -> float:
    return MAX_RATIO_RED if roles.visible == (roles.red,) else MAX_RATIO


def valid_for(block: FloatArray | Sequence[FloatArray], roles: Roles) -> BoolArray:
    """Pixels where every band in use is finite."""
    valid = np.isfinite(block[roles.nir])
    for band in roles.visible:
        valid &= np.isfinite(block[band])
    return valid


def thinned(values: FloatArray) -> FloatArray:
    """Every k-th value, such that enough are left to tell a percentile by."""
    return values[:: 1 + values.size // ENOUGH_TO_RANK]


def _positive_level(values: FloatArray) -> float:
    """Dark but positive level of a band: the 10th percentile, else a higher one, else 0."""
    levels = np.percentile(thinned(values), (10, 50, 90)) if values.size else ()
    return float(next((p for p in levels if p > 0), 0.0))


def _square(size: int) -> npt.NDArray[np.uint8]:
    return np.ones((size, size), np.uint8)


def _choose_window(
    looks: Sequence[FloatArray], valid: Sequence[BoolArray], roles: Roles, level: float, lost: int
) -> tuple[int, float, float, float]:
    """Smallest opening that leaves no sparkle: (window, mode, threshold, share of bright pixels)."""
    best: tuple[int, float, float, float] = (1, np.nan, np.inf, 0.0)
    best_rank, enough = (True, True, np.inf), False
    for window, larger in pairwise(WINDOWS):
        ground = _Ground(looks, valid, roles, window)
        mode, threshold = _threshold(ground, level)
        like_glint = window < lost and _like_glint(ground, threshold)
        if like_glint:  # blurred or dense, sparkle is wide, but not as wide as what is to be kept
            larger = next((n for n in WINDOWS if n >= lost), larger)
        now, then = (_bright_share(looks, valid, roles, threshold, n) for n in (window, larger))
        fine, well = (now - then <= max(least, MAX_LOSS_SHARE * now) for least in (0, MAX_LOSS))
        doubtful = threshold > MAX_GLINT * level or (like_glint and not well)
        # where a single pixel is not large enough there is sparkle, and it is not the answer
        rank = (doubtful, window == 1, now - then)
        enough = enough or (well and not doubtful)
        if enough or rank < best_rank:
            best, best_rank = (window, mode, threshold, now), rank
        if enough and (fine or window == 1 or larger > lost):
            break
    return best


def _like_glint(ground: _Ground, threshold: float) -> bool:
    """Whether what is brighter has the colour of water under glint: as it is, or, single pixels, within 3 x 3.

    A flash that the NIR alone has caught is no colour, and pixels that are bright in the NIR are mostly those.
    """
    if ground.like_water(ground.nir > threshold):
        return True
    if ground.window > 1:
        return False
    wider = _Ground(ground.looks, ground.valid, ground.roles, 3)
    return wider.like_water(wider.nir > threshold)


def _bright_share(
    looks: Sequence[FloatArray], valid: Sequence[BoolArray], roles: Roles, threshold: float, window: int
) -> float:
    """Share of valid pixels that are not water."""
    found = (opened(b[roles.nir] > threshold, ~v, window) for b, v in zip(looks, valid, strict=True))
    return sum(int(f.sum()) for f in found) / sum(int(v.sum()) for v in valid)


class _Ground:
    """Valid pixels of the looks, flat, after a local minimum over a square; bands are taken when asked for."""

    def __init__(self, looks: Sequence[FloatArray], valid: Sequence[BoolArray], roles: Roles, window: int):
        self.looks, self.valid, self.roles, self.window = looks, valid, roles, window
        self.nir = self.band(roles.nir)

    def band(self, index: int) -> FloatArray:
        """One band, flat."""
        low = [_eroded(b[index], v, self.window) for b, v in zip(self.looks, self.valid, strict=True)]
        return np.concatenate(low)

    def ratio(self, chosen: BoolArray) -> float:
        """Median NIR over median visible."""
        if not chosen.any():
            return np.nan
        visible = float(np.median(thinned(self.band(self.roles.visible[0])[chosen])))
        return float(np.median(thinned(self.nir[chosen]))) / visible if visible > 0 else np.inf

    def like_water(self, chosen: BoolArray) -> bool:
        """Whether the colour is that of water, with or without glint."""
        ratio = self.ratio(chosen)
        if not ratio < _max_ratio(self.roles):
            return False
        if ratio < SURE_RATIO or self.roles.red is None or self.roles.green is None:
            return True
        red, green = (np.median(self.band(b)[chosen]) for b in (self.roles.red, self.roles.green))
        return bool(red <= green)


def _eroded(band: FloatArray, valid: BoolArray, window: int) -> FloatArray:
    """Local minimum over a square, of the valid pixels, flat."""
    if window == 1:
        return band[valid]
    import cv2

    filled = np.where(valid, band, band.dtype.type(np.inf))
    low = np.asarray(cv2.erode(filled, _square(window)), band.dtype)
    return low[valid]


def _threshold(ground: _Ground, level: float) -> tuple[float, float]:
    """Mode of the water in the eroded NIR, and the value above which it is not water.

    Water may come in several common brightnesses (tiles of a wide swath, a slick): as long as the next one
    has the colour of water under glint, it is water too.
    """
    x = np.log(np.maximum(ground.nir / level, -0.19) + 0.2)
    density, edges = _histogram(x)
    centres = (edges[:-1] + edges[1:]) / 2
    mode, foot = _peak_and_foot(density, 0) or (0, len(density) - 1)
    last = mode
    while following := _peak_and_foot(density, foot):
        peak, end = following
        chosen = (x > edges[foot]) & (x <= edges[end + 1])
        if np.exp(centres[peak]) - 0.2 > MAX_GLINT or chosen.mean() < SLICK_SHARE:
            break
        if not ground.like_water(chosen):
            break
        last, foot = peak, end
    start, highest, limit = ((float(np.exp(centres[i])) - 0.2) * level for i in (mode, last, foot))
    return start, max(limit, highest + MIN_JUMP * level)


def _histogram(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Smoothed histogram of log NIR, and the edges of its bins."""
    start = float(np.log(0.01)) - 6 * BIN
    bins = int((float(x.max()) - start) / BIN) + 8
    counts, edges = np.histogram(x, bins, (start, start + bins * BIN))
    kernel = np.exp(-0.5 * (np.arange(-6, 7) / 2) ** 2)
    return np.convolve(counts, kernel / kernel.sum(), "same"), edges


def _peak_and_foot(density: FloatArray, start: int) -> tuple[int, int] | None:
    """Bins of the first common peak from `start` on, and of the foot to its right.

    Common: at least 3 % as high as the highest. The foot is where the density falls under 2 % of the peak, or
    under 30 % in a valley from which it rises threefold.
    """
    around = np.lib.stride_tricks.sliding_window_view(np.pad(density, 6), 13).max(axis=1)
    peaks = np.flatnonzero((density == around) & (density >= 0.03 * density.max()))
    peaks = peaks[peaks >= start]
    if not peaks.size:
        return None
    peak = int(peaks[0])
    after = np.maximum.accumulate(density[::-1])[::-1]
    valley = (density < 0.3 * density[peak]) & (after > 3 * density)
    valley &= np.append(density[:-1] <= density[1:], True)
    low = np.flatnonzero(valley | (density < 0.02 * density[peak]))
    low = low[low > peak]
    return peak, int(low[0]) if low.size else len(density) - 1
