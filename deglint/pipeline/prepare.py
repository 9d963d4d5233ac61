"""Prepare the correction of a scene: layout of the output, tiles, and estimates of noise and standard errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .. import tiles as tiling
from ..compensate import Background, Posterior, Sample, Setting, State, apply_chain, fit_removed, fit_replaced
from ..errors import FitError, InputError
from ..raster.environment import enter_thread
from ..raster.output import Layout
from ..readers.areas import open_area
from ..readers.roles import find_band
from ..remove.noise import noise
from ..scene import Scene
from ..tiles import Tile
from .correct import CHAIN_CELL, Correction
from .fit import Fitted
from .outputs import Outputs
from .overview import block_of, raster_of, tile_shape_of

STRIP = 4 << 20
"""Values in a tile of whole cells for files stored in strips, so that few strips are read twice."""
TILES = 8
"""Tiles from which noise and errors are estimated: spread over the scene; few, as each is corrected twice more."""
TRIAL_SIDE = 192
"""Side of these tiles [pixel]: a trial displaces glint by half a tile."""


def correction(
    scene: Scene, fitted: Fitted, *, mask: str | None = None, targets: Outputs | None = None, dtype: str | None = None,
    threads: int = 1,
) -> Correction:  # fmt: skip
    """The function that corrects the tiles of a scene, from a fit.

    `mask` and `dtype` override the recipe's mask and the scene's data type. `targets` are the outputs; noise and
    standard errors are estimated if an output needs them, with `threads` threads.
    """
    info, bands = raster_of(scene).info, tuple(range(len(scene.bands)))
    wanted = mask or fitted.recipe.mask
    area = None if wanted in ("auto", "none") else open_area(wanted, scene, "--mask")
    out = np.dtype(dtype or info.dtype)
    nodata, masked = marking(scene, out)
    # bands of files without descriptions are known by their files' names, and must be in the output, too
    names = tuple(info.descriptions[b] or scene.bands[b].name for b in bands)
    layout = Layout(info, bands, out.name, nodata, targets.options if targets else {}, names=names, masked=masked)
    work = Correction(
        scene, fitted.model, layout, fitted.chain, area, fitted.water if wanted == "auto" else None,
        fitted.water_bands, tuple(find_band(scene, b) for b in fitted.recipe.bands),
        want_flags=bool(targets and targets.flags), want_amount=bool(targets and targets.amount),
    )  # fmt: skip
    if work.want_flags:
        work = with_noise(work, threads)
    if targets and targets.stderr:
        work = with_stderr(work, threads)
    return replace(work, layout=replace(layout, tile=_tile_shape(work)))


def _tile_shape(work: Correction) -> tuple[int, int]:
    """Rows and columns of the tiles in which a scene is corrected: whole cells if there is a chain."""
    scene, bands = work.scene, len(work.scene.bands)
    shape = tile_shape_of(scene)
    if work.by_cells:
        cells = max(STRIP // (CHAIN_CELL * bands) // CHAIN_CELL, 1) if shape[1] >= scene.width else 1
        return CHAIN_CELL, cells * CHAIN_CELL
    if work.halo:
        return tiling.compact(shape, block_of(scene), bands, work.halo, held=tiling.HELD_ALONE)
    return shape


def marking(scene: Scene, dtype: np.dtype[Any]) -> tuple[float | None, bool]:
    """How the output marks invalid pixels: nodata value, and whether it has a mask.

    The nodata is that of the input, if the type can hold it. There is a mask if the input has one, or if its nodata
    cannot be expressed otherwise.
    """
    source = raster_of(scene)
    value = next((n for n in source.info.nodatas if n is not None), None)
    masked = any(f.dataset_mask or f.band_masks or f.alpha is not None for f in source.files)
    if dtype.kind == "f":
        held = value is None or not np.isfinite(value) or abs(value) <= np.finfo(dtype).max
        return (value if held else float("nan")), masked
    limits = np.iinfo(dtype)
    if value is not None and limits.min <= value <= limits.max and float(value).is_integer():
        return value, masked
    return None, masked or value is not None or source.info.dtype.kind == "f"


def with_stderr(work: Correction, threads: int) -> Correction:
    """The same correction, with standard errors.

    Raises FitError, InputError: no band is corrected, no water in the tiles, or a compensation without an error
    estimate.
    """
    if not work.changed:
        raise InputError("no band is corrected, so it has no standard error: leave out --stderr, or name --method.")
    opens = any(isinstance(stage, Background) for stage in work.chain.before)
    if work.chain.replaces and not opens:
        raise InputError("--stderr needs a compensation with identify-level, or --compensate off.")
    scene = work.scene

    def read(tile: Tile) -> tuple[State, np.ndarray]:
        outer = tile.grown(work.halo, scene.height, scene.width)
        block = scene.source.read(outer.window, list(range(len(scene.bands))))
        state = State.of(block, work.water_in(outer, block), (outer.row0, outer.col0))
        inside = np.zeros(outer.shape, np.bool_)
        inside[tile.within(outer)] = True
        return state, inside & state.water

    found = tiling.run(_tiles_of(scene), read, threads=threads, start=enter_thread)
    chosen = [part for _t, part in found if part[1].any()]
    if not chosen:
        raise FitError("no pixel is corrected in the tiles that were read, so --stderr has nothing to learn from.")
    inside = tuple(m for _s, m in chosen)
    before = Sample(tuple(s for s, _m in chosen), inside)
    after = Sample(tuple(apply_chain(s, work.chain, work.model) for s in before.states), inside)
    if opens:
        errors = fit_replaced(before, after, lambda s: apply_chain(s, work.chain, work.model))
        return replace(work, want_stderr=True, replaced=errors)
    if any(isinstance(stage, Posterior) and stage.resolved for stage in work.chain.after):
        return replace(work, want_stderr=True)
    left = fit_removed(after, Setting(scene.bands, tuple(work.model.index_bands) or (0,)), work.model)
    return replace(work, want_stderr=True, left=left)


def with_noise(work: Correction, threads: int) -> Correction:
    """The same correction, with the noise of the corrected bands: pixel noise and rounding in the file."""
    scales = raster_of(work.scene).info.scales
    rounded = np.dtype(work.layout.dtype).kind in "iu"
    found = tiling.run(_tiles_of(work.scene), work.corrected, threads=threads, start=enter_thread)
    done = [part for _t, part in found]
    inside = [where for _p, where in done]
    pixels = [noise([np.nan_to_num(p[b]) for p, _w in done], inside) for b in work.changed]
    steps = [scales[b] / 12**0.5 if rounded else 0.0 for b in work.changed]
    return replace(work, noise=tuple(float(np.hypot(n, s)) for n, s in zip(pixels, steps, strict=True)))


def _tiles_of(scene: Scene) -> list[Tile]:
    """Tiles for the estimates."""
    return tiling.spread(tiling.tiles(scene.height, scene.width, (TRIAL_SIDE, TRIAL_SIDE)), TILES * TRIAL_SIDE**2)
