"""The level of the water beside the sparkle: a rank opening of each band.

Sparkle is bright and small. The darkest pixel within an element, the median of those minima, and the brightest of
these within the element again, is what remains when everything brighter than its surroundings and smaller than the
element is taken away. Of one frame alone nothing tells a glint from a small bright object; where bands see the sea at
different instants something does: an object is there in all of them. So a second, rounder opening, which follows the
outline of an object more closely and lets more sparkle through, counts only where neighbouring bands agree; so does
the opening by a diamond as large as the square, for objects that stand on their corners.

Arrays only. Local: a tile with `halo` pixels around it gives what the whole image gives, to the bit.

References
----------
Serra (1982), Image Analysis and Mathematical Morphology, ISBN 0-12-637240-3; Soille (2002), "On morphological
operators based on rank filters", Pattern Recognition 35, 527-535, doi:10.1016/S0031-3203(01)00047-4 (rank openings)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..scene import Window
from .psf import PSF
from .sharpen import all_finite, blur_and_back, inside, share_of, surrounded
from .state import Float32Array

SMALLEST = 5
"""Smallest element that tells sparkle from water [pixel]."""
LARGEST = 13
"""Largest element that is used unasked [pixel]."""
SLACK = 2.0
"""How much brighter, against the sun, a detail may be in one band than in its neighbours."""
_GUIDE = 3
"""Element under whose opening a detail may grow back [pixel]."""
_NOTHING = np.finfo(np.float32).max
"""What OpenCV takes for the pixels beyond an edge when it erodes; minus this when it dilates."""
_PATCH = np.array([[0, 0, 0], [0, 1, 1], [0, 1, 1]], np.uint8)  # of 2 x 2; in 3 x 3 OpenCV is faster
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)


def level_halo(size: int, detail: int = 0) -> int:
    """Pixels that `opened_level` needs around a tile."""
    diamond = 2 * (diamond_of(size) // 2) + 1
    return max(2 * (size // 2) + 1, 2 * (detail // 2) + 2 if detail else 0, diamond if detail else 0)


def _elements(size: int, shape: str) -> list[npt.NDArray[np.uint8]]:
    """Small elements which, one after the other, are one of this size: an octagon is a square and some crosses."""
    if shape == "square":
        return [np.ones((size, size), np.uint8)]
    radius = size // 2
    if shape == "diamond":
        steps: list[int] = []
        while sum(steps) < radius:
            steps.append(min(max(sum(steps), 1), radius - sum(steps)))
        return [_star(step) for step in steps]
    reach = round(1.45 * radius)  # |row| + |column| at most
    square, crosses = reach - radius, 2 * radius - reach
    return [np.ones((2 * square + 1, 2 * square + 1), np.uint8)] * (square > 0) + [_CROSS] * crosses


def _star(reach: int) -> npt.NDArray[np.uint8]:
    """A pixel, and the four so far from it along the axes."""
    out = np.zeros((2 * reach + 1, 2 * reach + 1), np.uint8)
    out[reach, [0, reach, -1]] = out[[0, -1], reach] = 1
    return out


def diamond_of(size: int) -> int:
    """Width of the diamond that is as large as a square of this width, odd [pixel]."""
    return 2 * round(size / 2**0.5 - 0.5) + 1


def rank_opening(
    band: Float32Array, size: int, *, shape: str = "square", corners: bool = False, sound: bool = False
) -> Float32Array:
    """Take away what is brighter than its surroundings and smaller than an element.

    ``m = dilate_n(median_3(e)), e = erode_n(a)``, or with corners ``m = dilate_n(max(median_3(e), open_2(e)))``

    Parameters
    ----------
    band : (row, column) float32 ndarray
        Any unit; NaN is not valid.
    size : int
        n, odd [pixel].
    shape : {"square", "octagon", "diamond"}
        Of the element; of the width n.
    corners : bool
        The median takes no patch of 2 x 2 minima or more away: it would cut the corners off an object into which the
        element just fits, whose minima are a patch of a few pixels.
    sound : bool
        Every number is known to be finite, and is not looked at for that.

    Returns
    -------
    (row, column) float32 ndarray
        NaN where no pixel within reach is valid.

    Notes
    -----
    The median makes the opening blind to single dark pixels of noise (or of a pit) in the minima. Assumes that every
    patch of water as large as the element has a pixel without glint somewhere within reach: under heavier glint the
    level rises with it. Anything brighter than the water around it and narrower than n is taken for sparkle.
    Cost, one core: 4 ns a pixel for a square of any size, twice that for an octagon of 11.

    Examples
    --------
    >>> import numpy as np
    >>> sea = np.ones((9, 9), np.float32)
    >>> sea[4, 4] = 7
    >>> float(rank_opening(sea, 3).max())
    1.0
    """
    import cv2

    if size < 1 or size % 2 == 0:
        raise InputError(f"an element must have an odd size of 1 pixel or more, got {size}.")
    elements = _elements(size, shape)
    missing = None if sound or all_finite(band) else np.isnan(band)
    some = missing is not None and bool(missing.any())
    found: Any = np.where(missing, _NOTHING, band) if some and missing is not None else band
    for element in elements:
        found = cv2.erode(found, element)
    middle: Any = cv2.medianBlur(found, 3)
    if corners:
        keep: Any = cv2.max
        patches = cv2.dilate(cv2.erode(found, _PATCH), _PATCH[::-1, ::-1])
        middle = keep(middle, patches)
    found = middle
    if some:
        found[found == _NOTHING] = -_NOTHING
    for element in elements:
        found = cv2.dilate(found, element)
    if some:
        found[found == -_NOTHING] = np.nan
    return np.asarray(found)


def detail_of(
    band: Float32Array, base: Float32Array, size: int, whole: int, *, sound: bool = False,
    out: Float32Array | None = None,
) -> Float32Array:  # fmt: skip
    """By how much other openings exceed a level: outlines of objects, and clumps of sparkle.

    A rounder, smaller one, by an octagon of this size, grown back by one pixel under the opening by a square of 3; and
    that by a diamond as large as the square of the level, `whole`.
    """
    from ._level_kernels import outlines

    found = np.empty_like(base) if out is None else out
    octagon = rank_opening(band, size, shape="octagon", sound=sound)
    diamond = rank_opening(band, diamond_of(whole), shape="diamond", corners=True, sound=sound)
    outlines(octagon, rank_opening(band, _GUIDE, sound=sound), diamond, base, found)
    return found


def agreeing(
    details: Float32Array, spectrum: Sequence[float], slack: float = SLACK, *, order: Sequence[int] | None = None
) -> None:
    """Keep of every band's detail what two neighbouring bands have as well, in place.

    Parameters
    ----------
    details : (band, row, column) float32 ndarray
        With fewer than three nothing is kept.
    spectrum : sequence of float
        Brightness of glint in each band, in which details are compared.
    slack : float
        A detail may be so many times brighter than the fainter of its neighbours.
    order : sequence of int, optional
        Bands by wavelength; as they stand by default. Those that are not named are left as they are.
    """
    from ._level_kernels import agree

    bands = list(range(len(details)) if order is None else order)
    if len(bands) < 3:
        details[bands] = 0.0
        return
    brightness = np.array([spectrum[b] for b in bands])
    agree(details, np.array(bands), brightness.astype(np.float32), (slack * brightness).astype(np.float32))


def blurred(band: Float32Array, psf: PSF, within: Window | None = None, *, sound: bool = False) -> Float32Array:
    """A level of sharpened pixels as the sensor would see it: convolved with the PSF's separable form.

    NaN has no share and stays. Exact at tile edges with `psf.radius` pixels around a tile; `within` names the rows and
    columns that are wanted.
    """
    blur, halo = blur_and_back(psf)[0], psf.radius
    rows, columns = within or ((0, band.shape[0]), (0, band.shape[1]))
    wide = surrounded(band, rows, columns, halo)
    inner = inside(wide.shape, halo)
    if sound or all_finite(wide):
        return blur(wide)[inner]
    valid = np.isfinite(wide)
    wide[~valid] = 0.0
    out = (blur(wide) / share_of(valid, blur, halo))[inner]
    out[~valid[inner]] = np.nan
    return out


def opened_level(
    bands: Iterable[Float32Array],
    size: int,
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
    size : int
        Element of the opening [pixel].
    detail : int
        Element of the rounder opening that follows outlines where bands agree [pixel]; 0 for none. Only for bands
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
    base, details = [], None
    for band in bands:
        whole = sound or all_finite(band)
        base.append(rank_opening(band, size, corners=True, sound=whole))
        if detail:
            details = np.empty((len(spectrum), *band.shape), np.float32) if details is None else details
            detail_of(band, base[-1], detail, size, sound=whole, out=details[len(base) - 1])
    if details is not None:
        agreeing(details, spectrum, order=order)
    rows, columns = within or tuple((0, n) for n in base[0].shape)
    out = np.empty((len(base), rows[1] - rows[0], columns[1] - columns[0]), np.float32)
    for i in range(len(out)):
        low, base[i] = base[i], base[i][:0]  # and its memory with it
        if details is not None:
            low += details[i]
        out[i] = (
            low[slice(*rows), slice(*columns)] if psfs is None else blurred(low, psfs[i], (rows, columns), sound=sound)
        )
    return out
