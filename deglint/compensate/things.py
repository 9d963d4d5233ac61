"""Things in a tile: where they are, how much of the excess is theirs, and how they are put back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..scene import FloatArray
from .evidence import LEAST_SCORE, REACH, BoolArray, Float64, Places, Protection, excess, plain, score

CHANGING = 0.0125
"""Part of a thing's power that one outline need not explain, from which more evidence is wanted."""
BLURRED_APART = 0.016
"""The same of a thing of one pixel, that the bands of one sensor blur differently."""
Weighed = tuple[Float64, Float64, Places]


@dataclass(frozen=True, eq=False)
class Things:
    """What was found in a tile.

    Attributes
    ----------
    mask : (row, column) ndarray of bool
        Part of a thing.
    edge : (row, column) ndarray of bool
        Beside one, and lit by it.
    excess : (band, row, column) ndarray of float32
        Of the thing over the level, in the unit of the scene; 0 elsewhere.
    score : (row, column) ndarray of float32
        S; NaN where not valid, minus infinity where nothing stands out, or too little for the threshold by far.
    residual : (row, column) ndarray of float32
        Of the best shape, relative to the excess; NaN where none was tried.
    """

    mask: BoolArray
    edge: BoolArray
    excess: FloatArray
    score: FloatArray
    residual: FloatArray

    def cropped(self, inner: tuple[slice, slice]) -> Things:
        """Without the halo."""
        at = (..., *inner)
        return Things(self.mask[at], self.edge[at], self.excess[at], self.score[at], self.residual[at])


def things(raw: FloatArray, level: FloatArray, protection: Protection) -> Things:
    """Find things.

    Parameters
    ----------
    raw, level : (band, row, column) ndarray
        As for `fit`, with `protection.halo` more pixels on every side of what is wanted.
    protection : Protection

    Returns
    -------
    Things

    Raises
    ------
    InputError
        Shapes that do not match.

    Notes
    -----
    A thing has one outline; that of sparkle changes from instant to instant. So the threshold on a 3 x 3 sum is
    multiplied by the part of the power of its pixels' excess that is not one outline times one spectrum, over
    `CHANGING`, where that is more than 1. And what 5 x 5 pixels hold that is not one outline (nor due to
    `BLURRED_APART`) has no more power than nine in ten such squares of sparkle: what is left of a flash that lasts and
    moves has.

    A saturated thing is judged by the numbers that there are. Of a thing's own pixels the excess that its spectrum
    explains is kept (10 % and 2 standard deviations more), so that sparkle of one band does not come along; of those
    within 2 pixels the part of the nearest thing's spectrum that nearly all bands show.

    Fails: for sparkle that stays as bright over all instants as a thing does (near the mirror point, short delays;
    then the threshold rises and single pixels are lost); for things that move more than half their size from the
    first band to the last, and for single coloured pixels.

    Cost for each band of each pixel, on one core: 7 ns at 5 m/s of wind, 11 at 9 and 14 at 12, where 24, 63 and 94 %
    of the pixels stand out; more where there are many things (60 where they are 8 % of the pixels).

    Examples
    --------
    >>> from deglint.compensate.evidence import Protection
    >>> found = things(np.ones((2, 3, 3)), np.ones((2, 3, 3)), Protection(reason="two bands"))
    >>> int(found.mask.sum())
    0
    """
    if raw.shape != level.shape or raw.ndim != 3:
        raise InputError(f"raw and level must be (band, row, column) and alike, got {raw.shape} and {level.shape}")
    plane, out = raw.shape[1:], np.zeros(raw.shape, np.float32)
    if not protection.possible:
        nothing, empty = np.zeros(plane, np.bool_), np.full(plane, np.nan, np.float32)
        return Things(nothing, nothing.copy(), out, empty, empty.copy())
    if max(protection.bands) >= len(raw):
        raise InputError(f"the block has {len(raw)} bands, but band {max(protection.bands) + 1} is to be judged")
    raw, level = plain(raw), plain(level)
    high, spectra, places = score(raw, level, protection, protection.threshold)
    mask = _rigid(raw, level, protection, (high, spectra, places))
    residual = np.full(mask.size, np.nan, np.float32)
    if places.size:
        y = excess(raw, level, protection, places)[0]
        tried = np.isfinite(high.ravel()[places])
        away = np.linalg.norm(y - spectra, axis=0) / np.linalg.norm(y, axis=0)
        residual[places[tried]] = away[tried]
    inside = mask.ravel()[places]
    edge = _keep(raw, level, protection, (mask, places[inside], spectra[:, inside]), out)
    return Things(mask, edge, out, high.astype(np.float32), residual.reshape(plane))


