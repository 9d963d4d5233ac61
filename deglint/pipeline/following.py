"""The NIR that a band follows: that of the water around what is no glint, and moved to where the band saw the sea.

A removal at coarse pixels follows the NIR pixel by pixel. Two things make it follow better: ships and surf stand out
from the water around them by more than glint does, and are given the NIR of that water; and bands that look at
different instants see the waves displaced, so that the NIR is moved by as much, where that explains more of the band.
A moved NIR is one more band, after those of the scene; the model names it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..compensate import Chain
from ..compensate.reference import ReferenceRule, standing_out
from ..compensate.register import Move, ShiftStatistics, apply_shift, shift_from, shift_halo, shift_statistics
from ..errors import InputError
from ..masks import water
from ..raster.environment import enter_thread
from ..remove import FitRequest, GlintIndex, GlintModel, apply
from ..scene import Band, Scene
from ..tiles import Tile
from .look import Look, core_of, role_bands
from .sample import Sampler

LEAST_GAIN = 0.005
"""Share of a band's variance that moving the NIR must explain more: it costs a second look at the NIR."""
Mask = npt.NDArray[np.bool_]
Planes = dict[int, npt.NDArray[Any]]


def find_moves(
    scene: Scene, request: FitRequest, look: Look, sampler: Sampler, tiles: Sequence[Tile], threads: int
) -> tuple[tuple[Move, ...], list[str]]:
    """By how much the NIR is to be moved for each band, where that helps; and what to say of it."""
    pairs = [
        (band, request.indexes[k].bands[0])
        for band, k in zip(request.correct, request.follows, strict=True)
        if k is not None and len(request.indexes[k].bands) == 1
    ]
    if not pairs:
        return (), []
    columns = sorted({b for pair in pairs for b in pair} | set(role_bands(look.roles)) | set(sampler.bands))

    def work(tile: Tile) -> list[ShiftStatistics] | None:
        block = scene.source.read(tile.window, columns)
        if block.dtype != np.float32:  # moving would cost digits
            return None
        mask = _water_of(block, columns, tile, look, sampler)
        return [shift_statistics(block[columns.index(b)], block[columns.index(n)], mask) for b, n in pairs]

    found_parts = [p for _t, p in tiling.run(tiles, work, threads=threads, start=enter_thread)]
    parts = [p for p in found_parts if p is not None]
    moves: list[Move] = []
    notes: list[str] = []
    if not parts:
        return (), []
    for i, (band, nir) in enumerate(pairs):
        found = shift_from(ShiftStatistics.merge([p[i] for p in parts]))
        if found.useful and found.r2_shifted - found.r2 >= LEAST_GAIN:
            move = Move(band, nir, found.row, found.column)
            moves.append(move)
            names = f"{scene.bands[band].name} follows {scene.bands[nir].name}"
            notes.append(
                f"{names} moved by {move.row:+.2f} rows, {move.column:+.2f} columns: "
                f"R2 {found.r2:.2f} -> {found.r2_shifted:.2f}"
            )
    return tuple(moves), notes


def _water_of(block: Any, columns: list[int], tile: Tile, look: Look, sampler: Sampler) -> Mask:
    if look.water is not None and look.water.has_water:
        return np.asarray(water([block[columns.index(b)] for b in role_bands(look.roles)], look.water))
    return np.asarray(sampler.mask(block, columns, tile))


def with_moves(request: FitRequest, moves: Sequence[Move]) -> FitRequest:
    """The request with moved NIR bands after the scene's own, each followed by its band."""
    bands, indexes, follows = list(request.bands), list(request.indexes), list(request.follows)
    for move in moves:
        follows[request.correct.index(move.band)] = len(indexes)
        indexes.append(GlintIndex((len(bands),), (1.0,)))
        bands.append(Band(name_of(request.bands, move), wavelength=request.bands[move.nir].wavelength))
    return replace(request, bands=tuple(bands), indexes=tuple(indexes), follows=tuple(follows))


def name_of(bands: Sequence[Band], move: Move) -> str:
    """What a moved NIR is called."""
    return f"{bands[move.nir].name} moved {move.row:+.2f} {move.column:+.2f}"


