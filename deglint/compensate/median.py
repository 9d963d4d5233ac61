"""Adaptive median: fill what is still glint from the clean pixels around it, in a window that grows as it must.

Used as the last resort of the thesis' chain, where a pixel is glint in every band. Only identified pixels are
touched. Assumes that the water changes little within the window; blurs texture where glint is dense. The median of a
few clean neighbours is their lower middle value: even numbers are not averaged, so results are values of the image.
Cost: none where nothing is left over; otherwise 0.1 to 1 microsecond a pixel that is.

References
----------
Hwang, Haddad (1995), "Adaptive median filters: new algorithms and results", IEEE Transactions on Image Processing 4,
499-502, doi:10.1109/83.370679. Fink (2014), "Glint Avoidance and Removal in the Maritime Environment", Rochester
Institute of Technology, section 6.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..errors import InputError
from .state import Float32Array, Mask, State

CLEAN = 5
"""Clean neighbours that are enough."""
_AT_ONCE = 1 << 22
"""Values gathered at a time."""


@dataclass(frozen=True)
class Median:
    """Adaptive median of identified pixels.

    Attributes
    ----------
    largest : int
        Side of the largest window, odd [pixel].
    """

    name: ClassVar[str] = "median"
    largest: int = 25

    def __post_init__(self) -> None:
        if self.largest < 3 or self.largest % 2 == 0:
            raise InputError(
                f"the largest window of the adaptive median must be odd and 3 or more, got {self.largest}."
            )

    @property
    def halo(self) -> int:
        """Half the largest window."""
        return self.largest // 2

    def apply(self, state: State) -> None:
        """Fill what is identified; what has too few clean pixels even in the largest window stays as it is."""
        if state.hit is None:
            raise InputError("median needs glint to be identified: name identify-median or identify-level before it.")
        for b, hit in enumerate(state.hit):
            if hit.any():
                values, filled = adaptive_median(state.image[b], hit, self.largest)
                state.replaced[b] |= filled
                np.copyto(state.image[b], values, where=filled)
        state.hit = state.level = state.sharp = state.psfs = None


def adaptive_median(band: Float32Array, hit: Mask, largest: int = 25) -> tuple[Float32Array, Mask]:
    """Median of the clean pixels around each identified one.

    Parameters
    ----------
    band : (row, column) float32 ndarray
        NaN is not valid.
    hit : (row, column) bool ndarray
        Pixels to fill; they and invalid ones are not used.
    largest : int
        Side of the largest window, odd [pixel]. The window grows from 3 by 2.

    Returns
    -------
    (ndarray, ndarray)
        The band with filled pixels, and which were filled.

    Examples
    --------
    >>> import numpy as np
    >>> sea = np.arange(9, dtype=np.float32).reshape(3, 3)
    >>> float(adaptive_median(sea, sea == 4)[0][1, 1])
    3.0
    """
    out, filled = band.copy(), np.zeros_like(hit)
    half = largest // 2
    clean = np.where(hit, np.float32(np.nan), band)
    padded = np.pad(clean, half, constant_values=np.nan)
    rows, columns = np.nonzero(hit)
    for reach in range(1, half + 1):
        if not rows.size:
            break
        side = 2 * reach + 1
        windows = sliding_window_view(padded, (side, side))
        left = []
        for first in range(0, rows.size, max(_AT_ONCE // side**2, 1)):
            part = slice(first, first + max(_AT_ONCE // side**2, 1))
            r, c = rows[part], columns[part]
            values = windows[r + half - reach, c + half - reach].reshape(r.size, -1)
            count = np.isfinite(values).sum(axis=1)
            enough = count >= CLEAN
            values = np.sort(values[enough], axis=1)  # NaN comes last
            out[r[enough], c[enough]] = values[np.arange(len(values)), (count[enough] - 1) // 2]
            filled[r[enough], c[enough]] = True
            left.append(~enough)
        keep = np.concatenate(left)
        rows, columns = rows[keep], columns[keep]
    return out, filled
