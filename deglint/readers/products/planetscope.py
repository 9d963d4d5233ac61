"""PlanetScope AnalyticMS and AnalyticMS_SR with 4 or 8 bands, and their *_metadata.xml or .json.

The image is one GeoTIFF; the XML file says by which factor each band becomes reflectance. Surface reflectance is
always 1/10000, whatever factors the XML of the radiance product beside it has.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as ET

from ... import sensors
from ...errors import InputError
from .container import Container, last
from .metadata import MetadataError, angle_tags, flat, json_of, number, positive, said, tags_of, xml_of
from .product import Product, ProductBand

METADATA = r"\d{8}_\d{6}_.*metadata.*\.(?:xml|json)"
IMAGES = r"(?P<scene>\d{8}_\d{6}_.*)_[13][AB]_AnalyticMS(?P<surface>_SR)?(?P<rest>(?:_.*)?)\.tiff?"
SURFACE_SCALE = 1e-4
"""Of surface reflectance products, as Planet documents them; their metadata do not repeat it."""
ALTITUDE = 500_000.0
"""[m] Orbits of the Doves are 450 to 580 km high."""
FOUR = ("blue", "green", "red", "nir")
DOVE = ((485.0, 60.0), (545.0, 90.0), (630.0, 80.0), (820.0, 80.0))
"""Centres and widths [nm] of the first Doves (instrument PS2): 455-515, 500-590, 590-670 and 780-860 nm, from Planet's
product specification; the sensor presets are of the later ones."""


def find(container: Container) -> Product | None:
    """The product in a folder or archive; None where there is none."""
    images = [n for n in container.find(IMAGES) if "udm" not in n.lower()]
    named = container.named
    if named in images:
        images = [named] if named else []
    elif named:
        stem = re.sub(r"(_[13][AB]_AnalyticMS.*)?_metadata.*$", "", last(named), flags=re.IGNORECASE)
        images = [n for n in images if last(n).startswith(stem)]
    if not images:
        return None
    if len(images) > 1:
        raise InputError(
            f"{container.path} holds {len(images)} PlanetScope images: {', '.join(map(last, images[:4]))}. Name one."
        )
    match = re.fullmatch(IMAGES, last(images[0]), re.IGNORECASE)
    assert match is not None  # as `Container.find` takes no others
    files = [n for n in container.find(METADATA) if last(n).startswith(match["scene"])]
    root, facts, notes = _read(container, files)
    surface = match["surface"] is not None
    eight = "_8b" in match["rest"].lower() or len(_factors(root)) == 8
    instrument = said(root, ".//Instrument/shortName") or str(facts.get("instrument", ""))
    bands, sensor = _bands(container.gdal(images[0]), eight, instrument)
    bands, more = _scaled(bands, root, surface=surface)
    view_angle = said(root, ".//spaceCraftViewAngle") or facts.get("view_angle")
    tags = tags_of({
        "instrument": instrument,
        "acquired": said(root, ".//acquisitionDateTime") or facts.get("acquired"),
        "view_angle": view_angle,
    } | angle_tags(
        sun_elevation=said(root, ".//illuminationElevationAngle") or facts.get("sun_elevation"),
        sun_azimuth=said(root, ".//illuminationAzimuthAngle") or facts.get("sun_azimuth"),
        incidence=number(said(root, ".//incidenceAngle")),
        off_nadir=number(view_angle),
        view_azimuth=number(facts.get("satellite_azimuth")),  # the XML's azimuthAngle is that of the image's lines
        altitude=ALTITUDE,
    ))  # fmt: skip
    kind = f"PlanetScope AnalyticMS{'_SR' if surface else ''}, {len(bands)} bands"
    return Product(kind, match["scene"], container.asked, bands, sensor, tags, (*notes, *more))


def _read(container: Container, files: list[str]) -> tuple[ET.Element | None, Mapping[str, Any], list[str]]:
    """XML and JSON of a scene as far as they are there and sound, and what to say of those that are not."""
    root, facts, notes = None, {}, []
    for name in files:
        try:
            if name.lower().endswith(".xml"):
                root = xml_of(container.read(name), name)
            else:
                facts = dict(flat(json_of(container.read(name), name)))
        except MetadataError as error:
            notes.append(f"{error}, and is not used. Download it again")
    return root, facts, notes


def _factors(root: ET.Element | None) -> dict[int, tuple[float | None, float | None]]:
    """Factors to reflectance and to radiance [W m-2 sr-1 um-1] of each band, from 1."""
    found = {}
    for node in [] if root is None else root.iter("bandSpecificMetadata"):
        place = said(node, "bandNumber")
        if place.isdecimal():
            found[int(place)] = (
                positive(said(node, "reflectanceCoefficient")),
                positive(said(node, "radiometricScaleFactor")),
            )
    return found


def _bands(path: str, eight: bool, instrument: str) -> tuple[tuple[ProductBand, ...], str | None]:
    """Bands by count and instrument, and the preset that knows them."""
    if eight:
        names: tuple[str, ...] = tuple(b.name for b in sensors.load("planetscope8").bands)
        sensor: str | None = "planetscope8"
    else:
        names = FOUR
        sensor = {"PS2": None, "PSB.SD": "planetscope8", "PSB": "planetscope8"}.get(instrument, "planetscope4")
    optics = DOVE if instrument == "PS2" and not eight else ((None, None),) * len(names)
    return tuple(
        ProductBand(path, name, i, wavelength=w, width=h, nodata=0.0)
        for i, (name, (w, h)) in enumerate(zip(names, optics, strict=True), start=1)
    ), sensor


def _scaled(
    bands: tuple[ProductBand, ...], root: ET.Element | None, *, surface: bool
) -> tuple[tuple[ProductBand, ...], list[str]]:
    if surface:
        return tuple(replace(b, scale=SURFACE_SCALE, unit="reflectance") for b in bands), []
    factors = _factors(root)
    for which, unit in ((0, "reflectance"), (1, "W m-2 sr-1 um-1")):
        scales = [factors.get(b.number, (None, None))[which] for b in bands]
        if all(scales):
            found = zip(bands, scales, strict=True)
            return tuple(replace(b, scale=s or 1.0, unit=unit) for b, s in found), []
    remedy = "they are taken as they stand. Put it beside the image, or give --scale"
    return bands, [f"no *_metadata.xml says how the numbers become reflectance: {remedy}"]
