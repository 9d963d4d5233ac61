"""An image written in parts, by many processes, and put together from their compressed blocks as they are.

Each part is a GeoTIFF of one tile, made of whole blocks with the output's own compression. Putting it into the image
copies its bytes; no pixel is decoded, and of the image only the places of its blocks are held. The header of the image
is the one that GDAL would have written, in front of all blocks.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import ReadError, WriteError
from ..scene import Window
from .failing import check_whole, write_errors
from .output import Layout, RasterWriter, finishing
from .overviews import add_overviews
from .scratch import Scratch
from .tiff import Header, copy_bytes, stretches

_PLAIN = frozenset({"none", "deflate", "lzw", "zstd", "lzma", "packbits"})
"""Compressions whose blocks mean the same in any file."""


@dataclass(frozen=True)
class Part:
    """A tile's pixels in a file of their own, with a mask where the image has one."""

    path: Path

    def read(self) -> npt.NDArray[Any]:
        """The pixels, (band, row, column)."""
        with _open(self.path) as dataset:
            return np.asarray(dataset.read())

    def valid(self) -> npt.NDArray[np.bool_]:
        """Which are valid."""
        with _open(self.path) as dataset:
            return np.asarray(dataset.read_masks(1) != 0)


def can_copy(layout: Layout) -> bool:
    """Whether parts can be put together without decoding: whole blocks to a tile, compression that stands alone.

    Interleaved by band or by pixel, plain or BigTIFF, with a mask or without.
    """
    given = {str(k).lower(): str(v).lower() for k, v in layout.options.items()}
    compression = given.get("compress", layout.info.compression or "none")
    odd = {"blockxsize", "blockysize", "tiled", "sparse_ok", "endianness", "copy_src_overviews", "nbits"}
    whole = all(t >= n or t % b == 0 for t, n, b in zip(
        layout.tile, (layout.info.height, layout.info.width), layout.block, strict=True))  # fmt: skip
    return whole and compression in _PLAIN and not odd & set(given)


def write_part(
    path: Path, block: npt.NDArray[Any], layout: Layout, window: Window, valid: npt.NDArray[np.bool_] | None
) -> Part:
    """Write a tile's pixels as a part of an image of this layout."""
    (row0, row1), (col0, col1) = window
    info = replace(
        layout.info, height=row1 - row0, width=col1 - col0, transform=None, crs=None, gcps=(), gcps_crs=None, rpcs=None,
        tags={}, band_tags=({},) * layout.info.count,
    )  # fmt: skip
    options = dict(layout.options) if can_copy(layout) else {}
    small = replace(layout, info=info, options=options | _block_options(layout), masked=valid is not None)
    whole = ((0, row1 - row0), (0, col1 - col0))
    with finishing(RasterWriter(path, path, small)) as writer:
        writer.write(block, whole)
        if valid is not None:
            writer.write_mask(valid, whole)
    return Part(path)


def _block_options(layout: Layout) -> dict[str, str]:
    rows, columns = layout.block
    sides = {"BLOCKXSIZE": str(columns), "BLOCKYSIZE": str(rows)}
    return sides | {"BIGTIFF": "NO", "NUM_THREADS": "1", "OVERVIEWS": "NONE"}


class Decoded:
    """An image put together from parts whose pixels are read and written again: where blocks cannot be copied."""

    def __init__(self, path: Path, target: Path, layout: Layout) -> None:
        self._writer = RasterWriter(path, target, layout)
        self.close, self.abort = self._writer.close, self._writer.abort

    def write(self, part: Part, window: Window) -> None:
        """Put a part where it belongs."""
        self._writer.write(part.read(), window)
        if self._writer.layout.masked:
            self._writer.write_mask(part.valid(), window)


class Assembly:
    """An image put together from the blocks of its parts, by one process.

    Parameters
    ----------
    path : Path
        Scratch file to write.
    target : Path
        What it will be called, for messages.
    layout : Layout
        For which `can_copy`.
    """

    def __init__(self, path: Path, target: Path, layout: Layout) -> None:
        self.path, self.target, self._layout, self._file = path, target, layout, None
        RasterWriter(path, target, replace(layout, options={**layout.options, "SPARSE_OK": "TRUE"})).close(whole=False)
        with write_errors(target):
            self._header = Header.read(path)
            self._file = path.open("wb", buffering=0)
            self._end = self._header.size
            self._file.truncate(self._end)

    def write(self, part: Part, window: Window) -> None:
        """Copy a part's blocks to the end of the file, and remember where they are."""
        assert self._file is not None
        with write_errors(self.target), _part(part.path) as (file, header):
            for own, theirs in zip(self._header.directories, header.directories, strict=True):
                places = own.places(theirs, window)
                for start, length, blocks in stretches(theirs.offsets, theirs.counts):
                    copy_bytes(file, self._file, start, self._end, length)
                    own.offsets[places[blocks]] = self._end + (theirs.offsets[blocks] - start).astype(np.uint64)
                    own.counts[places[blocks]] = theirs.counts[blocks]
                    self._end += length + length % 2

    def close(self) -> None:
        """Write the header in front, and make sure that all is on disk."""
        assert self._file is not None
        with write_errors(self.target):
            if not self._header.big and self._end >> 32:
                raise WriteError(f"{self.target} grows beyond 4 GB, which TIFF cannot hold: leave out --co BIGTIFF=NO.")
            self._file.seek(0)
            self._file.write(self._header.to_bytes())
            self._file.truncate(self._end)
            self._file.close()
            if self._layout.overviews:
                add_overviews(self.path, average=not self._layout.holds_flags)
        check_whole(self.path, self.target)

    def abort(self) -> None:
        """Let go of the file, whatever state it is in."""
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.close()


def writing_parts(
    scratch: Scratch, target: Path, layout: Layout
) -> contextlib.AbstractContextManager[Assembly | Decoded]:
    """An `Assembly` that finishes, or where that cannot be a `Decoded`."""
    kind: Any = Assembly if can_copy(layout) else Decoded
    return finishing(kind(scratch.add(target), target, layout))


@contextlib.contextmanager
def _part(path: Path) -> Iterator[tuple[Any, Header]]:
    try:
        file = path.open("rb", buffering=0)
    except OSError as error:
        raise _missing(path) from error
    with file:
        yield file, Header.read(path)


@contextlib.contextmanager
def _open(path: Path) -> Iterator[Any]:
    from .info import open_dataset

    try:
        dataset = open_dataset(str(path))
    except ReadError as error:
        raise _missing(path) from error
    with dataset:
        yield dataset


def _missing(path: Path) -> WriteError:
    return WriteError(
        f"a tile that a worker wrote is not in {path.parent}: workers and this process need the same file system."
    )
