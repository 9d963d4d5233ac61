"""Parts of a scene without glint: how they are known, as far as a sample shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..compensate import Sample, Setting, Step, fit_stages
from ..compensate.identify import IdentifyLevel
from ..compensate.presence import FAR, Cells, Presence, fit
from ..errors import FitError
from ..needs import Needs
from ..scene import Scene
from ..tiles import Tile
from .blocks import Blocks, workers
from .look import core_of

BY_CHANCE = 0.01
"""Probability that flashes as many as the sample has leave out all cells that must show none; below it, they cannot."""
REMAINS = 0.001
"""Of the variance that glint adds to the sample's bands: what stands out less in cells without is no flash, but sky."""
LEAST_CALM = 0.01
"""Share of the sample that must be far from glint in the NIR for other bands to be looked at there."""


def find_presence(
    blocks: Blocks, needs: Needs, setting: Setting, stage: IdentifyLevel, threads: int
) -> tuple[Presence | None, float]:
    """Where there is glint, and whether other bands have none far from that of the NIR.

    Parameters
    ----------
    blocks : Blocks
        As they were read.
    needs : Needs
    setting : Setting
        With the NIR.
    stage : IdentifyLevel
        What the whole sample shows.
    threads : int

    Returns
    -------
    Presence or None, float
        None where the sample does not tell; and the share of the sample that has none in the NIR.
    """
    sample, nir = blocks.sample, setting.nir
    assert nir is not None
    looks = [(s.image[nir], m) for s, m in zip(sample.states, sample.inside, strict=True)]
    known = fit(looks, nir, stage.sigmas[nir], quiet=int(needs.simultaneous))
    if known is None:
        return None, 0.0
    tiles = blocks.grown()
    cells = [known.cells(s.image, t.row0, t.col0) for s, t in zip(sample.states, tiles, strict=True)]

    def calm_of(told: Presence) -> list[npt.NDArray[np.bool_]]:
        parts = zip(cells, sample.inside, tiles, strict=True)
        return [m & _calm(told, c, t, blocks.scene) for c, m, t in parts]

    total = sum(int(m.sum()) for m in sample.inside)
    share = sum(int(m.sum()) for m in calm_of(known)) / total
    if needs.simultaneous:
        return known, share
    far = replace(known, quiet=FAR)
    calm = calm_of(far)
    if sum(int(m.sum()) for m in calm) < LEAST_CALM * total:
        return known, share
    parts = zip(cells, sample.inside, tiles, strict=True)
    shown = np.concatenate([c.inside(m, t.row0, t.col0) for c, m, t in parts]) > 0
    if (1 - shown.mean()) ** ((2 * FAR + 1) ** 2) > BY_CHANCE:
        return known, share
    try:
        with workers(threads) as each:
            step = Step("identify-level", needs.element)
            (rest,) = fit_stages([step], Sample(sample.states, calm), setting, each=each, cuts=None)
    except FitError:
        return known, share
    left = replace(needs, glint=rest.glint, things=rest.things).glinted
    ours, all_of_it = (np.array(s.glint) * np.array(s.sigmas) ** 2 for s in (rest, stage))
    return known if any(ours[b] >= REMAINS * all_of_it[b] for b in left) else far, share


def _calm(known: Presence, cells: Cells, tile: Tile, scene: Scene) -> npt.NDArray[np.bool_]:
    """Pixels of a block, as it was read, that show no glint, as far as the block tells."""
    out, halo = np.zeros(tile.shape, np.bool_), known.halo
    top, left = (halo * (first > 0) for first in (tile.row0, tile.col0))
    bottom, right = (halo * (last < n) for last, n in ((tile.row1, scene.height), (tile.col1, scene.width)))
    inner = Tile(tile.row0 + top, tile.row1 - bottom, tile.col0 + left, tile.col1 - right)
    if min(inner.shape) <= 0:
        return out
    share = cells.share(*inner.window, max(known.quiet, 1))
    if share is not None:
        out[core_of(inner.crop_of(tile), tile.shape)] = share == 0
    return out
