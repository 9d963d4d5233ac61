"""Removal within a compensation: every band follows 3 x 3 pixels of NIR, and of longer bands that see no bottom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..remove.lags import gather, merge, offsets, solve, unexplained
from .state import Float32, Mask, Sample, Setting, State


@dataclass(frozen=True)
class Mixture:
    band: int
    references: tuple[int, ...]
    kernels: tuple  # (3, 3) each
    level: float
    r2: float

    def predicted(self, image: Float32) -> Float32:
        import cv2
        total = np.zeros_like(image[0])
        for r, k in zip(self.references, self.kernels, strict=True):
            total += cv2.filter2D(image[r], -1, k, borderType=cv2.BORDER_REFLECT_101)
        return total - np.float32(self.level)


def fit_mixture(images, inside, band: int, refs: tuple[int, ...], percentile: float, side: int = 3) -> Mixture:
    parts = [gather([im[r] for r in refs], [im[band]], m, size=0) for im, m in zip(images, inside, strict=True)]
    grams = merge(parts)
    total = grams.grams.sum(axis=0)
    inputs = [c for r in range(len(refs)) for c in grams.columns(r, side)]
    out = [grams.band(0)]
    w = solve(total, inputs, out)
    r2 = 1 - float(unexplained(total, inputs, out, w)[0]) / total[out[0], out[0]]
    kernels = tuple(np.asarray(w[i * side * side:(i + 1) * side * side, 0].reshape(side, side), np.float32) for i in range(len(refs)))
    m = Mixture(band, refs, kernels, 0.0, r2)
    p = np.concatenate([m.predicted(im)[k] for im, k in zip(images, inside, strict=True)])
    return Mixture(band, refs, kernels, float(np.percentile(p, percentile)), r2)
