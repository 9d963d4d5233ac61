"""Find the files and bands of STAC Items, and list the scenes of a batch (a command that processes many scenes).

An Item can be named instead of a raster, by a local file or URL, by "FILE#ID" if FILE is an ItemCollection, and by
"FILE#ID#KEY,KEY" to select some of its assets. A batch takes names of files, patterns, CSV files and ItemCollections.
"""

import csv
import glob
import io
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urljoin

from ..errors import DeglintError, InputError, ReadError
from ..raster import RasterInfo
from ..raster.info import REMOTE_NAME
from . import products
from .products.metadata import ProductBand, filled, tags_of, view_tags
from .spectral import nanometres, nominal_wavelength
from .text import number, positive, read_json, read_text

LONGEST_NAME = 150  # allowed length of the name of a scene; names of outputs are longer
_MAGIC = re.compile(r"[*?\[]")
_RASTER = re.compile(r"image/|application/x-hdf|application/.*netcdf|application/(?:x-)?(?:zip|tar)", re.IGNORECASE)
_NAME = re.compile(r"(.+\.(?:geo)?json|https?://[^#]+/items/[^#]+)(?:#([^#]*))?(?:#([^#]*))?", re.IGNORECASE)
_NO_DATA = {"thumbnail", "overview", "visual", "metadata", "rendered_preview", "preview", "tilejson"}
"""Roles and keys of assets that are pictures or documents, not bands of the scene."""
_NOT_BANDS = {"pan", "lwir", "lwir11", "lwir12"}
"""Common names of bands that are not used: panchromatic (its finer grid would apply to all bands) and thermal."""
_STAC_PATIENCE = 60.0  # timeout of a server that sends Items [s]


@dataclass(frozen=True)
class Asset:
    """A file, and what a STAC Item says about its bands; `bands` and `tags` are empty for a file without Item."""

    path: str  # GDAL name
    bands: tuple[ProductBand, ...] = ()
    tags: Mapping[str, str] = field(default_factory=dict)  # tags from the Item: date, angles

    def put_on(self, info: RasterInfo) -> RasterInfo:
        """A copy of `info` with the Item's properties; `info` itself if the Item has another number of bands."""
        if len(self.bands) != info.count:
            return info
        nodatas = tuple(b.nodata if n is None else n for n, b in zip(info.nodatas, self.bands, strict=True))
        return replace(filled(info, self.bands, self.tags, None), nodatas=nodatas)


def assets_of(name: str) -> list[Asset]:
    """The files that a name stands for: the assets of a STAC Item that contain its bands, or the file itself."""
    found = _NAME.fullmatch(name)
    if found is None or products.name_of(name) is not None:  # a product may have its metadata in JSON
        return [Asset(name)]
    path, wanted, keys = found[1], found[2] or "", tuple(k for k in (found[3] or "").split(",") if k)
    items = items_of(read_document(path), path)
    fits = [i for i in items if wanted in ("", i["id"])]
    if len(fits) != 1:
        ids = ", ".join(i["id"] for i in items[:10]) or "none"
        raise InputError(f"{name} holds {len(fits)} STAC Items. Name one as {path}#ID; there are {ids}.")
    return bands_of_item(fits[0], path, keys)


def files_of(name: str) -> tuple[str, ...]:
    """GDAL names of all files that a name stands for: a STAC Item and the files of its bands, or a product's files.

    If the name is neither a STAC Item nor a product, or cannot be read, the result is the name itself.
    """
    try:
        assets = assets_of(name)
        found = tuple(file for asset in assets for file in products.files_of(asset.path))
    except DeglintError:  # the error is raised when the scene is opened
        return (name,)
    return found if assets == [Asset(name)] else (name.partition("#")[0], *found)


def read_document(path: str) -> Mapping[str, Any]:
    """Read the JSON object in a local file or at a URL. Raises ReadError or InputError if this fails."""
    return _fetched(path) if re.match(r"https?://", path, re.IGNORECASE) else read_json(path, "STAC")


@lru_cache(maxsize=16)  # an Item is read twice: for the names of its files, and to open them
def _fetched(path: str) -> Mapping[str, Any]:
    from urllib.request import Request, urlopen

    try:
        with urlopen(Request(path, headers={"Accept": "application/json"}), timeout=_STAC_PATIENCE) as answer:
            document = json.load(answer)
    except (OSError, ValueError, RecursionError) as error:
        why = getattr(error, "reason", None) or error
        raise ReadError(f"cannot read the STAC Item {path}: {why}. Check the address, or save it as a file.") from error
    if not isinstance(document, Mapping):
        raise InputError(f"{path} is not a STAC Item: it holds no object.")
    return document


