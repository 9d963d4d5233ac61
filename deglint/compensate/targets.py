"""Small bright targets (boats, swimmers, buoys), distinguished from sparkle (flashes of glint) by a likelihood ratio.

S is the log likelihood ratio of target and sparkle for the excess e over the background, in bands b = 1 to B by time:

.. math:: S = \\max_k \\ln w_k N(e; 0, A^2 F_k F_k^T + h h^T + V_k) - \\ln p(e_1) \\prod_{b=2}^B p(e_b \\mid e_{b-1})

The columns of F_k are a spectrum with probability w_k (smooth, or with one or two edges) and its standard deviations; A
is the power of 2 nearest to the largest excess. V_k is the variance of noise, of texture of the water (a bottom) and of
the non-smooth part of the spectrum; h is the standard deviation of the water that a target hides. Sparkle changes from
band to band; its probabilities p come from histograms of the scene, and include flashes that last. A score is the sum
of S over 3 x 3 pixels plus the log likelihood ratio of an outline common to all bands. A pixel with S > 0 belongs to a
target if its score or that of a neighbour exceeds a threshold, which a false-alarm rate and lasting sparkle determine.

Without band delays there is no test, as the spectrum of sparkle is as smooth as that of paint. The test fails for
targets that move by more than a quarter of their width from the first to the last band, for most coloured targets of
1 pixel where sparkle lasts, and where bands are misregistered by more than a third of a pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import ClassVar, Self

import cv2
import numpy as np
import numpy.typing as npt

from ..moments import Float64, Mask
from ..morphology import box_sum, grown
from ..physics.atmosphere import irradiance
from ..remove.spectrum import SUN_ZENITH
from . import spectra
from .spectra import Model, Places
from .state import LASTS, LEAST_DELAY, Float32, Sample, Setting, State, full_scale

Kinds = npt.NDArray[np.uint8]
Bins = npt.NDArray[np.int8]

RATE, TOGETHER = 1e-5, 2.8
"""`RATE`: default false-alarm rate: a pixel of sparkle reaches S = ln(1 / rate) with a probability of at most `rate`.
`TOGETHER`: factor for the sum over 3 x 3 pixels, as the blurred light of one facet raises S in about three pixels."""
SPECTRA_ALIKE, LIT_TOGETHER = 10.0, 4.0
"""`SPECTRA_ALIKE`: of the pixels that sparkle makes bright in all bands, one in ten has the spectrum of a target.
`LIT_TOGETHER`: one flash makes about four of 3 x 3 pixels bright."""
FEWEST_BANDS = 4  # three bands always fit the three parameters of a smooth spectrum
LASTING = 0.2
"""Share of faint lit pixels that keep their brightness in all bands, above which sparkle cannot be distinguished from
targets: 0.30 for 20 ms between bands and pixels of 0.9 m, up to 0.09 where the test works. Targets are not faint."""
COMMON = 0.1  # share of water above which detections are texture of the bottom (14 to 32 %); dense boats cover 6 %
MEAN_WINDOW = 15  # side of the local mean that replaces a missing background [pixel]: three times a target of 5 pixels
DISPLACEMENTS = 37, 53  # shift (row, column) of later bands that simulates false alarms; wider than clumps [pixel]
EXCEEDS, FEWEST_LIT, LONE = 3.0, 3, 2.0
"""`EXCEEDS`: standard deviations of noise above which a pixel is lit (bright) in a band (one pixel of water in 700).
`FEWEST_LIT`: fewest bands in which a target is lit. `LONE`: least S of a pixel of a target (odds of 7 to 1)."""
SAME_PEAK, OUTLINE_REACH = 0.7, 2
"""`SAME_PEAK`: in a common peak, noise and blur leave each band 0.7 or more of its maximum over 3 x 3 pixels.
`OUTLINE_REACH`: the edge of a target, blurred or hidden by sparkle in one band, extends over two pixels."""
DARK_FROM = 700.0  # wavelength from which water is dark, so that bands show mainly sparkle [nm]
NORMAL_BELOW = 0.1587  # share of a normal distribution that is more than one standard deviation below its median
EXCESS_BINS, LOW = 40, -3.0
"""Number of bins of the histograms of asinh(excess / noise), and their lower end (an excess of -10 times the noise). A
bin spans a factor of about 1.3, by which noise and blur vary a steady light."""


@dataclass(frozen=True)
class Targets:
    """The fitted stage `targets`: it finds small bright targets, whose contrast is restored after the removal."""

    name: ClassVar[str] = "targets"
    bands: tuple[int, ...] = ()  # 0-based bands that are used, in order of time
    wavelengths: tuple[float, ...] = ()  # their centres [nm]
    widths: tuple[float, ...] = ()  # their full widths [nm]
    light: tuple[float, ...] = ()  # relative radiance of a white target, scaled so that `noise` has a median of 1
    noise: tuple[float, ...] = ()  # standard deviation of noise, and of texture of the water, over `light`
    water: tuple[float, ...] = ()  # radiance of water over `light`
    glint: tuple[float, ...] = ()  # relative radiance of glint over `light`
    time: tuple[float, ...] = ()  # time offset [s]
    flash_share: float = 0.0  # share of the pixels with flashes that last through all bands; 0 where they are rare
    full: tuple[float, ...] = ()  # value from which a band is saturated; empty if `time` spans more than `LASTS`
    top: float = 1.0  # upper end of the histograms [asinh(excess)]
    tables: tuple[int, ...] = ()  # index into `following` for each band but the first
    first: tuple[float, ...] = field(default=(), repr=False)  # log probability of each bin in the first band
    following: tuple[tuple[float, ...], ...] = field(default=(), repr=False)  # same, given the bin in the band before
    threshold: float = 0.0  # least score of 3 x 3 pixels (see `Excess.scores`) of a target
    reason: str = ""  # why there is no test, else empty

    @property
    def halo(self) -> int:
        """Margin around a block that the stage needs [pixel]: the sum of the reaches of its steps; 0 without a test."""
        # mean; peaks, saturation, neighbours of peaks, sums; growth by 7 x 7; sums or outline, target; its edge
        return 0 if self.reason else MEAN_WINDOW // 2 + 1 + 1 + 1 + 1 + 3 + 1 + 1 + OUTLINE_REACH + 1

    def apply(self, state: State) -> State:
        """Set `State.targets` to the contrast of targets; without a background, subtract them from the image, too."""
        if self.reason:
            return state
        excess = Excess.of(self, state.raw, state.background)
        places, found = excess.restored(*excess.scores())
        targets = np.zeros(state.raw.shape, np.float32)
        targets.reshape(len(targets), -1)[np.array(self.bands)[:, None], places] = found
        image = state.image - targets if state.background is None else state.image
        return replace(state, targets=targets, image=image)

    @property
    def models(self) -> list[Model]:
        """Models of targets for each brightness (see `spectra.models`)."""
        return spectra.models(self.wavelengths, self.widths, self.water, self.noise)

    def flashes(self, change: float = spectra.CHANGE) -> list[Model]:
        """Models of flashes that last through all bands, for each brightness; `change` is as in `spectra.flashes`."""
        return spectra.flashes(self.glint, self.time, self.noise, change)

    @cached_property
    def _steps(self) -> Float32:
        """Log probability of a histogram bin given the bin in the band before, (table, bin before, bin)."""
        return np.array(self.following, np.float32).reshape(-1, EXCESS_BINS, EXCESS_BINS)

    @property
    def dark(self) -> list[int]:
        """Positions in `bands` of the bands in which water is dark, so that they show mainly sparkle (`DARK_FROM`)."""
        return [b for b, w in enumerate(self.wavelengths) if w >= DARK_FROM]

    @property
    def lit(self) -> int:
        """Index of the histogram bin of an excess of 3 times `light` (`EXCEEDS`); pixels in higher bins are lit."""
        return int((np.arcsinh(EXCEEDS) - LOW) * EXCESS_BINS / (self.top - LOW))

    def binned(self, e: Float32) -> Bins:
        """Index of the histogram bin of each excess; `e` and the result are (band, pixel)."""
        return np.clip((np.arcsinh(e) - LOW) * (EXCESS_BINS / (self.top - LOW)), 0, EXCESS_BINS - 1).astype(np.int8)

    def sparkle(self, e: Float32) -> Float32:
        """Log likelihood that a pixel is sparkle, (pixel,); `e`, (band, pixel), as in `score`."""
        q = self.binned(e)
        chain = [self._steps[k, a, b] for k, (a, b) in zip(self.tables, pairwise(q), strict=True)]
        each = np.float32(np.log(EXCESS_BINS / (self.top - LOW))) - np.log1p(e * e) / 2
        return np.asarray(each.sum(axis=0) + np.array(self.first, np.float32)[q[0]] + np.sum(chain, axis=0), np.float32)

    def score(self, e: Float32) -> tuple[Float32, Places]:
        """Log likelihood ratio S of target and sparkle, and index of the likeliest spectrum of a target, (pixel,) each.
        `e` (band, pixel) is the excess over the background divided by `light`.
        """
        target, kind = spectra.likelihoods(e, self.models)
        other = self.sparkle(e)
        if self.flash_share:
            flash, _ = spectra.likelihoods(e, self.flashes())
            other = np.logaddexp(other, np.float32(np.log(self.flash_share)) + flash)
        return target - other, kind


@dataclass(frozen=True, eq=False)
class Excess:
    """A block, its background and their difference, the excess, with tests of the excess; bands in order of time."""

    stage: Targets
    raw: list[Float32]  # the block, (row, column) for each band
    below: list[Float32]  # its background
    afloat: bool = False  # True without background: a target must be lit in a band with dark water, if there is one

    @classmethod
    def of(cls, stage: Targets, raw: Float32, background: Float32 | None) -> Self:
        """Excess of a block `raw` over `background`, (band, row, column) each; if it is None, over the local mean."""
        planes = [raw[b] for b in stage.bands]
        if background is None:
            return cls(stage, planes, [np.asarray(cv2.blur(p, (MEAN_WINDOW,) * 2)) for p in planes], afloat=True)
        return cls(stage, planes, [background[b] for b in stage.bands])

    def at(self, places: Places) -> Float32:
        """Excess divided by `light`, (band, pixel), at the flat indices `places` of pixels."""
        lit, at = zip(self.raw, self.below, self.stage.light, strict=True), np.divmod(places, self.raw[0].shape[1])
        return np.stack([(r[at] - m[at]) / np.float32(w) for r, m, w in lit])

    def peaks(self) -> Mask:
        """Mask (row, column) of possible peaks of targets: pixels that are lit (`EXCEEDS`), with nearly the largest
        excess of 3 x 3 pixels (`SAME_PEAK`), in at least three bands, which are not all in one half of the bands.
        """
        count, square = np.zeros((2, *self.raw[0].shape), np.uint8), np.ones((3, 3), np.uint8)
        planes = zip(self.raw, self.below, self.stage.light, self.stage.noise, strict=True)
        for i, (raw, below, light, s) in enumerate(planes):
            e = raw - below
            limit = np.maximum(cv2.dilate(e, square) * np.float32(SAME_PEAK), np.float32(EXCEEDS * s * light))
            count[2 * i // len(self.raw)] += e >= limit
        return np.asarray((count > 0).all(axis=0) & (count.sum(axis=0) >= FEWEST_LIT))

    def saturated(self) -> Mask:
        """Mask (row, column) of pixels saturated in a band, and of their neighbours. They are not tested for targets,
        as clipped sparkle has the spectrum of white paint. All False if time offsets span more than 0.1 s (`LASTS`).
        """
        limits = self.stage.full or [np.inf] * len(self.raw)
        return grown(np.any([raw >= np.float32(limit) for raw, limit in zip(self.raw, limits, strict=True)], axis=0), 3)

    def scores(self) -> tuple[Float32, Float32, Kinds]:
        """S (log likelihood ratio of target and sparkle), score of 3 x 3 pixels, and index of the likeliest spectrum of
        a target, (row, column) each; computed at and around `peaks`, and 0 elsewhere. S is set to 0 where it is at most
        `LONE`, where fewer than three bands are lit (or, if `afloat`, no band with dark water), and where pixels are
        `saturated`. The score is the sum of S over 3 x 3 pixels. Where this sum exceeds ln(1 / `RATE`), the log
        likelihood ratio of a common `outline` is added to it.
        """
        shape, least = self.raw[0].shape, EXCEEDS * np.array(self.stage.noise, np.float32)[:, None]
        S, known, kind = np.zeros(shape, np.float32), self.saturated(), np.zeros(shape, np.uint8)

        def weigh(where: Mask) -> Float32:
            """Compute S in the pixels `where` that do not have it yet; return the sum of S over 3 x 3 pixels."""
            i = np.flatnonzero(where & ~known)
            known.flat[i], e = True, self.at(i)
            bright = e > least
            lit = bright.sum(axis=0) >= FEWEST_LIT
            if self.afloat and self.stage.dark:
                lit &= bright[self.stage.dark].any(axis=0)
            found, kind.flat[i[lit]] = self.stage.score(e[:, lit])
            S.flat[i[lit]] = np.where(found > LONE, found, 0)
            return box_sum(S, 3)

        some = np.log(1 / RATE)
        weigh(self.peaks())
        T = weigh(grown(S > 0, 3))  # neighbours of peaks, which complete the sums around the peaks
        T = weigh(grown(some < T, 7))  # all pixels that the sums near a possible target and its outline can reach
        rows, columns = np.nonzero(some < T)
        T[rows, columns] += self.outline(rows, columns)
        return S, T, kind

    def outline(self, rows: Places, columns: Places) -> Float32:
        """Log likelihood ratio of target and sparkle, (pixel,), by `same_outline` in 3 x 3 pixels around each pixel."""
        (height, width), steps = self.raw[0].shape, (-1, 0, 1)
        row, column = ([np.clip(v + i, 0, n - 1) for i in steps] for v, n in ((rows, height), (columns, width)))
        return spectra.same_outline(np.stack([self.at(r * width + c).T for r in row for c in column], axis=1))

    def restored(self, S: Float32, T: Float32, kind: Kinds) -> tuple[Places, Float32]:
        """Flat indices of pixels, and contrast to restore in them, (band, pixel) [unit of the band]. The arguments are
        the results of `scores`. On a target, the contrast is at most the excess plus 3 times the noise. Up to two
        pixels beside a target, it is the contrast of the nearest pixel of the target times a factor of 0 to 1. The
        factor is the second lowest of the ratios, one for each band, of excess to contrast.
        """
        on = grown(self.stage.threshold < T, 3) & (S > 0)
        places = np.flatnonzero(on)
        light, s = (np.array(v, np.float32)[:, None] for v in (self.stage.light, self.stage.noise))
        if not places.size:
            return places, np.zeros((len(self.raw), 0), np.float32)
        e = self.at(places)
        full = spectra.contrast(e, kind.flat[places], self.stage.models)
        away, label = cv2.distanceTransformWithLabels(
            (~on).view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        number = np.zeros(int(label.max()) + 1, np.intp)
        number[label.flat[places]] = np.arange(places.size)
        beside = np.flatnonzero((away > 0) & (away < OUTLINE_REACH + 0.5))
        spectrum = full[:, number[label.flat[beside]]]
        share = np.clip(np.sort(self.at(beside) / np.maximum(spectrum, s), axis=0)[1], 0, 1)
        own = np.minimum(full, np.maximum(e + EXCEEDS * s, 0))
        return np.concatenate([places, beside]), np.concatenate([own, spectrum * share], axis=1) * light


def fit(sample: Sample, setting: Setting, number: float | None = None) -> Targets:
    """Fit the stage to a scene: histograms of sparkle and the detection threshold. `setting` describes the scene.

    If targets cannot be distinguished from sparkle, the stage does nothing; `reason` says why. Without background, the
    local mean is used. `number`: false-alarm rate per pixel, default 1e-5. Raises FitError if the sample is too small.
    """
    t, w = setting.offsets, setting.wavelengths
    order = [b for b in range(len(w)) if 300 < w[b] < 1000]
    if len(order) < FEWEST_BANDS:
        return Targets(reason=f"{len(order)} bands are between 300 and 1000 nm, need at least {FEWEST_BANDS}")
    if t is None or np.ptp(t[order]) < LEAST_DELAY:
        why = "are not known" if t is None else "differ by less than 10 ms"
        return Targets(reason=f"time offsets of the bands {why}: nothing distinguishes targets from sparkle")
    order.sort(key=list(zip(t, w, strict=True)).__getitem__)
    stage, t = described(sample, setting, order), t[order]
    if np.ptp(t) <= LASTS:
        stage = replace(stage, full=tuple(full_scale(sample, setting)[order].tolist()))
    blocks = [Excess.of(stage, s.raw, s.background) for s in sample.states]
    planes = [x.at(np.arange(x.raw[0].size)).reshape(-1, *x.raw[0].shape) for x in blocks]
    excess = sample.values(planes)
    stage = replace(with_texture(stage, excess), top=float(np.arcsinh(excess.max(initial=1))) + 1e-3)
    q = stage.binned(excess)
    stage = histograms(stage, q, t)
    if (lasts := lasting_share(q, stage)) > LASTING:
        return Targets(reason=f"{lasts:.0%} of the sparkle lasts in all bands: nothing distinguishes targets from it")
    later = int(np.diff(t).round(6).argmax()) + 1  # after the longest pause
    # with later bands displaced, brightness stays the same by chance only
    displaced = sample.values([np.concatenate([e[:later], np.roll(e[later:], DISPLACEMENTS, (1, 2))]) for e in planes])
    persistence = max(extrapolated(steady(q, stage).mean(axis=1)), steady(stage.binned(displaced), stage)[-1].mean())
    rate = number or RATE
    threshold = TOGETHER * np.log(1 / rate) + LIT_TOGETHER * np.log(max(persistence / (SPECTRA_ALIKE * rate), 1))
    lit = excess[:, (excess > EXCEEDS * np.array(stage.noise, np.float32)[:, None]).all(axis=0)]
    flashes = stage.flashes(), stage.flashes(spectra.NO_CHANGE)
    frequent = spectra.lasting_flashes(lit, stage.sparkle(lit), stage.models, *flashes).sum() / excess.shape[1]
    stage = replace(stage, threshold=float(threshold), flash_share=float(frequent))
    if (share := found_share(stage, blocks, sample)) > COMMON:
        return Targets(reason=f"{share:.0%} of the water would be targets, probably texture of the bottom")
    return stage


def described(sample: Sample, setting: Setting, order: Sequence[int]) -> Targets:
    """Make a stage with the properties of its bands (fields `bands` to `time`); `order` has 0-based bands by time."""
    below = [x.raw if x.background is None else x.background for x in sample.states]
    water = np.median(sample.values(below), axis=1)[list(order)]
    w = setting.wavelengths[list(order)]
    apart = np.gradient(np.sort(w))[np.argsort(np.argsort(w))]  # bands whose width is not known touch each other
    widths = np.array([setting.bands[b].width or g for b, g in zip(order, apart, strict=True)])
    inside = np.clip(w[:, None] + widths[:, None] * np.linspace(-0.5, 0.5, 17), 300, 1000)
    light = np.sum(irradiance(inside, SUN_ZENITH), axis=0).mean(axis=1)
    s = sample.noise_of([x.raw[list(order)] for x in sample.states])
    light *= np.median(s / light)
    glint, t = irradiance(inside, SUN_ZENITH).direct.mean(axis=1), np.asarray(setting.offsets)[list(order)]
    numbers = [tuple(map(float, v)) for v in (w, widths, light, s / light, water / light, glint / light, t)]
    return Targets(tuple(order), *numbers)  # type: ignore[arg-type]


def found_share(stage: Targets, blocks: Sequence[Excess], sample: Sample) -> float:
    """Share of the sample's pixels with a score above `stage.threshold` within 3 x 3 pixels; `afloat` is False."""
    scores = (replace(x, stage=stage, afloat=False).scores()[1] for x in blocks)
    return float(sample.values([grown(stage.threshold < T, 3).astype(np.float32) for T in scores]).mean())


