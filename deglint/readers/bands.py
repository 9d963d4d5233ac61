"""The bands and the sensor of a scene, from tags, names and the preset of the sensor.

Properties in the file are kept; missing ones come from the preset of the sensor, or from a user's file in the format of
`deglint/sensors.toml`. Bands are matched with those of the preset by name, else by wavelength, else by their order.
"""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from os.path import commonprefix
from typing import Any

from .. import sensors
from ..checks import described
from ..errors import BandError, InputError
from ..raster import RasterInfo
from ..scene import Band, Scene
from ..sensors import BandInfo, Optics, SensorInfo
from . import spectral
from .text import number, positive, read_toml

_NOT_NAMES = ("gray", "undefined", "palette", "alpha")
_PLACE = re.compile(r"(?:band|layer|channel)[\s_\-]*0*(\d+)")
_SENTINEL2 = re.compile(r"b0\d|b0?8a")
_PRESET_TITLES = {"sentinel2": "Sentinel-2", "landsat8": "Landsat 8 or 9"}
_NEAR_BAND = 30.0  # largest difference at which wavelengths are matched [nm]
_SAME_BAND = 60.0  # a larger difference shows that the order of bands is not the preset's [nm]
_SENSOR_TAGS = ("sensor", "sensor_type", "sensor type", "satelliteid", "satellite", "platform", "instrument")
_KINDS: Mapping[str, tuple[str, Any]] = {
    "str": ("a text", str),
    "float": ("a number", (int, float)),
    "bool": ("true or false", bool),
    "Optics": ("a table", dict),
}
"""For each type of an entry of a sensor file, except lists: its name in messages, and the Python type of its value."""
_BAND, _OPTICS, _SENSOR = (
    {f.name: str(f.type).removesuffix(" | None") for f in fields(kind)} for kind in (BandInfo, Optics, SensorInfo)
)
_OF_FILE = {k: v for k, v in _SENSOR.items() if k != "name"} | {"time_status": "str"}
"""Type of each entry of a sensor file, as text."""
_USUAL_WIDTH = 50.0  # width of a band if not given [nm], as most bands of multispectral sensors have
_CENTRE_RANGE = (300.0, 20_000.0)  # allowed range of centre wavelengths [nm]


def bands_of(info: RasterInfo, stems: Sequence[str], sensor: str | None) -> tuple[list[Band], str | None, list[str]]:
    """Return the bands of a scene, the name of the sensor preset that was used (or None), and notes for the log.

    `stems`: for each band, its file's name without extension, or "". A band without a name is named after its file.
    `sensor`: preset or .toml file that the user selected (BandError if it does not fit), or None. A wavelength comes
    from a tag, else from a number in the band's name, else from the preset, else from a code or colour in the name.
    """
    names, unnamed = _names(info, stems)
    bands = [
        Band(
            name=name,
            wavelength=wavelength or (None if i in unnamed else spectral.wavelength_in_name(name)),
            width=width,
            time_offset=spectral.time_offset(info.band_tags[i]),
            saturation=spectral.saturation(info, i),
        )
        for i, (name, (wavelength, width)) in enumerate(zip(names, spectral.spectral_of(info), strict=True))
    ]
    bands, preset, told = _with_sensor(bands, info, sensor, unnamed)
    bands, guessed = _from_names(bands, unnamed)
    return bands, preset, told + guessed


def labelled(info: RasterInfo, bands: Sequence[Band]) -> RasterInfo:
    """A copy of `info`, for outputs, with wavelengths and widths of `bands`, and their names where `info` has none."""
    names = tuple(
        d if d or b.name == f"band {i}" else b.name
        for i, (d, b) in enumerate(zip(info.descriptions, bands, strict=True), start=1)
    )
    return spectral.with_spectral(replace(info, descriptions=names), [(b.wavelength, b.width) for b in bands])


def _with_sensor(
    bands: list[Band], info: RasterInfo, sensor: str | None, unnamed: frozenset[int]
) -> tuple[list[Band], str | None, list[str]]:
    """Add missing properties to bands, from the preset `sensor` or, if it is None, from the preset that a tag names.

    `unnamed` is as in `apply_sensor`. Returns bands, name of the preset or .toml file used (or None), and notes.
    """
    if sensor is not None:
        asked = sensor_of(sensor)
        bands, notes = apply_sensor(bands, asked, unnamed)
        # a user's sensor is called by its file, from which it is read again later
        return bands, sensor if sensor.lower().endswith(".toml") else asked.name, notes
    tags = (tag for space in info.tags.values() for tag in space.items())
    named = (sensors.find(value) for name, value in tags if name.strip().lower() in _SENSOR_TAGS)
    tagged = next(filter(None, named), None)
    if tagged is None:
        return bands, None, []
    try:
        bands, notes = apply_sensor(bands, tagged, unnamed)
    except BandError as error:
        return bands, None, [f"the sensor in the file's tags is not used: {error}"]
    return bands, tagged.name, notes


