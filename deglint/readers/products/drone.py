"""MicaSense RedEdge and Altum and DJI Multispectral: captures of one TIFF a band, and mosaics, by their XMP.

GDAL hands the XMP over as it stands. Exposure, gain and black level become scale and offset; vignette and row gradient
are corrected while pixels are read. The bands of a capture are not registered to each other.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePosixPath

from ...raster import RasterInfo
from ...raster.info import describe_file
from .container import Container
from .metadata import MetadataError, numbers, tags_of, xml_of
from .product import Product, ProductBand, filled
from .radiometry import Facts, Radiometry, one, radiometry_of

METADATA = r"(?!)"  # each file has its own
IMAGES = (
    r"(?P<capture>IMG_\d{4,}|DJI_(?:\d+_)*\d{3,4}_MS|DJI_\d{3}(?=\d\.))_?(?P<band>\d{1,2}|G|R|RE|NIR)(?:_\d+)?\.tiff?"
)
THERMAL = 3000.0
"""[nm] A band beyond is heat, not reflected light."""
UNREGISTERED = (
    "the bands are not registered to each other: what is of one band is up to some ten pixels off in another. Register "
    "them first for a correction band by band, or take an aligned stack or a mosaic"
)


def find(container: Container) -> Product | None:
    """The one capture in a folder or archive; None where there is none.

    A single file is no product: `with_xmp` reads what it says of itself.
    """
    if container.named is not None:
        return None
    captures: dict[str, list[str]] = {}
    for member, match in container.matches(IMAGES):
        captures.setdefault(str(PurePosixPath(member).parent / match["capture"]), []).append(member)
    captures = {k: v for k, v in captures.items() if len(v) > 1}
    if not captures:
        return None
    if len(captures) > 1:
        files = " ".join(map(container.gdal, sorted(next(iter(captures.values())))))
        raise container.several("captures", sorted(captures), f"Name the files of one: {files}")
    ((capture, members),) = captures.items()
    return _product(container, PurePosixPath(capture).name, members)


def _product(container: Container, capture: str, members: list[str]) -> Product | None:
    infos = {m: describe_file(container.gdal(m)) for m in members}
    order = sorted(members, key=lambda m: [int(p) if p.isdecimal() else p for p in re.split(r"(\d+)", m)])
    bands, radiometry, left, notes = [], list[Radiometry](), [], list[str]()
    facts: Facts = {}
    for member in order:
        info = infos[member]
        facts, said_of_it = facts_of(info)
        notes += [n for n in said_of_it if n not in notes]
        found = bands_of(info, facts)
        if len(found) != 1:
            continue
        if (found[0].wavelength or 0.0) > THERMAL or found[0].name.casefold() in ("lwir", "panchro"):
            left.append(found[0].name)
        else:
            bands.append(found[0])
            radiometry.append(radiometry_of(info, facts))
    if not bands:
        return None
    if not re.search(r"_\d+(?:_\d+)?\.tiff?$", members[0], re.IGNORECASE):
        bands.sort(key=lambda b: b.wavelength or 0.0)  # names that end in letters have no order of their own
    if left:
        notes.append(f"{', '.join(left)} left out: pixels and light of another kind; name the file to open it")
    notes += [*_corrected(radiometry), UNREGISTERED]
    tags = tags_of({"acquired": infos[order[0]].tags.get("", {}).get("TIFFTAG_DATETIME")})
    return Product(_kind(facts), capture, container.asked, tuple(bands), _sensor(facts), tags, tuple(notes))


def with_xmp(info: RasterInfo) -> tuple[RasterInfo, list[str]]:
    """A file's description, with what its XMP says of the bands; as it is where there is none."""
    if "xml:XMP" not in info.tags:
        return info, []
    facts, notes = facts_of(info)
    bands = bands_of(info, facts)
    if len(bands) != info.count or (len(bands) == 1 and not facts.get("BandName")):
        return info, notes
    if any(info.descriptions):  # names that somebody gave in the file count more
        bands = [replace(b, name=d or b.name) for b, d in zip(bands, info.descriptions, strict=True)]
    notes.append(f"{info.paths[0]}: band names and wavelengths are those of its XMP ({_kind(facts)})")
    if is_capture(info):
        notes += _corrected([radiometry_of(info, facts)])
    return filled(info, tuple(bands), {}, _sensor(facts)), notes


