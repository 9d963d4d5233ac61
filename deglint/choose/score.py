r"""Expected error of a recipe, from what it leaves in sample tiles and what it makes of implanted signals.

At each scale s the result of recipe c has the power

.. math:: P_{cs} = g_{cs}^2 S_s + N_{cs}

with S the power of the scene's own signal, the same for all recipes, g the gain of a signal at that scale, and N what
is left of glint and noise. The error, against the scene without glint and noise, is then

.. math:: E_{cs} = (1 - g_{cs})^2 S_s + N_{cs} = P_{cs} + (1 - 2 g_{cs}) S_s .

S is not known, but no larger than :math:`P_{cs} / g_{cs}^2` of any recipe. The least of these is taken over all pixels,
and over those with the least glint, where recipes leave less of it. The first includes what all recipes leave of glint;
the second misses shallow bottoms, which the NIR sees as glint. S is their geometric mean. Recipes that erase signals
have a small P, and a small g too, and gain nothing by it. Tiles are few: what signals they may lack counts with a least
power, and objects as if they had a usual contrast and covered a hundredth of the scene.

At the coarsest scale only the loss :math:`(1 - g)^2 S` counts: what is left of glint there is its level, which all
pixels share, and which no texture tells.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .implants import BRIGHT, PLUME, SCALES, Float32, Mask

Float64 = npt.NDArray[np.float64]

SHARE = 0.01
"""Part of a scene that objects and plumes are taken to cover each."""
SIGNAL = 0.05
"""Signal that a scene is taken to hold at every scale beside what the tiles show, relative to the water: the least that
an analyst sees in an image without glint. Tiles are few, and what is looked for is rare."""
ZERO_GAIN = 0.05
"""A gain below this is 0, within the error of its estimate from some tiles."""
HALF = 0.5
"""The same for plumes: there is one in a tile."""
LEAST_GLINT_PERCENT = 10.0
"""Percent of the pixels that have the least glint: few, so that it is little, and ten thousand in eight tiles of
each band, so that the power of their texture is known to a few percent [%]."""


def powers(images: Sequence[Float32], inside: Sequence[Mask], unit: Float32, clear: Sequence[Mask] = ()) -> Float64:
    """Mean square of the texture at each scale: between the scales, and what is coarser than the last, about the mean.

    unit : (band,) by which bands are divided; infinite for those that do not count
    clear : (band, scale, row, column) of each image, the pixels that count, from `least_glint`; none, all inside
    """
    import cv2

    total, pixels = np.zeros(len(SCALES)), np.zeros(len(SCALES))
    for n, (image, mask) in enumerate(zip(images, inside, strict=True)):
        shares = _shares(mask)
        for b in np.flatnonzero(np.isfinite(unit)):
            finer = values = np.where(mask, image[b] / unit[b], np.float32(0))
            for i, (side, share) in enumerate(zip(SCALES[1:], shares, strict=True)):
                coarser = cv2.blur(values, (side, side)) / share  # means of the mask's pixels alone
                counted = clear[n][b, i] if clear else mask
                total[i] += float(np.square((finer - coarser)[counted], dtype=np.float64).sum())
                pixels[i] += int(counted.sum())
                finer = coarser
            rest = finer[mask]
            total[-1] += float(np.square(rest - rest.mean(), dtype=np.float64).sum()) if rest.size else 0.0
            pixels[-1] += rest.size
    return np.asarray(total / np.maximum(pixels, 1))


def least_glint(glint: Sequence[Float32], inside: Sequence[Mask]) -> list[Mask]:
    """Pixels with the least glint around them, for each band and scale but the coarsest: (band, scale, row, column)."""
    import cv2

    out = []
    for planes, mask in zip(glint, inside, strict=True):
        clear = np.zeros((len(planes), len(SCALES) - 1, *mask.shape), np.bool_)
        for b, plane in enumerate(planes):
            for i, (side, share) in enumerate(zip(SCALES[1:], _shares(mask), strict=True)):
                around = cv2.blur(np.where(mask, plane, np.float32(0)), (side, side)) / share
                if mask.any():
                    clear[b, i] = mask & (around <= np.percentile(around[mask], LEAST_GLINT_PERCENT))
        out.append(clear)
    return out


def _shares(mask: Mask) -> list[Float32]:
    """Share of a mask around each pixel, at each scale but the finest; positive."""
    import cv2

    known = mask.astype(np.float32)
    return [np.maximum(cv2.blur(known, (side, side)), np.float32(1e-6)) for side in SCALES[1:]]


def expected_errors(power: Float64, clear: Float64, gain: Float64, objects: Float64) -> Float64:
    """Expected error of each recipe, relative to the water.

    Parameters
    ----------
    power, clear, gain : (recipe, scale) ndarray
        From `powers`, over all pixels and over those with the least glint; and of the textures and, for the coarsest
        scale, of plumes.
    objects : (recipe,) ndarray
        Gain of discs.
    """
    kept = np.clip(gain, [ZERO_GAIN] * (gain.shape[1] - 1) + [HALF], 1) ** 2
    bound, clear_bound = ((p / kept).min(axis=0) for p in (power, clear))
    signal = np.sqrt(bound * np.minimum(bound, clear_bound))
    error = np.maximum(power + (1 - 2 * gain) * signal, 0)[:, :-1].sum(axis=1)
    lost = np.square(1 - gain[:, -1])
    error += lost * (signal[-1] + SHARE * PLUME**2) + SHARE * np.square(BRIGHT * (1 - objects))
    error += SIGNAL**2 * np.square(1 - gain[:, :-1]).sum(axis=1)
    return np.asarray(np.sqrt(error), np.float64)
