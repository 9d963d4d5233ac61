"""How far a deglinted pixel may be from the water's own radiance: its standard error, told by the scene itself.

Two kinds of pixels, and what their errors are made of. A pixel *passed on* by a compensation keeps its own noise: the
variance of clean pixels about the level of the water, as a line in the level. A *replaced* pixel has the error of the
level in its place, which trials tell (`deglint.compensate.trials`): the chain runs once more on a sea that is known,
the level that it found, with what the scene has above and below that level laid on it in other places. How far it
varies there, as a line in how far the level spans around, is how far it varies here, and the water's own variance from
pixel to pixel is added, which trials take for noise. Where half of what was taken was given back
(`deglint.compensate.faint`) half of the square of that is added. What is of one sign is added before it is squared: the
mean error of the trials; that the level lies above the middle of the clean pixels, which is seen in these (those above
the threshold are not among them, and the mean of a normal distribution that is cut off is known); and glint that is
left in both kinds of pixels: where it covers much of the sea the level rises with it, and by how much is seen in the
near infrared, whose water is even. A band that removal corrects keeps of it what the references do not explain. Without
a compensation the error is that of removal: what differs from pixel to pixel in its result, as a line in the square of
what was removed, and the standard error of the slope.

Root mean square errors, bias and all, not halves of an interval: errors are not normal. Assumes dark, even water in the
reference; that things narrower than the element are not there (an opening erases them, and nothing tells); that
errors which all pixels share (calibration, atmosphere, the level of removal) are not asked for.

References
----------
Barr, Sherrill (1999), The American Statistician 53, 357-361, doi:10.1080/00031305.1999.10474490 (mean of a normal
distribution that is cut off); Immerkaer (1996), Computer Vision and Image Understanding 64, 300-302,
doi:10.1006/cviu.1996.0060 (noise from second differences)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import erf, exp, pi, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import FitError, InputError
from ..remove import GlintModel
from ._variances import weighted_line
from .state import Float32Array, Mask
from .trials import Trial, own, shared

REACH = 3
"""Pixels around a pixel in which the level is looked at."""
FEWEST = 256
"""Fewest clean pixels that a variance is taken from."""
GROUPS = 24
"""Groups of pixels of like brightness through whose variances a line is laid."""
LOWEST = 1.0
"""Percentile of the reference's level that counts as water without glint [%]."""
HIGHEST = 99.9
"""Percentile of clean pixels about their level where they are cut off [%]."""
LEFT = 1.05
"""Glint left in a band that is not corrected, relative to what the reference shows."""
LEFT_CORRECTED = 0.25
"""The same in a corrected band, times the root of the share of its variance that the references do not explain."""
FULL_COVER = 0.25
"""Share of glinted pixels from which on what the reference shows above its lowest level is all glint."""
STANDS_OUT = 1.5
"""Below that cover it is noise of the level, save what exceeds its median by this factor."""
OF_WATER = 2.0
"""How many times as far above its median as its lowest percentile is below a level is that of water: bright things sink
in an opening, and what their pixels have in common is no texture of water."""
OF_GIVEN = 0.5
"""Variance of a replaced pixel of which half was given back, relative to the square of that: all of it is wrong where
it was noise, next to none where it was a crest that mirrors the sky."""
OF_RELIEF = 0.025
"""Error of a replaced pixel that a trial does not show, relative to how far the level spans within `REACH`: what an
opening cuts off is not in the level that the trial begins with."""


@dataclass(frozen=True, eq=False)
class Parts:
    """A deglinted block and what it came from, (band, row, column), all bands of the scene.

    Attributes
    ----------
    before, after : float32 ndarray
        Physical values; NaN where not valid.
    where : (row, column) bool ndarray
        Pixels that were to be corrected.
    replaced : bool ndarray, optional
        What a compensation replaced; None where there was none.
    kept : (row, column) bool ndarray, optional
        Things, which were put back.
    level, removed_level : float32 ndarray, optional
        Level of the water before removal, and what removal makes of it, with `REACH` more pixels on every side where
        the scene has them.
    inner : (slice, slice)
        Where the block lies in the levels.
    """

    before: Float32Array
    after: Float32Array
    where: Mask
    replaced: Mask | None = None
    kept: Mask | None = None
    level: Float32Array | None = None
    removed_level: Float32Array | None = None
    inner: tuple[slice, slice] = (slice(None), slice(None))


