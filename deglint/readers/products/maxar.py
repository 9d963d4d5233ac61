"""WorldView-2, WorldView-3, GeoEye-1 and QuickBird: an .IMD file (or the XML that repeats it), a .TIL mosaic, an image.

A mosaic of several tiles is opened by GDAL's TIL driver; a single image is opened itself. The factors to radiance are
those of the IMD file: absCalFactor over effectiveBandwidth, band by band.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import PurePosixPath

from ... import sensors
from ...errors import InputError
from .container import Container
from .metadata import MetadataError, groups_of, positive, tags_of, text_of, xml_of
from .product import Product, ProductBand

METADATA = r".+\.(?:IMD|TIL)|\d\d[A-Z]{3}\d{8}-.+\.XML"
IMAGES = r"\d\d[A-Z]{3}\d{8}[-_].+\.(?:tiff?|ntf)"
_SENSORS = {"WV02": "worldview2", "WV03": "worldview3", "GE01": "geoeye1", "QB02": "quickbird"}
_MAXAR_NAMES = {"C": "COASTAL", "B": "BLUE", "G": "GREEN", "Y": "YELLOW", "R": "RED", "RE": "REDEDGE", "N": "NIR1",
          "N2": "NIR2", "P": "PAN"}  # fmt: skip
_TITLES = {"WV02": "WorldView-2", "WV03": "WorldView-3", "WV04": "WorldView-4", "GE01": "GeoEye-1", "QB02": "QuickBird"}
_NO_PANSHARPENING = ("", "OFF", "NONE")
UNIT = "W m-2 sr-1 um-1"

Groups = Mapping[str, Mapping[str, str]]


def find(container: Container) -> Product | None:
    """The multispectral product in a folder or archive, or the one that was named; None where there is none."""
    named = container.named
    stems = {_stem(n) for n in container.find(METADATA)}
    if named is not None:
        stems &= {_stem(named)}
    found = []
    for stem in sorted(stems):
        groups, notes = _groups(container, stem)
        letters = [g.removeprefix("BAND_") for g in groups if g.startswith("BAND_")]
        image = _image(container, stem)
        if image and (len(letters) > 1 or (letters and named)):
            found.append((stem, image, letters, groups, notes))
        elif image and notes and named and named != image:
            raise InputError(f"{notes[0]}. Download it again, or name the image itself: {container.gdal(image)}")
    if len(found) > 1:
        names = ", ".join(container.gdal(stem) for stem, *_ in found[:4])
        raise InputError(
            f"{container.path} holds {len(found)} multispectral images. Name the .IMD file of one: {names}"
        )
    if not found:
        return None
    stem, image, letters, groups, notes = found[0]
    return _product(container, stem, image, letters, groups, notes)


def _product(
    container: Container, stem: str, image: str, letters: list[str], groups: Groups, notes: list[str]
) -> Product:
    every = {k: v for g in groups.values() for k, v in g.items()}
    satellite = every.get("satId", "")
    preset = sensors.find(_SENSORS.get(satellite, ""))
    enhanced = every.get("radiometricEnhancement", "").upper()
    if enhanced not in _NO_PANSHARPENING:
        notes.append(f"the image is enhanced ({enhanced}): its numbers are no radiance, and are taken as they stand")
    bands = []
    for i, letter in enumerate(letters, start=1):
        own = next((b for b in preset.bands if b.answers_to(f"BAND_{letter}")), None) if preset else None
        values = groups[f"BAND_{letter}"]
        factor, width = positive(values.get("absCalFactor")), positive(values.get("effectiveBandwidth"))
        known = factor is not None and width is not None and enhanced in _NO_PANSHARPENING
        scale = factor / width if known and factor and width else 1.0
        name = own.name if own else _MAXAR_NAMES.get(letter, letter)
        bands.append(ProductBand(container.gdal(image), name, i, scale=scale, unit=UNIT if known else None, nodata=0.0))
    if any(b.unit is None for b in bands) and enhanced in _NO_PANSHARPENING:
        notes.append(f"{stem}: absCalFactor or effectiveBandwidth is missing: the numbers are taken as they stand")
    tags = tags_of({
        "satellite": _TITLES.get(satellite, satellite), "acquired": every.get("firstLineTime") or every.get("TLCTime"),
        "sun_azimuth": every.get("meanSunAz"), "sun_elevation": every.get("meanSunEl"),
        "view_azimuth": every.get("meanSatAz"), "view_elevation": every.get("meanSatEl"),
        "off_nadir_angle": every.get("meanOffNadirViewAngle"),
    })  # fmt: skip
    name = PurePosixPath(stem).name
    kind = f"{_TITLES.get(satellite, 'Maxar')} {every.get('productLevel', '')}".strip()
    return Product(kind, name, container.asked, tuple(bands), preset.name if preset else None, tags, tuple(notes))


def _stem(member: str) -> str:
    return str(PurePosixPath(member).with_suffix(""))


def _groups(container: Container, stem: str) -> tuple[Groups, list[str]]:
    """Groups of the IMD file, else those of the XML file; where neither can be read, what to say."""
    notes = []
    for ending in (".imd", ".xml"):
        member = next((n for n in container.names if n.casefold() == f"{stem}{ending}".casefold()), None)
        if member is None:
            continue
        try:
            data = container.read(member)
            groups = groups_of(text_of(data, member)) if ending == ".imd" else _of_xml(data, member)
            if any(g.startswith("BAND_") for g in groups):
                return groups, []
            notes.append(f"{member} is damaged: it has no group BAND_")
        except MetadataError as error:
            notes.append(str(error))
    return {}, notes


_SPELLED = ("absCalFactor", "effectiveBandwidth", "satId", "firstLineTime", "TLCTime", "meanSunAz", "meanSunEl",
            "meanSatAz", "meanSatEl", "meanOffNadirViewAngle", "productLevel", "radiometricEnhancement")  # fmt: skip


def _of_xml(data: bytes, member: str) -> Groups:
    """The same from the element IMD, whose names are in capitals."""
    root = xml_of(data, member)
    own = next(root.iter("IMD"), None)
    spelled = {s.upper(): s for s in _SPELLED}
    found: dict[str, dict[str, str]] = {"": {}}
    for group in own if own is not None else ():
        values = {spelled[v.tag]: (v.text or "").strip() for v in group if v.tag in spelled}
        if len(group):
            found[group.tag.replace("IMAGE", "IMAGE_1")] = values
        elif group.tag in spelled:
            found[""][spelled[group.tag]] = (group.text or "").strip()
    return found


def _image(container: Container, stem: str) -> str | None:
    """The mosaic of several tiles, else the one image of that name; tiles lie beside it."""
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
