"""RX and its kin: how far a pixel lies from the background, in the background's own measure.

A `Detector` is a matrix made once from a `detect.background.Background`; `score` applies it to blocks, pixel by
pixel, so that it needs no halo and any tiling gives the same bits. Nothing here opens a file or chooses a threshold.

With d = x - mean and C the covariance:

===========  =====================================================================================
rx           d^T C^-1 d (squared Mahalanobis distance)
utd          (1 - mean)^T C^-1 d
rx-utd       (x - 1)^T C^-1 d = rx - utd
subspace     rx without the leading eigenvectors of C
residual     rx of what is left of each band after regression on reference bands (the NIR, say)
===========  =====================================================================================

References
----------
Reed, Yu (1990), "Adaptive multiple-band CFAR detection of an optical pattern with unknown spectral distribution", IEEE
Transactions on Acoustics, Speech, and Signal Processing 38, 1760-1770, doi:10.1109/29.60107.
Ashton, Schaum (1998), "Algorithms for the detection of sub-pixel targets in multispectral imagery", Photogrammetric
Engineering and Remote Sensing 64, 723-731.
Schaum (2007), "Hyperspectral anomaly detection beyond RX", Proc. SPIE 6565, 656502, doi:10.1117/12.718789.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint.checks import checked_keywords
from deglint.errors import FitError, InputError

from .background import (
    COMPILED_PIXELS,
    RIDGE,
    Background,
    Float64,
    Mask,
    Scores,
    as_image,
    as_mask,
    default_threads,
    fit,
)
from .covariance import TOLERANCE, whitener

METHODS = {
    "rx": "squared Mahalanobis distance",
    "utd": "uniform target detector: likeness to a spectrum of ones",
    "rx-utd": "rx less utd",
    "subspace": "rx without the leading eigenvectors of the covariance (--drop)",
    "residual": "rx of the bands' residuals after regression on the NIR",
}
"""Detectors that compare with one background for the whole scene."""
_CHUNK, _CHUNK_MANY = 8192, 1024
"""Pixels scored at a time, at most, of few bands and of many: they and their whitened values stay in the cache."""
_PRODUCTS = 1 << 18
"""Multiplications of a matrix product up to which OpenBLAS does not wake its threads; tiles have threads already."""
_NARROW = 256
"""Pixels below which a matrix product does not pay."""
_STRIP = 1 << 19
"""Pixels that a thread scores at a time."""
_KERNEL_BANDS = 32
"""Most bands for which the compiled kernel is faster than BLAS."""
_SMALL = {np.dtype(np.float32): 1e-12, np.dtype(np.float64): 1e-15}
"""Standard deviations by which a mean may be off, by the type of the scores."""


@dataclass(frozen=True, eq=False)
class Detector:
    """A detector ready to use: scores are norm(whiten d)^2 + linear . d with d = x - mean.

    Attributes
    ----------
    method : str
        A key of `METHODS`.
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
        A key of `METHODS`.
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
    if method not in METHODS:
        raise InputError(f"method {method!r} is not one of {', '.join(METHODS)}.")
    whiten = whitener(background.covariance)
    if not len(whiten):
        raise FitError("no band of the background varies, so nothing can stand out. Check bands and nodata.")
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
    compiled: bool = False,
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
    compiled : bool
        Use the compiled kernel: several times as fast for few bands, but it takes half a second to load. The last bits
        may differ.
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
    rank = len(detector.whiten)
    matrix = detector.whiten if detector.linear is None else np.vstack([detector.whiten, detector.linear])
    if compiled or rank == len(matrix) == len(image) > _KERNEL_BANDS:
        # a triangle gives the same lengths from half as many multiplications
        matrix = np.asarray(np.linalg.qr(detector.whiten, mode="r"))
    fill = _by_kernel if compiled else _by_blas

    def work(first: int) -> None:
        with np.errstate(invalid="ignore", over="ignore"):
            fill(flat, first, detector, matrix, rank, out[first : first + _STRIP])

    with ThreadPoolExecutor(max(threads, 1)) as pool:
        list((pool.map if threads > 1 else map)(work, range(0, len(out), _STRIP)))
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


