"""Recognise products of satellites and drones: a folder, an archive, a metadata file, or an image that belongs to one.

`PRODUCTS` is the table of families of products. A new family needs a module with METADATA, IMAGES and find, and a line
in the table. Only local files are recognised; other GDAL names (/vsis3/, https://) are opened as rasters.
"""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from types import ModuleType

from ...errors import DeglintError, ReadError
from ...raster import RasterInfo, RasterSource
from ..grid import footprints_on
from . import dimap, drone, landsat, maxar, planetscope, sentinel2
from .metadata import ARCHIVE, Container, MetadataError, Product, described, open_archive, open_folder

PRODUCTS: dict[str, ModuleType] = {
    "Sentinel-2 L1C and L2A": sentinel2,
    "Landsat 8 and 9 Collection 2": landsat,
    "PlanetScope": planetscope,
    "Pleiades and SPOT 6/7": dimap,
    "WorldView and GeoEye": maxar,
    "MicaSense and DJI captures": drone,
}
"""Module of each family of products, in the order in which they are tried. In a module, METADATA is the regular
expression for names of metadata files, and IMAGES that for names of images that may have metadata nearby: beside them,
or up to FOLDERS_ABOVE folders above. With NAMED_IN_IMAGES, names of images tell the product without metadata."""


@dataclass(frozen=True)
class OpenedFiles:
    """Files that a name stands for: descriptions of the rasters, the product with these files (or None), and notes."""

    infos: list[RasterInfo]
    product: Product | None
    notes: list[str]


def opened(path: str, describe: Callable[[str], RasterInfo]) -> OpenedFiles:
    """Describe the files of product `path`. If it is no product, call `describe` and add the file's XMP metadata."""
    product = find(path)
    if product is not None:
        infos, notes = described(product)
        return OpenedFiles(infos, product, notes)
    try:
        info, notes = drone.with_xmp(describe(path))
    except ReadError as error:
        if not _may_be_product(_local(path)):
            raise
        raise ReadError(
            f"{path} is not a raster that GDAL can read, and not a complete product that deglint knows "
            f"({', '.join(PRODUCTS)}). Name the raster files in it."
        ) from error
    return OpenedFiles([info], None, notes)


def notes_of(found: Sequence[OpenedFiles]) -> list[str]:
    """Notes on opened files: one line with kind, name and bands of each product, then all other notes, once each."""
    products: dict[str, list[str]] = {}
    for product in (o.product for o in found if o.product is not None):
        products.setdefault(f"{product.kind}, product {product.name}", []).extend(b.name for b in product.bands)
    notes = [f"{product}: {', '.join(bands)}" for product, bands in products.items()]
    notes += [note for o in found for note in o.notes]
    if sum(o.product is None and drone.is_capture(o.infos[0]) for o in found) > 1:
        notes.append(drone.UNREGISTERED)
    return list(dict.fromkeys(notes))


def named(found: Sequence[OpenedFiles]) -> str | None:
    """Kind and name of the products among opened files, as one text for `Scene.product`; None without a product."""
    every = dict.fromkeys(f"{o.product.kind} {o.product.name}" for o in found if o.product is not None)
    return "; ".join(every) or None


def footprints(found: Sequence[OpenedFiles], grid: RasterInfo) -> RasterSource | None:
    """Source of detector numbers (see `footprints_on`) of all bands, on the grid `grid`; None if a band has none."""
    bands = [band for o in found for band in (o.product.bands if o.product else ())]
    paths = [band.footprint for band in bands if band.footprint]
    whole = len(paths) == sum(info.count for o in found for info in o.infos)
    return footprints_on(grid, paths) if whole and paths else None


def find(path: str) -> Product | None:
    """The product that the name `path` stands for, or None; only file names and metadata are read, no pixels."""
    place = _local(path)
    if place is None:
        return None
    folder = open_folder(place) if place.is_dir() else None
    if folder is None and ARCHIVE.search(place.name):
        return _first(open_archive(str(place)))
    place = place.absolute()
    for family in PRODUCTS.values():
        root = _root_of(family, place, folder)
        found = None if root is None else _of(family, open_folder(root, place.relative_to(root).as_posix()))
        if found is not None:
            return found
    return None if folder is None else _first(folder)


def name_of(path: str) -> str | None:
    """Name of the product if `path` is its folder, archive or metadata file; None for anything else."""
    try:
        product = find(path) if _may_be_product(_local(path)) else None
    except DeglintError:  # the error is raised when the product is opened
        return None
    return product.name if product else None


def files_of(path: str) -> tuple[str, ...]:
    """GDAL names of the rasters (images, detector numbers) and metadata of the product `path`; else only `path`."""
    product = find(path)
    if product is None:
        return (path,)
    footprints = (band.footprint for band in product.bands if band.footprint)
    return tuple(dict.fromkeys((*(band.path for band in product.bands), *footprints, *product.texts)))


def _local(path: str) -> Path | None:
    """The local file or folder that a GDAL name stands for; None if it does not exist or is not local."""
    if path.lower().endswith(".zip"):
        path = path.removeprefix("zip://").removeprefix("/vsizip/")
    return Path(path) if os.path.exists(path) else None  # noqa: PTH110  (Path raises where a name is too long)


def _may_be_product(place: Path | None) -> bool:
    """Whether a local path is a folder, an archive or a metadata file; False for None."""
    if place is None or place.is_dir() or ARCHIVE.search(place.name):
        return place is not None
    return any(re.fullmatch(f.METADATA, place.name, re.IGNORECASE) for f in PRODUCTS.values())


def _first(container: Container) -> Product | None:
    return next((p for family in PRODUCTS.values() if (p := _of(family, container)) is not None), None)


def _of(family: ModuleType, container: Container) -> Product | None:
    """The product of a family (a module of `PRODUCTS`) in a container, or None; `Product.texts` names all files read.

    If metadata are damaged, raises MetadataError; but returns None if the user named an image, which is still opened.
    """
    try:
        found = family.find(container)
    except MetadataError:
        if not re.fullmatch(family.IMAGES, PurePosixPath(container.named or "").name, re.IGNORECASE):
            raise
        return None
    read = tuple(container.gdal(member) for member in dict.fromkeys(container.was_read))
    return None if found is None else replace(found, texts=read)


def _root_of(family: ModuleType, place: Path, folder: Container | None) -> Path | None:
    """Folder of the product of `family` at `place` (see `PRODUCTS`), or None. `folder` has the files, if it is one."""
    wanted, above = re.compile(family.METADATA, re.IGNORECASE), getattr(family, "FOLDERS_ABOVE", 0)
    if folder is not None:
        part = bool(above and folder.find(family.IMAGES) and not folder.find(family.METADATA))
    elif wanted.fullmatch(place.name):
        return place.parent
    else:
        part = re.fullmatch(family.IMAGES, place.name, re.IGNORECASE) is not None
    near = list(place.parents)[: above + 1] if part else ()
    alone = place.parent if part and getattr(family, "NAMED_IN_IMAGES", False) else None
    return next((folder for folder in near if any(map(wanted.fullmatch, os.listdir(folder)))), alone)  # noqa: PTH208
