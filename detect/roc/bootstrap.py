"""Confidence intervals of a ROC curve by the block bootstrap: objects and blocks of background are drawn at random.

Pixels of an object, and neighbouring pixels of background, are correlated. If single pixels were drawn, the intervals
would be too narrow. So whole objects and whole square blocks of background are drawn, both with replacement. Blocks
should be wider than the distance over which the scores of the background are correlated. The scores of each object and
block are counted once, in bins between fixed scores (the levels). A draw is then a sum of counts. If there are at most
1024 distinct target scores, all of them are levels, and the area under the curve is exact.

References
----------
Efron, Tibshirani (1993), "An Introduction to the Bootstrap", doi:10.1007/978-1-4899-4541-9 (ch. 13, percentiles).
Obuchowski (1997), "Nonparametric analysis of clustered ROC curve data", Biometrics 53, 567-578, doi:10.2307/2533958.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint.errors import InputError

from ..arrays import Array, Float64, Mask
from .curve import Roc, usable

_LEVELS = 1024  # maximum number of distinct target scores that are levels
_FEW_PIECES = 10  # number of objects, or of blocks, below which a note says that intervals are too narrow
_LEVEL = 0.95  # confidence level of the intervals
_DRAWS_AT_A_TIME = 100  # number of draws that are computed at a time: it limits the memory


@dataclass(frozen=True, eq=False)
class Bands:
    """Confidence bands of a ROC curve and interval of the area under it: percentiles over draws of objects and blocks.

    With the same seed and the same valid pixels, two detectors have the same draws. Then percentiles of the difference
    of their `areas`, draw by draw, are a confidence interval of the difference of the two areas.
    """

    pfa: Float64  # (points,): false-alarm rates
    low: Float64  # (points,): lower end of the interval of Pd at each rate; the intervals are pointwise
    high: Float64  # (points,): upper end
    auc: tuple[float, float]  # interval of the area
    auc_error: float  # standard deviation of the area over the draws
    areas: Float64  # (draws,): area under the curve of each draw
    draws: int
    seed: int
    block: int  # side of a block [pixel]
    objects: int  # number of objects from which the draws are made
    blocks: int  # number of blocks from which the draws are made
    notes: tuple[str, ...]
    level: float = _LEVEL  # confidence level


def default_block(height: int, width: int) -> int:
    """Default side of the blocks of background [pixel]: 1/24 of the longer side of the scene, but at least 16."""
    return max(16, -(-max(height, width) // 24))


def bootstrap(
    scores: Array,
    objects: Array,
    valid: Mask | None = None,
    *,
    draws: int = 1000,
    seed: int = 0,
    block: int | None = None,
    pfa: npt.ArrayLike | None = None,
) -> Bands:
    """Compute confidence intervals of Pd at the false-alarm rates `pfa`, and of the area under the ROC curve.

    `scores`, `objects` (the number of the object of a pixel; 0: background) and `valid` (False: the pixel is not used)
    are (row, column). `draws` is the number of draws; the same `seed` gives the same result. `block` is the side of the
    blocks of background [pixel], by default `default_block`; `pfa` is (points,), by default `default_grid`.
    Raises InputError where `Roc.of` does, and if `scores` are not 2-D, `draws` is below 2 or `block` is below 1.
    """
    if scores.ndim != 2:
        raise InputError(f"scores must be (row, column) to be cut into blocks, got shape {scores.shape}.")
    if draws < 2:
        raise InputError(f"draws: allowed is 2 or more, got {draws}. 1000 are usual.")
    block = default_block(*scores.shape) if block is None else block
    if block < 1:
        raise InputError(f"block: allowed is 1 pixel or more, got {block}.")
    ok = usable(scores, objects, valid)
    roc = Roc.of(scores, objects, ok)
    at = default_grid(len(roc.background)) if pfa is None else np.asarray(pfa, np.float64)
    targets, background = _count(scores, objects, ok, _levels(roc), block)
    areas, pds = _draw(targets, background, at, draws, seed)
    tails = [50 * (1 - _LEVEL), 50 * (1 + _LEVEL)]
    low, high = np.percentile(pds, tails, axis=0)
    lowest, highest = map(float, np.percentile(areas, tails))
    drawn = {"objects": targets.shape[0], "blocks": background.shape[0]}
    few = tuple(f"few {what} ({n}): intervals are too narrow" for what, n in drawn.items() if n < _FEW_PIECES)
    drawn |= {"draws": draws, "seed": seed, "block": block}
    auc, error = (lowest, highest), float(areas.std(ddof=1))
    return Bands(pfa=at, low=low, high=high, auc=auc, auc_error=error, areas=areas, notes=few, **drawn)


def default_grid(background: int) -> Float64:
    """Default rates Pfa, (62,), for n = `background` pixels: 0.5/n (no false alarm), and log-spaced from 1/n to 1."""
    return np.append(0.5 / background, np.geomspace(1 / background, 1, 61))


def _levels(roc: Roc) -> Array:
    """Ascending levels, (levels,), between which scores are counted: some scores, and the next larger float of each.

    Scores: up to 1024 distinct target scores at evenly spaced ranks; background scores at evenly and log-spaced ranks.
    """
    distinct = roc._steps[0]
    if len(distinct) > _LEVELS:
        distinct = distinct[np.linspace(0, len(distinct) - 1, _LEVELS).astype(np.int64)]
    n = len(roc.background)
    ranks = np.unique(np.concatenate([np.geomspace(1, n, _LEVELS), np.linspace(1, n, _LEVELS // 4)]).astype(np.int64))
    chosen = roc.background[n - ranks]
    up = distinct.dtype.type(np.inf)  # with the next larger float, pixels with exactly this score have their own bin
    return np.unique(np.concatenate([distinct, np.nextafter(distinct, up), chosen, np.nextafter(chosen, up)]))


def _count(scores: Array, objects: Array, ok: Mask, levels: Array, block: int) -> tuple[Any, Any]:
    """Count scores where `ok`, in bins between `levels`; two sparse arrays, (objects, bins) and (blocks, bins)."""
    from scipy.sparse import coo_array, csr_array, vstack

    bins = len(levels) + 1
    height, width = scores.shape
    across = -(-width // block)
    background = []
    for top in range(0, height, block):
        rows = slice(top, top + block)
        use = ok[rows] & (objects[rows] == 0)
        place = np.nonzero(use)[1] // block
        at = np.searchsorted(levels, scores[rows][use], side="right")
        counts = np.bincount(place * bins + at, minlength=across * bins).reshape(across, bins)
        background.append(csr_array(counts[counts.any(axis=1)]))
    target = ok & (objects != 0)
    names, which = np.unique(objects[target], return_inverse=True)
    at = np.searchsorted(levels, scores[target], side="right")
    targets = coo_array((np.ones(len(at)), (which, at)), shape=(len(names), bins)).tocsr()
    return targets, vstack(background, format="csr").astype(np.float64)


def _draw(targets: Any, background: Any, at: Float64, draws: int, seed: int) -> tuple[Float64, Float64]:
    """Bootstrap the counts of `_count`; return area under the curve, (draws,), and Pd, (draws, points), at Pfa `at`."""
    rng = np.random.default_rng(seed)
    areas, pds = np.empty(draws), np.empty((draws, len(at)))
    for start in range(0, draws, _DRAWS_AT_A_TIME):
        size = min(_DRAWS_AT_A_TIME, draws - start)
        some = slice(start, start + size)
        t, b = (
            rng.multinomial(n := pieces.shape[0], np.full(n, 1 / n), size).astype(np.float64) @ pieces
            for pieces in (targets, background)
        )
        m, n = t.sum(axis=1, keepdims=True), b.sum(axis=1, keepdims=True)
        below = np.cumsum(b, axis=1) - b / 2
        areas[some] = (t * below).sum(axis=1) / (m * n)[:, 0]
        found, false = (np.cumsum(x[:, ::-1], axis=1) for x in (t, b))
        for i in range(size):  # the highest Pd whose Pfa is allowed; both rise as the threshold falls
            last = np.searchsorted(false[i], at * n[i] * (1 + 1e-12), side="right")
            pds[start + i] = np.append(0, found[i])[last] / m[i]
    return areas, pds
