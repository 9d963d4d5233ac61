"""Data that pass from stage to stage of a compensation (`State`), and data to which stages are fitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import FitError, InputError
from ..moments import Float64, Mask
from ..remove.noise import noise
from ..remove.spectrum import SUN_ZENITH
from ..scene import ROUNDED, Band, image_bands
from .psf import PSF

Float32 = npt.NDArray[np.float32]
LEAST_DELAY = 0.01  # least time between the first and the last band, in which ripples change [s]
LASTS = 0.1  # time for which a peak of sparkle may stay bright [s]: a quarter of the period of waves of 0.25 m
NEVER = 1e6  # time offset of bands that are no images [s]: far from all others
LARGEST = 1e15  # sums of the squares of larger numbers exceed float32


@dataclass(frozen=True, eq=False)
class State:
    """A block of a scene and the results of the stages so far. Stages do not modify its arrays, (band, row, column)."""

    raw: Float32  # the block as read; finite everywhere
    image: Float32  # the block after the stages so far; finite everywhere
    water: Mask  # (row, column), valid water; other pixels have the values of the nearest water
    sharp: Float32 | None = None  # the image after deconvolution, from which the background is determined
    psfs: tuple[PSF, ...] | None = None  # PSF of each band, as used for the deconvolution
    unit: Float32 | None = None  # (band,) divisor of the normalised image; None if it is not normalised
    background: Float32 | None = None  # the bands without glint, as estimated
    glint: Mask | None = None  # glint pixels that are not replaced yet
    replaced: Mask | None = None  # pixels that were replaced
    targets: Float32 | None = None  # contrast of small bright targets with the water, which is restored at the end
    removed: Float32 | None = None  # glint that the removal subtracted
    variance: Float32 | None = None  # variance of the error of `image` [unit of the image squared]
    origin: tuple[int, int] = (0, 0)  # row and column of the block's first pixel in the scene
    errors: bool = False  # whether stages compute `variance`

    @classmethod
    def of(cls, block: npt.NDArray[Any], water: Mask | None = None, origin: tuple[int, int] = (0, 0)) -> Self:
        """Initial state of a block (band, row, column); `origin` is the row and column of its first pixel in the scene.
        Pixels that are not finite in a band, or not in the mask `water` (row, column; None: all is water), get the
        values of the nearest water pixel. Raises InputError if values of water exceed `LARGEST`.
        """
        valid = np.isfinite(block).all(axis=0)
        water = valid if water is None else water & valid
        with np.errstate(over="ignore"):
            image = filled(np.asarray(block, np.float32), water)
        if np.abs(image).max(initial=0) > LARGEST:
            raise InputError(
                f"values reach {np.abs(block[:, water]).max():.3g}; compensation and --stderr allow {LARGEST:g}. "
                "Rescale them (--scale), declare invalid values as nodata, or use --compensate off without --stderr."
            )
        return cls(image, image, water, origin=origin)


def in_scene_units(state: State) -> State:
    """The state in the unit of the scene. If it was normalised, pixels not replaced get exactly the values as read."""
    if state.unit is None:
        return state
    image = state.image * state.unit[:, None, None]
    image = state.raw if state.replaced is None else np.where(state.replaced, image, state.raw)
    return replace(state, image=image, unit=None, sharp=None, background=None, glint=None)


def filled(block: Float32, water: Mask) -> Float32:
    """The block with each pixel that is not water set to the values of the nearest water pixel; all 0 without water."""
    if water.all():
        return block
    if not water.any():
        return np.zeros_like(block)
    away = cv2.distanceTransformWithLabels((~water).view(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)[1]
    place = np.zeros(int(away.max()) + 1, np.int64)
    place[away[water]] = np.flatnonzero(water)
    out = block.copy()
    out[:, ~water] = block.reshape(len(block), -1)[:, place[away[~water]]]
    return out


@dataclass(frozen=True)
class Setting:
    """Properties of the scene that fitting a chain needs."""

    bands: tuple[Band, ...]  # all bands of the scene
    nir: tuple[int, ...]  # 0-based bands that show glint but no signal of the water
    psfs: tuple[PSF, ...] | None = None  # PSF of each band; None if not known
    pixel: float = 0.0  # side of a pixel on the ground [m]; 0: not known, treated like fine pixels

    @cached_property
    def wavelengths(self) -> Float64:
        """Wavelengths of the bands, (band,) [nm]; NaN where not known."""
        return np.array([b.wavelength or np.nan for b in self.bands])

    @cached_property
    def images(self) -> Mask:
        """Mask (band,) of the bands that are images (`image_bands`)."""
        return np.isin(np.arange(len(self.bands)), image_bands(self.bands, self.nir))

    @cached_property
    def offsets(self) -> Float64 | None:
        """Time offset of each band, (band,) [s]; None if not known for all `images`. It is `NEVER` for other bands."""
        found = np.array([np.nan if b.time_offset is None else b.time_offset for b in self.bands])
        return None if np.isnan(found[self.images]).any() else np.where(self.images, found, NEVER)

    @cached_property
    def delayed(self) -> bool:
        """Whether the times of the `images` are known, and span at least 0.01 s (`LEAST_DELAY`)."""
        return self.offsets is not None and float(np.ptp(self.offsets[self.images])) >= LEAST_DELAY

    @cached_property
    def colour(self) -> Float32:
        """Spectrum of glint, (band,): direct solar irradiance [W m-2 nm-1], 1 in bands that are no `images`; all 1 if
        one of the `images` is not at 300 to 1000 nm.
        """
        from ..physics.atmosphere import irradiance

        waves = self.wavelengths[self.images]
        if not ((waves > 300) & (waves < 1000)).all():
            return np.ones(len(self.bands), np.float32)
        return np.asarray(irradiance(np.where(self.images, self.wavelengths, 550.0), SUN_ZENITH).direct, np.float32)


@dataclass(frozen=True, eq=False)
class Sample:
    """Blocks of a scene, each with its halo and a mask (row, column) that is True where a pixel is used for fitting."""

    states: tuple[State, ...]
    inside: tuple[Mask, ...]

    def values(self, planes: Sequence[Float32]) -> Float32:
        """Values (..., pixel) of the sample, from an array (..., row, column) for each block.
        Raises FitError if the sample has too few pixels.
        """
        found = np.concatenate([p[..., m] for p, m in zip(planes, self.inside, strict=True)], axis=-1)
        if (pixels := found.shape[-1]) < FEWEST:
            raise FitError(f"the sample holds {pixels} pixels, need at least {FEWEST}. Widen the --sample.")
        return found

    def noise_of(self, images: Sequence[Float32]) -> Float64:
        """Standard deviation of the noise of each band, (band,), from an image (band, row, column) for each block."""
        return np.array([noise(planes, self.inside) for planes in zip(*images, strict=True)])


FEWEST = 64  # fewest pixels for a level and a standard deviation
NEARLY, PILED, STEPS = 0.99, 3, 1000
"""A band is saturated at its highest value if at least 3 pixels, and half of the pixels within a percent of it, have
exactly that value. If values of an image have fewer than 1000 steps, pixels are equal by chance."""


def full_scale(sample: Sample, setting: Setting) -> Float64:
    """Value from which a pixel counts as saturated, (band,): 0.999 times the saturation value, infinity if not known.
    The saturation value is the declared one, or the highest value of water if this is lower and many pixels have it.
    """
    found = np.array([np.inf if b.saturation is None else b.saturation for b in setting.bands])
    for b in range(len(found)):
        values = np.concatenate([s.raw[b][s.water] for s in sample.states])
        top = values.max(initial=0)
        near = values[values > NEARLY * top]
        some = np.diff(np.unique(values[:: 1 + values.size // 1000]))
        if np.sum(near == top) >= max(PILED, near.size / 2) and some.size and some.min() * STEPS < top:
            found[b] = min(found[b], top)
    return ROUNDED * found
