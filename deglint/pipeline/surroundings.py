"""What lies around a tile, for masks that look beyond its edge, without reading the neighbours' blocks again and again.

A mask that needs a halo needs little of it: which NIR pixels are bright. The NIR of a tile that comes later is read
once in advance and kept as bits, so a run over the tiles reads the NIR twice, however wide the halo and however the
file is compressed. Tiles are expected in row-major order; rows that no tile needs any more are dropped.
"""

from __future__ import annotations

import threading
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..masks import WaterRule, brightness
from ..scene import FloatArray, Scene
from ..tiles import Tile

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Around:
    """The same as `Surroundings` without a memory, for tiles that are worked on anywhere in any order."""

    scene: Scene
    rule: WaterRule
    nir: int

    def around(self, tile: Tile, nir: FloatArray) -> tuple[Mask, Mask] | None:
        """As `Surroundings.around`; the NIR of the halo is read for this tile alone."""
        if not brightness(nir, self.rule)[0].any():
            return None
        outer = tile.grown(self.rule.halo, self.scene.height, self.scene.width)
        return brightness(self.scene.source.read(outer.window, [self.nir])[0], self.rule)


@dataclass(frozen=True, eq=False)
class _Bits:
    """Two masks of a tile, packed."""

    shape: tuple[int, int]
    bright: npt.NDArray[np.uint8]
    missing: npt.NDArray[np.uint8] | None

    @classmethod
    def of(cls, nir: FloatArray, rule: WaterRule) -> _Bits:
        bright, missing = brightness(nir, rule)
        return cls(
            (bright.shape[0], bright.shape[1]),
            np.packbits(bright, axis=1),
            np.packbits(missing, axis=1) if missing.any() else None,
        )

    def unpack(self, rows: slice, columns: slice) -> tuple[Mask, Mask]:
        """Part of both masks."""
        width = self.shape[1]
        bright = np.unpackbits(self.bright[rows], axis=1, count=width)[:, columns].view(np.bool_)
        if self.missing is None:
            return bright, np.zeros_like(bright)
        return bright, np.unpackbits(self.missing[rows], axis=1, count=width)[:, columns].view(np.bool_)


class Surroundings:
    """Bright and missing NIR pixels of tiles and what lies around them; safe for threads; a pickled copy starts anew.

    Parameters
    ----------
    scene : Scene
    rule : WaterRule
    nir : int
        0-based band of the scene.
    tiles : sequence of Tile
        All tiles of the run, in row-major order.
    """

    def __init__(self, scene: Scene, rule: WaterRule, nir: int, tiles: list[Tile]) -> None:
        self._scene, self._rule, self._nir = scene, rule, nir
        self._rows = sorted({t.row0 for t in tiles})
        self._columns = sorted({t.col0 for t in tiles})
        self._row_at = {row: i for i, row in enumerate(self._rows)}
        self._column_at = {column: j for j, column in enumerate(self._columns)}
        self._tiles = {(t.row0, t.col0): t for t in tiles}
        self._start()

    def _start(self) -> None:
        self._kept: dict[tuple[int, int], Future[_Bits]] = {}
        self._lock = threading.Lock()

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in vars(self).items() if k not in ("_kept", "_lock")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._start()

    def around(self, tile: Tile, nir: FloatArray) -> tuple[Mask, Mask] | None:
        """Both masks of the tile, whose NIR is given, and of the rule's halo around it as far as the scene goes.

        None where no pixel of the tile itself is bright: then nothing around it matters, and nothing is read.
        """
        outer = tile.grown(self._rule.halo, self._scene.height, self._scene.width)
        bright = np.empty(outer.shape, np.bool_)
        missing = np.empty(outer.shape, np.bool_)
        self._drop_before(tile.row0)
        bits = _Bits.of(nir, self._rule)
        own = self._claim((tile.row0, tile.col0))
        if own is not None:
            own.set_result(bits)
        if not bits.bright.any():
            return None
        for other in self._touching(tile):
            to_rows, rows = _shared((outer.row0, outer.row1), (other.row0, other.row1))
            to_columns, columns = _shared((outer.col0, outer.col1), (other.col0, other.col1))
            bright[to_rows, to_columns], missing[to_rows, to_columns] = self._bits(other).unpack(rows, columns)
        return bright, missing

    def _touching(self, tile: Tile) -> list[Tile]:
        """The tile and its neighbours: a halo is never wider than a tile."""
        i, j = self._row_at[tile.row0], self._column_at[tile.col0]
        return [
            self._tiles[r, c] for r in self._rows[max(i - 1, 0) : i + 2] for c in self._columns[max(j - 1, 0) : j + 2]
        ]

    def _claim(self, key: tuple[int, int]) -> Future[_Bits] | None:
        """A future to fill, for the first that asks; None for the others."""
        with self._lock:
            if key in self._kept:
                return None
            self._kept[key] = Future()
            return self._kept[key]

    def _bits(self, tile: Tile) -> _Bits:
        key = tile.row0, tile.col0
        mine = self._claim(key)
        if mine is not None:
            try:
                mine.set_result(_Bits.of(self._scene.source.read(tile.window, [self._nir])[0], self._rule))
            except Exception as error:  # handed to whoever waits for it  # noqa: BLE001
                mine.set_exception(error)
        with self._lock:
            kept = self._kept.get(key)
        return (mine or kept or self._read_again(tile)).result()

    def _read_again(self, tile: Tile) -> Future[_Bits]:
        """For a tile whose bits were dropped too early: correct all the same."""
        again: Future[_Bits] = Future()
        again.set_result(_Bits.of(self._scene.source.read(tile.window, [self._nir])[0], self._rule))
        return again

    def _drop_before(self, row0: int) -> None:
        """Forget rows of tiles that neither this row nor the one before it, still under way, needs."""
        needed = self._rows[max(self._row_at[row0] - 2, 0)]
        with self._lock:
            for key in [k for k in self._kept if k[0] < needed]:
                del self._kept[key]


def _shared(outer: tuple[int, int], other: tuple[int, int]) -> tuple[slice, slice]:
    """What two ranges share, counted from the start of each."""
    low, high = max(outer[0], other[0]), min(outer[1], other[1])
    return slice(low - outer[0], high - outer[0]), slice(low - other[0], high - other[0])
