"""Read the pixels of one raster, or of several on the same grid, in any number of threads.

A `RasterSource` opens its files at the first read. Each reading thread uses file handles of its own, which are then
kept in a pool for the next reader, and are closed by `close` or at the end of a `with` block.
"""

import copy
import math
import os
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from typing import Any, Self

import numpy as np

from ..errors import InputError, ReadError
from ..moments import Mask
from ..scene import FloatArray, Window
from .convert import FlatField, Raw, is_valid, same_nodata, to_physical
from .environment import environment
from .info import RasterInfo, gdal_errors, one_line, open_dataset, remedy


@dataclass(frozen=True)
class FileBands:
    """The bands of a scene that come from one file."""

    path: str  # GDAL name
    indexes: tuple[int, ...]  # 1-based bands of the file, in scene order
    nodatas: tuple[float | None, ...]  # value that means "not valid", one per band
    masked: bool = False  # the file has a mask, for all bands together or for each band
    alpha: int | None = None  # 1-based alpha band; a pixel where it is 0 is not valid
    flat: FlatField | None = None  # corrects the file values while they are read
    warp: Mapping[str, object] | None = field(default=None, repr=False)  # WarpedVRT's options, to resample the file

    @classmethod
    def of(cls, info: RasterInfo) -> Self:
        """Make a `FileBands` with all bands, except alpha, of the file that `info` describes."""
        return cls(
            path=info.paths[0],
            indexes=tuple([i for i in range(1, info.count + 2) if i != info.alpha][: info.count]),
            nodatas=info.nodatas,
            masked=any(not flags or ("per_dataset" in flags and "alpha" not in flags) for flags in info.mask_flags),
            alpha=info.alpha,
            flat=info.flat,
        )

    def declared(self, nodatas: tuple[float | None, ...]) -> Self:
        """A copy with these nodata values, one per band; if all are the same, resampling (`warp`) excludes them."""
        if self.warp is None or nodatas[0] is None or not all(same_nodata(nodatas[0], n) for n in nodatas):
            return replace(self, nodatas=nodatas)
        warp = {**self.warp, "add_alpha": False, "src_nodata": nodatas[0], "nodata": nodatas[0]}
        return replace(self, nodatas=nodatas, alpha=None if self.warp.get("add_alpha") else self.alpha, warp=warp)


class RasterSource(AbstractContextManager["RasterSource"]):
    """Pixels of a scene, read from one file or from several on the same grid; a `deglint.scene.Source`.

    `files` are in the order of the scene's bands; `info` has their properties. A pickled copy opens the files again.
    """

    def __init__(self, files: Sequence[FileBands], info: RasterInfo) -> None:
        self.files, self.info = tuple(files), info
        self.deadline = math.inf  # time of time.monotonic() after which reads raise ReadError [s]
        self.pixels_read = 0  # pixels of all reads so far
        self._lock = threading.Lock()
        self._idle: list[list[Any]] = []
        self._closed = False
        self.undeclared: object = None  # what `deglint.readers.undeclared` found in the pixels; None before it searched

    def declared(self, info: RasterInfo) -> Self:
        """Copy of this source that reads with the nodata values, scales and offsets of `info`."""
        found = copy.copy(self)  # made by `__reduce__`: it has its own pool, no deadline, no pixels read, no findings
        if info.nodatas != self.info.nodatas:
            left = iter(info.nodatas)
            found.files = tuple(f.declared(tuple(islice(left, len(f.indexes)))) for f in self.files)
        found.info = info
        return found

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle local files by absolute path, as the copy may be used in another folder; other GDAL names are kept."""
        paths = (os.path.abspath(f.path) if os.path.exists(f.path) else f.path for f in self.files)  # noqa: PTH100, PTH110
        return RasterSource, ([replace(f, path=p) for f, p in zip(self.files, paths, strict=True)], self.info)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all open files; later reads raise ReadError."""
        with self._lock:
            idle, self._idle, self._closed = self._idle, [], True
        for dataset in chain.from_iterable(idle):
            dataset.close()

    def read(self, window: Window, bands: Sequence[int]) -> FloatArray:
        """Read the physical values of a window of the scene, (band, row, column); `bands` are 0-based.

        The values are float32, or float64 where the files need it; NaN where they are not valid or not finite. Raises
        InputError if the window reaches outside the scene or a band is not in it; ReadError if a file is missing,
        truncated or damaged, this source is closed, or its `deadline` is past.
        """
        if outside := [b for b in bands if not 0 <= b < self.info.count]:
            raise InputError(f"bands: allowed are 0-{self.info.count - 1}, counted from 0, got {outside[0]}")
        raw, valid = self._read(window, bands)
        scales, offsets = ([values[b] for b in bands] for values in (self.info.scales, self.info.offsets))
        return to_physical(raw, valid, scales, offsets)

    def read_raw(self, window: Window) -> tuple[Raw, Mask | None]:
        """Read all bands of a window as file values, (band, row, column), and a mask of this shape, True where valid.

        Values have the type of the file, or the smallest type that can hold all bands. The mask follows from nodata,
        mask and alpha; it is None if everything is valid, and may be a read-only view. NaN and infinity count as valid
        here, even if nodata is NaN; `to_physical` makes them NaN. A `FlatField` is applied. Errors are as in `read`.
        """
        return self._read(window, range(self.info.count))

    def to_physical(self, raw: Raw, valid: Mask | None = None) -> FloatArray:
        """Convert the two results of `read_raw` to physical values, as `read` returns them, in a new array."""
        return to_physical(raw, valid, self.info.scales, self.info.offsets)

    def _read(self, window: Window, bands: Sequence[int]) -> tuple[Raw, Mask | None]:
        (top, bottom), (left, right) = window
        if not (0 <= top <= bottom <= self.info.height and 0 <= left <= right <= self.info.width):
            raise InputError(
                f"window: allowed inside rows 0-{self.info.height} and columns 0-{self.info.width}, "
                f"got rows {top}-{bottom} and columns {left}-{right}"
            )
        if time.monotonic() > self.deadline:
            raise ReadError(f"{self.info.paths[0]} could not be read to its end in the given time")
        self.pixels_read += (bottom - top) * (right - left)
        try:
            with environment(), self._datasets() as datasets:
                return self._stacked(datasets, window, bands)
        except gdal_errors() as error:
            where = f"rows {top}-{bottom}, columns {left}-{right} of {', '.join(self.info.paths)}"
            said = one_line(error)
            raise ReadError(f"cannot read {where}: {said}. {remedy(self.info.paths[0], said)}") from error

    def _stacked(self, datasets: Sequence[Any], window: Window, bands: Sequence[int]) -> tuple[Raw, Mask | None]:
        """Read file values (band, row, column), and the mask of valid values, which is None if all are valid."""
        (top, bottom), (left, right) = window
        raw, valid, start = np.empty((len(bands), bottom - top, right - left), self.info.dtype), None, 0
        if not raw.size:
            return raw, None
        for file, dataset in zip(self.files, datasets, strict=True):
            at = [k for k, b in enumerate(bands) if 0 <= b - start < len(file.indexes)]
            own = [bands[k] - start for k in at]
            start += len(file.indexes)
            if not at:
                continue
            part, known = _read_file(file, dataset, own, window, self.info.dtype)
            if len(self.files) == 1:
                return part, known
            raw[at] = part
            if known is not None:
                valid = np.ones(raw.shape, np.bool_) if valid is None else valid
                valid[at] = known
        return raw, valid

    @contextmanager
    def _datasets(self) -> Iterator[list[Any]]:
        """Provide open datasets of all files to one thread; at the end of the `with` block they return to the pool."""
        with self._lock:
            if self._closed:
                raise ReadError(f"{self.info.paths[0]} was closed. Open the scene again.")
            found = self._idle.pop() if self._idle else []
        try:
            found = found or [_open(file) for file in self.files]
            yield found
        finally:
            with self._lock:
                self._idle.append(found)
            if self._closed:  # meanwhile
                self.close()


