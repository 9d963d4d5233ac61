"""Things in a tile: where they are, how much of the excess is theirs, and how they are put back."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..scene import FloatArray
from .evidence import LEAST_SCORE, REACH, BoolArray, Float64, Places, Protection, excess, grown, plain, weighed

CHANGING = 0.0125
"""Part of a thing's power that one outline need not explain, from which more evidence is wanted."""
BLURRED_APART = 0.016
"""The same of a thing of one pixel, that the bands of one sensor blur differently."""
Kept = tuple[Places, npt.NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Things:
    """What was found in a tile.

    Attributes
    ----------
    mask : (row, column) ndarray of bool
        Part of a thing.
    edge : (row, column) ndarray of bool
        Beside one, and lit by it.
    places : (place,) ndarray of int
        Where in the flat mask things and their edges are.
    kept : (band, place) ndarray of float32
        The excess of these.
    missing : (row, column) ndarray of bool
        Not valid in some band.
    weighed : (3, pixel) tuple of ndarray
        Of the pixels that were weighed in full the places, S, and residual.
    """

    mask: BoolArray
    edge: BoolArray
    places: Places = field(repr=False)
    kept: npt.NDArray[np.float32] = field(repr=False)
    missing: BoolArray = field(repr=False)
    weighed: tuple[Places, Float64, Float64] = field(repr=False)

    @property
    def excess(self) -> npt.NDArray[np.float32]:
        """Of the thing over the level, in the unit of the scene, (band, row, column); 0 elsewhere."""
        out = np.zeros((len(self.kept), self.mask.size), np.float32)
        out[:, self.places] = self.kept
        return out.reshape(-1, *self.mask.shape)

    @property
    def score(self) -> npt.NDArray[np.float32]:
        """S, (row, column); NaN where not valid, minus infinity where nothing stands out, or too little by far."""
        out = np.where(self.missing, np.float32(np.nan), np.float32(-np.inf))
        out.ravel()[self.weighed[0]] = self.weighed[1]
        return out

    @property
    def residual(self) -> npt.NDArray[np.float32]:
        """Of the best shape, relative to the excess, (row, column); NaN where none was tried."""
        out = np.full(self.mask.shape, np.nan, np.float32)
        places, high, away = self.weighed
        tried = np.isfinite(high)
        out.ravel()[places[tried]] = away[tried]
        return out

    def cropped(self, inner: tuple[slice, slice]) -> Things:
        """Without the halo."""
        places, inside = self._within(self.places, inner)
        seen, weighed = self._within(self.weighed[0], inner)
        planes = {name: getattr(self, name)[inner] for name in ("mask", "edge", "missing")}
        others = seen, self.weighed[1][weighed], self.weighed[2][weighed]
        return replace(self, **planes, places=places, kept=self.kept[:, inside], weighed=others)

    def _within(self, places: Places, inner: tuple[slice, slice]) -> tuple[Places, BoolArray]:
        """Places in a part of the mask, and which of those given they are."""
        spans = [range(*s.indices(n)) for s, n in zip(inner, self.mask.shape, strict=True)]
        rows, columns = np.divmod(places, self.mask.shape[1])
        inside = (rows >= spans[0].start) & (rows < spans[0].stop)
        inside &= (columns >= spans[1].start) & (columns < spans[1].stop)
        return ((rows - spans[0].start) * len(spans[1]) + columns - spans[1].start)[inside], inside


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

    Cost for each band of each pixel, on one core: 2 ns at 9 m/s; several times that where there are many things.

    Examples
    --------
    >>> from deglint.compensate.evidence import Protection
    >>> found = things(np.ones((2, 3, 3)), np.ones((2, 3, 3)), Protection(reason="two bands"))
    >>> int(found.mask.sum())
    0
    """
    if raw.shape != level.shape or raw.ndim != 3:
        raise InputError(f"raw and level must be (band, row, column) and alike, got {raw.shape} and {level.shape}")
    mask, nobody = np.zeros(raw.shape[1:], np.bool_), (np.empty(0, np.int64), np.empty(0), np.empty(0))
    nowhere = nobody[0], np.empty((len(raw), 0), np.float32)
    if not protection.possible:
        return Things(mask, mask.copy(), *nowhere, mask.copy(), nobody)
    if max(protection.bands) >= len(raw):
        raise InputError(f"the block has {len(raw)} bands, but band {max(protection.bands) + 1} is to be judged")
    raw, level = plain(raw), plain(level)
    missing, found = weighed(raw, level, protection, protection.threshold)
    may_be = np.flatnonzero(found.score > LEAST_SCORE)
    places, spectra = found.places[may_be], found.spectra[may_be].T
    own = np.minimum(found.excess[:, may_be], _most(spectra, found.noise[:, may_be]))
    if places.size:
        _rigid((raw, level), protection, (found.score[may_be], own, places), mask)
    weights = found.places, found.score, found.residual
    if not mask.any():
        return Things(mask, mask.copy(), *nowhere, missing, weights)
    inside = mask.ravel()[places]
    edge, kept = _keep(raw, level, protection, (mask, places[inside], spectra[:, inside], own[:, inside]))
    return Things(mask, edge, *kept, missing, weights)


def put_back(compensated: FloatArray, level: FloatArray, found: Things, out: FloatArray | None = None) -> FloatArray:
    """The compensated bands with the things in them again: level plus excess where there is one.

    Parameters
    ----------
    compensated, level : (band, row, column) ndarray
    found : Things
    out : ndarray, optional
        What is written to; `compensated` itself where only the places of things are to be.

    Returns
    -------
    (band, row, column) ndarray of the dtype of `compensated`
        A copy, or `out`; where nothing was found it is the same to the bit. Integers are rounded.
    """
    if out is None:
        out = compensated.copy()
    elif out is not compensated:
        np.copyto(out, compensated)
    put(out, found, lifted(level, found))
    return out


def lifted(level: FloatArray, found: Things) -> FloatArray:
    """Level plus excess at the places of things, (band, place): all that `put` needs of the level."""
    return np.asarray(level[:, *np.divmod(found.places, found.mask.shape[1])] + found.kept)


def put(image: FloatArray, found: Things, values: FloatArray) -> None:
    """Write the values into the image where there is excess."""
    bands, which = np.nonzero(found.kept)
    written = values[bands, which]
    if image.dtype.kind in "iu":
        written = np.rint(written)
    image[bands, *np.divmod(found.places[which], found.mask.shape[1])] = written.astype(image.dtype)


def _rigid(
    look: tuple[FloatArray, FloatArray], protection: Protection, found: tuple[Float64, Float64, Places], out: BoolArray
) -> None:
    """Mark pixels of high S in a square of enough: more, where its outline is not the same in all bands."""
    from ._protect_kernels import quiet, rigid
    from .glance import block

    high, own, places = found
    rigid(high, places, np.ascontiguousarray(own.T), protection.threshold, CHANGING, out)
    if not out.any():
        return
    white, bands = np.array(protection.irradiance), np.array(protection.bands)
    quiet(block(look[0]), block(look[1]), bands, white, BLURRED_APART, protection.around, out)


def _most(spectra: Float64, noise: Float64) -> Float64:
    """Of the excess that is a thing's own at most, (band, pixel): what its spectrum explains."""
    return np.asarray(1.1 * np.maximum(spectra, 0.0) + 2 * noise)


def _keep(
    raw: FloatArray, level: FloatArray, protection: Protection, inside: tuple[BoolArray, Places, Float64, Float64]
) -> tuple[BoolArray, Kept]:
    """The pixels beside things that get some excess, and the excess to keep."""
    mask, places, spectra, own = inside
    white, chosen = np.array(protection.irradiance)[:, None], np.array(protection.bands)[:, None]
    near = np.flatnonzero(grown(mask, REACH))
    bright, kept, share = np.maximum(spectra, 0.0), np.zeros((len(raw), near.size), np.float32), np.zeros(near.size)
    kept[chosen, np.searchsorted(near, places)] = own * white
    around = excess(raw, level, protection, near)
    sound = np.asarray(np.isfinite(around).all(axis=0))
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
            slot = np.searchsorted(near, here)
            y = around[:, slot]
            ratio = np.where(which, y / np.where(which, lit, 1.0), np.inf)
            part = np.clip(_low_share(ratio, which.sum(axis=0)), 0.0, 1.0)
            total = part * lit.max(axis=0)
            more = (total > share[slot]) & sound[slot]
            share[slot[more]] = total[more]
            kept[chosen, slot[more]] = np.minimum(y[:, more], part[more] * lit[:, more]) * white
    edge = np.zeros(mask.shape, np.bool_)
    edge.ravel()[near[share > 0]] = True
    return edge, (near, kept)


def _low_share(ratio: Float64, count: Places) -> Float64:
    """The value that a third of the finite ones, the odd one down, lie below."""
    ordered = np.sort(ratio, axis=0)
    return np.asarray(np.take_along_axis(ordered, ((count - 1) * 3 // 10)[None], axis=0)[0])
