"""Artefacts of a sensor and its processing: striping, resampling, JPEG.

The artefacts change the digital numbers of a scene, not the radiances of its truth.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np
import numpy.typing as npt

from ..physics._checks import Checked, Floats, one_of, ranged

DigitalNumbers = npt.NDArray[np.uint16]
Kernel = Literal["bilinear", "cubic", "lanczos"]

GRID_SHIFT = 0.5
"""Offset of the sensor's grid from the map's grid, down and right [pixel]; resampling by half a pixel blurs most."""


@dataclass(frozen=True, kw_only=True)
class Artefacts(Checked):
    """Artefacts of an image; by default there are none.

    Attributes
    ----------
    striping : float
        Standard deviation of the gain of the columns [1]; 0.02 is 2 %. Each band has its own gains.
    resampling : {"bilinear", "cubic", "lanczos"}, optional
        How the image is interpolated from the sensor's grid, which is offset by `GRID_SHIFT` pixels, to the map's grid.
    jpeg : int, optional
        Quality of a JPEG compression, 1 to 100. Each band is compressed separately with 8 bits, as in `compress`.
    """

    striping: float = ranged(0.0, 0.0, 0.5, "", "Two per cent is 0.02.")
    resampling: Kernel | None = one_of(None, (None, *get_args(Kernel)))
    jpeg: int | None = ranged(None, 1, 100, "", "75 is usual, 95 fine.", integer=True)


def stripe(radiance: Floats, deviation: float, seed: np.random.SeedSequence) -> Floats:
    """Multiply each column of a band (row, column) by a random gain (>= 0), mean 1, standard deviation `deviation`."""
    gain = 1.0 + deviation * np.random.default_rng(seed).standard_normal(radiance.shape[1])
    return np.asarray(radiance * np.maximum(gain, 0.0))


def resample(numbers: DigitalNumbers, kernel: Kernel, levels: int) -> DigitalNumbers:
    """Interpolate a band from the sensor's grid, which lies `GRID_SHIFT` pixels down and right, to the map's grid.

    `numbers` are digital numbers (row, column); the result is at most `levels`, the largest digital number.
    """
    how = {"bilinear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC, "lanczos": cv2.INTER_LANCZOS4}[kernel]
    move = np.array([[1.0, 0.0, GRID_SHIFT], [0.0, 1.0, GRID_SHIFT]])
    moved = cv2.warpAffine(numbers, move, numbers.shape[::-1], flags=how, borderMode=cv2.BORDER_REFLECT)
    return np.minimum(np.asarray(moved, np.uint16), np.uint16(levels))


def compress(numbers: DigitalNumbers, quality: int, levels: int) -> DigitalNumbers:
    """Compress the digital numbers (row, column) of a band as an 8-bit JPEG, and decompress them.

    Each byte is 255 sqrt(number / `levels`), where `levels` is the largest digital number of the sensor, so that the
    quantisation step is proportional to the shot noise, as in cameras. `quality` is the quality of the JPEG, 1 to 100.
    """
    small = np.rint(255.0 * np.sqrt(numbers / levels)).astype(np.uint8)
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.rint(levels * (np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)) / 255.0) ** 2).astype(np.uint16)
