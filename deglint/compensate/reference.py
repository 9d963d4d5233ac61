"""The NIR that a removal should follow: not that of ships.

Where bands are (nearly) simultaneous and pixels coarse, a removal takes what stands out in the NIR for glint, and so
darkens ships, surf and wakes. Glint comes in patches and waves with much the same strength all round; a pixel that
exceeds the water around it by more than glint ever does is something else, and its glint is best taken from that water:

.. math:: g_i' = \\bar g_{W(i)} \\quad \\mathrm{where} \\quad g_i > \\bar g_{W(i)} + k s

with the mean over the water in a square, and s the standard deviation of the NIR over deep water about such means.
Nothing that does not stand out is touched, to the bit. Arrays only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import FitError, InputError
from ..scene import FloatArray

Float64 = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SIZE = 15
"""Side of the square in which the water around is looked for [pixel]."""
DEVIATIONS = 8.0
"""Glint does not stand out by more than this many standard deviations."""
LEAST_WATER = 8
"""Water pixels that a mean needs; with fewer the NIR is left as it is."""
ENOUGH = 64
"""Pixels of deep water that a standard deviation needs."""


@dataclass(frozen=True, slots=True)
class ReferenceRule:
    """What stands out: plain numbers.

    Attributes
    ----------
    limit : float
        Above the mean of the water around, in the unit of the NIR.
    deviation : float
        Standard deviation of the NIR of deep water about that mean.
    pixels : int
        Of deep water that it was measured on.
    size : int
        Side of the square [pixel].
    """

    limit: float
    deviation: float
    pixels: int
    size: int = SIZE

    @property
    def halo(self) -> int:
        """Pixels that `reference` needs around a tile: means, of what does not stand out from its own mean."""
        return 2 * (self.size // 2)

    def numbers(self) -> dict[str, Any]:
        """What goes into a sidecar."""
        return asdict(self) | {"halo": self.halo}


def fit_reference(
    looks: Sequence[tuple[FloatArray, BoolArray]], *, deviations: float = DEVIATIONS, size: int = SIZE
) -> ReferenceRule:
    """Measure over deep water how far glint makes the NIR differ from its surroundings.

    Parameters
    ----------
    looks : sequence of (nir, deep)
        Each (row, column): the NIR, NaN not valid, and where the deep-water sample is.
    deviations : float
        Of these, what glint never exceeds.
    size : int
        Side of the square, odd, 3 or more [pixel].

    Returns
    -------
    ReferenceRule

    Raises
    ------
    InputError
        Shapes that do not match, an even size, or a limit that is not positive.
    FitError
        Too few pixels of deep water.
    """
    if size < 3 or size % 2 == 0:
        raise InputError(f"size of the square must be odd and at least 3; got {size}")
    if not deviations > 0:
        raise InputError(f"deviations must be above 0, got {deviations}")
    squares, pixels = 0.0, 0
    for nir, deep in looks:
        _check(nir, deep)
        kept = deep & np.isfinite(nir)
        mean, count = _around(nir, kept, size)
        kept &= count >= LEAST_WATER
        away = np.asarray(nir[kept], np.float64) - mean[kept]
        squares += float((away**2).sum())
        pixels += away.size
    if pixels < ENOUGH:
        raise FitError(f"deep water holds {pixels} pixels, need at least {ENOUGH} to know its glint. Widen the sample.")
    deviation = float(np.sqrt(squares / pixels))
    return ReferenceRule(limit=deviations * deviation, deviation=deviation, pixels=pixels, size=size)


def reference(nir: FloatArray, water: BoolArray, rule: ReferenceRule) -> FloatArray:
    """The NIR to follow instead of the one that is given.

    Parameters
    ----------
    nir : (row, column) ndarray
        NaN not valid; `rule.halo` more pixels on every side of what is wanted.
    water : (row, column) ndarray of bool
        Where it is taken from; all that is valid, if nothing better is known.
    rule : ReferenceRule

    Returns
    -------
    (row, column) ndarray of the dtype of `nir`
        A copy; the same to the bit where nothing stands out, or where there is no water around.

    Raises
    ------
    InputError
        Shapes that do not match.

    Notes
    -----
    What stands out from a first mean is left out of a second one, so that a ship does not raise its own
    surroundings. Integers are rounded. Cost: some 100 ns per pixel.

    Fails: beside land that the mask takes for water, for foam and glint alike weaker than the limit, and for ships
    longer and wider than the square.

    Examples
    --------
    >>> sea = np.full((20, 20), 5.0)
    >>> sea[10, 10] = 50.0
    >>> float(reference(sea, np.ones((20, 20), bool), ReferenceRule(limit=8.0, deviation=1.0, pixels=64))[10, 10])
    5.0
    """
    _check(nir, water)
    out = nir.copy()
    valid = np.isfinite(nir)
    kept = water & valid
    if not kept.any():
        return out
    for _ in range(2):
        mean, count = _around(nir, kept, rule.size)
        with np.errstate(invalid="ignore"):
            stands_out = valid & (count >= LEAST_WATER) & (nir > mean + rule.limit)
        kept &= ~stands_out
    where = np.nonzero(stands_out)
    out[where] = np.rint(mean[where]) if nir.dtype.kind in "iu" else mean[where]
    return out


def _check(nir: FloatArray, mask: BoolArray) -> None:
    if nir.ndim != 2 or mask.shape != nir.shape:
        raise InputError(f"the NIR and its mask must be (row, column) and alike, got {nir.shape} and {mask.shape}")


def _around(nir: FloatArray, kept: BoolArray, size: int) -> tuple[Float64, Float64]:
    """Mean over the kept pixels in the square around each pixel (NaN: none), and their number."""
    values = np.where(kept, nir, 0.0)
    count = _box(kept.astype(np.float64), size)
    with np.errstate(invalid="ignore", divide="ignore"):
        return _box(values, size) / np.where(count > 0, count, np.nan), count


def _box(values: Float64, size: int) -> Float64:
    """Sums over squares, each put together from the same parts in the same order wherever the tile begins."""
    padded = np.pad(values, size // 2)
    return _run(_run(padded, size).T, size).T


def _run(values: Float64, size: int) -> Float64:
    length = len(values) - size + 1
    total = np.zeros((length, *values.shape[1:]))
    offset, power, part = 0, 1, values
    while power <= size:
        if size & power:
            total += part[offset : offset + length]
            offset += power
        if 2 * power <= size:
            part = part[:-power] + part[power:]
        power *= 2
    return total
