"""Metadata of image products: read them from a folder, zip or tar, parse them, and add them to descriptions of rasters.

XML, JSON and lines "NAME = value" in groups are parsed into the same type of tree. A `Product` has plain values from
this tree. `described` reads the headers of the product's files and adds band names, scale, offset, nodata, unit and
tags to the descriptions of the files. Then products are processed like other files, and outputs have these metadata.
"""

import json
import math
import os
import re
import tarfile
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, islice
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree as ET

import numpy as np

from ...checks import T
from ...errors import InputError, ReadError
from ...physics import EARTH_RADIUS
from ...raster import FlatField, RasterInfo
from ...raster.info import describe_file
from ..spectral import with_spectral
from ..text import number

MOST_MEMBERS = 20_000  # most files of a folder that are listed: a folder that is no product may be large
PRODUCT_UNIT = "W m-2 sr-1 um-1"  # of radiance in the products of satellites
FULL = 65535.0  # saturated file value of Sentinel-2 and Landsat if the metadata do not give it
_DAMAGED = (OSError, ValueError, RuntimeError, KeyError, EOFError, zipfile.BadZipFile, tarfile.TarError)
ARCHIVE = re.compile(r"\.(?:zip|tar)$", re.IGNORECASE)


class MetadataError(InputError):
    """The metadata of an image product are damaged, or have the wrong format."""

    def __init__(self, name: str, why: object) -> None:
        super().__init__(f"{name} is damaged: {why}. Download it again, or name the image itself.")


@dataclass(frozen=True)
class Container:
    """A folder or archive, and the names of the files in it (its members)."""

    path: str
    kind: str  # "folder", "zip" or "tar"
    names: tuple[str, ...]  # sorted paths of the members inside it, with "/" between folders
    named: str | None = None  # the member (a file or a folder) that the user named; None: the whole container
    was_read: list[str] = field(default_factory=list, compare=False, repr=False)  # members that were read

    @property
    def name(self) -> str:
        """Name of the folder or archive, without its path and without .zip or .tar."""
        return ARCHIVE.sub("", Path(self.path).absolute().name)

    def gdal(self, member: str) -> str:
        """GDAL name with which a member can be opened."""
        if self.kind == "folder":
            return str(Path(self.path) / member)
        return f"/vsi{self.kind}/{Path(self.path).absolute()}/{PurePosixPath(member)}"  # without "./" in front

    def matches(self, pattern: str) -> list[tuple[str, re.Match[str]]]:
        """Members whose file name matches a regular expression, and the matches; case is ignored."""
        return [(n, match) for n in self.names if (match := re.fullmatch(pattern, last(n), re.IGNORECASE))]

    def find(self, pattern: str) -> list[str]:
        """Members whose file name matches a regular expression; case is ignored."""
        return [member for member, _ in self.matches(pattern)]

    def only(self, found: Sequence[T], what: str, names: Iterable[str], remedy: str = "Name one.") -> T:
        """The only item of `found`. If it has more, InputError says `what` they are, their `names` and a `remedy`."""
        if len(found) > 1:
            raise InputError(f"{self.path} holds {len(found)} {what}: {', '.join(islice(names, 4))}. {remedy}")
        return found[0]

    def beside(self, member: str, name: str) -> str | None:
        """The member called `name` in the folder of `member`, or None; case is ignored."""
        wanted = (PurePosixPath(member).parent / name).as_posix().casefold()
        return next((n for n in self.names if str(PurePosixPath(n)).casefold() == wanted), None)

    def read(self, member: str) -> bytes:
        """Content of a small member. Raises ReadError if it cannot be read."""
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

    def tree(self, member: str, needs: str = "") -> ET.Element:
        """Metadata in a member as a tree, from XML, JSON objects, or groups of lines "NAME = value" (MTL, IMD, TIL).

        Raises ReadError if the member cannot be read, MetadataError if it is damaged or has no element `needs`.
        """
        data, ending = self.read(member), member.lower()
        if ending.endswith(".xml"):
            root = xml_of(data, member)
        elif ending.endswith(".json"):
            try:
                root = _element("", json.loads(data))
            except (ValueError, RecursionError) as error:
                raise MetadataError(member, "it is not JSON") from error
        else:
            root = _element("", groups_of(data.decode("utf-8-sig", errors="replace")))
        if needs and root.find(f".//{needs}") is None:
            raise MetadataError(member, f"it has no {needs}")
        return root


