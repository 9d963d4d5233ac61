"""Cut a scene into tiles and process them on threads, with bounded memory and results in the order of the tiles.

Tiles start at multiples of the cells of statistics (`deglint.moments.CELL`), so a fit does not depend on their size.
Where possible they also start at multiples of the file's blocks, so every block is read once. Worker threads read and
compute, while the calling thread takes the results in the order of the tiles and writes them.
"""

from __future__ import annotations

import math
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from itertools import groupby
from types import EllipsisType
from typing import Any, TypeVar

from .checks import T, check_number
from .moments import CELL, Crop
from .scene import Window

Part = TypeVar("Part")
RunTiles = Callable[..., Iterator[tuple["Tile", Any]]]  # type of functions that run work on tiles, as `run` does
SAMPLES = 4 << 20  # usual number of values (pixels times bands) in a tile
MOST_SAMPLES = 32 << 20  # most values in a tile, where the file has large blocks
SAMPLES_AT_ONCE = 32 << 20  # most values in all tiles in progress at a time; large tiles get fewer threads
COMPACT = 512  # usual side of tiles for work that needs a halo and many copies [pixel]
MOST_WITH_HALO = 3 << 20
"""Most values in a tile of `compact` with its halo: removal keeps a prediction for every band in memory. With 5 << 20,
two threads need 310 MB instead of 225 MB, and the same time."""
_LOCK, _LIMITS, _contexts = threading.Lock(), ExitStack(), 0  # of `one_thread_each`; the number counts its contexts
LONGEST_SIDE = 1024  # longest side of a tile [pixel], unless the blocks of the file are strips


@dataclass(frozen=True, slots=True)
class Tile:
    """A rectangle of a scene: half-open ranges of rows and columns [pixel]."""

    row0: int
    row1: int
    col0: int
    col1: int

    @property
    def window(self) -> Window:
        """The window of the tile, for `Scene.read`."""
        return (self.row0, self.row1), (self.col0, self.col1)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.row1 - self.row0, self.col1 - self.col0

    @property
    def pixels(self) -> int:
        """Number of pixels of the tile."""
        return math.prod(self.shape)

    def grown(self, halo: int, height: int, width: int) -> Tile:
        """The tile and a halo [pixel] around it, cut off at the edges of a scene of `height` x `width` pixels."""
        wide = Tile(self.row0 - halo, self.row1 + halo, self.col0 - halo, self.col1 + halo)
        return wide.clipped(Tile(0, height, 0, width))

    def clipped(self, outer: Tile) -> Tile:
        """The part of the tile that lies in the tile `outer`; without one, a side of the result is 0 or negative."""
        rows = max(self.row0, outer.row0), min(self.row1, outer.row1)
        return Tile(*rows, max(self.col0, outer.col0), min(self.col1, outer.col1))

    def split(self, down: int, across: int | None = None) -> list[Tile]:
        """Cut into tiles of `down` x `across` (default: `down`) pixels, smaller at the end, in row-major order."""
        across = across or down
        rows, columns = range(self.row0, self.row1, down), range(self.col0, self.col1, across)
        return [Tile(r, min(r + down, self.row1), c, min(c + across, self.col1)) for r in rows for c in columns]

    def within(self, outer: Tile) -> tuple[EllipsisType, slice, slice]:
        """Index that selects this tile in an array of the tile `outer`, (row, column) or (band, row, column)."""
        rows = slice(self.row0 - outer.row0, self.row1 - outer.row0)
        return ..., rows, slice(self.col0 - outer.col0, self.col1 - outer.col0)

    def crop_of(self, outer: Tile) -> Crop:
        """Numbers of rows above and below, and of columns left and right, by which `outer` exceeds this tile."""
        above, left = self.row0 - outer.row0, self.col0 - outer.col0
        return above, outer.row1 - self.row1, left, outer.col1 - self.col1


