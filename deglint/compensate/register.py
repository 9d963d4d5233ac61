"""How far a band lies off the NIR, and the NIR moved to the band's place.

Bands that look at different times, or that were not laid on each other well, see the same wave in different places. A
shift of a part of a pixel halves what the NIR explains of a band. The shift is found from the waves themselves, with
its standard error, and is called useful only where the NIR explains more with it, beyond chance. Arrays only.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from .psf import Float64Array
from .sharpen import SLAB, BoolArray, Float32Array, mirrored

Sums = tuple[Float64Array, Float64Array, float]

CELL = 32
"""Side of the cells that are summed by themselves and left out in turn for the standard errors [pixel]."""
LAGS = 6
"""Largest lag that is looked at, each way [pixel]."""
MAX_SHIFT = 3.0
"""Largest shift that is told [pixel]."""
TREND = 15
"""Side of the square over which a mean is taken off both bands [pixel]."""
TAPS = 3
"""The kernel that moves reaches this far from the point, each way: Lanczos 3."""
SMOOTHINGS = (0.0, 1.0)
"""Standard deviations of a Gaussian over the covariances, of which the one that explains more is taken [pixel]. Without
it aliases pull sparkle to whole pixels; with it swell, which may move otherwise than sparkle, counts for more."""
LEAST_CELLS = 8
"""Fewer cells give no standard error."""
LEAST_PIXELS = 256
"""Pixels below which a cell is left out."""
GROUPS = 32
"""The cells are left out in so many groups, at most."""
SURE = 3.0
"""Standard errors by which a shift differs from 0, and by which R2 rises, to be called useful."""


@dataclass(frozen=True, eq=False)
class ShiftStatistics:
    """Covariances of a band with the NIR, cell by cell; those of several tiles may be merged.

    Attributes
    ----------
    cross : (cell, 13, 13) float64 ndarray
        Of the band with the NIR that lies -6..6 pixels further down and right.
    own : (cell, 13, 13) float64 ndarray
        Of the NIR with itself, likewise.
    variance : (cell,) float64 ndarray
        Of the band.
    pixels : int
        In all cells.
    """

    cross: Float64Array
    own: Float64Array
    variance: Float64Array
    pixels: int

    @classmethod
    def merge(cls, parts: Iterable[ShiftStatistics]) -> ShiftStatistics:
        """The cells of all parts, in the order given.

        Raises
        ------
        InputError
            There are no parts.
        """
        parts = list(parts)
        if not parts:
            raise InputError("no statistics to merge: give at least one part.")
        cross, own, variance = (np.concatenate([getattr(p, n) for p in parts]) for n in ("cross", "own", "variance"))
        return cls(cross, own, variance, sum(p.pixels for p in parts))


@dataclass(frozen=True)
class Shift:
    """How far the NIR is to be moved to lie on a band.

    Attributes
    ----------
    row, column : float
        Down and right [pixel].
    row_error, column_error : float
        Standard errors, from cells left out in turn [pixel]; NaN where there are too few cells.
    r2, r2_shifted : float
        Share of the band's variance (local mean taken off) that the NIR explains as it lies, and moved.
    gain_error : float
        Standard error of the difference of the two.
    pixels : int
        That were used.
    useful : bool
        Whether the NIR should be moved.
    reason : str
        What was decided, in one line.
    """

    row: float
    column: float
    row_error: float
    column_error: float
    r2: float
    r2_shifted: float
    gain_error: float
    pixels: int
    useful: bool
    reason: str

    @property
    def halo(self) -> int:
        """Pixels that `apply_shift` needs around a tile; 0 where the shift is not used."""
        return shift_halo(self.row, self.column) if self.useful else 0

    def numbers(self) -> dict[str, Any]:
        """Everything as plain numbers, for a sidecar."""
        return {**asdict(self), "halo": self.halo}


@dataclass(frozen=True, slots=True)
class Move:
    """A NIR band, moved for a band to follow.

    Attributes
    ----------
    band, nir : int
        0-based bands of the scene.
    row, column : float
        Down and right [pixel].
    """

    band: int
    nir: int
    row: float
    column: float


def shift_halo(row: float, column: float) -> int:
    """Pixels that moving by so much needs around a tile."""
    return int(np.floor(max(abs(row), abs(column)))) + TAPS


def shift_statistics(band: npt.NDArray[Any], nir: npt.NDArray[Any], mask: BoolArray | None = None) -> ShiftStatistics:
    """What `shift_from` needs to know of a tile.

    Parameters
    ----------
    band, nir : (row, column) ndarray
        Any unit; NaN is not valid.
    mask : (row, column) ndarray of bool, optional
        Water; all by default.

    Returns
    -------
    ShiftStatistics
        Of the whole cells of 32 x 32 pixels in the tile, or of the tile itself where it is smaller. Pixels within 6
        pixels of what is not valid are left out.

    Raises
    ------
    InputError
        Shapes that differ or are not two-dimensional.

    Notes
    -----
    Every cell is divided by the standard deviations of its two bands, so that a ship or a breaker counts no more than
    the same area of water. Cost: about 100 ns a pixel.
    """
    if band.ndim != 2 or band.shape != nir.shape or (mask is not None and mask.shape != band.shape):
        shapes = ", ".join(str(a.shape) for a in (band, nir, mask) if a is not None)
        raise InputError(f"band, NIR and mask must be (row, column) of one shape; got {shapes}")
    valid = np.isfinite(band) & np.isfinite(nir)
    if mask is not None:
        valid &= mask
    if not valid.any():
        empty = np.empty((0, 2 * LAGS + 1, 2 * LAGS + 1))
        return ShiftStatistics(empty, empty, np.empty(0), 0)
    b, n = (_detrended(x, valid) for x in (band, nir))
    inner = _eroded(valid)
    cells = []
    for first in range(0, max(band.shape[0] - CELL, 0) + 1, CELL):
        for left in range(0, max(band.shape[1] - CELL, 0) + 1, CELL):
            cell = slice(first, first + CELL), slice(left, left + CELL)
            if (inside := inner[cell]).sum() >= LEAST_PIXELS:
                cells.append(_cell(b[cell] * inside, n[cell] * inside, _around(n, cell), int(inside.sum())))
    cross, own, variance, pixels = (np.array([c[i] for c in cells if c[2] > 0]) for i in range(4))
    side = 2 * LAGS + 1
    return ShiftStatistics(cross.reshape(-1, side, side), own.reshape(-1, side, side), variance, int(pixels.sum()))


def shift_from(statistics: ShiftStatistics) -> Shift:
    """The shift that brings the NIR onto the band.

    The peak of the summed covariance, smoothed or not, between the lags by a quintic spline. Standard errors by
    leaving groups of cells out in turn (jackknife). R2 is what the NIR explains after the very kernel of `apply_shift`.

    Parameters
    ----------
    statistics : ShiftStatistics
        Of all the tiles that were looked at, merged.

    Returns
    -------
    Shift
        `useful` where it differs from 0 by 3 standard errors and R2 rises by 3 of its standard errors; otherwise
        `reason` says why not.

    Notes
    -----
    Assumes one shift for all tiles: with waves and a delay it is the displacement of the waves that carry the
    glint, and it does not hold where their direction changes. Swell whose length is below 12 pixels can mislead it.
    """
    cells = len(statistics.variance)
    if cells < LEAST_CELLS:
        reason = f"{cells} cells of {CELL} x {CELL} px of water are too few to tell a shift: {LEAST_CELLS} are needed"
        return Shift(0.0, 0.0, np.nan, np.nan, np.nan, np.nan, np.nan, statistics.pixels, False, reason)
    sums = [_sums(statistics, g) for g in _groups(cells)]
    total = _added(sums)
    found = [(_explained(*total, place), place, s) for s in SMOOTHINGS for place in [_peak(total[0], s)]]
    after, place, smoothing = max(found)
    groups = len(sums)
    rests = [_added(sums[:g] + sums[g + 1 :]) for g in range(groups)]
    places = np.array([_peak(r[0], smoothing) for r in rests])
    gains = np.array([_explained(*r, place) - _explained(*r, (0.0, 0.0)) for r in rests])
    spread = np.sqrt((groups - 1) * np.c_[places, gains].var(axis=0))
    before = _explained(*total, (0.0, 0.0))
    reason = _verdict(place, spread, after - before)
    errors = [float(x) for x in spread]
    useful = reason.startswith("moved")
    return Shift(*place, errors[0], errors[1], before, after, errors[2], statistics.pixels, useful, reason)


def estimate_shift(band: npt.NDArray[Any], nir: npt.NDArray[Any], mask: BoolArray | None = None) -> Shift:
    """`shift_from` the `shift_statistics` of one array.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> nir = rng.normal(size=(256, 256))
    >>> nir = nir + np.roll(nir, 1, 0) + np.roll(nir, 1, 1)
    >>> found = estimate_shift(np.roll(nir, (1, -2), (0, 1)), nir)
    >>> round(found.row, 1), round(found.column, 1), found.useful
    (1.0, -2.0, True)
    """
    return shift_from(shift_statistics(band, nir, mask))


def apply_shift(nir: npt.NDArray[Any], row: float, column: float) -> Float32Array:
    """Move a band down and right by parts of a pixel.

    Parameters
    ----------
    nir : (row, column) ndarray
        Any unit; NaN is not valid. A tile needs `shift_halo` more pixels on every side.
    row, column : float
        Down and right, up to 3 pixels each.

    Returns
    -------
    (row, column) ndarray of float32
        NaN where the pixel that comes to lie there is not valid.

    Raises
    ------
    InputError
        Not two-dimensional, or a larger shift.

    Notes
    -----
    Lanczos 3, weights made to sum to 1; over the valid pixels under the kernel only. The image is mirrored at its
    edges. A tile with its halo gives to the bit what the whole image gives. Cost, one core: 3 ns a pixel.

    Examples
    --------
    >>> apply_shift(np.arange(12.0).reshape(1, 12), 0, 1)[0, 4:8].tolist()
    [3.0, 4.0, 5.0, 6.0]
    """
    if nir.ndim != 2:
        raise InputError(f"a band must be (row, column); got an array of shape {nir.shape}")
    if not max(abs(row), abs(column)) <= MAX_SHIFT:
        raise InputError(f"a shift must be -{MAX_SHIFT:g} to {MAX_SHIFT:g} pixels, got ({row:g}, {column:g}).")
    out = np.empty(nir.shape, np.float32)
    if nir.size == 0:
        return out
    halo = shift_halo(row, column)
    kernels = _weights(row, halo)[::-1], _weights(column, halo)[::-1]
    for first in range(0, len(nir), SLAB):
        last = min(first + SLAB, len(nir))
        _moved(mirrored(nir, (first, last), halo), kernels, halo, (round(row), round(column)), out[first:last])
    return out


def _moved(
    padded: Float32Array,
    kernels: tuple[Float64Array, Float64Array],
    halo: int,
    nearest: tuple[int, int],
    out: Float32Array,
) -> None:
    """Put an array without its margin, moved, into `out`."""
    import cv2

    down, across = (np.ascontiguousarray(k, dtype=np.float32) for k in kernels)

    def move(image: Float32Array) -> Float32Array:
        return np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, across, down), np.float32)

    inner = slice(halo, halo + out.shape[0]), slice(halo, halo + out.shape[1])
    valid = np.isfinite(padded)
    if valid.all():
        out[...] = move(padded)[inner]
        return
    square = np.ones((2 * halo + 1, 2 * halo + 1), np.uint8)
    untouched = ~cv2.dilate((~valid).view(np.uint8), square).view(np.bool_)
    share = move(valid.astype(np.float32))
    share[untouched] = 1.0
    source = np.roll(valid, nearest, axis=(0, 1)) & (share > 0.25)
    share[~source] = np.nan
    padded[~valid] = 0.0
    np.divide(move(padded)[inner], share[inner], out=out)


def _weights(shift: float, radius: int) -> Float64Array:
    """Weights at offsets -radius..radius that move by `shift`: Lanczos 3, sum 1."""
    x = np.arange(-radius, radius + 1) - shift
    weights = np.where(np.abs(x) < TAPS, np.sinc(x) * np.sinc(x / TAPS), 0.0)
    return np.asarray(weights / weights.sum())


def _detrended(band: npt.NDArray[Any], valid: BoolArray) -> Float64Array:
    """Less the mean over the valid pixels in a square; 0 where not valid."""
    import cv2

    x = np.where(valid, band, 0).astype(np.float64)
    x -= x.sum() / max(valid.sum(), 1)  # so that a large offset costs no digits
    x[~valid] = 0.0
    options: dict[str, Any] = {"normalize": False, "borderType": cv2.BORDER_CONSTANT}
    total = cv2.boxFilter(x, cv2.CV_64F, (TREND, TREND), **options)
    count = cv2.boxFilter(valid.astype(np.float64), cv2.CV_64F, (TREND, TREND), **options)
    return np.where(valid, x - total / np.maximum(count, 1.0), 0.0)


def _eroded(valid: BoolArray) -> BoolArray:
    """Valid, and valid all around as far as the lags go."""
    import cv2

    square = np.ones((2 * LAGS + 1, 2 * LAGS + 1), np.uint8)
    options: dict[str, Any] = {"borderType": cv2.BORDER_CONSTANT, "borderValue": 0}
    return np.asarray(cv2.erode(valid.view(np.uint8), square, **options).view(np.bool_))


def _around(n: Float64Array, cell: tuple[slice, slice]) -> Float64Array:
    """The cell and the pixels around it that the lags reach; what lies beyond the array is never used."""
    padded = np.zeros((cell[0].stop - cell[0].start + 2 * LAGS, cell[1].stop - cell[1].start + 2 * LAGS))
    rows, columns = (
        slice(max(c.start - LAGS, 0), min(c.stop + LAGS, size)) for c, size in zip(cell, n.shape, strict=True)
    )
    part = n[rows, columns]
    top, left = rows.start - cell[0].start + LAGS, columns.start - cell[1].start + LAGS
    padded[top : top + part.shape[0], left : left + part.shape[1]] = part
    return padded


def _cell(
    b: Float64Array, n: Float64Array, around: Float64Array, pixels: int
) -> tuple[Float64Array, Float64Array, float, int]:
    """Covariances of a cell at all lags, in units of the cell's own standard deviations."""
    spectrum = np.fft.rfft2(around)
    side = 2 * LAGS + 1

    def covariance(x: Float64Array) -> Float64Array:
        product = np.fft.rfft2(x, s=around.shape).conj() * spectrum
        return np.asarray(np.fft.irfft2(product, s=around.shape)[:side, :side] / pixels)

    cross, own = covariance(b), covariance(n)
    variance, own_variance = float((b * b).sum() / pixels), float(own[LAGS, LAGS])
    if variance <= 0 or own_variance <= 0:
        return cross, own, 0.0, pixels
    return cross / np.sqrt(variance * own_variance), own / own_variance, 1.0, pixels