def _by_blas(flat: npt.NDArray[Any], first: int, detector: Detector, matrix: Float64, rank: int, out: Scores) -> None:
    """Fill `out` with the scores of pixels from `first` on, by matrix products."""
    moved = (matrix @ detector.rest)[:, None]
    shifted = bool(np.abs(moved).max(initial=0) > _SMALL[out.dtype])
    # always the same width: BLAS may add in another order at the end of a shorter one
    width = min(_PRODUCTS // max(matrix.size, 1), _CHUNK)
    width = width if width >= _NARROW else _CHUNK_MANY
    centred, total = np.zeros((len(flat), width)), np.empty(width)
    z, multiply = _product(matrix, centred, triangular=rank == len(matrix) == len(flat) > _KERNEL_BANDS)
    for start in range(0, len(out), width):
        count = min(width, len(out) - start)
        part = flat[:, first + start : first + start + count]
        np.subtract(part, detector.mean[:, None], out=centred[:, :count])
        multiply()
        if shifted:
            z -= moved
        np.square(z[:rank], out=z[:rank])
        np.add.reduce(z, axis=0, out=total)
        out[start : start + count] = total[:count]


def _product(matrix: Float64, x: Float64, *, triangular: bool) -> tuple[Float64, Callable[[], object]]:
    """Where matrix @ x will be, and what puts it there; an upper triangle puts it where x was."""
    if triangular:
        from scipy.linalg.blas import dtrmm

        factor = np.asfortranarray(matrix.T)
        return x, lambda: dtrmm(1.0, factor, x.T, side=1, lower=1, overwrite_b=1)
    z = np.empty((len(matrix), x.shape[1]))
    return z, lambda: np.matmul(matrix, x, out=z)


def _by_kernel(flat: npt.NDArray[Any], first: int, detector: Detector, matrix: Float64, rank: int, out: Scores) -> None:
    """The same by the compiled kernel, from a triangle."""
    from ._rx_kernel import FEW, squared_lengths, squared_lengths_of_few

    bands = len(flat)
    if flat.dtype == np.float16:  # which the compiler does not know
        flat, first = flat[:, first : first + len(out)].astype(np.float32), 0
    if detector.linear is None and bands <= FEW:
        filled, mean, moved = np.zeros((FEW, FEW)), np.zeros(FEW), np.zeros(FEW)
        filled[:rank, :bands], mean[:bands], moved[:rank] = matrix, detector.mean, matrix @ detector.rest
        rows = tuple(map(tuple, filled.tolist()))
        squared_lengths_of_few(flat, first, tuple(mean.tolist()), rows, tuple(moved.tolist()), out)
        return
    filled = np.zeros((rank + rank % 2, -(-bands // 4) * 4))
    filled[:rank, :bands] = matrix
    linear = detector.linear if detector.linear is not None else np.zeros(0)
    squared_lengths(flat, first, detector.mean, detector.rest, filled, linear, out)


@checked_keywords()
def rx(
    image: npt.NDArray[Any],
    background: Background | Mask | None = None,
    *,
    mask: Mask | None = None,
    nodata: float | None = None,
    covariance: str = "empirical",
    ridge: float = RIDGE,
    threads: int | None = None,
) -> Scores:
    """Global RX: squared Mahalanobis distance of every pixel from the background (Reed and Yu 1990).

    Parameters
    ----------
    image : (band, row, column) ndarray
        Any real type, any units: the scores do not depend on them. A pixel that a masked array masks in some band is
        not valid.
    background : Background or (row, column) bool ndarray, optional
        Fitted before (to another scene, say), or True where the background is; everything valid by default.
    mask : (row, column) bool ndarray, optional
        True where a pixel counts; others are not fitted to, and score NaN.
    nodata : float, optional
        Number that means: not valid, in any band. NaN never is.
    covariance, ridge
        As `detect.background.fit`.
    threads : int, optional
        All processors for large images, or as few as OMP_NUM_THREADS says; the result does not depend on it.

    Returns
    -------
    (row, column) ndarray
        float64 for float64, else float32; NaN where not valid. For a normal background of many pixels they follow
        chi-squared with as many degrees of freedom as there are bands.

    Raises
    ------
    FitError, InputError
        As `detect.background.fit`.

    Notes
    -----
    Does not change under any invertible affine map of the bands; so not under a glint removal that subtracts a multiple
    of the NIR from each band and leaves the NIR in the stack.

    Examples
    --------
    >>> import numpy as np
    >>> image = np.random.default_rng(0).normal(size=(3, 50, 60))
    >>> image[:, 20, 30] += 10
    >>> scores = rx(image)
    >>> np.unravel_index(scores.argmax(), scores.shape) == (20, 30)
    True
    """
    return _run("rx", image, background, _valid(image, as_mask(mask, image), nodata), covariance, ridge, threads)


def _valid(image: npt.NDArray[Any], mask: Mask | None, nodata: float | None) -> Mask | None:
    """The mask without pixels that are not valid in some band."""
    for bad in (np.ma.getmask(image), None if nodata is None else np.asarray(image) == nodata):
        if bad is not None and np.any(bad):
            valid = ~np.any(bad, axis=0)
            mask = valid if mask is None else mask & valid
    return mask


@checked_keywords()
def utd(image: npt.NDArray[Any], background: Background | Mask | None = None, *, mask: Mask | None = None) -> Scores:
    """Uniform target detector (Ashton and Schaum 1998): likeness to a spectrum of ones; parameters as `rx`."""
    return _run("utd", image, background, mask)


@checked_keywords()
def rx_utd(image: npt.NDArray[Any], background: Background | Mask | None = None, *, mask: Mask | None = None) -> Scores:
    """RX less UTD (Ashton and Schaum 1998); parameters as `rx`."""
    return _run("rx-utd", image, background, mask)


@checked_keywords()
def subspace_rx(
    image: npt.NDArray[Any], background: Background | Mask | None = None, *, drop: int = 1, mask: Mask | None = None
) -> Scores:
    """RX without the `drop` leading eigenvectors of the covariance (Schaum 2007); other parameters as `rx`.

    The leading eigenvector of a glinted sea is glint: leaving it out is a linear way to suppress it.
    """
    return _run("subspace", image, background, mask, drop=drop)


@checked_keywords()
def residual_rx(
    image: npt.NDArray[Any],
    background: Background | Mask | None = None,
    *,
    nir: Sequence[int],
    mask: Mask | None = None,
) -> Scores:
    """RX of what is left of each band after regression on reference bands; other parameters as `rx`.

    Parameters
    ----------
    nir : sequence of int
        0-based reference bands. The scores are those of RX on all bands less those of RX on the reference bands
        alone: what the reference bands themselves show does not count.
    """
    return _run("residual", image, background, mask, nir=nir)


def _run(
    method: str, image: npt.NDArray[Any], background: Background | Mask | None, mask: Mask | None,
    covariance: str = "empirical", ridge: float = RIDGE, threads: int | None = None, **options: Any,
) -> Scores:  # fmt: skip
    image = as_image(image)
    mask = as_mask(mask, image)
    threads = threads or default_threads(image)
    if not isinstance(background, Background):
        inside = as_mask(background, image)
        inside = mask if inside is None else inside if mask is None else inside & mask
        background = fit(image, mask=inside, covariance=covariance, ridge=ridge, threads=threads)
    ready = detector(method, background, **options)
    large = image.shape[1] * image.shape[2] > COMPILED_PIXELS and len(image) <= _KERNEL_BANDS
    return score(image, ready, mask, compiled=large, threads=threads)


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


class _Callable(ModuleType):
    """This module, which is called like its main function: `detect.rx` is both."""

    def __call__(self, *args: Any, **kwargs: Any) -> Scores:
        return rx(*args, **kwargs)


sys.modules[__name__].__class__ = _Callable
