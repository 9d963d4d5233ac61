"""The headers of a TIFF, as they stand in the file: read, given other places of its blocks, written again.

References
----------
TIFF revision 6.0 (Adobe 1992); the BigTIFF extension, https://libtiff.gitlab.io/libtiff/specification/bigtiff.html.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import Window

_OFFSETS, _COUNTS, _LONG8 = 324, 325, 16
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
"""Bytes of a value, by TIFF's number of its type."""


@dataclass(eq=False)
class Directory:
    """One image of a TIFF: its tags as they stand in the file (type, count, bytes), and where its blocks are."""

    tags: dict[int, tuple[int, int, bytes]]
    offsets: npt.NDArray[np.uint64]
    counts: npt.NDArray[np.uint64]

    def number(self, tag: int, usual: int = 1) -> int:
        """The (first) value of a tag that holds integers."""
        return int(_numbers(*self.tags[tag])[0]) if tag in self.tags else usual

    @property
    def grid(self) -> tuple[int, int, int]:
        """(planes, blocks down, blocks across)."""
        planes = self.number(277) if self.number(284) == 2 else 1
        return planes, -(-self.number(257) // self.number(323)), -(-self.number(256) // self.number(322))

    def places(self, part: Directory, window: Window) -> npt.NDArray[np.int64]:
        """Which of these blocks each block of a part is."""
        rows, columns = self.number(323), self.number(322)
        (row0, _), (col0, _) = window
        if (part.number(323), part.number(322)) != (rows, columns) or row0 % rows or col0 % columns:
            raise AssertionError("unreachable: parts are whole blocks")
        own = np.arange(np.prod(self.grid)).reshape(self.grid)
        _, down, across = part.grid
        top, left = row0 // rows, col0 // columns
        return own[:, top : top + down, left : left + across].ravel()


@dataclass(eq=False)
class Header:
    """All that stands in a TIFF before its blocks: directories that follow each other."""

    big: bool
    directories: list[Directory]

    @classmethod
    def read(cls, path: Path) -> Header:
        """From a file; places of blocks are 0 where it has none."""
        with path.open("rb") as file:
            mark = file.read(16)
            big = mark[:4] == b"II+\0"
            if not big and mark[:4] != b"II*\0":
                raise OSError(f"{path.name} is not a TIFF of this machine's byte order")
            at = struct.unpack_from("<Q", mark, 8)[0] if big else struct.unpack_from("<I", mark, 4)[0]
            found = []
            while at:
                directory, at = _directory(file, at, big)
                found.append(directory)
        return cls(big, found)

    @property
    def size(self) -> int:
        """Bytes, a multiple of 16."""
        return len(self.to_bytes())

    def to_bytes(self) -> bytes:
        """As it stands in the file."""
        out = bytearray(struct.pack("<2sHHHQ", b"II", 43, 8, 0, 16) if self.big else struct.pack("<2sHI", b"II", 42, 8))
        for i, directory in enumerate(self.directories):
            self._append(out, directory, last=i + 1 == len(self.directories))
        return bytes(out)

    def _append(self, out: bytearray, directory: Directory, *, last: bool) -> None:
        kind, word = (_LONG8, "<u8") if self.big else (4, "<u4")
        tags = dict(directory.tags)
        for tag, places in ((_OFFSETS, directory.offsets), (_COUNTS, directory.counts)):
            tags[tag] = kind, len(places), places.astype(word).tobytes()
        entry, inline = ("<HHQ", 8) if self.big else ("<HHI", 4)
        start, head = len(out), struct.calcsize(entry)
        first = start + (8 if self.big else 2) + len(tags) * (head + inline) + inline
        values, table = bytearray(), bytearray(struct.pack("<Q" if self.big else "<H", len(tags)))
        for tag, (form, count, data) in sorted(tags.items()):
            table += struct.pack(entry, tag, form, count)
            if len(data) > inline:
                table += struct.pack("<Q" if self.big else "<I", first + len(values))
                values += data + bytes(-len(data) % 8)
            else:
                table += data.ljust(inline, b"\0")
        values += bytes(-(first + len(values)) % 16)
        table += struct.pack("<Q" if self.big else "<I", 0 if last else first + len(values))
        out += table + values


def stretches(
    offsets: npt.NDArray[np.uint64], counts: npt.NDArray[np.uint64]
) -> Iterator[tuple[int, int, npt.NDArray[np.int64]]]:
    """Blocks that lie one behind the other: where they start, how long they are together, which they are."""
    order = np.argsort(offsets, kind="stable")
    order = order[counts[order] > 0]
    if not len(order):
        return
    ends = offsets[order] + counts[order]
    cuts = np.flatnonzero(offsets[order][1:] != ends[:-1]) + 1
    for blocks in np.split(order, cuts):
        start, last = int(offsets[blocks[0]]), blocks[-1]
        yield start, int(offsets[last] + counts[last]) - start, blocks


def copy_bytes(source: Any, target: Any, start: int, place: int, length: int) -> None:
    """Copy bytes between files that are open without buffers, inside the system where it can."""
    while length:
        try:
            done = os.copy_file_range(source.fileno(), target.fileno(), length, start, place)
        except (OSError, AttributeError):  # other file systems, other systems
            source.seek(start)
            target.seek(place)
            done = target.write(source.read(min(length, 1 << 20)))
        if not done:
            raise OSError("the file is shorter than it was")
        start, place, length = start + done, place + done, length - done


def _directory(file: Any, at: int, big: bool) -> tuple[Directory, int]:
    """The directory at a place, and the place of the next."""
    entry, inline = ("<HHQ", 8) if big else ("<HHI", 4)
    word, head = ("<Q" if big else "<I"), struct.calcsize(entry)
    file.seek(at)
    (many,) = struct.unpack("<Q" if big else "<H", file.read(8 if big else 2))
    data = file.read(many * (head + inline) + inline)
    tags = {}
    for i in range(many):
        tag, form, count = struct.unpack_from(entry, data, i * (head + inline))
        held = data[i * (head + inline) + head :][:inline]
        size = _SIZES.get(form, 1) * count
        if size > inline:
            file.seek(struct.unpack(word, held)[0])
            held = file.read(size)
        tags[tag] = form, count, held[:size]
    (following,) = struct.unpack_from(word, data, many * (head + inline))
    found = Directory(tags, np.zeros(0, np.uint64), np.zeros(0, np.uint64))
    blocks = int(np.prod(found.grid))
    places = [_numbers(*tags[tag]) if tag in tags else np.zeros(0, np.uint64) for tag in (_OFFSETS, _COUNTS)]
    # a file without blocks may leave these tags empty
    found.offsets, found.counts = (p if len(p) == blocks else np.zeros(blocks, np.uint64) for p in places)
    return found, int(following)


def _numbers(form: int, count: int, data: bytes) -> npt.NDArray[np.uint64]:
    kinds = {1: "<u1", 3: "<u2", 4: "<u4", _LONG8: "<u8"}
    return np.frombuffer(data, kinds[form], count).astype(np.uint64) if form in kinds else np.zeros(0, np.uint64)
