"""The files behind a name: all files that GDAL reads when it opens a raster, including nested sources of VRTs.

This serves three purposes: outputs never replace an input file (`deglint.raster.targets`), an input is identified by
all of its files (`deglint.checksum`), and an untrusted raster cannot read files outside its own folder. The sources of
VRTs at any depth are found in their XML before GDAL opens them (GDAL 3.10 has no setting for this): an untrusted VRT
must not read files outside its folder or on a server, nor contain itself.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from ..errors import InputError, ReadError

TRUST = "DEGLINT_VRT_SOURCES"
"""Environment variable: folders, or "any", from which VRTs may read besides their own folder."""
COMPANIONS = (".aux.xml", ".msk", ".ovr")
"""Endings of files beside a raster that GDAL reads with it."""
MOST_READS = 100_000
"""Most sources that are read for one band, if more than four times the number of files: nested mosaics multiply."""
MOST_NESTED = 32
"""Most levels of nested VRTs."""
MOST_VRT_BYTES = 64 << 20
_DRIVER_PREFIX = re.compile(r"[A-Za-z][\w+.-]+:")
_ODD = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}
_IN_ARCHIVES = re.compile(r"/vsi(zip|tar|gzip|7z|rar)/", re.IGNORECASE)
_ANYWHERE = {"sourcefilename", "sourcedataset", "dempath"}
_NESTED = "<vrtdataset"
_PLAIN_TEXT = (".json", ".geojson", ".toml", ".csv")
Sources = tuple[tuple[str, ...], ...]
"""Names of the sources of a VRT: those of the dataset, then those of each band."""


def real(path: str | Path) -> Path:
    """The path of a file with symbolic links resolved; it need not exist."""
    return Path(os.path.realpath(path))


def is_utf8(path: str | Path) -> bool:
    """Whether a name is valid UTF-8: Linux allows any bytes."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def check_kind(path: str | Path) -> None:
    """Reject a name that is neither a file nor a folder: reading it might never end."""
    if not is_utf8(path):
        raise ReadError(f"the name {os.fsencode(path)!r} is not UTF-8, and GDAL opens no other. Rename it.")
    kind = "a pipe" if str(path).lower().startswith("/vsistdin") else None
    with suppress(OSError, ValueError):
        kind = kind or _ODD.get(stat.S_IFMT(os.stat(path).st_mode))  # noqa: PTH116  (some names cannot be a Path)
    if kind:
        raise ReadError(f"{path} is {kind}, which cannot be read as a file. Save what comes from it, and name that.")


def identity(path: str | Path) -> tuple[int, int] | str:
    """Identity of a file under any of its names: device and inode, or the resolved name if it does not exist."""
    with suppress(OSError, ValueError):
        found = os.stat(path)  # noqa: PTH116  (some names cannot be a Path)
        return found.st_dev, found.st_ino
    with suppress(OSError, ValueError):
        return os.path.realpath(path)
    return str(path)


def is_odd(name: str) -> bool:
    """Whether a GDAL name is more than a file name, such as a URL or a driver prefix."""
    return name.startswith("/vsi") or "://" in name or bool(_DRIVER_PREFIX.match(name)) or name.lstrip().startswith("<")


def local(name: str) -> list[str]:
    """The local files that a GDAL name refers to, or lies in."""
    if os.path.lexists(name):
        return [name]
    if len(name) > 4096 or not is_odd(name):
        return []
    bare = re.sub(r"^(/vsi[a-z0-9_]+/)+", "/", name.split("?")[0], flags=re.IGNORECASE)
    bare = re.sub(r"^[A-Za-z][\w+.-]*://", "", bare).replace("!", "/").replace("{", "").replace("}", "")
    pieces = [bare, bare.lstrip("/"), *re.split(r'[":,]', bare)]
    found = []
    for piece in map(Path, pieces):
        place = next((p for p in (piece, *piece.parents) if os.path.lexists(p)), None)
        if place is not None and place.is_file():
            found.append(str(place))
    return list(dict.fromkeys(found))


