"""Increase of the scores of water with the glint at a pixel, which the NIR shows, and its correction.

Glint that a removal leaves, and glint that was never removed, is a heavy-tailed noise whose size follows the glint at
the pixel. Divided by it, scores of water are alike everywhere, and an object under water is found where little glint
covers it. What floats is bright in the NIR itself, so that the divisor grows no more above the 90 % quantile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
_CLASSES = 32
"""Classes of the NIR with equal numbers of pixels: each has 3 % of them, and so hundreds even in a small scene."""
_USUAL = 0.75
"""Quantile of the scores that stands for a class: above the median, as objects of less than a quarter do not change."""
_LAST_FACTOR = 0.9
"""Share of the NIR above which the divisor stays: boats and swimmers are as bright there as glint. With 1 no boat of a
simulated sea is found at 1.24 m; with 0.75 two objects less under water."""
_REACH = 3
"""Side of the square whose largest NIR counts [pixel]: waves move between the bands by a pixel or so."""


@dataclass(frozen=True, eq=False)
class GlintScale:
    """Usual scores in each class of the NIR.

    Attributes
    ----------
    centre, spread : (band,) ndarray
        Median and standard deviation (robust) of the NIR over water.
    side : int
        Side of the squares that the scores are means over [pixel].
    glint, factor : (class,) ndarray
        Largest standardised NIR nearby, and the usual score there over the usual score of the scene, not falling.
    """

    centre: npt.NDArray[np.float64]
    spread: npt.NDArray[np.float64]
    side: int
    glint: npt.NDArray[np.float64]
    factor: npt.NDArray[np.float64]

    @classmethod
    def fit(
        cls, nir: Sequence[Array], scores: Sequence[Array], water: Sequence[npt.NDArray[np.bool_]], side: int
    ) -> GlintScale:
        """Learn it from blocks.

        Parameters
        ----------
        nir : sequence of (band, row, column) ndarray
        scores : sequence of (row, column) ndarray
        water : sequence of (row, column) ndarray of bool
            Pixels that teach.
        side : int
            Side of the squares that the scores are means over [pixel].
        """
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

    def nearby(self, nir: Array) -> npt.NDArray[np.float32]:
        """Largest NIR around each pixel, in standard deviations, averaged as the scores are."""
        import cv2

        shape = (-1, 1, 1)
        standard = (np.nan_to_num(np.asarray(nir, np.float32)) - self.centre.reshape(shape)) / self.spread.reshape(
            shape
        )
        highest = cv2.dilate(standard.max(axis=0).astype(np.float32), np.ones((_REACH, _REACH), np.uint8))
        return np.asarray(cv2.blur(highest, (self.side, self.side)))

    def even(self, scores: Array, nir: Array) -> npt.NDArray[np.float32]:
        """Scores over what is usual at such a NIR."""
        return np.asarray(scores / np.interp(self.nearby(nir), self.glint, self.factor), np.float32)
