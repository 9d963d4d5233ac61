"""Size, modification time and CRC-32 of all input files of a run, to record them and to detect changes."""

import stat
import threading
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from .errors import ReadError
from .raster.targets import files_behind

_CHUNK = 4 << 20  # bytes read at a time: so many that the thread rarely has to compete for Python's interpreter lock
_VIEWER_FILES = (".aux.xml", ".ovr")
"""Endings of files that viewers write beside a raster. They may change during a run: GDAL has read them by then."""
Fingerprint = dict[str, str | int | None]  # path, size, CRC-32 and modification time of a file
Stamp = tuple[int, int, int, int]  # size [byte], modification time [ns], inode and change time [ns] of a file


class Checksum:
    """Compute the CRC-32 of all input files of a run in a separate thread, and detect files that change meanwhile.

    `names` are GDAL names of the input; files that GDAL reads with them are included. Names that are not local files
    (/vsis3/, zip://) have no checksum. `aside` are further names, such as a mask, that are only checked for changes.
    """

    def __init__(self, names: Sequence[str], aside: Sequence[str] = ()) -> None:
        self._names, self._aside = tuple(names), tuple(aside)
        self._found: list[Fingerprint] = []
        self._listed = files_behind(self._names)
        self._before = {path: _stamp(path) for path in (*self._listed, *files_behind(self._aside))}
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def result(self) -> list[Fingerprint]:
        """Path, size [byte] and CRC-32 (8 hexadecimal digits) of each input file; None for values that are not known.

        Raises ReadError if a file was changed during the run, as the output may then mix old and new content.
        """
        self._thread.join()
        if changed := self.changed():
            raise ReadError(f"{changed} was changed while it was read. Run again when it is whole.")
        return [{k: v for k, v in file.items() if k != "modified_ns"} for file in self._found]

    def fingerprints(self) -> list[Fingerprint]:
        """The list that `result` returns, with the modification time [ns] of each file; changed files are no error."""
        self._thread.join()
        return self._found

    def changed(self) -> str | None:
        """Path of a file (except .aux.xml, .ovr) changed, added or removed since this object was made; None if none."""
        crcs = {file["path"]: file["crc32"] for file in self._found}
        after = {path: _stamp(path) for path in (*files_behind(self._names), *files_behind(self._aside))}
        for path in (name for name in {**self._before, **after} if not name.endswith(_VIEWER_FILES)):
            one, two = self._before.get(path), after.get(path)
            same = one == two and (path in self._before) == (path in after)
            if not same and one and two and one[:3] == two[:3]:  # the content may be new, with the old time
                same = fingerprint(path)["crc32"] == crcs.get(path, "")
            if not same:
                return path
        return None

    def _work(self) -> None:
        self._found = [{"path": path, **fingerprint(path)} for path in self._listed]


def fingerprint(path: str | Path) -> Fingerprint:
    """Dict of a file's "bytes" (size), "modified_ns" (time), "crc32" (8 hexadecimal digits); all None if unreadable."""
    stamp = _stamp(path)
    if stamp is not None:
        crc, room = 0, memoryview(bytearray(min(_CHUNK, stamp[0] + 1)))
        with suppress(OSError), Path(path).open("rb", buffering=0) as file:
            while read := file.readinto(room):
                crc = zlib.crc32(room[:read], crc)
            return {"bytes": stamp[0], "crc32": f"{crc:08x}", "modified_ns": stamp[1]}
    return {"bytes": None, "crc32": None, "modified_ns": None}


def are_as(names: Sequence[str], said: Mapping[str, Mapping[str, object]]) -> bool:
    """Whether the files behind GDAL names are exactly those in `said` (fingerprints by path), with the same content."""
    files = files_behind(names)
    return set(files) == set(said) and all(is_as(path, said[path]) for path in files)


def is_as(path: str | Path, said: Mapping[str, object]) -> bool:
    """True if a file has the size, and the time or CRC-32, of `said`; or if it is missing and `said` has no size."""
    stamp = _stamp(path)
    if stamp is None:
        return said.get("bytes") is None
    if stamp[0] != said.get("bytes"):
        return False
    return stamp[1] == said.get("modified_ns") or fingerprint(path)["crc32"] == said.get("crc32")


def _stamp(path: str | Path) -> Stamp | None:
    """Size, times and inode of a local file (`Stamp`); None if it is not a regular file."""
    try:
        found = Path(path).stat()
    except (OSError, ValueError):
        return None
    if not stat.S_ISREG(found.st_mode):
        return None
    return found.st_size, found.st_mtime_ns, found.st_ino, found.st_ctime_ns
