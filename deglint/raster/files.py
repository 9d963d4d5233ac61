"""The files behind a name: all files that GDAL reads when it opens a raster, including nested sources of VRTs.

This serves three purposes: outputs never replace an input file (`deglint.raster.targets`), an input is identified by
all of its files (`deglint.checksum`), and an untrusted raster cannot read files outside its own folder.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ..errors import InputError, ReadError
from .local import COMPANIONS, check_kind, check_place, folder_of, identity, is_odd, local
from .vrt import Walk, is_vrt, sources_of

_PLAIN_TEXT = (".json", ".geojson", ".toml", ".csv")


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
            files, nested = _listed(dataset, name), _walk_of(dataset, name)
    except (InputError, ReadError):
        return
    yield from files
    for file in files:
        yield from local(file)
    for file in nested.found:
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
        Walk(folder_of(name)).start(name)


def check_after(dataset: Any, name: str) -> None:
    """Reject an open raster whose header refers to files outside of its folder."""
    if dataset.driver == "VRT":
        if not is_vrt(name):  # one that lies on a server, or in an archive
            _walk_of(dataset, name)
        return
    if dataset.driver.startswith("SENTINEL2") or is_odd(name):
        return  # parts of a product lie in the folders above; archives and servers hold no other names
    folder = os.path.dirname(os.path.abspath(name))  # noqa: PTH100, PTH120  (links beside the raster are its owner's)
    for file in _listed(dataset, name):
        beside = os.path.abspath(file).startswith(os.path.join(folder, ""))  # noqa: PTH100, PTH118
        if not (beside or file.startswith("/vsi") or file.endswith(COMPANIONS)):
            check_place(file, folder, name)


def _listed(dataset: Any, name: str) -> list[str]:
    """The files that GDAL lists for a dataset."""
    try:
        return list(dataset.files)
    except UnicodeDecodeError as error:
        raise ReadError(f"{name} leads to a file whose name is not UTF-8. Rename that, and correct {name}.") from error


def _walk_of(dataset: Any, name: str) -> Walk:
    """The sources of an open dataset; none if it is not a VRT."""
    files = _listed(dataset, name)
    walk = Walk(folder_of(files[0] if files else name))
    if dataset.driver == "VRT":
        if is_vrt(name):
            walk.start(name)
        else:
            text = dataset.tags(ns="xml:VRT").get("xml:VRT", "")
            walk.follow(sources_of(text, walk.folder, name))
    return walk
