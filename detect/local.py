"""Local RX: the distance of every pixel from the ring of pixels around it.

The background of a pixel is its ring: a square window of `outer` x `outer` pixels without its centre, the guard, of
`inner` x `inner` pixels. For few bands, sums over the rings of all pixels are computed together; their cost grows with
the logarithm of `outer`. For many bands, and where the sums are imprecise, each score is computed from the pixels of
its ring. The scores are the same to the bit for all tiles that start at multiples of `CELL`. No file is opened here.
A sum over a ring is computed as the sum of four bars around the guard, not as the difference of two squares. Thus an
extreme pixel reduces the precision only in rings that contain it.

References
----------
Reed, Yu (1990), doi:10.1109/29.60107, and for the dual window Kwon, Der, Nasrabadi (2003), "Adaptive anomaly detection
using subspace separation for hyperspectral imagery", Optical Engineering 42, 3342-3351, doi:10.1117/1.1614265.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from deglint.checks import check_choice, check_number, checked_keywords
from deglint.errors import InputError
from deglint.tiles import Tile, default_threads, one_thread_each, run

from .arrays import Array, Float64, Int64, Mask, Scores, Uint8
from .background import as_image, check_range, check_rule
from .covariance import TOLERANCE

CELL = 256  # side of the cells computed at a time [pixel]; tiles that start at multiples of it have identical scores
BORDERS = ("shrink", "mirror", "shift")  # beyond the image: ignore it, mirror the image, or move the window inside
SUMS_BANDS = 24  # maximum number of bands for which sums over windows are faster than rings computed one by one
FINE, DEFICIENT, TOO_FEW = 0, 1, 2
STATES = {
    DEFICIENT: "covariance of the ring is singular, pseudo-inverse used",
    TOO_FEW: "too few valid pixels in the ring, no score",
}
"""Values of the array `flags` of `local_rx`, and their meanings; 0 for an ordinary score."""
_DIRECT = 255  # state (`ASIDE` of `_local_kernel`) of pixels computed one by one: sums are slow or imprecise


@dataclass(frozen=True)
class WindowRule:
    """Checked parameters of `local_rx`, and the `size` of the whole scene: its numbers of rows and columns."""

    inner: int
    outer: int
    size: tuple[int, int]
    border: str = "shrink"
    ddof: int = 1
    ridge: float = 0.0

    def __post_init__(self) -> None:
        inner, outer, size = self.inner, self.outer, self.size
        if not (inner % 2 == outer % 2 == 1 and 1 <= inner < outer):
            raise InputError(f"window: want odd sides, 1 <= inner < outer, got inner {inner} and outer {outer}.")
        check_choice(self.border, list(BORDERS), "border")
        check_rule("ridge", self.ridge)
        check_number(self.ddof, 0, np.inf, "ddof")
        if self.border != "shrink" and outer > min(size):
            raise InputError(
                f"window: {outer} pixels do not fit into {size[0]} x {size[1]} with border {self.border}. "
                "Take a smaller window, or border shrink."
            )

    @property
    def halo(self) -> int:
        """Distance from a pixel to the edge of its window [pixel]."""
        return self.outer // 2

    @property
    def pixels(self) -> int:
        """Number of pixels in a ring of which all pixels are valid."""
        return self.outer * self.outer - self.inner * self.inner


@checked_keywords("border", "ddof", "ridge", "threads")
def local_rx(
    image: Array, *, inner: int, outer: int, mask: Mask | None = None, flags: Uint8 | None = None, **options: Any
) -> Scores:
    """Local RX with a dual window: squared Mahalanobis distance of every pixel from the ring of pixels around it.

    Parameters
    ----------
    image : (band, row, column) ndarray
        Any real type, any units; pixels with NaN or infinity in any band are not valid, nor are those hidden in any
        band of a numpy masked array.
    inner, outer : int
        Sides of the guard and of the window [pixel], odd, inner < outer. The ring is the window without the guard.
    mask : (row, column) bool ndarray, optional
        True where a pixel is used. The other pixels are in no ring, and their score is NaN.
    flags : (row, column) uint8 ndarray, optional
        Output array: a key of `STATES` where the covariance is singular or the ring has too few valid pixels, else 0.
    **options
        border: for windows that extend beyond the image, "shrink" (default) ignores the part outside, "mirror" mirrors
        the image at its edge, and "shift" moves window and guard inside, each by the smallest distance. ddof: the
        divisor of the covariance is the number of pixels minus ddof (default 1; most publications use 0). ridge:
        fraction of each band's variance that is added to it (default 0). threads: number of threads (default 1); the
        result does not depend on it.

    Returns
    -------
    (row, column) ndarray
        float64 for a float64 image, else float32. NaN where the pixel is not valid, or its ring has fewer than 2 valid
        pixels, or at most ddof.

    Raises
    ------
    InputError
        A parameter is not allowed, a value is beyond +-1e150, the window is too large for `border`, or shapes differ.

    Examples
    --------
    >>> image = np.random.default_rng(0).normal(size=(3, 50, 60))
    >>> image[:, 20, 30] += 10
    >>> scores = local_rx(image, inner=3, outer=11)
    >>> np.unravel_index(scores.argmax(), scores.shape) == (20, 30)
    True
    """
    image, mask = as_image(image, mask)
    size = (image.shape[1], image.shape[2])
    threads = default_threads(options.pop("threads", 1))
    rule = WindowRule(inner, outer, size, **options)
    if flags is not None and (flags.shape != size or flags.dtype != np.uint8):
        raise InputError(f"flags: want a uint8 array of shape {size}, got {flags.dtype} of shape {flags.shape}.")
    import scipy.linalg.lapack  # noqa: F401  a library that is loaded later is not limited

    with one_thread_each():  # a ring's matrices are small: threads would wait for each other
        whole = Tile(0, size[0], 0, size[1])
        scores, states = score_part(image, rule, whole, whole, mask, threads=threads)
    if flags is not None:
        flags[:] = states
    return scores


def score_part(
    block: Array, rule: WindowRule, held: Tile, part: Tile, mask: Mask | None = None, *, threads: int = 1
) -> tuple[Scores, Uint8]:
    """Scores and states (0 or a key of `STATES`), each (row, column), of the tile `part` of a scene.

    `block`, (band, row, column), and `mask` hold the tile `held`: `part` and its halo, cut at the edges of the scene.
    `part` starts at multiples of `CELL`. `rule` holds the sides of the window; other parameters are as in `local_rx`.
    """
    dtype = np.float64 if block.dtype == np.float64 else np.float32
    scores, states = np.full(part.shape, np.nan, dtype), np.zeros(part.shape, np.uint8)
    good = np.asarray(np.isfinite(block).all(axis=0))
    if mask is not None:
        good &= mask
    if dtype is np.float64:
        check_range(block[:, good])

    score_cell = partial(_score_cell, block, good, held, rule)
    for cell, (values, state) in run(part.split(CELL), score_cell, threads=threads):
        own = cell.within(part)
        scores[own], states[own] = np.minimum(values, np.finfo(dtype).max), state
    return scores, states


def _score_cell(block: Array, good: Mask, held: Tile, rule: WindowRule, cell: Tile) -> tuple[Float64, Uint8]:
    """As `score_part`, for the tile `cell` and without threads; `good`, (row, column), is True at valid pixels."""
    inside = good[cell.within(held)]
    scores, states = np.full(inside.shape, np.nan), np.where(inside, np.uint8(_DIRECT), np.uint8(FINE))
    if len(block) <= SUMS_BANDS and inside.any():
        from ._local_kernel import distances, ring_moments

        x = _padded(block, good, held, cell, rule)
        sums = np.empty((len(x) * (len(x) + 1) // 2, *scores.shape))
        ring_moments(x, rule.inner, (rule.outer - rule.inner) // 2, sums)
        own = x[1:, rule.halo : -rule.halo, rule.halo : -rule.halo].reshape(len(block), -1)
        found, how = np.empty(scores.size), np.empty(scores.size, np.uint8)
        distances(sums.reshape(len(sums), -1), own, rule.ddof, rule.ridge, found, how)
        scores[inside], states[inside] = found.reshape(scores.shape)[inside], how.reshape(scores.shape)[inside]
        if rule.border == "shift":
            rows, columns = (np.arange(*ends) for ends in cell.window)
            near = [(at < rule.halo) | (at >= n - rule.halo) for at, n in zip((rows, columns), rule.size, strict=True)]
            states[inside & np.logical_or.outer(*near)] = _DIRECT
    for r, c in np.argwhere(states == _DIRECT):
        scores[r, c], states[r, c] = _direct(block, good, held, (int(r) + cell.row0, int(c) + cell.col0), rule)
    return scores, states


def _padded(block: Array, good: Mask, held: Tile, cell: Tile, rule: WindowRule) -> Float64:
    """Array x for `ring_moments`, of `cell` and its halo: a layer of ones, then bands minus medians; 0 if not valid."""
    seen = cell.grown(rule.halo, *rule.size)
    above, below, left, right = (rule.halo - inside for inside in cell.crop_of(seen))
    beyond = ((0, 0), (above, below), (left, right))
    values, known = block[seen.within(held)], good[seen.within(held)]
    if rule.border == "mirror":
        values, known = np.pad(values, beyond, "symmetric"), np.pad(known, beyond[1:], "symmetric")
        beyond = ((0, 0),) * 3
    x = np.zeros((1 + len(block), *known.shape))
    x[0] = known
    for band, out in zip(values, x[1:], strict=True):
        few = band[::4, ::4][known[::4, ::4]]  # a median, because an extreme pixel does not change it
        np.subtract(band, np.median(few) if few.size else 0.0, out=out, where=known, dtype=np.float64)
    return np.pad(x, beyond)


def _direct(block: Array, good: Mask, held: Tile, place: tuple[int, int], rule: WindowRule) -> tuple[float, int]:
    """Score and state (0 or a key of `STATES`) of the pixel at (row, column) `place` of the scene, from its ring."""
    corner, outer, inner = [], [], []
    for at, size in zip(place, rule.size, strict=True):
        places = _places(at, size, rule.outer, rule.border)
        corner.append(int(places.min()))
        outer.append(np.bincount(places - corner[-1]))
        inner.append(np.bincount(_places(at, size, rule.inner, rule.border) - corner[-1], minlength=len(outer[-1])))
    count = np.multiply.outer(*outer) - np.multiply.outer(*inner)
    top, left = corner[0] - held.row0, corner[1] - held.col0
    area = (slice(top, top + count.shape[0]), slice(left, left + count.shape[1]))
    used = good[area] & (count > 0)
    weight = count[used].astype(np.float64)
    n = weight.sum()
    if n < 2 or n <= rule.ddof:
        return np.nan, TOO_FEW
    ring = block[(slice(None), *area)][:, used].T.astype(np.float64)
    shift = ring[0].copy()
    ring -= shift
    mean = weight @ ring / n
    ring -= mean
    away = block[:, place[0] - held.row0, place[1] - held.col0].astype(np.float64) - shift - mean
    root = np.sqrt(weight)
    ring *= root[:, None]
    value, full = _inverse_form(ring, away, root, rule.ridge)
    return value * (n - rule.ddof), FINE if full else DEFICIENT


def _places(at: int, size: int, side: int, border: str) -> Int64:
    """Rows of a window of `side` rows around row `at` in a scene of `size` rows; rows that are mirrored occur twice."""
    first = at - side // 2
    if border == "shift":
        first = min(max(first, 0), size - side)
    places = np.arange(first, first + side)
    if border == "mirror":  # the pixel at the edge comes twice
        places %= 2 * size
        return np.minimum(places, 2 * size - 1 - places)
    return places[(places >= 0) & (places < size)]


def _inverse_form(ring: Float64, away: Float64, root: Float64, ridge: float) -> tuple[float, bool]:
    """Compute d^T M^+ d, with M = R^T R + `ridge` * diag(R^T R) and d = `away`, (band,), and whether M has full rank.

    M^+: pseudo-inverse. R = `ring`, (pixel, band): deviations from the mean, times `root`, (pixel,). `root` is the
    square root of the weight of a pixel, the number of times that the pixel occurs in the ring.
    """
    bands = ring.shape[1]
    if bands > SUMS_BANDS:
        return _by_cholesky(ring, away, root, ridge)
    ring = np.concatenate([ring, np.diag(np.sqrt(ridge * (ring**2).sum(axis=0)))])
    length = np.sqrt((ring**2).sum(axis=0))
    if length.all():  # test the rank independently of the units of the bands
        _, values, vectors = np.linalg.svd(ring / length, full_matrices=False)
        if (values**2 > TOLERANCE * bands).all():
            return float(((vectors @ (away / length) / values) ** 2).sum()), True
    _, values, vectors = np.linalg.svd(ring, full_matrices=False)
    kept = values**2 > TOLERANCE * bands * (values**2).sum()
    return float(((vectors[kept] @ away / values[kept]) ** 2).sum()), False


def _by_cholesky(ring: Float64, away: Float64, root: Float64, ridge: float) -> tuple[float, bool]:
    """As `_inverse_form`, by a Cholesky factor of M; if pixels <= bands and `ridge` is 0, as |(R R^T)^+ R d|^2."""
    from scipy.linalg.lapack import dpotrf, dpotrs, dpstrf, dtrtrs

    pixels, bands = ring.shape
    few = pixels <= bands and ridge == 0
    if few:
        matrix, right = ring @ ring.T, ring @ away
        # the mean is subtracted, so R R^T maps `root` to 0; R d is orthogonal to it
        unit = root / np.linalg.norm(root)
        filled = matrix + np.outer(unit, unit) * (np.trace(matrix) / pixels)
    else:
        matrix, right = ring.T @ ring, away
        matrix[np.diag_indices(bands)] *= 1 + ridge
        filled = matrix
    lower, failed = dpotrf(filled, lower=1)
    if not failed and (np.diag(lower) ** 2 > TOLERANCE * len(lower) * np.diag(filled)).all():
        z = dtrtrs(lower, right, lower=1)[0]
        if few:
            z = dtrtrs(lower, z, lower=1, trans=1)[0]
        return float(z @ z), not few
    if not np.trace(matrix) > 0:
        return 0.0, False
    # pivoted factor L with as many columns as the rank; the pseudo-inverse is L (L^T L)^-2 L^T
    lower, pivots, rank, _ = dpstrf(matrix, lower=1, tol=TOLERANCE * len(matrix) * np.trace(matrix))
    lower, right = np.tril(lower)[:, :rank], right[pivots - 1]
    gram = dpotrf(lower.T @ lower, lower=1)[0]
    if few:
        z = dtrtrs(lower[:rank], right[:rank], lower=1)[0]
        return float(z @ dpotrs(gram, z, lower=1)[0]), False
    z = dpotrs(gram, lower.T @ right, lower=1)[0]
    return float(z @ z), False
