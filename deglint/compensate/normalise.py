"""Median normalisation: bring the bands to a common scale, water = 1.

    n_b = L_b / M_b,    M_b the median of band b over deep water

so that one threshold serves all bands and one band may stand in for another. The median is blind to glint while it
covers well under half of the water; where it covers more than a limit, the mode of the values may be taken instead.
(The thesis' chain keeps the median: bands that glint brightens are normalised by more, which makes up for some of it
when one band stands in for another.)

Assumes that glint-free water is the commonest thing in the sample. Fails, and cannot know it, where it is not: above
60 % cover the level is that of faint glint. Cost: one pass over the sample; one division a pixel.

References
----------
Fink (2014), "Glint Avoidance and Removal in the Maritime Environment", Rochester Institute of Technology, section
6.3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from ..errors import FitError
from ..remove.levels import mode
from .state import State

MOST_COVER = 0.3
"""Share of glint above which the plain median is no longer the level of water."""


@dataclass(frozen=True)
class Normalise:
    """Fitted median normalisation.

    Attributes
    ----------
    levels : tuple of float
        M_b of each band, in its unit.
    robust : tuple of bool
        Whether the level is the mode, because of glint.
    """

    name: ClassVar[str] = "normalise"
    levels: tuple[float, ...]
    robust: tuple[bool, ...]

    @property
    def halo(self) -> int:
        """None: it looks at single pixels."""
        return 0

    def apply(self, state: State) -> None:
        """Divide by the levels."""
        state.mark()
        for planes in (state.image,) if state.level is None else (state.image, state.level):
            for band, level in zip(planes, self.levels, strict=True):
                band /= np.float32(level)
        state.units = state.units * self.levels


def water_level(values: npt.NDArray[np.floating[Any]], most_cover: float = MOST_COVER) -> tuple[float, bool]:
    """Level of water in a sample, and whether it is the mode, because of glint.

    Parameters
    ----------
    values : (pixels,) ndarray
        Finite.
    most_cover : float
        Share of glint up to which the median is taken; 1 for always.

    Returns
    -------
    (float, bool)
    """
    middle = float(np.median(values))
    if most_cover >= 1:
        return middle, False
    peak = mode(values)
    below = peak - values[values <= peak]
    sigma = 1.4826 * float(np.median(below)) if below.size else 0.0
    if np.mean(values > peak + 3 * sigma) <= most_cover:
        return middle, False
    return peak, True


def fit_normalise(values: Sequence[npt.NDArray[np.floating[Any]]], *, most_cover: float = 1.0) -> Normalise:
    """Find the level of water in each band.

    Parameters
    ----------
    values : sequence of (pixels,) ndarray
        The sample, one array a band.
    most_cover : float
        Share of glint above which the mode is taken instead of the median; never by default.

    Raises
    ------
    FitError
        A band has no positive level to divide by.
    """
    found = [water_level(v, most_cover) for v in values]
    for number, (level, _) in enumerate(found, start=1):
        if not level > 0:
            raise FitError(f"band {number} has a level of {level:g} in deep water; normalising needs a positive one.")
    return Normalise(tuple(level for level, _ in found), tuple(robust for _, robust in found))