def with_texture(stage: Targets, e: Float32) -> Targets:
    """The stage with a `noise` that includes texture of the water, such as a bottom; `e` (band, pixel) as in `score`.
    Pixels not lit in bands with dark water are used. `noise` squared becomes the variance of their darker half, minus
    the variance of glint. The standard deviation of glint is proportional to `glint`, and as large as possible without
    exceeding the standard deviation of these pixels in any band with dark water. `noise` never decreases.
    """
    s, glint, dark = np.array(stage.noise), np.array(stage.glint), stage.dark
    quiet = e[:, (e[dark] < EXCEEDS * s[dark, None]).all(axis=0)]
    if not dark or not quiet.size:
        return stage
    below, middle = np.percentile(quiet, [100 * NORMAL_BELOW, 50], axis=1)
    of_glint = np.min((middle - below)[dark] / glint[dark]) * glint
    return replace(stage, noise=tuple(np.sqrt(np.maximum((middle - below) ** 2 - of_glint**2, s**2)).tolist()))


def histograms(stage: Targets, q: Bins, t: Float64) -> Targets:
    """The stage with `tables`, `first` and `following`, from the histogram bins `q` (band, pixel) of sparkle.
    `t` is the time of each band [s]. Only bands with dark water are used (`dark`), or all if fewer than two are dark.
    The table for a step to the next band comes from those pairs of these bands whose delay is nearest to the step's.
    """
    dark = stage.dark if len(stage.dark) > 1 else list(range(len(t)))
    pairs = np.array([(i, j) for i in dark for j in dark if i != j])
    smooth = cv2.getGaussianKernel(7, 1.5)
    counts = np.bincount(q[dark].ravel(), minlength=EXCESS_BINS).astype(np.float64)
    single = cv2.sepFilter2D(counts[:, None], -1, np.ones(1), smooth).ravel() + 0.5
    single /= single.sum()
    off = np.abs(np.abs(t[pairs[:, 0]] - t[pairs[:, 1]]) - np.diff(t)[:, None])  # (step, pair) [s]
    nearest = [tuple(np.flatnonzero(row < row.min() + 1e-3)) for row in off]
    distinct, transitions = list(dict.fromkeys(nearest)), []
    for same in distinct:
        i, j = (np.concatenate(q[pairs[list(same), k]]).astype(np.intp) for k in (0, 1))
        both = np.bincount(i * EXCESS_BINS + j, minlength=EXCESS_BINS**2).reshape(EXCESS_BINS, -1).astype(np.float64)
        both = cv2.sepFilter2D(both, -1, smooth, smooth, borderType=cv2.BORDER_REPLICATE) + 5 * single
        transitions.append(tuple(np.round(np.log(both / both.sum(axis=1, keepdims=True)), 3).ravel().tolist()))
    tables, first = tuple(map(distinct.index, nearest)), tuple(np.log(single).tolist())
    return replace(stage, tables=tables, first=first, following=tuple(transitions))