def last(member: str) -> str:
    """File name of a member (a path in a `Container`), without folders."""
    return PurePosixPath(member).name


def open_folder(path: Path, named: str | None = None) -> Container:
    """List files in a folder and its subfolders (no hidden files or links to folders); `named` is as in `Container`."""
    files = (Path(folder) / name for folder, _, names in os.walk(path) for name in names if not name.startswith("."))
    members = (file.relative_to(path).as_posix() for file in islice(files, MOST_MEMBERS))
    return Container(str(path), "folder", tuple(sorted(members)), named)


def open_archive(path: str) -> Container:
    """List the files in a .zip or .tar. Raises ReadError if it is damaged."""
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


def xml_of(data: bytes, name: str) -> ET.Element:
    """Parse an XML file called `name`; return its root without namespaces. Raises MetadataError if it is damaged."""
    try:
        root = ET.fromstring(data)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise MetadataError(name, error) from error
    for node in root.iter():
        node.tag = node.tag.rpartition("}")[2]
    return root


def _element(tag: str, value: object) -> ET.Element:
    """Make an element `tag` with `value` as text, or with one child per entry of a JSON object; lists are left out."""
    node = ET.Element(tag)
    if isinstance(value, Mapping):
        node.extend(_element(str(k), v) for k, v in value.items())
    elif isinstance(value, (str, int, float)):
        node.text = str(value)
    return node


def groups_of(text: str) -> dict[str, dict[str, str]]:
    """The values in a text of lines "NAME = value" with GROUP and END_GROUP lines (MTL, IMD, TIL), by group and name.

    Names are returned in capitals. Values outside groups are in the group "". Values over several lines are omitted.

    >>> groups_of('a = 1;\\nBEGIN_GROUP = BAND_R\\n\\tb = "x";\\nEND_GROUP = BAND_R')
    {'': {'A': '1'}, 'BAND_R': {'B': 'x'}}
    """
    found: dict[str, dict[str, str]] = {"": {}}
    inside = [""]
    for line in text.splitlines():
        name, sign, value = (part.strip() for part in line.partition("="))
        if not sign:
            continue
        value = value.rstrip(";").strip().strip('"')
        if name in ("GROUP", "BEGIN_GROUP"):
            inside.append(value)
        elif name == "END_GROUP":
            inside = inside[:-1] or [""]
        elif value != "(":
            found.setdefault(inside[-1], {})[name.upper()] = value
    return found


def said(node: ET.Element | None, *paths: str) -> str:
    """Text of the first non-empty element that is found at `paths` below a node; "" if there is none."""
    return next(filter(None, [] if node is None else [(node.findtext(path) or "").strip() for path in paths]), "")


def said_number(node: ET.Element | None, *paths: str) -> float | None:
    """The text that `said` returns, as a number; None if it is not a finite number."""
    return number(said(node, *paths))


def tags_of(facts: Mapping[str, object]) -> dict[str, str]:
    """Convert values to texts of at most 200 characters for tags; None and "" are left out."""
    return {k: str(v).strip()[:200] for k, v in facts.items() if v not in (None, "")}


ORBIT = 600_000.0
"""Altitude of a satellite if it is not known [m]. Imaging satellites fly at 450 to 800 km, which changes an incidence
angle of 20 degrees by at most 0.7 degrees."""
NADIR = 0.5  # incidence angle up to which a missing view azimuth is set to 0 [degree], as it has no effect


def view_tags(
    incidence: float | None, azimuth: float | None, off_nadir: float | None = None, altitude: float = ORBIT
) -> dict[str, float | None]:
    """Tags with the direction to the sensor, seen from the ground [degree]; its azimuth is clockwise from north.

    The elevation of the sensor is 90 - incidence. `off_nadir` is the angle from nadir, measured at the sensor, which is
    at `altitude` [m]. It replaces a missing incidence: sin(incidence) = (1 + altitude / Earth's radius) sin(off_nadir).
    """
    if incidence is None and off_nadir is not None:
        sine = (1.0 + altitude / EARTH_RADIUS) * math.sin(math.radians(abs(off_nadir)))
        incidence = math.degrees(math.asin(sine)) if sine <= 1.0 else None
    if incidence is not None and abs(incidence) <= NADIR and azimuth is None:
        azimuth = 0.0
    return {
        "view_elevation": None if incidence is None else round(90.0 - abs(incidence), 4),
        "view_azimuth": None if azimuth is None else round(azimuth, 4) % 360.0,
    }


