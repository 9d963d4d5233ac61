"""Normalisation of the scores of water by the glint of a pixel, which is measured in the NIR.

Residual glint is a heavy-tailed noise. Its standard deviation grows with the glint of the pixel. Scores are divided by
the usual score of water with the same NIR: then water scores alike everywhere, and a submerged object is found where
the glint above it is weak. Floating objects are bright in the NIR themselves. Therefore the divisor is constant above
the 90 % quantile of the NIR.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Float32, Float64, Mask

_CLASSES = 32
"""Number of classes of the NIR. Each class has 3 % of the pixels: hundreds, even in a small scene."""
_USUAL = 0.75
"""Quantile of the scores of a class that is its usual score. Objects on less than a quarter of the pixels do not change
it."""
_LAST_FACTOR = 0.9
"""Quantile of the NIR above which the divisor is constant: there, boats and swimmers are as bright as glint. On a
simulated sea with pixels of 1.24 m, 1 finds no boat, and 0.75 finds two submerged objects fewer."""
_REACH = 3
"""Side of the window over which the maximum of the NIR is taken [pixel]: waves move by about a pixel between bands."""


@dataclass(frozen=True, eq=False)
class GlintScale:
    """Usual score of water in each class of the NIR."""

    centre: Float64  # (band,): median of the NIR over water
    spread: Float64  # (band,): robust standard deviation of the NIR over water
    side: int  # of the largest averaging window of the scores [pixel]
    glint: Float64  # (class,): standardised NIR, see `nearby`
    factor: Float64  # (class,): usual score relative to that of the scene; does not decrease

    @classmethod
    def fit(cls, nir: Sequence[Array], scores: Sequence[Array], water: Sequence[Mask], side: int) -> GlintScale:
        """Fit the scale to the NIR, (band, row, column), and the scores of the water of blocks of a scene."""
        values = np.concatenate([np.asarray(n, np.float64)[:, w] for n, w in zip(nir, water, strict=True)], axis=1)
        values = np.nan_to_num(values)
        centre = np.median(values, axis=1)
        spread = 1.4826 * np.median(np.abs(values - centre[:, None]), axis=1)
        spread = np.where(spread > 0, spread, 1.0)
        flat = cls(centre, spread, side, np.zeros(1), np.ones(1))
        glint = np.concatenate([flat.nearby(n)[w] for n, w in zip(nir, water, strict=True)])
        scored = np.concatenate([s[w] for s, w in zip(scores, water, strict=True)])
        edges = np.unique(np.quantile(glint, np.linspace(0, 1, _CLASSES + 1)))
        usual = float(np.quantile(scored, _USUAL))
        if len(edges) < 3 or not usual > 0:
            return flat
        at = np.clip(np.searchsorted(edges, glint, side="right") - 1, 0, len(edges) - 2)
        order = np.argsort(at, kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(at, minlength=len(edges) - 1))[:-1])
        found = [(np.median(glint[p]), np.quantile(scored[p], _USUAL) / usual) for p in parts if len(p)]
        middle, factor = np.array(found, np.float64).T
        factor = np.maximum.accumulate(np.maximum(factor, 1e-3))
        return cls(
            centre, spread, side, middle, np.minimum(factor, factor[int(_LAST_FACTOR * (len(factor) - 1) + 0.5)])
        )

    def nearby(self, nir: Array) -> Float32:
        """Local maximum of the NIR [standard deviation], averaged over the window of the scores; (row, column)."""
        import cv2

        shape = (-1, 1, 1)
        standard = (np.nan_to_num(np.asarray(nir, np.float32)) - self.centre.reshape(shape)) / self.spread.reshape(
            shape
        )
        highest = cv2.dilate(standard.max(axis=0).astype(np.float32), np.ones((_REACH, _REACH), np.uint8))
        return np.asarray(cv2.blur(highest, (self.side, self.side)))

    def even(self, scores: Array, nir: Array) -> Float32:
        """Scores divided by the usual score of water with the same NIR; (row, column)."""
        return np.asarray(scores / np.interp(self.nearby(nir), self.glint, self.factor), np.float32)
