"""The bands of a scene: what each is called and its wavelength, from tags, names and the sensor's preset."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from .. import sensors
from ..errors import BandError
from ..raster import RasterInfo
from ..scene import Band
from ..sensors import Sensor
from .names import band_code, letter_wavelengths, nominal_wavelength, only_numbered, short_names, wavelength_in_name
from .presets import apply_sensor, named_in, sensor_in_tags
from .sensorfile import sensor_of
from .spectral import said_of_wavelength, saturation, spectral_of, time_offset

_NOT_NAMES = ("gray", "undefined", "palette", "alpha")
_SENTINEL2 = re.compile(r"b0\d|b0?8a")
_PRESET_TITLES = {"sentinel2": "Sentinel-2", "landsat8": "Landsat 8 or 9"}


def bands_of(info: RasterInfo, stems: Sequence[str], sensor: str | None) -> tuple[list[Band], str | None, list[str]]:
    """Bands of a scene, the sensor preset that was used, and what to say; `stems` are names for bands without one."""
    names, unnamed = _names(info, stems)
    spectra = spectral_of(info)
    bands = [
        Band(
            name=name,
            wavelength=known.wavelength or (None if i in unnamed else _spelled(name, i)),
            width=known.width,
            time_offset=time_offset(info.band_tags[i]),
            saturation=saturation(info, i),
        )
        for i, (name, known) in enumerate(zip(names, spectra, strict=True))
    ]
    notes = []
    if any(s.assumed for s in spectra):
        notes.append("wavelengths have no unit: up to 30 they are read as micrometres, above as nanometres")
    bands, preset, told = _with_sensor(bands, info, sensor, unnamed)
    bands, guessed = _from_names(bands, unnamed)
    return bands, preset, notes + told + guessed


def labelled(info: RasterInfo, bands: Sequence[Band]) -> RasterInfo:
    """A description that says names, wavelengths and widths of the bands itself, so that an output does, too."""
    tags = tuple(
        said_of_wavelength(
            own, None if known.wavelength is not None else b.wavelength, None if known.width is not None else b.width
        )
        for own, b, known in zip(info.band_tags, bands, spectral_of(info), strict=True)
    )
    names = tuple(
        d if d or b.name == f"band {i}" else b.name
        for i, (d, b) in enumerate(zip(info.descriptions, bands, strict=True), start=1)
    )
    return replace(info, descriptions=names, band_tags=tags)


def _spelled(name: str, place: int) -> float | None:
    """Wavelength in a name, unless its number is the band's own: "Band 400" of a spectrometer."""
    found = wavelength_in_name(name)
    return None if found == place + 1 and nominal_wavelength(name) is None else found


def _with_sensor(
    bands: list[Band], info: RasterInfo, sensor: str | None, unnamed: frozenset[int]
) -> tuple[list[Band], str | None, list[str]]:
    if sensor is not None:
        asked = sensor_of(sensor)
        bands, notes = apply_sensor(bands, asked, unnamed)
        # the file of a sensor of one's own is its name: it is looked up again by it
        return bands, sensor if sensor.lower().endswith(".toml") else asked.name, notes
    tagged = sensor_in_tags(info)
    if tagged is None:
        return bands, None, []
    try:
        bands, notes = apply_sensor(bands, tagged, unnamed)
    except BandError as error:
        return bands, None, [f"a tag names a sensor, which is not used: {error}"]
    return bands, tagged.name, notes


def _from_names(bands: list[Band], unnamed: frozenset[int]) -> tuple[list[Band], list[str]]:
    """Wavelengths that only the names tell: codes of a sensor that they are sure to be of, else colour words."""
    if all(b.wavelength is not None for b in bands):
        return bands, []
    notes = []
    sensor = _dialect([b.name for i, b in enumerate(bands) if i not in unnamed])
    letters = letter_wavelengths([b.name for b in bands])
    filled = []
    for i, (band, letter) in enumerate(zip(bands, letters, strict=True)):
        own = None if sensor is None or i in unnamed else named_in(band.name, sensor)
        nominal = own.wavelength if own else letter or (None if sensor else nominal_wavelength(band.name))
        filled.append(band if band.wavelength is not None else replace(band, wavelength=nominal))
    changed = [b.name for b, old in zip(filled, bands, strict=True) if b is not old and b.wavelength]
    if changed and sensor:
        notes.append(f"the names are {_PRESET_TITLES[sensor.name]}'s; their wavelengths are assumed")
    elif changed:
        notes.append(f"wavelengths of {', '.join(changed)} are nominal, from the names")
    return filled, notes


def _dialect(names: Sequence[str]) -> Sensor | None:
    """The sensor whose codes or words the names are sure to be, of those whose codes are not others' as well.

    Sentinel-2: B02 with its zero, B8A, B12; or B8 without B5, as Landsat's B8 is panchromatic. Landsat 8 and 9: SR_B6,
    which the surface reflectance of Landsat 4 to 7 lacks.
    """
    plain = [sensors.normalise(n) for n in names]
    codes = {c for n in names if (c := band_code(n))}
    if any(p.startswith("srb") for p in plain):
        return sensors.load("landsat8") if "6" in codes and codes <= set("1234567") else None
    if any(_SENTINEL2.fullmatch(p) for p in plain):
        return sensors.load("sentinel2")
    own = {band_code(b.name) for b in sensors.load("sentinel2").bands}
    sure = "8a" in codes or "12" in codes or (len(codes) > 2 and "8" in codes and "5" not in codes)
    if codes and codes <= own and sure:
        return sensors.load("sentinel2")
    if {"nbartswir3", "nbartnir2", "nbartrededge1"} & set(plain):
        return sensors.load("sentinel2")
    return None


def _names(info: RasterInfo, stems: Sequence[str]) -> tuple[list[str], frozenset[int]]:
    """One name a band: its description, else what its file or its colour is called, else "band N"; and which bands
    (0-based) have a name that says no more than their place."""
    names, unnamed = [], set()
    for i, (described, stem) in enumerate(zip(info.descriptions, short_names(stems), strict=True)):
        colour = info.colorinterp[i]
        name = (described or "").strip() or stem or ("" if colour in _NOT_NAMES else colour)
        if not name:
            unnamed.add(i)
        names.append(name or f"band {i + 1}")
    if only_numbered(names):
        unnamed = set(range(len(names)))
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        seen[name.casefold()] += 1
        if seen[name.casefold()] > 1:
            names[i] = f"{name} ({seen[name.casefold()]})"
    return names, frozenset(unnamed)