@dataclass(frozen=True)
class ProductBand:
    """One band of a product (see `Product`); unknown values are None."""

    path: str  # GDAL name of its file
    name: str  # as the provider calls it ("B08")
    wavelength: float | None = None  # centre [nm]
    width: float | None = None  # full width at half maximum [nm]
    scale: float = 1.0  # physical value = file value * scale + offset
    offset: float = 0.0
    unit: str | None = None  # of the physical value
    nodata: float | None = None  # file value that means "not valid"
    saturation: float | None = None  # file value from which on the detector is saturated
    footprint: str | None = None  # GDAL name of a raster of detector numbers
    flat: FlatField | None = None  # correction of vignetting and row gradient, for a file with one band


@dataclass(frozen=True)
class Product:
    """A product of a satellite or drone camera, or a part of it, as its metadata describe it."""

    kind: str  # family and level, such as "Sentinel-2 L2A"
    name: str  # name that the provider gave the product, without a path
    bands: tuple[ProductBand, ...]  # bands of one file are adjacent, in its order
    sensor: str | None = None  # a name of a sensor preset
    tags: Mapping[str, str] = field(default_factory=dict)  # for the output: time of acquisition, angles
    notes: tuple[str, ...] = ()  # what was left out or could not be used, one line each
    texts: tuple[str, ...] = ()  # GDAL names of the metadata files that were read


def described(product: Product) -> tuple[list[RasterInfo], list[str]]:
    """Return descriptions of the files of a product, with its metadata added, and notes; no pixels are read."""
    infos = []
    notes = list(product.notes)
    for path, group in groupby(product.bands, key=lambda band: band.path):
        bands = tuple(group)
        info = describe_file(path)
        if info.alpha is not None and info.count + 1 == len(bands):
            info = describe_file(path, alpha_is_band=True)
        if info.count != len(bands) and len(bands) > 1:
            notes.append(f"{path} has {info.count} bands, the metadata {len(bands)}: the metadata are not used")
            infos.append(info)
            continue
        if own := scaled_by_itself(info):
            notes.append(f"{path}: {own}")
        infos.append(filled(info, bands, {**product.tags, "product": product.name}, product.sensor))
    return infos, notes


def scaled_by_itself(info: RasterInfo) -> str:
    """Why a file keeps its own scale, offset, unit, nodata and saturation; "" if those of the product are used."""
    if any(np.dtype(t).kind == "f" for t in info.dtypes):
        return "floating-point numbers are taken as they are, without the product's scale and offset"
    if any(s != 1 for s in info.scales) or any(o != 0 for o in info.offsets):
        return "its own scale and offset are used, not the product's"
    return ""


def filled(info: RasterInfo, bands: tuple[ProductBand, ...], tags: Mapping[str, str], sensor: str | None) -> RasterInfo:
    """A copy of a file's description with names, scale, offset, nodata, unit and tags of its product.

    Nodata and tags in the file are kept; if it is `scaled_by_itself`, also scale, offset, unit. `sensor` becomes a tag.
    """
    bands = bands[: info.count] + bands[-1:] * (info.count - len(bands))
    flat = bands[0].flat if info.count == 1 else None
    dataset_tags = ({"sensor": sensor} if sensor else {}) | dict(tags) | dict(info.tags.get("", {}))
    named = replace(info, descriptions=tuple(b.name for b in bands), tags={**info.tags, "": dataset_tags})
    named = with_spectral(named, [(b.wavelength, b.width) for b in bands])
    if scaled_by_itself(info):
        return named
    full = [{} if b.saturation is None else {"FULL_SCALE": f"{b.saturation:.10g}"} for b in bands]
    return replace(
        named,
        dtypes=info.dtypes if flat is None else ("float32",),
        flat=flat,
        units=tuple(b.unit or u for u, b in zip(info.units, bands, strict=True)),
        scales=tuple(b.scale for b in bands),
        offsets=tuple(b.offset for b in bands),
        nodatas=tuple(b.nodata if n is None else n for n, b in zip(info.nodatas, bands, strict=True)),
        band_tags=tuple({**t, "": {**t[""], **f}} for t, f in zip(named.band_tags, full, strict=True)),
    )
