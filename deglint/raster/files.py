"""The files behind a name: all files that GDAL reads when it opens a raster, including nested sources of VRTs.

This serves two purposes: outputs never replace an input file (`deglint.raster.targets`), and an input is identified by
all of its files (`deglint.checksum`).
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from ..errors import InputError, ReadError
from .info import REMOTE_NAME, open_dataset

COMPANIONS = (".aux.xml", ".msk", ".ovr")
"""Endings of files beside a raster that GDAL reads with it."""
_GDAL_PREFIX = re.compile(r"^(/?vsi\w+/)+|^[\w+]+://", re.IGNORECASE)
_PLAIN_TEXT = (".json", ".geojson", ".toml", ".csv")


def identity(path: str | Path) -> tuple[int, int] | str:
    """Identity of a file under any of its names: device and inode, or the resolved name if it does not exist."""
    with suppress(OSError, ValueError):
        found = Path(path).stat()
        return found.st_dev, found.st_ino
    return os.path.realpath(path)


def files_behind(names: Iterable[str | Path]) -> tuple[str, ...]:
    """All files that are read for these names, each once: the names themselves, then the files that belong to them.

    Names are GDAL names, folders or text files. Names that are not files ("auto", "0,0,10,10") are skipped. For a file
    in an archive, the archive is included. Files that cannot be opened are included by name only.
    """
    given = list(dict.fromkeys(map(str, names)))
    found = {identity(name): name for name in given[::-1]}
    for name in given:
        for file in _read_with(name):
            found.setdefault(identity(file), file)
    return (*given, *(file for file in found.values() if file not in given))


def _read_with(name: str) -> Iterator[str]:
    """The files that GDAL lists for a raster, or for the VRTs among its sources, and the archives they lie in."""
    yield from _local(name)
    waiting, seen = [name, *_local(name)], set[str]()
    while waiting:
        file = waiting.pop()
        if file in seen or REMOTE_NAME.match(file) or file.lower().endswith(_PLAIN_TEXT):
            continue
        seen.add(file)
        try:
            with open_dataset(file) as dataset:
                listed, mosaic = dataset.files, dataset.driver == "VRT"
        except (InputError, ReadError):
            continue
        for other in listed:
            yield from (other, *_local(other))
            if mosaic:
                stem = os.path.splitext(other)[0]  # noqa: PTH122  (sources are not opened: there may be ten thousand)
                beside = *(f"{other}{ending}" for ending in (*COMPANIONS, ".hdr")), f"{stem}.hdr"
                yield from filter(os.path.exists, beside)
        waiting += [other for other in listed if mosaic and other.lower().endswith(".vrt")]


def _local(name: str) -> list[str]:
    """The local file that a GDAL name refers to, or the archive that it lies in."""
    bare = Path(_GDAL_PREFIX.sub("", name.split("?")[0], count=1).replace("!", "/"))
    if os.path.exists(name) or str(bare) == name:  # noqa: PTH110  (never raises)
        return []
    return [str(place) for place in (bare, *bare.parents) if place.is_file()]
