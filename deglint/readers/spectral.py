"""Wavelength and other properties of a band, from the tags of a file and from the name of the band.

Names of tags have many spellings. A wavelength without a unit is in micrometres if at most 30, else in nanometres. The
name of a band may contain a wavelength ("Blue-444", "490 nm"), a colour ("Red Edge") or a code ("SR_B2"). A colour only
gives a nominal wavelength (660 nm for "red"). What a code such as "B8" means depends on the sensor (`deglint.sensors`).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..raster import RasterInfo
from .text import number

_WAVELENGTH = re.compile(r"(?:cent(?:er|re|ral)_?)?wave_?lengths?(?:_(nm|um))?|wl(?:_(nm|um))?")
_WIDTH_TAG = re.compile(r"(?:fwhm|bandwidth|band_width)(?:_(nm|um))?")
_UNIT_TAG = re.compile(r"wave_?lengths?_units?")
_FULL_SCALE = re.compile("full_scale")
_NUMBER_PATTERN = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|[-+]?\.\d+")
_LARGEST_MICROMETRE = 30.0  # a wavelength without a known unit up to this number is in micrometres
_WIDEST_MICROMETRE = 0.99  # a width without a known unit up to this number is in micrometres
SPECTRAL_RANGE = (100.0, 20000.0)  # of wavelengths that are accepted in tags, or with a unit in names [nm]
_WIDEST_FILLED_TYPE = 16  # integer types of up to this number of bits are assumed to saturate at their largest value
Spectral = tuple[float | None, float | None]
"""Centre wavelength and full width at half maximum of a band [nm]; None if not known."""

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

_UNIT = r"\s*(nm|nanomet(?:er|re)s?|um|[µμ]m|micromet(?:er|re)s?|microns?)(?![a-z])"
_WITH_UNIT = re.compile(rf"(?<![\d.])(\d+(?:\.\d+)?){_UNIT}")
# the lower end has 3 digits or a decimal point: "Band 2 - 2.2 um" is no range
_ENDS = re.compile(
    rf"(?<![\d.])(\d{{3,}}(?:\.\d+)?|\d*\.\d+)(?:{_UNIT})?\s*(?:[-~\u2010-\u2014]|to)\s*(\d*\.?\d+){_UNIT}"
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
_RANGE = (380.0, 2500.0)  # a number without a unit in a name can be a wavelength in this range [nm]
_YEARS = (1970.0, 2100.0)  # a number without a unit in this range can be a year
_NEAR_NOMINAL = 0.4
"""A number beside a colour word is a wavelength if it differs from the nominal one by less than this share."""


def spectral_of(info: RasterInfo) -> list[Spectral]:
    """Centre wavelength and width [nm] of every band, from its own tags, else from a list in the tags of the file."""
    unit = _first(info.tags, _UNIT_TAG, "")
    lists = {key: _stated(info.tags, key, info.count) for key in (_WAVELENGTH, _WIDTH_TAG)}

    def of_band(i: int, key: re.Pattern[str], most: float) -> float | None:
        tags = info.band_tags[i]
        if not (found := _stated(tags, key, 1) or lists[key][i : i + 1]):
            return None
        ((value, stated),) = found
        return nanometres(value, stated or _first(tags, _UNIT_TAG, unit), most)

    waves = [of_band(i, _WAVELENGTH, _LARGEST_MICROMETRE) for i in range(info.count)]
    known = [w is not None and SPECTRAL_RANGE[0] <= w <= SPECTRAL_RANGE[1] for w in waves]
    return [(w, of_band(i, _WIDTH_TAG, _WIDEST_MICROMETRE)) if known[i] else (None, None) for i, w in enumerate(waves)]


def with_spectral(info: RasterInfo, spectra: Sequence[Spectral]) -> RasterInfo:
    """A copy of `info` with `spectra`, one per band, in the tags of the bands; if a value is None, the tag is kept."""
    every = []
    for own, (wavelength, width) in zip(info.band_tags, spectra, strict=True):
        facts = {"wavelength_nm": wavelength, "fwhm_nm": width}
        tags = {name: f"{value:.10g}" for name, value in facts.items() if value is not None}
        every.append({**own, "": {**own.get("", {}), **tags}})
    return replace(info, band_tags=tuple(every))


def own_facts(info: RasterInfo) -> RasterInfo:
    """A copy of `info` where bands without wavelength, width or FULL_SCALE (saturation) get the values of the file."""
    info = with_spectral(info, spectral_of(info))
    if not (full := _first(info.tags, _FULL_SCALE, "")):
        return info
    tags = ({**t, "": {"FULL_SCALE": _first(t, _FULL_SCALE, full), **t.get("", {})}} for t in info.band_tags)
    return replace(info, band_tags=tuple(tags))


def time_offset(tags: Mapping[str, Mapping[str, str]]) -> float | None:
    """Time of a band after the first band [s], from its tag `time_offset_s`; None if it has no such tag."""
    return number(_first(tags, re.compile("time_offset_s"), ""))


def saturation(info: RasterInfo, band: int) -> float | None:
    """Physical value from which on a band (0-based index `band`) is saturated; None if it is not known.

    The file value is read from the tag FULL_SCALE of the band or file. Without this tag, it is the largest value of an
    integer type of up to 16 bits. Returns None if this file value is nodata, or if the scale is not positive.
    """
    stored = number(_first(info.band_tags[band], _FULL_SCALE, _first(info.tags, _FULL_SCALE, "")))
    kind = np.dtype(info.dtypes[band])
    if stored is None and kind.kind in "iu" and kind.itemsize * 8 <= _WIDEST_FILLED_TYPE:
        stored = float(np.iinfo(kind).max)
    scale, offset = info.scales[band], info.offsets[band]
    if stored is None or stored == info.nodatas[band] or scale <= 0:
        return None
    return stored * scale + offset


def _first(tags: Mapping[str, Mapping[str, str]], key: re.Pattern[str], default: str) -> str:
    """The value of the first tag, in any namespace, whose name matches `key`; `default` if there is none."""
    return next((value for value, _ in _matching(tags, key)), default)


def _matching(tags: Mapping[str, Mapping[str, str]], key: re.Pattern[str]) -> list[tuple[str, re.Match[str]]]:
    named = [(name, value) for space in tags.values() for name, value in space.items()]
    named.sort(key=lambda one: not one[0].endswith("_nm"))  # the tags that `with_spectral` writes come first
    fits = [(value, key.fullmatch(re.sub(r"[\s\-]+", "_", name.strip().lower()))) for name, value in named]
    return [(value, match) for value, match in fits if match]


def _stated(tags: Mapping[str, Mapping[str, str]], key: re.Pattern[str], count: int) -> list[tuple[float, str]]:
    """Numbers, each with its unit or "", in the first tag that matches `key` and has `count` numbers; [] if none."""
    for value, match in _matching(tags, key):
        numbers = _NUMBER_PATTERN.findall(value)
        if len(numbers) == count:
            rest = value.replace(numbers[0], "").strip(" {}[]()") if count == 1 else ""
            return [(float(n), rest or next(filter(None, match.groups()), "")) for n in numbers]
    return []


def nanometres(value: float, unit: str = "", most: float = _LARGEST_MICROMETRE) -> float | None:
    """Convert a wavelength to nm. Without known unit, values up to `most` are um. Returns None for wavenumber, GHz, ...

    >>> nanometres(0.49), nanometres(490, "nm"), nanometres(0.49, "Micrometers"), nanometres(4900, "Angstroms")
    (490.0, 490, 490.0, 490.0)
    """
    name = unit.strip().lower()
    if name in ("wavenumber", "1/cm", "cm-1", "index", "ghz", "mhz"):
        return None
    if name.startswith(("angstrom", "ångström", "å")):
        return round(value / 10, 6)
    if name.startswith(("nm", "nano")):
        return value
    micrometres = name.startswith(("um", "µm", "μm", "micro")) or value <= most
    return round(value * 1000, 6) if micrometres else value


def wavelength_in_name(name: str) -> float | None:
    """Wavelength [nm] given as a number in a name; None if no number counts as a wavelength.

    A number with a unit counts from 100 to 20,000 nm; for a range ("450-520 nm"), the middle is returned. Without a
    unit, there are two cases. If the name is only a number, perhaps after a prefix ("band"), the number counts from 380
    to 2500 (nm), or if it is a decimal below 3 (um); but from 1970 to 2100 a prefix is needed, as it may be a year. If
    the name has a colour word, a number counts if it is the only one within 40 % of the colour's nominal wavelength.

    >>> wavelength_in_name("band_0.490"), wavelength_in_name("865 nm"), wavelength_in_name("B08")
    (490.0, 865.0, None)
    >>> wavelength_in_name("Blue 450-520 nm"), wavelength_in_name("0.52-0.60 um")
    (485.0, 560.0)
    >>> wavelength_in_name("Blue-444"), wavelength_in_name("Red edge 705"), wavelength_in_name("nir_2016")
    (444.0, 705.0, None)
    """
    text = name.strip().lower()
    if spelled := _WITH_UNIT.search(text):
        value = nanometres(float(spelled[1]), spelled[2]) or 0.0
        ends = _ENDS.search(text)
        if ends and ends.start() <= spelled.start():  # else the centre stands before the range
            low, high = (nanometres(float(n), ends[4]) or 0.0 for n in (ends[1], ends[3]))
            value = round((low + high) / 2, 6) if SPECTRAL_RANGE[0] <= low < high else value
        return value if SPECTRAL_RANGE[0] <= value <= SPECTRAL_RANGE[1] else None
    if bare := _BARE.fullmatch(text):
        value = float(bare[2])
        if value < 3:
            return round(value * 1000, 6)
        year = _YEARS[0] <= value <= _YEARS[1] and bare[0] == bare[2]
        return value if _RANGE[0] <= value <= _RANGE[1] and not year else None
    nominal = nominal_wavelength(name) or 0.0
    numbers = {float(n) for n in re.findall(r"(?<![\d.])\d{3,4}(?![\d.])", text)}
    fits = [n for n in numbers if abs(n - nominal) < _NEAR_NOMINAL * nominal]
    return fits[0] if len(fits) == 1 else None


def nominal_wavelength(name: str) -> float | None:
    """Nominal wavelength [nm] of the colour word in a name; None if it has no colour word or several colours.

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
    """Nominal wavelengths [nm] of two or more bands named by different letters (R, G, B, NIR); all None otherwise."""
    folded = [n.strip().lower() for n in names]
    letters = len(set(folded)) == len(folded) >= 2 and all(n in _LETTERS for n in folded)
    return [_LETTERS[n] if letters else None for n in folded]


def band_code(name: str) -> str | None:
    """The code in the name of a band, without leading zeros: "2" for "SR_B02"; None if there is none."""
    found = _CODE.fullmatch(name.strip().lower())
    return found[1] if found else None


def plain_name(name: str) -> str:
    """The name of a band in lower case, without a prefix for its physical quantity: "b2" for "SR_B2"."""
    text = name.strip().lower()
    return re.sub("^" + _NAME_PREFIX, "", text) or text


def example_names(count: int) -> str:
    """Example of `count` band names for the option --bands, for messages; abbreviated for more than 20 bands."""
    if count > 20:
        return f"b1,b2,...,b{count}"
    return ",".join([*("blue", "green", "red")[: count - 1], "nir", *(f"b{i}" for i in range(5, count + 1))])
