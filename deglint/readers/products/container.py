"""Container of a product: a folder, a zip or a tar, whose members are listed and whose small files are read."""

from __future__ import annotations

import os
import re
import tarfile
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree as ET

from ...errors import InputError, ReadError
from .metadata import MetadataError, tree_of

MOST_MEMBERS = 20_000
"""Most members of a folder that are listed: a folder that is no product may be large."""
_DAMAGED = (OSError, ValueError, RuntimeError, KeyError, EOFError, zipfile.BadZipFile, tarfile.TarError)
_ARCHIVE = re.compile(r"\.(?:zip|tar)$", re.IGNORECASE)


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
        return _ARCHIVE.sub("", Path(self.path).absolute().name)

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
        """Content of a small member."""
        self.was_read.append(member)
        try:
            if self.kind == "zip":
                with zipfile.ZipFile(self.path) as archive:
                    return archive.read(member)
            if self.kind == "tar":
                with tarfile.open(self.path, "r:") as tar:
                    held = tar.extractfile(member)
                    return held.read() if held else b""
            return (Path(self.path) / member).read_bytes()
        except _DAMAGED as error:
            raise ReadError(f"cannot read {member} in {self.path}: {error}. Copy or download it again.") from error

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


def last(member: str) -> str:
    """File name of a member."""
    return PurePosixPath(member).name


def is_archive(path: str) -> bool:
    """Whether a name has the ending of a supported archive."""
    return bool(_ARCHIVE.search(path))


def open_folder(path: Path, named: str | None = None) -> Container:
    """List a folder; links to folders are not followed."""
    files = (Path(folder) / name for folder, _, names in os.walk(path) for name in names if not name.startswith("."))
    members = (file.relative_to(path).as_posix() for file in islice(files, MOST_MEMBERS))
    return Container(str(path), "folder", tuple(sorted(members)), named)


def open_archive(path: str) -> Container:
    """List a zip or tar."""
    kind = path[-3:].lower()
    try:
        if kind == "zip":
            with zipfile.ZipFile(path) as archive:
                names = [name for name in archive.namelist() if not name.endswith("/")]
        else:
            with tarfile.open(path, "r:") as tar:
                names = [member.name for member in tar if member.isfile()]
    except _DAMAGED as error:
        raise ReadError(f"cannot read {path}: {error}. The archive is damaged: download it again.") from error
    return Container(path, kind, tuple(sorted(names)))
