"""The level of the water beside the sparkle: a rank opening of each band.

Sparkle is bright and small. The darkest pixel within an element, the median of those minima, and the brightest of
these within the element again, is what remains when everything brighter than its surroundings and smaller than the
element is taken away. Of one frame alone nothing tells a glint from a small bright object; where bands see the sea at
different instants something does: an object is there in all of them. So the openings by an octagon of the same width,
which follows round outlines and lets more sparkle through, and by a diamond as large as the square, for objects that
stand on their corners, count only where neighbouring bands agree.

Arrays only. Local: a tile with `opening_halo` pixels around it gives what the whole image gives, to the bit. The
openings themselves, and what they are after, are in `deglint.compensate.opening`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..scene import Window
from .codes import Codes, encoded
from .opening import openings
from .products import by_products, products
from .psf import PSF
from .state import Float32Array

Grid = tuple[float, float]
SMALLEST = 5
"""Smallest element that tells sparkle from water [pixel]."""
LARGEST = 13
"""Largest element that is used unasked [pixel]."""
SLACK = 2.0
"""How much brighter, against the sun, a detail may be in one band than in its neighbours."""


def agreeing(
    levels: Codes,
    outlines: Codes,
    grids: Sequence[Grid],
    spectrum: Sequence[float],
    *,
    order: Sequence[int],
    slack: float = SLACK,
) -> Float32Array:
    """A level, and of what other openings exceed it by what two neighbouring bands have as well.

    Parameters
    ----------
    levels, outlines : (band, row, column) int16 ndarray
        Codes.
    grids : sequence of (float, float)
        Centre and unit of each band's codes.
    spectrum : sequence of float
        Brightness of glint in each band, in which details are compared.
    order : sequence of int
        Bands by wavelength. Those that are not named get nothing added, and of fewer than three none does.
    slack : float
        A detail may be so many times brighter than the fainter of its neighbours.

    Returns
    -------
    (band, row, column) float32 ndarray
    """
    from ._code_kernels import LANES, agree

    if 0 < levels[0].size < LANES:
        some = ((0, 0), (0, LANES // levels.shape[1] + 1), (0, 0))
        more = (np.pad(codes, some) for codes in (levels, outlines))
        return agreeing(*more, grids, spectrum, order=order, slack=slack)[:, : levels.shape[1]]
    bands = np.array(order if len(order) >= 3 else (), np.int64)
    glint = np.array([spectrum[b] for b in bands], np.float32)
    found = np.empty(levels.shape, np.float32)
    if found.size:
        codes = (c.reshape(len(c), -1) for c in (levels, outlines))
        agree(*codes, np.array(grids, np.float32), bands, glint, np.float32(slack), found.reshape(len(found), -1))
    return found


def blurred(
    band: Float32Array, psf: PSF, within: Window | None = None, *, sound: bool = False, out: Float32Array | None = None
) -> Float32Array:
    """A level of sharpened pixels as the sensor would see it: convolved with the PSF's separable form.

    NaN has no share and stays. Exact at tile edges with `psf.radius` pixels around a tile; `within` names the rows and
    columns that are wanted, `out` the array that they go to. Cost, one core with vectors of 16 float32: 0.8 ns a pixel
    for 9 x 9 taps, 0.9 for 15 x 15.
    """
    wanted = within or ((0, band.shape[0]), (0, band.shape[1]))
    return by_products(band, products(psf), 0, wanted, sound=sound, out=out)


def opened_level(
    bands: Iterable[Float32Array],
    shape: tuple[int, int, int],
    size: int,
    grids: Sequence[Grid],
    *,
    detail: int = 0,
    order: Sequence[int] = (),
    spectrum: Sequence[float] = (),
    psfs: Sequence[PSF] | None = None,
    within: Window | None = None,
    sound: bool = False,
) -> Float32Array:
    """The level of the water of every band.

    Parameters
    ----------
    bands : iterable of (row, column) float32 ndarray
        The bands, sharpened or not, each asked for once.
    shape : (int, int, int)
        How many bands, rows and columns.
    size : int
        Element of the opening [pixel].
    grids : sequence of (float, float)
        Of each band the centre and the unit in which its levels are told: those of water and its noise. Levels are
        steps of a thousandth of the unit near the centre, see `deglint.compensate.codes`.
    detail : int
        Octagon that follows outlines where bands agree [pixel]; 0 for none, nor for a diamond. Only for bands
        that see the sea at different instants: in bands of one instant sparkle agrees, too.
    order : sequence of int
        Bands by wavelength.
    spectrum : sequence of float
        Brightness of glint in each band.
    psfs : sequence of PSF, optional
        Blur the level with these: of sharpened bands.
    within : ((row0, row1), (col0, col1)), optional
        Only these rows and columns are wanted.
    sound : bool
        Every number is known to be finite, and is not looked at for that.

    Returns
    -------
    (band, row, column) float32 ndarray
    """
    inner = within or ((0, shape[1]), (0, shape[2]))
    reach = max((p.radius for p in psfs or ()), default=0)
    outer = _grown(inner, reach, shape[1:])
    codes = np.empty((2 if detail else 1, shape[0], *(last - first for first, last in outer)), np.int16)
    for i, (band, grid) in enumerate(zip(bands, grids, strict=True)):
        openings(encoded(band, *grid), size, detail, within=outer, out=(codes[0, i], codes[-1, i]))
    level = agreeing(codes[0], codes[-1], grids, spectrum, order=order if detail else ())
    del codes
    if psfs is None:
        return level
    (top, bottom), (left, right) = (_shifted(a, b) for a, b in zip(inner, outer, strict=True))
    out = np.empty((shape[0], bottom - top, right - left), np.float32)
    for i, psf in enumerate(psfs):
        blurred(level[i], psf, ((top, bottom), (left, right)), sound=sound, out=out[i])
    return out


def _grown(window: Window, reach: int, shape: Sequence[int]) -> Window:
    """A window with so many pixels around it, as far as the array goes."""
    rows, columns = ((max(a - reach, 0), min(b + reach, n)) for (a, b), n in zip(window, shape, strict=True))
    return rows, columns


def _shifted(part: tuple[int, int], whole: tuple[int, int]) -> tuple[int, int]:
    """A range counted from the beginning of another."""
    return part[0] - whole[0], part[1] - whole[0]