def files_behind(names: Iterable[str | Path]) -> tuple[str, ...]:
    """All files that are read for these names, each once: the names themselves, then the files that belong to them.

    Names are GDAL names, folders or text files. Names that are not files ("auto", "0,0,10,10") are skipped. For a file
    in an archive, the archive is included. Files that cannot be opened are included by name only.
    """
    given = list(map(str, names))
    found = {identity(name): name for name in given[::-1]}
    for name in given:
        files = local(name)
        if not name.lower().endswith(_PLAIN_TEXT):
            files += _of_raster(name)
        for file in files:
            found.setdefault(identity(file), file)
    own = set(given)
    return (*dict.fromkeys(given), *(file for file in found.values() if file not in own))


def _of_raster(name: str) -> Iterator[str]:
    """The files that GDAL lists, and the sources of VRTs."""
    from .info import REMOTE_NAME, open_dataset

    if REMOTE_NAME.match(name):
        return  # all of it lies there
    try:
        with open_dataset(name) as dataset:
            files, nested = _listed(dataset, name), _nested_sources(dataset, name)
    except (InputError, ReadError):
        return
    yield from files
    for file in files:
        yield from local(file)
    for file in nested:
        yield file
        yield from local(file)
        stem = os.path.splitext(file)[0]  # noqa: PTH122  (sources are not opened: there may be ten thousand)
        yield from filter(
            os.path.lexists, [*(f"{file}{ending}" for ending in COMPANIONS), f"{stem}.hdr", f"{file}.hdr"]
        )


def check_before(name: str) -> None:
    """Reject a raster that must not be opened: a pipe, or a VRT with forbidden or too many sources."""
    check_kind(name)
    if is_vrt(name):
        _sources_behind(name, _folder_of(name))


def check_after(dataset: Any, name: str) -> None:
    """Reject an open raster whose header refers to files outside of its folder."""
    if dataset.driver == "VRT":
        if not is_vrt(name):  # one that lies on a server, or in an archive
            _nested_sources(dataset, name)
        return
    if dataset.driver.startswith("SENTINEL2") or is_odd(name):
        return  # parts of a product lie in the folders above; archives and servers hold no other names
    folder = os.path.dirname(os.path.abspath(name))  # noqa: PTH100, PTH120  (links beside the raster are its owner's)
    for file in _listed(dataset, name):
        beside = os.path.abspath(file).startswith(os.path.join(folder, ""))  # noqa: PTH100, PTH118
        if not (beside or file.startswith("/vsi") or file.endswith(COMPANIONS)):
            _check_place(file, folder, name)


def _listed(dataset: Any, name: str) -> list[str]:
    """The files that GDAL lists for a dataset."""
    try:
        return list(dataset.files)
    except UnicodeDecodeError as error:
        raise ReadError(f"{name} leads to a file whose name is not UTF-8. Rename that, and correct {name}.") from error


def _nested_sources(dataset: Any, name: str) -> Iterable[str]:
    """The sources of an open dataset; none if it is not a VRT."""
    if dataset.driver != "VRT":
        return ()
    files = _listed(dataset, name)
    folder = _folder_of(files[0] if files else name)
    if is_vrt(name):
        return _sources_behind(name, folder)
    walk = _Walk(folder)
    walk.follow(sources_of(dataset.tags(ns="xml:VRT").get("xml:VRT", ""), folder, name))
    return walk.found


def _sources_behind(name: str, folder: str) -> Iterable[str]:
    """The sources of a local VRT at any depth, each of which is checked."""
    walk = _Walk(folder)
    reads = walk.follow(_parsed(name, _stamp(name)), (_key(name),))
    if reads > MOST_READS and reads > 4 * len(walk.found):
        raise InputError(
            f"{name} reads {reads:,} sources for a band, most of them again and again; allowed are "
            f"{MOST_READS:,}. Make one raster of it first: gdal_translate."
        )
    return walk.found