@dataclass(frozen=True, slots=True)
class BandError:
    """Of one band, in the scene's unit and its square.

    Attributes
    ----------
    band : int
        0-based.
    fixed, growing : float
        Variance of a clean pixel: at 0, and per unit of the level (or of the squared amount, without compensation).
    level : float
        Variance of the level in the place of a replaced pixel.
    relief : float
        Mean square of how far the level spans around a clean pixel.
    edges : float
        Its increase with the square of how far the level spans around.
    high : float
        How far the level in the place of a replaced pixel lies above the water, but for glint that is left.
    left : float
        Glint left, per unit of what the reference shows above its lowest level.
    index : int
        Which of the model's indexes it follows; -1 for none.
    slope_error : float
        Standard error of its slope, relative to the slope.
    """

    band: int
    fixed: float
    growing: float
    level: float = 0.0
    relief: float = 0.0
    edges: float = 0.0
    high: float = 0.0
    left: float = 0.0
    index: int = -1
    slope_error: float = 0.0


@dataclass(frozen=True)
class Uncertainty:
    """What a scene says of the errors of its deglinted bands.

    Attributes
    ----------
    bands : tuple of BandError
    reference : int
        0-based band whose level shows the glint that is left; -1 without compensation.
    lowest : float
        Its level without glint.
    usual : float
        Median of how far its level stands above that.
    share : float
        Part of it that is glint, from 0 to 1.
    """

    bands: tuple[BandError, ...]
    reference: int = -1
    lowest: float = 0.0
    usual: float = 0.0
    share: float = 1.0

    @property
    def halo(self) -> int:
        """Pixels around a tile that `stderr` looks at."""
        return REACH if self.reference >= 0 else 0

    def numbers(self) -> dict[str, Any]:
        """For the sidecar."""
        return asdict(self)


def fit(
    looks: Sequence[Parts],
    model: GlintModel,
    bands: Sequence[int],
    *,
    trials: Sequence[Trial] = (),
    growth: float = 1.0,
    reference: int = -1,
    glint: Mapping[int, float] | None = None,
    cover: float = 1.0,
) -> Uncertainty:
    """Learn from some deglinted tiles how large the errors are.

    Parameters
    ----------
    looks : sequence of Parts
    model : GlintModel
        Of the removal.
    bands : sequence of int
        0-based bands that may have changed.
    trials : sequence of Trial
        On the levels of the looks; needed with compensation.
    growth : float
        By what factor the scene's errors vary more than those of trials (`deglint.compensate.trials.growth`).
    reference : int
        0-based NIR band; needed with compensation.
    glint : mapping of int to float, optional
        Mean brightness of glint in each band, with compensation, as it raises the level there.
    cover : float
        Share of glinted pixels in the reference.

    Raises
    ------
    FitError
        Too few clean pixels.
    InputError
        A compensation without a level, or without a trial.

    Notes
    -----
    The constants of this module were set on simulated seas and checked on others: see docs/uncertainty.md.
    """
    compensated = any(p.replaced is not None for p in looks)
    if compensated and any(p.level is None for p in looks):
        raise InputError("a standard error needs a compensation with replace-level, or none (--compensate off).")
    if compensated and not trials:
        raise InputError("a standard error with a compensation needs a trial of it.")
    fits = {f.band: f for f in model.fits}
    found = []
    for band in bands:
        error = _of_level(looks, trials, band, growth) if compensated else _of_removal(looks, band)
        if band in fits:
            fitted = fits[band]
            relative = float(fitted.stderr or 0.0) / abs(fitted.slope) if fitted.slope else 0.0
            error = replace(error, index=fitted.index, slope_error=relative)
        found.append(error)
    if not compensated:
        return Uncertainty(tuple(found))
    glint = glint or {}
    levels = np.concatenate([_level(p)[reference][p.where] for p in looks])
    lowest, middle = map(float, np.percentile(levels[np.isfinite(levels)], [LOWEST, 50.0]))
    per_unit = 1.0 / max(glint.get(reference, 0.0), float(np.finfo(np.float32).tiny))
    for i, error in enumerate(found):
        share = LEFT if error.index < 0 else LEFT_CORRECTED * (1 - (fits[error.band].r2 or 0.0)) ** 0.5
        found[i] = replace(error, left=share * glint.get(error.band, 0.0) * per_unit)
    return Uncertainty(tuple(found), reference, lowest, middle - lowest, min(1.0, cover / FULL_COVER))


