"""A detector made from a background, and the scores of blocks: see `detect.rx` for what each method is.

A `Detector` is a matrix made once from a `detect.background.Background`; `score` applies it to blocks, pixel by
pixel, so that it needs no halo and any tiling gives the same bits. Nothing here opens a file or chooses a threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint.errors import FitError, InputError

from .background import Background, Float64, Mask, Scores
from .covariance import TOLERANCE, whitener

GLOBAL_METHODS = {
    "rx": "squared Mahalanobis distance",
    "utd": "uniform target detector: likeness to a spectrum of ones",
    "rx-utd": "rx less utd",
    "subspace": "rx without the leading eigenvectors of the covariance (--drop)",
    "residual": "rx of the bands' residuals after regression on the NIR",
}
"""Detectors that compare with one background for the whole scene."""
_CHUNK = 1024
"""Least pixels scored at a time: their whitened values stay in the cache."""
_PRODUCTS = 1 << 18
"""Multiplications of a matrix product that are made at a time: OpenBLAS does not wake its threads for them."""
_STRIP_PIXELS = 1 << 19
"""Pixels that a thread scores at a time."""
_NEGLIGIBLE = {np.dtype(np.float32): 1e-12, np.dtype(np.float64): 1e-15}
"""Standard deviations by which a mean may be off, by the type of the scores."""


@dataclass(frozen=True, eq=False)
class Detector:
    """A detector ready to use: scores are norm(whiten d)^2 + linear . d with d = x - mean.

    Attributes
    ----------
    method : str
        A key of `GLOBAL_METHODS`.
    mean, rest : (bands,) ndarray
        The mean is mean + rest.
    whiten : (rank, bands) ndarray
    linear : (bands,) ndarray or None
    """

    method: str
    mean: Float64
    rest: Float64
    whiten: Float64
    linear: Float64 | None = None

    @property
    def rank(self) -> int:
        """Degrees of freedom: for rx, the mean score of the background is this times (n - 1) / n."""
        return len(self.whiten)


def detector(method: str, background: Background, *, drop: int = 1, nir: Sequence[int] = ()) -> Detector:
    """Make a detector from a background.

    Parameters
    ----------
    method : str
        A key of `GLOBAL_METHODS`.
    background : Background
    drop : int
        For "subspace": leading eigenvectors to leave out.
    nir : sequence of int
        For "residual": 0-based bands that the others are regressed on.

    Raises
    ------
    InputError
        A method that is not known, or `drop` or `nir` that leave nothing.
    FitError
        No band of the background varies.
    """
    if method not in GLOBAL_METHODS:
        raise InputError(f"method {method!r} is not one of {', '.join(GLOBAL_METHODS)}.")
    whiten = whitener(background.covariance)
    if not len(whiten):
        raise FitError("no band of the background varies, so no pixel can exceed it. Check bands and nodata.")
    linear = None
    if method == "subspace":
        whiten = _subspace(background.covariance, drop)
    elif method == "residual":
        whiten = _residual(background.covariance, nir)
    elif method in ("utd", "rx-utd"):
        linear = whiten.T @ (whiten @ (1 - background.mean))
        if method == "utd":
            whiten = whiten[:0]
        else:
            linear = -linear
    return Detector(method, background.mean, background.rest, whiten, linear)


def score(
    image: npt.NDArray[Any],
    detector: Detector,
    mask: Mask | None = None,
    *,
    threads: int = 1,
) -> Scores:
    """Scores of a block.

    Parameters
    ----------
    image : (band, row, column) ndarray
        Any real type; computed in float64.
    detector : Detector
    mask : (row, column) bool ndarray, optional
        True where a score is wanted.
    threads : int
        The result does not depend on it.

    Returns
    -------
    (row, column) ndarray
        float64 for float64, else float32; NaN where a band is not finite, or outside the mask.
    """
    image = np.asarray(image)
    if len(image) != len(detector.mean):
        raise InputError(f"the image has {len(image)} bands, the background {len(detector.mean)}. Use the same.")
    flat = np.ascontiguousarray(image).reshape(len(image), -1)
    out: Scores = np.empty(flat.shape[1], np.float64 if image.dtype == np.float64 else np.float32)
    matrix = detector.whiten if detector.linear is None else np.vstack([detector.whiten, detector.linear])

    def work(first: int) -> None:
        with np.errstate(invalid="ignore", over="ignore"):
            _fill(flat[:, first : first + _STRIP_PIXELS], detector, matrix, out[first : first + _STRIP_PIXELS])

    with ThreadPoolExecutor(max(threads, 1)) as pool:
        list((pool.map if threads > 1 else map)(work, range(0, len(out), _STRIP_PIXELS)))
    with np.errstate(invalid="ignore", over="ignore"):
        # what is finite but too large for the output's type stays the largest of all; the rest is not valid
        bad = ~np.isfinite(out)
        if bad.any():
            fine = np.isfinite(flat[:, bad]).all(axis=0)
            out[bad] = np.where(fine, np.copysign(float(np.finfo(out.dtype.name).max), out[bad]), np.nan)
    scores: Scores = out.reshape(image.shape[1:])
    if mask is not None:
        scores[~mask] = np.nan
    return scores


def _fill(flat: npt.NDArray[Any], detector: Detector, matrix: Float64, out: Scores) -> None:
    """Fill `out` with the scores of pixels."""
    rank, moved = len(detector.whiten), (matrix @ detector.rest)[:, None]
    shifted = bool(np.abs(moved).max(initial=0) > _NEGLIGIBLE[out.dtype])
    # always the same width: BLAS may add in another order at the end of a shorter one
    width = min(max(_PRODUCTS // max(matrix.size, 1), _CHUNK), 8 * _CHUNK)
    centred = np.zeros((len(flat), width))
    for start in range(0, len(out), width):
        part = flat[:, start : start + width]
        count = part.shape[1]
        np.subtract(part, detector.mean[:, None], out=centred[:, :count])
        z = matrix @ centred
        if shifted:
            z -= moved
        np.square(z[:rank], out=z[:rank])
        out[start : start + count] = np.add.reduce(z, axis=0)[:count]


def _subspace(covariance: Float64, drop: int) -> Float64:
    values, vectors = np.linalg.eigh(covariance)
    kept = np.flatnonzero(values > TOLERANCE * len(values) * values[-1])
    if not 0 <= drop < len(kept):
        raise InputError(f"drop: want 0 to {len(kept) - 1} of the {len(kept)} eigenvectors, got {drop}.")
    kept = kept[: len(kept) - drop]
    return np.asarray(vectors[:, kept].T / np.sqrt(values[kept])[:, None])


def _residual(covariance: Float64, nir: Sequence[int]) -> Float64:
    bands = len(covariance)
    reference = sorted({int(b) for b in nir})
    others = [b for b in range(bands) if b not in reference]
    if not reference or not others or reference[0] < 0 or reference[-1] >= bands:
        raise InputError(f"nir: want some of the bands 0 to {bands - 1}, not all, got {list(nir)}.")
    inverse = whitener(covariance[np.ix_(reference, reference)])
    cross = covariance[np.ix_(others, reference)]
    slopes = cross @ inverse.T @ inverse
    left = covariance[np.ix_(others, others)] - slopes @ cross.T
    # a band that the reference explains to the last digit is left out, as a constant one would be
    whole = np.diag(covariance)[others]
    gone = np.diag(left) <= TOLERANCE * bands * whole
    left[gone] = 0
    left[:, gone] = 0
    whiten = whitener(left)
    out = np.zeros((len(whiten), bands))
    out[:, others] = whiten
    out[:, reference] = -whiten @ slopes
    return out
