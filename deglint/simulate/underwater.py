"""The bottom of a shallow sea (its depth and materials), and objects under water."""

from collections.abc import Sequence
from dataclasses import MISSING, dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from ..checks import check_choice
from ..errors import InputError
from ..physics._checks import Checked, Floats, ranged
from .materials import SPECTRA

LEAST_DEPTH, MOST_DEPTH = 0.1, 60.0  # range of depths of a bottom [m]; light from a deeper bottom is negligible


@dataclass(frozen=True, kw_only=True)
class Bottom(Checked):
    """A bottom whose depth, always 0.1 to 60 m, changes from the left to the right edge of the image.

    Attributes
    ----------
    depth : (float, float)
        Mean depth at the left and at the right edge of the image [m], 0.1 to 60.
    edge : (float, float), optional
        An irregular reef edge, where the depth changes: mean distance from the left edge of the image, and width [m].
        By default, the depth changes linearly over the whole image.
    roughness : float
        Standard deviation of the depth about the mean depth [m]; rises and hollows of the bottom have the size `patch`.
    materials : (str, str)
        Material of the ground and of the patches; see `deglint.simulate.materials.SPECTRA`.
    share, patch : float
        Share of the ground that patches cover [1], 0 to 1; size of a patch [m], limited to the longer side of the sea.
    """

    depth: tuple[float, float] = ranged((25.0, 3.0), LEAST_DEPTH, MOST_DEPTH, "m", "A deeper bottom is invisible.")
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
            check_choice(name, list(SPECTRA), "material")


def depth_and_patches(
    bottom: Bottom, shape: tuple[int, int], spacing: float, width: float, seed: np.random.SeedSequence
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Depth [m] and mask of patches (True: second material), both (row, column), on a grid with the step `spacing` [m].

    The image covers the first `width` [m] of each row; a margin follows, up to the end of the grid. In the second
    half of the margin, the mean depth is that of the left edge of the image, because the grid is periodic.
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
    """Periodic noise (row, column) of mean 0 and variance 1 with features of a given size [m].

    It is white noise on a grid with the step `spacing` [m], smoothed by a Gaussian of standard deviation `size` / 3;
    a size above the longer side of the grid counts as this side, since a wider Gaussian would leave a constant.
    """
    from scipy import fft

    white = np.random.default_rng(seed).standard_normal(shape, np.float32)
    rows, columns = np.fft.fftfreq(shape[0], spacing)[:, None], np.fft.rfftfreq(shape[1], spacing)
    size = min(size, spacing * max(shape))
    gain = np.exp(-2.0 * (np.pi * size / 3.0) ** 2 * (rows**2 + columns**2)).astype(np.float32)
    field = np.asarray(fft.irfft2(fft.rfft2(white) * gain, s=shape))
    field -= field.mean()
    return np.asarray(field / float(field.std()))


@dataclass(frozen=True, kw_only=True)
class SubmergedObject(Checked):
    """A flat matt (Lambertian) object under water.

    Attributes
    ----------
    corners : tuple of (float, float)
        Corners of the outline, (right, down) from the upper left corner of the image [m].
    reflectance, depth : float
        Reflectance [1], 0 to 1, the same at all wavelengths; depth below the surface [m], 0.1 to 60.
    """

    corners: tuple[tuple[float, float], ...]
    reflectance: float = ranged(MISSING, 0.0, 1.0, "", "Ten per cent is 0.1.")
    depth: float = ranged(5.0, 0.1, 60.0, "m", "A deeper object is invisible.")

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.corners) < 3:
            raise InputError(f"object must have at least 3 corners, got {len(self.corners)}; give its outline [m]")

    def check_inside(self, height: float, width: float) -> None:
        """Check that the object lies within a scene of a height and width [m]. Raises InputError if it does not."""
        right, down = np.asarray(self.corners, dtype=np.float64).T
        if right.min() < 0 or down.min() < 0 or right.max() > width or down.max() > height:
            raise InputError(
                f"object must lie in the scene, 0 to {width:g} m right and 0 to {height:g} m down, got"
                f" {right.min():g} to {right.max():g} and {down.min():g} to {down.max():g} m;"
                " move it, enlarge the scene (--size), or leave objects out (--objects none)"
            )


def square(right: float, down: float, side: float, *, reflectance: float, depth: float = 5.0) -> SubmergedObject:
    """Make a square object from its centre (right, down), side and depth, all in [m], and its reflectance [1].

    Examples
    --------
    >>> square(10.0, 20.0, 4.0, reflectance=0.1).corners[0]
    (8.0, 18.0)
    """
    h = side / 2
    corners = ((right - h, down - h), (right + h, down - h), (right + h, down + h), (right - h, down + h))
    return SubmergedObject(corners=corners, reflectance=reflectance, depth=depth)


def thesis_array(
    size: tuple[int, int],
    gsd: float,
    *,
    reflectances: Sequence[float] = (0.02, 0.05, 0.10, 0.20),
    sides: Sequence[float] | None = None,
    depth: float = 5.0,
) -> tuple[SubmergedObject, ...]:
    """Make squares of several reflectances and sizes, row by row, on the right half of a scene; the left half is empty.

    Parameters
    ----------
    size, gsd : (int, int), float
        Rows and columns of the image [pixel], and the size of a pixel [m].
    reflectances : sequence of float
        Reflectance of each column of squares [1].
    sides : sequence of float, optional
        Side of the squares in each row of squares [pixel], repeated in order until there are size[0] // 64 rows. By
        default, those of 2, 4, 8, 16 that leave gaps between the squares, or 2 if none does.
    depth : float
        Depth of all squares [m].

    Examples
    --------
    >>> len(thesis_array((256, 256), 0.25))
    16
    """
    rows, columns = size
    across = columns / 2 / len(reflectances)
    if sides is None:
        sides = [s for s in (2, 4, 8, 16) if s <= 0.8 * min(across, rows / 4)] or [2]
    count = max(len(sides), rows // 64)
    down = rows / count
    out = []
    for i, (j, reflectance) in product(range(count), enumerate(reflectances)):
        place = (columns / 2 + (j + 0.5) * across) * gsd, (i + 0.5) * down * gsd
        out.append(square(*place, sides[i % len(sides)] * gsd, reflectance=reflectance, depth=depth))
    return tuple(out)


def label(objects: Sequence[SubmergedObject], shape: tuple[int, int], spacing: float) -> npt.NDArray[np.integer[Any]]:
    """Number of the object at each point of a grid, (row, column) uint16: 1 for the first object, 0 for no object.

    Later objects hide earlier ones. The grid has steps of `spacing` [m]; its first point is half a step from the edges.
    """
    from skimage.draw import polygon

    out = np.zeros(shape, dtype=np.uint16)
    for number, target in enumerate(objects, start=1):
        right, down = np.asarray(target.corners, dtype=np.float64).T / spacing - 0.5
        rows, columns = polygon(down - 1e-9, right - 1e-9, shape)  # points on an edge count on one side only
        out[rows, columns] = number
    return out
