"""What a tile is on its way through compensation, and what has become of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..compensate import Chain, State
from ..compensate.faint import SKIRT, give_back
from ..compensate.noise import Spread
from ..compensate.presence import Cells, Presence, Share
from ..remove import GlintModel
from ..scene import Scene
from ..tiles import Tile
from .look import core_of, place_in


@dataclass(frozen=True, eq=False)
class Shown:
    """Where a tile shows glint: how much of the removal and what follows is done (None: all of it), and how much of
    anything (None: the same); and where less is done, what was there, with `SKIRT` pixels around the tile."""

    tile: Tile
    skirted: Tile
    cells: Cells | None = None
    share: Share | None = None
    quiet: Share | None = None
    was: Any = None

    @property
    def own(self) -> Any:
        """The tile's own values."""
        return self.was[place_in(self.tile, self.skirted)]

    def opened(self, image: Any, replaced: Any, spreads: Sequence[Spread], middle: Tile) -> Any:
        """The tile as an opening leaves it, but for half of what that takes from faint pixels without glint.

        image, replaced : of `middle`, a larger tile; the image is worked on itself where nothing follows in the tile
        """
        assert self.share is not None
        here, around, follows = image[place_in(self.tile, middle)], place_in(self.skirted, middle), self.share.any()
        if self.quiet is not None and not ((self.quiet > 0) & (self.share == 0)).any():
            return here.copy() if follows else here
        made = np.empty(here.shape, here.dtype) if follows else here
        inner = core_of(self.tile.crop_of(self.skirted), self.skirted.shape)
        give_back(image[around], self.was, replaced[around], self.share, spreads, inner, made)
        return made


def shown_in(presence: Presence | None, block: Any, tile: Tile, outer: Tile) -> Shown:
    """Where the tile of a block, that of `outer`, shows glint, as far as that is known before anything is done."""
    skirted = tile.grown(SKIRT, outer.row1, outer.col1)
    if presence is None:
        return Shown(tile, skirted)
    cells = presence.cells(block, outer.row0, outer.col0)
    share = cells.share(*tile.window)
    if share is None:
        return Shown(tile, skirted, cells)
    quiet = cells.share(*tile.window, presence.quiet) if presence.quiet else None
    return Shown(tile, skirted, cells, share, quiet, block[place_in(skirted, outer)])


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
