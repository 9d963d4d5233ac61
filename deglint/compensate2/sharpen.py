"""PSF correction: Richardson-Lucy deconvolution with the point spread function of each band."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from .psf import PSF
from .state import Float32, Sample, Setting, State

ITERATIONS = 2
"""Richardson-Lucy iterations; more dig pits beside sparkle, which the opening then spreads."""


def blurred(band: Float32, psf: PSF) -> Float32:
    """A band convolved with a PSF (its two largest separable products)."""
    import cv2

    total = np.zeros_like(band)
    for down, across in psf.factors(2):
        total += cv2.sepFilter2D(band, -1, across, down, borderType=cv2.BORDER_REFLECT_101)
    return total


def richardson_lucy(band: Float32, psf: PSF, iterations: int = ITERATIONS) -> Float32:
    """Deconvolution of Richardson (1972) and Lucy (1974), begun with the band itself."""
    floor = np.float32(max(1e-3 * float(np.median(band)), 1e-12))
    known = np.maximum(band, floor)
    out = known
    for _ in range(iterations):
        ratio = known / np.maximum(blurred(out, psf), floor)
        out = out * np.maximum(blurred(ratio, psf), np.float32(1e-3))
    return out


@dataclass(frozen=True)
class Sharpen:
    name: ClassVar[str] = "psf"
    psfs: tuple[PSF, ...]
    iterations: int = ITERATIONS

    @property
    def halo(self) -> int:
        return (2 * self.iterations + 1) * max(p.radius for p in self.psfs)

    def apply(self, state: State) -> State:
        sharp = np.stack([richardson_lucy(b, p, self.iterations) for b, p in zip(state.image, self.psfs, strict=True)])
        return replace(state, sharp=sharp)


def fit(sample: Sample, setting: Setting, number: float | None = None) -> Sharpen:
    assert setting.psfs is not None
    return Sharpen(setting.psfs, int(number or ITERATIONS))