def _from_names(bands: list[Band], unnamed: frozenset[int]) -> tuple[list[Band], list[str]]:
    """Add missing wavelengths from codes, letters or colours in names (not of `unnamed` bands); return bands, notes."""
    sensor = dialect([b.name for i, b in enumerate(bands) if i not in unnamed])
    filled = []
    for i, (band, letter) in enumerate(zip(bands, spectral.letter_wavelengths([b.name for b in bands]), strict=True)):
        own = None if sensor is None or i in unnamed else named_in(band.name, sensor)
        nominal = own.wavelength if own else letter or (None if sensor else spectral.nominal_wavelength(band.name))
        filled.append(band if band.wavelength is not None else replace(band, wavelength=nominal))
    changed = [b.name for b, old in zip(filled, bands, strict=True) if b is not old and b.wavelength]
    if not changed:
        return filled, []
    if sensor:
        return filled, [f"band names match {_PRESET_TITLES[sensor.name]}: its wavelengths are assumed"]
    return filled, [f"wavelengths of {', '.join(changed)} are typical values for the band names"]


def nominal_pixel(scene: Scene) -> float | None:
    """Nominal pixel size [m] of the scene's sensor (`Scene.sensor`, else found from band names); None if not known."""
    sensor = sensor_of(scene.sensor) if scene.sensor else dialect([b.name for b in scene.bands])
    return positive(sensor.pixel) if sensor else None


def dialect(names: Sequence[str]) -> SensorInfo | None:
    """The sensor that band names identify by unambiguous codes or words, or None.

    Codes like B02 (with zero), B8A or B12 identify Sentinel-2. So do 3 or more codes with B8 (its NIR) but without B5
    (the NIR of Landsat 8, whose B8 is panchromatic). SR_B6 identifies Landsat 8 or 9: Landsat 4 to 7 have no SR_B6.
    """
    plain = [sensors.normalise(n) for n in names]
    codes = {c for n in names if (c := spectral.band_code(n))}
    if any(p.startswith("srb") for p in plain):
        return sensors.load("landsat8") if "6" in codes and codes <= set("1234567") else None
    own = {spectral.band_code(b.name) for b in sensors.load("sentinel2").bands}
    sure = "8a" in codes or "12" in codes or (len(codes) > 2 and "8" in codes and "5" not in codes)
    spelled = any(_SENTINEL2.fullmatch(p) for p in plain) or {"nbartswir3", "nbartnir2", "nbartrededge1"} & set(plain)
    return sensors.load("sentinel2") if spelled or (sure and codes <= own) else None


def _names(info: RasterInfo, stems: Sequence[str]) -> tuple[list[str], frozenset[int]]:
    """Unique band names (description, else file name, colour or "band N"), and `unnamed` as in `apply_sensor`."""
    names, unnamed = [], set()
    for i, (stated, stem) in enumerate(zip(info.descriptions, short_names(stems), strict=True)):
        colour = info.colorinterp[i]
        name = (stated or "").strip() or stem or ("" if colour in _NOT_NAMES else colour)
        if not name:
            unnamed.add(i)
        names.append(name or f"band {i + 1}")
    if only_numbered(names):
        unnamed = set(range(len(names)))
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        while seen[names[i].casefold()]:
            seen[name.casefold()] += 1
            names[i] = f"{name} ({seen[name.casefold()]})"
        seen[names[i].casefold()] += 1
    return names, frozenset(unnamed)


def only_numbered(names: Sequence[str]) -> bool:
    """Whether the names only number the bands in order: "Band 1", "Band 2", ..."""
    found = [_PLACE.fullmatch(n.strip().lower()) for n in names]
    return all(m is not None and int(m[1]) == i for i, m in enumerate(found, start=1))


