"""Products that are recognised: a folder, an archive, a metadata file, or an image with its metadata nearby.

`PRODUCTS` is the table of families: a new one needs a module with METADATA, IMAGES and find, and a line here. Only
local files are searched; other GDAL names (/vsis3/, https://) are opened as rasters.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...errors import DeglintError, ReadError
from ...raster import RasterInfo
from ..grid import Footprints
from . import dimap, drone, landsat, maxar, planetscope, sentinel2
from .container import Container, is_archive, open_archive, open_folder
from .product import Product, described

_is_dir, _is_file = os.path.isdir, os.path.isfile  # False where a name is too long, where Path raises


@dataclass(frozen=True)
class Family:
    """A family of products; `metadata` and `images` are regular expressions of file names."""

    title: str
    metadata: str
    images: str  # those that may have metadata near
    find: Callable[[Container], Product | None]
    above: int = 0  # how many folders above an image its metadata may lie


PRODUCTS: dict[str, Family] = {
    "sentinel2": Family("Sentinel-2 L1C and L2A", sentinel2.METADATA, sentinel2.IMAGES, sentinel2.find, above=4),
    "landsat": Family("Landsat 8 and 9 Collection 2", landsat.METADATA, landsat.IMAGES, landsat.find),
    "planetscope": Family("PlanetScope", planetscope.METADATA, planetscope.IMAGES, planetscope.find),
    "dimap": Family("Pleiades and SPOT 6/7", dimap.METADATA, dimap.IMAGES, dimap.find),
    "maxar": Family("WorldView and GeoEye", maxar.METADATA, maxar.IMAGES, maxar.find),
    "drone": Family("MicaSense and DJI captures", drone.METADATA, drone.IMAGES, drone.find),
}
"""Families of products, in the order in which they are tried."""


@dataclass(frozen=True)
class OpenedFiles:
    """The files behind a name: described rasters, and their product if any."""

    infos: list[RasterInfo]
    product: Product | None
    notes: list[str]


def opened(path: str, describe: Callable[[str], RasterInfo]) -> OpenedFiles:
    """Describe the files behind a name: those of a product, else a raster by `describe`."""
    product = find(path)
    if product is not None:
        infos, notes = described(product)
        return OpenedFiles(infos, product, notes)
    try:
        info, notes = drone.with_xmp(describe(path))
    except ReadError as error:
        if not _may_be_product(_local(path)):
            raise
        known = ", ".join(f.title for f in PRODUCTS.values())
        raise ReadError(
            f"{path} is not a raster GDAL can read, and holds no product that is known with its images ({known}). Name "
            "the raster files in it."
        ) from error
    return OpenedFiles([info], None, notes)


def notes_of(found: Sequence[OpenedFiles]) -> list[str]:
    """Notes on opened files: kind, name and bands of each product, then further notes without repetition."""
    products: dict[tuple[str, str], list[str]] = {}
    for product in (o.product for o in found):
        if product is not None:
            products.setdefault((product.kind, product.name), []).extend(b.name for b in product.bands)
    notes = [f"{kind}, product {name}: {', '.join(bands)}" for (kind, name), bands in products.items()]
    notes += [note for o in found for note in o.notes]
    captures = [o for o in found if o.product is None and drone.is_capture(o.infos[0])]
    if len(captures) > 1:
        notes.append(drone.UNREGISTERED)
    return list(dict.fromkeys(notes))


def named(found: Sequence[OpenedFiles]) -> str | None:
    """Kind and name of the opened products, or None."""
    every = dict.fromkeys(f"{o.product.kind} {o.product.name}" for o in found if o.product is not None)
    return "; ".join(every) or None


def footprints(found: Sequence[OpenedFiles], grid: RasterInfo) -> Footprints | None:
    """Detector numbers of the opened bands on the grid of their scene; None if no band has any."""
    paths: list[str | None] = []
    for o in found:
        stated = [()] * len(o.infos) if o.product is None else o.product.files.values()
        for info, bands in zip(o.infos, stated, strict=True):
            paths += [bands[i].footprint if i < len(bands) else None for i in range(info.count)]
    absolute = tuple(p if p is None or p.startswith("/vsi") else str(Path(p).absolute()) for p in paths)
    return Footprints(absolute, grid) if any(paths) else None


def find(path: str) -> Product | None:
    """The product behind a name, or None; metadata and file names are read, no pixels."""
    local = _local(path)
    if local is None or not (_is_dir(local) or _is_file(local)):
        return None
    if not _is_dir(local) and is_archive(local):
        return _first(open_archive(local))
    place = Path(local)
    folder = open_folder(place) if _is_dir(local) else None
    place = place.absolute()
    for family in PRODUCTS.values():
        root = _root_of(family, place, folder)
        found = None if root is None else _of(family, open_folder(root, place.relative_to(root).as_posix()))
        if found is not None:
            return found
    return None if folder is None else _first(folder)


def name_of(path: str) -> str | None:
    """Name of the product in a folder, an archive or of a metadata file; None for anything else."""
    try:
        product = find(path) if _may_be_product(_local(path)) else None
    except DeglintError:  # said where it is opened
        return None
    return product.name if product else None


def files_of(path: str) -> tuple[str, ...]:
    """GDAL names of the files behind a name: images, footprints and metadata of a product, else the name itself."""
    try:
        product = find(path)
    except DeglintError:
        product = None
    if product is None:
        return (path,)
    footprints = (band.footprint for band in product.bands if band.footprint)
    return tuple(dict.fromkeys((*product.files, *footprints, *product.texts)))


def _local(path: str) -> str | None:
    """A local path; None for other GDAL names."""
    if path.startswith("zip://") and "!" not in path:
        path = path[6:]
    elif path.lower().startswith("/vsizip/") and path.lower().endswith(".zip"):
        path = path[8:]
    if re.match(r"/vsi|[A-Za-z][\w+.-]+:", path) or "\0" in path:
        return None
    return path


def _may_be_product(path: str | None) -> bool:
    """Whether a local path is a folder, an archive or a metadata file."""
    if path is None or _is_dir(path) or is_archive(path):
        return path is not None
    return any(re.fullmatch(f.metadata, Path(path).name, re.IGNORECASE) for f in PRODUCTS.values())


def _first(container: Container) -> Product | None:
    return next((p for family in PRODUCTS.values() if (p := _of(family, container)) is not None), None)


def _of(family: Family, container: Container) -> Product | None:
    """The product of a family in a container, with the names of the metadata files that were read."""
    found = family.find(container)
    read = tuple(container.gdal(member) for member in dict.fromkeys(container.was_read))
    return None if found is None else replace(found, texts=read)


def _root_of(family: Family, place: Path, folder: Container | None) -> Path | None:
    """The folder with the metadata of the product that contains a file, or a folder of images."""
    wanted = re.compile(family.metadata, re.IGNORECASE)
    if folder is not None:
        part = bool(family.above and folder.find(family.images) and not folder.find(family.metadata))
    elif wanted.fullmatch(place.name):
        return place.parent
    else:
        part = re.fullmatch(family.images, place.name, re.IGNORECASE) is not None
    for above in list(place.parents)[: family.above + 1] if part else ():
        if any(map(wanted.fullmatch, os.listdir(above))):  # noqa: PTH208  (faster where a folder is large)
            return above
    return None