def _groups(cells: int) -> list[slice]:
    """Cells in order, in groups as even as may be."""
    edges = np.linspace(0, cells, min(cells, GROUPS) + 1).astype(int)
    return [slice(a, b) for a, b in pairwise(edges)]


def _sums(statistics: ShiftStatistics, group: slice) -> Sums:
    cross, own = (x[group].sum(axis=0) for x in (statistics.cross, statistics.own))
    return cross, own, float(statistics.variance[group].sum())


def _added(sums: list[Sums]) -> Sums:
    """Sums of groups, added."""
    crosses, owns, variances = zip(*sums, strict=True)
    return np.sum(crosses, axis=0), np.sum(owns, axis=0), sum(variances)


def _peak(cross: Float64Array, smoothing: float) -> tuple[float, float]:
    """Place of the largest absolute covariance, as a move of the NIR down and right [pixel]."""
    from scipy.interpolate import RectBivariateSpline
    from scipy.optimize import minimize

    lags = np.arange(-LAGS, LAGS + 1)
    if smoothing:
        smooth = np.exp(-0.5 * ((lags[:, None] - lags) / smoothing) ** 2)
        smooth /= smooth.sum(axis=1, keepdims=True)
        cross = smooth @ cross @ smooth.T
    near = np.abs(lags) <= MAX_SHIFT
    window = np.ix_(near, near)
    heights = cross * np.sign(cross[window].flat[np.argmax(np.abs(cross[window]))])
    top = np.unravel_index(np.argmax(np.where(near[:, None] & near, heights, -np.inf)), cross.shape)
    start = np.array([lags[i] for i in top], dtype=float)
    spline = RectBivariateSpline(lags, lags, heights / heights[top], kx=5, ky=5)
    bounds = [(max(x - 1, -MAX_SHIFT), min(x + 1, MAX_SHIFT)) for x in start]
    found = minimize(lambda p: -spline(*p)[0, 0], start, bounds=bounds, method="L-BFGS-B").x
    return -float(found[0]), -float(found[1])


