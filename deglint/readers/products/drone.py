"""MicaSense RedEdge and Altum and DJI Multispectral: captures with one TIFF file per band, and mosaics.

Their metadata are XMP, which GDAL returns as text. Exposure, gain and black level are converted to scale and offset;
vignetting and row gradient are corrected while pixels are read. Bands of a capture are not registered to each other.

References
----------
MicaSense, imageprocessing (micasense.utils.raw_image_to_radiance), https://github.com/micasense/imageprocessing
DJI, Mavic 3M Image Processing Guide (2023), equation 9 and the vignetting correction.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from ...errors import ReadError
from ...raster import FlatField, RasterInfo
from ...raster.info import describe_file, quiet
from ..text import number, numbers, positive
from .metadata import Container, MetadataError, Product, ProductBand, filled, open_archive, tags_of, xml_of

METADATA = r"(?!)"  # matches nothing: the metadata are inside each image
IMAGES = (
    r"(?P<capture>IMG_\d{4,}|DJI_(?:\d+_)*\d{3,4}_MS|DJI_\d{3}(?=\d\.))_?(?P<band>\d{1,2}|G|R|RE|NIR)(?:_\d+)?\.tiff?"
)
THERMAL = 3000.0  # bands beyond this wavelength are thermal [nm]
UNREGISTERED = (
    "the bands are assumed not to be registered to each other, but displaced by up to some ten pixels. Register them "
    "first for a correction band by band, or take an aligned stack or a mosaic"
)

Facts = Mapping[str, Sequence[str]]  # values in an XMP by name without namespace
Calibration = tuple[float, str | None, FlatField]
"""Scale, unit of the physical value (None: not known), and correction of black level, vignetting and row gradient."""
_BLACK_LEVEL = 50714  # number of the DNG tag BlackLevel, which GDAL does not report


def find(container: Container) -> Product | None:
    """The capture in a folder or archive: a set of images that a camera took at once, one file for each band.

    Returns None if there is none, or if the user named one file (see `with_xmp`). Several captures raise InputError.
    """
    captures: dict[str, list[str]] = {}
    for member, match in container.matches(IMAGES):
        captures.setdefault(str(PurePosixPath(member).parent / match["capture"]), []).append(member)
    captures = {k: v for k, v in captures.items() if len(v) > 1}
    if not captures:
        return None
    files = " ".join(map(container.gdal, sorted(next(iter(captures.values())))))
    every = list(captures.items())
    capture, members = container.only(every, "captures", sorted(captures), f"Name the files of one: {files}")
    return _product(container, PurePosixPath(capture).name, members)


def _product(container: Container, capture: str, members: list[str]) -> Product | None:
    order = sorted(members, key=lambda m: [int(p) if p.isdecimal() else p for p in re.split(r"(\d+)", m)])
    infos = [describe_file(container.gdal(m)) for m in order]
    bands, left, notes = [], [], list[str]()
    facts: Facts = {}
    for info in infos:
        own = facts_of(info)
        found, corrected = bands_of(info, own)
        if len(found) != 1:
            continue
        if (found[0].wavelength or 0.0) > THERMAL or found[0].name.casefold() in ("lwir", "panchro"):
            left.append(found[0].name)
        else:
            facts = own
            bands += found
            notes += corrected
    if not bands:
        return None
    if not re.search(r"_\d+(?:_\d+)?\.tiff?$", members[0], re.IGNORECASE):
        bands.sort(key=lambda b: b.wavelength or 0.0)  # file names that end in letters do not give the order
    if left:
        notes.insert(0, f"{', '.join(left)} left out (thermal or panchromatic); to use one, name its file as IN")
    notes = list(dict.fromkeys([*notes, UNREGISTERED]))
    tags = tags_of({"acquired": infos[0].tags.get("", {}).get("TIFFTAG_DATETIME")})
    return Product(_kind(facts), capture, tuple(bands), _sensor(facts), tags, tuple(notes))


def with_xmp(info: RasterInfo) -> tuple[RasterInfo, list[str]]:
    """A copy of `info` with wavelengths, calibration, sensor and missing names from its XMP, if any; and notes."""
    facts = facts_of(info)
    bands, corrected = bands_of(info, facts)
    if not bands:
        return info, []
    if any(info.descriptions):  # band names in the file itself take precedence
        bands = [replace(b, name=d or b.name) for b, d in zip(bands, info.descriptions, strict=True)]
    note = f"{info.paths[0]}: band names and wavelengths are those of its XMP ({_kind(facts)})"
    return filled(info, tuple(bands), {}, _sensor(facts)), [note, *corrected]


def is_capture(info: RasterInfo) -> bool:
    """Whether a file is one band of a capture: it has one band and XMP metadata, and its name matches `IMAGES`."""
    name = PurePosixPath(info.paths[0]).name
    return info.count == 1 and "xml:XMP" in info.tags and re.fullmatch(IMAGES, name, re.IGNORECASE) is not None


def facts_of(info: RasterInfo) -> Facts:
    """Values in the XMP metadata of a file, by their name without namespace; empty if XMP is missing or damaged."""
    try:
        root = xml_of(info.tags.get("xml:XMP", {}).get("xml:XMP", "").strip("\0 \n").encode(), "XMP")
    except MetadataError:
        return {}
    found: dict[str, list[str]] = {}
    for node in root.iter():
        for name, value in node.attrib.items():
            found.setdefault(name.rpartition("}")[2], [value.strip()])
        items = [(n.text or "").strip() for n in node.iter("li")] or [(node.text or "").strip()]
        if any(items):
            found.setdefault(node.tag, items)
    return found


def bands_of(info: RasterInfo, facts: Facts) -> tuple[list[ProductBand], list[str]]:
    """Bands that the XMP (`facts`) names, and notes on corrections; no bands if the file has more or fewer bands."""
    names = facts.get("BandName", ())
    if not names or len(names) != info.count:
        return [], []
    stated = (facts.get(name, ()) for name in ("CentralWavelength", "WavelengthFWHM"))
    centres, widths = ([next(iter(numbers(text)), None) for text in texts] for texts in stated)
    spread = re.match(r"\s*([\d.]+)\s*\(\s*\+/-\s*([\d.]+)\s*\)", one(facts, "BandFreq"))
    if spread and not centres:
        centres, widths = [float(spread[1])], [2 * float(spread[2])]
    none: list[float | None] = [None] * len(names)
    centres, widths = (v if len(v) == len(names) else none for v in (centres, widths))
    radiometry, notes = _radiometry(info, facts) if is_capture(info) else ({}, [])
    return [
        ProductBand(info.paths[0], name, wavelength=centre, width=width, **radiometry)
        for name, centre, width in zip(names, centres, widths, strict=True)
    ], notes


def _kind(facts: Facts) -> str:
    maker = "MicaSense" if {"RadiometricCalibration", "RigName"} & {*facts} else "DJI" if "BandFreq" in facts else ""
    return f"{maker} {one(facts, 'RigName') or one(facts, 'Model')}".strip() or "drone camera"


def _sensor(facts: Facts) -> str | None:
    """Name of the sensor preset with the camera's optics and time offsets; None if the camera is not a RedEdge."""
    return "micasense" if one(facts, "RigName").lower().startswith("rededge") else None


