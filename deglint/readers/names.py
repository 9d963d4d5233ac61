"""Information in the name of a band: wavelength ("Blue-444", "490 nm"), colour ("Red Edge") and code ("SR_B2").

Colour words give only nominal wavelengths (a "red" band is assumed to be near 660 nm). A code such as "B8" depends on
the sensor and is interpreted by the sensor presets.
"""

import re
from collections.abc import Sequence

_WORDS = {
    425.0: "violet",
    440.0: "coastal coastalblue coastalaerosol aerosol ultrablue deepblue",
    485.0: "blue",
    531.0: "greeni green1",
    555.0: "green",
    565.0: "greenii green2",
    605.0: "yellow",
    620.0: "orange",
    660.0: "red",
    705.0: "rededge1 rededge70 rededge71 rededge071",
    720.0: "rededge",
    740.0: "rededge2 rededge74 rededge75 rededge075",
    783.0: "rededge3 rededge78 rededge078",
    840.0: "nir nir1 nearinfrared nearinfrared1 nearir nearir1 broadnir nirbroad",
    865.0: "rededge4 narrownir nirnarrow nirn nir08",
    945.0: "nir09 watervapour watervapor",
    950.0: "nir2 nearinfrared2 nearir2",
    1375.0: "cirrus",
    1610.0: "swir swir1 swir16",
    2200.0: "swir2 swir22",
}
"""Colour words (lower case, letters and digits only), by their nominal centre [nm]."""
NOMINAL = {word: centre for centre, words in _WORDS.items() for word in words.split()}  # [nm]

_LETTERS = {"c": 440.0, "b": 485.0, "g": 555.0, "y": 605.0, "r": 660.0, "re": 720.0, "n": 840.0, "nir": 840.0}
"""Centres [nm] of colours that are given by letters; used only if the names of all bands are such letters."""

_WITH_UNIT = re.compile(
    r"(?<![\d.])(\d+(?:\.\d+)?)\s*(nm|nanomet(?:er|re)s?|um|[µμ]m|micromet(?:er|re)s?|microns?)(?![a-z])"
)
_NAME_PREFIX = (
    r"(?:(?:nbart|nbar|sr|toa|boa|refl|reflectance|srefl|surface|lambertian|l1c|l2a|adjusted|radiance|rad|rho[a-z]{0,3}|"
    r"rrs|image)[\s_\-.]+)*"
)
"""Prefixes that providers put before the name of a band, for its physical quantity (surface reflectance, ...)."""
_BARE = re.compile(
    _NAME_PREFIX + r"(band|b|wl|wavelength|lambda|r|rrs|rho[a-z]{0,3})?[\s_\-]*(\d{3,4}(?:\.\d+)?|[0-2]\.\d{2,})"
)
_CODE = re.compile(_NAME_PREFIX + r"(?:band|b)[\s_\-]*0*(\d{1,2}a?)(?:[\s_\-]*\d{2}m)?")
_RANGE = (380.0, 2500.0)  # a number in a name can be a wavelength in this range [nm]
_YEARS = (1970.0, 2100.0)  # a number without a unit in this range can be a year
_NEAR_NOMINAL = 0.4
"""A number beside a colour word is a wavelength if it differs from the nominal one by less than this share."""


def wavelength_in_name(name: str) -> float | None:
    """Wavelength [nm] given as a number in a name.

    A number is accepted with a unit, beside a colour word with a similar wavelength, or if the rest of the name is only
    a prefix. None if there is no such number.

    >>> wavelength_in_name("band_0.490"), wavelength_in_name("865 nm"), wavelength_in_name("B08")
    (490.0, 865.0, None)
    >>> wavelength_in_name("Blue-444"), wavelength_in_name("Red edge 705"), wavelength_in_name("nir_2016")
    (444.0, 705.0, None)
    """
    text = name.strip().lower()
    if spelled := _WITH_UNIT.search(text):
        value = float(spelled[1]) * (1 if spelled[2].startswith("n") else 1000)
        return round(value, 6) if 100 <= value <= 20000 else None
    if bare := _BARE.fullmatch(text):
        number = float(bare[2])
        if number < 3:
            return round(number * 1000, 6)
        year = _YEARS[0] <= number <= _YEARS[1] and bare[0] == bare[2]
        return number if _RANGE[0] <= number <= _RANGE[1] and not year else None
    nominal = nominal_wavelength(name) or 0.0
    numbers = {float(n) for n in re.findall(r"(?<![\d.])\d{3,4}(?![\d.])", text)}
    fits = [n for n in numbers if abs(n - nominal) < _NEAR_NOMINAL * nominal]
    return fits[0] if len(fits) == 1 else None


def nominal_wavelength(name: str) -> float | None:
    """Nominal wavelength [nm] of the colour word in a name; None if it has none, or words of several colours.

    >>> nominal_wavelength("Red Edge"), nominal_wavelength("B5 - Near Infrared"), nominal_wavelength("pan")
    (720.0, 840.0, None)
    """
    words = re.findall(r"[a-z]+\d*|\d+", name.lower())
    for length in (3, 2, 1):
        joined = ("".join(words[i : i + length]) for i in range(len(words) - length + 1))
        if found := {NOMINAL[word] for word in joined if word in NOMINAL}:
            return found.pop() if len(found) == 1 else None
    return None


def letter_wavelengths(names: Sequence[str]) -> list[float | None]:
    """Nominal wavelengths [nm] of bands that are all called by letters (R, G, B, NIR); otherwise None for each."""
    folded = [n.strip().lower() for n in names]
    letters = len(set(folded)) == len(folded) >= 2 and all(n in _LETTERS for n in folded)
    return [_LETTERS[n] if letters else None for n in folded]


def band_code(name: str) -> str | None:
    """The code in the name of a band, without leading zeros: "2" for "SR_B02"; None if there is none."""
    found = _CODE.fullmatch(name.strip().lower())
    return found[1] if found else None


def plain_name(name: str) -> str:
    """The name of a band without the prefix for its quantity, in lower case: "b2" for "SR_B2"."""
    text = name.strip().lower()
    rest = re.sub("^" + _NAME_PREFIX, "", text)
    return rest or text


def example_names(count: int) -> str:
    """Example of `count` names for `--bands`, for messages; it is abbreviated for more than 20 bands."""
    if count > 20:
        return f"b1,b2,...,b{count}"
    return ",".join([*("blue", "green", "red")[: count - 1], "nir", *(f"b{i}" for i in range(5, count + 1))])
