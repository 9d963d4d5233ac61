"""Checksums of files, on a thread of their own; nothing but Python's own library is loaded for them."""

from __future__ import annotations

import stat
import threading
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..errors import ReadError

_CHUNK = 4 << 20
"""Bytes read at a time: a piece should take as long as Python lets another thread work before it asks."""
_AHEAD: dict[tuple[str, ...], Checksum] = {}
"""Begun by a command, and not yet asked for."""


class Checksum:
    """CRC-32 of the input files' bytes, computed on a thread of its own while the work goes on.

    Names that are not local files (/vsis3/, zip://) have none.
    """

    def __init__(self, paths: Sequence[str]) -> None:
        self._paths = tuple(paths)
        self._found: list[dict[str, Any]] = []
        self._before = [_stamp(path) for path in self._paths]
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def result(self) -> list[dict[str, Any]]:
        """For each file its name, size [byte] and checksum (8 hexadecimal digits), or None.

        Raises
        ------
        ReadError
            A file was changed while it was read: what was made of it is of no one state of it.
        """
        self._thread.join()
        if changed := self.changed():
            raise ReadError(f"{changed} was changed while it was read. Run again when it is whole.")
        return [{k: v for k, v in file.items() if k != "modified_ns"} for file in self._found]

    def fingerprints(self) -> list[dict[str, Any]]:
        """The same, with the times of the last change."""
        self._thread.join()
        return self._found

    def changed(self) -> str | None:
        """A file that was changed since this was begun."""
        both = zip(self._paths, self._before, strict=True)
        return next((path for path, before in both if _stamp(path) != before), None)

    def _work(self) -> None:
        self._found = [{"path": path, **fingerprint(path)} for path in self._paths]


def begin_checksum(paths: Sequence[str]) -> None:
    """Begin on files that are about to be read: a command's modules take a while to load."""
    if all(_stamp(path) for path in paths):
        _AHEAD[tuple(paths)] = Checksum(paths)


def checksum_of(paths: Sequence[str]) -> Checksum:
    """What was begun on these files, or a new one."""
    found = _AHEAD.pop(tuple(paths), None)
    return Checksum(paths) if found is None or found.changed() else found


def fingerprint(path: str | Path) -> dict[str, Any]:
    """Size [byte], time of the last change [ns] and CRC-32 (8 hexadecimal digits) of a file; None where it has none."""
    stamp = _stamp(path)
    if stamp is not None:
        crc, room = 0, memoryview(bytearray(min(_CHUNK, stamp[0] + 1)))
        with suppress(OSError), Path(path).open("rb", buffering=0) as file:
            while read := file.readinto(room):
                crc = zlib.crc32(room[:read], crc)
            return {"bytes": stamp[0], "crc32": f"{crc:08x}", "modified_ns": stamp[1]}
    return {"bytes": None, "crc32": None, "modified_ns": None}


def is_as(path: str | Path, said: Mapping[str, Any]) -> bool:
    """Whether a file is the one that `fingerprint` said this of: read only where size or time do not tell."""
    stamp = _stamp(path)
    if stamp is None:
        return said.get("bytes") is None
    if stamp[0] != said.get("bytes"):
        return False
    return stamp[1] == said.get("modified_ns") or fingerprint(path)["crc32"] == said.get("crc32")


def _stamp(path: str | Path) -> tuple[int, int] | None:
    """Size and time of the last change of a local file."""
    try:
        found = Path(path).stat()
    except (OSError, ValueError):
        return None
    return (found.st_size, found.st_mtime_ns) if stat.S_ISREG(found.st_mode) else None
