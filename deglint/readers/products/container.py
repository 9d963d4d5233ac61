"""Container of a product: a folder, a zip or a tar, whose members are listed and whose small files are read.

Limits protect against malicious files: number of members, their depth, and size of texts. File names in metadata are
used only if they are members of the container.
"""

from __future__ import annotations

import os
import re
import tarfile
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree as ET

from ...errors import InputError, ReadError
from .metadata import MetadataError, tree_of

MOST_MEMBERS = 20_000
"""Most members of a folder or archive that are listed."""
DEEPEST = 6
"""Levels of folders that are listed: a SAFE product has four."""
MOST_METADATA_BYTES = 32 << 20
"""Largest metadata file that is read [byte]; those of Sentinel-2 have up to 1 MB."""
_DAMAGED = (OSError, zipfile.BadZipFile, tarfile.TarError)
_ZIP, _TAR = re.compile(r"\.zip$", re.IGNORECASE), re.compile(r"\.tar$", re.IGNORECASE)


@dataclass(frozen=True)
class Container:
    """A folder or archive, and the names of its members."""

    path: str
    kind: str  # "folder", "zip" or "tar"
    names: tuple[str, ...]  # members, relative, with "/" between folders, sorted
    named: str | None = None  # the member (a file or a folder) that was meant, where not all of it was
    was_read: list[str] = field(default_factory=list, compare=False, repr=False)  # members that `read` has read

    @property
    def name(self) -> str:
        """Name of the folder or archive, without .zip or .tar."""
        last = Path(self.path).absolute().name
        return _TAR.sub("", _ZIP.sub("", last))

    def gdal(self, member: str) -> str:
        """GDAL name of a member."""
        if self.kind == "folder":
            return str(Path(self.path) / member)
        return f"/vsi{self.kind}/{Path(self.path).absolute()}/{PurePosixPath(member)}"  # without "./" in front

    def matches(self, pattern: str) -> list[tuple[str, re.Match[str]]]:
        """Members whose file name matches a regular expression, and the matches; case is ignored."""
        fits = re.compile(pattern, re.IGNORECASE)
        return [(n, match) for n in self.names if (match := fits.fullmatch(last(n)))]

    def find(self, pattern: str) -> list[str]:
        """Members whose file name matches a regular expression; case is ignored."""
        return [member for member, _ in self.matches(pattern)]

    def several(self, what: str, names: Iterable[str], remedy: str = "Name one.") -> InputError:
        """The error for several items where one is expected; it lists up to four."""
        every = list(names)
        return InputError(f"{self.path} holds {len(every)} {what}: {', '.join(every[:4])}. {remedy}")

    def beside(self, member: str, name: str) -> str | None:
        """The member called `name` in the folder of `member`, if there is one."""
        wanted = (PurePosixPath(member).parent / name).as_posix().casefold()
        return next((n for n in self.names if str(PurePosixPath(n)).casefold() == wanted), None)

    def read(self, member: str) -> bytes:
        """Content of a small member, at most `MOST_METADATA_BYTES`."""
        try:
            data = self._bytes(member)
        except (*_DAMAGED, RuntimeError, KeyError, EOFError) as error:
            raise ReadError(f"cannot read {member} in {self.path}: {error}. Copy or download it again.") from error
        self.was_read.append(member)
        if len(data) > MOST_METADATA_BYTES:
            raise InputError(
                f"{member} in {self.path} is larger than {MOST_METADATA_BYTES >> 20} MB, too large for metadata."
            )
        return data

    def tree(self, member: str | None, notes: list[str], otherwise: str = "", *, needs: str = "") -> ET.Element | None:
        """The metadata in a member; None where there is none, or where they are damaged or lack the element `needs`.

        What is damaged is noted in `notes`, in a line that ends with `otherwise`.
        """
        if member is None:
            return None
        try:
            root = tree_of(self.read(member), member)
            if needs and root.find(f".//{needs}") is None:
                raise MetadataError(f"{member} is damaged: it has no {needs}")
        except MetadataError as error:
            notes.append(f"{error}{otherwise}")
            return None
        return root

    def metadata(self, members: list[str], what: str, remedy: str, needs: str) -> tuple[ET.Element | None, list[str]]:
        """The metadata in the first of some members; where they cannot be read, a note that ends with `remedy`."""
        if not members:
            return None, [f"{self.path} has no {what}: {remedy}"]
        notes: list[str] = []
        return self.tree(members[0], notes, f": {remedy}", needs=needs), notes

    def _bytes(self, member: str) -> bytes:
        if self.kind == "zip":
            with zipfile.ZipFile(self.path) as archive, archive.open(member) as file:
                return file.read(MOST_METADATA_BYTES + 1)
        if self.kind == "tar":
            with tarfile.open(self.path, "r:") as tar:
                held = tar.extractfile(member)
                return held.read(MOST_METADATA_BYTES + 1) if held else b""
        with (Path(self.path) / member).open("rb") as file:
            return file.read(MOST_METADATA_BYTES + 1)


def last(member: str) -> str:
    """File name of a member."""
    return PurePosixPath(member).name


def is_archive(path: str) -> bool:
    """Whether a name has the ending of a supported archive."""
    return bool(_ZIP.search(path) or _TAR.search(path))


def open_folder(path: Path, named: str | None = None) -> Container:
    """List a folder; links to folders are not followed."""
    return Container(str(path), "folder", tuple(sorted(islice(_walk(path), MOST_MEMBERS))), named)


def open_archive(path: str) -> Container:
    """List a zip or tar."""
    kind = "zip" if _ZIP.search(path) else "tar"
    try:
        if kind == "zip":
            with zipfile.ZipFile(path) as archive:
                names = archive.namelist()
        else:
            with tarfile.open(path, "r:") as tar:
                names = [member.name for member in islice(tar, MOST_MEMBERS) if member.isfile()]
    except (*_DAMAGED, ValueError) as error:
        raise ReadError(f"cannot read {path}: {error}. The archive is damaged: download it again.") from error
    kept = [n for n in names[:MOST_MEMBERS] if not n.endswith("/") and _stays_inside(n)]
    return Container(path, kind, tuple(sorted(kept)))


def _stays_inside(name: str) -> bool:
    parts = PurePosixPath(name).parts
    return not (name.startswith("/") or ".." in parts or "\\" in name or len(parts) > DEEPEST + 1)


def _walk(root: Path) -> Iterator[str]:
    for folder, inner, files in os.walk(root):
        below = Path(folder).relative_to(root)
        inner[:] = sorted(d for d in inner if not d.startswith(".")) if len(below.parts) < DEEPEST else []
        yield from ((below / f).as_posix() for f in files if not f.startswith("."))
