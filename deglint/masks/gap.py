"""The gap between water and land in the histogram of the NIR."""

import numpy as np

from ..moments import Float64
from ..scene import FloatArray

INTO_GAP = 0.25
"""Position of the threshold in the gap, 0..1, nearer to the water: ships, piers and mixed pixels fill the rest."""
GAP_BINS = 64  # bins of the histogram in which the gap between water and land is searched


def threshold_in_gap(nir: FloatArray, level: float, high: float) -> float:
    """Threshold of the NIR in the gap between water and land, from the histogram of the NIR.

    `nir`: sorted values (pixel,). `level`: NIR of typical water, where the histogram starts. `high`: end of the gap.
    The peak of the histogram is water. The lower end of its slope, the foot, is where the logarithm of the density lies
    farthest below the straight line from the peak to `high`: the triangle method of Zack, Rogers, Latt (1977), J.
    Histochem. Cytochem. 25, 741-753, doi:10.1177/25.7.70454. The threshold is at foot + `INTO_GAP` * (`high` - foot).
    """
    if not high > level:
        return high
    density, edges = _log_density(nir, level, high)
    peak = int(np.argmax(density))
    line = np.linspace(density[peak], density[-1], len(density) - peak)
    bend = edges[1:][peak + int(np.argmax(line - density[peak:]))]
    return float(bend + INTO_GAP * (high - bend))


def index_of_valley(nir: FloatArray, last: int) -> int:
    """Index, in sorted NIR (pixel,), of the valley of the histogram above index `last`; `last` if there is no valley.

    A valley is a minimum between water and land; on both sides the histogram is at least twice as high. Pixels up to
    `last` vote for water; `last` is below the valley if bands are not calibrated or had an offset subtracted.
    """
    density, edges = _log_density(nir, float(nir[0]), float(np.percentile(nir, 99)))
    start = min(int(np.searchsorted(edges[1:], nir[last])), len(density) - 1)
    lowest = np.minimum.accumulate(density[start:])
    deep = np.minimum(density[start] - lowest, density[start:] - lowest) >= np.log(2)
    if not deep.any():
        return last
    valley = start + int(np.argmin(density[start : start + int(np.argmax(deep))]))
    return max(last, int(np.searchsorted(nir, edges[valley + 1])) - 1)


def _log_density(values: FloatArray, low: float, high: float) -> tuple[Float64, Float64]:
    """Logarithm of a smoothed histogram, (bin,), of sorted `values` from `low` to `high`; and the edges of its bins."""
    between = values[np.searchsorted(values, low) : np.searchsorted(values, high, "right")]
    bins = min(GAP_BINS, 1 + int(np.count_nonzero(np.diff(between))))  # no more bins than values that differ
    counts, edges = np.histogram(between.astype(np.float64) - low, bins, (0.0, high - low))  # float32 may be too coarse
    kernel = np.exp(-0.5 * (np.arange(-4, 5) / (2 * bins / GAP_BINS)) ** 2)
    return np.log(np.convolve(np.pad(counts, 4, "edge"), kernel / kernel.sum(), "valid") + 0.5), edges + low


def end_of_gap(nir: FloatArray) -> float:
    """Upper end of the gap in sorted `nir`: upper edge of the last histogram bin with (nearly) the smallest count."""
    if not nir[-1] > nir[0]:
        return float(nir[-1])
    start = float(nir[0])
    counts, edges = np.histogram(nir.astype(np.float64) - start, GAP_BINS)
    least = int(counts.min())
    chance = least + 2 * np.sqrt(least) + 1  # two standard deviations of a count, and one pixel
    return start + float(edges[1:][np.flatnonzero(counts <= chance)[-1]])