def short_names(stems: Sequence[str]) -> list[str]:
    """Derive band names from file names (`stems`): a code, else the part in which names differ, else the whole name."""
    codes = [re.findall(r"(?<![A-Za-z0-9])(B\d{1,2}A?)(?![A-Za-z0-9])", s, flags=re.IGNORECASE) for s in stems]
    rest = list(stems)
    if len(stems) > 1 and all(stems):
        split = [re.split(r"([\s_\-.]+)", s) for s in stems]
        least = min(map(len, split)) - 1  # at least one part of each name remains
        front, back = (
            min(len(commonprefix(parts)), least)  # noqa: RUF071  (parts of names, not of paths)
            for parts in (split, [s[::-1] for s in split])
        )
        cut = ["".join(s[front : len(s) - back]).strip(" _-.") for s in split]
        if all(cut) and not all(c.isdecimal() for c in cut) and len(set(cut)) == len(cut):
            rest = cut
    return [c[0] if len(c) == 1 else r for c, r in zip(codes, rest, strict=True)]


def apply_sensor(bands: Sequence[Band], sensor: SensorInfo, unnamed: Collection[int]) -> tuple[list[Band], list[str]]:
    """Add missing wavelengths, widths, time offsets and groups (see `Band`) from a preset; return bands and notes.

    `unnamed`: 0-based indexes of bands not named, or only numbered; they get the preset's names. Errors as in `match`.
    """
    matched, how = match(bands, sensor, unnamed)
    filled = []
    for i, (band, own) in enumerate(zip(bands, matched, strict=True)):
        facts = ("wavelength", "width", "time_offset", "group") if own else ()
        known = {name: getattr(own, name) for name in facts if getattr(band, name) is None}
        filled.append(replace(band, name=own.name if own and i in unnamed else band.name, **known))
    notes = [f"sensor {sensor.name} ({sensor.title}); its bands are matched by {how}"]
    if without := [b.name for b, own in zip(bands, matched, strict=True) if own is None]:
        notes.append(f"{sensor.name} has no band {', '.join(without)}")
    if sensors.UNVERIFIED in [b.time_status for b in matched if b is not None and b.time_offset is not None]:
        notes.append(f"some time offsets of {sensor.name} are not verified")
    if sensor.wavelength_status == sensors.UNVERIFIED:
        notes.append(f"the wavelengths of {sensor.name} are not verified")
    return filled, notes


def match(bands: Sequence[Band], sensor: SensorInfo, unnamed: Collection[int]) -> tuple[list[BandInfo | None], str]:
    """Return the preset's band for each band (or None), and the property by which they match ("name", ...), for a note.

    `unnamed` is as in `apply_sensor`. Raises BandError if the preset does not fit the bands.
    """
    by_name = _unique([None if i in unnamed else named_in(b.name, sensor) for i, b in enumerate(bands)])
    if any(by_name):
        return by_name, "name"
    if all(b.wavelength for b in bands):
        by_wavelength = _unique([_nearest(b.wavelength or 0.0, sensor) for b in bands])
        if all(by_wavelength):
            return by_wavelength, "wavelength"
    product = sensor.product(len(bands))
    pairs = zip(bands, product, strict=False)
    if not product or any(b.wavelength and abs(b.wavelength - own.wavelength) > _SAME_BAND for b, own in pairs):
        raise BandError(_why_not(bands, sensor, product))
    if product == sensor.bands:
        return list(product), "order"
    assumed = ", ".join(b.name for b in product)
    return list(product), f"their number: the file is assumed to hold {assumed}, in this order"


def _why_not(bands: Sequence[Band], sensor: SensorInfo, product: Sequence[BandInfo]) -> str:
    why = "the wavelengths in the file are not those of the preset"
    if not sensor.ordered:
        why = "its products come in more than one band order, and no band name fits"
    elif not product:
        counts = " or ".join(map(str, sensor.counts))
        why = f"no band name fits, and its products have {counts} bands, not {len(bands)}"
    return (
        f"sensor {sensor.name} does not fit the file: {why}. The file has {', '.join(b.name for b in bands)}; the "
        f"preset has {', '.join(b.name for b in sensor.bands)}. Leave the sensor out, or name the {len(bands)} bands "
        f'in the file\'s order, such as --bands "{spectral.example_names(len(bands))}".'
    )


def named_in(name: str, sensor: SensorInfo) -> BandInfo | None:
    """The band of a preset with this name, alias or code (a prefix such as "sr_" is ignored); None if no band fits."""
    if answers := [b for wanted in (name, spectral.plain_name(name)) for b in sensor.bands if b.answers_to(wanted)]:
        return answers[0]
    code = spectral.band_code(name)
    fits = [b for b in sensor.bands if code and code in map(spectral.band_code, (b.name, *b.aliases))]
    return fits[0] if len(fits) == 1 else None


def _nearest(wavelength: float, sensor: SensorInfo) -> BandInfo | None:
    best = min(sensor.bands, key=lambda b: abs(b.wavelength - wavelength))
    return best if abs(best.wavelength - wavelength) <= _NEAR_BAND else None


