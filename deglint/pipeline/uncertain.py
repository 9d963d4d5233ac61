"""Learn a scene's noise and standard errors from some of its tiles, which are corrected once more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .. import tiles as tiling
from ..compensate import Background, Posterior, Sample, Setting, State, apply_chain, fit_posterior, fit_replaced
from ..errors import FitError, InputError
from ..raster.environment import enter_thread
from ..remove.noise import noise
from ..scene import Scene
from ..tiles import Tile
from .correct import Correction, Errors
from .overview import raster_of

TILES = 8
"""Tiles that are learnt from: spread over the scene, and few, as each is corrected twice more."""
TRIAL_SIDE = 192
"""Their side [pixel]: a trial lays glint half a tile away."""


def with_stderr(work: Correction, threads: int) -> Correction:
    """The same correction, which gives standard errors as well.

    Raises
    ------
    FitError, InputError
        No water in the tiles, or a compensation whose error is not known.
    """
    opens = any(isinstance(stage, Background) for stage in work.chain.before)
    replaces = work.chain.replaces
    if replaces and not opens:
        raise InputError("--stderr needs a compensation with identify-level, or --compensate off.")
    scene = work.scene

    def read(tile: Tile) -> tuple[State, np.ndarray]:
        outer = tile.grown(work.halo, scene.height, scene.width)
        block = scene.source.read(outer.window, list(range(len(scene.bands))))
        state = State.of(block, work.water_in(outer, block), (outer.row0, outer.col0))
        inside = np.zeros(outer.shape, np.bool_)
        inside[tile.within(outer)] = True
        return state, inside & state.water

    some = _tiles_of(scene)
    chosen = [part for _t, part in tiling.run(some, read, threads=threads, start=enter_thread) if part[1].any()]
    if not chosen:
        raise FitError("no pixel is corrected in the tiles that were read, so --stderr has nothing to learn from.")
    inside = tuple(m for _s, m in chosen)
    before = Sample(tuple(s for s, _m in chosen), inside)
    after = Sample(tuple(apply_chain(s, work.chain, work.model) for s in before.states), inside)
    if opens:
        errors = fit_replaced(before, after, lambda s: apply_chain(s, work.chain, work.model))
        return replace(work, errors=Errors(errors))
    if any(isinstance(stage, Posterior) for stage in work.chain.after):
        return replace(work, errors=Errors())
    nir = tuple(work.model.index_bands) or (0,)
    left = fit_posterior(after, Setting(scene.bands, nir))
    return replace(work, errors=Errors((), replace(left, resolved=False)))


def with_noise(work: Correction, threads: int) -> Correction:
    """The same correction, with the noise of the corrected bands: that of the pixels, and of rounding in the file."""
    scene, info = work.scene, raster_of(work.scene).info
    some = _tiles_of(scene)
    done = [part for _t, part in tiling.run(some, work.corrected, threads=threads, start=enter_thread)]
    steps = [info.scales[b] if np.dtype(work.layout.dtype).kind in "iu" else 0.0 for b in work.changed]
    inside = [where for _p, where in done]
    found = [noise([np.nan_to_num(p[b]) for p, _w in done], inside) for b in work.changed]
    return replace(work, noise=tuple(float(np.hypot(n, s / 12**0.5)) for n, s in zip(found, steps, strict=True)))


def _tiles_of(scene: Scene) -> list[Tile]:
    """Tiles that are learnt from."""
    return tiling.spread(tiling.tiles(scene.height, scene.width, (TRIAL_SIDE, TRIAL_SIDE)), TILES * TRIAL_SIDE**2)
