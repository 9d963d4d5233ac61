"""Glint replacement: by the band's own background, or by the spectrally nearest band without glint."""

from dataclasses import dataclass, replace
from typing import ClassVar

import cv2
import numpy as np

from ..moments import Mask
from .state import Float32, Sample, Setting, State


@dataclass(frozen=True)
class ReplaceLevel:
    """The stage `replace-level`: it replaces glint by the background of the same band; water may have any spectrum."""

    name: ClassVar[str] = "replace-level"
    halo: ClassVar[int] = 0

    def apply(self, state: State) -> State:
        """Set glint pixels to `State.background`, and mark them as replaced."""
        assert state.background is not None  # a chain has identify-level before
        assert state.glint is not None
        return put(state, state.glint, state.background, glint=None, sharp=None, psfs=None)


@dataclass(frozen=True)
class ReplaceBands:
    """The stage `replace-bands`: it replaces glint by the value of the spectrally nearest band without glint.

    The image must be normalised (stage `normalise`): the contrast with deep water is assumed to be equal in both bands.
    The new values have the texture and the faint, unmarked glint of the other band. Objects change colour.
    """

    name: ClassVar[str] = "replace-bands"
    halo: ClassVar[int] = 0
    order: tuple[tuple[int, ...], ...]  # for each band, all other bands, the nearest in wavelength first

    def apply(self, state: State) -> State:
        """Replace glint and remove its mark in `State.glint`, except where all bands have glint."""
        assert state.glint is not None  # a chain identifies glint before
        values, found = nearest_clean(state.image, state.glint, self.order)
        return put(state, found, values, glint=state.glint & ~found)


def put(state: State, where: Mask, values: Float32, **changes: object) -> State:
    """Set pixels `where` to `values`, (band, row, column) each, mark them as replaced, and set the fields `changes`."""
    replaced, image = where if state.replaced is None else state.replaced | where, state.image.copy()
    for band, new, mask in zip(image, values, where, strict=True):
        cv2.copyTo(new, mask.view(np.uint8), band)  # np.where takes ten times longer
    return replace(state, image=image, replaced=replaced, **changes)  # type: ignore[arg-type]


def nearest_clean(image: Float32, glint: Mask, order: tuple[tuple[int, ...], ...]) -> tuple[Float32, Mask]:
    """Replace glint by the nearest glint-free band; return image and mask of replaced pixels, (band, row, column) each.
    For each band, `order` lists the other bands, nearest first. Pixels with glint in every band are not changed.
    """
    values, todo = image.copy(), glint.copy()
    for band, others in enumerate(order):
        for other in others:
            take = todo[band] & ~glint[other]
            np.copyto(values[band], image[other], where=take)
            todo[band] &= ~take
    return values, glint & ~todo


def fit_bands(_sample: Sample, setting: Setting, _number: float | None = None) -> ReplaceBands:
    """Make the stage for `Setting.images`; "nearest" is by wavelength, or by number if a wavelength is not known."""
    waves, images = setting.wavelengths, setting.images
    place = waves if np.isfinite(waves[images]).all() else np.arange(len(waves), dtype=float)
    order = [np.argsort(np.abs(place - own), kind="stable").tolist() for own in place]
    return ReplaceBands(tuple(tuple(j for j in o if j != i and images[j]) for i, o in enumerate(order)))
