"""Landsat 8 and 9, Collection 2, Level 1 and Level 2: a folder, a .tar, or an MTL file (*_MTL.txt, .json or .xml).

GDAL has no driver for these products: each band is a GeoTIFF, and only the MTL file has scale and offset. The MTL file
of Level 2 also has the factors of Level 1, under the same names, so factors are read from the group of their level.
"""

import math
from dataclasses import replace
from xml.etree import ElementTree as ET

from ..text import positive
from .metadata import FULL, Container, Product, ProductBand, said, said_number, tags_of, view_tags

METADATA = r"(?P<scene>L[CO]0[89]_.*)_MTL\.(?:txt|json|xml)"
IMAGES = r"(?P<scene>L[CO]0[89]_L[12].*?)_(?P<band>(?:SR_)?B(?P<number>[1-79]))\.tiff?"
NAMED_IN_IMAGES = True
_LEVEL2 = "LEVEL2_SURFACE_REFLECTANCE_PARAMETERS"
_MTL_GROUPS = {"1": ("LEVEL1_RADIOMETRIC_RESCALING", "LEVEL1_MIN_MAX_PIXEL_VALUE"), "2": (_LEVEL2, _LEVEL2)}
"""For each level, two groups of the MTL file: that with scales and offsets, and that with the largest file values."""
FACTORS = {"1": (2e-05, -0.1), "2": (2.75e-05, -0.2)}
"""Scale and offset of all products of each level of Collection 2 (USGS), used if the MTL file is missing."""
LANDSAT_ORBIT = 705_000.0
"""Altitude of Landsat 8 and 9 [m], to convert ROLL_ANGLE (0, in a few scenes about 15 degrees) to incidence angles."""
CIRRUS = (1373.5, 20.0)  # centre and width of B9 [nm] (USGS: 1363-1384 nm); the preset has only the bands 1 to 7


def find(container: Container) -> Product | None:
    """The product in `container`, or None. If the user named an image in it, the product has only this band."""
    named, images, texts = container.named, container.matches(IMAGES), container.matches(METADATA)
    if named is not None:
        scene_of = {n: m["scene"] for n, m in texts}
        images = [(n, m) for n, m in images if named == n or scene_of.get(named) == m["scene"]]
    if not images:
        return None
    scenes = sorted({m["scene"] for _, m in images})
    scene = container.only(scenes, "Landsat scenes", scenes, "Name the *_MTL.txt file of one.")
    level = "2" if any(m["band"].upper().startswith("SR_") for _, m in images) else "1"
    own = sorted([n for n, m in texts if m["scene"] == scene], key=lambda n: (not n.lower().endswith(".txt"), n))
    root = container.tree(own[0], _MTL_GROUPS[level][0]) if own else None
    assumed = "scale {:g} and offset {:g} of all Level-{} products of Collection 2 are assumed"
    notes = [] if own else [f"{container.path} has no *_MTL.txt: {assumed.format(*FACTORS[level], level)}"]
    bands = [_band(container.gdal(n), m["band"].upper(), m["number"], level, root) for n, m in images]
    facts = None if root is None else root.find(".//IMAGE_ATTRIBUTES")
    elevation = said_number(facts, "SUN_ELEVATION")
    if level == "1" and elevation is not None and elevation > 0:
        notes.append(
            f"reflectance is not divided by the sine of the sun's elevation ({elevation:g} degrees, a factor of "
            f"{1 / math.sin(math.radians(elevation)):.3f} for the whole scene)"
        )
    angles: dict[str, object] = {"sun_elevation": elevation, "sun_azimuth": said(facts, "SUN_AZIMUTH")}
    angles |= view_tags(None, None, said_number(facts, "ROLL_ANGLE"), LANDSAT_ORBIT)
    when = "T".join(filter(None, (said(facts, "DATE_ACQUIRED"), said(facts, "SCENE_CENTER_TIME"))))
    tags = tags_of({"satellite": said(facts, "SPACECRAFT_ID"), "acquired": when} | angles)
    kind = f"Landsat {scene[3:4]} Level {level}"
    return Product(kind, scene, tuple(sorted(bands, key=lambda b: b.name)), "landsat8", tags, tuple(notes))


def _band(path: str, name: str, digit: str, level: str, root: ET.Element | None) -> ProductBand:
    factors, limits = _MTL_GROUPS[level]
    scale = positive(said(root, f".//{factors}/REFLECTANCE_MULT_BAND_{digit}"))
    offset = said_number(root, f".//{factors}/REFLECTANCE_ADD_BAND_{digit}")
    full = positive(said(root, f".//{limits}/QUANTIZE_CAL_MAX_BAND_{digit}")) or FULL
    centre, width = CIRRUS if digit == "9" else (None, None)
    band = ProductBand(path, name, wavelength=centre, width=width, nodata=0.0, saturation=full)
    if scale is None or offset is None:
        scale, offset = FACTORS[level]
    return replace(band, scale=scale, offset=offset, unit="reflectance")
