"""Where there is glint at all, as the NIR tells: elsewhere removal would only do harm.

Removal subtracts from a band a mixture of other bands. Where no glint is, that mixture is their noise, and whatever
else they show: things under water that the red still sees, shoals, the sky in the waves. A part of a scene in the lee,
or beyond the glint's edge, has nothing to gain and all that to lose. So the NIR is looked at in cells of a grid that is
the scene's own: how much it varies in a cell, and how far the cell's mean m stands above the level L0 without glint,

    e = var / s^2 - 1 + max(m - L0 - 4 t, 0)^2 / s^2,

where s is the standard deviation in cells without glint, and t that of their means: noise, and mirrored sky, which
varies from place to place. e is 0 without glint, which adds its variance, and its mean. There is none below `CALM`,
nothing but to remove it above `CLEAR` (both higher in a cell that has fewer pixels, by the square root of that), and in
between it is removed in part. A cell counts as the one of the nine about it that has most, and between their middles it
is interpolated (two lines), so that all of a cell with glint is done with.

L0 is told by means over squares of 64 x 64 pixels in the sample: the median of those that lie less than the noise's
standard deviation (the spread of the NIR about its opened level) above their 2nd percentile. s is the median of cells
that lie no further above L0, and t how far means of cells lie below it: glint only adds. Both are at most 1.5 times the
noise's.

Where bands see the sea at one instant, a cell without glint in the NIR has none in any band, and is passed as it is.
Where they do not, another band may have caught a flash there: removal is left out, and what follows it, and of what an
opening takes from faint pixels half is given back (`deglint.compensate.faint`). But where flashes are dense, none is
far from those of the NIR: if so many as the sample has would hardly leave out `FAR` cells about one by chance, and such
cells have no glint in any band of it, they are passed as they are, too.

Assumes that the sensor's noise in the NIR is even. Fails where glint lies so evenly over a whole sample that no part of
it is without: then it is part of L0, as of every other level. Bright things and land in the NIR pass for glint: there
everything is done as without this. Costs 0.1 ns a pixel and band of eight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray

Mask = npt.NDArray[np.bool_]
Share = npt.NDArray[np.float32]

CELL = 16
"""Side of a cell [pixel]; the grid begins at the scene's first pixel."""
FAR = 4
"""Cells around one that must be without glint in the NIR for other bands of other instants to have none."""
CALM = 3.0
"""Excess e up to which there is no glint: 34 standard deviations of that of white noise, but sky in waves is none."""
CLEAR = 4.0
"""Excess from which on there is nothing but to remove it."""
WIDE = 64
"""Side of the squares whose means tell the glint-free level [pixel]."""
PERCENTILE = 2.0
"""Of those means, from which on they are without glint."""
BEYOND = 4.0
"""How many times their spread means of cells may lie above the level without glint."""
MOST = 1.5
"""Standard deviation in cells without glint, and of their means, at most [standard deviations of noise]."""
_FURTHEST, _STEPS = 128.0, 256.0  # furthest that one pixel counts, and steps of a unit: a cell stays below 2^31


