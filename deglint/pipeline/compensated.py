"""What a tile is on its way through compensation, and what has become of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..compensate import Chain, State
from ..compensate.presence import Cells, Share
from ..remove import GlintModel
from ..scene import Scene
from ..tiles import Tile


@dataclass(frozen=True, eq=False)
class Shown:
    """Where a block shows glint (None: not asked), how much of the removal and what follows is done in its tile, and
    how much of anything (None: all of it everywhere); and the tile's own values, where less is done."""

    cells: Cells | None = None
    share: Share | None = None
    quiet: Share | None = None
    own: Any = None


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
