"""Glint replacement: by the band's own background, or by the spectrally nearest band without glint."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..errors import InputError
from .state import Float32, Mask, Sample, Setting, State


@dataclass(frozen=True)
class ReplaceLevel:
    """The stage `replace-level`: replace glint by the background of the same band, for any spectrum of the water."""

    name: ClassVar[str] = "replace-level"
    halo: ClassVar[int] = 0

    def apply(self, state: State) -> State:
        """Set glint pixels to the background."""
        if state.background is None or state.glint is None:
            raise InputError("replace-level needs a level: name identify-level before it.")
        return put(state, state.glint, state.background, glint=None, sharp=None, psfs=None)


@dataclass(frozen=True)
class ReplaceBands:
    """The stage `replace-bands`: replace glint by the value of the spectrally nearest band without glint.

    Values are relative to deep water (stage `normalise`). The contrast with deep water is assumed to be equal in both
    bands. The texture of the image is kept. Glint below the threshold is copied, too, and objects change their colours.
    """

    name: ClassVar[str] = "replace-bands"
    halo: ClassVar[int] = 0
    order: tuple[tuple[int, ...], ...]  # for each band, all other bands, the nearest in wavelength first

    def apply(self, state: State) -> State:
        """Replace glint; pixels with glint in every band stay marked."""
        if state.glint is None:
            raise InputError("replace-bands needs glint to be identified: name identify-median or identify-level.")
        values, found = nearest_clean(state.image, state.glint, self.order)
        return put(state, found, values, glint=state.glint & ~found)


def put(state: State, where: Mask, values: Float32, **changes: object) -> State:
    """State with `values` in pixels `where`, (band, row, column) both, marked as replaced; `changes`: fields to set."""
    import cv2

    replaced, image = where if state.replaced is None else state.replaced | where, state.image.copy()
    for band, new, mask in zip(image, values, where, strict=True):
        cv2.copyTo(new, mask.view(np.uint8), band)  # np.where takes ten times longer
    return replace(state, image=image, replaced=replaced, **changes)  # type: ignore[arg-type]


def nearest_clean(image: Float32, glint: Mask, order: tuple[tuple[int, ...], ...]) -> tuple[Float32, Mask]:
    """The image with glint replaced from the nearest band without glint in the pixel, and the mask of replaced values.
    Arrays are (band, row, column); `order`: see `ReplaceBands`. A pixel with glint in every band keeps its values.
    """
    values, todo = image.copy(), glint.copy()
    for band, others in enumerate(order):
        for other in others:
            take = todo[band] & ~glint[other]
            np.copyto(values[band], image[other], where=take)
            todo[band] &= ~take
    return values, glint & ~todo


def fit_bands(_sample: Sample, setting: Setting, _number: float | None = None) -> ReplaceBands:
    """For each band, order the others by distance in wavelength, or in the file if wavelengths are not known."""
    waves = setting.wavelengths
    place = waves if np.isfinite(waves).all() else np.arange(len(waves), dtype=float)
    count = range(len(place))
    order = [sorted((j for j in count if j != i), key=lambda j: (abs(place[j] - place[i]), j)) for i in count]
    return ReplaceBands(tuple(map(tuple, order)))