def stderr(parts: Parts, uncertainty: Uncertainty, *, steps: Sequence[float] = ()) -> Float32Array:
    """Standard error of a deglinted block.

    Parameters
    ----------
    parts : Parts
    uncertainty : Uncertainty
    steps : sequence of float, optional
        Of the whole numbers that each of the scene's bands is rounded to [unit of the scene].

    Returns
    -------
    (band, row, column) float32 ndarray
        Of `uncertainty.bands`; NaN where not valid or not corrected.
    """
    out = np.empty((len(uncertainty.bands), *parts.where.shape), np.float32)
    for i, error in enumerate(uncertainty.bands):
        variance = _local(parts, error, uncertainty) if uncertainty.reference >= 0 else _plain(parts, error)
        if error.slope_error:
            variance += (error.slope_error * _followed(parts, error.band)) ** 2
        if steps:
            touched: Any = True if error.index >= 0 or parts.replaced is None else parts.replaced[error.band]
            variance += np.where(touched, steps[error.band] ** 2 / 12, 0.0)
        variance[~(parts.where & np.isfinite(parts.after[error.band]))] = np.nan
        out[i] = np.sqrt(variance)
    return out


def _local(parts: Parts, error: BandError, uncertainty: Uncertainty) -> npt.NDArray[np.float64]:
    """Variance after a compensation."""
    assert parts.replaced is not None
    assert parts.level is not None
    assert parts.removed_level is not None
    level = parts.removed_level[error.band]
    span = np.maximum(_span(level)[parts.inner].astype(np.float64) ** 2 - error.relief, 0.0)
    of_level = error.level + (error.edges + OF_RELIEF**2) * span
    kept = np.zeros_like(parts.where) if parts.kept is None else parts.kept
    base = np.where(kept, parts.after[error.band], level[parts.inner])
    noise = error.fixed + error.growing * np.maximum(base, 0).astype(np.float64)
    replaced = parts.replaced[error.band] & ~kept
    left = error.left * np.sqrt(_shown(parts, uncertainty))
    given = np.where(replaced, np.maximum(parts.after[error.band] - level[parts.inner], 0.0), 0.0).astype(np.float64)
    variance = np.where(replaced, of_level + OF_GIVEN * given**2, noise) + np.where(kept, of_level, 0.0)
    return np.asarray(variance + (left + np.where(replaced, error.high, 0.0)) ** 2)


def _shown(parts: Parts, uncertainty: Uncertainty) -> npt.NDArray[np.float64]:
    """Mean square of the glint that the reference shows to be left."""
    above = np.maximum(_level(parts)[uncertainty.reference].astype(np.float64) - uncertainty.lowest, 0.0)
    sure = np.maximum(above - STANDS_OUT * uncertainty.usual, 0.0)
    return np.asarray(uncertainty.share**2 * above**2 + (1 - uncertainty.share**2) * sure**2)


def _plain(parts: Parts, error: BandError) -> npt.NDArray[np.float64]:
    """Variance after a removal alone."""
    return np.asarray(error.fixed + error.growing * _removed(parts, error.band) ** 2)


