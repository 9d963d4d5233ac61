"""Background: a band without glint, estimated from the darkest pixels within a window (morphological opening).

An opening is the minimum over a window, then the maximum of these minima. It removes glint, which is brighter than the
water and narrower than the objects to keep. An opening by a square also removes corners and round edges of objects.
Openings by an octagon and a diamond keep such edges, but also more glint. The outline detail is the excess of the
larger of these two over the opening by a square. It is added to the background around pixels where it exceeds a limit
in at least two bands. The limit is measured on sparkle (single flashes of glint) in the NIR bands, which do not show
objects under water. A band has at most `MOST` times the larger outline detail of its two neighbours in time.

The method fails where a clump of glint fills the window, as even the darkest pixel is then glint. Objects and textures
of the bottom that are narrower than the window are removed, too.

References
----------
Serra (1982), Image Analysis and Mathematical Morphology, chapter II, ISBN 978-0126372403.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import cv2
import numpy as np
import numpy.typing as npt

from ..moments import Float64
from ..remove.noise import spread
from .sharpen import blurred
from .state import LASTS, Float32, Sample, Setting, State

OPENING_WINDOW = 13
"""Default window [pixel]: the largest square within a disc of 4 m at 0.25 m is 12 pixels wide, and optics blur it."""
SMALLEST_OUTLINE = 7  # smallest window [pixel] for which the octagon and the diamond differ from the square
MOST = 2.0
"""Upper limit of the outline detail of a band over the larger detail of its two neighbours in time, both in units of
glint: about the factor by which one metre of water changes the ratio of two visible bands."""
RARE_SPARKLE = 0.99
"""Quantile of the outline detail of the NIR bands, which is sparkle. `ABOVE` times this quantile is the limit from
which outline detail is used. About one clump in ten windows exceeds the quantile."""
ABOVE = 1.5
"""Ratio of that limit to the quantile. With 1, sparkle makes errors at 9 m/s 10 % larger; 4 removes faint discs."""
COVER_K = 3.0  # standard deviations of noise by which a glint pixel exceeds the background (0.1 % do so by chance)
HALF_NORMAL = 0.399  # mean of max(-n, 0) for normal noise n [standard deviation]
RAISED = 4.0
"""Number of pixels whose background is too bright, as glint is faint or fills the window, over that of glint pixels."""
CLEAR_PERCENT = 10.0
"""Share of the pixels that count as those with the least glint [%]: few, so that glint is weak even where it is dense;
enough (thousands of a sample) that the median of their noise is known to a few percent of its standard deviation."""
PIT_K, MOST_PITS = 5.0, 3e-4
"""A pit is a pixel that is darker than the water around it by `PIT_K` standard deviations of noise, or not above
zero. An image has ringing if the share of pits exceeds `MOST_PITS` in every band; for normal noise it is 3e-7."""
PIT_SIDE = 9  # side of the window for the water around a pit [pixel]; ringing extends over 2 or 3 pixels


def opening(band: Float32, size: int, cut: int = 0) -> Float32:
    """Morphological opening of a band by a square, an octagon or a diamond.

    band : (row, column), any unit, finite
    size : width of the window, odd [pixel]
    cut : side of the corners that are cut off [pixel]: 0 for a square, size / 4 for an octagon, size / 2 for a diamond

    Returns ``dilate(median_3x3(erode(band)))``, (row, column) [unit of the band]. The median removes isolated values,
    so that a bright area remains only if the window fits into it at several positions.
    """
    square, corners = np.ones((max(size - 2 * cut, 1),) * 2, np.uint8), _diamond(cut)
    low = cv2.erode(band, square)
    for part in corners:
        low = cv2.erode(low, part)
    low = cv2.medianBlur(low, 3)
    for part in corners:
        low = cv2.dilate(low, part)
    return np.asarray(cv2.dilate(low, square), np.float32)


def _diamond(radius: int) -> list[npt.NDArray[np.uint8]]:
    """Structuring elements of five pixels which, applied in sequence, act as a diamond of this radius [pixel]."""
    parts, reach = [], 0
    while reach < radius:
        arm = min(max(reach, 1), radius - reach)
        part = np.zeros((2 * arm + 1, 2 * arm + 1), np.uint8)
        part[arm, ::arm] = part[::arm, arm] = 1
        parts.append(part)
        reach += arm
    return parts


def outlines(sharp: Float32, level: Float32, size: int) -> Float32:
    """Outline detail of bands `sharp`: the larger of openings by an octagon and a diamond, minus `level`; at least 0.

    All arrays are (band, row, column); `level` has the openings of `sharp` by a square of side `size` [pixel]. The
    octagon is 2 pixels narrower than the square, so that it fits into blurred discs. The diamond is 4 pixels wider than
    the square, so that their areas are similar: for a `size` of 13, 145 pixels (diamond) and 169 (square).
    """
    octagon, diamond = size - 2, size + 4
    out = np.empty_like(sharp)
    for b, band in enumerate(sharp):
        found = np.maximum(opening(band, octagon, octagon // 4), opening(band, diamond, diamond // 2))
        np.maximum(found - level[b], 0, out=out[b])
    return out


def shared(details: Float32, order: tuple[int, ...]) -> Float32:
    """Limit the outline detail of each band to `MOST` times the larger one of the bands before and after it in time.
    `details` and the result are (band, row, column), in a unit in which glint is the same in all bands; `order` has the
    0-based bands in order of time. If there is only one band, its detail is set to 0.
    """
    out = np.empty_like(details)
    for place, b in enumerate(order):
        beside = [details[order[i]] for i in (place - 1, place + 1) if 0 <= i < len(order)]
        out[b] = np.minimum(details[b], np.float32(MOST) * np.maximum(beside[0], beside[-1])) if beside else 0
    return out


def clear_pixels(excess: Float32, water: Float64, times: Float64) -> npt.NDArray[np.bool_]:
    """Mask, (band, pixel): for each band, the `CLEAR_PERCENT` of the pixels that have the least glint in another band.

    Candidates for the other band are those at most `LASTS` [s] before or after the band, as they have the same sparkle;
    if there are none, those nearest in time. The candidate with the darkest water relative to glint is used, most often
    the NIR. (The darkest pixels of the band itself would be those of low noise or dark water.) Do not use the mask if
    bands are simultaneous or have ringing: they then have equal errors of resampling and compression beside glint.

    excess : bands minus their openings, (band, pixel)
    water : background of each band, (band,), in a unit in which glint is the same in all bands
    times : time of each band, (band,) [s]
    """
    clear = np.ones(excess.shape, np.bool_)
    for b in range(len(excess)):
        apart = np.where(np.arange(len(times)) == b, np.inf, np.abs(times - times[b]))
        seen = excess[np.argmin(np.where(apart <= max(apart.min(), LASTS), water, np.inf))]
        clear[b] = seen <= np.percentile(seen, CLEAR_PERCENT)
    return clear


def median_and_spread(excess: Float32) -> tuple[float, float]:
    """Median of `excess` (pixel,), a band minus its opening, and standard deviation about it, from values below it."""
    middle = float(np.median(excess))
    return middle, spread(excess[excess < middle] - middle)


def mode_and_spread(excess: Float32) -> tuple[float, float]:
    """Mode of the non-zero values of `excess` (pixel,), and standard deviation about it, from values below it."""
    away = np.abs(excess)
    apart = away > (1e-3 * np.median(away[away > 0]) if (away > 0).any() else -1)  # not pixels equal to their opening
    d = excess[apart]
    low, high = np.percentile(d, [0.5, 70])
    counts, edges = np.histogram(d, 256, (low, max(high, low + 1e-12)))
    i = int(np.convolve(counts, np.ones(21) / 21, "same").argmax())
    middle = 0.5 * (edges[i] + edges[i + 1])
    below = d[d < middle] - middle
    return float(middle), float(spread(below) if below.size > 10 else d.std())


def around(band: Float32, cap: float) -> Float32:
    """Mean of min(`band`, `cap`) over the 9 x 9 pixels (`PIT_SIDE`) around each pixel; (row, column), as `band`."""
    return np.asarray(cv2.blur(np.minimum(band, np.float32(cap)), (PIT_SIDE, PIT_SIDE)), np.float32)


@dataclass(frozen=True)
class Background:
    """The fitted stage `identify-level`: it estimates the background of each band; pixels that exceed it are glint."""

    name: ClassVar[str] = "identify-level"
    size: int  # width of the window [pixel]
    order: tuple[int, ...]  # 0-based bands in order of time
    colour: tuple[float, ...]  # spectrum of glint, scaled so that colour / noise has a median of 1
    offsets: tuple[float, ...]  # of each band: water without glint minus the opening [unit of the image]
    sigmas: tuple[float, ...]  # standard deviation of the noise of each band [unit of the image]
    cover: float  # fraction of glint pixels in the sample, 0..1; median of the bands
    limit: float | None  # outline detail is used where two bands exceed this [unit of `colour`]; None: never
    caps: tuple[float, ...] = ()  # largest value of water in each band [unit of the image]; empty without ringing
    reach: int = 0  # radius of the widest PSF [pixel]
    cut: tuple[float, ...] = ()  # decrease of each band's mean, because noise is replaced, too [unit of the scene]

    @property
    def clear(self) -> float:
        """Share of pixels without glint, 0..1. As many pixels are assumed to have undetected as detected glint."""
        return max(1 - 2 * self.cover, 0.0)

    @property
    def halo(self) -> int:
        """Margin around a block that the stage needs [pixel]: the sum of the reaches of its filters."""
        grown = 0 if self.limit is None else 4 + self.size // 2
        return self.size + 1 + grown + (PIT_SIDE // 2 if self.caps else self.reach)

    def opened(self, state: State) -> tuple[Float32, Float32 | None]:
        """Openings of the bands by a square, and their outline detail (None without `limit`), (band, row, column) each.

        The bands are the image or, after a stage `psf`, its deconvolution. With `caps`, they are the image with dark
        pits raised to the mean `around` them. Outline detail is divided by `colour`, and then limited by `shared`.
        """
        source = state.image if state.sharp is None else state.sharp
        if self.caps:
            source = np.stack([np.maximum(b, around(b, cap)) for b, cap in zip(state.image, self.caps, strict=True)])
        level = np.stack([opening(b, self.size) for b in source])
        if self.limit is None:
            return level, None
        found = outlines(source, level, self.size)
        found /= np.array(self.colour, np.float32)[:, None, None]
        return level, shared(found, self.order)

    def level(self, state: State, level: Float32, detail: Float32 | None) -> Float32:
        """Background minus `offsets`, (band, row, column), as blurred as the image: `level` plus `detail`, the results
        of `opened`, where detail is used. `level` is modified.
        """
        if self.limit is not None and detail is not None:
            seen = (detail > np.float32(max(self.limit, 1e-6))).sum(axis=0, dtype=np.uint8) >= 2
            if seen.any():
                near = cv2.dilate(seen.astype(np.float32), np.ones((self.size, self.size), np.uint8))
                for b, unit in enumerate(self.colour):
                    level[b] += detail[b] * (near * np.float32(unit))
        if state.sharp is not None and state.psfs is not None and not self.caps:
            level = np.stack([blurred(b, p) for b, p in zip(level, state.psfs, strict=True)])
        return level

    def apply(self, state: State) -> State:
        """Determine the background, and mark the pixels that exceed it as glint.

        Pixels that exceed the background only because of noise are marked, too. A background higher by one standard
        deviation of noise would miss faint glint: errors would change by 19 % in dense glint, by under 2 % in other.
        """
        background = self.level(state, *self.opened(state))
        background += np.array(self.offsets, np.float32)[:, None, None]
        return replace(state, background=background, glint=state.image > background)


def fit(sample: Sample, setting: Setting, number: float | None = None) -> Background:
    """Fit the stage to a sample; `number` is the width of the window, odd, 13 by default [pixel]. Outline detail is
    used only if the width is at least 7, and the scene has time offsets, a NIR and at least three bands. Raises
    FitError if the sample is too small.
    """
    size, states = int(number or OPENING_WINDOW), sample.states
    images = [s.image for s in states]
    values = sample.values(images)
    sigma = sample.noise_of(images)
    unit = np.float32(1) if states[0].unit is None else states[0].unit
    colour = setting.colour / unit
    colour = np.asarray(colour / np.median(colour / sigma), np.float32)
    reach = max((p.radius for p in states[0].psfs or ()), default=0)
    caps = ringing(sample, sigma)
    by = setting.wavelengths if setting.offsets is None else setting.offsets  # unknown ones are last
    order = tuple(np.argsort(by, kind="stable").tolist())
    outlined = setting.offsets is not None and size >= SMALLEST_OUTLINE and setting.nir and len(values) > 2
    stage = Background(size, order, tuple(map(float, colour)), (), (), 0.0, 0.0 if outlined else None, caps, reach)
    opened = [stage.opened(s) for s in states]
    if details := [detail for _, detail in opened if detail is not None]:
        high = [np.quantile(sample.values([d[b] for d in details]), RARE_SPARKLE) for b in setting.nir]
        stage = replace(stage, limit=ABOVE * float(np.median(high)))
    levels = [stage.level(s, *parts) for s, parts in zip(states, opened, strict=True)]
    openings = sample.values(levels)
    excess = values - openings
    times = setting.offsets if setting.delayed and not caps else None  # as simultaneous bands share artefacts
    clear = None if times is None else clear_pixels(excess, np.median(openings, axis=1) / colour, times)
    found = []
    for b, above in enumerate(excess):
        middle, about = mode_and_spread(above) if clear is None else median_and_spread(above[clear[b]])
        about = max(about, float(sigma[b]))
        found.append((middle, about, float((above > middle + COVER_K * about).mean())))
    offsets, sigmas, shares = zip(*found, strict=True)
    stage = replace(stage, offsets=offsets, sigmas=sigmas, cover=float(np.median(shares)))
    return replace(stage, cut=tuple((HALF_NORMAL * max(1 - RAISED * stage.cover, 0) * sigma * unit).tolist()))


def ringing(sample: Sample, sigma: Float64) -> tuple[float, ...]:
    """Largest value of water without glint in each band, (band,), if the image has ringing; else an empty tuple.

    Ringing is caused by resampling: beside sparkle there are dark pixels (pits), which an erosion would widen. Dark
    objects are darker than the water, too, but not in all bands, as water hides them in some. So an image has ringing
    if the share of pits exceeds `MOST_PITS` in every band. As values of a dark band may be limited to at least 0, its
    pits may be less deep (see `PIT_K`). `sigma`, (band,), is the standard deviation of noise.
    """
    caps, least = [], 1.0
    for b, s in enumerate(sigma):
        planes = [state.image[b] for state in sample.states]
        values = sample.values(planes)
        cap = float(np.percentile(values, 30)) + 3 * float(s)  # water, where glint covers up to 70 %
        below = sample.values([around(p, cap) for p in planes]) - values
        least = min(least, float(((below > PIT_K * s) | ((values <= 0) & (below > 0))).mean()))
        caps.append(cap)
    return tuple(caps) if least > MOST_PITS else ()