def one(facts: Facts, name: str) -> str:
    """The first value called `name` in the XMP; "" if there is none."""
    return next(iter(facts.get(name, ())), "")


def _radiometry(info: RasterInfo, facts: Facts) -> tuple[dict[str, Any], list[str]]:
    """Scale, offset, unit and `FlatField` of a raw capture, as fields of `ProductBand` ({} if unknown), and notes."""
    found = None if info.dtypes[0] != "uint16" else _micasense(info, facts) or _dji(facts)
    if found is None:
        return {}, ["the XMP has no exposure: file values are used without scaling"]
    scale, unit, flat = found
    words = [word for word, there in (("vignette", flat.polynomial), ("row gradient", flat.row_gradient)) if there]
    note = f"{', '.join(['exposure, gain and black level', *words])} are corrected as the XMP says"
    if words:
        note += "; the numbers become floating point"
    offset = 0.0 - flat.black * scale  # not -0.0
    return {"scale": scale, "offset": offset, "unit": unit, "flat": flat if words else None}, [note]


def _micasense(info: RasterInfo, facts: Facts) -> Calibration | None:
    """MicaSense's conversion of file values p to radiance L; None if XMP and EXIF lack values for it.

    L = V(x, y) R(y) (p - black) a1 / (gain t 2^16), with column x, row y, vignette correction V, row correction R =
    1 / (1 + (a2 / t - a3) y), gain (ISO speed / 100), exposure time t [s], and a1 to a3 of RadiometricCalibration.
    """
    exif = {k: number(v.strip("()")) for k, v in info.tags.get("EXIF", {}).items()}
    calibration, dark, centre, vignette = (
        [n for text in facts.get(name, ()) for n in numbers(text)]
        for name in ("RadiometricCalibration", "DarkRowValue", "VignettingCenter", "VignettingPolynomial")
    )
    shutter = exif.get("EXIF_ExposureTime")
    if not calibration or not shutter or shutter <= 0 or calibration[0] <= 0:
        return None
    gain = (exif.get("EXIF_ISOSpeed") or exif.get("EXIF_ISOSpeedRatings") or 100.0) / 100.0
    black = _black_level(info.paths[0])
    if black is None:
        black = sum(dark) / len(dark) if dark else 0.0
    flat = FlatField(black)
    if len(centre) == 2 and vignette:
        flat = replace(flat, centre=(centre[0], centre[1]), polynomial=tuple(vignette))
    if len(calibration) == 3:
        flat = replace(flat, row_gradient=calibration[1] / shutter - calibration[2])
    return calibration[0] / (gain * shutter * 65536), "W m-2 sr-1 nm-1", flat


