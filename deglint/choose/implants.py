"""Known signals that are added to sample tiles, to see what a recipe leaves of them.

Of four kinds: textures of three scales, discs as wide as the smallest object to keep, broad plumes of turbid water, and
small white targets. Their contrasts are relative to the water in each band, through some metres of water where they lie
below the surface. What a recipe makes of them is its gain: 1 where a signal is kept, 0 where it is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ..physics.iops import WAVELENGTH_RANGE, case1
from ..remove.mixture import PLUME, TURBID
from ..scene import Band

Float32 = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

SCALES = (1, 3, 9, 27)
"""Sides of the windows between whose local means textures lie [pixel]: factors of three part the range from a pixel to
the swell."""
DEPTH = 3.0
"""Depth of textures and discs [m]: an object that is dimmed in the red, and gone in the NIR."""
TEXTURE_CONTRAST, BRIGHT, DARK_DISC, WHITE_DISC = 0.1, 0.5, -0.25, 0.3
"""Contrasts with the water: of textures (standard deviation), discs; radiance of white targets
relative to the water's blue. An analyst would not miss any of them in an image without glint."""
SEED = 1
"""The same signals in the same tiles, every time."""
CHLOROPHYLL = 0.1
"""Of the clear sea through which they are seen [mg m-3]."""


@dataclass(frozen=True, eq=False)
class Implants:
    """Signals that are added to one tile.

    Attributes
    ----------
    names : tuple of str
    patterns : (signal, row, column) float32 ndarray
    colours : (signal, band) float32 ndarray
        Contrast in each band [unit of the band].
    """

    names: tuple[str, ...]
    patterns: Float32
    colours: Float32

    @property
    def total(self) -> Float32:
        """All of them together, (band, row, column)."""
        return np.einsum("sb,sij->bij", self.colours, self.patterns, dtype=np.float32)


def implants(shape: tuple[int, int], bands: Sequence[Band], level: Float32, width: float, seed: int) -> Implants:
    """Signals for a tile.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns.
    bands : sequence of Band
    level : (band,) ndarray
        Brightness of the water.
    width : float
        Of the smallest object to keep [pixel].
    seed : int
        Another one for each tile.
    """
    rng = np.random.default_rng((SEED, seed))
    known = [b.wavelength for b in bands]
    wavelengths = np.array([w for w in known if w]) if all(known) else np.full(len(bands), 480.0)
    seen = case1(np.clip(wavelengths, *WAVELENGTH_RANGE), CHLOROPHYLL).absorption
    through = np.exp(-DEPTH * seen).astype(np.float32) * level
    turbid = np.interp(wavelengths, *TURBID.T).astype(np.float32) * level
    white = np.full(len(bands), WHITE_DISC * float(level.max()), np.float32)
    patterns = {f"texture of {a} to {b} pixels": (_texture(shape, a, b, rng), through) for a, b in _pairs()}
    patterns["discs"] = _discs(shape, width, rng), through
    patterns["plumes"] = _plume(shape, rng), turbid
    patterns["targets of 2 pixels"] = _targets(shape, rng), white
    return Implants(
        tuple(patterns),
        np.stack([p for p, _ in patterns.values()]),
        np.stack([c for _, c in patterns.values()]),
    )


def gains(
    responses: Sequence[Float32], added: Sequence[Implants], inside: Sequence[Mask], unit: Float32
) -> dict[str, float]:
    """What is left of each signal: least squares of the responses on the patterns, over all tiles and bands.

    Means of tiles are left out: what the signals change of the level is not their own.

    responses : (band, row, column) of each tile, what a recipe makes of it with the signals less without them
    unit : (band,) by which bands are divided; infinite for those that do not count
    """
    names = added[0].names
    gram, cross = np.zeros((len(names),) * 2), np.zeros(len(names))
    for response, signals, mask in zip(responses, added, inside, strict=True):
        if not mask.any():
            continue
        patterns = signals.patterns[:, mask].astype(np.float64)
        patterns -= patterns.mean(axis=1, keepdims=True)
        colours = signals.colours / unit
        values = (response / unit[:, None, None])[:, mask]
        values -= values.mean(axis=1, keepdims=True)
        gram += (patterns @ patterns.T) * (colours @ colours.T)
        cross += ((patterns @ values.T) * colours).sum(axis=1)
    return dict(zip(names, np.linalg.lstsq(gram, cross, rcond=None)[0].tolist(), strict=True))


def _pairs() -> list[tuple[int, int]]:
    return list(pairwise(SCALES))


def _texture(shape: tuple[int, int], fine: int, coarse: int, rng: np.random.Generator) -> Float32:
    """Noise between two scales."""
    import cv2

    noise = rng.standard_normal(shape).astype(np.float32)
    band = cv2.blur(noise, (fine, fine)) - cv2.blur(noise, (coarse, coarse))
    return np.asarray(band * np.float32(TEXTURE_CONTRAST / band.std()), np.float32)


def _discs(shape: tuple[int, int], width: float, rng: np.random.Generator) -> Float32:
    """Bright and dark discs, six widths apart."""
    import cv2

    out, pitch = np.zeros(shape, np.float32), max(round(6 * width), 16)
    places = [(r, c) for r in range(pitch // 2, shape[0], pitch) for c in range(pitch // 2, shape[1], pitch)]
    for n, (row, column) in enumerate(places):
        centre = int(column + rng.integers(-2, 3)), int(row + rng.integers(-2, 3))
        cv2.circle(out, centre, max(round((width - 1) / 2), 0), BRIGHT if n % 2 else DARK_DISC, -1)
    return out


def _plume(shape: tuple[int, int], rng: np.random.Generator) -> Float32:
    """One Gaussian, a fifth of the tile wide."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    row, column = rng.uniform(0.25, 0.75, 2) * shape
    squares = (rows - row) ** 2 + (columns - column) ** 2
    return np.asarray(PLUME * np.exp(-squares / (2 * (0.2 * min(shape)) ** 2)), np.float32)


def _targets(shape: tuple[int, int], rng: np.random.Generator) -> Float32:
    """Squares of two pixels, 24 apart."""
    out = np.zeros(shape, np.float32)
    for row in range(12, shape[0] - 2, 24):
        for column in range(12, shape[1] - 2, 24):
            r, c = row + int(rng.integers(-4, 5)), column + int(rng.integers(-4, 5))
            out[r : r + 2, c : c + 2] = 1.0
    return out
