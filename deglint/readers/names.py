"""What a band's name says of its wavelength: "NIR1", "Red Edge", "band_0.490", "490 nm".

Words give nominal wavelengths only (a "red" band is taken to be near 660 nm). Numbers such as "B8" mean
another band with every sensor and are left to the sensor presets.
"""

from __future__ import annotations

import re

NOMINAL = {
    "coastal": 440.0,
    "coastalblue": 440.0,
    "coastalaerosol": 440.0,
    "ultrablue": 440.0,
    "blue": 485.0,
    "greeni": 531.0,
    "green": 555.0,
    "greenii": 565.0,
    "yellow": 605.0,
    "red": 660.0,
    "rededge": 720.0,
    "rededge1": 705.0,
    "rededge2": 740.0,
    "rededge3": 783.0,
    "nir": 840.0,
    "nir1": 840.0,
    "nearinfrared": 840.0,
    "nearinfrared1": 840.0,
    "nearir": 840.0,
    "nearir1": 840.0,
    "narrownir": 865.0,
    "nirnarrow": 865.0,
    "nir08": 865.0,
    "nir09": 945.0,
    "nir2": 950.0,
    "nearinfrared2": 950.0,
    "nearir2": 950.0,
    "cirrus": 1375.0,
    "swir": 1610.0,
    "swir1": 1610.0,
    "swir16": 1610.0,
    "swir2": 2200.0,
    "swir22": 2200.0,
}
"""Nominal centre [nm] of a colour word (lower case, letters and digits only)."""

_WITH_UNIT = re.compile(
    r"(?<![\d.])(\d+(?:\.\d+)?)\s*(nm|nanomet(?:er|re)s?|um|[µμ]m|micromet(?:er|re)s?|microns?)(?![a-z])"
)
_BARE = re.compile(r"(?:band|b|wl|lambda|r|rrs|rho[a-z]{0,3})?[\s_\-]*(\d{3,4}(?:\.\d+)?|[0-2]\.\d{2,})")
_BARE_RANGE = (380.0, 1100.0)  # a bare whole number outside this is no wavelength (a year, say)


def wavelength_in_name(name: str) -> float | None:
    """Wavelength [nm] that a name spells out as a number.

    >>> wavelength_in_name("band_0.490"), wavelength_in_name("865 nm"), wavelength_in_name("B08")
    (490.0, 865.0, None)
    """
    text = name.strip().lower()
    spelled = _WITH_UNIT.search(text)
    if spelled:
        value = float(spelled[1]) * (1 if spelled[2].startswith("n") else 1000)
        return round(value, 6) if 100 <= value <= 20000 else None
    bare = _BARE.fullmatch(text)
    if not bare:
        return None
    number = float(bare[1])
    if number < 3:
        return round(number * 1000, 6)
    return number if _BARE_RANGE[0] <= number <= _BARE_RANGE[1] else None


def nominal_wavelength(name: str) -> float | None:
    """Nominal wavelength [nm] of a colour word in a name, or None.

    >>> nominal_wavelength("Red Edge"), nominal_wavelength("B5 - Near Infrared"), nominal_wavelength("pan")
    (720.0, 840.0, None)
    """
    words = re.findall(r"[a-z]+\d*|\d+", name.lower())
    for length in range(min(3, len(words)), 0, -1):
        found = {
            NOMINAL[joined]
            for i in range(len(words) - length + 1)
            if (joined := "".join(words[i : i + length])) in NOMINAL
        }
        if found:
            return found.pop() if len(found) == 1 else None
    return None
