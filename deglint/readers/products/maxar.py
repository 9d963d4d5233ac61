"""WorldView-2, WorldView-3, GeoEye-1 and QuickBird: an .IMD file (or the equivalent XML), a .TIL mosaic, an image.

A mosaic of several tiles is opened by GDAL's TIL driver, a single image directly. The factors to radiance are those of
the IMD file: absCalFactor over effectiveBandwidth of each band.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import PurePosixPath
from xml.etree import ElementTree as ET

from ... import sensors
from ...errors import InputError
from .container import Container, last
from .metadata import MetadataError, groups_of, positive, tags_of, text_of, xml_of
from .product import Product, ProductBand

METADATA = r".+\.(?:IMD|TIL)|\d\d[A-Z]{3}\d{8}-.+\.XML"
IMAGES = r"\d\d[A-Z]{3}\d{8}[-_].+\.(?:tiff?|ntf)"
_SATELLITES = {
    "WV02": ("WorldView-2", "worldview2"),
    "WV03": ("WorldView-3", "worldview3"),
    "WV04": ("WorldView-4", ""),
    "GE01": ("GeoEye-1", "geoeye1"),
    "QB02": ("QuickBird", "quickbird"),
}
"""Title and preset of the satellites by their code in the metadata."""
_MAXAR_NAMES = {"C": "COASTAL", "B": "BLUE", "G": "GREEN", "Y": "YELLOW", "R": "RED", "RE": "REDEDGE", "N": "NIR1",
          "N2": "NIR2", "P": "PAN"}  # fmt: skip
_NOT_ENHANCED = ("", "OFF", "NONE")
UNIT = "W m-2 sr-1 um-1"

Groups = Mapping[str, Mapping[str, str]]


def find(container: Container) -> Product | None:
    """The multispectral product in a folder or archive, or the selected one; None if there is none."""
    named = container.named
    stems = {_stem(n) for n in container.find(METADATA)}
    if named is not None:
        stems &= {_stem(named)}
    found = []
    for stem in sorted(stems):
        groups, notes = _groups(container, stem)
        letters = _letters(groups)
        image = _image(container, stem)
        if image and (len(letters) > 1 or (letters and named)):
            found.append((stem, image, groups, notes))
        elif image and notes and named and named != image:
            raise InputError(f"{notes[0]}. Download it again, or name the image itself: {container.gdal(image)}")
    if len(found) > 1:
        names = (container.gdal(stem) for stem, *_ in found)
        raise container.several("multispectral images", names, "Name the .IMD file of one.")
    return _product(container, *found[0]) if found else None


def _product(container: Container, stem: str, image: str, groups: Groups, notes: list[str]) -> Product:
    """The product of an image, from the groups of its metadata."""
    letters = _letters(groups)
    every = {k: v for g in groups.values() for k, v in g.items()}
    satellite, enhanced = every.get("SATID", ""), every.get("RADIOMETRICENHANCEMENT", "").upper()
    title, preset_name = _SATELLITES.get(satellite, (satellite, ""))
    preset = sensors.find(preset_name)
    plain = enhanced in _NOT_ENHANCED
    if not plain:
        notes.append(f"the image is enhanced ({enhanced}): its numbers are no radiance, and are taken as they stand")
    bands = []
    for i, letter in enumerate(letters, start=1):
        own = next((b for b in preset.bands if b.answers_to(f"BAND_{letter}")), None) if preset else None
        values = groups[f"BAND_{letter}"]
        factor, width = positive(values.get("ABSCALFACTOR")), positive(values.get("EFFECTIVEBANDWIDTH"))
        band = ProductBand(container.gdal(image), own.name if own else _MAXAR_NAMES.get(letter, letter), i, nodata=0.0)
        bands.append(replace(band, scale=factor / width, unit=UNIT) if plain and factor and width else band)
    if plain and any(b.unit is None for b in bands):
        notes.append(f"{stem}: absCalFactor or effectiveBandwidth is missing: the numbers are taken as they stand")
    tags = tags_of({
        "satellite": title, "acquired": every.get("FIRSTLINETIME") or every.get("TLCTIME"),
        "sun_azimuth": every.get("MEANSUNAZ"), "sun_elevation": every.get("MEANSUNEL"),
        "view_azimuth": every.get("MEANSATAZ"), "view_elevation": every.get("MEANSATEL"),
        "off_nadir_angle": every.get("MEANOFFNADIRVIEWANGLE"),
    })  # fmt: skip
    known = title if satellite in _SATELLITES else "Maxar"
    kind = f"{known} {every.get('PRODUCTLEVEL', '')}".strip()
    return Product(kind, last(stem), container.asked, tuple(bands), preset.name if preset else None, tags, tuple(notes))


def _letters(groups: Groups) -> list[str]:
    """Letters of the bands, in the order of the image."""
    return [g.removeprefix("BAND_") for g in groups if g.startswith("BAND_")]


def _stem(member: str) -> str:
    return str(PurePosixPath(member).with_suffix(""))


def _groups(container: Container, stem: str) -> tuple[Groups, list[str]]:
    """Groups of the IMD file, else of the XML file; if neither can be read, notes on that."""
    notes = []
    for ending in (".imd", ".xml"):
        member = next((n for n in container.names if n.casefold() == f"{stem}{ending}".casefold()), None)
        if member is None:
            continue
        try:
            data = container.read(member)
            groups = _of_imd(data, member) if ending == ".imd" else _of_xml(data, member)
            if _letters(groups):
                return groups, []
            notes.append(f"{member} is damaged: it has no group BAND_")
        except MetadataError as error:
            notes.append(str(error))
    return {}, notes


def _of_imd(data: bytes, member: str) -> Groups:
    """The groups of an IMD file, with names in upper case as in the XML file."""
    found = groups_of(text_of(data, member))
    return {group: {k.upper(): v for k, v in values.items()} for group, values in found.items()}


def _of_xml(data: bytes, member: str) -> Groups:
    """The groups of an XML file, from the element IMD."""
    own: Iterable[ET.Element] = next(xml_of(data, member).iter("IMD"), ())
    single = {node.tag: (node.text or "").strip() for node in own if not len(node)}
    return {"": single} | {node.tag: {v.tag: (v.text or "").strip() for v in node} for node in own if len(node)}


def _image(container: Container, stem: str) -> str | None:
    """The mosaic of several tiles, else the image of that name; tiles are beside it."""
    til = next((n for n in container.names if n.casefold() == f"{stem}.til".casefold()), None)
    if til is not None:
        groups = groups_of(text_of(container.read(til), til))
        names = [v["filename"] for v in groups.values() if "filename" in v]
        tiles = [container.beside(til, n) if re.fullmatch(r"[\w. +-]+", n) else None for n in names]
        if None in tiles or not tiles:
            raise InputError(f"{til}: not every tile that it names lies beside it. Name one image, or get them all.")
        return til if len(tiles) > 1 else tiles[0]
    fits = re.compile(re.escape(stem) + r"\.(?:tiff?|ntf)", re.IGNORECASE)
    return next((n for n in container.names if fits.fullmatch(n)), None)
