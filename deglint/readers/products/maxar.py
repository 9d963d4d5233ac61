"""WorldView-2, -3 and -4, GeoEye-1 and QuickBird: metadata in .IMD or .XML; the image is one file, or tiles (.TIL).

Several tiles are opened as one image by GDAL's TIL driver, a single image directly. To convert file values of a band to
radiance, they are multiplied by absCalFactor / effectiveBandwidth, both from the metadata.
"""

import re
from dataclasses import replace
from pathlib import PurePosixPath
from xml.etree import ElementTree as ET

from ... import sensors
from ...errors import InputError
from ..text import positive
from .metadata import PRODUCT_UNIT, Container, MetadataError, Product, ProductBand, last, said, tags_of

METADATA = r".+\.(?:IMD|TIL)|\d\d[A-Z]{3}\d{8}-.+\.XML"
IMAGES = r"\d\d[A-Z]{3}\d{8}[-_].+\.(?:tiff?|ntf)"
_SATELLITES = {
    "WV02": ("WorldView-2", "worldview2"),
    "WV03": ("WorldView-3", "worldview3"),
    "WV04": ("WorldView-4", ""),
    "GE01": ("GeoEye-1", "geoeye1"),
    "QB02": ("QuickBird", "quickbird"),
}
"""Title and sensor preset ("": none) of the satellites, by their code in the metadata."""
_NOT_ENHANCED = ("", "OFF", "NONE")


def find(container: Container) -> Product | None:
    """The multispectral product in `container`, or None; if the user named a file in it, the product of this file."""
    named = container.named
    stems = {_without_ending(n) for n in container.find(METADATA)}
    if named is not None:
        stems &= {_without_ending(named)}
    found = []
    for stem in sorted(stems):
        beside = (container.beside(stem, last(stem) + ending) for ending in (".imd", ".xml"))
        member, image = next(filter(None, beside), None), _image(container, stem)
        if member and image:
            root = container.tree(member)
            root = next(root.iter("IMD"), root)
            if not _letters(root):
                raise MetadataError(member, "it has no group BAND_")
            if len(_letters(root)) > 1 or named:
                found.append((stem, image, root))
    if not found:
        return None
    names = (container.gdal(stem) for stem, *_ in found)
    return _product(container, *container.only(found, "multispectral images", names, "Name the .IMD file of one."))


def _product(container: Container, stem: str, image: str, root: ET.Element) -> Product:
    """Make the product of the file `image` with the metadata `root`; `stem` is the metadata file without extension."""
    notes = []
    satellite, enhanced = said(root, ".//SATID"), said(root, ".//RADIOMETRICENHANCEMENT").upper()
    title, preset_name = _SATELLITES.get(satellite, (satellite, ""))
    preset = sensors.find(preset_name)
    plain = enhanced in _NOT_ENHANCED
    if not plain:
        notes.append(f"the image is enhanced ({enhanced}): file values are used without scaling, not as radiance")
    bands, known = [], [*(preset.bands if preset else ()), *sensors.load("worldview3").bands]
    for letter in _letters(root):
        named = (b.name for b in known if b.answers_to(f"BAND_{letter}"))
        factor, width = (positive(said(root, f"BAND_{letter}/{k}")) for k in ("ABSCALFACTOR", "EFFECTIVEBANDWIDTH"))
        band = ProductBand(container.gdal(image), next(named, "PAN" if letter == "P" else letter), nodata=0.0)
        bands.append(replace(band, scale=factor / width, unit=PRODUCT_UNIT) if plain and factor and width else band)
    if plain and any(b.unit is None for b in bands):
        notes.append(f"{stem}: absCalFactor or effectiveBandwidth is missing: file values are used without scaling")
    facts = {
        "acquired": ("FIRSTLINETIME", "TLCTIME"),
        "sun_azimuth": ("MEANSUNAZ",),
        "sun_elevation": ("MEANSUNEL",),
        "view_azimuth": ("MEANSATAZ",),
        "view_elevation": ("MEANSATEL",),
        "off_nadir_angle": ("MEANOFFNADIRVIEWANGLE",),
    }
    tags = tags_of({"satellite": title} | {k: said(root, *(f".//{n}" for n in names)) for k, names in facts.items()})
    kind = f"{title if satellite in _SATELLITES else 'Maxar'} {said(root, './/PRODUCTLEVEL')}".strip()
    return Product(kind, last(stem), tuple(bands), preset.name if preset else None, tags, tuple(notes))


def _letters(root: ET.Element) -> list[str]:
    """Letters that denote the bands in the metadata ("B", "N2"), in the order of the image."""
    return [n.tag.removeprefix("BAND_") for n in root if n.tag.startswith("BAND_")]


def _without_ending(member: str) -> str:
    return str(PurePosixPath(member).with_suffix(""))


def _image(container: Container, stem: str) -> str | None:
    """The file to open for `stem` (a path without extension): the .TIL file, or its tile if there is only one.

    Without a .TIL file, the image is returned, or None. Raises InputError if a tile does not lie beside the .TIL file.
    """
    til = container.beside(stem, f"{last(stem)}.til")
    if til is not None:
        names = [said(n, ".") for n in container.tree(til).iter("FILENAME")]
        tiles = [container.beside(til, n) if re.fullmatch(r"[\w. +-]+", n) else None for n in names]
        if None in tiles or not tiles:
            raise InputError(f"{til}: some tiles that it lists are not in its folder. Name one tile, or add the rest.")
        return til if len(tiles) > 1 else tiles[0]
    fits = re.compile(re.escape(stem) + r"\.(?:tiff?|ntf)", re.IGNORECASE)
    return next((n for n in container.names if fits.fullmatch(n)), None)
