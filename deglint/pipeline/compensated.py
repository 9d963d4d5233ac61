"""What a tile is on its way through compensation, and what has become of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..compensate import Chain, State
from ..compensate.faint import SKIRT, give_back
from ..compensate.presence import Cells, Presence, Share
from ..remove import GlintModel
from ..scene import Scene
from ..tiles import Tile
from .look import core_of, place_in


@dataclass(frozen=True, eq=False)
class Shown:
    """Where a block shows glint (None: not asked), how much of the removal and what follows is done in its tile, and
    how much of anything (None: all of it everywhere); and where less is done, what was there: `SKIRT` pixels around
    the tile with it, and which tile that is."""

    cells: Cells | None = None
    share: Share | None = None
    quiet: Share | None = None
    around: Any = None
    tile: Tile | None = None
    outer: Tile | None = None

    @property
    def own(self) -> Any:
        """The tile's own values."""
        assert self.tile is not None
        assert self.outer is not None
        return self.around[place_in(self.tile, self.outer)]

    def opened(self, image: Any, replaced: Any, spreads: Sequence[tuple[int, float]], middle: Tile) -> Any:
        """The tile as an opening leaves it, but for half of what that takes from faint pixels without glint.

        image, replaced : of `middle`, a larger tile
        """
        assert self.tile is not None
        assert self.outer is not None
        assert self.share is not None
        made, here = image[place_in(self.tile, middle)].copy(), place_in(self.outer, middle)
        if self.quiet is None or ((self.quiet > 0) & (self.share == 0)).any():
            inner = core_of(self.tile.crop_of(self.outer), self.outer.shape)
            give_back(image[here], self.around, replaced[here], self.share, spreads, inner, made)
        return made


def shown_in(presence: Presence | None, block: Any, tile: Tile, outer: Tile) -> Shown:
    """Where a block, that of `outer`, shows glint, and what its tile is where it shows none, as far as that is known
    before anything is done."""
    if presence is None:
        return Shown()
    cells = presence.cells(block, outer.row0, outer.col0)
    share = cells.share(*tile.window)
    if share is None:
        return Shown(cells)
    quiet = cells.share(*tile.window, presence.quiet) if presence.quiet else None
    around = tile.grown(SKIRT, outer.row1, outer.col1)
    return Shown(cells, share, quiet, block[place_in(around, outer)].copy(), tile, around)


@dataclass(eq=False)
class Begun:
    """A block on its way: its state, its own values where things are looked for, where that is, the block itself
    where the state does not work on that, where glint is, and the tile's own values: None once they are all rewritten,
    where nothing else is written of it."""

    state: State | None
    raw: Any
    looked: Tile
    block: Any
    shown: Shown
    own: Any = None
    alone: bool = False


@dataclass(frozen=True, eq=False)
class Compensated:
    """A tile after the chain: where it is to be corrected (None: everywhere), its bands, what was replaced in each,
    which pixels are things that were put back, and how much of the removal was done (None: all)."""

    inside: npt.NDArray[np.bool_] | None
    clean: Any
    replaced: npt.NDArray[np.bool_]
    held: npt.NDArray[np.bool_] | None = None
    level: Any = None
    removed_level: Any = None
    inner: tuple[slice, slice] = (slice(None), slice(None))
    share: Share | None = None


def changed_bands(scene: Scene, model: GlintModel, chain: Chain, only: tuple[int, ...] = ()) -> list[int]:
    """0-based bands that may change: those that removal corrects, and with compensation all, or those asked for."""
    removed = [f.band for f in model.fits]
    if not chain.runs:
        return removed
    return sorted(only) if only else list(range(len(scene.bands)))
