"""Run work over an array's tiles: a lazy one's own chunks, when they are asked for; else tiles on threads, now.

What `deglint.xr` and `detect.xr` share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..raster.environment import enter_thread
from ..raster.source import ArraySource
from ..readers.arrays import ArrayScene
from ..scene import Scene
from ..tiles import Tile, default_threads

Work = Callable[[Scene, Tile], npt.NDArray[Any]]
"""What makes a (band, row, column) array of a tile of a scene."""


def over_tiles(
    opened: ArrayScene, work: Work, reach: int, like: tuple[int, np.dtype[Any]], *, step: int = 1,
    threads: int | None = None,
) -> Any:  # fmt: skip
    """Run work on a scene's tiles: a lazy array's chunks, later; else tiles on threads, now.

    Parameters
    ----------
    opened : ArrayScene
    work : callable
        Is given a scene that serves the tile and `reach` pixels around it. It must be picklable.
    reach : int
    like : (int, dtype)
        Bands and type of the result.
    step : int
        Tiles start at multiples of it.

    Returns
    -------
    (band, row, column) numpy or dask array
    """
    scene, values = opened.scene, opened.values
    if hasattr(values, "dask"):
        return _lazily(replace(scene, source=DetachedSource()), opened, work, reach, like, step)
    block = max(step, tiling.COMPACT) // step * step
    out = np.empty((like[0], scene.height, scene.width), like[1])
    every = tiling.tiles(scene.height, scene.width, (block, block))
    threads = tiling.affordable(threads or default_threads(), (block, block), 3 * len(scene.bands))
    for tile, done in tiling.run(every, partial(work, scene), threads=threads, start=enter_thread):
        (row0, row1), (col0, col1) = tile.window
        out[:, row0:row1, col0:col1] = done
    return out


class DetachedSource:
    """Replaces the source of a scene in a Dask task, so that the task does not carry the whole array."""

    def read(self, *_: Any) -> Any:
        """Never called."""
        raise AssertionError("unreachable: every chunk has a source of its own")


def _lazily(bare: Scene, opened: ArrayScene, work: Work, reach: int, like: tuple[int, np.dtype[Any]], step: int) -> Any:
    from dask.array import map_blocks
    from dask.array.overlap import overlap

    values = opened.values.rechunk({0: -1})
    chunks = [_aligned(c, step, reach) for c in values.chunks[1:]]
    values = values.rechunk({1: chunks[0], 2: chunks[1]})
    starts = [np.concatenate([[0], np.cumsum(c)]).tolist() for c in values.chunks[1:]]
    padded = overlap(values, {1: reach, 2: reach}, "none", allow_rechunk=False) if reach else values
    info = opened.scene.source.info  # type: ignore[attr-defined]
    task = _Chunk(bare, info, work, reach, (tuple(starts[0]), tuple(starts[1])))
    return map_blocks(
        task, padded, dtype=like[1], chunks=((like[0],), *values.chunks[1:]), meta=np.empty((0, 0, 0), like[1])
    )  # fmt: skip


class _Chunk:
    """A chunk's task: cut out where it lies in the scene, and run the work on it."""

    def __init__(self, scene: Scene, info: Any, work: Work, reach: int, starts: tuple[tuple[int, ...], ...]) -> None:
        self.scene, self.info, self.work, self.reach, self.starts = scene, info, work, reach, starts

    def __call__(self, block: npt.NDArray[Any], block_id: tuple[int, ...] | None = None) -> npt.NDArray[Any]:
        if block_id is None:
            raise AssertionError("unreachable: dask says which block it is")
        (row0, row1), (col0, col1) = (s[i : i + 2] for s, i in zip(self.starts, block_id[1:], strict=True))
        tile = Tile(row0, row1, col0, col1)
        outer = tile.grown(self.reach, self.scene.height, self.scene.width)
        source = ArraySource(block, self.info, (outer.row0, outer.col0))
        return self.work(replace(self.scene, source=source), tile)


def _aligned(chunks: tuple[int, ...], step: int, least: int) -> tuple[int, ...]:
    """Chunks that start at multiples of `step`, their edges moved up to the next, and hold `least` pixels or more."""
    total, edges = sum(chunks), [0]
    for edge in np.cumsum(chunks[:-1]):
        moved = -(-int(edge) // step) * step
        if moved - edges[-1] >= max(least, 1) and total - moved >= max(least, 1):
            edges.append(moved)
    return tuple(int(n) for n in np.diff([*edges, total]))