def _explained(cross: Float64Array, own: Float64Array, variance: float, place: tuple[float, float]) -> float:
    """R2 of the band on the NIR moved by `place`, from the covariances."""
    down, across = (_weights(-p, LAGS) for p in place)
    with_band = down @ cross @ across
    # covariances at a lag depend on the difference of two offsets, so a kernel counts by its own correlation
    down, across = (_weights(p - round(p), TAPS) for p in place)
    down, across = (np.correlate(k, k, "full") for k in (down, across))
    itself = down @ own @ across
    return float(np.clip(with_band**2 / (itself * variance), 0.0, 1.0)) if itself > 0 else 0.0


def _verdict(place: tuple[float, float], spread: Float64Array, gain: float) -> str:
    """Whether to move, in one line."""
    told = f"({place[0]:+.3f} +- {spread[0]:.3f}, {place[1]:+.3f} +- {spread[1]:.3f}) px"
    if max(abs(p) for p in place) > MAX_SHIFT - 0.01:
        return f"not moved: no peak within {MAX_SHIFT:g} px"
    if all(abs(p) <= SURE * s for p, s in zip(place, spread[:2], strict=True)):
        return f"not moved: {told} does not differ from 0"
    if not gain > SURE * spread[2]:
        return f"not moved: {told} raises R2 by {gain:.4f} +- {spread[2]:.4f}, no more than chance"
    return f"moved by {told}: R2 rises by {gain:.4f} +- {spread[2]:.4f}"
