"""The level of the water beside the sparkle: a rank opening of each band.

Sparkle is bright and small. The darkest pixel within an element, the median of those minima, and the brightest of
these within the element again, is what remains when everything brighter than its surroundings and smaller than the
element is taken away. Of one frame alone nothing tells a glint from a small bright object; where bands see the sea at
different instants something does: an object is there in all of them. So the openings by an octagon of the same width,
which follows round outlines and lets more sparkle through, and by a diamond as large as the square, for objects that
stand on their corners, count only where neighbouring bands agree. In bands of one instant sparkle is in all of them,
too, and brightest, against the water, in the NIR, where things under water are not: that is the witness. There they
count about what is brighter than `BEYOND` times the glint that the witness shows, and less what it shows of them.

Arrays only. Local: a tile with `opening_halo` pixels around it (and the reach of a witness) gives what the whole image
gives, to the bit. The openings themselves, and what they are after, are in `deglint.compensate.opening`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import Window
from .codes import Codes, decoded, encoded, exceeding
from .evidence import grown
from .opening import opening_halo, openings, openings_of_pieces
from .products import by_products, products
from .psf import PSF
from .state import LIMITS, Float32Array, Mask

Grid = tuple[float, float]
SMALLEST = 5
"""Smallest element that tells sparkle from water [pixel]."""
LARGEST = 13
"""Largest element that is used unasked [pixel]."""
PIECE = 32
"""Side of the squares in which outlines are looked for where they are wanted in some pixels only."""
MOST_LOOKED_AT = 0.65
"""Pixels that such squares look at, halos and all, as a share of all pixels, from which on it takes less to look
everywhere."""
BEYOND = 4.0
"""How many times as bright as glint, as a witness shows it, a thing is to be: optics blur it less in other bands."""
SLACK = 2.0
"""How much brighter, against the sun, a detail may be in one band than in its neighbours."""


@dataclass(frozen=True, eq=False)
class Opened:
    """Openings of bands, of which a level is made: what other openings exceed it by counts where neighbours have it.

    Attributes
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
    bands : sequence of int, optional
        Which bands of an image they are, of which the others are left as they are; all of them by default.
    least : sequence of float
        Of each band: outlines of things are where what is added exceeds this in half of the bands that are compared,
        or more: clumps of sparkle seldom do. They are not told without.
    where : (row, column) bool ndarray, optional
        Where outlines count, if not everywhere.
    witness : int, optional
        The one that shows glint wherever another does: of their outlines that is glint's which it has, too.
    """

    levels: Codes
    outlines: Codes
    grids: Sequence[Grid]
    spectrum: Sequence[float]
    order: Sequence[int]
    slack: float = SLACK
    bands: Sequence[int] | None = None
    least: Sequence[float] = ()
    where: Mask | None = None
    witness: int | None = None

    @property
    def fits(self) -> bool:
        """Rows are long enough to be worked on."""
        from ._code_kernels import LANES

        return self.levels.shape[2] >= LANES and self.levels.size > 0

    @property
    def tells(self) -> bool:
        """Outlines are told, where there are any."""
        return len(self.least) > 0 and len(self.order) >= 3

    def level(self) -> tuple[Float32Array, Mask | None]:
        """The level, and where an outline is part of it; of the bands that the openings are of.

        Returns
        -------
        level : (band, row, column) float32 ndarray
        outlined : (row, column) bool ndarray, or None
            None where that is not told.
        """
        if not self.fits:
            return self._narrow()
        found = np.empty(self.levels.shape, np.float32)
        none, nowhere = np.empty(0, np.float32), np.empty(0, np.bool_)
        outlined = np.empty(found.shape[1:], np.bool_) if self.tells else nowhere
        every, least = range(len(found)), np.array(self.least, np.float32)
        limits = np.empty((0, LIMITS), np.float32)
        self._agree(every, limits, (none, 0, 0), least, found.ravel(), none, nowhere, outlined.ravel())
        return found, outlined if self.tells else None

    def of_image(self, count: int) -> tuple[Float32Array, Mask | None]:
        """The same for an image of so many bands: NaN in those that there are no openings of."""
        level, outlined = self.level()
        return of_every_band(level, range(count) if self.bands is None else self.bands, count), outlined

    def settled(
        self, image: Float32Array, limits: Float32Array, wanted: bool
    ) -> tuple[Float32Array | None, Float32Array, Mask, Mask | None]:
        """The level, where it is wanted; the image with that in place of what exceeds it, and where; outlines.

        Parameters
        ----------
        image : (band, row, column) float32 ndarray
            Rows may lie apart; not modified.
        limits : (band, LIMITS) float32 ndarray
            As `deglint.compensate.state.State` has them.
        """
        from .glance import block

        level = np.empty(image.shape if wanted else (len(image), 0, 0), np.float32)
        clean, replaced = np.empty(image.shape, np.float32), np.empty(image.shape, np.bool_)
        bands = range(len(image)) if self.bands is None else self.bands
        outlined, least = np.empty(image.shape[1:] if self.tells else (0, 0), np.bool_), np.zeros(len(image))
        if self.tells:
            least[list(bands)] = self.least
        out = level.ravel(), clean.ravel(), replaced.ravel(), outlined.ravel()
        self._agree(bands, limits, block(image), least.astype(np.float32), *out)
        for b in range(len(image)):
            if b not in bands:  # left as they are
                level[b], clean[b], replaced[b] = np.nan, image[b], False
        return level if wanted else None, clean, replaced, outlined if self.tells else None

    def _agree(
        self, bands: Sequence[int], limits: Float32Array, image: tuple[Any, int, int], least: Float32Array,
        *out: npt.NDArray[Any],
    ) -> None:  # fmt: skip
        """Run the compiled function."""
        from ._code_kernels import agree

        count = len(self.levels)
        some = list(self.order) if len(self.order) >= 3 else []
        glint = np.array([self.spectrum[b] for b in some] + [1.0] * (count - len(some)), np.float32)
        order = np.array(some + [b for b in range(count) if b not in some], np.int64)
        numbers = image[0].view()
        numbers.flags.writeable = False  # as it may be or not, and there would be compiled code for either
        agree(
            (self.levels.ravel(), self.outlines.ravel()), np.array(self.grids, np.float32), order, len(some),
            np.array(bands, np.int64), glint, np.float32(self.slack), self.levels.shape[2], limits,
            order.tolist().index(self.witness) if self.witness in some else -1,
            (numbers, *image[1:]), least if least.size else np.zeros(max(bands, default=0) + 1, np.float32),
            np.empty(0, np.bool_) if self.where is None else np.ascontiguousarray(self.where).ravel(), out,
        )  # fmt: skip

    def _narrow(self) -> tuple[Float32Array, Mask | None]:
        """The same for rows that are too short."""
        from ._code_kernels import LANES

        some = ((0, 0), (0, 0), (0, LANES))
        levels, outlines = (np.pad(codes, some) for codes in (self.levels, self.outlines))
        where = None if self.where is None else np.pad(self.where, some[1:])
        more = replace(self, levels=levels, outlines=outlines, where=where)
        if not more.fits:
            return np.empty(self.levels.shape, np.float32), None
        (level, outlined), part = more.level(), (..., slice(self.levels.shape[2]))
        return level[part], None if outlined is None else outlined[part]


def of_every_band(level: Float32Array, bands: Sequence[int], count: int) -> Float32Array:
    """A level of some bands as that of so many: NaN in the others."""
    if len(level) == count:
        return level
    every = np.full((count, *level.shape[1:]), np.nan, np.float32)
    every[list(bands)] = level
    return every


def blurred(
    band: Float32Array, psf: PSF, within: Window | None = None, *, sound: bool = False, out: Float32Array | None = None
) -> Float32Array:
    """A level of sharpened pixels as the sensor would see it: convolved with the PSF's separable form.

    NaN has no share and stays. Exact at tile edges with `psf.radius` pixels around a tile; `within` names the rows and
    columns that are wanted, `out` the array that they go to. Cost, one core with vectors of 16 float32: 1.0 ns a pixel
    at f/10 (`python -m benchmarks stages`).
    """
    wanted = within or ((0, band.shape[0]), (0, band.shape[1]))
    return by_products(band, products(psf), 0, wanted, sound=sound, out=out)


@dataclass(frozen=True)
class Witness:
    """A band that shows glint wherever another does, as bands of one instant do: outlines of sparkle agree in them.

    Attributes
    ----------
    band : int
        Its place among the bands that are opened.
    sure : sequence of float
        Of each of these: what exceeds the level by more is no noise.
    reach : int
        Pixels around what stands out in others, and not in this one, in which outlines may count.
    """

    band: int
    sure: Sequence[float]
    reach: int


def openings_of(
    bands: Iterable[Float32Array],
    shape: tuple[int, int, int],
    size: int,
    grids: Sequence[Grid],
    *,
    detail: int,
    order: Sequence[int],
    spectrum: Sequence[float],
    within: Window,
    where: Mask | None = None,
    witness: Witness | None = None,
) -> Opened:
    """The openings of every band; see `opened_level`."""
    told: Iterable[Codes] = (encoded(band, *grid) for band, grid in zip(bands, grids, strict=True))
    known, pieces = None, None
    if where is not None:
        where = where[slice(*within[0]), slice(*within[1])]
    elif witness is not None and detail:
        kept = list(told)
        told, (known, where) = kept, _without_glint(kept, size, grids, spectrum, within, shape[1:], witness)
    if where is not None:
        detail = detail if where.any() else 0
        pieces = _pieces(where, opening_halo(size, detail)) if detail else None
    levels = np.empty((shape[0], *(last - first for first, last in within)), np.int16) if known is None else known
    outlines = np.empty_like(levels) if detail else levels
    for codes, level, outline in zip(told, levels, outlines, strict=True):
        beside = detail if pieces is None else 0
        if known is None or beside:
            openings(codes, size, beside, within=within, out=(level if known is None else None, outline))
        if pieces is not None:
            openings_of_pieces(codes, size, detail, pieces, PIECE, within=within, out=outline)
    if not detail and witness is None:
        return Opened(levels, levels, grids, spectrum, ())
    return Opened(
        levels, outlines, grids, spectrum, order, where=where, witness=None if witness is None else witness.band
    )


def _without_glint(
    told: Sequence[Codes], size: int, grids: Sequence[Grid], spectrum: Sequence[float], within: Window,
    shape: Sequence[int], witness: Witness,
) -> tuple[Codes, Mask]:  # fmt: skip
    """The openings by a square, and the surroundings of what they lose that is more than glint, as the witness shows
    it."""
    wide = _grown(within, witness.reach, shape)
    levels = np.empty((len(told), *(last - first for first, last in wide)), np.int16)
    for codes, level in zip(told, levels, strict=True):
        openings(codes, size, within=wide, out=(level, level))
    found, b = np.zeros(levels.shape[1:], np.bool_), witness.band
    seen = decoded(told[b][slice(*wide[0]), slice(*wide[1])], *grids[b]) - decoded(levels[b], *grids[b])
    shown = np.fmax(seen, np.float32(0))
    for n, (codes, level) in enumerate(zip(told, levels, strict=True)):
        if n != b:
            share = BEYOND * spectrum[n] / spectrum[b]
            found |= exceeding(codes, level, wide, grids[n], witness.sure[n], shown, share)
    (top, bottom), (left, right) = (_shifted(a, b) for a, b in zip(within, wide, strict=True))
    part = slice(top, bottom), slice(left, right)
    return np.ascontiguousarray(levels[:, *part]), grown(found, witness.reach)[part]


def _pieces(where: Mask, halo: int) -> npt.NDArray[np.int64] | None:
    """First row and column of the squares of `PIECE` that hold a mask; None for where it takes less to look
    everywhere."""
    rows, columns = (np.arange(0, n, PIECE) for n in where.shape)
    some = np.logical_or.reduceat(np.logical_or.reduceat(where, rows, axis=0), columns, axis=1)
    if some.mean() * (1 + 2 * halo / PIECE) ** 2 > MOST_LOOKED_AT or min(where.shape) < PIECE:
        return None
    corners = PIECE * np.argwhere(some)
    return np.minimum(corners, np.array(where.shape) - PIECE)


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
    where: Mask | None = None,
    least: Sequence[float] = (),
    witness: Witness | None = None,
    sound: bool = False,
) -> tuple[Float32Array, Mask | None]:
    """The level of the water of every band, and where an outline of a thing is part of it.

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
        Octagon that follows outlines where bands agree [pixel]; 0 for none, nor for a diamond. In bands of one
        instant sparkle agrees, too: they need a witness.
    order : sequence of int
        Bands by wavelength.
    spectrum : sequence of float
        Brightness of glint in each band.
    psfs : sequence of PSF, optional
        Blur the level with these: of sharpened bands.
    within : ((row0, row1), (col0, col1)), optional
        Only these rows and columns are wanted.
    where : (row, column) bool ndarray, optional
        Where other openings than that of the square count, if not everywhere.
    least : sequence of float
        Of each band: outlines are where other openings add more than this to the level of half of the bands or more.
        They are not told without.
    witness : Witness, optional
        Other openings count only about what stands out but in this band, and as far as they do not in it.
    sound : bool
        Every number is known to be finite, and is not looked at for that.

    Returns
    -------
    level : (band, row, column) float32 ndarray
    outlined : (row, column) bool ndarray, or None
        None where that is not told.
    """
    inner = within or ((0, shape[1]), (0, shape[2]))
    reach = max((p.radius for p in psfs or ()), default=0)
    outer = _grown(inner, reach, shape[1:])
    opened = openings_of(
        bands,
        shape,
        size,
        grids,
        detail=detail,
        order=order,
        spectrum=spectrum,
        within=outer,
        where=where,
        witness=witness,
    )
    level, outlined = replace(opened, least=least).level()
    del opened
    if psfs is None:
        return level, outlined
    (top, bottom), (left, right) = (_shifted(a, b) for a, b in zip(inner, outer, strict=True))
    if outlined is not None:
        outlined = outlined[top:bottom, left:right]
    out = np.empty((shape[0], bottom - top, right - left), np.float32)
    for i, psf in enumerate(psfs):
        blurred(level[i], psf, ((top, bottom), (left, right)), sound=sound, out=out[i])
    return out, outlined


def _grown(window: Window, reach: int, shape: Sequence[int]) -> Window:
    """A window with so many pixels around it, as far as the array goes."""
    rows, columns = ((max(a - reach, 0), min(b + reach, n)) for (a, b), n in zip(window, shape, strict=True))
    return rows, columns


def _shifted(part: tuple[int, int], whole: tuple[int, int]) -> tuple[int, int]:
    """A range counted from the beginning of another."""
    return part[0] - whole[0], part[1] - whole[0]
