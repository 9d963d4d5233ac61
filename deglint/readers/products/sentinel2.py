"""Sentinel-2 L1C and L2A: a .SAFE folder or its zip, MTD_MSIL1C.xml or MTD_MSIL2A.xml, and single band files near it.

The image files are opened one by one, not through GDAL's SENTINEL2 driver: that driver opens each resolution as a
dataset of its own, needs the product whole and with its own file names, and leaves the offsets to the caller.
"""

from __future__ import annotations

import math
import re
from pathlib import PurePosixPath
from xml.etree import ElementTree as ET

from ... import sensors
from ...errors import InputError
from .container import Container, last
from .metadata import MetadataError, angle_tags, number, numbers, positive, said, tags_of, xml_of
from .product import Product, ProductBand

METADATA = r"(?:.+[_.-])?MTD_MSIL(?:1C|2A)\.xml|S2[A-D]_(?:OPER|USER)_MTD_SAFL(?:1C|2A)_.*\.xml"
IMAGES = r"(?:.*_)?(?P<band>B0[1-9]|B1[0-2]|B8A)(?:_(?P<pixel>10|20|60)m)?\.(?:jp2|tiff?)"
_IMAGE = re.compile(IMAGES, re.IGNORECASE)
_MASK = re.compile(r"(?:.*_)?(?:MSK_)?DETFOO_(?:.*_)?(?P<band>B0[1-9]|B1[0-2]|B8A)(?:_MSIL1C)?\.(?:jp2|tiff?)", re.I)
_TILE = r"MTD_TL\.xml|S2[A-D]_(?:OPER|USER)_MTD_L(?:1C|2A)_TL_.*\.xml"
PIXELS = {"B01": 60, "B02": 10, "B03": 10, "B04": 10, "B05": 20, "B06": 20, "B07": 20, "B08": 10, "B8A": 20,
          "B09": 60, "B10": 60, "B11": 20, "B12": 20}  # fmt: skip
"""Side of a pixel on the ground [m] that each band is taken at."""
FULL = 65535.0
"""What stands for saturated where the metadata do not say."""


def find(container: Container) -> Product | None:
    """The product in a folder or archive, or the named band files of it; None where there is none."""
    metadata = container.find(METADATA)
    images = _images(container)
    if container.named and last(container.named) in map(last, metadata):
        metadata = [container.named]
    if not images or not (metadata or any("IMG_DATA" in PurePosixPath(n).parts for n in images)):
        return None
    if len(metadata) > 1:
        raise InputError(
            f"{container.path} holds {len(metadata)} Sentinel-2 products: {', '.join(metadata[:4])}. Name one."
        )
    granules = {_granule(n) for n in images} - {""}
    if len(granules) > 1:
        raise InputError(
            f"{container.path} holds {len(granules)} granules. Name the folder of one: "
            f"{', '.join(sorted(container.gdal(g) for g in granules)[:3])}"
        )
    root, notes = _root(container, metadata)
    facts = _Facts(root)
    chosen, left = _chosen(images, single=_single(container))
    bands = tuple(facts.band(container, name, file, _mask(container, name, file)) for name, file in chosen.items())
    if left:
        notes.append(f"{', '.join(left)} (pixels of 60 m) left out; name their files to open them")
    if root is not None:
        missing = [n for n, side in PIXELS.items() if side < 60 and n not in chosen]
        if missing and not _single(container):
            notes.append(f"no files of {', '.join(missing)} in the product")
        notes.append("time offsets are those of odd-numbered detectors; in even ones the bands follow in reverse order")
    level = facts.level or ("2A" if any("_L2A" in n or "MSIL2A" in n for n in (container.path, *images)) else "1C")
    name = said(root, ".//PRODUCT_URI") or said(root, ".//PRODUCT_URI_2A") or _safe(container)
    return Product(
        f"Sentinel-2 L{level}",
        name.removesuffix(".SAFE"),
        container.asked,
        bands,
        "sentinel2",
        facts.tags | _angles(container, next(iter(granules), ""), notes),
        tuple(notes),
    )


def _images(container: Container) -> list[str]:
    """Image files of bands, those below what was named."""
    found = [
        n for n in container.find(IMAGES) if "QI_DATA" not in PurePosixPath(n).parts and not _MASK.fullmatch(last(n))
    ]
    named = container.named
    if named is None or _is_metadata(named):
        return found
    return [n for n in found if n == named or n.startswith(f"{named}/")]


def _is_metadata(member: str) -> bool:
    return bool(re.fullmatch(METADATA, last(member), re.IGNORECASE))


def _single(container: Container) -> bool:
    """Whether one image file was named, not a product."""
    return container.named is not None and _IMAGE.fullmatch(last(container.named)) is not None


def _granule(member: str) -> str:
    """Path of the granule that a file belongs to, or ""."""
    parts = PurePosixPath(member).parts
    return "/".join(parts[: parts.index("IMG_DATA")]) if "IMG_DATA" in parts else ""


def _angles(container: Container, granule: str, notes: list[str]) -> dict[str, str]:
    """Where sun and satellite stand, seen from the ground: means over the tile, and over the bands."""
    member = next((n for n in container.find(_TILE) if granule and n.startswith(f"{granule}/")), None)
    if member is None:
        return {}
    try:
        root = xml_of(container.read(member), member)
    except MetadataError as error:
        notes.append(f"{error}: the angles of sun and satellite are not known")
        return {}
    sun = _direction(root.find(".//Mean_Sun_Angle"))
    views = [v for node in root.iter("Mean_Viewing_Incidence_Angle") if (v := _direction(node))]
    found = {} if sun is None else angle_tags(sun_elevation=round(90.0 - sun[0], 4), sun_azimuth=round(sun[1], 4))
    if views:
        east, north = (
            sum(math.sin(math.radians(zenith)) * of(math.radians(azimuth)) for zenith, azimuth in views) / len(views)
            for of in (math.sin, math.cos)
        )
        zenith, azimuth = math.degrees(math.asin(math.hypot(east, north))), math.degrees(math.atan2(east, north))
        found |= {k: v for k, v in angle_tags(incidence=zenith, view_azimuth=azimuth).items() if v is not None}
    return tags_of(found)


