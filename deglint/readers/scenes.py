"""List the scenes of a batch from names, patterns, a CSV or a STAC ItemCollection."""

import csv
import glob
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError, ReadError
from .products import name_of
from .stac import bands_of_item, items_of, read_document
from .text import read_text

LONGEST_NAME = 150  # allowed length of the name of a scene; names of outputs are longer
_MAGIC = re.compile(r"[*?\[]")


@dataclass(frozen=True)
class ListedScene:
    """A scene of a batch: its name and its files."""

    name: str  # its outputs get this name; never a path
    paths: tuple[str, ...]  # GDAL names of its files
    item: str = field(default="", compare=False)  # name of the STAC Item that has these files, for `open_scene`

    @property
    def source(self) -> list[str]:
        """Names for `open_scene`."""
        return [self.item] if self.item else list(self.paths)


def list_scenes(given: Sequence[str], assets: Sequence[str] = ()) -> list[ListedScene]:
    """List the scenes that arguments of a command name, in their order.

    Parameters
    ----------
    given : sequence of str
        GDAL names and products (a folder, an archive or a metadata file); patterns with ``*``, ``?`` or ``[``, of local
        files; a CSV (``.csv``) whose column `path` has the file of a scene (several separated by ";") and whose
        optional column `name` has the name of the scene; a STAC ItemCollection or Item (``.json``, ``.geojson``).
    assets : sequence of str
        Keys of the assets of a STAC Item that are its bands, in this order. If empty: the assets declared as bands,
        else the only raster with the role "data", else the only raster.
    """
    found = [scene for text in given for scene in _of_argument(text, assets)]
    if not found:
        raise InputError(f"no scene is named in {', '.join(given) or 'nothing'}. Name rasters, a CSV or a STAC file.")
    return found


def _of_argument(text: str, assets: Sequence[str]) -> Iterator[ListedScene]:
    ending = Path(text).suffix.lower()
    if name_of(text) is not None:
        yield ListedScene(_stem(text), (text,))
    elif _MAGIC.search(text) and not Path(text).exists():
        names = sorted(glob.glob(text, recursive=True))  # noqa: PTH207  (Path.glob knows no absolute patterns)
        if not names:
            raise ReadError(f"no file fits {text}. Check the pattern, and the directory that it starts from.")
        for name in names:
            yield ListedScene(_stem(name), (name,))
    elif ending == ".csv":
        yield from _of_csv(text)
    elif ending in (".json", ".geojson") or re.match(r"https?://.+/items/[^/]+$", text, re.IGNORECASE):
        for item in items_of(read_document(text), text):
            files = tuple(asset.path for asset in bands_of_item(item, text, assets))
            source = f"{text}#{item['id']}" + (f"#{','.join(assets)}" if assets else "")
            yield ListedScene(checked_name(item["id"], text), files, source)
    else:
        yield ListedScene(_stem(text), (text,))


def _stem(path: str) -> str:
    """Name of a scene: the name of the product, else the file name without folder and ending."""
    last = re.split(r"[/\\:]", path.rstrip("/"))[-1]
    return checked_name(name_of(path) or Path(last).stem or last, path)


def checked_name(name: str, origin: str) -> str:
    """Return the name of a scene if it can be part of a file name; else InputError, which names its `origin`."""
    if not 0 < len(name) <= LONGEST_NAME or name.startswith(".") or re.search(r"[/\\\x00-\x1f\x7f]", name):
        raise InputError(
            f"{origin}: a scene is called {name!r}, of which no file name can be made. Allowed are 1 to "
            f"{LONGEST_NAME} letters without / and \\ and no dot in front."
        )
    return name


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
