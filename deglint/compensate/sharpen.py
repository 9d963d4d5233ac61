"""PSF correction: Richardson-Lucy deconvolution with the point spread function of each band."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import cv2
import numpy as np

from ..errors import InputError
from .psf import PSF
from .state import Float32, Sample, Setting, State

ITERATIONS = 2
"""Default number of iterations. With one, the error of the compensated image is 8 % larger at a wind of 9 m/s; three
cause dark rings beside sparkle, which openings enlarge."""
FLOOR = 1e-3  # lower limit of values, as a share of the band's median: the algorithm needs positive values


def blurred(band: Float32, psf: PSF, rank: int = 2) -> Float32:
    """Convolve a band (row, column) with a PSF of `rank` separable kernels; rank 1 makes final errors 5 % larger.
    The sum of these kernels is scaled to 1.
    """
    factors = psf.factors[:rank]
    total = sum(down.sum() * across.sum() for down, across in factors)
    kernels = [((down / total).astype(np.float32), across.astype(np.float32)) for down, across in factors]
    parts = [cv2.sepFilter2D(band, -1, across, down, borderType=cv2.BORDER_REFLECT_101) for down, across in kernels]
    return np.asarray(sum(parts[1:], parts[0]), np.float32)


def richardson_lucy(band: Float32, psf: PSF, iterations: int = ITERATIONS, floor: float = 1e-12) -> Float32:
    """Deconvolution of Richardson (1972) and Lucy (1974), started with the band itself.

    .. math:: u_{k+1} = u_k \\, h^T * \\frac{y}{h * u_k}

    band : (row, column), the blurred band y, finite
    psf : the kernel h, symmetric; * is the convolution
    iterations : number of iterations
    floor : lower limit of y and of its prediction ``h * u``, positive [unit of the band]

    Returns the deconvolved band u after the last iteration, (row, column) [unit of the band].

    A PSF that is wider than the PSF of the image causes ringing. A few iterations concentrate the light of glint in
    fewer pixels and hardly amplify the noise.

    Richardson (1972), J. Opt. Soc. Am. 62, 55-59, doi:10.1364/JOSA.62.000055.
    Lucy (1974), Astron. J. 79, 745-754, doi:10.1086/111605.
    """
    least = np.float32(floor)
    out = known = np.maximum(band, least)
    for _ in range(iterations):
        ratio = np.asarray(known / np.maximum(blurred(out, psf), least), np.float32)
        out = out * np.maximum(blurred(ratio, psf), np.float32(1e-3))  # a pixel keeps at least a thousandth
    return out


@dataclass(frozen=True)
class Sharpen:
    """The fitted stage `psf`: it deconvolves the bands. The result is used only to determine the background."""

    name: ClassVar[str] = "psf"
    psfs: tuple[PSF, ...]  # PSF of each band
    iterations: int
    floors: tuple[float, ...]  # lower limit of the values of each band [unit of the image]

    @classmethod
    def fit(cls, sample: Sample, setting: Setting, number: float | None = None) -> Self:
        """Make the stage with the PSFs in `setting`; `number` is the number of iterations, 2 by default. The lower
        limits `floors` are a thousandth of the median of each band in `sample`. Raises InputError if the PSFs are not
        known, FitError if the sample is too small.
        """
        if setting.psfs is None:
            raise InputError(
                f"{cls.name} needs the wavelengths of all bands, 300 to 2500 nm: give --wavelengths, or leave it out."
            )
        values = sample.values([s.image for s in sample.states])
        floors = tuple(max(FLOOR * float(np.median(v)), 1e-12) for v in values)
        return cls(setting.psfs, int(number or ITERATIONS), floors)

    @property
    def halo(self) -> int:
        """Margin around a block that the iterations need [pixel]."""
        return 2 * self.iterations * max(p.radius for p in self.psfs)

    def sharp(self, state: State) -> Float32:
        """All bands after deconvolution, (band, row, column)."""
        parts = zip(state.image, self.psfs, self.floors, strict=True)
        return np.stack([richardson_lucy(b, p, self.iterations, f) for b, p, f in parts])

    def apply(self, state: State) -> State:
        """Store the deconvolved bands in `State.sharp`, and the PSFs in `State.psfs`; the image is not changed."""
        return replace(state, sharp=self.sharp(state), psfs=self.psfs)


@dataclass(frozen=True)
class SharpenImage(Sharpen):
    """The fitted stage `psf-image`: the deconvolved bands become the image, as in Fink (2014), section 6.3.2."""

    name: ClassVar[str] = "psf-image"

    def apply(self, state: State) -> State:
        """Replace every band by its deconvolution, and mark all water as replaced."""
        return replace(state, image=self.sharp(state), replaced=np.broadcast_to(state.water, state.image.shape))
