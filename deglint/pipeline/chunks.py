"""Run a function over an array's tiles: over the chunks of a lazy array, later; else over tiles on threads, at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..raster.environment import enter_thread
from ..raster.source import ArraySource
from ..readers.arrays import ArrayScene
from ..scene import Scene
from ..tiles import Tile, default_threads
from .overview import raster_of

Work = Callable[[Scene, Tile], npt.NDArray[Any]]
"""Function that computes a (band, row, column) array from a tile of a scene."""


def over_tiles(
    opened: ArrayScene, work: Work, reach: int, like: tuple[int, np.dtype[Any]], *, step: int = 1,
    threads: int | None = None,
) -> Any:  # fmt: skip
    """Run `work` on a scene's tiles: lazily on the chunks of a Dask array; else at once, on threads.

    `work` must be picklable; it gets a scene from which the tile and `reach` pixels around it can be read. `like` gives
    the number of bands and the type of the result, a (band, row, column) numpy or dask array. Tiles start at multiples
    of `step` [pixel].
    """
    scene = opened.scene
    if hasattr(opened.values, "dask"):
        return _lazily(opened, work, reach, like, step)
    block = max(step, tiling.COMPACT) // step * step
    out = np.empty((like[0], scene.height, scene.width), like[1])
    every = tiling.tiles(scene.height, scene.width, (block, block))
    threads = tiling.affordable(threads or default_threads(), (block, block), 3 * len(scene.bands))
    for tile, done in tiling.run(every, partial(work, scene), threads=threads, start=enter_thread):
        (row0, row1), (col0, col1) = tile.window
        out[:, row0:row1, col0:col1] = done
    return out


def detached(scene: Scene) -> Scene:
    """A scene without its source, so that a Dask task does not carry the whole array: each chunk has its own."""
    return replace(scene, source=cast("Any", None))


def _lazily(opened: ArrayScene, work: Work, reach: int, like: tuple[int, np.dtype[Any]], step: int) -> Any:
    from dask.array import map_blocks
    from dask.array.overlap import overlap

    values = opened.values.rechunk({0: -1})
    rows, columns = (_aligned(chunks, step, reach) for chunks in values.chunks[1:])
    values = values.rechunk({1: rows, 2: columns})
    padded = overlap(values, {1: reach, 2: reach}, "none", allow_rechunk=False) if reach else values
    task = partial(_of_chunk, detached(opened.scene), raster_of(opened.scene).info, work, reach)
    chunks, meta = ((like[0],), rows, columns), np.empty((0, 0, 0), like[1])
    return map_blocks(task, padded, dtype=like[1], chunks=chunks, meta=meta)


def _of_chunk(
    scene: Scene, info: Any, work: Work, reach: int, block: npt.NDArray[Any], block_info: Any = None
) -> npt.NDArray[Any]:
    """Run the work on a chunk with the pixels around it; `block_info` (from dask) gives its position."""
    (row0, row1), (col0, col1) = block_info[None]["array-location"][1:]
    tile = Tile(row0, row1, col0, col1)
    outer = tile.grown(reach, scene.height, scene.width)
    return work(replace(scene, source=ArraySource(block, info, (outer.row0, outer.col0))), tile)


def _aligned(chunks: tuple[int, ...], step: int, least: int) -> tuple[int, ...]:
    """Chunks with edges moved up to multiples of `step`, of at least `least` pixels each."""
    total, edges = sum(chunks), [0]
    for edge in np.cumsum(chunks[:-1]):
        moved = -(-int(edge) // step) * step
        if moved - edges[-1] >= max(least, 1) and total - moved >= max(least, 1):
            edges.append(moved)
    return tuple(int(n) for n in np.diff([*edges, total]))
