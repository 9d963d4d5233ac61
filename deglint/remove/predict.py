"""Apply a model: predict the glint in each band, pixel by pixel or from a neighbourhood, and subtract it.

The result is the same to the bit for any division into tiles. As the filters of OpenCV process the last columns of an
image with other processor instructions, spare columns are added first and removed afterwards.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import cv2
import numpy as np

from ..checks import check_kind
from ..errors import InputError
from ..moments import Crop, Mask
from ..scene import FloatArray
from .kernels import KERNEL_REACH
from .model import GlintIndex, GlintModel
from .reference import clean

_SLAB = 1 << 16  # pixels corrected at a time, so that intermediate results fit into the processor's cache
SPARE = 16  # columns that are added: at least as many as OpenCV's filters process at a time


def predictions(
    references: Mapping[int, FloatArray], model: GlintModel, origin: tuple[int, int] = (0, 0)
) -> Iterator[FloatArray]:
    """Yield, for each band that a kernel model corrects, its glint index, (row, column) [unit of the index].

    references : finite values, (row, column), of each reference, by its 0-based band; they are mirrored at the edges
    origin : row and column in the scene of the first pixel [pixel]

    If the model has kernels for two kinds of detector strips, the predictions are blended where the strips meet.
    """
    sides = KERNEL_REACH, KERNEL_REACH, KERNEL_REACH, KERNEL_REACH + SPARE
    wide = {r: cv2.copyMakeBorder(values, *sides, cv2.BORDER_REFLECT_101) for r, values in references.items()}
    for fit in model.fits:
        found = _filtered(wide, model.indexes[fit.index])
        if model.strips is not None:
            spans = ((first, first + length) for first, length in zip(origin, found.shape, strict=True))
            share = model.strips.share(*spans).astype(found.dtype)
            if share.any():
                found += share * (_filtered(wide, model.second[fit.index]) - found)
        yield found


def _filtered(wide: Mapping[int, Any], index: GlintIndex) -> FloatArray:
    """Sum of the references `wide` (by 0-based band), filtered by the kernels of an index; the border is cut off."""
    inner = slice(KERNEL_REACH, -KERNEL_REACH), slice(KERNEL_REACH, -KERNEL_REACH - SPARE)
    parts: list[Any] = []
    for band in dict.fromkeys(index.bands):
        terms = [(o, w) for b, o, w in zip(index.bands, index.offsets, index.weights, strict=True) if b == band]
        reach = max(abs(step) for offset, _ in terms for step in offset)
        kernel = np.zeros((2 * reach + 1, 2 * reach + 1), wide[band].dtype)
        for (row, column), weight in terms:
            kernel[row + reach, column + reach] = weight
        parts.append(cv2.filter2D(wide[band], -1, kernel, borderType=cv2.BORDER_CONSTANT)[inner])
    return np.asarray(sum(parts[1:], parts[0]))


def glint(
    block: FloatArray, model: GlintModel, water: Mask, origin: tuple[int, int] = (0, 0), crop: Crop = (0, 0, 0, 0)
) -> tuple[dict[int, FloatArray], Mask | None]:
    """Predict the glint in each band that a kernel model corrects.

    block : (band, row, column), physical values, NaN where not valid; a tile needs a halo of `model.halo` pixels
    water : (row, column), True over water; in references, other pixels and NaN are replaced by the mean of water around
    origin : row and column in the scene of the first pixel of the block [pixel]; used if there are detector strips
    crop : width of the halo above, below, left and right of the tile [pixel]

    Returns the glint (row, column) by 0-based band, without the halo [unit of the band]. It is valid only over water,
    limited by `BandFit.floor`, and never negative unless the model is signed. Also returns a mask of the same shape:
    True where `clean` found water too bright for glint, and at the pixels beside it; None if no water is so bright.
    """
    height, width = water.shape
    inner = slice(crop[0], height - crop[1]), slice(crop[2], width - crop[3])
    # the kernels need less of the halo than the rules of the references
    near = tuple(slice(max(s.start - KERNEL_REACH, 0), s.stop + KERNEL_REACH) for s in inner)
    rest = tuple(slice(s.start - n.start, s.stop - n.start) for s, n in zip(inner, near, strict=True))
    places = origin[0] + near[0].start, origin[1] + near[1].start
    references, exceeds = {}, None
    for rule in model.references:
        cleaned, over = clean(block[rule.band], water, rule)
        references[rule.band] = cleaned[near]
        if over is not None:
            exceeds = over[inner] if exceeds is None else exceeds | over[inner]
    out = {}
    for fit, found in zip(model.fits, predictions(references, model, places), strict=True):
        above = found[rest]
        above -= above.dtype.type(model.indexes[fit.index].level)
        above *= above.dtype.type(fit.slope)
        if fit.floor is not None:
            room = block[fit.band][inner] - above.dtype.type(fit.floor)
            np.minimum(above, np.maximum(room, 0, out=room) if model.signed else room, out=above)
        if not model.signed:
            np.maximum(above, 0, out=above)
        out[fit.band] = above
    return out, exceeds


def _check_block(block: FloatArray, model: GlintModel) -> None:
    """Raise InputError if `block` is no float array with the model's bands, or if `model` is no GlintModel."""
    check_kind(block, np.ndarray, "block", "Read a scene with scene.read(), or give it to deglint.correct.")
    check_kind(model, GlintModel, "model", "Make one with deglint.fit; deglint.correct takes what fit_scene gives.")
    if block.ndim != 3 or len(block) != len(model.band_names):
        raise InputError(
            f"the model is for {len(model.band_names)} bands ({', '.join(model.band_names)}), "
            f"but the array has shape {block.shape}; expected (band, row, column)."
        )
    if block.dtype not in (np.float32, np.float64):
        raise InputError(f"expected float32 or float64 physical values, got {block.dtype}; convert first.")


