"""The level of the water beside the sparkle: a rank opening of each band.

Sparkle is bright and small. The darkest pixel within an element, the median of those minima, and the brightest of
these within the element again, is what remains when everything brighter than its surroundings and smaller than the
element is taken away. Of one frame alone nothing tells a glint from a small bright object; where bands see the sea at
different instants something does: an object is there in all of them. So a second, rounder opening, which follows the
outline of an object more closely and lets more sparkle through, counts only where neighbouring bands agree; so does
the opening by a diamond as large as the square, for objects that stand on their corners.

Arrays only. Local: a tile with `opening_halo` pixels around it gives what the whole image gives, to the bit. The
openings themselves, and what they are after, are in `deglint.compensate.opening`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..scene import Window
from .opening import opening_and_detail, rank_opening
from .psf import PSF
from .sharpen import all_finite, blur_and_back, inside, share_of, surrounded
from .state import Float32Array

SMALLEST = 5
"""Smallest element that tells sparkle from water [pixel]."""
LARGEST = 13
"""Largest element that is used unasked [pixel]."""
SLACK = 2.0
"""How much brighter, against the sun, a detail may be in one band than in its neighbours."""


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
    base: list[Float32Array] = []
    details: Float32Array | None = None
    for band in bands:
        if detail:
            details = np.empty((len(spectrum), *band.shape), np.float32) if details is None else details
            base.append(opening_and_detail(band, size, detail, details[len(base)], sound=sound))
        else:
            base.append(rank_opening(band, size, corners=True, sound=sound))
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
