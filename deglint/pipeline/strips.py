"""Strips of detectors with opposite delays in a scene: from the product's footprints, or found in all of the image."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .. import tiles as tiling
from ..moments import CELL
from ..raster.environment import enter_thread
from ..remove import SampleTile
from ..remove.strips import Strips, filled
from ..remove.wiener import StripFinder
from ..scene import Scene
from ..tiles import Tile
from .look import LOOK_SIDE


def strips_of_footprints(scene: Scene, band: int) -> Strips | None:
    """Strips by the footprints of a band's detectors, odd and even; None where there are none, or of one kind alone."""
    if scene.footprints is None:
        return None
    centres = np.minimum(np.arange(CELL // 2, scene.width + CELL // 2, CELL), scene.width - 1)
    known = []
    for row in range(CELL // 2, scene.height + CELL // 2, CELL):
        at = min(row, scene.height - 1)
        line = scene.footprints.read(((at, at + 1), (0, scene.width)), [band])[0, 0, centres]
        known.append(np.where(np.isfinite(line), np.nan_to_num(line) % 2, -1).astype(np.int8))
    second = filled(np.array(known))
    return Strips.of(second) if second.any() and not second.all() else None


def strips_finder(scene: Scene, read: Callable[[Tile], SampleTile], threads: int) -> Callable[[StripFinder], Strips]:
    """What looks at all of a scene for strips, square by square, once a sample has shown that there are some."""

    def find(finder: StripFinder) -> Strips:
        known = np.full((-(-scene.height // CELL), -(-scene.width // CELL)), -1, np.int8)
        everything = tiling.tiles(scene.height, scene.width, (LOOK_SIDE, LOOK_SIDE))
        found = tiling.run(everything, lambda tile: finder(read(tile)), threads=threads, start=enter_thread)
        for _tile, (places, second) in found:
            known[places[:, 0] // CELL, places[:, 1] // CELL] = second
        return Strips.of(filled(known))

    return find
