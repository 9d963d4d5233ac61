"""The bottom of a shallow sea: its depth, and patches of a second material on its ground."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..physics._checks import Checked, Floats, choice, ranged
from .materials import SPECTRA

LEAST_DEPTH, MOST_DEPTH = 0.1, 60.0  # range of depths of a bottom [m]; light from a deeper bottom is negligible


@dataclass(frozen=True, kw_only=True)
class Bottom(Checked):
    """A bottom whose depth changes from the left to the right edge of the image.

    Attributes
    ----------
    depth : (float, float)
        Mean depth at the left and at the right edge of the image [m], 0.1 to 60.
    edge : (float, float), optional
        A reef edge, where the depth changes: distance of its centre from the left edge of the image, and its width [m].
        By default the depth changes linearly over the whole image.
    roughness : float
        Standard deviation of the depth about its mean [m], with features of the size `patch`.
    materials : (str, str)
        Material of the ground and of the patches; see `deglint.simulate.materials.SPECTRA`.
    share, patch : float
        Share of the ground that patches cover [1], 0 to 1, and size of a patch [m].
    """

    depth: tuple[float, float] = ranged((25.0, 3.0), LEAST_DEPTH, MOST_DEPTH, "m", "Leave a deeper bottom out.")
    edge: tuple[float, float] | None = None
    roughness: float = ranged(0.0, 0.0, 20.0, "m", "It is a standard deviation of the depth.")
    materials: tuple[str, str] = ("sand", "algae")
    share: float = ranged(0.4, 0.0, 1.0, "", "Give a share, not per cent.")
    patch: float = ranged(8.0, 1e-2, 1e5, "m", "Give the size of a patch.")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.edge is not None and not self.edge[1] > 0:
            raise InputError(f"edge must have a width above 0 m, got {self.edge[1]:g}; give (middle, width) [m]")
        for name in self.materials:
            choice("material", name, SPECTRA)


def depth_and_patches(
    bottom: Bottom, shape: tuple[int, int], spacing: float, width: float, seed: np.random.SeedSequence
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Depth [m], float32, and mask of the second material, both (row, column), on a grid with the step `spacing` [m].

    The image covers the first `width` [m] of each row. In the second half of the rest of the row, the mean depth is
    the depth at the left edge, because the grid is periodic.
    """
    rough, patchy, bent = seed.spawn(3)
    right = (np.arange(shape[1]) + 0.5) * spacing
    if bottom.edge is None:
        rise = np.clip(right / width, 0.0, 1.0)[None, :]
    else:
        middle, extent = bottom.edge
        line = middle + 0.5 * extent * smooth_noise(shape, spacing, 3.0 * bottom.patch, bent)
        rise = 0.5 + 0.5 * np.tanh(2.0 * (right - line) / extent)
    rise = np.where(right > 0.5 * (width + shape[1] * spacing), 0.0, rise)
    depth = bottom.depth[0] + (bottom.depth[1] - bottom.depth[0]) * rise
    depth = depth + bottom.roughness * smooth_noise(shape, spacing, bottom.patch, rough)
    depth = np.clip(depth, LEAST_DEPTH, MOST_DEPTH).astype(np.float32)
    field = smooth_noise(shape, spacing, bottom.patch, patchy)
    field = field + 0.3 * smooth_noise(shape, spacing, 0.2 * bottom.patch, patchy.spawn(1)[0])
    return depth, field > np.quantile(field, 1.0 - bottom.share)


def smooth_noise(shape: tuple[int, int], spacing: float, size: float, seed: np.random.SeedSequence) -> Floats:
    """Periodic noise of mean 0 and variance 1 with features of a given size [m], (row, column) float32.

    It is white Gaussian noise, smoothed by a Gaussian whose standard deviation is a third of `size`.
    """
    from scipy import fft

    white = np.random.default_rng(seed).standard_normal(shape, np.float32)
    rows, columns = np.fft.fftfreq(shape[0], spacing)[:, None], np.fft.rfftfreq(shape[1], spacing)
    gain = np.exp(-2.0 * (np.pi * size / 3.0) ** 2 * (rows**2 + columns**2)).astype(np.float32)
    field = np.asarray(fft.irfft2(fft.rfft2(white) * gain, s=shape))
    field -= field.mean()
    return np.asarray(field / max(float(field.std()), 1e-12))
