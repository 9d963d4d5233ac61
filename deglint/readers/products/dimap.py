"""Pleiades, Pleiades Neo, SPOT 6 and SPOT 7: metadata in DIM_*.XML (DIMAP 2), images opened by GDAL's DIMAP driver.

The driver joins the tiles of an image, but does not report gains or the order of bands, which are in the XML. Radiance,
or reflectance in products of reflectance, is DN / GAIN + BIAS, where DN is the file value.
"""

import math
from pathlib import PurePosixPath
from typing import Any
from xml.etree import ElementTree as ET

from ...errors import InputError
from ..spectral import nanometres
from ..text import positive
from .metadata import PRODUCT_UNIT, Container, Product, ProductBand, said, said_number, tags_of, view_tags

METADATA = r"(?:DIM|VOL)_.+\.XML"
IMAGES = r"IMG_.+\.(?:tiff?|jp2)"
_SHOWN = ("RED_CHANNEL", "GREEN_CHANNEL", "BLUE_CHANNEL")
_NAMES = {"R": "red", "G": "green", "B": "blue", "NIR": "nir", "RE": "rededge", "DB": "coastal", "P": "pan"}
_DIMAP_TITLES = {"PHR": "Pleiades", "PNEO": "Pleiades Neo", "SPOT": "SPOT"}
_SCALED = ("BASIC", "", "REFLECTANCE")  # radiometric processing levels whose gains convert to radiance or reflectance
_PLEIADES_ORBIT = 694_000.0  # altitude of Pleiades and SPOT 6 and 7 [m]


def find(container: Container) -> Product | None:
    """The multispectral product in `container`, or None; if the user named a file in it, the product of this file."""
    named = None if (container.named or "").upper().startswith("VOL_") else container.named
    files, found = container.find(METADATA), []
    for member in [named] if named in files else files:
        root = container.tree(member)
        tiles = [n.get("href", "") for n in root.iter("DATA_FILE_PATH")]
        if named and named not in (member, *(container.beside(member, t) for t in tiles)):
            continue
        if (said_number(root, ".//Raster_Dimensions/NBANDS") or 0) > 1 or named:
            found.append((member, root, tiles))
    if not found:
        return None
    member, root, tiles = container.only(found, "multispectral images", (container.gdal(m) for m, *_ in found))
    for tile in tiles:
        if container.beside(member, tile) is None:
            raise InputError(f"{member} names the image {tile[:80]!r}, which is not in its folder. Download all files.")
    return _product(container, member, root)


def _product(container: Container, member: str, root: ET.Element) -> Product:
    ids, notes = _order(root)
    processing = said(root, ".//RADIOMETRIC_PROCESSING").upper()
    values = root.iter("Special_Value")
    special = {said(v, "SPECIAL_VALUE_TEXT").upper(): said_number(v, "SPECIAL_VALUE_COUNT") for v in values}
    marks: dict[str, Any] = {"nodata": special.get("NODATA", 0.0), "saturation": special.get("SATURATED")}
    bands = [
        ProductBand(container.gdal(member), _NAMES.get(band, band), **marks, **_band(root, band, processing))
        for band in ids
    ]
    if any(b.unit is None for b in bands):
        why = "without gains" if processing in _SCALED else f"made for display ({processing})"
        notes.append(f"the product is {why}: file values are used without scaling")
    mission = said(root, ".//Strip_Source/MISSION", ".//MISSION").upper()
    index = said(root, ".//Strip_Source/MISSION_INDEX", ".//MISSION_INDEX")
    when = "T".join(filter(None, (said(root, ".//IMAGING_DATE"), said(root, ".//IMAGING_TIME"))))
    facts = {"satellite": f"{_DIMAP_TITLES.get(mission, mission)} {index}", "acquired": when}
    tags = tags_of(facts | {"view_angle": said(root, ".//INCIDENCE_ANGLE")} | _angles(root))
    name = said(root, ".//DATASET_NAME") or PurePosixPath(member).stem.removeprefix("DIM_")
    kind = f"{_DIMAP_TITLES.get(mission, 'DIMAP')} {index}".strip()
    return Product(kind, name, tuple(bands), "pleiades" if mission == "PHR" else None, tags, tuple(notes))