def lasting_share(q: Bins, stage: Targets) -> float:
    """Share of pixels that are `steady` in all steps, of the darker half of the pixels lit in the first band."""
    lit = q[0] > stage.lit
    faint = lit & (q[0] <= np.median(q[0, lit])) if lit.any() else lit
    return float(steady(q, stage)[-1, faint].mean()) if faint.any() else 0.0


def steady(q: Bins, stage: Targets) -> Mask:
    """Mask (step, pixel); a step leads from one band to the next in time. True where in this and all earlier steps the
    second band is lit (`Targets.lit`), and the histogram bins of both, in `q` (band, pixel), differ by at most 1.
    """
    return np.logical_and.accumulate([(np.abs(b - a) <= 1) & (b > stage.lit) for a, b in pairwise(q)])


def extrapolated(runs: Float64) -> float:
    """Share of the pixels in which sparkle (not a target) stays bright in all bands.

    `runs` (step,): share of the pixels that stay bright for 1, 2, ... steps after the first band. The part of sparkle
    falls geometrically, the part of targets is constant. The part of sparkle at the last step is returned.

    Examples
    --------
    >>> round(extrapolated(0.2 * 0.5 ** np.arange(7) + 0.01), 6)  # a hundredth is targets
    0.003125
    """
    ends = np.maximum(-np.diff(runs), 0)
    ratio = float(np.clip(np.median(ends[1:] / np.maximum(ends[:-1], 1e-12)), 0, 0.95))
    return float(ends[-1]) * ratio / (1 - ratio)
