"""Which scenes a batch is of: names, patterns, a CSV, or a STAC ItemCollection.

Lists come from others: names in them become file names only after they were checked, and no list is read that is too
long to be one.
"""

from __future__ import annotations

import csv
import glob
import io
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urljoin

from ..errors import InputError, ReadError
from ..shown import in_file_name
from .products import name_of
from .text import read_json, read_text

MOST_SCENES = 1_000_000
"""Scenes that a list may name."""
LONGEST_NAME = 150
"""Bytes of a scene's name: what is added for its outputs has to fit, too."""
_MAGIC = re.compile(r"[*?\[]")
_REMOTE = re.compile(r"(?:https?|s3|gs|az)://", re.IGNORECASE)
_SCHEME = re.compile(r"[A-Za-z][\w+.-]*:")
_RASTER = re.compile(r"image/|application/x-hdf|application/.*netcdf|application/(?:x-)?(?:zip|tar)", re.IGNORECASE)


@dataclass(frozen=True)
class ListedScene:
    """A scene of a batch.

    Attributes
    ----------
    name : str
        What its outputs are called after; never a path.
    paths : tuple of str
        GDAL names of its files.
    """

    name: str
    paths: tuple[str, ...]


def list_scenes(given: Sequence[str], assets: Sequence[str] = ()) -> list[ListedScene]:
    """The scenes that some arguments name, in their order.

    Parameters
    ----------
    given : sequence of str
        GDAL names and products (a folder, an archive or a metadata file); patterns with ``*``, ``?`` or ``[``, of local
        files; a CSV (``.csv``) whose column `path` names the file of a scene (several with ";" between them) and whose
        column `name`, if it is there, names the scene; a STAC ItemCollection or Item (``.json``, ``.geojson``).
    assets : sequence of str
        Keys of the assets of a STAC Item that are its bands, in this order; where empty, the item must have one
        raster of role "data", or one raster at all.

    Returns
    -------
    list of ListedScene

    Raises
    ------
    ReadError
        A list that is not there, or a pattern that fits no file.
    InputError
        A list that is not what its ending says, or names that cannot be names of files.
    """
    found: list[ListedScene] = []
    for text in given:
        new = list(_of_argument(text, assets))
        _check_paths(text, new)
        found.extend(new)
        if len(found) > MOST_SCENES:
            raise InputError(f"{text} brings the scenes to more than {MOST_SCENES}. Give a part of them at a time.")
    if not found:
        raise InputError(f"no scene is named in {', '.join(given) or 'nothing'}. Name rasters, a CSV or a STAC file.")
    return found


def _check_paths(origin: str, scenes: Sequence[ListedScene]) -> None:
    for path in (p for scene in scenes for p in scene.paths):
        try:
            fit = b"\0" not in os.fsencode(path)
        except UnicodeEncodeError:
            fit = False
        if not fit:
            raise InputError(f"{origin} names a file {path[:80]!r}, which no file can be called. Correct the name.")


def _of_argument(text: str, assets: Sequence[str]) -> Iterator[ListedScene]:
    ending = Path(text).suffix.lower()
    product = name_of(text)
    if product is not None:
        yield ListedScene(checked_name(product, text), (text,))
    elif _MAGIC.search(text) and not Path(text).exists():
        names = sorted(glob.glob(text, recursive=True))  # noqa: PTH207  (Path.glob knows no absolute patterns)
        if not names:
            raise ReadError(f"no file fits {text}. Check the pattern, and the directory that it starts from.")
        for name in names:
            yield ListedScene(_stem(name), (name,))
    elif ending == ".csv":
        yield from _of_csv(text)
    elif ending in (".json", ".geojson"):
        yield from _of_stac(text, assets)
    else:
        yield ListedScene(_stem(text), (text,))


def _stem(path: str) -> str:
    """The name of a product, else the last part of a GDAL name, without its ending."""
    product = name_of(path)
    if product is not None:
        return checked_name(product, path)
    last = re.split(r"[/\\:]", path.rstrip("/"))[-1]
    return checked_name(Path(last).stem or last, path)


