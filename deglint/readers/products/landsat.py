"""Landsat 8 and 9, Collection 2, Level 1 and Level 2: a folder, a .tar, or *_MTL.txt, .json or .xml.

GDAL has no driver for these: each band is a GeoTIFF, and only the MTL file has scale and offset. A Level-2 file repeats
the factors of Level 1 under the same names, so they are read from the group of the level.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from .container import Container, last
from .metadata import MetadataError, angle_tags, groups_of, json_of, number, positive, tags_of, text_of, xml_of
from .product import Product, ProductBand

METADATA = r"L[CO]0[89]_.*_MTL\.(?:txt|json|xml)"
IMAGES = r"(?P<scene>L[CO]0[89]_L[12].*?)_(?P<band>(?:SR_)?B(?P<number>[1-79]))\.tiff?"
_MTL_GROUPS = {"1": ("LEVEL1_RADIOMETRIC_RESCALING", "LEVEL1_MIN_MAX_PIXEL_VALUE"),
               "2": ("LEVEL2_SURFACE_REFLECTANCE_PARAMETERS", "LEVEL2_SURFACE_REFLECTANCE_PARAMETERS")}  # fmt: skip
"""Groups of factors and of largest values, by level."""
SURFACE = (2.75e-05, -0.2)
"""Scale and offset of every Level-2 product of Collection 2 (USGS), used if the MTL file is missing or damaged."""
FULL = 65535.0
"""Largest value of the products if the MTL file does not give it (QUANTIZE_CAL_MAX_BAND_n)."""
LANDSAT_ORBIT = 705_000.0
"""Altitude of Landsat 8 and 9 [m]. They view the nadir, except in a few scenes with a ROLL_ANGLE of about 15 degrees.
"""
CIRRUS = (1373.5, 20.0)
"""Centre and width of B9 [nm] (USGS: 1363-1384 nm), which is not in the preset of the bands 1 to 7."""

Groups = Mapping[str, Mapping[str, Any]]


def find(container: Container) -> Product | None:
    """The product in a folder or archive, or of a selected band file; None if there is none."""
    metadata, named = container.find(METADATA), container.named
    images = container.matches(IMAGES)
    if named in metadata:
        images = [(n, m) for n, m in images if m["scene"] == _stem(named or "")]
    elif named is not None:
        images = [(n, m) for n, m in images if n == named]
    scenes = sorted({m["scene"] for _, m in images})
    if not images:
        return None
    if len(scenes) > 1:
        raise container.several("Landsat scenes", scenes, "Name the *_MTL.txt file of one.")
    (scene,) = scenes
    level = "2" if any(m["band"].upper().startswith("SR_") for _, m in images) else "1"
    groups, notes = _groups(container, [m for m in metadata if _stem(m) == scene], level)
    bands = [_band(container.gdal(n), m["band"].upper(), m["number"], level, groups) for n, m in images]
    facts = groups.get("IMAGE_ATTRIBUTES", {})
    elevation = number(facts.get("SUN_ELEVATION"))
    if level == "1" and elevation is not None and elevation > 0:
        notes.append(
            f"reflectance is not divided by the sine of the sun's elevation ({elevation:g} degrees, a factor of "
            f"{1 / math.sin(math.radians(elevation)):.3f} for the whole scene)"
        )
    angles = angle_tags(
        sun_elevation=elevation,
        sun_azimuth=facts.get("SUN_AZIMUTH"),
        off_nadir=number(facts.get("ROLL_ANGLE")),
        altitude=LANDSAT_ORBIT,
    )
    when = f"{facts.get('DATE_ACQUIRED', '')}T{facts.get('SCENE_CENTER_TIME', '')}" if facts else ""
    tags = tags_of({"satellite": facts.get("SPACECRAFT_ID"), "acquired": when} | angles)
    kind = f"Landsat {scene[3:4]} Level {level}"
    return Product(
        kind, scene, container.asked, tuple(sorted(bands, key=lambda b: b.name)), "landsat8", tags, tuple(notes)
    )


def _stem(member: str) -> str:
    return re.sub(r"_MTL\.\w+$", "", last(member), flags=re.IGNORECASE)


def _groups(container: Container, metadata: list[str], level: str) -> tuple[Groups, list[str]]:
    """The MTL file's groups; if none can be read, notes on that."""
    remedy = "the numbers are taken as they stand. Download it again, or give --scale and --offset"
    if level == "2":
        remedy = f"scale {SURFACE[0]:g} and offset {SURFACE[1]:g} of all Level-2 products of Collection 2 are assumed"
    if not metadata:
        return {}, [f"{container.path} has no *_MTL.txt: {remedy}"]
    chosen = min(metadata, key=lambda m: (not m.lower().endswith(".txt"), m))
    try:
        return _read(container.read(chosen), chosen), []
    except MetadataError as error:
        return {}, [f"{error}: {remedy}"]


def _read(data: bytes, name: str) -> Groups:
    """The groups of an MTL file in any of its three formats."""
    found: Any
    if name.lower().endswith(".xml"):
        found = {g.tag: {v.tag: (v.text or "").strip() for v in g} for g in xml_of(data, name)}
    elif name.lower().endswith(".json"):
        document = json_of(data, name)
        found = document.get("LANDSAT_METADATA_FILE") if isinstance(document, Mapping) else None
    else:
        found = groups_of(text_of(data, name))
    groups = {k: v for k, v in found.items() if isinstance(v, Mapping)} if isinstance(found, Mapping) else {}
    if not any(g in groups for pair in _MTL_GROUPS.values() for g in pair):
        raise MetadataError(f"{name} is damaged: it has no factors of reflectance")
    return groups


def _band(path: str, name: str, digit: str, level: str, groups: Groups) -> ProductBand:
    factors, limits = (groups.get(g, {}) for g in _MTL_GROUPS[level])
    scale = positive(factors.get(f"REFLECTANCE_MULT_BAND_{digit}"))
    offset = number(factors.get(f"REFLECTANCE_ADD_BAND_{digit}"))
    full = positive(limits.get(f"QUANTIZE_CAL_MAX_BAND_{digit}")) or FULL
    centre, width = CIRRUS if digit == "9" else (None, None)
    band = ProductBand(path, name, wavelength=centre, width=width, nodata=0.0, saturation=full)
    if scale is None or offset is None:
        if level == "1":
            return band
        scale, offset = SURFACE
    return replace(band, scale=scale, offset=offset, unit="reflectance")
