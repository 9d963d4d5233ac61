"""Local files behind GDAL names: their kind, and the folders in which they may lie."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

from ..errors import InputError, ReadError

TRUST = "DEGLINT_VRT_SOURCES"
"""Environment variable: folders, or "any", from which VRTs may read besides their own folder."""
COMPANIONS = (".aux.xml", ".msk", ".ovr")
"""Endings of files beside a raster that GDAL reads with it."""
_DRIVER_PREFIX = re.compile(r"[A-Za-z][\w+.-]+:")
_ODD = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}


def real(path: str | Path) -> Path:
    """The path of a file with symbolic links resolved; it need not exist."""
    return Path(os.path.realpath(path))


def check_kind(path: str | Path) -> None:
    """Reject a name that is neither a file nor a folder: reading it might never end."""
    if not is_utf8(path):
        raise ReadError(f"the name {os.fsencode(path)!r} is not UTF-8, and GDAL opens no other. Rename it.")
    kind = "a pipe" if str(path).lower().startswith("/vsistdin") else _odd(path)
    if kind:
        raise ReadError(f"{path} is {kind}, which cannot be read as a file. Save what comes from it, and name that.")


def is_utf8(path: str | Path) -> bool:
    """Whether a name is valid UTF-8: Linux allows any bytes."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _odd(path: str | Path) -> str:
    try:
        return _ODD.get(stat.S_IFMT(os.stat(path).st_mode), "")  # noqa: PTH116  (what cannot be a Path raises here)
    except (OSError, ValueError):
        return ""


def identity(path: str | Path) -> tuple[int, int] | str:
    """Identity of a file under any of its names: device and inode, or the resolved name if it does not exist."""
    try:
        found = os.stat(path)  # noqa: PTH116  (names that cannot be a Path raise here, too)
    except (OSError, ValueError):
        try:
            return os.path.realpath(path)
        except (OSError, ValueError):
            return str(path)
    return found.st_dev, found.st_ino


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
    for piece in dict.fromkeys(pieces):
        place = Path(piece) if piece.strip("/ ") else None
        while place is not None and not os.path.lexists(str(place)):
            place = place.parent if place.parent != place and len(place.parts) > 1 else None
        if place is not None and place.is_file():
            found.append(str(place))
    return list(dict.fromkeys(found))


def folder_of(name: str) -> str:
    """The folder of a raster with links resolved; in archives and on servers as in the GDAL name."""
    if name.lstrip().startswith("<"):
        return os.path.realpath(".")
    if os.path.lexists(name):
        return os.path.realpath(name if Path(name).is_dir() else Path(name).parent)
    return os.path.dirname(name)  # noqa: PTH120


def check_place(file: str, folder: str, name: str) -> None:
    """Reject a file outside of a folder and of the trusted folders."""
    where = os.path.realpath(file)
    for allowed in (folder, *trusted()):
        if allowed == "any" or where.startswith(os.path.join(os.path.realpath(allowed), "")):  # noqa: PTH118
            return
    refuse(file, folder, name)


def refuse(file: str, folder: str, name: str = "a VRT") -> None:
    """Raise the error for a raster that refers to a forbidden file, with the way to allow it."""
    named = os.path.dirname(os.path.realpath(file)) if not is_odd(file) else "any"  # noqa: PTH120
    raise InputError(
        f"{name} in {folder or '.'} reads {file[:200]!r}, which is not in that folder. If you trust it, allow it: "
        f"set the environment variable {TRUST}={named} (folders with {os.pathsep!r} between them, or any)."
    )


def trusted() -> list[str]:
    """The folders trusted by the environment variable."""
    return [t for t in os.environ.get(TRUST, "").split(os.pathsep) if t]
