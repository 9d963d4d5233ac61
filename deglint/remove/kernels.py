r"""Kernels that predict bands from the neighbourhoods of pixels in references: fit, choice of width, uncertainty.

.. math:: k = (G_{rr} + \lambda I)^{-1} G_{rb}, \qquad G = \sum_x v(x) v(x)^T

The vector v(x) of pixel x has the references (r) at every offset in a window of up to `SIDE` pixels, then the bands
(b), all minus their means; G_rr and G_rb are parts of G, lambda is a small ridge. There is one Gram matrix G for each
square of `CELL` x `CELL` pixels of the sample; a fit uses the sum of these matrices. The response of a kernel is the
change of the band if the NIR rises by 1: the sum of its coefficients, where coefficients on another reference are
multiplied by the slope of this reference on the NIR. The support of a kernel is the side of its window on each
reference. The fit is repeated without each group of squares in turn: the residuals in the group that is left out
select the support (cross-validation), and the scatter of the responses gives their covariance (jackknife).
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise, product
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from ..errors import FitError
from ..moments import CELL, Float64, Mask
from ..morphology import eroded, squares
from ..scene import FloatArray
from .reference import LEAST_OPEN

SIDE = 5  # side of the largest kernel [pixel]; kernels of 7 pixels were no better on any scene
KERNEL_REACH = SIDE // 2  # pixels on each side that the largest kernel needs [pixel]
KERNEL_RIDGE = 1e-6  # ridge for singular matrices, relative to the mean of the diagonal; 1e-2 gives the same results
SUPPORTS = ((1,), (3,), (3, 1), (3, 3), (5,), (5, 3))  # sides of kernels on first and second reference [pixel]
WITH_SWIR = ((1, 1), (3, 1), (3, 3), (5, 3))
"""The same if the second reference is SWIR. SWIR is then always used: it distinguishes glint from turbid water, which
is bright in the NIR, and the residuals by which supports are compared do not show this advantage."""
WORTH, WORTH_WIDER = 0.01, 0.002
"""Least relative reduction of RMS residuals for which a removal is made (`WORTH`), and for which a wider kernel or a
second reference is used (`WORTH_WIDER`)."""
FOLDS = 16  # groups of squares that are left out in turn: an error estimated from 16 groups has an uncertainty of 18 %


def offsets(side: int) -> tuple[tuple[int, int], ...]:
    """Offsets (row, column) of the pixels of a square from its centre; its `side` [pixel] is odd."""
    span = range(-(side // 2), side // 2 + 1)
    return tuple(product(span, span))


class LagGrams(NamedTuple):
    """Gram matrices of a sample: for each square, the sums over its pixels of the products of all pairs of variables.
    The variables are each reference at each offset in a square window (`sides`), then each band to predict.
    """

    grams: Float64  # (square, variable, variable), with the mean of the square subtracted
    pixels: npt.NDArray[np.int64]  # (square,): number of pixels in the sums
    places: npt.NDArray[np.int64]  # (square, 2): row and column in the scene of the first pixel of the square
    sides: tuple[int, ...]  # side of the window on each reference [pixel]

    def some(self, chosen: Mask) -> Self:
        """The Gram matrices of those squares of the sample for which the mask `chosen` (square,) is True."""
        return self._replace(grams=self.grams[chosen], pixels=self.pixels[chosen], places=self.places[chosen])

    def columns(self, reference: int, side: int) -> list[int]:
        """Indices of the rows of a Gram matrix for a kernel of this `side` [pixel] on a `reference` (0: the first)."""
        inside, first = set(offsets(side)), sum(s * s for s in self.sides[:reference])
        return [first + i for i, offset in enumerate(offsets(self.sides[reference])) if offset in inside]

    @property
    def outputs(self) -> list[int]:
        """Indices of the rows of a Gram matrix that belong to the bands to predict."""
        return list(range(sum(s * s for s in self.sides), self.grams.shape[1]))

    def inputs(self, support: tuple[int, ...]) -> list[int]:
        """Indices of the rows of a Gram matrix for kernels whose sides on the references are `support` [pixel]."""
        return [c for reference, side in enumerate(support) for c in self.columns(reference, side)]


def kernel_squares(sample: Mask) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """Yield (row, column) slices of each square of `CELL` x `CELL` pixels that has enough pixels for a fit, and a mask
    of these pixels in the square. They are the pixels around which the largest kernel (`SIDE`) reads only the `sample`.
    """
    inner = eroded(sample, SIDE)
    return ((s, inner[s]) for s in squares(sample.shape, CELL) if inner[s].sum() >= LEAST_OPEN * CELL**2)


def gather(
    references: Sequence[FloatArray],
    bands: Sequence[FloatArray],
    sample: Mask,
    *,
    sides: Sequence[int],
    origin: tuple[int, int] = (0, 0),
    weight: FloatArray | None = None,
) -> LagGrams:
    """Compute the Gram matrix of each square of `CELL` x `CELL` pixels of a tile, with the variables of `LagGrams`.

    references, bands : arrays (row, column) of the tile, one for each reference and band to predict
    sample : (row, column), True where pixels can be used for fitting; references and bands are finite there. Only the
        pixels of `kernel_squares` count
    sides : side of the largest kernel to be fitted to each reference, odd, at most `SIDE` [pixel]
    origin : row and column in the scene of the first pixel of the tile [pixel]
    weight : (row, column) weight of each pixel in the sums; 1 by default
    """
    values = np.stack([*references, *bands]).astype(np.float64)
    values[:, ~sample] = 0.0
    (height, width), reach = sample.shape, (KERNEL_REACH, KERNEL_REACH)
    padded = np.pad(values[: len(references)], ((0, 0), reach, reach))
    shifted = [
        plane[KERNEL_REACH + row :, KERNEL_REACH + column :][:height, :width]
        for plane, side in zip(padded, sides, strict=True)
        for row, column in offsets(side)
    ]
    grams, pixels, places = [], [], []
    for cell, mask in kernel_squares(sample):
        variables = np.stack([v[cell] for v in (*shifted, *values[len(references) :])]).reshape(-1, mask.size)
        weights = np.where(mask, 1.0 if weight is None else weight[cell].astype(np.float64), 0.0)
        grams.append(_gram(variables, weights.ravel()))
        pixels.append(int(mask.sum()))
        places.append((origin[0] + cell[0].start, origin[1] + cell[1].start))
    count = len(shifted) + len(bands)
    return LagGrams(
        np.array(grams).reshape(-1, count, count),
        np.array(pixels, np.int64),
        np.array(places, np.int64).reshape(-1, 2),
        tuple(sides),
    )


def _gram(variables: Float64, weight: Float64) -> Float64:
    """Weighted Gram matrix of variables (variable, pixel) minus their means; `weight` is (pixel,)."""
    centred = variables - (variables @ weight / weight.sum())[:, None]
    centred *= np.sqrt(weight)
    return np.asarray(centred @ centred.T)


def merge(parts: Sequence[LagGrams]) -> LagGrams:
    """Join the Gram matrices of several tiles into one `LagGrams`, in the order of the tiles."""
    grams, pixels, places, sides = zip(*parts, strict=True)
    return LagGrams(np.concatenate(grams), np.concatenate(pixels), np.concatenate(places), sides[0])


def solve(gram: Float64, inputs: Sequence[int], outputs: Sequence[int]) -> Float64:
    """Coefficients (input, output) of a ridge regression; `inputs` and `outputs` are indices of rows of `gram`."""
    power, cross = gram[np.ix_(inputs, inputs)], gram[np.ix_(inputs, outputs)]
    if len(inputs) == 1:
        return np.asarray(cross / power, np.float64) if power[0, 0] > 0 else np.zeros_like(cross)
    ridge = KERNEL_RIDGE * np.trace(power) / len(power) or 1.0
    return np.asarray(np.linalg.solve(power + ridge * np.eye(len(power)), cross), np.float64)


def unexplained(gram: Float64, inputs: Sequence[int], outputs: Sequence[int], coefficients: Float64) -> Float64:
    """Residual sums of squares (..., output) for `coefficients` from `solve`; `gram` is one Gram matrix or several."""
    rows = gram[..., inputs, :]
    power, cross = rows[..., inputs], rows[..., outputs]
    rest = gram[..., outputs, outputs] - 2 * (coefficients * cross).sum(axis=-2)
    return np.asarray(rest + (coefficients * (power @ coefficients)).sum(axis=-2))


class BandSet(NamedTuple):
    """Bands to correct that are predicted from the same references."""

    references: tuple[int, ...]  # 0-based bands of the scene
    bands: tuple[int, ...]  # positions in `FitRequest.correct`
    supports: tuple[tuple[int, ...], ...]  # to choose from, smallest first: sides of kernels [pixel]


class KernelFit(NamedTuple):
    """Fitted kernels of bands that have the same references, and the same side of the kernel on each reference."""

    references: tuple[int, ...]  # as in `BandSet`
    bands: list[int]  # as in `BandSet`
    support: tuple[int, ...]  # side of the kernel on each reference [pixel]
    coefficients: Float64  # (variable, band): weight of each reference at each offset
    response: Float64  # (band,): change of a band if its NIR rises by 1 everywhere
    left_out: Float64  # (group, band): the response fitted without each group of squares; empty for a single group
    loss: Float64  # (band,): residual power in squares left out of the fit, over the power of the band in all squares
    pixels: int  # pixels of the fit


def fit_kernels(band_set: BandSet, grams: LagGrams) -> list[KernelFit]:
    """Select the support of each band (side of its kernel on each reference), and fit kernels; one result per support.

    Raises FitError if the first reference (the NIR) does not vary, or if sums of squares exceed double precision.
    """
    outputs, count = grams.outputs, min(FOLDS, len(grams.grams))
    groups = [grams.grams[a:b].sum(axis=0) for a, b in pairwise(np.arange(count + 1) * len(grams.grams) // count)]
    total = np.sum(groups, axis=0)
    varied = [total[grams.columns(k, 1)].any() for k in range(len(grams.sides))]
    usable = dict.fromkeys(s if varied[len(s) - 1] else s[:1] for s in band_set.supports if len(s) <= len(varied))
    if not varied[0] or not np.isfinite(total).all():
        raise FitError(
            "the NIR does not vary over the sample, or its squares are beyond double precision, so no kernel can be "
            "fitted. Choose another --nir, or a --sample where glint varies."
        )
    losses = {s: _held_out(groups, total, grams.inputs(s), outputs) for s in usable}
    chosen, out = _chosen_supports(losses), []
    for support in dict.fromkeys(chosen):
        mine = [k for k, s in enumerate(chosen) if s == support]
        wanted = [outputs[k] for k in mine]
        left_out = [_response(grams, total - g, support, wanted) for g in groups] if count > 1 else []
        own, loss = [band_set.bands[k] for k in mine], losses[support].sum(axis=0)[mine]
        kernels, response = solve(total, grams.inputs(support), wanted), _response(grams, total, support, wanted)
        pixels = int(grams.pixels.sum())
        out.append(KernelFit(band_set.references, own, support, kernels, response, np.array(left_out), loss, pixels))
    return out


def _held_out(groups: Sequence[Float64], total: Float64, inputs: list[int], outputs: list[int]) -> Float64:
    """Residual power in each group of squares after a fit to the other groups, (group, band). It is divided by the
    band's power in all groups. With one group, the fit is to this group. For a constant band the sum over groups is 1.
    """
    power, alone = total[outputs, outputs], len(groups) == 1
    left = [unexplained(g, inputs, outputs, solve(total if alone else total - g, inputs, outputs)) for g in groups]
    shares = np.array(left) / np.maximum(power, np.finfo(float).tiny)
    return np.where(power > 0, shares, 1 / len(groups))  # a constant band has no noise that a kernel could remove


def _chosen_supports(losses: dict[tuple[int, ...], Float64]) -> list[tuple[int, ...]]:
    """Support of each band: the smallest one that `_within_chance` accepts for the mean over bands. A band for which
    this is not accepted gets the smallest support accepted for it. `losses`: `_held_out` by support, smallest first.
    """
    power = {s: np.maximum(loss.sum(axis=0), 1e-12) for s, loss in losses.items()}
    least = np.min(list(power.values()), axis=0)
    common = _within_chance({s: (loss / least).mean(axis=1) for s, loss in losses.items()})[0]
    own = [_within_chance({s: loss[:, k] / at for s, loss in losses.items()}) for k, at in enumerate(least)]
    return [common if common in some else some[0] for some in own]


def _within_chance(losses: dict[tuple[int, ...], Float64]) -> list[tuple[int, ...]]:
    """Supports whose RMS residual exceeds the least one by at most `WORTH_WIDER`, or by at most one standard error.
    `losses` is the residual power in each group, (group,), by support. It and the result have small supports first.
    """
    least = min(losses, key=lambda s: float(losses[s].sum()))
    best, out = losses[least], []
    for support, loss in losses.items():
        excess = (loss - best) / max(best.sum(), np.finfo(float).tiny)  # 0 where a band is constant
        chance = np.sqrt(len(excess)) * excess.std(ddof=1) if len(excess) > 1 else np.inf
        if excess.sum() <= max(2 * WORTH_WIDER, chance):
            out.append(support)
    return out or [least]  # losses that are not finite


def _response(grams: LagGrams, gram: Float64, support: tuple[int, ...], outputs: list[int]) -> Float64:
    """Response (output,) of kernels of sides `support`, fitted to `gram`, a Gram matrix with rows as in `grams`."""
    coefficients = solve(gram, grams.inputs(support), outputs)
    first = grams.columns(0, support[0])
    out, start = np.zeros(len(outputs)), 0
    for reference, side in enumerate(support):
        rise = 1.0 if reference == 0 else float(solve(gram, first, grams.columns(reference, 1)).sum())
        out += rise * coefficients[start : start + side * side].sum(axis=0)
        start += side * side
    return out


def joined(found: Sequence[KernelFit], bands: int) -> tuple[Float64, Float64, Float64]:
    r"""Join the fits `found` of `bands` bands: responses s (band,), their covariance V (band, band), losses (band,).

    .. math:: V = \frac{G - 1}{G} \sum_g (s_{-g} - \bar s)(s_{-g} - \bar s)^T

    with s_{-g} the responses fitted without group g of the G groups of squares (jackknife). If a band is in several
    fits (one for each kind of strip), s and loss (`KernelFit.loss`) are means over these fits, weighted by pixels. With
    fewer than two groups, the standard error of a response is the response itself.
    """
    share = np.sum([f.pixels * np.bincount(f.bands, minlength=bands) for f in found], axis=0)
    groups = min((len(f.left_out) for f in found), default=0)
    response, loss, left_out = np.zeros(bands), np.zeros(bands), np.zeros((groups, bands))
    for f in found:
        response[f.bands] += f.response * f.pixels / share[f.bands]
        loss[f.bands] += f.loss * f.pixels / share[f.bands]
        if groups:
            left_out[:, f.bands] += f.left_out[:groups] * f.pixels / share[f.bands]
    if groups < 2:
        return response, np.diag(response**2), loss
    away = left_out - left_out.mean(axis=0)
    return response, (groups - 1) / groups * away.T @ away, loss