@dataclass(frozen=True)
class Presence:
    """Where glint is, by one band.

    Attributes
    ----------
    band : int
        0-based; the NIR.
    level : float
        Of the band without glint, in the scene's unit.
    within, spread : float
        Standard deviation in cells without glint, and of their means, in the same.
    quiet : int
        Cells around one that must be without glint in the NIR for no band to have any: 1 where bands see the sea at one
        instant, `FAR` where the sample shows that, and 0 where nothing is known of other bands.
    """

    band: int
    level: float
    within: float
    spread: float = 0.0
    quiet: int = 0

    @property
    def halo(self) -> int:
        """Pixels around a tile that its shares look at, at most."""
        return (2 * max(self.quiet, 1) + 3) * CELL // 2

    def numbers(self) -> dict[str, Any]:
        """What goes into a sidecar."""
        return asdict(self) | {"cell": CELL, "calm": CALM, "clear": CLEAR}

    def cells(self, block: FloatArray, row: int, column: int) -> Cells:
        """How much of what compensation does is to be done in the cells that a block holds.

        Parameters
        ----------
        block : (band, row, column) float32 or float64 ndarray
            As it was read, NaN where not valid; not modified.
        row, column : int
            Where it begins in the scene.
        """
        from ._presence_kernels import sum_cells

        band = block[self.band]
        rows, columns = (_edges(begin, length) for begin, length in zip((row, column), band.shape, strict=True))
        level, scale, most, steps = (np.float32(x) for x in (self.level, 1 / self.within, _FURTHEST, _STEPS))
        count, total, square = sum_cells(band, rows, columns, level, scale, most, steps)
        known = np.maximum(count, 1)
        mean = total / (_STEPS * known)
        above = np.maximum(mean - BEYOND * self.spread / self.within, 0)
        excess = (square / (_STEPS * known) - mean**2) * known / np.maximum(known - 1, 1) - 1 + above**2
        shares = (excess * np.sqrt(count) / CELL - CALM) / (CLEAR - CALM)
        shares = np.where(count > 0, np.clip(shares, 0, 1), 1).astype(np.float32)
        return Cells(shares, row // CELL, column // CELL)


@dataclass(frozen=True, eq=False)
class Cells:
    """Shares of cells, (row, column) of cells, and the first of them in the scene's grid."""

    shares: Share
    row: int
    column: int

    def inside(self, mask: Mask, row: int, column: int) -> Share:
        """Shares of the cells whose middles lie in a mask, which begins there in the scene."""
        rows, columns = (
            (first + np.arange(n)) * CELL + CELL // 2 - begin
            for first, n, begin in zip((self.row, self.column), self.shares.shape, (row, column), strict=True)
        )
        rows, columns = np.clip(rows, 0, mask.shape[0] - 1), np.clip(columns, 0, mask.shape[1] - 1)
        return self.shares[mask[np.ix_(rows, columns)]]

    def share(self, rows: tuple[int, int], columns: tuple[int, int], around: int = 1) -> Share | None:
        """The same pixel by pixel.

        Parameters
        ----------
        rows, columns : (int, int)
            Where the pixels lie in the scene, half-open.
        around : int
            Cells around one that count as it does if they have more.

        Returns
        -------
        (row, column) float32 ndarray or None
            From 0 to 1; None where it is 1 everywhere.
        """
        (above, below, down), (before, after, right) = (
            _between(*ends, first, count)
            for ends, first, count in zip((rows, columns), (self.row, self.column), self.shares.shape, strict=True)
        )
        shares = _largest(self.shares, around)
        if (shares[above[0] : below[-1] + 1, before[0] : after[-1] + 1] == 1).all():
            return None
        lines = np.ascontiguousarray(shares[:, before] + right * (shares[:, after] - shares[:, before]))
        found: Share = lines[above] + down[:, None] * (lines[below] - lines[above])
        return found


def fit(looks: Sequence[tuple[FloatArray, Mask]], band: int, sigma: float, *, quiet: int = 0) -> Presence | None:
    """Measure the glint-free level of the NIR.

    Parameters
    ----------
    looks : sequence of (nir, inside)
        (row, column) each: the band, and its pixels of water.
    band : int
        0-based.
    sigma : float
        Standard deviation of its noise.
    quiet : int
        As `Presence` has it.

    Returns
    -------
    Presence or None
        None where no square of the sample is at least half water, or the band has no noise to go by.

    Examples
    --------
    >>> sea = np.random.default_rng(1).normal(5, 1, (128, 128)).astype(np.float32)
    >>> sea[:, :64] += 9 * (np.arange(64) % 4 == 0)
    >>> told = fit([(sea, np.ones(sea.shape, bool))], 0, 1.0)
    >>> share = told.cells(sea[None], 0, 0).share((0, 128), (0, 128))
    >>> float(share[:, :64].min()), float(share[:, 88:].max())
    (1.0, 0.0)
    """
    squares, means, variances = (np.empty(0) for _ in range(3))
    for nir, inside in looks:
        known = inside & np.isfinite(nir)
        middle = nir[known].mean(dtype=np.float64) if known.any() else 0.0
        values = np.where(known, nir - middle, 0).astype(np.float64)
        count, total, square = (_summed(x, CELL) for x in (known.astype(np.float64), values, values**2))
        enough = count >= CELL**2 / 2
        mean = total[enough] / count[enough]
        means = np.append(means, mean + middle)
        variances = np.append(variances, square[enough] / count[enough] - mean**2)
        count, total = (_summed(x, WIDE // CELL) for x in (count, total))
        enough = count >= WIDE**2 / 2
        squares = np.append(squares, total[enough] / count[enough] + middle)
    if not squares.size or not sigma > 0:
        return None
    lowest = np.sort(squares)[int(PERCENTILE / 100 * squares.size)]
    level = float(np.median(squares[(squares >= lowest) & (squares <= lowest + sigma)]))
    near = means <= level + sigma
    below = means[means <= level] - level
    within = float(np.sqrt(np.median(variances[near]))) if near.any() else sigma
    spread = float(np.sqrt((below**2).mean())) if below.size else 0.0
    return Presence(band, level, float(np.clip(within, sigma, MOST * sigma)), float(min(spread, MOST * sigma)), quiet)


def presence_from(data: Mapping[str, Any]) -> Presence:
    """Read back what `Presence.numbers` says.

    Raises
    ------
    KeyError, TypeError, ValueError
        Not such numbers.
    """
    level, within, spread = (float(data[name]) for name in ("level", "within", "spread"))
    told = Presence(int(data["band"]), level, within, spread, int(data["quiet"]))
    if not (within > 0 and spread >= 0 and np.isfinite([level, within, spread]).all() and told.quiet in (0, 1, FAR)):
        raise ValueError(f"presence of glint above {level}, {within} in cells and {spread} of them, quiet {told.quiet}")
    return told


def blend(after: FloatArray, before: FloatArray, share: Share) -> None:
    """Take back what was done to a block, all but a share of it; to the bit where that is 0 or 1.

    Parameters
    ----------
    after : (band, row, column) ndarray
        What was made of the block; overwritten.
    before : (band, row, column) ndarray
    share : (row, column) float32 ndarray
    """
    from ._presence_kernels import blended
    from .glance import block

    blended(block(after, written=True), block(before), np.ascontiguousarray(share), len(after))


def _summed(values: npt.NDArray[np.float64], side: int) -> npt.NDArray[np.float64]:
    """Sums over whole squares."""
    rows, columns = (n // side for n in values.shape)
    cut = values[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return np.asarray(cut.sum(axis=(1, 3)))


def _largest(shares: Share, around: int) -> Share:
    """The largest of so many about each."""
    import cv2

    if not around:
        return shares
    return np.asarray(cv2.dilate(shares, np.ones((2 * around + 1, 2 * around + 1), np.uint8)))


def _edges(begin: int, length: int) -> npt.NDArray[np.int64]:
    """Edges of the cells in a stretch of the scene, counted from its beginning; the first and last may be parts."""
    inner = np.arange((begin // CELL + 1) * CELL, begin + length, CELL) - begin
    return np.concatenate([[0], inner, [length]])


def _between(
    begin: int, end: int, first: int, count: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Share]:
    """For each pixel of a stretch the cells whose middles it lies between, and how far it is from the first of them."""
    at = (np.arange(begin, end) + 0.5) / CELL - 0.5
    low = np.floor(at).astype(np.int64)
    down = (at - low).astype(np.float32)
    return np.clip(low - first, 0, count - 1), np.clip(low + 1 - first, 0, count - 1), down
