"""The NIR that a removal should follow: not that of ships.

Where bands are (nearly) simultaneous and pixels coarse, a removal takes what stands out in the NIR for glint, and so
darkens ships, surf and wakes. Glint comes in patches and waves with much the same strength all round; a pixel that
exceeds the water around it by more than glint ever does is something else, and its glint is best taken from that water:

.. math:: g_i' = \\bar g_{W(i)} \\quad \\mathrm{where} \\quad g_i > \\bar g_{W(i)} + k s

with the mean over the water in a square, and s the standard deviation of the NIR over deep water about such means (or
twice what one deep pixel in a thousand exceeds them by, where that is more than k s).
Nothing that does not stand out is touched, to the bit. Arrays only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from ..errors import FitError, InputError
from ..scene import FloatArray

Float64 = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SIZE = 15
"""Side of the square in which the water around is looked for [pixel]."""
DEVIATIONS = 8.0
"""Glint does not stand out by more than this many standard deviations,"""
TAIL, TAIL_FACTOR = 99.9, 2.0
"""nor by more than so many times this percentile of what stands out in deep water: sparkle has a long tail."""
LEAST_WATER = 8
"""Water pixels that a mean needs; with fewer the NIR is left as it is."""
AT_ONCE = 1 << 14
"""Squares that are looked at together."""
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
    least : float
        Nothing below this stands out, whatever is around it: the lowest such mean over deep water, and the limit.
    most : float
        Above this the NIR is not that of water, and is in no mean.
    """

    limit: float
    deviation: float
    pixels: int
    size: int = SIZE
    least: float = -np.inf
    most: float = np.inf

    @property
    def halo(self) -> int:
        """Pixels that `reference` needs around a tile: means, of what does not stand out from its own mean."""
        return 2 * (self.size // 2)

    def numbers(self) -> dict[str, Any]:
        """What goes into a sidecar."""
        return asdict(self) | {"halo": self.halo}


def fit_reference(
    looks: Sequence[tuple[FloatArray, BoolArray]],
    *,
    deviations: float = DEVIATIONS,
    size: int = SIZE,
    most: float = np.inf,
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
    most : float
        Above this the NIR is not that of water.

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
    squares, pixels, lowest = 0.0, 0, np.inf
    excesses = []
    for nir, deep in looks:
        _check(nir, deep)
        kept = deep & np.isfinite(nir)
        mean, count = _around(nir, kept, size)
        kept &= count >= LEAST_WATER
        lowest = min(lowest, float(mean[kept].min(initial=np.inf)))
        away = np.asarray(nir[kept], np.float64) - mean[kept]
        excesses.append(away)
        squares += float((away**2).sum())
        pixels += away.size
    if pixels < ENOUGH:
        raise FitError(f"deep water holds {pixels} pixels, need at least {ENOUGH} to know its glint. Widen the sample.")
    deviation = float(np.sqrt(squares / pixels))
    tail = float(np.percentile(np.concatenate(excesses), TAIL))
    limit = max(deviations * deviation, TAIL_FACTOR * tail)
    return ReferenceRule(limit, deviation, pixels, size, lowest + limit, most)


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
    surroundings. Integers are rounded. Cost: one comparison a pixel, and a microsecond for each that is bright
    enough to be looked at.

    Fails: beside land that the mask takes for water, for foam and glint alike weaker than the limit, and for ships
    longer and wider than the square.

    Examples
    --------
    >>> sea = np.full((20, 20), 5.0)
    >>> sea[10, 10] = 50.0
    >>> float(reference(sea, np.ones((20, 20), bool), ReferenceRule(limit=8.0, deviation=1.0, pixels=64))[10, 10])
    5.0
    """
    out = nir.copy()
    found, values = standing_out(nir, water, rule)
    out[found] = np.rint(values) if nir.dtype.kind in "iu" else values
    return out


def standing_out(
    nir: FloatArray, water: BoolArray, rule: ReferenceRule, where: BoolArray | None = None
) -> tuple[BoolArray, Float64]:
    """What stands out from the water around it, and the mean of that water.

    Parameters
    ----------
    nir, water, rule
        As for `reference`.
    where : (row, column) ndarray of bool, optional
        Pixels that are asked about; all by default.

    Returns
    -------
    (row, column) ndarray of bool, (pixels,) float64 ndarray
    """
    _check(nir, water)
    with np.errstate(invalid="ignore"):
        bright = np.isfinite(nir) & (nir > rule.least)
        kept = water & np.isfinite(nir) & (nir <= rule.most)
    asked = np.ones_like(bright) if where is None else where
    found, values = np.zeros_like(bright), np.zeros(0)
    if not (bright & asked).any():
        return found, values
    for _ in range(2):
        rows, columns = np.nonzero(bright)
        mean, count = _means_at(nir, kept, rows, columns, rule.size)
        with np.errstate(invalid="ignore"):
            over = (count >= LEAST_WATER) & (nir[rows, columns] > mean + rule.limit)
        found[...] = False
        found[rows[over], columns[over]] = True
        kept &= ~found
    values = np.zeros(nir.shape)
    values[rows[over], columns[over]] = mean[over]
    found &= asked
    return found, values[found]


def _check(nir: FloatArray, mask: BoolArray) -> None:
    if nir.ndim != 2 or mask.shape != nir.shape:
        raise InputError(f"the NIR and its mask must be (row, column) and alike, got {nir.shape} and {mask.shape}")


def _means_at(
    nir: FloatArray, kept: BoolArray, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp], size: int
) -> tuple[Float64, Float64]:
    """Mean over the kept pixels in the squares around some pixels (NaN: none), and their number."""
    half = size // 2
    values = sliding_window_view(np.pad(np.where(kept, nir, 0.0).astype(np.float64, copy=False), half), (size, size))
    there = sliding_window_view(np.pad(kept, half), (size, size))
    total, count = np.empty(rows.size), np.empty(rows.size)
    for first in range(0, rows.size, AT_ONCE):
        part = slice(first, first + AT_ONCE)
        at = rows[part], columns[part]
        total[part] = values[at].reshape(-1, size * size).sum(axis=1)
        count[part] = there[at].reshape(-1, size * size).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return total / np.where(count > 0, count, np.nan), count


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
