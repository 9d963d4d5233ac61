"""Things in a tile: where they are, how much of the excess is theirs, and how they are put back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..scene import FloatArray
from .evidence import REACH, BoolArray, Float64, Places, Protection, clusters, score, variance


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
        S; minus infinity where nothing stands out, NaN where not valid.
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
    A saturated thing is judged by the numbers that there are. Of a thing's own pixels the excess that its spectrum
    explains is kept (10 % and 2 standard deviations more), so that sparkle of one band does not come along; of those
    within 2 pixels the part of the nearest thing's spectrum that nearly all bands show.

    Fails: for sparkle that stays as bright over all instants as a thing does (near the mirror point, short delays;
    then the threshold rises and single pixels are lost); for things that move more than half their size from the
    first band to the last, and for single coloured pixels.

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
    chosen = list(protection.bands)
    r, m = np.asarray(raw[chosen], np.float64), np.asarray(level[chosen], np.float64)
    high, spectra, places = score(r, m, protection)
    mask = clusters(high, protection.threshold)
    white = np.array(protection.irradiance)[:, None]
    y = (r - m).reshape(len(r), -1) / white
    sigma = np.sqrt(variance(r.reshape(len(r), -1), protection)) / white
    residual = np.full(plane[0] * plane[1], np.nan, np.float32)
    if places.size:
        tried = np.isfinite(high.ravel()[places])
        away = np.linalg.norm(y[:, places] - spectra, axis=0) / np.linalg.norm(y[:, places], axis=0)
        residual[places[tried]] = away[tried]
    inside = mask.ravel()[places]
    kept, edge = _keep(y, sigma, mask, places[inside], spectra[:, inside])
    out[chosen] = (kept * white).reshape(r.shape)
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
    touched = (found.mask | found.edge) & (found.excess != 0)
    values = level[touched] + found.excess[touched]
    if out.dtype.kind in "iu":
        values = np.rint(values)
    out[touched] = values.astype(out.dtype)
    return out


def _keep(y: Float64, sigma: Float64, mask: BoolArray, places: Places, spectra: Float64) -> tuple[Float64, BoolArray]:
    """Excess [reflectance] to keep, (band, pixel), and the pixels beside things that get some."""
    kept = np.zeros(y.shape)
    bright = np.maximum(spectra, 0.0)
    kept[:, places] = np.minimum(y[:, places], 1.1 * bright + 2 * sigma[:, places])
    share = np.zeros(mask.size)
    rows, columns = np.divmod(places, mask.shape[1])
    strong = bright > 0.3 * bright.max(axis=0, initial=0.0)
    for down in range(-REACH, REACH + 1):
        for right in range(-REACH, REACH + 1):
            r, c = rows + down, columns + right
            inside = (r >= 0) & (r < mask.shape[0]) & (c >= 0) & (c < mask.shape[1])
            at = np.where(inside, r * mask.shape[1] + c, 0)
            use = inside & ~mask.ravel()[at] & np.isfinite(y[:, at]).all(axis=0)
            if not use.any():
                continue
            here, lit, which = at[use], bright[:, use], strong[:, use]
            ratio = np.where(which, y[:, here] / np.where(which, lit, 1.0), np.inf)
            part = np.clip(_low_share(ratio, which.sum(axis=0)), 0.0, 1.0)
            total = part * lit.max(axis=0)
            more = total > share[here]
            share[here[more]] = total[more]
            kept[:, here[more]] = np.minimum(y[:, here[more]], part[more] * lit[:, more])
    return kept, (share > 0).reshape(mask.shape)


def _low_share(ratio: Float64, count: Places) -> Float64:
    """The value that a third of the finite ones, the odd one down, lie below."""
    ordered = np.sort(ratio, axis=0)
    return np.asarray(np.take_along_axis(ordered, ((count - 1) * 3 // 10)[None], axis=0)[0])
