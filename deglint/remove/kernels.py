"""Kernels of bands on the neighbourhoods of references: how wide they are, and how sure their responses are.

Squares of the sample are left out in groups: what a kernel leaves in squares that it was not fitted to tells which
support is worth its width, and how responses scatter without each group is their jackknife covariance. Arrays only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import FitError
from .lags import LagGrams, solve, unexplained

Float64 = npt.NDArray[np.float64]

SUPPORTS = ((1,), (3,), (3, 1), (3, 3), (5,), (5, 3))
"""Sides of the kernels on the first and on the second reference, plainest first [pixel]."""
WITH_SWIR = ((1, 1), (3, 1), (3, 3), (5, 3))
"""The same where the second reference is SWIR. It is always used: it tells glint from turbid water, which only the NIR
shows, and that does not show in the noise by which supports are compared."""
WORTH = 0.01
"""Relative noise that a wider kernel, a second reference, or any removal at all must save."""
FOLDS = 16
"""Groups of squares that are left out in turn: an error estimated from 16 is itself known to 18 %."""


@dataclass(frozen=True)
class BandSet:
    """Bands that follow the same references; `bands` are places among the request's bands to correct."""

    references: tuple[int, ...]
    bands: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class KernelFit:
    """Kernels of one set: coefficients (variable, band), responses to even glint, all and without each group."""

    band_set: BandSet
    support: tuple[int, ...]
    coefficients: Float64
    response: Float64
    left_out: Float64
    loss: Float64
    pixels: int


def fit_kernels(band_set: BandSet, grams: LagGrams, supports: Sequence[tuple[int, ...]]) -> list[KernelFit]:
    """The kernels of a set of bands, for each support that suits some of them best."""
    outputs = [grams.band(i) for i in range(len(band_set.bands))]
    count = min(FOLDS, len(grams.grams))
    groups = [grams.grams[i * len(grams.grams) // count : (i + 1) * len(grams.grams) // count].sum(axis=0)
              for i in range(count)]  # fmt: skip
    total = np.sum(groups, axis=0)
    usable = [s for s in supports if len(s) <= grams.references and total[grams.centre(len(s) - 1)].any()]
    if not usable or not np.isfinite(total).all():
        raise FitError(
            "the NIR does not vary over the sample, or its squares are beyond double precision, so no kernel can be "
            "fitted. Choose another --nir, or a --sample where glint varies."
        )
    losses = {s: _held_out(groups, total, _inputs(grams, s), outputs) for s in usable}
    chosen = _supports(losses)
    out = []
    for support in dict.fromkeys(chosen):
        mine = [k for k, s in enumerate(chosen) if s == support]
        wanted = [outputs[k] for k in mine]
        left_out = [_response(grams, total - g, support, wanted) for g in groups] if count > 1 else []
        out.append(
            KernelFit(
                BandSet(band_set.references, tuple(band_set.bands[k] for k in mine)),
                support,
                solve(total, _inputs(grams, support), wanted),
                _response(grams, total, support, wanted),
                np.array(left_out),
                losses[support].sum(axis=0)[mine],
                int(grams.pixels.sum()),
            )
        )
    return out


def _inputs(grams: LagGrams, support: tuple[int, ...]) -> list[int]:
    return [c for reference, side in enumerate(support) for c in grams.columns(reference, side)]


def _held_out(groups: Sequence[Float64], total: Float64, inputs: list[int], outputs: list[int]) -> Float64:
    """Power (group, band) that a fit to the other groups leaves in each, over the power of the band in all."""
    power = np.maximum(total[outputs, outputs], np.finfo(float).tiny)
    alone = len(groups) == 1
    left = [unexplained(g, inputs, outputs, solve(total if alone else total - g, inputs, outputs)) for g in groups]
    return np.array(left) / power


def _supports(losses: dict[tuple[int, ...], Float64]) -> list[tuple[int, ...]]:
    """The support of each band: that which suits all of them, but where a band clearly wants another.

    losses : of each support, the relative power that it leaves, (group, band)
    """
    power = {s: np.maximum(loss.sum(axis=0), 1e-12) for s, loss in losses.items()}
    least = np.min(list(power.values()), axis=0)
    common = _within_chance({s: (loss / least).mean(axis=1) for s, loss in losses.items()})[0]
    out = []
    for k in range(len(least)):
        own = _within_chance({s: loss[:, k] / least[k] for s, loss in losses.items()})
        out.append(common if common in own else own[0])
    return out


def _within_chance(losses: dict[tuple[int, ...], Float64]) -> list[tuple[int, ...]]:
    """The supports, plainest first, that leave at most `WORTH` more noise than the best, or not more beyond chance.

    losses : of each support, the power that it leaves in each group
    """
    least = min(losses, key=lambda s: float(losses[s].sum()))
    best, out = losses[least], []
    for support, loss in losses.items():
        excess = (loss - best) / max(best.sum(), np.finfo(float).tiny)  # 0 where a band is constant
        chance = np.sqrt(len(excess)) * excess.std(ddof=1) if len(excess) > 1 else np.inf
        if excess.sum() <= max(2 * WORTH, chance):
            out.append(support)
    return out or [least]  # losses that are not finite


def _response(grams: LagGrams, gram: Float64, support: tuple[int, ...], outputs: list[int]) -> Float64:
    """How each band follows a rise of 1 in its NIR everywhere; the second reference rises as it follows the first."""
    inputs = _inputs(grams, support)
    coefficients = solve(gram, inputs, outputs)
    first = grams.columns(0, support[0])
    out, start = np.zeros(len(outputs)), 0
    for reference, side in enumerate(support):
        rise = 1.0 if reference == 0 else float(solve(gram, first, [grams.centre(reference)]).sum())
        out += rise * coefficients[start : start + side * side].sum(axis=0)
        start += side * side
    return out


def joined(found: Sequence[KernelFit], bands: int) -> tuple[Float64, Float64]:
    """Responses of all bands, the mean over strips, and their covariance by the jackknife over groups."""
    share = np.zeros(bands)
    for f in found:
        share[list(f.band_set.bands)] += f.pixels
    groups = min((len(f.left_out) for f in found), default=0)
    response, left_out = np.zeros(bands), np.zeros((groups, bands))
    for f in found:
        mine = list(f.band_set.bands)
        response[mine] += f.response * f.pixels / share[mine]
        if groups:
            left_out[:, mine] += f.left_out[:groups] * f.pixels / share[mine]
    if groups < 2:
        return response, np.diag(response**2)
    away = left_out - left_out.mean(axis=0)
    return response, (groups - 1) / groups * away.T @ away
