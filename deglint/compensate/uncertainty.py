r"""Standard errors of the pixels of a compensated image, from the scene itself.

.. math:: \sigma^2 = \sigma_w^2 + (\sigma_b g / b)^2 + (b \sigma_0)^2

with :math:`\sigma_b / b` the relative standard error of a band's slope b, g the removed glint, and :math:`\sigma_0` the
standard error of the glint-free NIR. Where stages before the removal replaced glint, the error variance of the water,
:math:`\sigma_w^2`, is measured by a trial: objects, and the glint of the scene displaced by half a block, are added to
the compensated image, and the chain is run again. Elsewhere the variance comes from the stage `posterior` if the chain
has it, else it is the variance of noise and, if no stage replaces glint, of the glint that the removal left. Bands that
the removal does not correct (such as the NIR, from which it predicts glint) keep their faint glint: the square of the
excess over water without glint is added.

The standard errors are root mean square errors, noise included. They do not include errors that all pixels share:
calibration and atmosphere. Objects that an opening removes do not increase the standard error.

References
----------
Efron, Tibshirani (1993), An Introduction to the Bootstrap, doi:10.1201/9780429246593 (errors on data with known truth).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import cv2
import numpy as np

from ..remove.mixture import WATER_PERCENTILE
from ..remove.model import GlintModel
from ..remove.noise import noise
from . import posterior
from .posterior import Posterior
from .state import FEWEST, Float32, Sample, Setting, State

SPAN = 7  # side of the window for the local range of a background [pixel]: errors occur at edges
LEAST_R2 = 0.25
"""Lower limit of R2, for the standard error of a slope: where glint explains less of a band's variance, the rest is
mostly signal of the water. With this limit, the true slope is at most twice the fitted slope."""
ABOVE_LOW = NormalDist().inv_cdf(1 - WATER_PERCENTILE / 100)  # decrease of this percentile by normal noise [sigma]
LEAST_BACKGROUND_VARIANCE = 0.25
"""Lower limit of the variance of a background, relative to the variance of noise: it comes from few pixels."""


@dataclass(frozen=True)
class ReplacedError:
    """Error variance of one band, for pixels that were replaced and for other pixels [unit of the band squared]."""

    band: int  # 0-based
    noise: float  # variance of noise, for pixels that were not replaced
    even: float  # error variance of a replaced pixel where the background is uniform
    relief: float  # increase of the error variance per square of the local range (`SPAN`) of the background [1]
    water: float  # value of the band without glint [unit of the band]


def fit_replaced(
    before: Sample, after: Sample, objects: Sequence[Float32], run: Callable[[State], State]
) -> tuple[ReplacedError, ...]:
    """Measure the error of replaced pixels, by a trial: displaced glint is added to the compensated sample.

    before, after : the sample as read, and after all stages
    objects : objects to add to the water of each block, as errors are largest at their edges, (band, row, column) each
        [unit of the band]
    run : function that applies all stages to a state as read, and returns the new state

    Returns the error of each band: the error of noise if the trial replaced fewer than `FEWEST` pixels of the band.
    """
    water = [replace(s, raw=s.raw + o, image=s.image + o) for s, o in zip(after.states, objects, strict=True)]
    tried = [run(_trial(s)) for s in water]
    out = []
    for b in range(len(before.states[0].raw)):
        s2 = noise([s.raw[b] for s in before.states], before.inside) ** 2
        images = [s.image[b] for s in after.states]
        low = float(np.percentile(after.values(images), WATER_PERCENTILE))
        least = low + ABOVE_LOW * noise(images, after.inside)
        wrong, spans = [], []
        for truth, done, inside in zip(water, tried, after.inside, strict=True):
            if truth.replaced is not None and done.replaced is not None:
                seen = inside & done.replaced[b] & ~truth.replaced[b]  # the truth has its own noise there
                wrong.append((done.image[b] - truth.image[b])[seen])
                spans.append(_span(done.image[b])[seen])
        away = np.concatenate(wrong) if wrong else np.zeros(0, np.float32)
        if away.size < FEWEST:
            out.append(ReplacedError(b, s2, s2, 0.0, least))
            continue
        relief = np.concatenate(spans).astype(np.float64) ** 2
        square = away.astype(np.float64) ** 2 - s2
        flat = relief <= np.median(relief)
        even = max(float(square[flat].mean()), LEAST_BACKGROUND_VARIANCE * s2)
        steep = max(float(square[~flat].mean()) - even, 0.0) / max(float(relief[~flat].mean()), 1e-30)
        out.append(ReplacedError(b, s2, even, steep, least))
    return tuple(out)


def _trial(done: State) -> State:
    """State for a trial: image of `done` (after all stages) plus the replaced glint, which is moved by half a block."""
    assert done.replaced is not None  # a stage before the removal replaces glint
    glint = np.where(done.replaced, np.maximum(done.raw - done.image, 0), 0)
    known = done.image + np.roll(glint, (glint.shape[1] // 2, glint.shape[2] // 2), (1, 2))
    return State(known, known, done.water)


def _span(band: Float32) -> Float32:
    """Maximum minus minimum in 7 x 7 pixels around each pixel, (row, column), after a median of 5 x 5 pixels."""
    plane, window = cv2.medianBlur(band, 5), np.ones((SPAN, SPAN), np.uint8)
    return np.asarray(cv2.dilate(plane, window) - cv2.erode(plane, window), np.float32)


def stderr(state: State, model: GlintModel, errors: Sequence[ReplacedError] = ()) -> Float32:
    """Standard error of a block after all stages, (band, row, column) [unit of the band]; 0 where it is not estimated.

    state : the block, with the light that was `removed`, and the `variance` if a stage has computed it
    model : model of the removal
    errors : result of `fit_replaced` if stages before the removal replace glint. Replaced pixels get the error that the
        trial has measured. Other pixels get the error of noise where `variance` is not known. In bands that the removal
        does not correct, the excess over water without glint is added.
    """
    variance = np.zeros_like(state.image) if state.variance is None else state.variance.copy()
    corrected = {f.band for f in model.fits}
    for e in errors:
        rough = np.float32(e.even) + np.float32(e.relief) * _span(state.image[e.band]) ** 2
        replaced = np.zeros_like(state.water) if state.replaced is None else state.replaced[e.band]
        known = variance[e.band] > 0  # noise included
        variance[e.band] = np.where(replaced, rough, np.where(known, variance[e.band], np.float32(e.noise)))
        if e.band not in corrected:  # faint glint is left in it
            variance[e.band] += np.square(np.maximum(state.image[e.band] - np.float32(e.water), 0))
    for f in model.fits:
        if state.removed is not None and f.slope:
            variance[f.band] += np.square(np.float32((f.stderr or 0.0) / f.slope) * state.removed[f.band])
        variance[f.band] += np.float32((f.slope * (model.level_stderr or 0.0)) ** 2)
    return np.sqrt(variance)


def fit_removed(after: Sample, setting: Setting, model: GlintModel) -> Posterior:
    """Measure the glint left in a sample `after` the removal by `model`; return a stage that only sets the variance.

    The variance includes the error of the slope. The true slope is 1 to 1/rho times the fitted slope (rho: correlation
    of band and glint). The factor is 1 if the variance that glint does not explain is signal of water, 1/rho if it is
    glint that moved between bands. All factors are equally likely: the relative error is (1/rho - 1) / sqrt(3).
    """
    found = posterior.fit(after, setting)
    share = {f.band: (max(f.r2, LEAST_R2) ** -0.5 - 1) / 3**0.5 for f in model.fits if f.r2 is not None}
    left = []
    for p in found.left:  # the error of the slope is the same share of the glint
        slope_errors = (share.get(p.band, 0.0) * g for g in p.glint)
        left.append(replace(p, variance=tuple(v + e**2 for v, e in zip(p.variance, slope_errors, strict=True))))
    return replace(found, left=tuple(left), resolved=False)


def halo(errors: Sequence[ReplacedError]) -> int:
    """Margin around a block that `stderr` needs [pixel]; `errors` is the result of `fit_replaced`."""
    return SPAN // 2 + 2 if errors else 0