def items_of(document: Mapping[str, Any], path: str) -> list[Mapping[str, Any]]:
    """The Items in a document, which is a STAC ItemCollection or Item. Raises InputError for anything else."""
    found = document.get("features") if document.get("type") == "FeatureCollection" else [document]
    items = found if isinstance(found, list) else []
    for i, item in enumerate(items, start=1):
        held = item.get("assets") if isinstance(item, Mapping) else None
        if not isinstance(held, Mapping) or not isinstance(item.get("id"), str):
            raise InputError(f"{path}: feature {i} is no STAC Item: it lacks id or assets. Name a raster or an Item.")
    return items


def bands_of_item(item: Mapping[str, Any], path: str, keys: Sequence[str]) -> list[Asset]:
    """Assets with the bands of a STAC Item (file or URL `path`): those in `keys`, else the default of `list_scenes`."""
    assets, what = item["assets"], f"{path}: item {item['id'][:80]!r}"
    if missing := [k for k in keys if k not in assets]:
        raise InputError(
            f"{what} has no asset {', '.join(missing)}; it has {', '.join(map(str, list(assets)[:30]))}. Choose "
            "the band assets: FILE#ID#KEY,KEY as input, or assets in [input] of a batch recipe."
        )
    facts = item["properties"] if isinstance(item.get("properties"), Mapping) else {}
    # `view:azimuth` is interpreted as the direction from the scene to the satellite: the specification is ambiguous,
    # but Items of Sentinel-2 and PlanetScope use it so
    view = {name: number(facts.get(f"view:{name}")) for name in ("incidence_angle", "azimuth", "off_nadir")}
    sun = {name: number(facts.get(f"view:{name}")) for name in ("sun_elevation", "sun_azimuth")}
    texts = {k: facts[k] for k in ("platform", "datetime") if isinstance(facts.get(k), str)}
    tags = tags_of(texts | sun | view_tags(view["incidence_angle"], view["azimuth"], view["off_nadir"]))
    applied = any(facts.get(f"{p}:boa_offset_applied") is True for p in ("earthsearch", "sentinel"))
    found = []
    for key in keys or _chosen(assets, what):
        file = href(assets[key], path)
        found.append(Asset(file, tuple([band for _, band in _said(assets[key], key, file, applied=applied)]), tags))
    return found


def _chosen(assets: Mapping[str, Any], what: str) -> list[str]:
    """Keys of the assets used by default, as in `list_scenes`. Raises InputError if the Item `what` has no default."""
    rasters = {k: a for k, a in assets.items() if isinstance(a, Mapping) and _RASTER.match(str(a.get("type", "")))}
    roles = {k: a["roles"] if isinstance(a.get("roles"), list) else [] for k, a in rasters.items()}
    usable = {k: a for k, a in rasters.items() if not _NO_DATA & {str(k), *map(str, roles[k])}}
    said = {k: _said(a, k) for k, a in usable.items()}
    # of assets with the same band, that with the smallest pixels is used; of these, TIFF: it can be read in parts
    rank = {k: (f[0][0]["gsd"], "tiff" not in str(usable[k].get("type"))) for k, f in said.items() if len(f) == 1}
    singles: dict[object, list[str]] = {}
    for key in sorted(rank, key=rank.__getitem__):
        ((stated, band),) = said[key]
        common = str(stated.get("common_name") or "")
        if band.wavelength is not None and common not in _NOT_BANDS:
            same = singles.setdefault(stated["name"] or (common, band.wavelength), [])
            if not same or (not stated["name"] and rank[key] == rank[same[0]]):  # such as three red-edge bands
                same.append(key)
    keys = sorted([k for same in singles.values() for k in same], key=lambda k: said[k][0][1].wavelength or 0.0)
    if len(keys) > 1:
        return keys
    several = [k for k, bands in said.items() if len(bands) > 1]
    if len(several) == 1:
        return several
    keys = [k for k in rasters if "data" in roles[k]] or list(rasters) or list(assets)
    if len(keys) == 1:
        return keys
    raise InputError(
        f"{what} has {len(keys)} rasters: {', '.join(map(str, keys[:30]))}. Choose the band assets, in order: "
        "FILE#ID#KEY,KEY as input, or assets in [input] of a batch recipe."
    )