def _angles(root: ET.Element) -> dict[str, object]:
    """Tags with the directions of sun and satellite [degree], seen from the ground at the centre of the image.

    In the metadata, AZIMUTH_ANGLE is the orientation of the image; VIEWING_ANGLE is measured at the satellite. The
    azimuth of the satellite is AZIMUTH_ANGLE - atan2(tan(across), tan(along)), with the incidence angles across and
    along the track, as in the Orfeo Toolbox (CNES).
    """
    places = list(root.iter("Located_Geometric_Values"))
    place = next((p for p in places if said(p, "LOCATION_TYPE").casefold() == "center"), places[0] if places else root)
    azimuth, across, along = (
        said_number(place, f".//{name}")
        for name in ("AZIMUTH_ANGLE", "INCIDENCE_ANGLE_ACROSS_TRACK", "INCIDENCE_ANGLE_ALONG_TRACK")
    )
    if azimuth is not None and across is not None and along is not None:
        across, along = math.tan(math.radians(across)), math.tan(math.radians(along))
        azimuth -= math.degrees(math.atan2(across, along))
    else:
        azimuth = None
    sun = {"sun_elevation": said(place, ".//SUN_ELEVATION"), "sun_azimuth": said(place, ".//SUN_AZIMUTH")}
    incidence, off_nadir = (said_number(place, f".//{name}") for name in ("INCIDENCE_ANGLE", "VIEWING_ANGLE"))
    return {**sun, **view_tags(incidence, azimuth, off_nadir, _PLEIADES_ORBIT)}


def _order(root: ET.Element) -> tuple[list[str], list[str]]:
    """Names of the bands (BAND_ID in the metadata) in the order of the image, and notes."""
    # Pleiades Neo has two parts, with three bands each
    parts = [part for part in root.iter("Data_Files") if part.find(".//Raster_Index") is not None] or [root]
    placed = [
        (i, said_number(node, "BAND_INDEX") or 0, said(node, "BAND_ID"))
        for i, part in enumerate(parts)
        for node in part.iter("Raster_Index")
    ]
    count = int(said_number(root, ".//Raster_Dimensions/NBANDS") or 0)
    if placed and len(placed) == count:
        return [band for _, _, band in sorted(placed)], []
    named = dict.fromkeys(said(n, "BAND_ID") for k in ("Band_Radiance", "Band_Spectral_Range") for n in root.iter(k))
    every = [e for e in named if e and (e != "P" or count == 1)]
    first = [s for s in [said(root, f".//Band_Display_Order/{channel}") for channel in _SHOWN] if s in every]
    ids = first + [e for e in every if e not in first]
    if len(ids) != count:
        raise InputError(
            f"the metadata name {len(ids)} bands and the image has {count}. Name the image itself, and its bands with "
            "--bands"
        )
    note = f"the order of the bands is not stated: {', '.join(ids)} is assumed, as they are displayed"
    return ids, [note] if count > 1 else []


def _band(root: ET.Element, band: str, processing: str) -> dict[str, Any]:
    """Known fields of the `ProductBand` with BAND_ID `band`; `processing` is the radiometric level of the product."""
    kind, unit = "Band_Radiance", PRODUCT_UNIT
    if processing == "REFLECTANCE":
        kind, unit = "Band_Reflectance", "reflectance"
    kinds = kind, "Band_Spectral_Range"
    factors, ends = (next((n for n in root.iter(k) if said(n, "BAND_ID") == band), None) for k in kinds)
    found: dict[str, Any] = {}
    gain, bias = positive(said(factors, "GAIN")), said_number(factors, "BIAS")
    if gain is not None and bias is not None and processing in _SCALED:
        found = {"scale": 1 / gain, "offset": bias, "unit": unit}
    stated = (positive(said(ends, name)) for name in ("MIN", "MAX"))
    low, high = (None if end is None else nanometres(end, said(ends, "MEASURE_UNIT")) for end in stated)
    if low is not None and high is not None and high > low:
        found |= {"wavelength": 0.5 * (low + high), "width": high - low}
    return found
