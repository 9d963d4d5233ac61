"""Sentinel-2 L1C and L2A: a .SAFE folder or its zip, MTD_MSIL1C.xml or MTD_MSIL2A.xml, or files of single bands.

The image files are opened one by one, not through GDAL's SENTINEL2 driver: that driver opens each resolution as a
separate dataset, needs a complete product with the original file names, and does not apply the offsets.
"""

import cmath
import math
import re
from pathlib import PurePosixPath
from xml.etree import ElementTree as ET

from ... import sensors
from ..text import numbers, positive
from .metadata import FULL, Container, Product, ProductBand, last, said, said_number, tags_of, view_tags

METADATA = r"(?:.+[_.-])?MTD_MSIL(?:1C|2A)\.xml|S2[A-D]_(?:OPER|USER)_MTD_SAFL(?:1C|2A)_.*\.xml"
IMAGES = r"(?:.*_)?(?P<band>B0[1-9]|B1[0-2]|B8A)(?:_(?P<pixel>10|20|60)m)?\.(?:jp2|tiff?)"
FOLDERS_ABOVE = 4  # metadata lie in up to this number of folders above the image
_MASK = r"(?:.*_)?(?:MSK_)?DETFOO_(?:.*_)?(?P<band>B0[1-9]|B1[0-2]|B8A)(?:_MSIL1C)?\.(?:jp2|tiff?)"
_TILE = r"MTD_TL\.xml|S2[A-D]_(?:OPER|USER)_MTD_L(?:1C|2A)_TL_.*\.xml"
_BAND_CODES = ("B01", "B02", "B03", "B04", "B05", "B06", "B07", "B08", "B8A", "B09", "B10", "B11", "B12")
PIXELS = dict(zip(_BAND_CODES, (60, 10, 10, 10, 20, 20, 20, 10, 20, 60, 60, 20, 20), strict=True))
"""Pixel size of each band [m]."""
_QUANTUM = 10_000.0  # file value of reflectance 1 if the metadata do not give it
_AS_STORED = (
    "scale and offset are not known: file values are used without scaling. Give --scale and "
    "--offset, or download the metadata again"
)


def find(container: Container) -> Product | None:
    """The product in `container`, or None. If the user named an image or folder, the product has only its bands."""
    metadata = container.find(METADATA)
    images = _images(container)
    if container.named and last(container.named) in map(last, metadata):
        metadata = [container.named]
    if not images or not (metadata or any("IMG_DATA" in PurePosixPath(n).parts for n in images)):
        return None
    main = container.only(metadata or [""], "Sentinel-2 products", metadata)
    granules = sorted({_granule(n) for n in images} - {""})
    granule = container.only(granules or [""], "granules", map(container.gdal, granules), "Name the folder of one.")
    root = container.tree(main, "Product_Image_Characteristics") if main else None
    notes = [] if metadata else [f"{container.path} has no MTD_MSIL1C.xml or MTD_MSIL2A.xml: {_AS_STORED}"]
    single = container.named in images
    chosen, left = _chosen(images, single=single)
    if left:
        notes.append(f"{', '.join(left)} (pixels of 60 m) left out; name their files to open them")
    if root is not None:
        missing = [n for n, side in PIXELS.items() if side < 60 and n not in chosen]
        if missing and not single:
            notes.append(f"no files of {', '.join(missing)} in the product")
        notes.append("time offsets are those of odd-numbered detectors; in even ones the bands follow in reverse order")
    level = said(root, ".//PROCESSING_LEVEL").replace("Level-", "").removesuffix("p")
    level = level or ("2A" if any("_L2A" in n or "MSIL2A" in n for n in (container.path, *images)) else "1C")
    safe = next((p for n in container.names for p in PurePosixPath(n).parts if p.endswith(".SAFE")), container.name)
    name = said(root, ".//PRODUCT_URI", ".//PRODUCT_URI_2A") or safe
    facts = {
        "satellite": said(root, ".//SPACECRAFT_NAME"),
        "acquired": said(root, ".//PRODUCT_START_TIME"),
        "processing_baseline": said(root, ".//PROCESSING_BASELINE"),
    }
    tags = tags_of(facts) | _angles(container, granule)
    bands = tuple(_bands(container, root, chosen))
    return Product(f"Sentinel-2 L{level}", name.removesuffix(".SAFE"), bands, "sentinel2", tags, tuple(notes))


def _images(container: Container) -> dict[str, re.Match[str]]:
    """Image files of bands, with their matches of `IMAGES`: all, or only the image or folder that the user named."""
    masks, named = set(container.find(_MASK)), container.named
    found = {n: m for n, m in container.matches(IMAGES) if "QI_DATA" not in PurePosixPath(n).parts and n not in masks}
    if named is None or re.fullmatch(METADATA, last(named), re.IGNORECASE):
        return found
    return {n: m for n, m in found.items() if n == named or n.startswith(f"{named}/")}


