"""Glint replacement: put something in the place of what was identified as glint.

`ReplaceLevel` takes the level of the band itself, which `deglint.compensate.identify` found beside the sparkle: local
in wavelength, so nothing is assumed of the spectrum; it costs one copy. `ReplaceBands` takes, as the thesis does, the
value of the spectrally nearest band that is clean at that pixel, in units of water: it keeps the pixel's own texture,
and assumes that whatever is there is as bright against water in the other band; glint just below the threshold in the
clean band is carried over, and bright objects of a colour change it.

References
----------
Fink (2014), "Glint Avoidance and Removal in the Maritime Environment", Rochester Institute of Technology, section
6.3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..errors import InputError
from .state import Float32Array, Mask, State


@dataclass(frozen=True)
class ReplaceLevel:
    """Replace identified glint by the band's own level."""

    name: ClassVar[str] = "replace-level"

    @property
    def halo(self) -> int:
        """None: it looks at single pixels."""
        return 0

    def apply(self, state: State) -> None:
        """Put the level where there is glint."""
        if state.opened is None and state.level is None:
            raise InputError("replace-level needs a level: name identify-level before it.")
        state.settle()
        state.water = state.level
        state.hit = state.level = state.sharp = state.psfs = None


@dataclass(frozen=True)
class ReplaceBands:
    """Replace identified glint from the spectrally nearest clean band.

    Attributes
    ----------
    order : tuple of tuple of int
        For each band the others, the nearest in wavelength first.
    """

    name: ClassVar[str] = "replace-bands"
    order: tuple[tuple[int, ...], ...]

    @property
    def halo(self) -> int:
        """None: it looks at single pixels."""
        return 0

    def apply(self, state: State) -> None:
        """Replace; pixels that are glint in every band stay identified."""
        if state.hit is None:
            raise InputError("replace-bands needs glint to be identified: name identify-median or identify-level.")
        values, filled = nearest_clean(state.image, state.hit, self.order)
        state.replace(filled, values)
        state.hit = state.hit & ~filled


def neighbours(wavelengths: Sequence[float | None]) -> tuple[tuple[int, ...], ...]:
    """For each band the others, the nearest in wavelength first (in the file, where those are unknown)."""
    known = all(w is not None for w in wavelengths)
    place = [float(w) if known and w is not None else float(i) for i, w in enumerate(wavelengths)]
    count = range(len(place))
    return tuple(
        tuple(sorted((j for j in count if j != i), key=lambda j: (abs(place[j] - place[i]), j))) for i in count
    )


def nearest_clean(image: Float32Array, hit: Mask, order: Sequence[Sequence[int]]) -> tuple[Float32Array, Mask]:
    """Values of the spectrally nearest band without glint.

    Parameters
    ----------
    image : (band, row, column) float32 ndarray
        In units of water.
    hit : bool ndarray like image
        True where a band has glint.
    order : sequence of sequence of int
        For each band the others, the nearest first.

    Returns
    -------
    (ndarray, ndarray)
        Values, and where one was found.
    """
    usable = ~hit & np.isfinite(image)
    values = image.copy()
    todo = hit.copy()
    for band, others in enumerate(order):
        for other in others:
            take = todo[band] & usable[other]
            np.copyto(values[band], image[other], where=take)
            todo[band] &= ~take
            if not todo[band].any():
                break
    return values, hit & ~todo
