"""What lens and shutter of a frame camera do to the numbers of a capture: vignette and row gradient.

The numbers of a file are corrected as they are read: black + (number - black) * factor, with a factor for each pixel.
They become floating point, and keep the file's scale and offset.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import Window


@dataclass(frozen=True)
class FlatField:
    """How bright each pixel of a capture is made."""

    black: float = 0.0  # number in the file without any light
    centre: tuple[float, float] = (0.0, 0.0)  # column and row of the middle of the vignette [pixel]
    polynomial: tuple[float, ...] = ()  # p1, p2 ... of 1 + p1 r + p2 r^2 + ..., r: distance from the centre [pixel]
    corrects: bool = False  # the polynomial is the correction itself, not the fall-off that is to be corrected
    row_gradient: float = 0.0  # rows are brighter by 1 + row_gradient * row

    def factor(self, window: Window) -> npt.NDArray[np.float32]:
        """By what the light of each pixel of a window is multiplied, (row, column)."""
        (top, bottom), (left, right) = window
        rows = np.arange(top, bottom, dtype=np.float64)[:, np.newaxis]
        columns = np.arange(left, right, dtype=np.float64)
        r = np.hypot(columns - self.centre[0], rows - self.centre[1])
        vignette = np.polyval([*self.polynomial[::-1], 1.0], r)
        found = (vignette if self.corrects else 1.0 / vignette) / (1.0 + self.row_gradient * rows)
        return found.astype(np.float32)

    def apply(self, raw: npt.NDArray[Any], window: Window, nodata: float | None) -> None:
        """Correct the numbers of a window in place; those that say "not valid" stay."""
        light = raw - np.float32(self.black)
        corrected = light * self.factor(window) + np.float32(self.black)
        np.copyto(raw, corrected, where=True if nodata is None else raw != nodata)