def for_scene(scene: Scene, model: GlintModel, chain: Chain) -> tuple[GlintModel, Chain]:
    """A fit that was saved, for a scene whose bands may stand in another order.

    Raises
    ------
    InputError
        A band that is needed is missing, or stages of a compensation were fitted to bands in another order.
    """
    old = [n.casefold() for n in model.band_names[: len(model.band_names) - len(chain.moves)]]
    new = [n.casefold() for n in scene.names]
    if chain.runs and old != new:
        raise InputError(
            f"the compensation was fitted to bands {', '.join(model.band_names)} in this order; the scene has "
            f"{', '.join(scene.names)}. Fit it to a scene like this one."
        )
    place = {i: new.index(name) for i, name in enumerate(old) if name in new}
    moved_names = model.band_names[len(old) :]
    model = model.for_bands((*scene.names, *moved_names))
    rules = tuple((place[b], rule) for b, rule in chain.references if b in place)
    moves = tuple(replace(m, band=place[m.band], nir=place[m.nir]) for m in chain.moves)
    return model, replace(chain, references=rules, moves=moves)


def without_moves(scene: Scene, model: GlintModel, chain: Chain) -> GlintModel:
    """The model with every band following its NIR as it lies."""
    count = len(scene.bands)
    own = {count + i: move.nir for i, move in enumerate(chain.moves)}
    indexes = tuple(replace(x, bands=tuple(own.get(b, b) for b in x.bands)) for x in model.indexes)
    return replace(model, indexes=indexes, band_names=model.band_names[:count])


def moved_halo(chain: Chain) -> int:
    """Pixels around a tile that moving looks at."""
    return max((shift_halo(m.row, m.column) for m in chain.moves), default=0)


def moved(nir: npt.NDArray[Any], move: Move) -> npt.NDArray[Any]:
    """The NIR moved; as it lies where nothing valid comes to lie."""
    out = apply_shift(nir, move.row, move.column)
    np.copyto(out, nir, where=np.isnan(out), casting="same_kind")
    return out


def nir_to_follow(scene: Scene, chain: Chain, tile: Tile, physical: Any, where: Mask | None) -> tuple[Planes, Mask]:
    """What to follow instead of the tile's own NIR, and which pixels stand out.

    Returns
    -------
    dict, (row, column) ndarray of bool
        For each scene band that differs, and for each moved one (after the scene's), its values over the tile.
    """
    planes: Planes = {}
    held = np.zeros(tile.shape, np.bool_)
    rules = dict(chain.references)
    for band in sorted({*rules, *(m.nir for m in chain.moves)}):
        mine = [(i, m) for i, m in enumerate(chain.moves, start=len(scene.bands)) if m.nir == band]
        rule = rules.get(band)
        if not mine and (rule is None or not _bright(physical[band], rule, where).any()):
            continue
        reach = max((shift_halo(m.row, m.column) for _, m in mine), default=0)
        outer = tile.grown(reach + (rule.halo if rule else 0), scene.height, scene.width)
        nir = scene.source.read(outer.window, [band])[0]
        inner = core_of(tile.crop_of(outer), outer.shape)
        if rule is not None:
            nir = np.array(nir)
            found, values = standing_out(nir, np.ones(outer.shape, np.bool_), rule)
            nir[found] = values
            held |= found[inner]
            planes[band] = nir[inner]
        for i, move in mine:
            planes[i] = moved(nir, move)[inner]
    return planes, held if where is None else held & where


def _bright(nir: Any, rule: ReferenceRule, where: Mask | None) -> Mask:
    with np.errstate(invalid="ignore"):
        bright = np.asarray(nir > rule.least)
    return bright if where is None else bright & where


def remove_following(physical: Any, model: GlintModel, where: Mask | None, planes: Planes) -> None:
    """Correct a tile in place; a band that follows a reference in `planes` follows that, and not the tile's own.

    A reference may itself be corrected (multiband): its own values are, only what the others follow comes from
    `planes`.
    """
    count = len(physical)
    place = {band: count + i for i, band in enumerate(planes)}
    indexes = (replace(x, bands=tuple(place.get(b, b) for b in x.bands)) for x in model.indexes)
    names = (*model.band_names[:count], *(model.band_names[b] for b in planes))
    block = np.stack([*physical, *planes.values()])
    physical[:] = apply(block, replace(model, indexes=tuple(indexes), band_names=names), where=where, out=block)[:count]
