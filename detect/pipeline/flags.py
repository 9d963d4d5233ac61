"""What became of each pixel, as bits of a raster: why it has no score, or what to know of the one it has."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..local import DEFICIENT, STATES, TOO_FEW

Mask = npt.NDArray[np.bool_]
Flags = npt.NDArray[np.uint8]
NOT_VALID, MASKED_OUT, NOT_BACKGROUND, PSEUDO_INVERSE, NO_RING = 1, 2, 4, 8, 16
MEANINGS = {
    NOT_VALID: "nodata, or not finite, in a band in use: no score",
    MASKED_OUT: "outside --mask: no score",
    NOT_BACKGROUND: "outside the area of --background: scored, but not fitted to",
    PSEUDO_INVERSE: STATES[DEFICIENT],
    NO_RING: STATES[TOO_FEW],
}
"""Bits of the flag raster; 0: a score like any other."""


def flags_of(
    block: npt.NDArray[Any], mask: Mask | None, area: Mask | None, states: npt.NDArray[np.uint8] | None
) -> Flags:
    """Flags of a tile.

    Parameters
    ----------
    block : (band, row, column) ndarray
    mask, area : (row, column) bool ndarray, optional
        True where a score is wanted, and where the background is.
    states : (row, column) uint8 ndarray, optional
        As `detect.local.local_rx` fills `flags`.

    Returns
    -------
    (row, column) uint8 ndarray
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
