r"""Posterior mean of the water, given the glint that the removal left.

.. math:: x = w + n + r, \quad w \sim N(\mu, \tau^2), \quad n \sim N(0, s^2), \quad r \sim N(0, v(g))

.. math:: E[w + n \mid x] = x - q (x - \mu), \qquad q = \frac{v}{v + s^2 + \tau^2}

.. math:: E[(E[w + n \mid x] - w)^2] = (1 - q)^2 (s^2 + v) + q^2 (\tau^2 + var(\mu))

x is a band after removal, w the water, n noise of variance :math:`s^2`, and r the error of the removal: glint that is
left, or removed in excess. The variance v of r grows with the removed glint g and is measured on the scene. Pixels are
grouped by g. In each group, v is the variance about a median of 5 x 5 pixels, minus the same variance in the group with
the least glint. Variation where no glint was removed (noise of any correlation, and texture) is thus not counted as
glint. A pixel from which nothing was removed keeps exactly its value, unless it is saturated or a pit (a dark pixel
that resampling makes beside glint). The mean :math:`\mu` and the variance :math:`\tau^2` of the water are estimated
from a window about twice as wide as a clump of glint, with the weights :math:`1 / (v + s^2)` (for constant v this is
the filter of Lee 1980); :math:`var(\mu)` is the variance of the estimated mean. At edges and objects,
:math:`\tau^2` is large, and the pixel is hardly changed.

The method fails where strong glint covers a window: the mean of the water then has the error of the removal. Objects
narrower than a clump under strong glint are lost, but get a large standard error. Cost: three box filters per band.

References
----------
Lee (1980), IEEE Trans. Pattern Anal. Mach. Intell. 2, 165-168, doi:10.1109/TPAMI.1980.4766994 (local mean, variance).
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import cv2
import numpy as np

from ..morphology import grown
from ..remove.noise import noise, spread
from .state import FEWEST, Float32, Sample, Setting, State, full_scale

GLINT_QUANTILES = (*np.linspace(0.0, 0.95, 20), 0.97, 0.985, 0.993, 0.998, 1.0)
"""Quantiles of the removed glint that bound the groups of pixels: most glint is in the last few."""
CLUMP_REACH = 0.9
"""Half of the window's side, in widths of a clump: glint is uncorrelated at this distance. Values of 0.6 to 1.6 change
the results by less than 5 %."""
NARROWEST_CLUMP = 3  # lower limit of the width of a clump [pixel]: the mean of fewer pixels is too uncertain
WAVES_RESOLVED, RESOLVED, STRONG_QUANTILE = 5.0, 3.0, 0.993
"""Pixels of at least `WAVES_RESOLVED` [m] hold whole waves: their texture grows with the waves. Such an image is
changed only if pixels with strong glint (above `STRONG_QUANTILE`) have more than `RESOLVED` times the standard
deviation of pixels with little glint, in the mean over bands. For texture alone the ratio is smaller."""
WIDEST_CLUMP = 32  # largest lag of the autocorrelation of glint [pixel]
TABLE_ENTRIES = 2048  # entries of the lookup table of variances, denser for little glint; np.interp is ten times slower
LEAST_VARIANCE = np.float32(0.01)  # lower limit of the variance of the water, relative to the variance of noise
UNKNOWN = np.float32(1e6)
"""Variance of left-over glint, relative to the variance of noise, in pixels without information on the water: saturated
pixels, and for the posterior mean also pits, which are zero or negative in a corrected band."""
PIT_REACH, DEEP = 3, 10.0
"""Resampling digs pits beside glint: the kernels of cubic and Lanczos interpolation have negative lobes up to
`PIT_REACH` pixels away, a tenth of the glint deep. They exceed noise beside glint of `DEEP` standard deviations."""


@dataclass(frozen=True)
class LeftOver:
    """Variance of the glint that the removal left in one band.
    The variance depends on the removed glint. It is interpolated linearly between the amounts in `glint`; above the
    last amount, it grows with the square of the removed glint.
    """

    band: int  # 0-based
    sigma: float  # standard deviation of noise [unit of the band]
    glint: tuple[float, ...]  # amounts of removed glint [unit of the band]
    variance: tuple[float, ...]  # variance of the glint that is left, at these amounts [unit of the band squared]
    water: float = 0.0  # median of the band after the removal [unit of the band]
    ratio: float = 0.0  # of standard deviations about a 5 x 5 median, in strong glint over that in little glint

    def of(self, glint: Float32) -> Float32:
        """Variance of the glint that is left, (row, column) [unit of the band squared], given the removed `glint`."""
        if not any(self.variance):
            return np.zeros_like(glint)
        part = glint * np.float32(1 / self.glint[-1])
        root = np.linspace(0.0, 1.0, TABLE_ENTRIES)
        table = np.interp(self.glint[-1] * root**2, self.glint, self.variance).astype(np.float32)
        place = np.sqrt(np.clip(part, 0, 1)) * (TABLE_ENTRIES - 1)
        return table.take(place.astype(np.intp)) * np.square(np.maximum(part, 1))


def left_over(band: int, sample: Sample) -> LeftOver:
    """Measure on a sample how the error of the removal in a 0-based band grows with the removed glint."""
    images = [s.image[band] for s in sample.states]
    rest = sample.values([i - np.asarray(cv2.medianBlur(i, 5), np.float32) for i in images])
    taken = sample.values([s.removed[band] for s in sample.states if s.removed is not None])
    sigma = min(noise([s.raw[band] for s in sample.states], sample.inside), noise(images, sample.inside))
    water = float(np.median(sample.values(images)))
    limits = np.unique(np.quantile(taken, GLINT_QUANTILES))
    if limits.size < 3:
        return LeftOver(band, sigma, (0.0,), (0.0,), water)
    group = np.searchsorted(limits[1:-1], taken)
    parts = [rest[group == k] for k in range(limits.size - 1)]
    spreads = np.maximum.accumulate([spread(p) if p.size >= FEWEST // 2 else 0.0 for p in parts])
    calm = max(sigma, float(spreads[0]))
    middles = (limits[1:] + limits[:-1]) / 2
    variance = np.maximum(spreads**2 - calm**2, 0.0)
    ratio = float(np.interp(np.quantile(taken, STRONG_QUANTILE), middles, spreads)) / calm
    sigma = max(sigma, float(np.sqrt(variance.max() / UNKNOWN)))  # integers may hide noise
    return LeftOver(band, sigma, tuple(map(float, middles)), tuple(map(float, variance)), water, ratio)


@dataclass(frozen=True)
class Posterior:
    """The fitted stage `posterior`: it replaces the image by the posterior mean, and estimates its error variance.
    If `resolved` is False, the image is not changed, as its variation may be texture; only `State.variance` is set.
    """

    name: ClassVar[str] = "posterior"
    width: int  # width of a clump of glint [pixel]
    left: tuple[LeftOver, ...]  # one for each band that the removal corrected
    saturation: tuple[float, ...]  # value from which each band of the scene is saturated; infinity if not known
    resolved: bool = True  # True if variation under glint is glint that is left (`RESOLVED`)

    @property
    def side(self) -> int:
        """Side of the window from which the mean of the water is estimated [pixel]."""
        return 2 * round(CLUMP_REACH * max(self.width, NARROWEST_CLUMP)) + 1

    @property
    def halo(self) -> int:
        """Margin around a block that the stage needs [pixel]."""
        return self.side // 2 + PIT_REACH

    def apply(self, state: State) -> State:
        """Set the image to the posterior mean (if `resolved`), and `State.variance` to its variance (if `errors`)."""
        assert state.removed is not None  # in a chain, the removal comes before
        taken, image = state.removed, state.image.copy()
        variance = np.zeros_like(image) if state.errors else None
        unknown = (state.raw >= np.array(self.saturation, np.float32)[:, None, None]).any(axis=0)
        for left in (p for p in self.left if self.resolved and p.water > p.sigma):  # darker water is often zero
            beside = grown(taken[left.band] > np.float32(DEEP * left.sigma), 2 * PIT_REACH + 1)
            unknown |= (state.raw[left.band] <= 0) & beside
        for left in self.left:
            b, s2 = left.band, np.float32(left.sigma**2)
            v = left.of(taken[b])
            v[unknown] += UNKNOWN * s2
            error = None if variance is None else variance[b]
            if self.resolved:
                image[b] = posterior_mean(state.image[b], v, s2, self.side, error)
            elif error is not None:
                np.add(v, s2, out=error)
        return replace(state, image=image, variance=variance)


def posterior_mean(x: Float32, v: Float32, s2: np.float32, side: int, error: Float32 | None = None) -> Float32:
    """Posterior mean of water plus noise in a band, (row, column) [unit of `x`]; exactly equal to `x` where `v` is 0.

    x : (row, column), a band after removal
    v : (row, column), variance of the glint that is left in each pixel [unit of `x` squared]
    s2 : variance of noise [unit of `x` squared]
    side : side of the window for the mean of the water [pixel]
    error : (row, column), array to fill with the error variance, noise included [unit of `x` squared]; None: not needed
    """

    def mean(a: Float32) -> Float32:
        return np.asarray(cv2.blur(a, (side, side), borderType=cv2.BORDER_REFLECT_101), np.float32)

    total = v + s2
    weighted = s2 / total
    sums = np.maximum(mean(weighted), np.float32(1e-9))
    weighted *= x
    around = mean(weighted) / sums
    weighted *= x
    water = mean(weighted) / sums - around * around  # around the window's own mean
    known = s2 / sums
    np.maximum(water - known, 0, out=water)
    water += LEAST_VARIANCE * s2
    share = v / (total + water)
    if error is not None:
        error[...] = (1 - share) ** 2 * total + share**2 * (water + known / np.float32(side * side))
    return np.asarray(x - share * (x - around), np.float32)


def fit(sample: Sample, setting: Setting, number: float | None = None) -> Posterior:
    """Fit the stage: measure the glint that is left in a sample after the removal. `setting` describes the scene;
    `number` is the width of a clump of glint [pixel], by default as measured in the first NIR band. Raises FitError if
    the sample is too small.
    """
    taken = [s.removed for s in sample.states if s.removed is not None]
    corrected = [b for b in range(len(setting.bands)) if any(plane[b].any() for plane in taken)]
    left = tuple(left_over(b, sample) for b in corrected)
    width = int(number) if number else clump_width(sample, setting.nir[0])
    resolved = setting.pixel < WAVES_RESOLVED or float(np.mean([p.ratio for p in left] or [0.0])) > RESOLVED
    return Posterior(width, left, tuple(full_scale(sample, setting).tolist()), resolved)


def clump_width(sample: Sample, band: int) -> int:
    """Width of a clump of glint in a 0-based band [pixel]: twice the smallest lag at which the autocorrelation is below
    1/2. If it is nowhere below 1/2, the width is 64.
    """
    total = np.zeros(WIDEST_CLUMP)
    for state in sample.states:
        plane = state.raw[band]
        high = plane - cv2.blur(plane, (4 * WIDEST_CLUMP + 1,) * 2)
        lags = np.fft.irfft2(np.abs(np.fft.rfft2(high)) ** 2, s=high.shape)
        n = min(WIDEST_CLUMP, *high.shape)
        total[:n] += lags[0, :n] + lags[:n, 0]
    below = total < total[0] / 2
    return 2 * int(np.argmax(below)) if below.any() else 2 * WIDEST_CLUMP
