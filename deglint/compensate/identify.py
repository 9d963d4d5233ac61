"""Identify glint by a threshold for each band: the median of deep water plus a number of standard deviations."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..remove.noise import spread
from .state import Sample, Setting, State, full_scale

K = 5.0  # standard deviations above the median, as in Fink (2014), section 6.3


@dataclass(frozen=True)
class IdentifyMedian:
    """The fitted stage `identify-median`: it marks pixels above a threshold, even if they are objects or shoals."""

    name: ClassVar[str] = "identify-median"
    halo: ClassVar[int] = 0
    thresholds: tuple[float, ...]  # of each band [unit of the image at this stage]; at most the saturation value

    def apply(self, state: State) -> State:
        """Mark the pixels of each band that exceed its threshold as glint."""
        return replace(state, glint=state.image > np.array(self.thresholds, np.float32)[:, None, None])


def fit(sample: Sample, setting: Setting, number: float | None = None) -> IdentifyMedian:
    """Compute thresholds from a sample; `number` is the number of standard deviations above the median, 5 by default.
    The standard deviation is estimated from the values x below the median m, as glint only adds light: ``1.4826
    median(m - x)``, x <= m (Rousseeuw, Croux 1993, doi:10.1080/01621459.1993.10476408). It is at least the standard
    deviation of noise. A threshold is at most the saturation value, from `setting` or the sample. The method fails
    where glint covers half of the pixels, as the median is then glint. Raises FitError if the sample is too small.
    """
    k = K if number is None else number
    unit = sample.states[0].unit
    full = full_scale(sample, setting) / (1 if unit is None else unit)
    images, found = [s.image for s in sample.states], []
    for values, sigma, most in zip(sample.values(images), sample.noise_of(images), full, strict=True):
        middle = np.float32(np.median(values))
        about = max(spread(values[values <= middle] - middle), float(sigma))
        found.append(min(float(middle) + k * about, float(most)))  # so that saturated pixels are glint
    return IdentifyMedian(tuple(found))
