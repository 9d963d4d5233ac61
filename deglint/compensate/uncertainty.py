r"""Standard errors of a compensated image, from the scene itself.

.. math:: \sigma^2 = \sigma_w^2 + (\sigma_b g / b)^2 + (b \sigma_0)^2

with :math:`\sigma_b / b` the relative standard error of a band's slope b, g the glint that removal took, and
:math:`\sigma_0` the standard error of the level that all bands share. The variance of the water, :math:`\sigma_w^2`, is
that of the posterior mean where that stage ran (`deglint.compensate.posterior`). Where glint was replaced by a
background, it is the variance of the background's error, measured by a trial: the glint of the scene is added to its
own compensated image, displaced by half a tile, and the chain is run again. Where nothing was replaced it is that of
noise, and of the glint that the removal leaves.

The standard errors are root mean square errors, noise included. They do not include errors that all pixels share:
calibration and atmosphere. Objects narrower than the window of an opening are erased without an increase of the
standard error.

References
----------
Efron, Tibshirani (1993), An Introduction to the Bootstrap, doi:10.1201/9780429246593 (errors from a known copy).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..remove.model import GlintModel
from ..remove.noise import noise
from . import posterior
from .posterior import Posterior
from .state import FEWEST, Float32, Sample, Setting, State

SPAN = 7  # side of the window for the local range of a background [pixel]: errors occur at edges

LEAST_R2 = 0.25
"""Share of a band's variance that glint explains, below which the rest is rather the water's: slopes at most double."""

LEAST_BACKGROUND_VARIANCE = 0.25
"""Lower limit of the variance of a background, relative to that of noise: it depends on a few of the darkest pixels."""


@dataclass(frozen=True)
class ReplacedError:
    """Error variance of one band [unit of the band squared], where nothing and where glint was replaced."""

    band: int  # 0-based
    noise: float  # variance of noise
    even: float  # error variance of a uniform background
    relief: float  # its increase per square of the local range within `SPAN` pixels


def fit_replaced(before: Sample, after: Sample, run: Callable[[State], State]) -> tuple[ReplacedError, ...]:
    """Measure the error of backgrounds on a sample, by a trial with known water.

    Parameters
    ----------
    before, after : Sample
        The sample as read, and after all stages.
    run : callable
        Applies all stages to a state as read.

    Returns
    -------
    tuple of ReplacedError
        One for each band.
    """
    tried = [run(_trial(s)) for s in after.states]
    out = []
    for b in range(len(before.states[0].raw)):
        s2 = noise([s.raw[b] for s in before.states], before.inside) ** 2
        wrong, spans = [], []
        for truth, done, inside in zip(after.states, tried, after.inside, strict=True):
            if truth.replaced is not None and done.replaced is not None:
                seen = inside & done.replaced[b] & ~truth.replaced[b]  # the truth has its own noise there
                wrong.append((done.image[b] - truth.image[b])[seen])
                spans.append(_span(done.image[b])[seen])
        away = np.concatenate(wrong) if wrong else np.zeros(0, np.float32)
        if away.size < FEWEST:
            out.append(ReplacedError(b, s2, s2, 0.0))
            continue
        relief = np.concatenate(spans).astype(np.float64) ** 2
        square = away.astype(np.float64) ** 2 - s2
        flat = relief <= np.median(relief)
        even = max(float(square[flat].mean()), LEAST_BACKGROUND_VARIANCE * s2)
        steep = max(float(square[~flat].mean()) - even, 0.0) / max(float(relief[~flat].mean()), 1e-30)
        out.append(ReplacedError(b, s2, even, steep))
    return tuple(out)


def _trial(done: State) -> State:
    """The compensated image with glint added that was removed from another part of it."""
    glint = np.maximum(done.raw - done.image, 0)
    if done.replaced is not None:
        glint = np.where(done.replaced, glint, 0)
    half = done.raw.shape[1] // 2, done.raw.shape[2] // 2
    known = done.image + np.roll(glint, half, (1, 2))
    return State(known, known, done.water)


def _span(band: Float32) -> Float32:
    """Local range of a band around each pixel, without single pixels."""
    import cv2

    plane, window = cv2.medianBlur(band, 5), np.ones((SPAN, SPAN), np.uint8)
    return np.asarray(cv2.dilate(plane, window) - cv2.erode(plane, window), np.float32)


def stderr(state: State, model: GlintModel, errors: Sequence[ReplacedError] = ()) -> Float32:
    """Standard error of a block after all stages.

    Parameters
    ----------
    state : State
        With `variance` of a posterior mean; or `replaced`, with `errors`.
    model : GlintModel
        Of the removal.
    errors : sequence of ReplacedError

    Returns
    -------
    (band, row, column) float32 ndarray
        0 for bands without an estimate.
    """
    variance = np.zeros_like(state.image) if state.variance is None else state.variance.copy()
    for e in errors:
        rough = np.float32(e.even) + np.float32(e.relief) * _span(state.image[e.band]) ** 2
        replaced = np.zeros_like(state.water) if state.replaced is None else state.replaced[e.band]
        variance[e.band] += np.where(replaced, rough, np.float32(e.noise))
    for f in model.fits:
        if state.removed is not None and f.slope:
            variance[f.band] += np.square(np.float32((f.stderr or 0.0) / f.slope) * state.removed[f.band])
        variance[f.band] += np.float32((f.slope * (model.level_stderr or 0.0)) ** 2)
    return np.sqrt(variance)


def fit_removed(after: Sample, setting: Setting, model: GlintModel) -> Posterior:
    """Measure on a sample what removal leaves where nothing else is done: a stage that sets the variance alone.

    Least squares gives between rho and 1 times the slope, with rho the correlation of the band with the glint: rho
    where all that differs is glint that moved between the bands, 1 where it is the water. All between are as likely,
    so that the slope has a relative standard error of (1 / rho - 1) / sqrt(3).
    """
    found = posterior.fit(after, setting)
    share = {f.band: (max(f.r2, LEAST_R2) ** -0.5 - 1) / 3**0.5 for f in model.fits if f.r2 is not None}
    left = []
    for p in found.left:  # this share of the glint was taken too little or too much
        slope_errors = (share.get(p.band, 0.0) * g for g in p.glint)
        left.append(replace(p, variance=tuple(v + e**2 for v, e in zip(p.variance, slope_errors, strict=True))))
    return replace(found, left=tuple(left), resolved=False)


def halo(errors: Sequence[ReplacedError]) -> int:
    """Pixels around a block that `stderr` needs."""
    return SPAN // 2 + 2 if errors else 0
