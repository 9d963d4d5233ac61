"""Parsing of metadata: XML, JSON and lines of groups as one kind of tree; numbers, texts and angles in it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree as ET

from ...errors import InputError


class MetadataError(InputError):
    """Metadata are damaged, or have the wrong format."""


def xml_of(data: bytes, name: str) -> ET.Element:
    """The root of an XML document; namespaces are removed from tags."""
    try:
        root = ET.fromstring(data)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise MetadataError(f"{name} is damaged: {error}") from error
    for node in root.iter():
        node.tag = node.tag.rpartition("}")[2]
    return root


def tree_of(data: bytes, name: str) -> ET.Element:
    """Metadata in XML, in JSON, or in lines of groups (MTL, IMD, TIL) as one tree: objects and groups are elements."""
    if name.lower().endswith(".xml"):
        return xml_of(data, name)
    if not name.lower().endswith(".json"):
        return _grown("", groups_of(data.decode("utf-8-sig", errors="replace")))
    try:
        return _grown("", json.loads(data))
    except ValueError as error:
        raise MetadataError(f"{name} is damaged: it is not JSON") from error


def _grown(tag: str, value: Any) -> ET.Element:
    """An element with a value, or with one element for each entry of an object; lists are left out."""
    node = ET.Element(tag)
    if isinstance(value, Mapping):
        node.extend(_grown(str(k), v) for k, v in value.items())
    elif isinstance(value, (str, int, float)):
        node.text = str(value)
    return node


def groups_of(text: str) -> dict[str, dict[str, str]]:
    """The values in a text of lines "NAME = value" with GROUP and END_GROUP lines (MTL, IMD, TIL), by group.

    Names are in capitals. Values outside of groups stand under "". A value in several lines is left out.

    >>> groups_of('a = 1;\\nBEGIN_GROUP = BAND_R\\n\\tb = "x";\\nEND_GROUP = BAND_R')
    {'': {'A': '1'}, 'BAND_R': {'B': 'x'}}
    """
    found: dict[str, dict[str, str]] = {"": {}}
    inside = [""]
    for line in text.splitlines():
        name, sign, value = (part.strip() for part in line.partition("="))
        if not sign:
            continue
        value = value.rstrip(";").strip().strip('"')
        if name in ("GROUP", "BEGIN_GROUP"):
            inside.append(value)
        elif name == "END_GROUP":
            inside = inside[:-1] or [""]
        elif value != "(":
            found.setdefault(inside[-1], {})[name.upper()] = value
    return found


def number(value: Any) -> float | None:
    """A finite number, or None."""
    try:
        found = float(value)
    except (TypeError, ValueError):
        return None
    return found if math.isfinite(found) else None


def positive(value: Any) -> float | None:
    """A finite number above 0, or None."""
    found = number(value)
    return found if found is not None and found > 0 else None


def numbers(text: str | None) -> list[float]:
    """The numbers in a text, separated by blanks or commas; empty if any is not a number."""
    found = [number(part) for part in (text or "").replace(",", " ").split()]
    return [] if None in found else [n for n in found if n is not None]


def said(node: ET.Element | None, *paths: str) -> str:
    """Text of the first element found at some paths below a node, or ""."""
    found = [] if node is None else [(node.findtext(path) or "").strip() for path in paths]
    return next(filter(None, found), "")


def said_number(node: ET.Element | None, *paths: str) -> float | None:
    """The same as a finite number, or None."""
    return number(said(node, *paths))


def tags_of(facts: Mapping[str, Any]) -> dict[str, str]:
    """Non-empty values as short texts."""
    return {k: str(v).strip()[:200] for k, v in facts.items() if v not in (None, "")}


EARTH_RADIUS = 6_371_000.0
"""Mean radius of the Earth [m]."""
ORBIT = 600_000.0
"""Altitude of a satellite if not known [m]: imaging satellites fly at 450 to 800 km, which changes an incidence angle
of 20 degrees by at most 0.7 degrees."""
NADIR = 0.5
"""Off-nadir angle below which no azimuth is needed [degree]: it does not affect the reflected light."""


def angle_tags(
    *,
    sun_elevation: Any = None,
    sun_azimuth: Any = None,
    incidence: float | None = None,
    off_nadir: float | None = None,
    view_azimuth: float | None = None,
    altitude: float = ORBIT,
) -> dict[str, Any]:
    """Tags of the directions of sun and sensor, seen from the ground [degree]; azimuths are clockwise from north.

    The sensor's elevation is 90 - incidence. If only the off-nadir angle is known, which is measured at the satellite,
    sin(incidence) = (1 + altitude / radius of the Earth) sin(off_nadir).
    """
    if incidence is None and off_nadir is not None:
        sine = (1.0 + altitude / EARTH_RADIUS) * math.sin(math.radians(abs(off_nadir)))
        incidence = math.degrees(math.asin(sine)) if sine <= 1.0 else None
    if incidence is not None and abs(incidence) <= NADIR and view_azimuth is None:
        view_azimuth = 0.0
    return {
        "sun_elevation": sun_elevation,
        "sun_azimuth": sun_azimuth,
        "view_elevation": None if incidence is None else round(90.0 - abs(incidence), 4),
        "view_azimuth": None if view_azimuth is None else round(view_azimuth, 4) % 360.0,
    }
