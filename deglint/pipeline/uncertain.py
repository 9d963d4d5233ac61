"""Learn a scene's standard errors: some of its tiles are corrected once more, and their sparkle is moved and corrected.

A trial lays what a tile has above and below its level on the same level elsewhere, around the tile's edges, and runs
the chain on that: a sea like the tile's, whose truth is known. See `deglint.compensate.trials`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..compensate import State, apply_stages, finish
from ..compensate.identify import IdentifyLevel
from ..compensate.state import Float32Array
from ..compensate.trials import Sea, Trial, growth
from ..compensate.uncertainty import Parts, fit
from ..errors import FitError, InputError
from ..raster.environment import enter_thread
from ..readers.roles import find_nir
from ..remove import apply
from ..remove.model import removed
from ..tiles import Tile
from .correct import Correction

Move = tuple[float, float]
Moments = npt.NDArray[np.float64]
NONE = np.zeros((2, 0, 3))
VALUES = 8 << 20
"""Most values (pixels times bands) that are looked at, and that trials are made of where one of each tile is fewer."""
MOVES = ((0.5, 0.5), (0.25, 0.75), (0.75, 0.25), (0.5, 0.0))
"""Where trials lay the sparkle: so much of a tile down and to the right. Small scenes get all, for what is rare."""
AGAIN = (0.25, 0.75)
"""How much further than the first of these the second trial lays it: nowhere near where it came from."""


def with_stderr(work: Correction, everything: Sequence[Tile], nir: Sequence[str], threads: int) -> Correction:
    """The same correction, which tells standard errors as well.

    Parameters
    ----------
    work : Correction
    everything : sequence of Tile
        The scene in tiles to learn from. The errors depend on them, so they must not depend on the file's blocks.
    nir : sequence of str
        NIR bands that were named; found where empty.
    threads : int

    Raises
    ------
    FitError, InputError
        Too few clean pixels, or a compensation that has no level.
    """
    work = replace(work, want_stderr=True)
    levels = [s for s in work.chain.before if isinstance(s, IdentifyLevel)]
    if work.chain.before and (not levels or not any(s.name == "replace-level" for s in work.chain.before)):
        raise InputError("--stderr needs a compensation with replace-level before the removal, or --compensate off.")
    bands = tuple(work.changed)
    if levels and set(bands) - set(levels[-1].bands):
        raise InputError("--stderr needs a level of every band: leave it out, or identify glint in all bands.")
    most = VALUES // len(work.scene.bands)
    chosen = tiling.spread(everything, most)
    moves = MOVES[: max(most // sum(t.shape[0] * t.shape[1] for t in chosen), 1)]

    def look(tile: Tile) -> tuple[Parts, list[Trial], Moments] | None:
        parts = work(tile).parts
        if parts is None or not parts.where.any():
            return None
        return (parts, [], NONE) if parts.level is None else (parts, *_looked(work, parts, moves))

    found = [f for _t, f in tiling.run(chosen, look, threads=threads, start=enter_thread) if f]
    looks, trials = [parts for parts, _, _ in found], [trial for _, some, _ in found for trial in some]
    if not looks:
        raise FitError("no pixel is corrected in the tiles that were looked at, so --stderr has nothing to learn from.")
    if not levels:
        return replace(work, uncertainty=fit(looks, work.model, bands))
    stage = levels[-1]
    reference = find_nir(work.scene, list(nir) or None)[0]
    glint = {band: mean * _skirt(work, band, reference) for band, mean in zip(stage.bands, stage.spectrum, strict=True)}
    cover = stage.cover[stage.bands.index(reference)] if reference in stage.bands else float(np.median(stage.cover))
    more = growth(*np.sum([moments for _, _, moments in found], axis=0))
    learnt = fit(looks, work.model, bands, trials=trials, growth=more, reference=reference, glint=glint, cover=cover)
    return replace(work, uncertainty=learnt)


def _skirt(work: Correction, band: int, reference: int) -> float:
    """How much less than in the reference flashes raise the level beside them: diffraction goes with the wavelength.

    Of a band that removal corrects what is left has been set against its glint as it is.
    """
    here, there = (work.scene.bands[b].wavelength for b in (band, reference))
    if here is None or there is None or any(f.band == band for f in work.model.fits):
        return 1.0
    return min(here / there, 1.0)


def _looked(work: Correction, parts: Parts, moves: Sequence[Move]) -> tuple[list[Trial], Moments]:
    """Trials of a tile, and moments of the first one and of another that begins with what that one found."""
    sea = _sea(parts)
    scale = sea.noise()
    sea = sea.steady(scale)
    first, found = _trial(work, sea, scale, moves[0])
    second, _ = _trial(work, found.steady(scale), scale, AGAIN)
    moments = np.stack([first.moments(), second.moments()])
    return [first, *(_trial(work, sea, scale, move)[0] for move in moves[1:])], moments


def _sea(parts: Parts) -> Sea:
    """A tile as it is, on its level; things that were put back are left out."""
    assert parts.level is not None
    assert parts.replaced is not None
    level = parts.level[(slice(None), *parts.inner)]
    usable = parts.where & np.isfinite(level).all(axis=0) & np.isfinite(parts.before).all(axis=0)
    if parts.kept is not None:
        usable &= ~parts.kept
    return Sea(parts.before, level, parts.replaced, usable)


def _trial(work: Correction, sea: Sea, scale: Float32Array, move: Move) -> tuple[Trial, Sea]:
    """What the chain makes of a tile's sparkle and noise on its own level, so much of the tile further; and that sea,
    on the level that was found."""
    by = int(move[0] * sea.usable.shape[0]), int(move[1] * sea.usable.shape[1])
    tried = sea.laid(scale, by)
    state = apply_stages(State.of(tried), work.chain.before)
    assert state.water is not None
    found = state.water * state.units.astype(np.float32)[:, None, None]
    clean, replaced, outlined = finish(state, tried), state.replaced, state.outlined
    truth, level = sea.level, found
    if work.model.fits:
        clean, truth, level = removed(clean, work.model), apply(truth, work.model), apply(found, work.model)
    if work.chain.after:
        state = State.own(clean)
        state.outlined = outlined
        apply_stages(state, work.chain.after)
        clean, replaced = finish(state, clean), replaced | state.replaced
    where = sea.usable & np.roll(sea.usable, by, axis=(0, 1))
    trial = Trial(clean - truth, replaced, where, level, clean - level)
    return trial, Sea(tried, np.where(sea.usable, found, sea.level), replaced, sea.usable)
