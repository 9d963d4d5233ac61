"""What became of each pixel, as bits of a raster: why it has no score, or what to know of the one it has."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .. import sea
from ..local import DEFICIENT, STATES, TOO_FEW

Mask = npt.NDArray[np.bool_]
Flags = npt.NDArray[np.uint8]
NOT_VALID, MASKED_OUT, NOT_BACKGROUND, PSEUDO_INVERSE, NO_RING = 1, 2, 4, 8, 16
ON_RIM, FLOATS, BESIDE_LAND = 32, 64, 128
MEANINGS = {
    NOT_VALID: "nodata, or not finite, in a band in use: no score",
    MASKED_OUT: "outside --mask: no score",
    NOT_BACKGROUND: "outside the area of --background: scored, but not fitted to",
    PSEUDO_INVERSE: STATES[DEFICIENT],
    NO_RING: STATES[TOO_FEW],
    ON_RIM: "sea: water beside land, half land itself: no score",
    FLOATS: "sea: no water, but small enough to float",
    BESIDE_LAND: "sea: no water, attached to land, with the size and shape of a ship or a short pier",
}
"""Bits of the flag raster; 0: a score like any other."""


def flags_of(
    block: npt.NDArray[Any], mask: Mask | None, area: Mask | None, states: npt.NDArray[np.uint8] | None
) -> Flags:
    """Flags of a tile; the mask is True where a score is wanted, the area where the background is.

    `states` are what `detect.local.score_part` fills `flags` with.
    """
    flags = np.where(np.isfinite(block).all(axis=0), 0, NOT_VALID).astype(np.uint8)
    if mask is not None:
        flags[~mask] |= MASKED_OUT
    if area is not None:
        flags[~area] |= NOT_BACKGROUND
    if states is not None:
        flags[states == DEFICIENT] |= PSEUDO_INVERSE
        flags[states == TOO_FEW] |= NO_RING
    return flags


def flags_of_sea(valid: Mask, classes: npt.NDArray[np.uint8]) -> Flags:
    """Flags of a tile of sea, from `detect.sea.region`'s classes."""
    flags = np.where(valid, 0, NOT_VALID).astype(np.uint8)
    flags[valid & (classes == sea.NOT_SEA)] |= MASKED_OUT
    for which, bit in ((sea.RIM, ON_RIM), (sea.AFLOAT, FLOATS), (sea.ALONGSIDE, BESIDE_LAND)):
        flags[valid & (classes == which)] |= bit
    return flags
