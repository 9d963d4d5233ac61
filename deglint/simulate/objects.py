"""Submerged objects: flat Lambertian surfaces that are wide relative to their depth."""

from collections.abc import Sequence
from dataclasses import MISSING, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..physics._checks import Checked, ranged

Labels = npt.NDArray[np.integer[Any]]


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
    depth: float = ranged(5.0, 0.1, 60.0, "m", "Deeper, nothing of it comes back.")

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.corners) < 3:
            raise InputError(f"object must have at least 3 corners, got {len(self.corners)}; give its outline [m]")

    def check_inside(self, height: float, width: float) -> None:
        """Check that the object lies within a scene of this size [m]. Raises InputError: it does not."""
        right, down = np.asarray(self.corners, dtype=np.float64).T
        if right.min() < 0 or down.min() < 0 or right.max() > width or down.max() > height:
            raise InputError(
                f"object must lie in the scene, 0 to {width:g} m right and 0 to {height:g} m down, got"
                f" {right.min():g} to {right.max():g} and {down.min():g} to {down.max():g} m;"
                " move it or enlarge the scene"
            )


def square(right: float, down: float, side: float, *, reflectance: float, depth: float = 5.0) -> SubmergedObject:
    """Make a square object from its centre (right, down), side and depth, all in metres, and its reflectance [1].

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
        Side of the squares in each row [pixel], repeated for further rows; by default those of 2, 4, 8 and 16 that fit.
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
    return tuple(
        square((columns / 2 + (j + 0.5) * across) * gsd, (i + 0.5) * down * gsd, sides[i % len(sides)] * gsd,
               reflectance=reflectance, depth=depth)
        for i in range(count) for j, reflectance in enumerate(reflectances)
    )  # fmt: skip


def label(objects: Sequence[SubmergedObject], shape: tuple[int, int], spacing: float) -> Labels:
    """Number of the object at each point of a grid, (row, column) uint16: 1 for the first object, 0 for no object.

    Later objects hide earlier ones. Points are `spacing` [m] apart; the first lies half as far from both edges.
    """
    from skimage.draw import polygon

    out = np.zeros(shape, dtype=np.uint16)
    for number, target in enumerate(objects, start=1):
        right, down = np.asarray(target.corners, dtype=np.float64).T / spacing - 0.5
        rows, columns = polygon(down - 1e-9, right - 1e-9, shape)  # points on an edge count on one side only
        out[rows, columns] = number
    return out
