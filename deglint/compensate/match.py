"""Blur every band as the reference (the NIR) is blurred, so that glint looks the same in both.

Diffraction grows with wavelength: at the same instant a sparkle is narrower in the blue than in the NIR, and a
multiple of the NIR cannot take it off. Useful where bands are simultaneous, useless where they are not. Arrays only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from .psf import PSF, Float64Array
from .sharpen import SLAB, Float32Array, fir, flipped, mirrored, share_of

Form = Literal["fir", "fft"]
FORMS: tuple[str, ...] = get_args(Form)

RIDGE = 1e-3
"""Added to the squared OTF of the band, so that what it does not pass is not blown up."""
LEAST_SHARE = 0.2
"""Where less of the kernel than this lies on valid pixels, a pixel is passed as it is."""


@dataclass(frozen=True, eq=False)
class Matching:
    """Kernels that blur each band as the reference is blurred.

    Attributes
    ----------
    kernels : tuple of (side, side) float64 ndarray, or None
        One a band, each with sum 1; None for bands that are left alone: the reference, and what is blurrier.
    reference : int
        Index of the band whose blur all get.
    residual : tuple of float
        Largest difference between the OTF that a band ends up with and that of the reference, 0..1.
    """

    kernels: tuple[Float64Array | None, ...] = field(repr=False)
    reference: int
    residual: tuple[float, ...]

    @property
    def halo(self) -> int:
        """Pixels that `apply_match` needs around a tile."""
        return max((len(k) // 2 for k in self.kernels if k is not None), default=0)

    def numbers(self) -> dict[str, Any]:
        """What describes it, as plain numbers, for a sidecar."""
        sides = [0 if k is None else len(k) for k in self.kernels]
        return {"reference": self.reference, "sides": sides, "residual": list(self.residual), "halo": self.halo}


def fit_match(psfs: Sequence[PSF], reference: int, *, radius: int | None = None) -> Matching:
    """Kernels that match the bands' OTFs to the reference's.

    A kernel of any size that minimises ``|p_b * h - p_N|**2 + 1e-3 |h|**2`` has the transform
    ``H = O_N conj(O_b) / (|O_b|**2 + 1e-3)``; here h is the kernel of limited size, with sum 1, that minimises it.

    Parameters
    ----------
    psfs : sequence of PSF
        One a band, in the order of the bands.
    reference : int
        Index of the band to match, the NIR.
    radius : int, optional
        Of the kernels [pixel]; by default that of the reference's PSF.

    Returns
    -------
    Matching

    Raises
    ------
    InputError
        No such band, or a radius out of range.

    Notes
    -----
    Bands that are blurrier than the reference are left alone: to sharpen them would raise their noise. Cost: about
    10 ms a band for 9 x 9, 200 ms for 27 x 27.

    Examples
    --------
    >>> from deglint.compensate.psf import system_psf
    >>> psfs = [system_psf(w, f_number=10, pitch=8e-6) for w in (480.0, 832.5)]
    >>> fit_match(psfs, 1).halo == psfs[1].radius
    True
    """
    _check_reference(len(psfs), reference)
    target = psfs[reference]
    radius = target.radius if radius is None else radius
    if not 0 <= radius <= 32:
        raise InputError(f"radius of the matching kernels must be 0 to 32 pixels, got {radius}.")
    kernels = tuple(None if _left_alone(p, target) else _fitted(p, target, radius) for p in psfs)
    residual = (_residual(p, target, k) for p, k in zip(psfs, kernels, strict=True))
    return Matching(kernels, reference, tuple(residual))


def apply_match(block: npt.NDArray[Any], matching: Matching) -> npt.NDArray[Any]:
    """Blur the bands of a block.

    Parameters
    ----------
    block : (band, row, column) ndarray
        Any unit; NaN is not valid. A tile needs `matching.halo` more pixels on every side.
    matching : Matching
        From `fit_match`.

    Returns
    -------
    (band, row, column) ndarray of float32

    Raises
    ------
    InputError
        The block has other bands than the model.

    Notes
    -----
    Mirrored at the edges. A blurred pixel is the mean over the valid pixels under the kernel; pixels that are not
    finite are passed as they are. A tile with its halo gives to the bit what the whole image gives. Cost, one core:
    3 ns a pixel and band for 9 x 9 taps.
    """
    if block.ndim != 3 or len(block) != len(matching.kernels):
        raise InputError(f"the block has shape {block.shape}, the model has {len(matching.kernels)} bands")
    out = np.empty(block.shape, np.float32)
    for band, kernel, result in zip(block, matching.kernels, out, strict=True):
        if kernel is None or band.size == 0:
            result[...] = band
            continue
        blur = fir(flipped(kernel))
        for first in range(0, len(band), SLAB):
            rows = first, min(first + SLAB, len(band))
            _blurred(band, rows, blur, len(kernel) // 2, result[slice(*rows)])
    return out


def match(image: npt.NDArray[Any], psfs: Sequence[PSF], reference: int, *, form: Form = "fir") -> npt.NDArray[Any]:
    """Blur all bands of an image as the reference is blurred.

    .. math:: H = \\frac{O_N O_b^*}{|O_b|^2 + 10^{-3}}

    Parameters
    ----------
    image : (band, row, column) ndarray
        Any unit; NaN is not valid.
    psfs : sequence of PSF
        One a band.
    reference : int
        Index of the band to match, the NIR.
    form : str
        "fir": `fit_match` and `apply_match`, the same in tiles. "fft": H itself, for whole images without NaN.

    Returns
    -------
    (band, row, column) ndarray of float32

    Raises
    ------
    InputError
        No such band or form, other bands than PSFs, or "fft" of an image that has pixels that are not finite.
    """
    if form not in FORMS:
        raise InputError(f"form must be one of {', '.join(FORMS)}; got {form!r}")
    if image.ndim != 3 or len(image) != len(psfs):
        raise InputError(f"the image has shape {image.shape}, but {len(psfs)} PSFs are given; give one a band")
    if form == "fir":
        return apply_match(image, fit_match(psfs, reference))
    _check_reference(len(psfs), reference)
    out = image.astype(np.float32)
    if not np.isfinite(out).all():
        raise InputError('the image has pixels that are not finite; form "fft" cannot leave them out. Use "fir".')
    for band, psf in zip(out, psfs, strict=True):
        if not _left_alone(psf, psfs[reference]) and band.size:
            band[...] = _by_transform(band, psf, psfs[reference])
    return out


def _check_reference(bands: int, reference: int) -> None:
    if not 0 <= reference < bands:
        raise InputError(f"the reference is band index {reference}, but there are PSFs for indexes 0..{bands - 1}")


def _left_alone(psf: PSF, target: PSF) -> bool:
    return psf is target or psf.centre <= target.centre


def _fitted(psf: PSF, target: PSF, radius: int) -> Float64Array:
    """The kernel: normal equations in the correlations of the two PSFs, sum 1 by a Lagrange multiplier."""
    side = 2 * radius + 1
    size = len(psf.wide) + len(target.wide) + 2 * side
    band, wanted = _otf(psf, (size, size)), _otf(target, (size, size))
    auto = np.fft.irfft2(np.abs(band) ** 2, s=(size, size))
    cross = np.fft.irfft2(wanted * band.conj(), s=(size, size))
    place = np.stack(np.divmod(np.arange(side * side), side)) - radius
    apart = (place[:, :, None] - place[:, None, :]) % size
    matrix = auto[apart[0], apart[1]] + RIDGE * np.eye(side * side)
    right = np.stack([cross[place[0] % size, place[1] % size], np.ones(side * side)], axis=1)
    best, even = np.linalg.solve(matrix, right).T
    return np.asarray((best + even * (1 - best.sum()) / even.sum()).reshape(side, side))


def _otf(psf: PSF, shape: tuple[int, int], kernel: Float64Array | None = None) -> npt.NDArray[np.complex128]:
    """Half spectrum of a PSF (or kernel) with its middle at the origin of a grid that holds it."""
    wide = psf.wide if kernel is None else kernel
    half = len(wide) // 2
    padded = np.zeros(shape)
    padded[: len(wide), : len(wide)] = wide
    return np.fft.rfft2(np.roll(padded, (-half, -half), axis=(0, 1)))


def _residual(psf: PSF, target: PSF, kernel: Float64Array | None) -> float:
    """Largest difference of OTFs after matching."""
    size = max(len(psf.wide), len(target.wide)) | 1
    got = _otf(psf, (size, size))
    if kernel is not None:
        got = got * _otf(psf, (size, size), kernel)
    return float(np.abs(got - _otf(target, (size, size))).max())


def _blurred(band: npt.NDArray[Any], rows: tuple[int, int], blur: Any, radius: int, out: Float32Array) -> None:
    """Put the given rows of a band, blurred, into `out`."""
    y = mirrored(band, rows, radius)
    inner = slice(radius, radius + rows[1] - rows[0]), slice(radius, radius + band.shape[1])
    valid = np.isfinite(y)
    if valid.all():
        out[...] = blur(y, None)[inner]
        return
    share = share_of(valid, blur, radius, least=LEAST_SHARE)[inner]
    original = y[inner].copy()
    y[~valid] = 0.0
    np.divide(blur(y, None)[inner], share, out=out)
    np.copyto(out, original, where=~valid[inner] | np.isnan(share))


def _by_transform(band: Float32Array, psf: PSF, target: PSF) -> Float32Array:
    """H itself, the image mirrored about its edges by half the width of the widest PSF."""
    from scipy import fft

    half = max(len(psf.wide), len(target.wide)) // 2
    rows, columns = (fft.next_fast_len(n + 2 * half, real=True) for n in band.shape)
    padded = mirrored(band, (0, len(band)), half, columns)
    padded = np.pad(padded, ((0, rows - len(padded)), (0, 0)), mode="edge")
    side = max(rows, len(psf.wide), len(target.wide)), max(columns, len(psf.wide), len(target.wide))
    own = _otf(psf, side)
    transfer = _otf(target, side) * own.conj() / (np.abs(own) ** 2 + RIDGE) * (1 + RIDGE)
    blurred = fft.irfft2(fft.rfft2(padded) * transfer.astype(np.complex64), s=padded.shape)
    return np.asarray(blurred[half : half + band.shape[0], half : half + band.shape[1]])
