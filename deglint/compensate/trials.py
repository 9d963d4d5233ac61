"""Trials of a compensation: seas whose truth is known, made of a scene's own level, sparkle and noise.

What a tile has above and below its level is laid on the same level elsewhere, all bands alike, so that what bands
share stays shared: a bootstrap of blocks of residuals. Noise is laid down as large as it is there: it grows with the
brightness, and a bright object sinks by its own noise, not by that of the deep water around it. What was replaced is
sparkle, and is laid down as it is.

A trial knows a smoother truth than the scene has: its level has lost already what the chain takes off. So its errors
are too small, by a factor that a second trial tells, made of what the first one found: as the second is to the
first, the first is to the scene (an iterated bootstrap). And it takes for noise what is the water's own from pixel to
pixel, sky in the waves, which no level follows. That is seen in what neighbouring clean pixels share about the level;
errors of the level are in that, too. A trial shares both once more: what was moved with the rest, and errors of the
level that it found. So what the scene shares, less what the trial shares beyond that, is the water's own.

References
----------
Efron (1979), Annals of Statistics 7, 1-26, doi:10.1214/aos/1176344552 (the bootstrap, of residuals in its section 7);
Kuensch (1989), Annals of Statistics 17, 1217-1241, doi:10.1214/aos/1176347265 (whole blocks of them, where neighbours
depend on each other); Hall, Martin (1988), Biometrika 75, 661-671, doi:10.1093/biomet/75.4.661 (a bootstrap that is
tried on itself)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ._variances import Float64
from .noise import noise_by_level
from .state import Float32Array, Mask

NO_NOISE = 4.0
"""Standard deviations from the level beyond which nothing is noise."""


@dataclass(frozen=True, eq=False)
class Sea:
    """A sea on its level.

    Attributes
    ----------
    values, level : (band, row, column) float32 ndarray
        What there is, and the level of the water in it.
    replaced : bool ndarray
        What a compensation replaces.
    usable : (row, column) bool ndarray
        Pixels of which all of this is known.
    """

    values: Float32Array
    level: Float32Array
    replaced: Mask
    usable: Mask

    def laid(self, scale: Float32Array, by: tuple[int, int]) -> Float32Array:
        """What is above and below the level, laid on the same level so many rows and columns further.

        Parameters
        ----------
        scale : (band, row, column) float32 ndarray
            Standard deviation of noise.
        by : (int, int)
            Around the edges.

        Returns
        -------
        (band, row, column) float32 ndarray
            The sea's own values where it is not usable.
        """
        out = self.values.copy()
        for b, there in enumerate(scale):
            rest = np.where(self.usable, self.values[b] - self.level[b], np.float32(0))
            here = np.roll(there, by, axis=(0, 1))
            noise = ~np.roll(self.replaced[b], by, axis=(0, 1)) & (here > 0)
            larger = np.divide(there, here, out=np.ones_like(there), where=noise)
            np.copyto(out[b], self.level[b] + larger * np.roll(rest, by, axis=(0, 1)), where=self.usable)
        return out

    def steady(self, scale: Float32Array) -> Sea:
        """The same on a level that holds all that is neither noise nor sparkle: pixels that were not replaced, and lie
        further from the level than noise does, are edges of things, and tops of some that sank in an opening.

        Parameters
        ----------
        scale : (band, row, column) float32 ndarray
            Standard deviation of noise.
        """
        own = self.usable & ~self.replaced & (scale > 0) & (np.abs(self.values - self.level) > NO_NOISE * scale)
        return replace(self, level=np.where(own, self.values, self.level))

    def noise(self) -> Float32Array:
        """Standard deviation of noise at each pixel, as the level there has it."""
        out = np.zeros_like(self.level)
        for b, level in enumerate(self.level):
            fixed, growing = noise_by_level(np.where(self.usable, self.values[b] - level, np.float32(np.nan)), level)
            out[b] = np.sqrt(fixed + growing * np.where(self.usable, np.maximum(level, 0), np.float32(0)))
        return out


@dataclass(frozen=True, eq=False)
class Trial:
    """What the chain, and the removal in it, made of a sea that is known.

    Attributes
    ----------
    error : (band, row, column) float32 ndarray
        What was made of it, less the truth.
    replaced : bool ndarray
        What the chain replaced.
    where : (row, column) bool ndarray
        Pixels to look at.
    level : float32 ndarray
        The level that was found, after removal.
    away : float32 ndarray
        What was made of it, less that.
    """

    error: Float32Array
    replaced: Mask
    where: Mask
    level: Float32Array
    away: Float32Array

    def errors(self, band: int) -> Float64:
        """Errors of the pixels that were replaced, in row-major order."""
        return self.error[band][self.of(band)].astype(np.float64)

    def of(self, band: int) -> Mask:
        """Pixels that were replaced, and are known."""
        return np.asarray(self.where & self.replaced[band] & np.isfinite(self.error[band]))

    def shared(self, band: int, most: float = np.inf) -> Float64:
        """`shared`, of pixels that were not replaced and whose level is no higher than this."""
        clean = self.where & ~self.replaced[band] & np.isfinite(self.away[band])
        return shared(self.away[band], clean & (self.level[band] <= most))

    def moments(self) -> Float64:
        """Of each band: how many pixels were replaced, the sum of their errors, and of the squares, (band, 3)."""
        found = [self.errors(b) for b in range(len(self.error))]
        return np.array([(e.size, e.sum(), (e**2).sum()) for e in found]).reshape(-1, 3)


def shared(away: Float64 | Float32Array, clean: Mask) -> Float64:
    """What clean pixels beside each other have in common: the sum of products about the mean, and how many.

    Parameters
    ----------
    away : (row, column) ndarray
        How far pixels lie above their level.
    clean : (row, column) bool ndarray

    Returns
    -------
    (2,) float64 ndarray
    """
    if not clean.any():
        return np.zeros(2)
    about = np.where(clean, away - away[clean].mean(dtype=np.float64), 0.0)
    products = (about[1:] * about[:-1]).sum() + (about[:, 1:] * about[:, :-1]).sum()
    return np.array([products, (clean[1:] & clean[:-1]).sum() + (clean[:, 1:] & clean[:, :-1]).sum()], np.float64)


def own(scene: Float64, tried: Float64) -> float:
    """Variance of the water's own brightness from pixel to pixel.

    Parameters
    ----------
    scene, tried : (2,) float64 ndarray
        `shared` of the scene and of its trials, summed over tiles.

    Returns
    -------
    float
        0 or more.
    """
    here, there = (products / max(count, 1.0) for products, count in (scene, tried))
    return max(float(2 * here - there), 0.0)


def growth(first: Float64, second: Float64) -> float:
    """By what factor variances of a first trial are larger than those of a second, in the mean of the bands.

    Parameters
    ----------
    first, second : (band, 3) float64 ndarray
        `Trial.moments`, summed over tiles.

    Returns
    -------
    float
        1 or more; 1 where nothing was replaced.
    """
    count = np.maximum(np.stack([first[:, 0], second[:, 0]]), 1.0)
    sums, squares = (np.stack([first[:, i], second[:, i]]) for i in (1, 2))
    variance = squares / count - (sums / count) ** 2
    known = (variance > 0).all(axis=0)
    if not known.any():
        return 1.0
    return max(float(np.exp(np.log(variance[0, known] / variance[1, known]).mean())), 1.0)