def tile_shape(height: int, width: int, bands: int, block: tuple[int, int]) -> tuple[int, int]:
    """Shape (rows, columns) of the tiles for a scene of this size, whose file has blocks of shape `block`."""
    side = int(math.sqrt(SAMPLES / bands)) // CELL * CELL
    side = min(max(side, CELL), LONGEST_SIDE)
    if block[1] >= width and block[0] < height:  # strips: whole rows, so that none is read twice
        rows = max(SAMPLES // (width * bands) // CELL * CELL, CELL)
        if rows * width * bands <= MOST_SAMPLES:
            return rows, width
    return _side(side, block[0], bands), _side(side, block[1], bands)


def compact(shape: tuple[int, int], block: tuple[int, int], bands: int, halo: int) -> tuple[int, int]:
    """Shape (rows, columns) of tiles for processing that needs a halo [pixel] and many copies of a tile in memory.

    `shape` is the usual shape of tiles, `block` the shape of the file's blocks. Tiles are wide, so that few pixels are
    read twice. With its halo, a tile has at most about `MOST_WITH_HALO` values, or more if there are many bands.
    """
    rows, half = _side(min(max(shape[0], COMPACT // 2), COMPACT), block[0], 1), COMPACT // 2
    wide = (MOST_WITH_HALO // ((rows + 2 * halo) * bands) - 2 * halo) // half * half
    return rows, _side(min(max(wide, min(shape[1], COMPACT)), 2 * COMPACT), block[1], 1)


def _side(side: int, block: int, bands: int) -> int:
    """Largest multiple of lcm(`CELL`, `block`) up to `side`; without one, this lcm or, if it is too large, `side`."""
    step = math.lcm(block, CELL)
    if step <= side:
        return side // step * step
    return step if step <= LONGEST_SIDE and step * step * bands <= MOST_SAMPLES else side


def tiles(height: int, width: int, shape: tuple[int, int]) -> list[Tile]:
    """Cut a scene of `height` x `width` pixels into tiles of `shape` (rows, columns), in row-major order."""
    return Tile(0, height, 0, width).split(*shape)


def spread(everything: Sequence[Tile], pixels: int) -> list[Tile]:
    """Select tiles, evenly spread over the scene, with about `pixels` pixels in total; all tiles if they have fewer.

    The selection is a regular lattice, shifted from row to row, in row-major order; it depends on the arguments only.
    """
    wanted = max(pixels // max(t.pixels for t in everything), 1)
    if len(everything) <= wanted:
        return list(everything)
    in_order = sorted(everything, key=lambda t: (t.row0, t.col0))
    rows = [list(row) for _row0, row in groupby(in_order, key=lambda t: t.row0)]
    columns = max(map(len, rows))
    down = min(max(round(math.sqrt(wanted * len(rows) / columns)), 1), len(rows), wanted)
    across = min(max(wanted // down, 1), columns)
    chosen = []
    for i in range(down):
        line = rows[int((i + 0.5) * len(rows) / down)]
        shift = 0.25 if i % 2 else 0.75
        chosen += [line[int((j + shift) * len(line) / across)] for j in range(across)]
    return sorted(set(chosen), key=lambda t: (t.row0, t.col0))


def default_threads(threads: int | None = None) -> int:
    """`threads` or, if None, the number of processors this process may use. Raises InputError if not 1 to 1024."""
    if threads is not None:
        check_number(threads, 1, 1024, "threads")
        return threads
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Context (also a decorator) in which OpenCV and BLAS use one thread each, while tiles occupy all processors.

    Threads of BLAS wait in busy loops, and would take the processors from the tiles. If several threads are in
    this context at the same time, the limits end when the last thread leaves it.
    """
    import cv2
    from threadpoolctl import threadpool_limits

    global _contexts
    with _LOCK:
        _contexts += 1
        _LIMITS.callback(cv2.setNumThreads, cv2.getNumThreads())
        cv2.setNumThreads(1)
        _LIMITS.enter_context(threadpool_limits(1, user_api="blas"))
    try:
        yield
    finally:
        with _LOCK:
            _contexts -= 1
            if not _contexts:
                _LIMITS.close()


def affordable(threads: int, tile: tuple[int, int], bands: int) -> int:
    """Number of threads, 1 to `threads`, whose tiles of shape `tile` have at most `SAMPLES_AT_ONCE` values in total."""
    return max(1, min(threads, SAMPLES_AT_ONCE // (tile[0] * tile[1] * bands)))


def run(
    everything: Sequence[Tile],
    work: Callable[[Tile], T],
    *,
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[tuple[Tile, T]]:
    """Call `work` on every tile and yield (tile, result) in order; at most threads + 1 tiles are pending at a time.

    `progress` is called with the numbers of finished and of all tiles. After an error, or if the caller stops, no
    further tile is started, and running tiles are finished.
    """
    total = len(everything)
    with ThreadPoolExecutor(threads, thread_name_prefix="deglint") as pool:
        waiting: deque[tuple[Tile, Future[T]]] = deque()
        todo = iter(everything)
        try:
            for done in range(total):
                while len(waiting) <= threads and (tile := next(todo, None)) is not None:
                    waiting.append((tile, pool.submit(work, tile)))
                tile, future = waiting.popleft()
                result = future.result()
                del future
                yield tile, result
                del result
                if progress:
                    progress(done + 1, total)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def by_rows(done: Iterator[tuple[Tile, Part]], combine: Callable[[list[Part]], T]) -> Iterator[T]:
    """Yield the combined results of each row of tiles; `done` yields (tile, result) in order, as `run` does.

    `combine` gets the list of results of a row. Its calls, and so its rounding, do not depend on threads or workers.
    """
    with closing(done):  # type: ignore[type-var]
        for _row0, row in groupby(done, key=lambda one: one[0].row0):
            yield combine([result for _tile, result in row])