@dataclass
class _Walk:
    """Recursive search of the sources of a VRT in a folder, which checks each and counts the reads for a band."""

    folder: str
    found: dict[str, int | None] = field(default_factory=dict)  # files read for each source; None: not known yet

    def follow(self, sources: Sources, inside: tuple[str, ...] = ()) -> int:
        """Check sources, including nested VRTs; return the most reads for one band.

        `inside` are the VRTs in which they lie.
        """
        whole, *bands = (sum(self._reads_of(name, inside) for name in names) for names in sources)
        return whole + max(bands, default=0)

    def _reads_of(self, name: str, inside: tuple[str, ...]) -> int:
        """Files that are read for a source: one, or those of a nested VRT."""
        if name not in self.found:
            self.found[name] = None
            _check_source(name, self.folder)
        if (reads := self.found[name]) is not None:
            return reads
        nested = _inner(name)
        if nested:
            key = _key(name)
            if key in inside:
                return 0  # it holds itself; GDAL stops there
            if len(inside) >= MOST_NESTED:
                raise InputError(
                    f"VRTs lie in VRTs more than {MOST_NESTED} deep. Make one raster of it: gdal_translate."
                )
            inside = (*inside, key)
        self.found[name] = reads = self.follow(nested, inside) if nested else 1
        return reads


def _check_source(name: str, folder: str) -> None:
    """Reject a source of a VRT outside of its folder and of the trusted folders."""
    check_kind(name)
    if name.lower().startswith(("vrt://", _NESTED)):
        return  # what it names is checked
    if name.startswith("/vsi") and os.path.normpath(name).startswith(os.path.normpath(folder) + "/"):
        return  # beside the VRT on its server, or in its archive
    inside = local(name)
    elsewhere = not inside or (name.startswith("/vsi") and not _IN_ARCHIVES.match(name))
    if is_odd(name) and not Path(name).exists() and elsewhere and "any" not in _trusted():
        _refuse(name, folder, "a VRT", "any")
    for file in inside or [name]:
        _check_place(file, folder, "a VRT")


def _check_place(file: str, folder: str, name: str) -> None:
    """Reject a file outside of a folder and of the trusted folders."""
    where = os.path.realpath(file)
    for allowed in (folder, *_trusted()):
        if allowed == "any" or where.startswith(os.path.join(os.path.realpath(allowed), "")):  # noqa: PTH118
            return
    _refuse(file, folder, name, os.path.dirname(where) if not is_odd(file) else "any")  # noqa: PTH120


def _refuse(file: str, folder: str, name: str, trust: str) -> None:
    raise InputError(
        f"{name} in {folder or '.'} reads {file[:200]!r}, which is not in that folder. If you trust it, allow it: "
        f"set the environment variable {TRUST}={trust} (folders with {os.pathsep!r} between them, or any)."
    )


def _trusted() -> list[str]:
    """The folders trusted by the environment variable."""
    return [t for t in os.environ.get(TRUST, "").split(os.pathsep) if t]


def _folder_of(name: str) -> str:
    """The folder of a raster with links resolved; in archives and on servers as in the GDAL name."""
    if name.lstrip().startswith("<"):
        return os.path.realpath(".")
    if os.path.lexists(name):
        return os.path.realpath(name if Path(name).is_dir() else Path(name).parent)
    return os.path.dirname(name)  # noqa: PTH120


def _inner(name: str) -> Sources:
    """The sources of a source that is itself a VRT; else none."""
    if name.lower().startswith(_NESTED):
        return sources_of(name, "", "a VRT")
    if name.lower().startswith("vrt://"):
        return ((name[6:].partition("?")[0],),)
    return _parsed(name, _stamp(name)) if is_vrt(name) else ()


def _key(name: str) -> str:
    return name if name.lower().startswith((_NESTED, "vrt://")) else os.path.realpath(name)


