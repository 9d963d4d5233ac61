"""RX and related detectors: distance of a pixel from the background, relative to the background's covariance.

A `Detector` holds the matrix that `detector` computes once from a `detect.background.Background`. `score` applies it to
blocks, pixel by pixel, so the scores are the same to the bit for any tiling. No file is opened here.

References
----------
Reed, Yu (1990), "Adaptive multiple-band CFAR detection of an optical pattern with unknown spectral distribution", IEEE
Transactions on Acoustics, Speech, and Signal Processing 38, 1760-1770, doi:10.1109/29.60107.
Ashton, Schaum (1998), "Algorithms for the detection of sub-pixel targets in multispectral imagery", Photogrammetric
Engineering and Remote Sensing 64, 723-731.
Schaum (2007), "Hyperspectral anomaly detection beyond RX", Proc. SPIE 6565, 656502, doi:10.1117/12.718789.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deglint.checks import check_choice, checked_keywords
from deglint.errors import FitError, InputError
from deglint.tiles import Tile, default_threads, run, tiles

from .arrays import Array, Float64, Mask, Scores
from .background import RIDGE, Background, as_image, both, fit
from .covariance import TOLERANCE, whitener

Given = Background | Mask | None  # a fitted background, or the pixels to which one is fitted; None: all of them
_CHUNK = 1024  # number of pixels that are scored at a time (for few bands up to 8 times as many): they fit in the cache
_PRODUCTS = 1 << 18  # multiplications in a matrix product for up to 16 bands: so few that OpenBLAS starts no threads
_STRIP_PIXELS = 1 << 19  # number of pixels that a thread scores at a time


@dataclass(frozen=True)
class Method:
    """Entry of `DETECTORS`.

    `matrices` computes `Detector.whiten`, and for some detectors `Detector.linear`, from the background, the whitening
    matrix of its covariance, the number of eigenvectors to drop, and 0-based NIR bands; None without one background.
    """

    summary: str  # one line for `--help`
    matrices: Callable[[Background, Float64, int, Sequence[int]], tuple[Float64, ...]] | None = None
    law: bool = False  # whether scores over a normal background follow F or chi-squared
    invariant: bool = False  # whether a removal that subtracts multiples of NIR bands in use changes no score
    nir: bool = False  # whether `matrices` needs the NIR bands
    options: tuple[str, ...] = ()  # fields of a recipe that only this detector uses
    covariances: tuple[str, ...] = ("empirical",)  # estimators that a detector without `matrices` accepts


@dataclass(frozen=True, eq=False)
class Detector:
    """A detector that is fitted to a background.

    The score of a pixel x, (bands,), is |whiten d|^2 + linear . d, with d = x - mean - rest.
    """

    mean: Float64  # (bands,)
    rest: Float64  # (bands,): rounding error of the mean
    whiten: Float64  # (rank, bands); the rank is the number of degrees of freedom
    linear: Float64 | None = None  # (bands,); None: the score has no linear term


def detector(method: str, background: Background, *, drop: int = 1, nir: Sequence[int] = ()) -> Detector:
    """Make a detector from a background; `method`: a key of `DETECTORS` with `Method.matrices`.

    "subspace" leaves out `drop` leading eigenvectors; "residual" regresses the other bands on the bands `nir`, 0-based.
    Raises InputError if `method`, `drop` or `nir` is not allowed, and FitError if no band of the background varies.
    """
    known = {name: kind.matrices for name, kind in DETECTORS.items() if kind.matrices}
    check_choice(method, list(known), "method")
    whiten = whitener(background.covariance)
    if not len(whiten):
        raise FitError("no band of the background varies, so no pixel can exceed it. Check bands and nodata.")
    return Detector(background.mean, background.rest, *known[method](background, whiten, drop, nir))


def score(image: Array, detector: Detector, mask: Mask | None = None, *, threads: int = 1) -> Scores:
    """Scores, (row, column), of a block, (band, row, column); NaN where a band is not finite, or outside the mask."""
    image = np.asarray(image)
    if len(image) != len(detector.mean):
        raise InputError(f"the image has {len(image)} bands, the background {len(detector.mean)}. Use the same bands.")
    flat = np.ascontiguousarray(image).reshape(len(image), -1)
    out: Scores = np.empty(flat.shape[1], np.float64 if image.dtype == np.float64 else np.float32)

    def fill_strip(strip: Tile) -> None:
        pixels = slice(strip.col0, strip.col1)
        with np.errstate(invalid="ignore", over="ignore"):
            _fill(flat[:, pixels], detector, out[pixels])

    list(run(tiles(1, len(out), (1, _STRIP_PIXELS)), fill_strip, threads=threads))
    # finite scores beyond the output type become its largest value; the others are not valid
    if (bad := ~np.isfinite(out)).any():
        fine = np.isfinite(flat[:, bad]).all(axis=0)
        out[bad] = np.where(fine, np.copysign(np.finfo(out.dtype.name).max, out[bad]), np.nan)
    scores: Scores = out.reshape(image.shape[1:])
    if mask is not None:
        scores[~mask] = np.nan
    return scores


def _fill(flat: Array, detector: Detector, out: Scores) -> None:
    """Fill `out`, (pixels,), with the scores of the pixels `flat`, (bands, pixels)."""
    matrix = detector.whiten if detector.linear is None else np.vstack([detector.whiten, detector.linear])
    rank, moved = len(detector.whiten), (matrix @ detector.rest)[:, None]
    # always the same width: at the end of a shorter matrix, BLAS may add in another order, and tiles would differ
    width = min(max(_PRODUCTS // max(matrix.size, 1), _CHUNK), 8 * _CHUNK)
    centred = np.zeros((len(flat), width))
    for start in range(0, len(out), width):
        part = flat[:, start : start + width]
        count = part.shape[1]
        np.subtract(part, detector.mean[:, None], out=centred[:, :count])
        z = matrix @ centred
        z -= moved
        np.square(z[:rank], out=z[:rank])
        out[start : start + count] = np.add.reduce(z, axis=0)[:count]


def _uniform(background: Background, whiten: Float64, *_: Any) -> tuple[Float64, Float64]:
    """Empty whitening matrix, and weights of the bands, (bands,): the score is the sum of weight * (x - mean).
    The weights are C^-1 (u - mean), where C is the covariance, and the target spectrum u is 1 in all bands.
    """
    return whiten[:0], np.asarray(whiten.T @ (whiten @ (1 - background.mean)))


def _subspace(background: Background, _whiten: Float64, drop: int, _nir: Sequence[int]) -> tuple[Float64]:
    """Whitening matrix, (rank - drop, bands), without the `drop` leading eigenvectors of the covariance."""
    values, vectors = np.linalg.eigh(background.covariance)
    kept = np.flatnonzero(values > TOLERANCE * len(values) * values[-1])
    if not 0 <= drop < len(kept):
        raise InputError(f"drop: want 0 to {len(kept) - 1} of the {len(kept)} eigenvectors, got {drop}.")
    kept = kept[: len(kept) - drop]
    return (np.asarray(vectors[:, kept].T / np.sqrt(values[kept])[:, None]),)


def _residual(background: Background, _whiten: Float64, _drop: int, nir: Sequence[int]) -> tuple[Float64]:
    """Matrix, (rank, bands), that regresses the other bands on the bands `nir` (0-based) and whitens the residuals."""
    covariance, bands = background.covariance, background.bands
    reference = sorted({int(b) for b in nir})
    others = [b for b in range(bands) if b not in reference]
    if not reference or not others or reference[0] < 0 or reference[-1] >= bands:
        raise InputError(f"nir: want some of the bands 0 to {bands - 1}, not all, got {list(nir)}.")
    inverse = whitener(covariance[np.ix_(reference, reference)])
    cross = covariance[np.ix_(others, reference)]
    slopes = cross @ inverse.T @ inverse
    left = covariance[np.ix_(others, others)] - slopes @ cross.T
    # a band that the reference explains up to rounding errors is left out, like a constant band
    gone = np.diag(left) <= TOLERANCE * bands * np.diag(covariance)[others]
    left[gone] = left[:, gone] = 0
    whiten = whitener(left)
    out = np.zeros((len(whiten), bands))
    out[:, others], out[:, reference] = whiten, -whiten @ slopes
    return (out,)


DETECTORS = {
    "sea": Method("distance from the water around, for ships, boats and swimmers",
                  options=("largest_object", "side", "false_per_km2")),
    "lines": Method("rx relative to an average of the lines before, line by line"),
    "rx": Method("squared Mahalanobis distance from the background (Reed, Yu 1990)",
                 lambda _, whiten, *__: (whiten,), law=True, invariant=True),
    "local": Method("rx relative to the ring around each pixel", law=True, invariant=True,
                    options=("window", "border"), covariances=("empirical", "ridge")),
    "utd": Method("similarity to a target of the value 1 in all bands (Ashton, Schaum 1998)", _uniform),
    "rx-utd": Method("rx minus utd", lambda background, whiten, *_: (whiten, -_uniform(background, whiten)[1])),
    "subspace": Method("rx without the leading eigenvectors (Schaum 2007)", _subspace, law=True, options=("drop",)),
    "residual": Method("rx after regression on the NIR", _residual, law=True, invariant=True, nir=True),
}  # fmt: skip
"""All detectors by name; those with `matrices` compare pixels with one background for the whole scene."""


@checked_keywords()
def rx(
    image: Array,
    background: Given = None,
    *,
    mask: Mask | None = None,
    nodata: float | None = None,
    covariance: str = "empirical",
    ridge: float = RIDGE,
    threads: int | None = None,
) -> Scores:
    """Global RX (Reed and Yu 1990): squared Mahalanobis distance (x - mean)' C^-1 (x - mean) from the background.

    Parameters
    ----------
    image : (band, row, column) ndarray
        Any real type, any units. In a numpy masked array, pixels that are masked in any band are not valid.
    background : Background or (row, column) bool ndarray, optional
        A background that is already fitted, to this or another scene; or a mask that is True at the pixels to which
        it is fitted. By default, it is fitted to all valid pixels.
    mask : (row, column) bool ndarray, optional
        True where a pixel is used. The others are not in the background, and their score is NaN.
    nodata : float, optional
        A pixel with this value in any band is not valid. NaN is never valid.
    covariance, ridge, threads : str, float, int
        As in `detect.background.fit`; `covariance` and `ridge` are ignored if `background` is a Background.

    Returns
    -------
    (row, column) ndarray
        float64 for a float64 image, else float32; NaN where not valid. For a normal background of many pixels the
        scores follow chi-squared with as many degrees of freedom as there are independent bands.

    Raises
    ------
    InputError, FitError
        As in `detect.background.fit`; also InputError if image and background differ in the number of bands, and
        FitError if no band of the background varies.

    Examples
    --------
    >>> image = np.random.default_rng(0).normal(size=(3, 50, 60))
    >>> image[:, 20, 30] += 10
    >>> scores = rx(image)
    >>> np.unravel_index(scores.argmax(), scores.shape) == (20, 30)
    True
    """
    if nodata is not None:
        image = np.ma.array(image, mask=np.ma.getmaskarray(image) | (np.asarray(image) == nodata), copy=False)
    return _run("rx", image, background, mask, covariance=covariance, ridge=ridge, threads=threads)


@checked_keywords()
def utd(image: Array, background: Given = None, *, mask: Mask | None = None) -> Scores:
    """Uniform target detector (Ashton, Schaum 1998): (u - mean)' C^-1 (x - mean), with u = 1 in all bands; see `rx`."""
    return _run("utd", image, background, mask)