def _dji(facts: Facts) -> Calibration | None:
    """DJI's conversion of file values p to numbers proportional to radiance; None if the XMP has no values for it.

    The numbers are V c (p - black) / (gain t 2^16), where V corrects vignetting, c is SensorGainAdjustment, and t [s]
    is the exposure time. Their unit is not known.
    """
    micro, gain = positive(one(facts, "ExposureTime")), positive(one(facts, "SensorGain"))
    black = number(one(facts, "BlackLevel") or one(facts, "BlackCurrent"))
    if micro is None or gain is None or black is None:
        return None
    factor = positive(one(facts, "SensorGainAdjustment")) or 1.0
    vignette = numbers(one(facts, "VignettingData"))
    centre = [number(one(facts, f"CalibratedOpticalCenter{axis}")) for axis in "XY"]
    flat = FlatField(black)
    if vignette and None not in centre and one(facts, "VignettingFlag") != "1":  # 1: the camera has corrected it
        flat = FlatField(black, (centre[0] or 0.0, centre[1] or 0.0), tuple(vignette), corrects=True)
    return factor / (65536 * gain * micro * 1e-6), None, flat


def _black_level(path: str) -> float | None:
    """Mean of the tag BlackLevel of a TIFF [file value]; None if it is missing or unreadable."""
    from PIL.TiffImagePlugin import TiffImageFile

    archive = re.fullmatch(r"/vsi(?:zip|tar)/(.+?\.(?:zip|tar))/(.+)", path, re.IGNORECASE)
    try:
        file: str | BytesIO = path
        if archive:
            box = open_archive(archive[1])
            file = BytesIO(box.read(box.beside("", archive[2]) or archive[2]))
        with quiet(), TiffImageFile(file) as image:
            return float(np.atleast_1d(image.tag_v2[_BLACK_LEVEL]).astype(np.float64).mean())
    except (ReadError, OSError, ValueError, TypeError, KeyError, SyntaxError):
        return None
