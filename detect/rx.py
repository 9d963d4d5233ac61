"""RX and its kin: how far a pixel lies from the background, in the background's own measure.

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
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint.checks import checked_keywords

from .background import RIDGE, Background, Mask, Scores, as_image, as_mask, default_threads, fit
from .detector import GLOBAL_METHODS, Detector, detector, score

__all__ = ["GLOBAL_METHODS", "Detector", "detector", "residual_rx", "rx", "rx_utd", "score", "subspace_rx", "utd"]


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
    return score(image, ready, mask, threads=threads)


class _Callable(ModuleType):
    """This module, which is called like its main function: `detect.rx` is both."""

    def __call__(self, *args: Any, **kwargs: Any) -> Scores:
        return rx(*args, **kwargs)


sys.modules[__name__].__class__ = _Callable
