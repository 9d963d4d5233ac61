"""Apply kernels: predict the glint in a band from a neighbourhood of the references.

The result does not depend on tiles, to the bit: OpenCV's filters process the last columns of an image by other
instructions, so columns are added that are removed afterwards. Arrays only.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..moments import Mask
from ..scene import FloatArray
from .kernels import KERNEL_REACH
from .model import GlintIndex, GlintModel
from .reference import clean

SPARE = 16
"""Columns that are added: at least as many as OpenCV's filters process at a time."""


def bordered(values: FloatArray) -> FloatArray:
    """A reference with the border that `predicted` needs: mirrored at its edges, and with spare columns."""
    import cv2

    wide = cv2.copyMakeBorder(
        values, KERNEL_REACH, KERNEL_REACH, KERNEL_REACH, KERNEL_REACH + SPARE, cv2.BORDER_REFLECT_101
    )
    return np.asarray(wide, values.dtype)


def predicted(
    references: Mapping[int, FloatArray], model: GlintModel, k: int, origin: tuple[int, int] = (0, 0)
) -> FloatArray:
    """Prediction of index `k` of a model, (row, column); two kinds of strips are blended at their seams.

    references : by 0-based band, (row, column), finite, from `bordered`
    origin : row and column in the scene of the first pixel
    """
    first = _filtered(references, model.indexes[k])
    if model.strips is None:
        return first
    height, width = first.shape
    share = model.strips.share((origin[0], origin[0] + height), (origin[1], origin[1] + width))
    if not share.any():
        return first
    return first + share.astype(first.dtype) * (_filtered(references, model.second[k]) - first)


def _filtered(references: Mapping[int, FloatArray], index: GlintIndex) -> FloatArray:
    """Weighted sum of the references at the offsets of an index."""
    import cv2

    inner = slice(KERNEL_REACH, -KERNEL_REACH), slice(KERNEL_REACH, -KERNEL_REACH - SPARE)
    total: FloatArray | None = None
    for band in dict.fromkeys(index.bands):
        terms = [(o, w) for b, o, w in zip(index.bands, index.offsets, index.weights, strict=True) if b == band]
        wide = references[band]
        if len(terms) == 1:
            found: FloatArray = wide[inner] * wide.dtype.type(terms[0][1])
        else:
            reach = max(max(abs(row), abs(column)) for (row, column), _ in terms)
            kernel = np.zeros((2 * reach + 1, 2 * reach + 1), wide.dtype)
            for (row, column), weight in terms:
                kernel[row + reach, column + reach] = weight
            found = np.asarray(cv2.filter2D(wide, -1, kernel, borderType=cv2.BORDER_CONSTANT), wide.dtype)[inner]
        total = found if total is None else np.add(total, found, out=total)
    assert total is not None
    return total


def glint(
    block: FloatArray,
    model: GlintModel,
    water: Mask,
    origin: tuple[int, int] = (0, 0),
    crop: tuple[int, int, int, int] = (0, 0, 0, 0),
) -> tuple[dict[int, FloatArray], Mask | None]:
    """Glint in each band that a kernel model corrects.

    block : (band, row, column), physical values, NaN where not valid; a tile needs `model.halo` more pixels around
    water : (row, column), water in the references; other pixels, and NaN, are replaced by the water around
    origin : row and column of the block in the scene, for strips [pixel]
    crop : halo above, below, left and right [pixel]

    Returns the glint by 0-based band, (row, column) without the halo, never negative unless the model is signed, and
    meaningful only over water; and the water where a reference exceeds its surroundings by more than glint does, and is
    replaced by their mean, None if there is none.
    """
    height, width = water.shape
    top, bottom, left, right = (max(side - KERNEL_REACH, 0) for side in crop)  # what the kernels look at stays
    near = slice(top, height - bottom), slice(left, width - right)
    rest = tuple(min(side, KERNEL_REACH) for side in crop)
    inner = slice(rest[0], height - top - bottom - rest[1]), slice(rest[2], width - left - right - rest[3])
    references, exceeds = {}, None
    for rule in model.references:
        values, over = clean(block[rule.band], water, rule)
        references[rule.band] = bordered(values[near])
        if over is not None:
            over = over[near][inner]
            exceeds = over if exceeds is None else exceeds | over
    out = {}
    for fit in model.fits:
        index = model.indexes[fit.index]
        above = predicted(references, model, fit.index, (origin[0] + top, origin[1] + left))[inner]
        above -= above.dtype.type(index.level)
        if not model.signed:
            np.maximum(above, 0, out=above)
        above *= above.dtype.type(fit.slope)
        out[fit.band] = above
    return out, exceeds


def subtract(block: FloatArray, model: GlintModel, where: Mask | None, out: FloatArray) -> FloatArray:
    """`apply` for a kernel model: the whole block at once, subtracted from its copy `out`."""
    water = np.ones(block.shape[1:], np.bool_) if where is None else where
    for band, amount in glint(block, model, water)[0].items():
        np.subtract(out[band], amount, out=out[band], where=water)
    return out