def put_back(compensated: FloatArray, level: FloatArray, found: Things) -> FloatArray:
    """The compensated bands with the things in them again: level plus excess where there is one.

    Parameters
    ----------
    compensated, level : (band, row, column) ndarray
    found : Things

    Returns
    -------
    (band, row, column) ndarray of the dtype of `compensated`
        A copy; where nothing was found it is the same to the bit. Integers are rounded.
    """
    out = compensated.copy()
    rows, columns = np.nonzero(found.mask | found.edge)
    bands, which = np.nonzero(found.excess[:, rows, columns])
    at = bands, rows[which], columns[which]
    values = level[at] + found.excess[at]
    if out.dtype.kind in "iu":
        values = np.rint(values)
    out[at] = values.astype(out.dtype)
    return out


def _rigid(raw: FloatArray, level: FloatArray, protection: Protection, found: Weighed) -> BoolArray:
    """Pixels of high S in a square of enough: more, where its outline is not the same in all bands."""
    from ._protect_kernels import quiet, rigid

    high, spectra, places = found
    mask, index = np.zeros(high.shape, np.bool_), np.zeros(high.shape, np.int64)
    if places.size:
        index.ravel()[places] = np.arange(places.size)
        own = np.ascontiguousarray(_own(raw, level, protection, places, spectra).T)
        beside = raw, level, np.array(protection.bands), np.array(protection.irradiance)
        rigid(high, index, own, LEAST_SCORE, protection.threshold, CHANGING, mask)
        quiet(beside, BLURRED_APART, protection.around, mask)
    return mask


def _own(raw: FloatArray, level: FloatArray, protection: Protection, places: Places, spectra: Float64) -> Float64:
    """The excess of some pixels that is the thing's own, (band, pixel): what its spectrum explains."""
    y, sigma = excess(raw, level, protection, places)
    return np.asarray(np.minimum(y, 1.1 * np.maximum(spectra, 0.0) + 2 * sigma))


def _keep(
    raw: FloatArray,
    level: FloatArray,
    protection: Protection,
    inside: tuple[BoolArray, Places, Float64],
    out: FloatArray,
) -> BoolArray:
    """Write the excess to keep; and the pixels beside things that get some."""
    mask, places, spectra = inside
    white = np.array(protection.irradiance)[:, None]
    to, chosen = out.reshape(len(out), -1), np.array(protection.bands)
    bright = np.maximum(spectra, 0.0)
    to[np.ix_(chosen, places)] = _own(raw, level, protection, places, spectra) * white
    share = np.zeros(mask.size)
    rows, columns = np.divmod(places, mask.shape[1])
    strong = bright > 0.3 * bright.max(axis=0, initial=0.0)
    for down in range(-REACH, REACH + 1):
        for right in range(-REACH, REACH + 1):
            r, c = rows + down, columns + right
            use = (r >= 0) & (r < mask.shape[0]) & (c >= 0) & (c < mask.shape[1])
            at = np.where(use, r * mask.shape[1] + c, 0)
            use &= ~mask.ravel()[at]
            if not use.any():
                continue
            here, lit, which = at[use], bright[:, use], strong[:, use]
            y = excess(raw, level, protection, here)[0]
            ratio = np.where(which, y / np.where(which, lit, 1.0), np.inf)
            part = np.clip(_low_share(ratio, which.sum(axis=0)), 0.0, 1.0)
            total = part * lit.max(axis=0)
            more = (total > share[here]) & np.isfinite(y).all(axis=0)
            share[here[more]] = total[more]
            to[np.ix_(chosen, here[more])] = np.minimum(y[:, more], part[more] * lit[:, more]) * white
    return np.asarray((share > 0).reshape(mask.shape))


def _low_share(ratio: Float64, count: Places) -> Float64:
    """The value that a third of the finite ones, the odd one down, lie below."""
    ordered = np.sort(ratio, axis=0)
    return np.asarray(np.take_along_axis(ordered, ((count - 1) * 3 // 10)[None], axis=0)[0])