def _granule(member: str) -> str:
    """Path of the folder of the granule (tile) that a file belongs to; "" if the file does not lie below IMG_DATA."""
    parts = PurePosixPath(member).parts
    return "/".join(parts[: parts.index("IMG_DATA")]) if "IMG_DATA" in parts else ""


def _chosen(images: dict[str, re.Match[str]], *, single: bool) -> tuple[dict[str, str], list[str]]:
    """File of each band (that with the smallest pixels), and the names of the bands that are left out.

    `images` is as `_images` returns it. Bands with pixels of 60 m are kept only if the user named a single band file
    (`single`), or if there are no bands with smaller pixels.
    """
    found: dict[str, tuple[int, str]] = {}
    for member, match in images.items():
        name = match["band"].upper()
        pixel = int(match["pixel"] or PIXELS[name])
        found[name] = min(found.get(name, (pixel, member)), (pixel, member))
    fine = [n for n in PIXELS if n in found and PIXELS[n] < 60]
    kept = [n for n in PIXELS if n in found] if single or not fine else fine
    return {n: found[n][1] for n in kept}, [n for n in PIXELS if n in found and n not in kept]


def _bands(container: Container, root: ET.Element | None, files: dict[str, str]) -> list[ProductBand]:
    """Describe the bands in `files` (file by band) from the metadata `root`; if it is None, from the sensor preset."""
    known, values = root is not None, ET.Element("none") if root is None else root
    levels = (f".//{level}QUANTIFICATION_VALUE" for level in ("", "BOA_", "L2A_BOA_"))
    quantum = positive(said(values, *levels)) or _QUANTUM
    offsets = {
        node.get("band_id"): said_number(node, ".") or 0.0
        for tag in ("RADIO_ADD_OFFSET", "BOA_ADD_OFFSET")
        for node in values.iter(tag)
    }
    mark = {said(v, "SPECIAL_VALUE_TEXT"): said_number(v, "SPECIAL_VALUE_INDEX") for v in values.iter("Special_Values")}
    spectral = {  # a band "B1" in the metadata is "B01" in file names
        re.sub(r"^B(\d)$", r"B0\1", s.get("physicalBand") or ""): s for s in values.iter("Spectral_Information")
    }
    presets = {b.name: b for b in sensors.load("sentinel2").bands}
    masks = container.matches(_MASK)
    found = []
    for name, file in files.items():
        own = spectral.get(name)
        place = str(list(PIXELS).index(name)) if own is None else own.get("bandId")
        footprints = (m for m, match in masks if match["band"].upper() == name and m.startswith(_granule(file)))
        found.append(
            ProductBand(
                path=container.gdal(file),
                name=name,
                wavelength=positive(said(own, "Wavelength/CENTRAL")) or presets[name].wavelength,
                width=_width(own) or presets[name].width,
                scale=1 / quantum if known else 1.0,
                offset=offsets.get(place, 0.0) / quantum if known else 0.0,
                unit="reflectance" if known else None,
                nodata=mark.get("NODATA", 0.0),
                saturation=mark.get("SATURATED", FULL),
                footprint=next(map(container.gdal, footprints), None),
            )
        )
    return found


def _width(spectral: ET.Element | None) -> float | None:
    """Full width at half maximum of a band's spectral response [nm]; None if the metadata do not have it."""
    values = numbers(said(spectral, "Spectral_Response/VALUES"))
    step = positive(said(spectral, "Spectral_Response/STEP")) or 0.0
    return step * sum(v >= 0.5 * max(values) for v in values) or None


def _angles(container: Container, granule: str) -> dict[str, str]:
    """Tags with elevation and azimuth of sun and satellite [degree], as means over the tile `granule` and its bands."""
    member = next((n for n in container.find(_TILE) if granule and n.startswith(f"{granule}/")), None)
    if member is None:
        return {}
    root = container.tree(member)
    sun = said_number(root, ".//Mean_Sun_Angle/ZENITH_ANGLE")
    zenith, azimuth = _mean_direction(list(root.iter("Mean_Viewing_Incidence_Angle")))
    angles = {
        "sun_elevation": None if sun is None else round(90.0 - sun, 4),
        "sun_azimuth": said_number(root, ".//Mean_Sun_Angle/AZIMUTH_ANGLE"),
    }
    return tags_of(angles | view_tags(zenith, azimuth))


def _mean_direction(nodes: list[ET.Element]) -> tuple[float | None, float | None]:
    """Zenith angle and azimuth [degree] of the mean of directions, each from an XML node; None, None if none is known.

    It is the mean of unit vectors: azimuths of 350 and 10 have the mean 0. Nodes without both angles are ignored.
    """
    stated = [(said_number(n, "ZENITH_ANGLE"), said_number(n, "AZIMUTH_ANGLE")) for n in nodes]
    known = [(math.radians(z), math.radians(a)) for z, a in stated if z is not None and a is not None]
    if not known:
        return None, None
    across, up = sum(cmath.rect(math.sin(z), a) for z, a in known), sum(math.cos(z) for z, _ in known)
    return math.degrees(math.atan2(abs(across), up)), math.degrees(cmath.phase(across))  # across: north + i east