def _stamp(name: str) -> tuple[int, int, int]:
    found = Path(name).stat()
    return found.st_ino, found.st_size, found.st_mtime_ns


def is_vrt(name: str) -> bool:
    """Whether GDAL would treat a local file as a VRT: the first kilobytes contain its root element."""
    try:
        if not Path(name).is_file():
            return False
        with Path(name).open("rb") as file:
            return b"<VRTDataset" in file.read(4096)
    except (OSError, ValueError):
        return False


@lru_cache(maxsize=256)
def _parsed(name: str, stamp: tuple[int, int, int]) -> Sources:
    """The sources of a local VRT; cached until the file changes."""
    if stamp[1] > MOST_VRT_BYTES:
        raise InputError(f"{name} is a VRT of {stamp[1] >> 20} MB; allowed are {MOST_VRT_BYTES >> 20} MB.")
    try:
        data = Path(name).read_bytes()
    except OSError as error:
        raise ReadError(f"cannot read {name}: {error.strerror}.") from error
    folder = str(Path(name).parent)
    try:
        return sources_of(data.decode(), folder, name)
    except UnicodeDecodeError:
        found = sources_of(data.decode("latin-1"), folder, name)
    if not all(source.isascii() for sources in found for source in sources):
        raise ReadError(f"{name} leads to a file whose name is not UTF-8. Rename that, and correct {name}.")
    return found


def sources_of(text: str, folder: str, name: str) -> Sources:
    """The sources named in the XML of a VRT.

    XML that GDAL's parser might read differently is rejected: entities, or incomplete documents.
    """
    try:
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ValueError("it declares entities")
        start = text.index("<VRTDataset")
        root = ET.fromstring(text[start:].rstrip("\0 \n\r\t"))
    except (ValueError, ET.ParseError, RecursionError) as error:
        raise ReadError(f"cannot read {name[:200]}: its XML is damaged ({error}). Make the VRT again.") from error
    whole: list[str] = []
    bands = []
    for top in root:
        named = [source for element in top.iter() for source in _named(element, folder)]
        if _tag(top) == "vrtrasterband":
            bands.append(tuple(named))
        else:
            whole += named
    return tuple(whole), *bands


def _named(element: ET.Element, folder: str) -> Iterator[str]:
    """File names that GDAL might read from an element; there may be several if it has child elements."""
    tag, text = _tag(element), "".join(element.itertext())
    key = (_attribute(element, "name") or _attribute(element, "key")).lower()
    named = tag in ("argument", "mdi") and ("filename" in key or key in ("x_dataset", "y_dataset"))
    if not (named or tag in _ANYWHERE):
        return
    flags = [_attribute(element, "relativetovrt")] + [c.text or "" for c in element if _tag(c) == "relativetovrt"]
    relative = any(re.match(r"\s*[+-]?0*[1-9]", flag) for flag in flags)
    for spelled in dict.fromkeys((element.text or "", text, *(child.tail or "" for child in element))):
        if name := spelled.strip():
            yield _beside(name, folder) if relative else name


def _beside(name: str, folder: str) -> str:
    """A name relative to a VRT's folder, resolved as GDAL does."""
    if name.lower().startswith("vrt://"):
        return "vrt://" + _beside(name[6:], folder)
    quoted = re.fullmatch(r'([A-Za-z][\w+.-]+:)("?)([^":]*)("?)(:.*)?', name)
    if quoted and not (Path(folder) / name).exists():
        head, first, file, last, tail = quoted.groups()
        return f"{head}{first}{os.path.join(folder, file)}{last}{tail or ''}"  # noqa: PTH118
    return os.path.join(folder, name)  # noqa: PTH118  (a GDAL name stays one)


def _tag(element: ET.Element) -> str:
    return str(element.tag).rpartition("}")[2].rpartition(":")[2].lower()


def _attribute(element: ET.Element, name: str) -> str:
    """An attribute by name; case is ignored, as in GDAL."""
    return next((v for k, v in element.attrib.items() if k.lower() == name), "")