class ArraySource(RasterSource):
    """Pixels of a scene from a (band, row, column) numpy or dask array; each read returns a copy.

    Only the requested window of a dask array is computed. `origin`: position (row, column) of the array in the scene.
    """

    def __init__(self, values: Any, info: RasterInfo, origin: tuple[int, int] = (0, 0)) -> None:
        super().__init__([FileBands(info.paths[0], tuple(range(1, info.count + 1)), info.nodatas)], info)
        self.values, self.origin = values, origin

    def __reduce__(self) -> tuple[object, ...]:
        return ArraySource, (self.values, self.info, self.origin)

    def _read(self, window: Window, bands: Sequence[int]) -> tuple[Raw, Mask | None]:
        rows, columns = ((a - first, b - first) for (a, b), first in zip(window, self.origin, strict=True))
        _, height, width = self.values.shape
        if not (0 <= rows[0] <= rows[1] <= height and 0 <= columns[0] <= columns[1] <= width):
            raise InputError(f"window: allowed are {height} rows, {width} columns from {self.origin} on, got {window}")
        first = min(bands, default=0)
        together = list(bands) == list(range(first, first + len(bands)))
        chosen = slice(first, first + len(bands)) if together else list(bands)  # a slice copies nothing
        raw = np.array(self.values[chosen, slice(*rows), slice(*columns)], self.info.dtype)
        return raw, is_valid(raw, [self.info.nodatas[b] for b in bands])


def _open(file: FileBands) -> Any:
    from rasterio.vrt import WarpedVRT

    dataset = open_dataset(file.path)
    return dataset if file.warp is None else WarpedVRT(dataset, **file.warp)


def _read_file(file: FileBands, dataset: Any, bands: list[int], window: Window, dtype: Any) -> tuple[Raw, Mask | None]:
    """Read `bands` (0-based positions in `file.indexes`) as values of type `dtype`, and the mask as in `_stacked`."""
    (top, bottom), (left, right) = window
    raw, indexes = np.empty((len(bands), bottom - top, right - left), dtype), [file.indexes[b] for b in bands]
    if len({dataset.dtypes[i - 1] for i in indexes}) == 1:
        dataset.read(indexes, window=window, out=raw)
    else:  # rasterio cannot read bands of several types at once
        for numbers, i in zip(raw, indexes, strict=True):
            dataset.read(i, window=window, out=numbers)
    valid, masks = is_valid(raw, [file.nodatas[b] for b in bands]), []
    if file.masked:
        masks.append(dataset.read_masks(indexes, window=window) != 0)
    if file.alpha is not None:
        masks.append(dataset.read(file.alpha, window=window)[np.newaxis] != 0)
    for mask in masks:
        if not mask.all():
            valid = np.broadcast_to(mask, raw.shape) if valid is None else valid & mask
    if file.flat is not None:
        for numbers, b in zip(raw, bands, strict=True):
            file.flat.apply(numbers, window, file.nodatas[b])
    return raw, valid