def apply(
    block: FloatArray, model: GlintModel, *, where: Mask | None = None, out: FloatArray | None = None
) -> FloatArray:
    """Subtract the glint that a model predicts in a block.

    Parameters
    ----------
    block : (band, row, column) float32 or float64 ndarray
        Physical values, NaN or masked where not valid. With `model.strips`, it must begin at the scene's first pixel.
    model : GlintModel
    where : (row, column) bool ndarray, optional
        True where pixels are corrected (default: all); others are copied. Kernels also take it as mask of water.
    out : ndarray like block, optional
        Array for the result, a new one by default. It may be `block` itself; otherwise `block` is not modified.

    Returns
    -------
    (band, row, column) ndarray
        Same dtype as the block. NaN stays NaN. Without kernels, a NaN in a glint index makes corrected bands NaN, too.

    Raises
    ------
    InputError
        If the block or mask does not have the bands, shape or type that the model needs, or `model` is no GlintModel.

    Examples
    --------
    >>> from deglint.remove import BandFit
    >>> model = GlintModel("hedley", (GlintIndex((1,), (1.0,), 2.0),), (BandFit(0, "B", 0, 0.5),), ("B", "NIR"))
    >>> float(apply(np.array([[[10.0]], [[4.0]]]), model)[0, 0, 0])
    9.0
    """
    _check_block(block, model)
    where = np.ones(block.shape[1:], np.bool_) if where is None else np.asarray(where, np.bool_)
    if where.shape != block.shape[1:]:
        raise InputError(f"where has shape {where.shape}, but the block has {block.shape[1:]} pixels.")
    block = np.ma.filled(block, np.nan)
    if out is None:
        out = block.copy()
    elif out is not block:
        np.copyto(out, block)
    if model.halo:  # kernels take the whole block at once
        for band, amount in glint(block, model, where)[0].items():
            np.subtract(out[band], amount, out=out[band], where=where)
        return out
    rows = max(1, _SLAB // max(block.shape[2], 1))
    for top in range(0, block.shape[1], rows):  # a few rows in float64, rounded once
        part = slice(top, top + rows)
        above = [index.of(block[:, part]) - index.level for index in model.indexes]
        if not where[part].all():
            for index in above:
                index[~where[part]] = 0.0  # x - slope * 0 is x to the bit, NaN and all
        for fit in model.fits:
            np.subtract(out[fit.band, part], above[fit.index] * fit.slope, out=out[fit.band, part], casting="same_kind")
    return out