def _of_level(looks: Sequence[Parts], trials: Sequence[Trial], band: int, growth: float) -> BandError:
    """How clean pixels lie about the level, and by how much the level errs in trials."""
    away, place, spans, about = [], [], [], []
    for parts in looks:
        assert parts.replaced is not None
        assert parts.removed_level is not None
        wide = parts.removed_level[band]
        level = wide[parts.inner].astype(np.float64)
        rest = parts.after[band] - level
        clean = parts.where & ~parts.replaced[band] & np.isfinite(rest)
        if parts.kept is not None:
            clean &= ~parts.kept
        about.append((rest, clean, level))
        away.append(rest[clean])
        place.append(level[clean])
        spans.append(_span(wide)[parts.inner][clean].astype(np.float64))
    rest, level, span = np.concatenate(away), np.concatenate(place), np.concatenate(spans)
    if rest.size < FEWEST:
        return _too_few(rest.size)
    fixed, growing = _line(np.maximum(level, 0.0), (rest - rest.mean()) ** 2)
    relief = float(np.median(span**2))
    high = _cut_off(rest) - float(rest.mean())
    wrong = np.concatenate([trial.errors(band) for trial in trials])
    if not wrong.size:
        return BandError(band, fixed, growing, float(rest.var()), relief, 0.0, high)
    steep = np.concatenate([_span(trial.level[band])[trial.of(band)] for trial in trials]).astype(np.float64)
    of_level, edges = _line(np.maximum(steep**2 - relief, 0.0), (wrong - wrong.mean()) ** 2)
    low, middle = np.percentile(level, [LOWEST, 50.0])
    most = float(middle + OF_WATER * (middle - low))
    beside = np.sum([shared(far, clean & (there <= most)) for far, clean, there in about], axis=0)
    texture = own(beside, np.sum([trial.shared(band, most) for trial in trials], axis=0))
    return BandError(
        band, fixed, growing, growth * of_level + texture, relief, growth * edges, high + float(wrong.mean())
    )


def _cut_off(rest: npt.NDArray[np.float64]) -> float:
    """Mean of a normal distribution about 0 that has the lower half of these, and is cut off where they are.

    Barr, Sherrill (1999), equation 2.
    """
    below = rest[rest < 0]
    sigma = sqrt(float((below**2).mean())) if below.size else 0.0
    if sigma == 0:
        return 0.0
    z = float(np.percentile(rest, HIGHEST)) / sigma
    return -sigma * exp(-z * z / 2) / sqrt(2 * pi) / (0.5 * (1 + erf(z / sqrt(2))))


def _of_removal(looks: Sequence[Parts], band: int) -> BandError:
    """How pixels differ from their neighbours after removal."""
    squares, place = [], []
    for parts in looks:
        amount = _removed(parts, band) ** 2
        value = np.where(parts.where, parts.after[band], np.nan).astype(np.float64)
        for a, v in ((amount, value), (amount.T, value.T)):
            bent = (v[:-2] - 2 * v[1:-1] + v[2:]) ** 2 / 6
            known = np.isfinite(bent)
            squares.append(bent[known])
            place.append(((a[:-2] + 4 * a[1:-1] + a[2:]) / 6)[known])
    bent, amount = np.concatenate(squares), np.concatenate(place)
    if bent.size < FEWEST:
        return _too_few(bent.size)
    return BandError(band, *_line(amount, bent))


def _too_few(count: int) -> BandError:
    raise FitError(
        f"{count} clean pixels, need {FEWEST} to tell a standard error by. Widen --mask, or leave out --stderr."
    )


def _line(place: npt.NDArray[np.float64], squares: npt.NDArray[np.float64]) -> tuple[float, float]:
    """The line through variances, neither part below 0; groups count by their relative errors."""
    order = np.argsort(place, kind="stable")
    groups = [g for g in np.array_split(order, GROUPS) if g.size]
    x, y = (np.array([v[g].mean() for g in groups]) for v in (place, squares))
    weight = np.array([float(g.size) for g in groups])
    fixed, growing = weighted_line(x, y, weight)
    told = float((weight * (fixed + growing * x)).sum() / weight.sum())
    scale = float(squares.mean()) / told if told > 0 else 0.0
    return fixed * scale, growing * scale


def _span(level: Float32Array) -> Float32Array:
    """How far a level spans within `REACH` pixels."""
    import cv2

    element = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
    known = np.isfinite(level)
    high = cv2.dilate(np.where(known, level, np.float32(-np.inf)), element)
    low = cv2.erode(np.where(known, level, np.float32(np.inf)), element)
    return np.subtract(high, low, out=np.zeros_like(level), where=known)


def _level(parts: Parts) -> Float32Array:
    assert parts.level is not None
    return parts.level[(slice(None), *parts.inner)]


def _removed(parts: Parts, band: int) -> npt.NDArray[np.float64]:
    return np.subtract(parts.before[band], parts.after[band], dtype=np.float64)


def _followed(parts: Parts, band: int) -> npt.NDArray[np.float64]:
    """What removal took away: slope times how far the index stands above its level."""
    if parts.level is None or parts.removed_level is None:
        return _removed(parts, band)
    at = (band, *parts.inner)
    return np.subtract(parts.level[at], parts.removed_level[at], dtype=np.float64)
