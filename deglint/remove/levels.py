"""Glint-free level of a glint index: the mode of a sample (`mode`), or levels for all bands together (`shared_level`).

References
----------
Parzen (1962), "On estimation of a probability density function and mode", Annals of Mathematical Statistics 33,
1065-1076, doi:10.1214/aoms/1177704472.
Silverman (1986), "Density estimation for statistics and data analysis", Chapman and Hall.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from ..errors import FitError
from ..moments import Float64, Mask
from ..morphology import grown
from ..scene import FloatArray
from .kernels import FOLDS

_BINS_PER_BANDWIDTH = 8  # histogram bins per bandwidth
_BANDWIDTH_REACH = 4  # distance at which the Gaussian kernel is truncated [bandwidth]
_MOST_BINS = 1 << 20  # most bins of a histogram, so that outliers do not make it too large
MOSTLY_CLEAR, SPARSE, SHEET_SPAN = 0.05, 0.1, 0.3
"""Limits of the span (`span_of`) below which glint is clear, sparse or dense; else it is a sheet. The span is the range
of the lower half of the predictions (the NIR that the kernels predict), relative to the range from their median to
their 99th percentile: .007 to .02 for pixels that resolve sparkle, .2 for pixels of 5 m, .32 to .5 for 10 m."""
NORMAL_TAIL, RARE = 1.65, 0.3
"""If waves are resolved, or glint is no sheet, a second test is made: the 1st percentile of the predictions is more
than `NORMAL_TAIL` times as far from the median as the 10th (1.82 for normal noise, more beside dark rings of
resampling), and `even_share` is below `RARE`. Glint is then clear, or rare if the span is at least `SPARSE`."""
LEAST_GLINT, LEAST_DENSE, LEAST_CLEAR = 0.2, 0.05, 40.0  # shares of the sample in `GLINT_KINDS` [%]
AVERAGED = 3  # side of the window of the means and of the binomial filter in `GLINT_KINDS` [pixel]
GLINT_KINDS = {
    "clear": ("mean", LEAST_CLEAR, False),
    "rare": ("binomial", LEAST_CLEAR, False),
    "sparse": ("mean", LEAST_GLINT, False),
    "dense": ("binomial", LEAST_DENSE, True),
    "sheet": ("pixel", LEAST_DENSE, True),
}
"""Three properties of each kind of glint. The first says where the least glint is searched: in means of pixels, after a
binomial filter, or in single pixels. The second is the share of the sample with the least glint [%], and the level is
the median of the predictions in this share. The third is True if local means must not become negative, False if single
pixels must not; errors of the kernels make some pixels negative. Where glint is clear or rare, most pixels differ by
noise alone. Where it is sparse, some water has none, and means of pixels are searched: in single pixels the lowest
noise would be taken as the level. Where it is dense, such a mean always has glint, and a binomial filter suppresses
noise and the negative lobes of resampling. In a sheet every pixel may have glint, which changes from pixel to pixel, so
single pixels are used: an image does not show how much of the minimum is water and how much is a sheet of glint."""
STRONG_PERCENTILE, PIT = 98.0, 7
"""Percentile of the predictions above which glint is strong [%], and side of the square around such a pixel that is
excluded because of negative lobes [pixel]: two lobes of a Lanczos kernel and the kernel of the removal."""
NEGATIVE_SHARE = 0.1  # share of pixels with little glint (or of local means) that may be negative after removal [%]
SUBTRACTED = 0.05  # a band with this share of negative values before the removal may be negative: its water is
DARKER = 0.75
"""Largest ratio of NIR to visible light of water, divided by the same ratio for glint. It rises with sediment (Doxaran
et al. 2002, Remote Sensing of Environment 81, 149-161, doi:10.1016/S0034-4257(01)00341-8) and exceeds .75 in the most
turbid estuaries only; mirrored sky and haze have .4 to .75."""
LEVEL_PIXELS = 50_000  # pixels from which the error of the level is estimated: about 100 of them have the least glint
LEAST_OF_MEDIAN = 0.5
"""Largest ratio of least to median glint if all pixels have glint: waves make it .23 to .48 in 1.6 to 10 m pixels."""


def mode(sample: FloatArray) -> float:
    """Mode of n values (pixel,), for float and integer data alike.

    The mode is the peak of a Gaussian kernel density (Parzen 1962). Its bandwidth h = (4/5)^(1/7) s n^(-1/7) is the
    optimum for the derivative of a density (Silverman 1986); the optimum for the density itself leaves several local
    maxima. The scale s is 1.4826 times the median distance of the values below the mode to the mode. Scale and mode are
    determined together by iteration, so that glint, which lies above the mode, does not affect s. The density is
    computed on a histogram of bins h/8 wide, and a parabola refines the peak. Where values come in steps (integers, or
    integers times a factor), a bin contains an integer number of steps and is centred on them.

    Raises FitError if there are no values.

    Notes
    -----
    One main peak is assumed. If values are shifted or scaled, so is the mode (to rounding). The error falls with
    n^(-2/7); a half-sample mode, the usual alternative, is several times noisier. The cost is a sort and a few passes.
    """
    if sample.size == 0:
        raise FitError("the sample is empty, so that it has no mode.")
    values: Float64 = np.sort(sample.astype(np.float64))
    quarter, three_quarters = np.quantile(values, [0.25, 0.75])
    scale = float(three_quarters - quarter) / 1.349 or float(values[-1] - values[0])
    if scale == 0:
        return float(values[0])
    step = _step(values)
    peak = _density_peak(values, scale, step)
    for _ in range(10):
        below = values[: max(np.searchsorted(values, peak, side="right"), 1)]
        lower = max(1.4826 * float(np.median(peak - below)), step / 2)
        if lower <= 0 or abs(lower - scale) < 0.01 * scale:
            break
        scale = lower
        peak = _density_peak(values, scale, step)
    return peak


def even_share(sample: FloatArray) -> float:
    """Share of the variance of values (pixel,) that is symmetric about their median.

    The share is about 1 for noise and nearly 0 for glint. Glint only adds light, so variation below the median has
    other causes, noise or reflected sky, which contribute as much above the median. The share is 2 L / (L + U), with L
    and U the mean square distance from the median in the lower and the upper half; above 1 if L > U, 0 if L + U is 0.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal(100_000)
    >>> round(even_share(noise), 1), round(even_share(np.exp(2 * noise)), 1)
    (1.0, 0.0)
    """
    values = np.sort(sample.astype(np.float64))
    middle, step, half = float(np.quantile(values, 0.5)), _step(values), (values.size + 1) // 2
    if step > 0:  # the median is interpolated within its step
        below, upto = (np.searchsorted(values, middle + d * step) for d in (-0.5, 0.5))
        middle += step * ((values.size / 2 - int(below)) / max(int(upto - below), 1) - 0.5)
    away = values - middle
    lower, upper = away[:half], away[-half:]
    total = float(lower @ lower + upper @ upper)
    return 2 * float(lower @ lower) / total if total > 0 else 0.0


def _density_peak(values: Float64, scale: float, step: float) -> float:
    """Peak of the density of sorted `values`, given their spread `scale` (s in `mode`) and quantisation `step`."""
    bandwidth = 0.8 ** (1 / 7) * scale * values.size ** (-1 / 7)
    fine = bandwidth / _BINS_PER_BANDWIDTH
    if step > 0:
        fine = max(1.0, round(fine / step)) * step
    last = max(float(np.quantile(values, 0.99)), float(values[0]) + 1000 * fine)
    middle = values[: np.searchsorted(values, last, side="right")]
    if (middle[-1] - middle[0]) / fine > _MOST_BINS:  # a far tail below: keep values around the median
        middle = middle[middle >= np.quantile(values, 0.5) - _MOST_BINS * fine / 2]
        middle = middle[: np.searchsorted(middle, middle[0] + _MOST_BINS * fine)]
    low = middle[0] - fine / 2
    counts = np.bincount(((middle - low) / fine).astype(np.int64)).astype(np.float64)
    reach = max(1, round(_BANDWIDTH_REACH * bandwidth / fine))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * fine / max(bandwidth, fine / 2)) ** 2)
    return float(low + fine * (_peak(np.convolve(counts, kernel)) - reach + 0.5))


def _step(ordered: Float64) -> float:
    """Quantisation step of sorted values [unit of the values]; 0 for continuous values."""
    distinct = ordered[np.concatenate([[True], np.diff(ordered) > 0])]
    if distinct.size < 2 or distinct.size > ordered.size / 2:
        return 0.0
    gaps = np.diff(distinct)
    step = float(np.quantile(gaps, 0.05))
    return step if np.all(np.abs(gaps / step - np.round(gaps / step)) < 0.05) and step > 0 else 0.0


def _peak(counts: Float64) -> float:
    """Position [bin] of the maximum of `counts` (bin,), by a parabola, or the middle of adjacent equal maxima."""
    tops = np.flatnonzero(counts == counts.max())
    if len(tops) > 1:
        run = tops[: np.argmax(np.diff(tops, append=tops[-1] + 2) > 1) + 1]
        return float(run.mean())
    at = int(tops[0])
    left, right = np.pad(counts, 1)[[at, at + 2]]
    return at + 0.5 * (left - right) / (left - 2 * counts[at] + right)


def apart_from_sparkle(together: FloatArray, sample: Mask) -> Mask:
    """The mask `sample` without pixels near strong predicted glint `together`, as resampling darkens these pixels."""
    return sample & ~grown(together > np.percentile(together[sample], STRONG_PERCENTILE), PIT)


@dataclass(frozen=True, eq=False)
class LevelSample:
    """Values of the pixels of a sample from which `shared_level` determines the glint-free level of all bands."""

    prediction: FloatArray  # (band, pixel): NIR at the time of the band, predicted by its kernel [unit of the NIR]
    value: FloatArray  # (band, pixel): value before the removal [unit of the band]
    mean: FloatArray  # (pixel,): sum over bands of prediction times slope, mean of `AVERAGED` x `AVERAGED` pixels
    binomial: FloatArray  # (pixel,): the same sum after a binomial filter of this size
    local: FloatArray  # (band, pixel): local mean of prediction - value / slope [unit of the NIR]
    apart: Mask  # (pixel,): True where a pixel may determine the level (`apart_from_sparkle`); all may if none is True

    def some(self, which: Mask | slice) -> Self:
        """The sample reduced to the pixels that `which`, a mask (pixel,) or a slice, selects."""
        return type(self)(*(values[..., which] for values in vars(self).values()))


def shared_level(
    sample: LevelSample, slopes: Float64, of_glint: Float64 | None = None, *, resolved: bool = False
) -> tuple[Float64, tuple[float, float, float]]:
    """Glint-free level of each band, (band,), and three levels that are common to all bands [unit of the NIR].

    The level of a band is the prediction by its kernel (`LevelSample.prediction`) for water without glint.

    slopes : (band,), glint of the band divided by the glint of its NIR
    of_glint : (band,), the slope of glint alone in visible bands, NaN in other bands. The visible bands limit the
        possible NIR of the water; with None there is no such limit
    resolved : True if pixels are smaller than waves

    The three levels are the lowest one with which almost no pixel with little glint becomes negative, the chosen one,
    and the median of the predicted NIR. The chosen level is the least prediction in the sample, or the lowest level if
    this is larger. The kind of glint (`GLINT_KINDS`: clear, rare, sparse, dense or a sheet) decides how both levels are
    computed. If glint is dense or a sheet, and each pixel contains several waves, all pixels may have glint. Then the
    chosen level is lowered to the highest NIR of the water, computed from the excess b / s - p, with b the value of a
    band, s the slope of glint, p the prediction. Glint cancels in the excess, which is w_b / s - w_NIR, with w_b and
    w_NIR the values of the water. In a visible band w_NIR is at most `DARKER` w_b / s, so at most `DARKER` /
    (1 - `DARKER`) times the excess. The level is not lowered below the lowest level, and the least glint stays at most
    `LEAST_OF_MEDIAN` times the median glint. If waves are resolved, it is not lowered, as some pixels have no glint.
    """
    together = slopes @ sample.prediction / slopes.sum()  # in units of the NIR
    span, middle = span_of(together, sample.apart), float(np.median(together))
    kind = "sparse" if span < SPARSE else "dense" if span < SHEET_SPAN else "sheet"
    if span < MOSTLY_CLEAR or ((resolved or kind != "sheet") and _normal_tail(together)):
        kind = "clear" if span < SPARSE else "rare"
    searched, share, local = GLINT_KINDS[kind]
    if sample.apart.any():
        sample, together = sample.some(sample.apart), together[sample.apart]
    order = together if searched == "pixel" else getattr(sample, searched)
    least = order <= np.percentile(order, share)
    prediction, value = sample.prediction, sample.value
    level = np.median(prediction[:, least], axis=1)
    raised = float(np.median(together[least]))
    unit = _units(np.median(prediction, axis=1) - level, slopes)
    excess = sample.local if local else prediction - value / slopes[:, None]
    less_glint = together <= middle
    short = [
        (_highest(over[inside], NEGATIVE_SHARE + 100 * below) - at) / u
        for over, v, at, u in zip(excess, value, level, unit, strict=True)
        if (below := float((v[less_glint] < 0).mean())) < SUBTRACTED and (inside := (v > 0) & less_glint).any()
    ]
    lowest = min(raised + max(short, default=0.0), middle)
    chosen = max(raised, lowest)
    if kind in ("dense", "sheet") and not resolved:
        uneven = (raised - LEAST_OF_MEDIAN * middle) / (1 - LEAST_OF_MEDIAN)
        chosen = max(min(raised, _darkest(sample, slopes, of_glint)), uneven, lowest)
    interval = float(min(max(lowest, 0.0), chosen)), float(chosen), middle
    return np.asarray(level + (chosen - raised) * unit, np.float64), interval


def floors(sample: LevelSample, slopes: Float64, level: Float64) -> list[float | None]:
    """Lower limit of the result of the removal in each band, (band,) [unit of the band]; None for a band without limit.

    `slopes` and `level`, (band,), are as `shared_level` takes and returns them. The limit is the least positive value
    after removal in the half of the sample with less glint. Errors of the prediction grow with glint: without a limit,
    some pixels of the other half would become darker than this half. A band with many negative values has no limit.
    """
    less_glint = (together := slopes @ sample.prediction) <= np.median(together)
    left = sample.value - slopes[:, None] * np.maximum(sample.prediction - level[:, None], 0)
    limited = (sample.value[:, less_glint] < 0).mean(axis=1) < SUBTRACTED
    known = [b[less_glint & (b > 0) & within] for b, within in zip(left, limited, strict=True)]
    return [float(k.min()) if len(k) else None for k in known]


def _highest(values: FloatArray, share: float) -> float:
    """Value that `share` [%] of the values (pixel,) exceed, or a limit if this is lower, as objects may be bright.

    The limit is twice as far above the median as the value that ten times this share exceeds. For a share of 0.1 %, the
    limit is 26 % farther above the median than the value if the tail is exponential, and 51 % farther if it is normal.
    """
    middle, near, far = np.percentile(values, [50.0, 100 - 10 * share, 100 - share])
    return float(min(far, 2 * near - middle))


def _normal_tail(together: FloatArray) -> bool:
    """Whether predicted NIR, (pixel,), is noise below its median and rare sparkle above: most pixels have no glint."""
    least, low, middle = np.percentile(together, [1.0, 10.0, 50.0])
    return bool(middle - least > NORMAL_TAIL * (middle - low)) and even_share(together) < RARE


def _units(glint: Float64, slopes: Float64) -> Float64:
    """Glint (band,) over its mean, in which bands have weights `slopes`; all 1 if the glint of a band is not > 0."""
    mean = float(slopes @ glint / slopes.sum())
    return glint / mean if mean > 0 and (glint > 0).all() else np.ones_like(glint)


def _darkest(sample: LevelSample, slopes: Float64, of_glint: Float64 | None) -> float:
    """Highest possible NIR of the water, from the visible bands (see `shared_level`); infinite if there are none."""
    if of_glint is None or not (visible := np.isfinite(of_glint)).any():
        return np.inf
    less = (together := slopes @ sample.prediction) <= np.median(together)
    excess = sample.value[visible][:, less] / of_glint[visible, None] - sample.prediction[visible][:, less]
    return DARKER / (1 - DARKER) * float(np.median(excess, axis=1).min())


def span_of(together: FloatArray, apart: Mask | None = None) -> float:
    """Span of the predicted NIR `together`, (pixel,): (median - least) / (99th percentile - median).
    The least is percentile 0.1 of the pixels in the mask `apart`, or of all pixels if it is None or nowhere True.
    """
    middle, strong = np.percentile(together, [50.0, 99.0])
    low = together if apart is None or not apart.any() else together[apart]
    return float((middle - np.percentile(low, LEAST_GLINT / 2)) / max(strong - middle, np.finfo(float).tiny))


def shared_level_error(
    sample: LevelSample, slopes: Float64, of_glint: Float64 | None = None, *, resolved: bool = False
) -> float:
    """Standard error of the level [unit of the NIR]; the arguments are as in `shared_level`.

    It is estimated by the jackknife over groups of neighbouring pixels. If every pixel may have glint (a sheet, see
    `SHEET_SPAN`), a second term is added: the true level then lies between the lowest possible and the chosen level,
    with a probability density that rises linearly to the chosen one. The term is the length of this interval divided by
    the root of 6. The interval reaches down to the highest NIR that water can have, if this is lower.
    """
    sample = sample.some(slice(None, None, max(sample.prediction.shape[1] // LEVEL_PIXELS, 1)))
    pixels = sample.prediction.shape[1]
    group = np.arange(pixels) * FOLDS // pixels
    left_out = [shared_level(sample.some(group != g), slopes, of_glint, resolved=resolved)[1][1] for g in range(FOLDS)]
    error = float(np.std(left_out) * np.sqrt(FOLDS - 1))
    if span_of(slopes @ sample.prediction / slopes.sum(), sample.apart) < SHEET_SPAN:
        return error
    lowest, chosen, _ = shared_level(sample, slopes, of_glint, resolved=resolved)[1]
    lowest = min(lowest, max(_darkest(sample, slopes, of_glint), 0.0))
    return float(np.hypot(error, (chosen - lowest) / np.sqrt(6)))
