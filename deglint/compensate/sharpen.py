"""Sharpen a band by Richardson-Lucy iterations with its PSF, so that sparkle covers fewer pixels.

Arrays only: (row, column), one band. The result serves to find the level of the water beside the sparkle; it is no
output. Nothing is estimated from the image, so a tile with its halo gives what the whole image gives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..scene import Window
from .products import Float32Array, all_finite, by_products, products
from .psf import PSF, Float64Array

BoolArray = npt.NDArray[np.bool_]
Blur = Callable[[Float32Array, Float32Array | None], Float32Array]
Form = Literal["separable", "fir", "fft"]
FORMS: tuple[str, ...] = get_args(Form)

LEAST_RATIO, MOST_RATIO = 1e-3, 1e3
"""The ratio of what is seen to what is predicted is kept within these."""
NEXT_TO_NOTHING = 1e-30
"""What is not positive is taken as this."""
SLAB = 1024
"""Rows that are worked on at a time, so that memory does not grow with the image."""
VECTOR = 64
"""OpenCV rounds the last columns of a row otherwise than the rest; with widths of so many there are none."""
MOST_TAPS = 121
"""OpenCV may take larger kernels by Fourier transform, which is not the same to the bit in a tile."""


def sharpen_halo(psf: PSF, iterations: int) -> int:
    """Pixels that `richardson_lucy` needs around a tile, separable or FIR."""
    return 2 * iterations * psf.radius


def richardson_lucy(
    band: npt.NDArray[Any],
    psf: PSF,
    *,
    iterations: int | None = None,
    form: Form = "separable",
    rank: int = 2,
    pedestal: float = 0.0,
    within: Window | None = None,
    sound: bool = False,
) -> Float32Array:
    """Sharpen one band.

    .. math:: a_{k+1} = a_k \\; P^T \\left( \\frac{y}{P a_k} \\right), \\qquad a_0 = y

    (Richardson 1972, Lucy 1974; the start is the image itself.)

    Parameters
    ----------
    band : (row, column) ndarray
        y [any unit, proportional to light]; integers or floats, NaN is not valid.
    psf : PSF
        P, of this band.
    iterations : int, optional
        0 to 20; by default what suits the PSF, 2 to 4. From 5 on, f/10, pits appear around sparkle.
    form : str
        "separable": P is the sum of `rank` products of a column and a row that is nearest to the kernel. "fir": the
        kernel itself. "fft": all of `psf.wide`, by Fourier transform of the whole image.
    rank : int
        1 to 3. One product takes as long as two, and misses what makes the PSF round.
    pedestal : float
        Added before and taken off after [unit of the band]: where noise makes values of dark water negative, a few
        standard deviations of it. Sharpening grows weaker with it.
    within : ((row0, row1), (col0, col1)), optional
        Only these rows and columns are wanted; what lies around them is looked at.
    sound : bool
        Every number is known to be finite, and is not looked at for that.

    Returns
    -------
    (row, column) ndarray of float32
        Pixels that are not finite are passed as they are.

    Raises
    ------
    InputError
        Not two-dimensional, an unknown form, or a number out of range.

    Notes
    -----
    The image is mirrored at its edges. What is not valid has no share: predictions and corrections are means over
    the valid pixels under the kernel, so NaN does not spread. Values of -pedestal and below are taken as next to
    nothing and stay there. The ratio is kept within 1e-3 to 1e3.

    Assumes that the PSF is right to some 20 % of the f-number; a Gaussian of the same width is not good enough.
    Noise is sharpened with the rest. A tile with `sharpen_halo` pixels more on every side gives to the bit what the
    whole image gives, in the forms "separable" and "fir"; "fft" is for whole images. Cost, one core with vectors of 16
    float32, 2 iterations at f/10: 2.2 ns a pixel with rank 1 or 2, 19 as FIR, 50 by Fourier transform.

    References
    ----------
    Richardson, W. H. (1972), "Bayesian-based iterative method of image restoration", J. Opt. Soc. Am. 62, 55-59,
    doi:10.1364/JOSA.62.000055. Lucy, L. B. (1974), "An iterative technique for the rectification of observed
    distributions", Astron. J. 79, 745-754, doi:10.1086/111605.

    Examples
    --------
    >>> from deglint.compensate.psf import system_psf
    >>> spot = np.ones((9, 9))
    >>> spot[3:6, 3:6] += [[1, 2, 1], [2, 8, 2], [1, 2, 1]]
    >>> bool(richardson_lucy(spot, system_psf(545.0, f_number=10, pitch=8e-6))[4, 4] > 9)
    True
    """
    iterations = psf.iterations if iterations is None else iterations
    _check(band, iterations, form, rank)
    if not np.isfinite(pedestal):
        raise InputError(f"pedestal must be a finite number, got {pedestal}.")
    rows, columns = within or ((0, band.shape[0]), (0, band.shape[1]))
    if iterations == 0 or band.size == 0:
        return band[slice(*rows), slice(*columns)].astype(np.float32)
    if form == "separable":
        kernels = products(psf, rank)
        return by_products(band, kernels, iterations, (rows, columns), pedestal=pedestal, sound=sound)
    out = np.empty((rows[1] - rows[0], columns[1] - columns[0]), np.float32)
    filters = _fir_filters(psf, iterations) if form == "fir" else _fft_filters(band.shape, psf, iterations)
    slab, wide = (SLAB, None) if form == "fir" else (len(band), _fft_columns(band.shape[1], filters.halo))
    for first in range(rows[0], rows[1], slab):
        last = min(first + slab, rows[1])
        y = mirrored(band, (first, last), filters.halo, wide)
        some = out[first - rows[0] : last - rows[0]]
        _sharpened(y, columns[0], filters, iterations, pedestal, some)
    return out


@dataclass(frozen=True)
class Filters:
    """P and its transpose, where they reach, and how many pixels of margin they want."""

    blur: Blur
    back: Blur
    radius: int
    halo: int


def _check(band: npt.NDArray[Any], iterations: int, form: str, rank: int) -> None:
    if band.ndim != 2:
        raise InputError(f"a band must be (row, column); got an array of shape {band.shape}")
    if form not in FORMS:
        raise InputError(f"form must be one of {', '.join(FORMS)}; got {form!r}")
    if iterations not in range(21):
        raise InputError(f"iterations must be a whole number, 0 to 20, got {iterations}. 2 to 4 are usual.")
    if rank not in (1, 2, 3):
        raise InputError(f"rank must be 1, 2 or 3, got {rank}. 2 is usual.")


def _fir_filters(psf: PSF, iterations: int) -> Filters:
    """P and its transpose, as they are."""
    return Filters(
        fir(flipped(psf.kernel)), fir(psf.kernel.astype(np.float32)), psf.radius, sharpen_halo(psf, iterations)
    )


def fir(kernel: Float32Array) -> Blur:
    """Correlation with a kernel, in strips of it that OpenCV sums pixel by pixel."""
    import cv2

    side = len(kernel)
    rows = max(MOST_TAPS // side, 1)
    strips = [(first, np.ascontiguousarray(kernel[first : first + rows])) for first in range(0, side, rows)]

    def correlate(image: Float32Array, out: Float32Array | None = None) -> Float32Array:
        if len(strips) == 1:
            return np.asarray(cv2.filter2D(image, cv2.CV_32F, strips[0][1], dst=out))
        total = np.zeros_like(image) if out is None else out
        total[...] = 0.0
        for first, strip in strips:
            _add_strip(image, strip, first - side // 2, total)
        return total

    return correlate


def _add_strip(image: Float32Array, strip: Float32Array, offset: int, total: Float32Array) -> None:
    """Add the correlation with some rows of a kernel, the first of which lies `offset` rows below the middle."""
    import cv2

    middle = min(max(-offset, 0), len(strip) - 1)  # the row of the strip that OpenCV is to take for the kernel's middle
    part = cv2.filter2D(image, cv2.CV_32F, strip, anchor=(-1, middle))
    away = offset + middle  # and how far below the middle it really lies
    if abs(away) >= len(part):
        return
    if away >= 0:
        total[: len(part) - away] += part[away:]
    else:
        total[-away:] += part[:away]


def _fft_filters(shape: tuple[int, ...], psf: PSF, iterations: int) -> Filters:
    """P and its transpose by Fourier transform of all of the PSF."""
    from scipy import fft

    half = len(psf.wide) // 2
    halo = 2 * iterations * half
    rows, columns = shape[0] + 2 * halo, _fft_columns(shape[1], halo)
    padded = np.zeros((rows, columns), np.float32)
    padded[: len(psf.wide), : len(psf.wide)] = psf.wide
    otf = fft.rfft2(np.roll(padded, (-half, -half), axis=(0, 1)))

    def by(transfer: npt.NDArray[np.complexfloating[Any, Any]]) -> Blur:
        def convolve(image: Float32Array, out: Float32Array | None = None) -> Float32Array:
            blurred = fft.irfft2(fft.rfft2(image) * transfer, s=image.shape)
            if out is not None:
                out[...] = blurred
            return np.asarray(blurred)

        return convolve

    return Filters(by(otf), by(otf.conj()), half, halo)


def _fft_columns(columns: int, halo: int) -> int:
    """Width of the arrays that are transformed."""
    from scipy import fft

    return int(fft.next_fast_len(columns + 2 * halo, real=True))


def _sharpened(
    y: Float32Array, left: int, filters: Filters, iterations: int, pedestal: float, out: Float32Array
) -> None:
    """Put some rows of a band, given with halo and columns further left, sharpened into `out`; `y` is overwritten."""
    halo = filters.halo
    inner = slice(halo, halo + out.shape[0]), slice(halo + left, halo + left + out.shape[1])
    valid = None if all_finite(y) else np.isfinite(y)
    original = None if valid is None else y[inner].copy()
    if pedestal:
        y += np.float32(pedestal)
    np.subtract(_iterate(y, valid, filters, iterations)[inner], np.float32(pedestal), out=out)
    if original is not None and valid is not None:
        np.copyto(out, original, where=~valid[inner])


def _iterate(y: Float32Array, valid: BoolArray | None, filters: Filters, iterations: int) -> Float32Array:
    """Richardson-Lucy on an array that has its margins, by whole arrays; `y` is overwritten."""
    import cv2

    keep: Any = cv2.max  # with numbers these are three times as fast as numpy's, but not typed
    cap: Any = cv2.min
    shares = None
    if valid is not None:
        y[~valid] = 0.0
        shares = [np.nan_to_num(share_of(valid, f, filters.radius), nan=1.0) for f in (filters.blur, filters.back)]
    keep(y, NEXT_TO_NOTHING, dst=y)
    a = y.copy()
    if valid is not None:
        a[~valid] = 0.0
    ratio, change = np.empty_like(a), np.empty_like(a)
    for _ in range(iterations):
        filters.blur(a, ratio)
        if shares is not None:
            ratio /= shares[0]
        keep(ratio, NEXT_TO_NOTHING, dst=ratio)
        cv2.divide(y, ratio, dst=ratio)
        keep(ratio, LEAST_RATIO, dst=ratio)
        cap(ratio, MOST_RATIO, dst=ratio)
        if valid is not None:
            ratio[~valid] = 0.0
        filters.back(ratio, change)
        if shares is not None:
            change /= shares[1]
        keep(change, LEAST_RATIO, dst=change)  # products and transforms may have negative weights
        cv2.multiply(a, change, dst=a)
    return a


def mirrored(band: npt.NDArray[Any], rows: tuple[int, int], halo: int, columns: int | None = None) -> Float32Array:
    """Some rows of a band with `halo` pixels around them, mirrored where the band ends, as float32.

    There are more columns on the right, for OpenCV's sake.
    """
    import cv2

    first, last = rows
    top, bottom = max(first - halo, 0), min(last + halo, len(band))
    part = np.ascontiguousarray(band[top:bottom], dtype=np.float32)
    wanted = columns or -(-(band.shape[1] + 2 * halo) // VECTOR) * VECTOR
    margins = halo - (first - top), halo - (bottom - last), halo, wanted - band.shape[1] - halo
    return np.asarray(cv2.copyMakeBorder(part, *margins, cv2.BORDER_REFLECT_101))


def share_of(valid: BoolArray, blur: Blur, radius: int) -> Float32Array:
    """Share of the kernel that lies on valid pixels: exactly 1 where all do, NaN where it is below `LEAST_RATIO`."""
    import cv2

    share = blur(valid.astype(np.float32), None)
    square = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    touched = cv2.dilate((~valid).view(np.uint8), square).view(np.bool_)
    share[~touched] = 1.0
    share[share < LEAST_RATIO] = np.nan
    return share


def flipped(kernel: Float64Array) -> Float32Array:
    """A kernel turned round, as float32, so that correlation with it is convolution."""
    return np.ascontiguousarray(kernel[::-1, ::-1], dtype=np.float32)
