"""Processing of one tile: read, mask, score, flag and count."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from deglint.tiles import Tile

from ..arrays import Float32, Mask, Uint8
from ..global_rx import score
from ..lines import LineScorer
from ..local import DEFICIENT, STATES, TOO_FEW, score_part
from ..sea.model import SeaModel
from ..sea.model import score as score_sea
from ..sea.region import AFLOAT, ALONGSIDE, ATTACHED, NOT_SEA, RIM, SeaRule
from ..threshold import Tail, p_value
from .mark import Places
from .plan import Plan, read_sea

NOT_VALID, MASKED_OUT, NOT_BACKGROUND, PSEUDO_INVERSE, NO_RING = 1, 2, 4, 8, 16
ON_RIM, FLOATS, BESIDE_LAND = 32, 64, 128
MEANINGS = {
    NOT_VALID: "nodata, or not finite, in a band in use: no score",
    MASKED_OUT: "outside --mask: no score",
    NOT_BACKGROUND: "outside the area of --background: scored, but not fitted to",
    PSEUDO_INVERSE: STATES[DEFICIENT],
    NO_RING: STATES[TOO_FEW],
    ON_RIM: "sea: water beside land, half land itself: no score",
    FLOATS: "sea: no water, but small enough to float",
    BESIDE_LAND: "sea: no water, attached to land, with the size and shape of a ship or a short pier",
}
"""Bits of the flag raster, and their meanings; 0: the pixel has a score, and there is nothing to note."""
_SEA_FLAGS = {NOT_SEA: MASKED_OUT, RIM: ON_RIM, AFLOAT: FLOATS, ATTACHED: FLOATS, ALONGSIDE: BESIDE_LAND}
"""Bit of the flag raster for each class of `detect.sea.region`."""


@dataclass
class PixelCounts:
    """Number of pixels of a tile or of the whole run: all, scored, and for each reason of a missing score."""

    total: int = 0
    masked_out: int = 0  # no score: outside the mask, or (method "sea") beside land
    not_valid: int = 0  # no score: nodata or not finite; for "lines" also before the statistics have enough pixels
    scored: int = 0
    deficient: int = 0  # scored by a pseudo-inverse (local RX)
    too_few: int = 0  # no score: the ring has too few valid pixels (local RX)

    def add(self, other: Self) -> None:
        """Add the counts of another tile to these."""
        for name in vars(self):
            setattr(self, name, getattr(self, name) + getattr(other, name))


@dataclass(frozen=True, eq=False)
class Scored:
    """Results of one tile; rasters are (row, column)."""

    scores: Float32
    counts: PixelCounts
    tail: Tail | None = None  # the highest scores, if a threshold is requested; for "sea" without those of ALONGSIDE
    p_values: Float32 | None = None
    flags: Uint8 | None = None  # bits of `MEANINGS`
    beside: dict[int, Places] = field(default_factory=dict)  # pixels attached to land, by class of `detect.sea.region`


@dataclass(frozen=True, eq=False)
class Scoring:
    """Callable that scores a tile, shared by all threads. Only the method "lines" keeps a state (`lines`)."""

    plan: Plan
    keep: int = 0  # number of highest scores that a tile returns
    want_p: bool = False  # compute p-values
    want_flags: bool = False  # compute the flag raster
    lines: LineScorer = field(default_factory=LineScorer)

    def __call__(self, tile: Tile) -> Scored:
        """Read a tile, score and flag it, and count its pixels."""
        plan = self.plan
        outer = tile.grown(plan.halo, plan.scene.height, plan.scene.width)
        if plan.sea is not None and plan.model is not None:
            return self._of_sea(tile, outer, plan.sea, plan.model)
        block = plan.scene.source.read(outer.window, list(plan.bands))
        mask = plan.read_mask(outer)
        states = np.zeros(tile.shape, np.uint8)
        if plan.window is not None:
            scores, states = score_part(block, plan.window, outer, tile, mask)
            block, mask = block[tile.within(outer)], None if mask is None else mask[tile.within(outer)]
        elif plan.ready is not None:
            scores = score(block, plan.ready, mask)
        else:  # line by line, on one thread: the statistics depend on the order of the lines
            kept = block if mask is None else np.where(mask, block, np.nan)
            scores = np.stack([self.lines.score(line) for line in kept.swapaxes(0, 1)])
        found = np.minimum(scores, np.finfo(np.float32).max).astype(np.float32)
        tail = Tail.of(found, self.keep) if self.keep else None
        p_values = flags = None
        if self.want_p and plan.law:
            p_values = p_value(found / plan.unbiased, *plan.law).astype(np.float32)
        if self.want_flags:
            area = None if plan.area is None else plan.area.read(tile.window)
            marks = [(m == 0, bit) for m, bit in ((mask, MASKED_OUT), (area, NOT_BACKGROUND)) if m is not None]
            marks += [(states == DEFICIENT, PSEUDO_INVERSE), (states == TOO_FEW, NO_RING)]
            flags = _flags(np.asarray(np.isfinite(block).all(axis=0)), marks)
        return Scored(found, _count(found, mask, states), tail, p_values, flags)

    def _of_sea(self, tile: Tile, outer: Tile, rule: SeaRule, model: SeaModel) -> Scored:
        """Score and flag a tile for the method "sea", and count its pixels; `outer` is the tile with its halo."""
        block, classes, nir = read_sea(self.plan, rule, outer)
        core = tile.within(outer)
        scores = score_sea(block, classes, model, nir)[core]
        classes, valid = classes[core], np.asarray(np.isfinite(block[core]).all(axis=0))
        afloat = np.where(classes == ALONGSIDE, np.float32(np.nan), scores)
        tail = Tail.of(afloat, self.keep) if self.keep else None
        marks = ((valid & (classes == which), bit) for which, bit in _SEA_FLAGS.items())
        flags = _flags(valid, marks) if self.want_flags else None
        counts = _count(scores, np.isfinite(scores) | ~valid, np.zeros_like(classes))
        beside = {}
        for which in (ALONGSIDE, ATTACHED):
            rows, columns = np.nonzero((classes == which) & np.isfinite(scores))
            beside[which] = rows + tile.row0, columns + tile.col0, scores[rows, columns]
        return Scored(scores, counts, tail, None, flags, beside)


def _flags(valid: Mask, marks: Iterable[tuple[Mask, int]]) -> Uint8:
    """Flag raster: `NOT_VALID` where not valid, and for each (mask, bit) of `marks` the bit where the mask is True."""
    flags = np.where(valid, 0, NOT_VALID).astype(np.uint8)
    for where, bit in marks:
        flags[where] |= bit
    return flags


def _count(scores: Float32, mask: Mask | None, states: Uint8) -> PixelCounts:
    """Count the pixels of a tile; `mask` is False where masked out (None: nowhere), `states` are from `score_part`."""
    scored = int(np.count_nonzero(np.isfinite(scores)))
    outside = 0 if mask is None else scores.size - int(np.count_nonzero(mask))
    deficient, too_few = (int(np.count_nonzero(states == state)) for state in (DEFICIENT, TOO_FEW))
    return PixelCounts(scores.size, outside, scores.size - outside - scored - too_few, scored, deficient, too_few)