def _unique(found: list[BandInfo | None]) -> list[BandInfo | None]:
    taken = [b for b in found if b is not None]
    return found if len({b.name for b in taken}) == len(taken) else [None] * len(found)


def sensor_of(name: str) -> SensorInfo:
    """The preset called `name`, or the sensor in the .toml file `name`. Raises ReadError or InputError on failure."""
    if not name.lower().endswith(".toml"):
        return sensors.load(name)
    document = read_toml(name, "--sensor")
    if len(document) != 1 or not isinstance(next(iter(document.values())), Mapping):
        raise InputError(f"{name} (--sensor): want one table, such as [mycamera], with title and bands in it.")
    ((key, entry),) = document.items()
    where = f"{name} (--sensor): [{key}]"
    checked: dict[str, Any] = {"wavelength_status": "defined", "time_status": "defined", "title": key} | dict(entry)
    _check(where, entry, _OF_FILE, ("bands",))
    checked["bands"] = [_band(f"{where} bands, entry {i}", band) for i, band in enumerate(entry["bands"], start=1)]
    own = [band["name"] for band in checked["bands"]]
    if not own:
        raise InputError(f"{where}: bands is empty. Give a table for each band.")
    if not all(isinstance(p, list) and all(name in own for name in p) for p in entry.get("products", ())):
        raise InputError(f"{where}: products: want lists of {', '.join(own)}.")
    if "optics" in entry:
        _check(f"{where} optics", entry["optics"], _OPTICS)
        checked["optics"] = {"status": "defined"} | dict(entry["optics"])
    return sensors.sensor_from(name, checked)


def optics_of(scene: Scene) -> dict[str, float] | None:
    """Optics of a scene's sensor, as keywords of `compensate.psf.system_psf`: `f_number`, `pitch` [m], `smear` [pixel].

    They follow from the tags F_NUMBER, PIXEL_PITCH_UM and SMEAR_PIXELS, else from the sensor's preset, which has no
    smear. A smear that is not known is left out. Returns None if the f-number or the pixel pitch is not known.
    """
    info: RasterInfo | None = getattr(scene.source, "info", None)
    tags = {k.upper(): v for part in ([] if info is None else info.tags.values()) for k, v in part.items()}
    f_number, pitch, smear = (number(tags.get(name)) for name in ("F_NUMBER", "PIXEL_PITCH_UM", "SMEAR_PIXELS"))
    if not positive(f_number) or not positive(pitch):
        optics = sensor_of(scene.sensor).optics if scene.sensor else None
        if optics is None:
            return None
        f_number, pitch, smear = optics.f_number, optics.pixel_pitch, None
    if f_number is None or pitch is None:
        return None
    return {"f_number": f_number, "pitch": 1e-6 * pitch} | ({} if smear is None else {"smear": smear})


def _band(where: str, band: object) -> dict[str, Any]:
    if not isinstance(band, Mapping):
        raise InputError(f'{where}: want a table such as {{ name = "NIR", wavelength = 842 }}, got {described(band)}.')
    _check(where, band, _BAND, ("name", "wavelength"))
    if not _CENTRE_RANGE[0] <= band["wavelength"] <= _CENTRE_RANGE[1]:
        low, high = _CENTRE_RANGE
        raise InputError(f"{where}: wavelength: allowed is {low:g} to {high:g} nm, got {band['wavelength']}.")
    return {"width": _USUAL_WIDTH} | dict(band)


def _check(where: str, entry: Mapping[str, Any], allowed: Mapping[str, str], needed: tuple[str, ...] = ()) -> None:
    for key, value in entry.items():
        if key not in allowed:
            raise InputError(f"{where}: {key!r} is not one of {', '.join(allowed)}.")
        wanted, kind = _KINDS.get(allowed[key], ("a list", list))
        if not isinstance(value, kind):
            raise InputError(f"{where}: {key}: want {wanted}, got {described(value)}.")
        if allowed[key] == "tuple[str, ...]" and not all(isinstance(v, str) for v in value):
            raise InputError(f"{where}: {key}: want texts in quotes, got {described(value)}.")
        if allowed[key] == "float":
            found, least = number(value), "" if key == "time_offset" else " above 0"
            if isinstance(value, bool) or found is None or (least and found <= 0):
                raise InputError(f"{where}: {key}: want a finite number{least}, got {described(value)}.")
    if missing := [key for key in needed if key not in entry]:
        raise InputError(f"{where}: {missing[0]} is missing; needed are {', '.join(needed)}.")