def _direction(node: ET.Element | None) -> tuple[float, float] | None:
    """Zenith angle and azimuth [degree] that an element states."""
    zenith, azimuth = number(said(node, "ZENITH_ANGLE")), number(said(node, "AZIMUTH_ANGLE"))
    return None if zenith is None or azimuth is None else (zenith, azimuth)


def _safe(container: Container) -> str:
    """Name of the SAFE folder."""
    inside = next((p for n in container.names for p in PurePosixPath(n).parts if p.endswith(".SAFE")), "")
    return inside or container.name


def _root(container: Container, metadata: list[str]) -> tuple[ET.Element | None, list[str]]:
    remedy = (
        "band names are known, scale and offset are not: the numbers are taken as they stand. Give --scale and "
        "--offset, or download the metadata again"
    )
    if not metadata:
        return None, [f"{container.path} has no MTD_MSIL1C.xml or MTD_MSIL2A.xml: {remedy}"]
    try:
        root = xml_of(container.read(metadata[0]), metadata[0])
        if root.find(".//Product_Image_Characteristics") is None:
            raise MetadataError(f"{metadata[0]} is damaged: it has no Product_Image_Characteristics")
    except MetadataError as error:
        return None, [f"{error}: {remedy}"]
    return root, []


def _chosen(images: list[str], *, single: bool) -> tuple[dict[str, str], list[str]]:
    """The file of each band, in the order of wavelengths, and the bands of 60 m that are left out."""
    found: dict[str, tuple[int, str]] = {}
    for member in images:
        match = _IMAGE.fullmatch(last(member))
        assert match is not None  # as `_images` takes no others
        name = match["band"].upper()
        pixel = int(match["pixel"] or PIXELS[name])
        found[name] = min(found.get(name, (pixel, member)), (pixel, member))
    fine = [n for n in PIXELS if n in found and PIXELS[n] < 60]
    kept = [n for n in PIXELS if n in found] if single or not fine else fine
    return {n: found[n][1] for n in kept}, [n for n in PIXELS if n in found and n not in kept]


def _mask(container: Container, band: str, file: str) -> str | None:
    """The file of detector numbers of a band."""
    granule = _granule(file)
    for member in container.names:
        match = _MASK.fullmatch(last(member))
        if match and match["band"].upper() == band and member.startswith(granule):
            return container.gdal(member)
    return None


class _Facts:
    """What MTD_MSIL*.xml says."""

    def __init__(self, root: ET.Element | None) -> None:
        self._root = root
        self._known = root is not None
        values = root if root is not None else ET.Element("none")
        self.level = said(values, ".//PROCESSING_LEVEL").replace("Level-", "").removesuffix("p")
        quantum = next(
            (q for tag in ("QUANTIFICATION_VALUE", "BOA_QUANTIFICATION_VALUE", "L2A_BOA_QUANTIFICATION_VALUE")
             if (q := positive(said(values, f".//{tag}")))), 10_000.0,
        )  # fmt: skip
        self._quantum = quantum
        offsets = [*values.iter("RADIO_ADD_OFFSET"), *values.iter("BOA_ADD_OFFSET")]
        self._offsets = {o.get("band_id"): number(o.text) or 0.0 for o in offsets}
        special = {
            said(v, "SPECIAL_VALUE_TEXT"): number(said(v, "SPECIAL_VALUE_INDEX")) for v in values.iter("Special_Values")
        }
        self._nodata = special.get("NODATA", 0.0)
        self._full = special.get("SATURATED", FULL)
        self._spectral = {_code(s.get("physicalBand") or ""): s for s in values.iter("Spectral_Information")}
        self.tags = tags_of(
            {
                "satellite": said(values, ".//SPACECRAFT_NAME"),
                "acquired": said(values, ".//PRODUCT_START_TIME"),
                "processing_baseline": said(values, ".//PROCESSING_BASELINE"),
            }
        )

    def band(self, container: Container, name: str, file: str, mask: str | None) -> ProductBand:
        own = self._spectral.get(name)
        place = own.get("bandId") if own is not None else str(list(PIXELS).index(name))
        preset = next(b for b in sensors.load("sentinel2").bands if b.name == name)
        known = self._known
        return ProductBand(
            path=container.gdal(file),
            name=name,
            wavelength=positive(said(own, "Wavelength/CENTRAL")) or preset.wavelength,
            width=_width(own) or preset.width,
            scale=1 / self._quantum if known else 1.0,
            offset=self._offsets.get(place, 0.0) / self._quantum if known else 0.0,
            unit="reflectance" if known else None,
            nodata=self._nodata,
            saturation=self._full,
            footprint=mask,
        )


def _code(physical: str) -> str:
    """ "B1" as file names have it: "B01"."""
    return re.sub(r"^B(\d)$", r"B0\1", physical)


def _width(spectral: ET.Element | None) -> float | None:
    """Full width at half maximum of the response [nm]."""
    values = numbers(said(spectral, "Spectral_Response/VALUES"))
    step = positive(said(spectral, "Spectral_Response/STEP"))
    if not values or not step:
        return None
    return step * sum(v >= 0.5 * max(values) for v in values) or None