def _said(asset: Any, key: str, file: str = "", *, applied: bool = False) -> list[tuple[dict[str, Any], ProductBand]]:
    """For each band of an asset, what the Item states, as a dict and as a `ProductBand` of the file `file` (GDAL name).

    Both are read from "bands" (STAC 1.1), or from the extensions "eo:bands" and "raster:bands". A `ProductBand` without
    a stated name is named `key`. If `applied`, the provider has applied the offset, and the `ProductBand` has offset 0.
    Keys of the dict have no prefix "eo:" or "raster:". Its "gsd" is the pixel size [m], infinite if it is not stated.
    """
    given = [asset.get(n) for n in ("bands", "eo:bands", "raster:bands")] if isinstance(asset, Mapping) else []
    lists = [n for n in given if isinstance(n, list) and all(isinstance(b, Mapping) for b in n)]
    count = max(map(len, lists), default=0)
    found = []
    for i in range(count):
        said: dict[str, Any] = {}
        for own in [asset, *(n[i] for n in lists if len(n) == count)]:
            said |= {re.sub(r"^(?:eo|raster):", "", str(k)): v for k, v in own.items()}
        said["gsd"] = positive(said.get("spatial_resolution")) or positive(said.get("gsd")) or math.inf
        said["name"] = said["name"] if isinstance(said.get("name"), str) else ""
        name = said["name"] or str(key)
        centre, width = number(said.get("center_wavelength")), number(said.get("full_width_half_max"))
        wavelength = nanometres(centre, "um") if centre else nominal_wavelength(str(said.get("common_name") or name))
        band = ProductBand(file, name, wavelength, nanometres(width, "um") if width else None)
        scale, offset, nodata = (number(said.get(k)) for k in ("scale", "offset", "nodata"))
        unit = said["unit"] if isinstance(said.get("unit"), str) else None
        offset = 0.0 if applied or offset is None else offset
        found.append((said, replace(band, scale=scale or 1.0, offset=offset, nodata=nodata, unit=unit)))
    return found


def href(asset: object, path: str) -> str:
    """GDAL name of the file of an asset; a relative link is resolved from `path`, the Item's file or URL."""
    given = asset.get("href") if isinstance(asset, Mapping) else None
    if not isinstance(given, str) or not given:
        raise InputError(f"{path}: an asset has no href. Name the raster files themselves.")
    if REMOTE_NAME.match(given):
        return given
    if given.lower().startswith("file://"):
        return unquote(given[7:])
    return urljoin(path, given) if REMOTE_NAME.match(path) else str(Path(path).parent / given)


@dataclass(frozen=True)
class ListedScene:
    """A scene of a batch: its name and its files."""

    name: str  # used in the names of its outputs; it is not a path
    paths: tuple[str, ...]  # GDAL names of its files
    item: str = field(default="", compare=False)  # name of the STAC Item that has these files, for `open_scene`

    @property
    def source(self) -> list[str]:
        """Names to give to `open_scene` as `path`."""
        return [self.item] if self.item else list(self.paths)


def list_scenes(given: Sequence[str], assets: Sequence[str] = ()) -> list[ListedScene]:
    """List the scenes that arguments of a command stand for, in their order. Raises ReadError or InputError on failure.

    given : the arguments: GDAL names; products (a folder, an archive or a metadata file); patterns of local files with
        *, ? or [; a CSV file (.csv) whose column `path` has the file of a scene (several are separated by ";") and
        whose optional column `name` has the name of the scene; a STAC ItemCollection or Item (.json, .geojson, URL)
    assets : keys of the assets of a STAC Item that contain its bands, in this order. If empty, all assets with a single
        band of known wavelength are used, sorted by wavelength. If these are fewer than two, the only asset with
        several bands is used, else the only raster with the role "data", else the only raster
    """
    found = [scene for text in given for scene in _of_argument(text, assets)]
    if not found:
        raise InputError(f"no scene is named in {', '.join(given) or 'nothing'}. Name rasters, a CSV or a STAC file.")
    return found


def _of_argument(text: str, assets: Sequence[str]) -> Iterator[ListedScene]:
    ending = Path(text).suffix.lower()
    if products.name_of(text) is not None:
        yield ListedScene(_scene_name(text), (text,))
    elif _MAGIC.search(text) and not Path(text).exists():
        names = sorted(glob.glob(text, recursive=True))  # noqa: PTH207  (Path.glob knows no absolute patterns)
        if not names:
            raise ReadError(f"no file fits {text}. Check the pattern, and the directory that it starts from.")
        for name in names:
            yield ListedScene(_scene_name(name), (name,))
    elif ending == ".csv":
        yield from _of_csv(text)
    elif ending in (".json", ".geojson") or re.match(r"https?://.+/items/[^/]+$", text, re.IGNORECASE):
        for item in items_of(read_document(text), text):
            files = tuple(asset.path for asset in bands_of_item(item, text, assets))
            source = f"{text}#{item['id']}" + (f"#{','.join(assets)}" if assets else "")
            yield ListedScene(checked_name(item["id"], text), files, source)
    else:
        yield ListedScene(_scene_name(text), (text,))


def _scene_name(path: str) -> str:
    """Name of a scene: the name of its product, else the name of its file without folder and extension."""
    last = re.split(r"[/\\:]", path.rstrip("/"))[-1]
    return checked_name(products.name_of(path) or Path(last).stem or last, path)


def checked_name(name: str, origin: str) -> str:
    """Return a scene's name if it can be in a file name; else raise InputError, which states the name's `origin`."""
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
            yield ListedScene(checked_name(name, path) if name else _scene_name(files[0]), files)
    except csv.Error as error:
        raise InputError(f"{path}, line {rows.line_num}: not CSV: {error}.") from error
