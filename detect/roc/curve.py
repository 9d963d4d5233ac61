"""The ROC curve of a scene, its summary numbers, and DeLong's standard error of the area under it.

The scores of targets and of background are sorted separately. All numbers follow from the ranks of target scores among
background scores: no pairs of pixels are formed, and all valid pixels are used.
DeLong's intervals assume independent pixels. Neighbouring pixels of an image are not independent, because they have the
target or the glint in common. So these intervals are too narrow for images, and those of `bootstrap` should be used.

References
----------
Hanley, McNeil (1982), Radiology 143, 29-36, doi:10.1148/radiology.143.1.7063747 (area). McClish (1989), "Analyzing a
portion of the ROC curve", Medical Decision Making 9, 190-195, doi:10.1177/0272989X8900900307. Chang (2021), "An
effective evaluation tool for hyperspectral target detection: 3D receiver operating characteristic curve analysis",
IEEE TGRS 59, 5131-5153, doi:10.1109/TGRS.2020.3021671. DeLong, DeLong, Clarke-Pearson (1988), Biometrics 44, 837-845,
doi:10.2307/2531595; computed by ranks, in O(n log n), as in Sun, Xu (2014), IEEE Signal Processing Letters 21,
1389-1393, doi:10.1109/LSP.2014.2337313.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from deglint.errors import InputError
from deglint.plotting import axes

from ..arrays import Array, Float64, Int64, Mask

_Z = 1.959963984540054  # half-width of a normal interval of 95 % in standard errors


@dataclass(frozen=True)
class OperatingPoint:
    """False-alarm and detection rate at a threshold; a pixel is detected if its score is greater than the threshold."""

    pfa_requested: float  # requested false-alarm rate; `pfa` is at most this
    threshold: float
    pfa: float  # fraction of background pixels that are detected
    pd: float  # fraction of target pixels that are detected


@dataclass(frozen=True, eq=False)
class Roc:
    """A ROC curve, stored as the sorted scores of targets and of background.

    Attributes
    ----------
    targets, background : (n,) ndarray
        Scores of the target pixels and of the background pixels, ascending; integers are converted to float64.
    left_out : int
        Number of pixels that are not valid, and therefore not used.

    Examples
    --------
    >>> roc = Roc.of(np.array([1.0, 2, 2, 3, 9]), np.array([0, 0, 1, 0, 1]))
    >>> round(roc.auc, 4), roc.point(0.4).pd
    (0.75, 0.5)
    """

    targets: Array
    background: Array
    left_out: int = 0

    @classmethod
    def of(cls, scores: Array, truth: Array, valid: Mask | None = None) -> Self:
        """Make the curve from the scores and the truth of all pixels.

        Parameters
        ----------
        scores : ndarray
            Scores of the pixels, any shape; a pixel that is NaN, or hidden in a numpy masked array, is not valid.
        truth : ndarray of the same shape
            Not 0 where a pixel is a target, 0 for background; not valid as for scores.
        valid : ndarray of bool, optional
            False where a pixel is not used; by default all pixels are used.

        Raises
        ------
        InputError
            The shapes differ, no target or no background is valid, a score is infinite, or all scores are equal.
        """
        ok = usable(np.asanyarray(scores), np.asanyarray(truth), valid)
        scores, truth = np.asarray(scores), np.asarray(truth)
        target = truth != 0
        kept = scores.astype(np.float64) if scores.dtype.kind in "iub" else scores
        targets, background = (np.sort(kept[part]) for part in (ok & target, ok & ~target))
        left_out = scores.size - targets.size - background.size
        if not (len(targets) and len(background)):
            aside = f" ({left_out} left out as not valid)" if left_out else ""
            raise InputError(
                f"a curve needs targets (truth is not 0) and background (truth is 0), got {len(targets)} and "
                f"{len(background)} valid pixels{aside}. Check nodata, the mask and the truth."
            )
        low, high = min(targets[0], background[0]), max(targets[-1], background[-1])
        if not (np.isfinite(low) and np.isfinite(high)):
            raise InputError("scores hold infinity; allowed are finite numbers, and NaN where a pixel is not valid.")
        if low == high:
            raise InputError(f"all {len(targets) + len(background)} scores are {low:g}: they distinguish nothing.")
        return cls(targets, background, left_out)

    @cached_property
    def _steps(self) -> tuple[Array, Int64, Int64, Int64]:
        """Distinct target scores t, ascending; for each t, numbers of targets = t, background < t, background <= t."""
        distinct, counts = np.unique(self.targets, return_counts=True)
        below, upto = (np.searchsorted(self.background, distinct, side) for side in ("left", "right"))
        return distinct, counts.astype(np.int64), below.astype(np.int64), upto.astype(np.int64)

    @cached_property
    def vertices(self) -> tuple[Float64, Float64]:
        """Pfa and Pd, (points,) each, at the corners of the curve, from (0, 0) to (1, 1); straight lines join them."""
        _, counts, below, upto = self._steps
        n, m = len(self.background), len(self.targets)
        reached = np.cumsum(counts[::-1])
        false = np.column_stack([n - upto[::-1], n - below[::-1]]).ravel()
        found = np.column_stack([reached - counts[::-1], reached]).ravel()
        return np.concatenate([[0], false, [n]]) / n, np.concatenate([[0], found, [m]]) / m

    @cached_property
    def auc(self) -> float:
        """Area under the curve: P(target score > background score) + P(equal scores) / 2, exact (Mann-Whitney)."""
        _, counts, below, upto = self._steps
        return int((counts * (below + upto)).sum()) / 2 / (len(self.targets) * len(self.background))

    def partial_auc(self, pfa_max: float) -> float:
        """Area under the curve from Pfa = 0 to `pfa_max`; the area of a perfect detector is `pfa_max`."""
        _check_pfa(pfa_max)
        pfa, pd = self.vertices
        stop = int(np.searchsorted(pfa, pfa_max, side="right"))
        x, y = np.append(pfa[:stop], pfa_max), np.append(pd[:stop], np.interp(pfa_max, pfa, pd))
        return float(((y[1:] + y[:-1]) / 2 * np.diff(x)).sum())

    def mcclish(self, pfa_max: float) -> float:
        """The area `partial_auc`, scaled to 0.5 for a random and to 1 for a perfect detector (McClish 1989, eq. 4)."""
        least = pfa_max * pfa_max / 2
        return (1 + (self.partial_auc(pfa_max) - least) / (pfa_max - least)) / 2

    def point(self, pfa: float) -> OperatingPoint:
        """Operating point with the highest Pd at a Pfa up to `pfa`, among thresholds that are background scores."""
        _check_pfa(pfa)
        n = len(self.background)
        allowed = min(math.floor(pfa * n * (1 + 1e-12)), n - 1)
        threshold = self.background[n - 1 - allowed]
        false = n - int(np.searchsorted(self.background, threshold, side="right"))
        found = len(self.targets) - int(np.searchsorted(self.targets, threshold, side="right"))
        return OperatingPoint(pfa, float(threshold), false / n, found / len(self.targets))

    @cached_property
    def precision_recall(self) -> tuple[Float64, Float64]:
        """Precision and recall (Pd), (points,), at thresholds just below the distinct target scores, highest first."""
        _, counts, below, _ = self._steps
        found = np.cumsum(counts[::-1])
        return found / (found + len(self.background) - below[::-1]), found / len(self.targets)

    def plot(self, ax: Any = None, *, label: str | None = None) -> Any:
        """Draw Pd over Pfa on a logarithmic axis; needs matplotlib (`pip install 'deglint[reports]'`).

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; a new figure by default.
        label : str, optional
            Name of the detector; the AUC is added.

        Returns
        -------
        matplotlib Axes

        Raises
        ------
        InputError
            matplotlib is not installed.
        """
        ax = axes(ax, "Roc.plot")
        name = f"{label}, AUC {self.auc:.4f}" if label else f"AUC {self.auc:.4f}"
        ax.plot(*self.vertices, label=name)
        ax.set(xscale="log", xlim=(1 / max(len(self.background), 2), 1), ylim=(0, 1))
        ax.set(xlabel="observed false-alarm rate", ylabel="detected share of target pixels")
        ax.legend(loc="lower right")
        return ax

    @cached_property
    def average_precision(self) -> float:
        """Sum over thresholds of precision times increase of recall. It depends on the fraction of target pixels."""
        precision, recall = self.precision_recall
        return float((precision * np.diff(recall, prepend=0)).sum())

    def three_d(self) -> dict[str, float]:
        """Measures of the 3-D ROC curve (Chang 2021): Pd and Pfa as functions of the threshold tau.

        Returns
        -------
        dict
            d_tau, f_tau: areas under Pd(tau) and Pfa(tau) (eq. 18, 19), with scores and tau scaled to 0..1. They equal
            the mean scores of targets and background. d_tau_trapezoid, f_tau_trapezoid: areas by the trapezoid rule.
            td = auc + d_tau, bs = auc - f_tau, tdbs = d_tau - f_tau, od = auc + d_tau - f_tau, snpr = d_tau / f_tau.
            All measures depend on the lowest and the highest score: use them only to compare detectors on one scene.
        """
        low = float(min(self.targets[0], self.background[0]))
        span = float(max(self.targets[-1], self.background[-1])) - low
        d, f = ((float(part.mean(dtype=np.float64)) - low) / span for part in (self.targets, self.background))
        distinct, counts = np.unique(np.concatenate([self.targets, self.background]), return_counts=True)
        # the trapezoid rule adds half the mean step to the next higher score
        steps = np.append(np.diff(distinct.astype(np.float64)), 0.0) / span / 2
        more = steps[np.searchsorted(distinct, self.targets)].sum()
        d_more, f_more = more / len(self.targets), max(counts @ steps - more, 0.0) / len(self.background)
        out = {"d_tau": d, "f_tau": f, "d_tau_trapezoid": d + float(d_more), "f_tau_trapezoid": f + float(f_more)}
        out |= {"td": self.auc + d, "bs": self.auc - f, "tdbs": d - f, "od": self.auc + d - f}
        return out | {"snpr": d / f if f > 0 else math.inf}


@dataclass(frozen=True)
class AucInterval:
    """Area under a ROC curve, and its DeLong interval: NaN if there is only one target or only one background pixel."""

    auc: float
    standard_error: float
    low: float  # lower end of the interval
    high: float  # upper end
    level: float = 0.95  # confidence level


@dataclass(frozen=True)
class Comparison:
    """Difference of the areas under two ROC curves on the same pixels, and its confidence interval (DeLong)."""

    auc: tuple[float, float]  # the two areas
    difference: float  # first minus second area
    standard_error: float  # standard error of the difference
    z: float  # difference / standard error; NaN where both are 0
    p: float  # two-sided p-value of z; 1 where both are 0
    low: float  # lower end of the interval of the difference
    high: float  # upper end
    level: float = 0.95  # confidence level
    pixels: int = 0  # number of pixels that are valid for both detectors


def auc_interval(roc: Roc) -> AucInterval:
    """Area under a ROC curve, its standard error (DeLong 1988, eq. 6) and normal 95 % interval, limited to 0..1."""
    error = math.sqrt(_variance(*_components(roc.targets, roc.background, roc)))
    return AucInterval(roc.auc, error, max(roc.auc - _Z * error, 0.0), min(roc.auc + _Z * error, 1.0))


def compare(first: Array, second: Array, truth: Array, valid: Mask | None = None) -> Comparison:
    """DeLong's paired test of the scores of two detectors, on pixels valid for both. The arrays are as in `Roc.of`."""
    ok = usable(first, truth, valid) & usable(second, truth)
    target, background = ok & (truth != 0), ok & (truth == 0)
    rocs = [Roc.of(scores, truth, ok) for scores in (first, second)]
    one, two = (_components(s[target], s[background], r) for s, r in zip((first, second), rocs, strict=True))
    areas = rocs[0].auc, rocs[1].auc
    difference, error = areas[0] - areas[1], math.sqrt(_variance(one[0] - two[0], one[1] - two[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        z = float(np.divide(difference, error))
    p = 1.0 if difference == error == 0 else math.erfc(abs(z) / math.sqrt(2))  # both rank all pixels alike
    low, high = difference - _Z * error, difference + _Z * error
    return Comparison(areas, difference, error, z, p, low, high, pixels=int(np.count_nonzero(ok)))


def _components(targets: Array, background: Array, roc: Roc) -> tuple[Float64, Float64]:
    """Fraction of background below each target, and of targets above each background pixel; equal scores count half.

    Scores `targets`, (targets,), and `background`, (pixels,), have any order; `roc` holds the same scores, sorted.
    """
    below, at_least = (
        (np.searchsorted(others, own, "left") + np.searchsorted(others, own, "right")) / (2 * len(others))
        for own, others in ((targets, roc.background), (background, roc.targets))
    )
    return below, 1 - at_least


def _variance(v10: Float64, v01: Float64) -> float:
    """DeLong's variance of an area under the curve, from its `_components` `v10`, (targets,), and `v01`, (background,).

    Differences of components give the variance of a difference of areas. NaN if `v10` or `v01` has only one value.
    """
    if min(len(v10), len(v01)) < 2:
        return math.nan
    return float(v10.var(ddof=1) / len(v10) + v01.var(ddof=1) / len(v01))


def usable(scores: Array, truth: Array, valid: Mask | None = None) -> Mask:
    """Mask of the pixels to use: score and truth neither NaN nor hidden in a numpy masked array, and `valid` True.

    Raises InputError if the shapes differ.
    """
    if scores.shape != truth.shape or (valid is not None and valid.shape != scores.shape):
        shapes = ", ".join(str(a.shape) for a in (scores, truth, valid) if a is not None)
        raise InputError(f"scores, truth and valid must be of one shape, got {shapes}.")
    ok = np.ones(scores.shape, np.bool_) if valid is None else valid.astype(np.bool_)
    for array in (scores, truth):
        ok &= ~np.ma.getmaskarray(array)
        if array.dtype.kind == "f":
            ok &= ~np.isnan(np.asarray(array))
    return ok


def _check_pfa(pfa: float) -> None:
    if not 0 < pfa <= 1:
        raise InputError(f"Pfa: allowed is above 0 and up to 1, got {pfa}.")
