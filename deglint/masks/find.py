"""Find water by a threshold of the NIR, which is determined from the colours of the scene's pixels.

Criteria compare differences or ranks, and so do not depend on the unit or on an offset common to all bands. But if the
bands are radiances, ratios are compared, because white then has different values in the bands (`_View.white`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..moments import Mask
from ..morphology import box_sum, grown, square, squares
from ..scene import ROUNDED, FloatArray
from .gap import end_of_gap, index_of_valley, threshold_in_gap
from .surface import Roles, WaterRule, filled_squares, land, thinned, valid_for

Votes = npt.NDArray[np.int8]

GLINT_SIZE = 5.0  # width of the widest patches of glint in images with small pixels [m]: blurred facets of waves
WINDOWS = (1, 3, 5, 7, 9, 13, 17, 21, 25, 33)  # windows of the morphological opening to try, in this order [pixel]
WIDEST_WINDOW, RARE_BRIGHT, EVERYWHERE = 17, 2e-3, 0.8
"""For pixels of unknown size: the largest window [pixel]; and the share of the sea up to which isolated bright pixels
may be boats and piers, as in an image with coarse pixels. These pixels are glint if no land is in view, or if at least
the share `EVERYWHERE` of the squares of sea (see `SQUARE`) has some of them."""
TAIL, LEAST_TAIL = 3.0, 0.5
"""The NIR of water ends at its median plus `TAIL` times the distance from there to its 99th percentile. Few pixels are
brighter, as the frequency of glint decreases exponentially with brightness. The distance from the median to the end is
at least `LEAST_TAIL` times the difference between visible and NIR of the darkest water (for water without glint)."""
DARKEST, MAX_SHEET = 10, 8.0
"""The darkest water: the share 1 / `DARKEST` of the water, that with the lowest NIR. Glint and haze may brighten areas
by up to `MAX_SHEET` times the difference between visible and NIR of the darkest water. Clouds are brighter."""
WHITEST, WHITE_SHARE = 0.2, 2.0
"""Share of the brightest pixels, from which the colour of white is determined [%]; least ratio of their green to the
green of the darkest pixels: turbid water has a smaller ratio."""
PLAIN_WHITE, SUN = (1.0, 1.0), (0.85, 0.57)
"""Red over green and NIR over green of white, in reflectance and in radiance (solar irradiance at 660, 840, 560 nm)."""
COARSE_PIXEL = 1.0
"""Smallest size of pixels [m] for which the colour of white is determined from the brightest pixels. In smaller pixels
dense glint may be brighter than all else, and it is not white if the bands are not simultaneous."""
WHITE_RED, WHITE_NIR = (0.7, 1.1), (0.4, 0.8)
"""Range of red over green, and of NIR over green, of white where the bands are radiances."""
LEAST_BODY = 25  # fewest pixels of water, in squares of 5 x 5 [pixel]: smaller areas are shadows or dark roofs
CLUMP, SQUARE, BOAT_SQUARES, ORDINARY, UNEVEN = 3, 64, 4, 75, 2.0
"""Sides of a clump of glint and of a square of sea [pixel]. The brightest clump in a square is glint or a boat, which
lies in up to `BOAT_SQUARES` squares. The limit of glint is the percentile `ORDINARY` of these clumps. In a block whose
median is higher, glint is denser: there it is their maximum, but at most `UNEVEN` times their median."""
CORE, OF_CLUMP = (5, 7), 0.3
"""Boats and narrow land are brighter than the clump (see `CLUMP`) in a whole larger square. Its side is from `CORE`
pixels to half the width of a patch of glint: the smallest with which the brightest square of glint exceeds the water by
at most `OF_CLUMP` times as much as the clump does. `CORE` is 5 if 5 pixels are a third of a patch or more, else 7: then
sparkle fills some squares of 5. A second square is for pixels with NIR above visible, which are rare in glint."""
AFLOAT = 2.0
"""Boats and narrow land exceed the NIR of water by at least this multiple of the difference between visible and NIR of
the darkest water. Turbid plumes do not. This limit matters where there is no glint to compare with."""
COMPACTNESS = 0.7  # least share of brown water in squares of 5 x 5 pixels: a town, brown in radiance, is less compact
SATURATED_SHARE = 1e-3
"""The highest NIR is saturated if at least this share of the pixels has it, and if it exceeds the NIR of dark water by
more than visible and NIR differ: in images of 8 bits, the NIR of calm water has few values, all frequent."""
BEYOND = 1.4
"""Upper end of the search for the gap between water and land, in multiples of the distance from the median NIR of water
to the NIR at which water and other colours are equally frequent."""
RARE_GLINT = 1e-3
"""In small pixels, the gap is searched for above the NIR that only this share of the votes for water exceeds: there,
pixels of sparkle are only as frequent as mixed pixels of a shore."""


def fit_water(
    blocks: Sequence[FloatArray],
    roles: Roles,
    *,
    pixel: float | None = None,
    whole: bool = True,
    reflectance: bool = False,
) -> WaterRule:
    """Determine from some blocks of a scene how to distinguish water from land, clouds, foam and ships.

    Water absorbs the NIR. It is therefore darker in the NIR than in the visible, with glint or without (the NDWI is
    positive). The sign of visible minus NIR does not depend on the unit or on a common offset, but is noisy: roofs and
    shadows look like water, and some water does not. Therefore each pixel votes for or against water by this sign. The
    NIR threshold separates the votes with the fewest errors, and is then moved into the gap between water and land.

    In small pixels glint is sparkle: as bright as land, but in small patches. Therefore a bright pixel is land only if
    it lies in a square of pixels that are all bright. The side of the square is the smallest with which no isolated
    bright pixels are left on the sea (almost none if they may be boats, see `RARE_BRIGHT`), and at most the width of a
    patch of glint. Boats, rocks and floating plants may be narrower than this square. They are found with smaller
    squares: all pixels of such a square have far more NIR than glint of this size, or more NIR than visible.

    blocks : blocks (band, row, column) that represent the scene, or the whole scene [any unit]; NaN is not valid
    roles : which band is the NIR, and which are visible
    pixel : side of a pixel on the ground [m]; None if not known
    whole : whether the blocks cover the whole scene; if not, there may be land outside them
    reflectance : True if the bands are known to be reflectances. If False, the brightest pixels show whether they are
        reflectances or radiances; but if pixels are below `COARSE_PIXEL` or of unknown size, reflectances are assumed

    Returns the rule for `water`; its `has_water` is False if no water was found.

    McFeeters (1996), International Journal of Remote Sensing 17, 1425-1432, doi:10.1080/01431169608948714 (NDWI).

    >>> sea = np.stack([np.full((32, 32), 0.05), np.full((32, 32), 0.01)])
    >>> fit_water([sea], Roles(nir=1, green=0)).all_water
    True
    """
    view = _View(blocks, roles)
    found = WaterRule(roles)
    if view.pixels:
        coarse = not reflectance and pixel is not None and pixel >= COARSE_PIXEL
        white = view.white if coarse else PLAIN_WHITE
        ways = (False, False), (True, False), (False, True)
        tried = (_fit(view, white, pixel, brown=brown, strict=strict) for brown, strict in ways)
        found = next(filter(None, tried), found)
    return replace(found, pixels=view.pixels, whole=whole)


def _fit(
    view: _View, white: tuple[float, float], pixel: float | None, *, brown: bool, strict: bool
) -> WaterRule | None:
    """Determine the rule that distinguishes blue or, if `brown`, turbid water from land; None if there is no water.

    white : red / green and NIR / green of a white surface, as in `_View.white`
    pixel : side of a pixel [m], or None if not known
    strict : if True, pixels of unknown colour count as not water, so that dark land is not joined to the water
    """
    widest = WIDEST_WINDOW if pixel is None else next((w for w in WINDOWS if w >= GLINT_SIZE / pixel), WINDOWS[-1])
    most = 0.0
    for window in [w for w in WINDOWS if w <= widest]:
        votes = view.votes(window, white, brown=brown)
        votes = [np.where(v > 0, v, np.int8(-1)) for v in votes] if strict else votes
        rule = _threshold(view, window, view.flat(votes), sparkle=window > 1 or pixel is None, strict=strict)
        if rule is None:
            return None
        if window == widest:
            break
        bright, sea = view.isolated(rule.threshold, window, widest, votes if pixel is None else None)
        if pixel is None and window == 1 and view.may_be_boats(bright, sea):
            most = RARE_BRIGHT
        if sum(int(b.sum()) for b in bright) <= most * sum(int(s.sum()) for s in sea):
            break
    assert rule is not None
    if pixel is None and not any((v < 0).any() for v in votes):  # cameras without a georeference fly below the clouds
        rule = replace(rule, threshold=np.inf)
    rule = _with_cores(view, rule, widest)
    solid = [land(b, rule) for b in view.blocks] if rule.core > 1 else view.brighter(rule.threshold, window)
    if not view.is_water(solid, votes, brown=brown, alone=white == PLAIN_WHITE):
        return None
    return replace(rule, water_fraction=1.0 - sum(int(s.sum()) for s in solid) / view.pixels)


def _with_cores(view: _View, rule: WaterRule, widest: int) -> WaterRule:
    """Add squares and limits of boats (`CORE`) to a rule, unless sea or glint patches (`widest` [pixel]) are small."""
    solid = view.brighter(rule.threshold, rule.window)
    level, plume, least = rule.nir_level, AFLOAT * abs(rule.contrast), CORE[3 * CORE[0] < widest]
    sides = [w for w in WINDOWS if least <= w <= widest and (w == least or 2 * w <= widest + 1)]
    clumps = [max(view.clumps(solid, level, red=red), plume) for red in (False, True)]
    if not sides or not np.isfinite(clumps).all():
        return rule
    cores = [
        next((w for w in sides if view.clumps(solid, level, w, red=red) <= OF_CLUMP * clump), 0)
        for red, clump in zip((False, True), clumps, strict=True)
    ]
    bright = min(level + clumps[0], ROUNDED * view.saturation if cores[0] else np.inf)
    core, red_core = (w or sides[-1] for w in cores)
    return replace(rule, core=core, bright=bright, red_core=red_core, red=level + clumps[1])


class _View:
    """Blocks (band, row, column) in which water is searched for, and masks (row, column) of their valid pixels."""

    def __init__(self, blocks: Sequence[FloatArray], roles: Roles) -> None:
        kept = [(b, v) for b in blocks if (v := valid_for(b, roles)).any()]
        self.blocks, self.valid, self.roles = [b for b, _ in kept], [v for _, v in kept], roles
        self.pixels = int(sum(v.sum() for v in self.valid))

    def flat(self, arrays: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """Values (pixel,) of the valid pixels, or of every k-th; `arrays` has an array (row, column) for each block."""
        return thinned(np.concatenate([a[v] for a, v in zip(arrays, self.valid, strict=True)]))

    @cached_property
    def contrast(self) -> FloatArray:
        """First visible band minus NIR, (pixel,), at the pixels that `flat` selects."""
        return self.flat([b[self.roles.visible[0]] - b[self.roles.nir] for b in self.blocks])

    @cached_property
    def dark(self) -> bool:
        """Whether most pixels have less NIR, relative to the first visible band, than a white surface in radiances."""
        visible, nir = self.roles.visible[0], self.roles.nir
        return float(np.median(self.flat([b[visible] * SUN[1] - b[nir] for b in self.blocks]))) > 0

    @cached_property
    def saturation(self) -> float:
        """NIR value of saturated pixels, whose colour is therefore not known; infinite if no pixels are saturated."""
        nir = self.flat([b[self.roles.nir] for b in self.blocks])
        low, high = float(np.percentile(nir, 1)), float(nir.max())
        saturated = (nir == high).mean() >= SATURATED_SHARE and high - low > float(np.median(np.abs(self.contrast)))
        return high if saturated else np.inf

    def votes(self, window: int, white: tuple[float, float], *, brown: bool) -> list[Votes]:
        """Vote of each pixel of each block, (row, column), by its colour: 1 for water, -1 against water, 0 unknown.

        A pixel votes for water if its NIR / visible is below that of white (`white`: red / green, NIR / green). This
        vote becomes 0 if the NIR is saturated or, unless `brown`, if red / green or (in radiance) NIR / red exceeds
        white (soil, town, brown water). Bands are summed over squares of side `window`, as delays displace sparkle.
        """
        roles, (red, nir) = self.roles, white
        found = []
        for block, valid in zip(self.blocks, self.valid, strict=True):
            scale = block.dtype.type
            like = _summed(block[roles.visible[0]] * scale(nir) - block[roles.nir], valid, window) > 0
            votes = np.where(like, np.int8(1), np.int8(-1))
            votes[like & (block[roles.nir] >= self.saturation)] = 0
            if not brown and roles.red is not None and roles.green is not None:
                votes[like & (_summed(block[roles.red] - block[roles.green] * scale(red), valid, window) > 0)] = 0
                if nir < 1:
                    redder = _summed(block[roles.nir] - block[roles.red] * scale(nir / red), valid, window) > 0
                    votes[like & redder] = 0
            found.append(votes)
        return found

    @cached_property
    def white(self) -> tuple[float, float]:
        """Red / green and NIR / green of a white surface: `SUN` if the bands seem to be radiances, else `PLAIN_WHITE`.

        The brightest pixels usually are white: roofs, sand, clouds, or glint. The bands are radiances if these pixels
        are bright enough and have the colour of sunlight.
        """
        roles = self.roles
        if roles.green is None or roles.red is None:
            return PLAIN_WHITE
        green, red, nir = (self.flat([b[i] for b in self.blocks]) for i in (roles.green, roles.red, roles.nir))
        both, dark = green + nir, float(np.percentile(green, 1))
        chosen = both >= np.percentile(both, 100 - WHITEST)  # in both: sparkle may be in one of them alone
        bright = float(np.median(green[chosen]))
        if not bright > WHITE_SHARE * dark > 0:
            return PLAIN_WHITE
        up = bright - dark
        red_of, nir_of = ((float(np.median(x[chosen])) - float(np.percentile(x, 1))) / up for x in (red, nir))
        radiance = WHITE_RED[0] < red_of < WHITE_RED[1] and WHITE_NIR[0] < nir_of < WHITE_NIR[1]
        return SUN if radiance else PLAIN_WHITE

    def brighter(self, threshold: float, window: int) -> list[Mask]:
        """Mask of each block, (row, column), True in squares of side `window` with all NIR above `threshold`."""
        nir = self.roles.nir
        return [filled_squares(b[nir] > threshold, ~v, window) for b, v in zip(self.blocks, self.valid, strict=True)]

    def clumps(self, solid: Sequence[Mask], level: float, side: int = CLUMP, *, red: bool = False) -> float:
        """NIR of bright clumps of glint (see `CLUMP`) minus `level`, the NIR of water; infinite if the sea is small.

        solid : mask (row, column) of each block, True where it is not water
        side : width of a clump [pixel]
        red : count only pixels with more NIR than visible; glint has such pixels only if bands are not simultaneous
        """
        tops: list[list[float]] = []
        for block, valid, other in zip(self.blocks, self.valid, solid, strict=True):
            open_sea, nir = valid & ~grown(other, SQUARE // 2 + 1), block[self.roles.nir]
            if red:
                nir = np.where(nir > block[self.roles.visible[0]], nir, nir.dtype.type(level))
            nir = _opened_band(nir, open_sea, side)
            tops.append([float(nir[part].max()) - level for part in _squares(open_sea) if open_sea[part].all()])
        every = [top for some in tops for top in some]
        limit = float(np.percentile(every, ORDINARY)) if len(every) >= BOAT_SQUARES else np.inf
        blocks = [(max(t), float(np.median(t))) for t in tops if len(t) > 2 * BOAT_SQUARES]
        return max([limit, *(min(most, UNEVEN * middle) for most, middle in blocks if middle > limit)])

    def isolated(self, threshold: float, window: int, widest: int, votes: Sequence[Votes] | None) -> list[list[Mask]]:
        """Masks of isolated bright pixels on the sea far from land, and of this sea: two lists with a mask per block.

        Bright pixels are those that `brighter` marks with squares of side `window`, except pixels that vote against
        water (if `votes` are given). Land is what `brighter` marks with the side `widest`; far is over `widest` pixels.
        """
        near = [grown(o, 2 * widest + 1) for o in self.brighter(threshold, widest)]
        sea = [v & ~n for v, n in zip(self.valid, near, strict=True)]
        bright = [b & s for b, s in zip(self.brighter(threshold, window), sea, strict=True)]
        if votes is not None:
            bright = [b & (v >= 0) for b, v in zip(bright, votes, strict=True)]
        return [bright, sea]

    def may_be_boats(self, bright: Sequence[Mask], sea: Sequence[Mask]) -> bool:
        """Whether `bright` pixels on `sea` may be boats: land is in view, and only a part of the sea has them."""
        has_land = sum(int(s.sum()) for s in sea) < self.pixels
        found = [b[p].any() for b, s in zip(bright, sea, strict=True) for p in _squares(s) if 2 * s[p].mean() >= 1]
        return has_land and (len(found) < BOAT_SQUARES or float(np.mean(found)) < EVERYWHERE)

    def is_water(self, solid: Sequence[Mask], votes: Sequence[Votes], *, brown: bool, alone: bool) -> bool:
        """Whether most pixels outside `solid` (land) vote for water, and enough of them fill squares of 5 x 5 pixels.

        brown : the share `COMPACTNESS` of them must lie in such squares, and some pixel of `solid` must vote against
            water; or, if the scene may be water `alone`, most pixels have less NIR than white in images of radiance
        """
        found = alike = together = 0
        side = min(5, *(n for v in self.valid for n in v.shape))
        for o, vote, v in zip(solid, votes, self.valid, strict=True):
            like = v & ~o & (vote > 0)
            found, alike = found + int((v & ~o).sum()), alike + int(like.sum())
            together += int(filled_squares(like, ~v, side).sum())
        least = max(min(LEAST_BODY, side * side), COMPACTNESS * found if brown else 0.0)
        beside = any((o & (a < 0)).any() for o, a in zip(solid, votes, strict=True))
        return 2 * alike > found and together >= least and (not brown or beside or (alone and self.dark))


def _squares(mask: Mask) -> Iterator[tuple[slice, slice]]:
    """Row and column slices of the complete squares of `SQUARE` x `SQUARE` pixels into which an array can be cut."""
    return (part for part in squares(mask.shape, SQUARE) if mask[part].size == SQUARE**2)


def _summed(values: FloatArray, valid: Mask, side: int) -> FloatArray:
    """Sum of the valid values (row, column) in the square of side `side` [pixel] around each pixel, (row, column)."""
    values = np.where(valid, values, 0)
    return values if side == 1 else box_sum(values, side)


def _opened_band(band: FloatArray, valid: Mask, window: int) -> FloatArray:
    """Morphological opening of a band (row, column) by a square window [pixel]; invalid pixels are ignored."""
    if window == 1:
        return band
    low = cv2.erode(np.where(valid, band, band.dtype.type(np.inf)), square(window))
    return np.asarray(cv2.dilate(np.where(valid, low, band.dtype.type(-np.inf)), square(window)), band.dtype)


def _threshold(view: _View, window: int, votes: Votes, *, sparkle: bool, strict: bool) -> WaterRule | None:
    """Determine the rule, a threshold of the NIR, for squares of side `window` [pixel]; None if there is no water.

    The threshold separates the `votes` (pixel,) with the fewest errors, and is then moved into the gap between water
    and land. Without land, it is the upper end of the NIR of water or, if `sparkle`, of glint on water. If `strict`, it
    is not moved up to the next valley of the histogram, below which there may be dark land.
    """
    nir = view.flat([_opened_band(b[view.roles.nir], v, window) for b, v in zip(view.blocks, view.valid, strict=True)])
    order = np.argsort(nir, kind="stable")
    nir, contrast, votes = nir[order], view.contrast[order], votes[order]
    won = np.cumsum(votes, dtype=np.int64)
    won[:-1][nir[:-1] == nir[1:]] = -1  # equal values cannot be separated
    last = nir.size - 1 - int(np.argmax(won[::-1]))
    if won[last] <= 0:
        return None
    last = index_of_valley(nir, last) if window == 1 and not strict else last
    few = last // DARKEST + 1
    darkest = float(np.median(contrast[:few]))
    sheet = float(np.median(nir[:few])) + MAX_SHEET * abs(darkest)
    alone = last == nir.size - 1  # nothing else is in view
    water = nir[: max(int(np.searchsorted(nir[: last + 1], sheet, "right")), 1)]
    level, end = (float(p) for p in np.percentile(water, (50, 99)))
    tail = level + max(TAIL * (end - level), LEAST_TAIL * abs(darkest))
    if alone:
        threshold = sheet if sparkle else min(tail, sheet)
    elif window > 1:
        nearly = int(np.argmax(won >= (1 - RARE_GLINT) * won[last]))
        threshold = min(end_of_gap(nir[nearly : last + 1]), sheet)
    else:
        threshold = threshold_in_gap(nir, level, min(level + BEYOND * (float(nir[last + 1]) - level), sheet, tail))
    if not alone and threshold >= nir[-1]:  # else all pixels would be water: land may be saturated
        threshold = (float(nir[last]) + float(nir[last + 1])) / 2
    return WaterRule(view.roles, threshold, window, nir_level=level, contrast=darkest)
