"""Adaptive median: pixels that are still glint are set to the median of the glint-free pixels around them."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..moments import Mask
from .replace_glint import put
from .state import Float32, Sample, Setting, State

LARGEST_MEDIAN = 25  # default side of the largest window [pixel]: twice the default window of the opening
CLEAN = 5  # least number of glint-free pixels in a window: the median of fewer is hardly less noisy than one pixel
VALUES_AT_ONCE = 1 << 22  # values processed at a time: 16 MB


@dataclass(frozen=True)
class Median:
    """The stage `median`: it replaces glint by the median of glint-free pixels, in a window that grows where needed."""

    name: ClassVar[str] = "median"
    largest: int = LARGEST_MEDIAN  # side of the largest window, odd [pixel]

    @property
    def halo(self) -> int:
        """Margin around a block that the stage needs [pixel]: half the side of the largest window."""
        return self.largest // 2

    def apply(self, state: State) -> State:
        """Replace glint where the largest window has enough glint-free pixels."""
        assert state.glint is not None  # a chain identifies glint before
        values, filled = state.image.copy(), np.zeros_like(state.glint)
        for b, glint in enumerate(state.glint):
            at, clean = glint & state.water, ~glint & state.water
            values[b], filled[b] = adaptive_median(state.image[b], at, clean, self.largest)
        return put(state, filled, values, glint=None, background=None, sharp=None, psfs=None)


def fit(_sample: Sample, _setting: Setting, number: float | None = None) -> Median:
    """Make the stage; `number` is the side of the largest window, odd, 25 by default [pixel]."""
    return Median(int(number or LARGEST_MEDIAN))


def adaptive_median(band: Float32, glint: Mask, clean: Mask, largest: int = LARGEST_MEDIAN) -> tuple[Float32, Mask]:
    """Replace each glint pixel of a band by the median of the glint-free pixels around it.

    band : (row, column), any unit
    glint, clean : masks (row, column) of the pixels to replace, and of the glint-free pixels that may replace them
    largest : side of the largest window, odd [pixel]. The side is first 3 pixels and is increased in steps of 2 until
        the window contains 5 glint-free pixels (`CLEAN`); if even the largest has fewer, the pixel is not replaced

    Returns the band after replacement, and the mask of replaced pixels, (row, column) each. For an even number of
    values, the median is the lower of the two middle values.

    Hwang, Haddad (1995), IEEE Trans. Image Process. 4, 499-502, doi:10.1109/83.370679.

    >>> sea = np.arange(9, dtype=np.float32).reshape(3, 3)
    >>> float(adaptive_median(sea, sea == 4, sea != 4)[0][1, 1])
    3.0
    """
    out, filled, half = band.copy(), np.zeros_like(glint), largest // 2
    padded = np.pad(np.where(clean, band, np.float32(np.nan)), half, constant_values=np.nan)
    rows, columns = np.nonzero(glint)
    for reach in range(1, half + 1):
        if not rows.size:
            break
        side = 2 * reach + 1
        windows, left = sliding_window_view(padded, (side, side)), []
        for part in np.array_split(np.arange(rows.size), rows.size * side**2 // VALUES_AT_ONCE + 1):
            r, c = rows[part], columns[part]
            values = windows[r + half - reach, c + half - reach].reshape(r.size, -1)
            count = np.isfinite(values).sum(axis=1)
            enough = count >= CLEAN
            values = np.sort(values[enough], axis=1)  # NaN comes last
            out[r[enough], c[enough]] = values[np.arange(len(values)), (count[enough] - 1) // 2]
            filled[r[enough], c[enough]] = True
            left.append(part[~enough])
        keep = np.concatenate(left)
        rows, columns = rows[keep], columns[keep]
    return out, filled