def checked_name(name: str, origin: str) -> str:
    """A name that may become part of a file's name.

    Raises
    ------
    InputError
        It is empty, too long, or holds what leads out of a directory or is no letter.
    """
    try:
        length = len(os.fsencode(name))
    except UnicodeEncodeError:
        length = 0
    if not 0 < length <= LONGEST_NAME or name.startswith(".") or re.search(r"[/\\\x00-\x1f\x7f]", name):
        raise InputError(
            f"{origin[:200]}: a scene is called {name[:80]!r}, of which no file name can be made. Allowed are 1 to "
            f"{LONGEST_NAME} bytes without / and \\ and no dot in front."
        )
    return in_file_name(name)


def _of_csv(path: str) -> Iterator[ListedScene]:
    rows = csv.DictReader(io.StringIO(read_text(path, "list of scenes")), strict=True)
    try:
        if "path" not in (rows.fieldnames or ()):
            raise InputError(f"{path} has no column called path. Its first line must name the columns: path, name.")
        for row in rows:
            files = tuple(p.strip() for p in (row["path"] or "").split(";") if p.strip())
            if not files:
                raise InputError(f"{path}, line {rows.line_num}: the column path is empty. Name the scene's file.")
            name = (row.get("name") or "").strip()
            yield ListedScene(checked_name(name, path) if name else _stem(files[0]), files)
    except csv.Error as error:
        raise InputError(f"{path}, line {rows.line_num}: not CSV: {error}.") from error


def _of_stac(path: str, assets: Sequence[str]) -> Iterator[ListedScene]:
    document = read_json(path, "list of scenes")
    items = document.get("features") if document.get("type") == "FeatureCollection" else [document]
    if not isinstance(items, list):
        raise InputError(f"{path} is not a STAC ItemCollection: it has no list of features.")
    for i, item in enumerate(items, start=1):
        held = item.get("assets") if isinstance(item, Mapping) else None
        if not isinstance(held, Mapping) or not isinstance(item.get("id"), str):
            raise InputError(f"{path}: feature {i} is not a STAC Item: it lacks an id or assets.")
        keys = list(assets) or [_only_raster(held, f"{path}: item {item['id'][:80]!r}")]
        missing = [k for k in keys if k not in held]
        if missing:
            raise InputError(
                f"{path}: item {item['id'][:80]!r} has no asset {', '.join(missing)}; it has "
                f"{', '.join(map(str, list(held)[:30]))}. Name them in the recipe: [input] assets."
            )
        yield ListedScene(checked_name(item["id"], path), tuple(_href(held[k], path) for k in keys))


def _only_raster(assets: Mapping[str, Any], what: str) -> str:
    """Key of the one raster among assets."""
    rasters = {k: a for k, a in assets.items() if isinstance(a, Mapping) and _RASTER.match(str(a.get("type", "")))}
    data = [k for k, a in rasters.items() if "data" in (a.get("roles") or ())]
    keys = data or list(rasters) or list(assets)
    if len(keys) == 1:
        return keys[0]
    raise InputError(
        f"{what} has {len(keys)} rasters: {', '.join(map(str, keys[:30]))}. Name those that are the bands, in their "
        "order, in the recipe: [input] assets."
    )


def _href(asset: Any, path: str) -> str:
    """GDAL name of an asset; a relative one starts from the list."""
    href = asset.get("href") if isinstance(asset, Mapping) else None
    if not isinstance(href, str) or not href:
        raise InputError(f"{path}: an asset has no href.")
    if _REMOTE.match(href):
        return href
    if href.lower().startswith("file://"):
        return unquote(href[7:])
    if _SCHEME.match(href) or href.startswith("/vsi"):
        raise InputError(
            f"{path}: an asset lies at {href[:80]!r}; allowed are files, http(s), s3, gs and az. Name such a scene on "
            "the command line."
        )
    if _REMOTE.match(path):
        return urljoin(path, href)
    return str(Path(path).parent / href)
