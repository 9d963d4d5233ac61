"""Normalisation: each band is divided by its typical value over deep water, so that bands are comparable."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..errors import FitError
from ..remove.levels import mode
from ..remove.noise import spread
from .background import COVER_K
from .state import Float32, Sample, Setting, State


@dataclass(frozen=True)
class Normalise:
    """The fitted stage `normalise`: it divides each band by its level, which is the typical value of deep water."""

    name: ClassVar[str] = "normalise"
    halo: ClassVar[int] = 0
    levels: tuple[float, ...]  # level of each band [unit of the band]
    robust: tuple[bool, ...]  # whether the level is the mode instead of the median, because there is much glint

    def apply(self, state: State) -> State:
        """Divide each band, and the background of the band, by the level of the band."""
        unit = np.array(self.levels, np.float32)
        before = 1 if state.unit is None else state.unit
        background = None if state.background is None else state.background / unit[:, None, None]
        image = state.image / unit[:, None, None]
        return replace(state, image=image, background=background, sharp=None, unit=unit * before)


def water_level(values: Float32, most_cover: float) -> tuple[float, bool]:
    """Median of `values` (pixel,) and False; or mode and True, if the share of glint exceeds `most_cover` (0..1)."""
    peak = mode(values)
    sigma = spread(values[values <= peak] - np.float32(peak))
    much = bool(np.mean(values > peak + COVER_K * sigma) > most_cover)
    return peak if much else float(np.median(values)), much


def fit(sample: Sample, setting: Setting, number: float | None = None) -> Normalise:
    """Determine the level of deep water in each band of `setting` from a sample. The level is the median of the band.

    If more than `number` percent of the pixels are glint, the level is the mode; by default it is always the median.
    Glint raises the median, so normalised values are too low. Where they replace glint in another band, this error
    offsets their own faint glint (`ReplaceBands`). Raises FitError if the sample is too small or a level is not > 0.

    References
    ----------
    Fink (2014), "Glint Avoidance and Removal in the Maritime Environment", RIT, section 6.3.
    """
    values, most = sample.values([s.image for s in sample.states]), 0.01 * (number or 100)
    pairs = zip(values, setting.images, strict=True)
    found = [water_level(v, most) if image else (1.0, False) for v, image in pairs]
    for place, (level, _) in enumerate(found, start=1):
        if not level > 0:
            raise FitError(f"band {place} has a level of {level:g} in deep water; normalising needs a positive one.")
    levels, robust = zip(*found, strict=True)
    return Normalise(levels, robust)
