"""PlanetScope AnalyticMS and AnalyticMS_SR with 4 or 8 bands: a GeoTIFF, with metadata in *_metadata.xml or .json.

AnalyticMS is radiance; the XML has a factor for each band, which converts its file values to reflectance. AnalyticMS_SR
is surface reflectance; its scale is always 1/10000, and the factors in the XML do not apply to it.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from xml.etree import ElementTree as ET

from ... import sensors
from ..text import number, positive
from .metadata import PRODUCT_UNIT, Container, Product, ProductBand, last, said, said_number, tags_of, view_tags

METADATA = r"\d{8}_\d{6}_.*metadata.*\.(?:xml|json)"
IMAGES = r"(?P<scene>\d{8}_\d{6}_.*)_[13][AB]_AnalyticMS(?P<surface>_SR)?(?P<rest>(?:_.*)?)\.tiff?"
SURFACE_SCALE = 1e-4  # scale of surface reflectance, as Planet documents it; it is not in the metadata
DOVE_ORBIT = 500_000.0  # assumed altitude of the Doves [m]; they fly at 450 to 580 km
FOUR = ("blue", "green", "red", "nir")  # names of the bands of images with four bands
DOVE = ((485.0, 60.0), (545.0, 90.0), (630.0, 80.0), (820.0, 80.0))
"""Centres and widths [nm] of the first Doves (instrument PS2): 455-515, 500-590, 590-670 and 780-860 nm, from Planet's
product specification; the sensor presets are for later instruments."""


def find(container: Container) -> Product | None:
    """The product in `container`, or None. If the user named an image or its metadata file, only this image is used."""
    images = {n: match for n, match in container.matches(IMAGES) if "udm" not in n.lower()}
    named = container.named
    if named in images:
        images = {named: images[named]}
    elif named:
        stem = re.sub(r"(_[13][AB]_AnalyticMS.*)?_metadata.*$", "", last(named), flags=re.IGNORECASE)
        images = {n: match for n, match in images.items() if last(n).startswith(stem)}
    if not images:
        return None
    image, match = container.only(list(images.items()), "PlanetScope images", map(last, images))
    root, notes = ET.Element("scene"), list[str]()
    root.extend(container.tree(n) for n in container.find(METADATA) if last(n).startswith(match["scene"]))
    surface, nodes = match["surface"] is not None, root.iter("bandSpecificMetadata")
    factors = {int(place): node for node in nodes if (place := said(node, "bandNumber")).isdecimal()}
    instrument = said(root, ".//Instrument/shortName", ".//instrument")
    bands, sensor = _bands(container.gdal(image), "_8b" in match["rest"].lower() or len(factors) == 8, instrument)
    scales, unit = ([SURFACE_SCALE] * len(bands), "reflectance") if surface else _scales(factors, len(bands))
    if unit:
        bands = [replace(b, scale=s, unit=unit) for b, s in zip(bands, scales, strict=True)]
    else:
        remedy = "file values are used without scaling. Put this file beside the image, or give --scale"
        notes.append(f"*_metadata.xml with the scale is missing: {remedy}")
    view_angle = said(root, ".//spaceCraftViewAngle", ".//view_angle")
    facts: dict[str, object] = {
        "instrument": instrument,
        "acquired": said(root, ".//acquisitionDateTime", ".//acquired"),
        "view_angle": view_angle,
        "sun_elevation": said(root, ".//illuminationElevationAngle", ".//sun_elevation"),
        "sun_azimuth": said(root, ".//illuminationAzimuthAngle", ".//sun_azimuth"),
    }
    azimuth = said_number(root, ".//satellite_azimuth")  # azimuthAngle belongs to the image's lines
    tags = tags_of(facts | view_tags(said_number(root, ".//incidenceAngle"), azimuth, number(view_angle), DOVE_ORBIT))
    kind = f"PlanetScope AnalyticMS{'_SR' if surface else ''}, {len(bands)} bands"
    return Product(kind, match["scene"], tuple(bands), sensor, tags, tuple(notes))


def _scales(factors: Mapping[int, ET.Element], count: int) -> tuple[list[float], str]:
    """Scales to reflectance, else radiance, of bands 1 to `count` in `factors`, and the unit; [], "" if incomplete."""
    for name, unit in (("reflectanceCoefficient", "reflectance"), ("radiometricScaleFactor", PRODUCT_UNIT)):
        known = [s for i in range(1, count + 1) if (s := positive(said(factors.get(i), name)))]
        if len(known) == count:
            return known, unit
    return [], ""


def _bands(path: str, eight: bool, instrument: str) -> tuple[list[ProductBand], str | None]:
    """The four bands of an image (eight if `eight`), and the name of the sensor preset of its instrument, or None."""
    if eight:
        return [ProductBand(path, b.name, nodata=0.0) for b in sensors.load("planetscope8").bands], "planetscope8"
    sensor = {"PS2": None, "PSB.SD": "planetscope8", "PSB": "planetscope8"}.get(instrument, "planetscope4")
    optics = DOVE if instrument == "PS2" else ((None, None),) * len(FOUR)
    return [ProductBand(path, name, w, h, nodata=0.0) for name, (w, h) in zip(FOUR, optics, strict=True)], sensor
