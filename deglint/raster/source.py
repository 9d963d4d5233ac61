"""Serve the pixels of one raster, or of several put on one grid, to any number of threads.

A `RasterSource` opens its files when they are first read. Each reading thread has a handle to itself for
as long as it reads; handles wait in a pool for the next reader and are closed by `close`, or at the end
of a `with` block. GDAL's block cache is left as the caller's `rasterio.Env` sets it: an Env belongs to a
thread, so a worker thread enters its own. Nothing is written here, and no pixel is kept.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, ReadError
from ..scene import FloatArray, Window
from .convert import Raw, Valid, to_physical
from .handle import FileBands, Handle
from .info import RasterInfo, gdal_errors, one_line, remedy


class Budget:
    """What may be read of a scene that is only looked at: so many windows (about one a tile), for so long [s]."""

    def __init__(self, seconds: float, reads: int) -> None:
        self.seconds, self.reads = seconds, reads
        self.done = self.pixels = 0
        self.over = False
        self._begun = time.monotonic()

    def spend(self, pixels: int) -> None:
        """Count a window, or refuse it with a ReadError: it is one too many, or too late."""
        if self.done >= self.reads or time.monotonic() - self._begun > self.seconds:
            self.over = True
            raise ReadError(f"stopped after {self.done} windows of the scene and {self.seconds:g} s at most")
        self.done, self.pixels = self.done + 1, self.pixels + pixels


class RasterSource:
    """Pixels of a scene, from one file or several on one grid; a `deglint.scene.Source`.

    `files` are in scene order; `info` is what the scene's bands are like. It can be pickled: the copy opens the files
    anew, wherever it is unpickled on this file system.

    Examples
    --------
    >>> with open_scene("scene.tif").source as source:  # doctest: +SKIP
    ...     raw, valid = source.read_raw(((0, 256), (0, 256)))
    ...     physical = source.to_physical(raw, valid)
    """

    def __init__(self, files: Sequence[FileBands], info: RasterInfo) -> None:
        self.files = tuple(files)
        self.info = info
        self._start()

    def _start(self) -> None:
        self.budget: Budget | None = None
        self._lock = threading.Lock()
        self._idle: list[Handle] = []
        self._closed = False
        self.settled = False  # whether the pixels were asked what the file does not declare

    def declared(self, info: RasterInfo) -> RasterSource:
        """The same pixels with another nodata and offset declared."""
        ends = np.cumsum([len(f.indexes) for f in self.files])
        nodatas = [info.nodatas[end - len(f.indexes) : end] for end, f in zip(ends, self.files, strict=True)]
        files = [replace(f, nodatas=tuple(n)) for f, n in zip(self.files, nodatas, strict=True)]
        found = RasterSource(files, info)
        found.settled = True
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {"files": tuple(replace(f, path=_absolute(f.path)) for f in self.files), "info": self.info}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._start()

    def __enter__(self) -> RasterSource:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close every handle; a read after this is refused."""
        with self._lock:
            idle, self._idle, self._closed = self._idle, [], True
        for handle in idle:
            handle.close()

    def read(self, window: Window, bands: Sequence[int]) -> FloatArray:
        """Physical values of a window.

        Parameters
        ----------
        window : ((row0, row1), (col0, col1))
            Half-open ranges inside the scene.
        bands : sequence of int
            0-based bands of the scene.

        Returns
        -------
        (len(bands), rows, columns) ndarray
            float32, or float64 where the files need it; NaN where not valid or not finite.

        Raises
        ------
        InputError
            The window reaches outside the scene.
        ReadError
            The file is truncated or damaged, or this source is closed.
        """
        raw, valid = self._read(window, bands, nodata=False)
        every = [nodata for file in self.files for nodata in file.nodatas]
        scales, offsets = ([values[b] for b in bands] for values in (self.info.scales, self.info.offsets))
        nodatas = [every[b] for b in bands]
        return to_physical(raw, valid, scales, offsets, nodatas=nodatas)

    def read_raw(self, window: Window) -> tuple[Raw, Valid | None]:
        """All bands of a window as they stand in the file, (band, row, column), and which pixels are valid.

        Numbers have the file's own type (the smallest common one where bands differ). Validity is what nodata, mask and
        alpha say; None where everything is valid, and it may be a read-only view. NaN and infinity are not looked for
        here, not even where nodata is NaN: `to_physical` finds them. Errors are those of `read`.
        """
        return self._read(window, range(self.info.count), nodata=True)

    def to_physical(self, raw: Raw, valid: Valid | None = None) -> FloatArray:
        """What `read` gives, from what `read_raw` gave: scale and offset applied, NaN where not valid; a new array."""
        return to_physical(raw, valid, self.info.scales, self.info.offsets)

    def _read(self, window: Window, bands: Sequence[int], *, nodata: bool) -> tuple[Raw, Valid | None]:
        (top, bottom), (left, right) = window
        if not (0 <= top <= bottom <= self.info.height and 0 <= left <= right <= self.info.width):
            raise InputError(
                f"window: allowed inside rows 0-{self.info.height} and columns 0-{self.info.width}, "
                f"got rows {top}-{bottom} and columns {left}-{right}"
            )
        from rasterio.env import env_ctx_if_needed

        if self.budget is not None:
            self.budget.spend((bottom - top) * (right - left))
        place = f"rows {top}-{bottom}, columns {left}-{right}"
        with env_ctx_if_needed(), self._handle(place) as handle:
            return handle.read(window, bands, self.info, nodata=nodata)

    @contextmanager
    def _handle(self, place: str) -> Iterator[Handle]:
        """A handle for this thread alone; kept for the next reader unless the reading fails."""
        with self._lock:
            if self._closed:
                raise ReadError(f"{self.info.paths[0]} was closed. Open the scene again.")
            handle = self._idle.pop() if self._idle else None
        try:
            handle = handle or Handle(self.files)
            yield handle
        except BaseException as error:
            if handle is not None:
                handle.close()
            refusal = self._explain(error, place)
            if refusal is None:
                raise
            raise refusal from error
        with self._lock:
            if not self._closed:
                self._idle.append(handle)
                return
        handle.close()

    def _explain(self, error: BaseException, place: str) -> ReadError | None:

        where = f"{place} of {', '.join(self.info.paths)}"
        if isinstance(error, MemoryError):
            return ReadError(f"{where} do not fit into memory. Read smaller windows.")
        if isinstance(error, gdal_errors()):
            return ReadError(f"cannot read {where}: {one_line(error)}. {remedy(self.info.paths[0])}")
        return None


def _absolute(name: str) -> str:
    """The name of a file in this directory, for a process that runs in another; GDAL's other names stay."""
    try:
        return str(Path(name).absolute()) if Path(name).exists() else name
    except (OSError, ValueError):
        return name
