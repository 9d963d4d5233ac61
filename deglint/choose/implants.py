"""Known signals that are added to sample tiles, to measure how much of them a recipe preserves.

There are four kinds of signals: textures of three scales, discs as wide as the smallest object to keep, broad plumes of
turbid water, and small white targets. Their contrasts are relative to the water; textures and discs are attenuated by
3 m of water. The gain of a recipe is the share of a signal that the recipe preserves: 1 for all of it, 0 for none.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import cv2
import numpy as np

from ..compensate.state import Float32
from ..moments import Float64, Mask
from ..physics.iops import WAVELENGTH_RANGE, case1
from ..remove.mixture import PLUME, TURBID
from ..scene import Band

SCALES = (1, 3, 9, 27)
"""Windows of local means [pixel]. A texture is the difference of two means: factors of three divide the range from one
pixel to the length of swell."""
DEPTH = 3.0  # depth of textures and discs [m]: they are weak in the red and invisible in the NIR
TEXTURE_CONTRAST, BRIGHT, DARK_DISC, WHITE_TARGET = 0.1, 0.5, -0.25, 0.3
"""Contrasts with the water, relative to the water: standard deviation of textures, bright discs, dark discs; and
contrast of white targets in every band, relative to water in its brightest band. All are visible without glint."""
SEED = 1  # seed of the random generator: the same tiles always get the same signals
CHLOROPHYLL = 0.1  # chlorophyll of the water above textures and discs [mg m-3]: clear water of the open sea


@dataclass(frozen=True, eq=False)
class Implants:
    """Known signals that are added to a tile: each is a pattern (row, column) times a spectrum (band,), its colour."""

    names: tuple[str, ...]  # (signal,)
    patterns: Float32  # (signal, row, column): contrast in units of the colour of the signal [1]
    colours: Float32  # (signal, band): radiance of a signal of contrast 1 [unit of the band]

    @property
    def total(self) -> Float32:
        """Sum of all signals, to be added to the tile, (band, row, column) [unit of the band]."""
        return np.einsum("sb,sij->bij", self.colours, self.patterns, dtype=np.float32)


def implants(inside: Mask, bands: Sequence[Band], level: Float32, width: float, seed: int) -> Implants:
    """Make the signals for a tile with these bands: textures, discs, plumes and targets.

    inside : (row, column), True where pixels are evaluated
    level : (band,) brightness of the water [unit of the band]
    width : width of the smallest object to keep [pixel]
    seed : a different number for each tile
    """
    rng, shape = np.random.default_rng((SEED, seed)), inside.shape
    wavelengths, through = _wavelengths(bands), _submerged(bands, level)
    turbid = np.interp(wavelengths, *TURBID.T).astype(np.float32) * level
    spectral = [bool(b.wavelength) for b in bands]  # a class or a product has no brightness
    white = np.full(len(bands), WHITE_TARGET * float(level[spectral if any(spectral) else ...].max()), np.float32)
    patterns = {f"texture of {a} to {b} pixels": (_texture(shape, a, b, rng), through) for a, b in pairwise(SCALES)}
    patterns["discs"] = _discs(inside, width, rng), through
    patterns["plumes"] = _plume(shape, rng), turbid
    patterns["targets of 2 pixels"] = _targets(shape, rng), white
    return Implants(tuple(patterns), *map(np.stack, zip(*patterns.values(), strict=True)))


def discs(inside: Mask, bands: Sequence[Band], level: Float32, width: float, seed: int) -> Float32:
    """Discs to add to a tile, (band, row, column). The arguments are those of `implants`, but places differ."""
    pattern = _discs(inside, width, np.random.default_rng((SEED, seed)))
    return np.asarray(_submerged(bands, level)[:, None, None] * pattern, np.float32)


def gains(
    responses: Sequence[Float32], added: Sequence[Implants], inside: Sequence[Mask], unit: Float32
) -> dict[str, float]:
    """Gain of each signal, by name, from a least squares fit of the patterns to the responses in all tiles and bands.

    The mean of each tile is subtracted first: signals also shift the fitted level (glint-free NIR); this is no gain.

    responses : (band, row, column) of each tile: results of a recipe with the signals minus its results without them
    added : signals of each tile
    inside : (row, column) of each tile, True where pixels are used
    unit : (band,) divisor of each band [unit of the band]; infinite for bands that are not evaluated
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


def _wavelengths(bands: Sequence[Band]) -> Float64:
    """Wavelength of each band, (band,) [nm]; 480 (blue, in which all signals are visible) for a band without one."""
    return np.array([b.wavelength or 480.0 for b in bands])


def _submerged(bands: Sequence[Band], level: Float32) -> Float32:
    """Colour of a white signal under `DEPTH` metres of water, (band,) [unit of the band]; `level` as in `implants`."""
    seen = case1(np.clip(_wavelengths(bands), *WAVELENGTH_RANGE), CHLOROPHYLL).absorption
    return np.exp(-DEPTH * seen).astype(np.float32) * level


def _texture(shape: tuple[int, int], fine: int, coarse: int, rng: np.random.Generator) -> Float32:
    """Random pattern (row, column) of scales from `fine` to `coarse` [pixel]; standard deviation `TEXTURE_CONTRAST`."""
    noise = rng.standard_normal(shape).astype(np.float32)
    band = cv2.blur(noise, (fine, fine)) - cv2.blur(noise, (coarse, coarse))
    return np.asarray(band * np.float32(TEXTURE_CONTRAST / band.std()), np.float32)


def _discs(inside: Mask, width: float, rng: np.random.Generator) -> Float32:
    """Contrast (row, column) of discs of a `width` [pixel], half of them bright and half dark; 0 elsewhere.

    The centres lie near a grid that starts where `inside` starts; its pitch is four widths, at least 16 pixels.
    """
    out, pitch = np.zeros(inside.shape, np.float32), max(round(4 * width), 16)
    top, left = (int(np.argmax(inside.any(axis=a))) + pitch // 2 for a in (1, 0))
    places = [(r, c) for r in range(top, len(inside), pitch) for c in range(left, inside.shape[1], pitch)]
    for (row, column), n in zip(places, rng.permutation(len(places)), strict=True):
        centre = int(column + rng.integers(-2, 3)), int(row + rng.integers(-2, 3))
        cv2.circle(out, centre, max(round((width - 1) / 2), 0), BRIGHT if n % 2 else DARK_DISC, -1)
    return out


def _plume(shape: tuple[int, int], rng: np.random.Generator) -> Float32:
    """Contrast (row, column): Gaussian of height `PLUME` near the middle; sigma is 1/5 of the tile's shorter side."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    row, column = rng.uniform(0.25, 0.75, 2) * shape
    squares = (rows - row) ** 2 + (columns - column) ** 2
    return np.asarray(PLUME * np.exp(-squares / (2 * (0.2 * min(shape)) ** 2)), np.float32)


def _targets(shape: tuple[int, int], rng: np.random.Generator) -> Float32:
    """Contrast (row, column) of targets: 1 in squares of 2 x 2 pixels, about 24 pixels apart; 0 elsewhere."""
    out = np.zeros(shape, np.float32)
    for row, column in product(*(range(12, n - 2, 24) for n in shape)):
        r, c = row + int(rng.integers(-4, 5)), column + int(rng.integers(-4, 5))
        out[r : r + 2, c : c + 2] = 1.0
    return out
