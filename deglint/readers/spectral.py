"""Properties of bands from the tags of a file: wavelength, width, time offset, and saturation.

Tags have many spellings. A number without a unit is in micrometres up to 30 and in nanometres above.
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
_LARGEST_MICROMETRE = 30.0  # a wavelength without a unit up to this number is in micrometres
_WIDEST_MICROMETRE = 1.0  # a width without a unit below this number is in micrometres
SPECTRAL_RANGE = (100.0, 20000.0)  # a number in a tag can be a wavelength in this range [nm]
_WIDEST_FILLED_TYPE = 16  # detectors fill the range of integers of up to so many bits
Spectral = tuple[float | None, float | None]
"""Centre wavelength and full width at half maximum of a band [nm]; None if not known."""


def spectral_of(info: RasterInfo) -> list[Spectral]:
    """Wavelength and width of every band, from the tags of the band, else from a list in the tags of the file."""
    unit = _first(info.tags, _UNIT_TAG, "")
    wavelengths, widths = (_stated(info.tags, key, info.count) for key in (_WAVELENGTH, _WIDTH_TAG))
    unknown: list[tuple[float | None, str]] = [(None, "")]
    found: list[Spectral] = []
    for i, tags in enumerate(info.band_tags):
        own_unit = _first(tags, _UNIT_TAG, unit)
        ((value, stated),) = _stated(tags, _WAVELENGTH, 1) or wavelengths[i : i + 1] or unknown
        wavelength = None if value is None else nanometres(value, stated or own_unit)
        if wavelength is None or not SPECTRAL_RANGE[0] <= wavelength <= SPECTRAL_RANGE[1]:
            found.append((None, None))
            continue
        ((width, stated),) = _stated(tags, _WIDTH_TAG, 1) or widths[i : i + 1] or unknown
        if width is not None:
            width = nanometres(width, stated or own_unit or ("um" if width < _WIDEST_MICROMETRE else "nm"))
        found.append((wavelength, width))
    return found


def with_spectral(info: RasterInfo, spectra: Sequence[Spectral]) -> RasterInfo:
    """A copy of `info` with these wavelengths and widths in the tags of its bands; None keeps the tag of the file."""
    every = []
    for own, (wavelength, width) in zip(info.band_tags, spectra, strict=True):
        facts = {"wavelength_nm": wavelength, "fwhm_nm": width}
        tags = {name: f"{value:.10g}" for name, value in facts.items() if value is not None}
        every.append({**own, "": {**own.get("", {}), **tags}})
    return replace(info, band_tags=tuple(every))


def own_facts(info: RasterInfo) -> RasterInfo:
    """A copy of `info` with wavelength, width and full scale in each band's tags; missing ones come from the file's."""
    info = with_spectral(info, spectral_of(info))
    if not (full := _first(info.tags, _FULL_SCALE, "")):
        return info
    tags = ({**t, "": {"FULL_SCALE": _first(t, _FULL_SCALE, full), **t.get("", {})}} for t in info.band_tags)
    return replace(info, band_tags=tuple(tags))


def time_offset(tags: Mapping[str, Mapping[str, str]]) -> float | None:
    """Time of a band after the first band [s], from its tag `time_offset_s`; None without that tag."""
    return number(_first(tags, re.compile("time_offset_s"), ""))


def saturation(info: RasterInfo, band: int) -> float | None:
    """Physical value from which on a band is saturated; None if not known.

    `band` is 0-based. The tag FULL_SCALE of the band or of the file has the file value. Without this tag, it is the
    largest value of an integer type of up to 16 bits, as wider types are never filled. None if that value is nodata.
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
    """The value of the first tag whose name matches `key`, in any namespace; `default` if there is none."""
    return next((value for value, _ in _matching(tags, key)), default)


def _matching(tags: Mapping[str, Mapping[str, str]], key: re.Pattern[str]) -> list[tuple[str, re.Match[str]]]:
    named = [(name, value) for space in tags.values() for name, value in space.items()]
    named.sort(key=lambda one: not one[0].endswith("_nm"))  # the tags that `with_spectral` writes come first
    fits = [(value, key.fullmatch(re.sub(r"[\s\-]+", "_", name.strip().lower()))) for name, value in named]
    return [(value, match) for value, match in fits if match]


def _stated(tags: Mapping[str, Mapping[str, str]], key: re.Pattern[str], count: int) -> list[tuple[float, str]]:
    """The numbers, each with its unit or "", in the first tag that matches `key` and has `count` numbers; else none."""
    for value, match in _matching(tags, key):
        numbers = _NUMBER_PATTERN.findall(value)
        if len(numbers) == count:
            rest = value.replace(numbers[0], "").strip(" {}[]()") if count == 1 else ""
            return [(float(n), rest or next(filter(None, match.groups()), "")) for n in numbers]
    return []


def nanometres(value: float, unit: str = "") -> float | None:
    """Convert a wavelength to nm; without a unit, it is in um up to 30, else in nm. None for frequencies and the like.

    >>> nanometres(0.49), nanometres(490, "nm"), nanometres(0.49, "Micrometers")
    (490.0, 490, 490.0)
    """
    name = unit.strip().lower()
    if name in ("wavenumber", "index", "ghz", "mhz"):
        return None
    micrometres = name.startswith(("um", "µm", "μm", "micro")) or (name[:1] != "n" and value <= _LARGEST_MICROMETRE)
    return round(value * 1000, 6) if micrometres else value