@checked_keywords()
def rx_utd(image: Array, background: Given = None, *, mask: Mask | None = None) -> Scores:
    """`rx` minus `utd` (Ashton, Schaum 1998): (x - u)' C^-1 (x - mean), with u = 1 in all bands; see `rx`."""
    return _run("rx-utd", image, background, mask)


@checked_keywords()
def subspace_rx(image: Array, background: Given = None, *, drop: int = 1, mask: Mask | None = None) -> Scores:
    """RX without the `drop` leading eigenvectors of the covariance (Schaum 2007). See `rx` for other parameters.

    For a sea with glint, the leading eigenvector is the spectrum of the glint, so that RX without it suppresses glint.
    """
    return _run("subspace", image, background, mask, drop=drop)


@checked_keywords()
def residual_rx(image: Array, background: Given = None, *, nir: Sequence[int], mask: Mask | None = None) -> Scores:
    """RX of the residuals of the bands after regression on reference bands; the other parameters are as in `rx`.

    Parameters
    ----------
    nir : sequence of int
        0-based reference bands. The score, RX of all bands minus RX of `nir`, is low where `nir` predicts other bands.
    """
    return _run("residual", image, background, mask, nir=nir)


def _run(method: str, image: Array, background: Given, mask: Mask | None, **options: Any) -> Scores:
    """Score an image with a method; fit the background if none is given. `options` are those of `fit` or `detector`."""
    fitting = {name: options.pop(name) for name in ("covariance", "ridge", "threads") if name in options}
    pixels, mask = as_image(image, mask)
    if not isinstance(background, Background):
        background = fit(pixels, mask=both(as_image(pixels, background)[1], mask), **fitting)
    threads = default_threads(fitting.get("threads"))
    return score(pixels, detector(method, background, **options), mask, threads=threads)