def is_capture(info: RasterInfo) -> bool:
    """Whether a file is one band of a capture, by its name and XMP."""
    name = PurePosixPath(info.paths[0]).name
    return info.count == 1 and "xml:XMP" in info.tags and re.fullmatch(IMAGES, name, re.IGNORECASE) is not None


def facts_of(info: RasterInfo) -> tuple[Facts, list[str]]:
    """Values in the XMP by their names without namespace, and what to say where it is damaged."""
    text = info.tags.get("xml:XMP", {}).get("xml:XMP", "")
    if not text:
        return {}, []
    try:
        root = xml_of(text.strip("\0 \n").encode(), f"the XMP of {info.paths[0]}")
    except MetadataError as error:
        return {}, [f"{error}, and is not used"]
    found: dict[str, list[str]] = {}
    for node in root.iter():
        for name, value in node.attrib.items():
            found.setdefault(name.rpartition("}")[2], [value.strip()])
        items = [(n.text or "").strip() for n in node.iter("li")]
        if node.tag not in ("li", "Seq", "Bag", "Description", "RDF", "xmpmeta") and (
            items or (node.text or "").strip()
        ):
            found.setdefault(node.tag, items or [(node.text or "").strip()])
    return found, []


def bands_of(info: RasterInfo, facts: Facts) -> list[ProductBand]:
    """The bands that an XMP names, those of a capture with their radiometry; else none."""
    names = facts.get("BandName", ())
    centres, widths = (
        [next(iter(numbers(v)), None) for v in facts.get(k, ())] for k in ("CentralWavelength", "WavelengthFWHM")
    )
    spread = re.match(r"\s*([\d.]+)\s*\(\s*\+/-\s*([\d.]+)\s*\)", one(facts, "BandFreq"))
    if spread and not centres:
        centres, widths = [float(spread[1])], [2 * float(spread[2])]
    if not names or len(names) != info.count:
        return []
    none: list[float | None] = [None] * len(names)
    centres, widths = (v if len(v) == len(names) else none for v in (centres, widths))
    made = radiometry_of(info, facts) if is_capture(info) else Radiometry()
    offset = 0.0 - made.black * made.scale  # not -0.0
    band = ProductBand(info.paths[0], "", scale=made.scale, offset=offset, unit=made.unit, flat=made.flat)
    return [
        replace(band, name=name, number=i, wavelength=centre, width=width)
        for i, (name, centre, width) in enumerate(zip(names, centres, widths, strict=True), start=1)
    ]


def _kind(facts: Facts) -> str:
    rig = one(facts, "RigName") or one(facts, "Model")
    micasense = "RadiometricCalibration" in facts or "RigName" in facts
    maker = "MicaSense" if micasense else "DJI" if "BandFreq" in facts else ""
    return f"{maker} {rig}".strip() or "drone camera"


def _sensor(facts: Facts) -> str | None:
    """The preset whose optics and instants are this camera's."""
    return "micasense" if one(facts, "RigName").lower().startswith("rededge") else None


def _corrected(bands: Sequence[Radiometry]) -> list[str]:
    """What of the radiometry is corrected, and what is not."""
    words = list(dict.fromkeys(w for b in bands for w in b.applied))
    applied = f"{', '.join(words)} are corrected as the XMP says" if words else ""
    if any(b.flat for b in bands):
        applied += "; the numbers become floating point"
    missing = "the XMP says nothing of exposure: the numbers are taken as they stand"
    return [applied or missing, *dict.fromkeys(n for b in bands for n in b.notes)]
