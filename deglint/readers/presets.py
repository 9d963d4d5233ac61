"""Put a sensor preset's facts on the bands of a file: by name, else by wavelength, else by the number of bands.

What the file itself says is kept; the preset fills in what is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from .. import sensors
from ..errors import BandError
from ..raster import RasterInfo
from ..scene import Band
from ..sensors import Sensor, SensorBand
from .names import band_code, example_names, plain_name

_NEAR_BAND = 30.0  # [nm] a band this near to a preset's band may be that band
_SAME_BAND = 60.0  # [nm] a band farther off than this is not the one that its place in the order says
_SENSOR_TAGS = ("sensor", "sensor_type", "sensor type", "satelliteid", "satellite", "platform", "instrument")


def sensor_in_tags(info: RasterInfo) -> Sensor | None:
    """The preset that a tag of the dataset names (SATELLITEID, sensor type, platform ...), if any."""
    tags = [tag for space in info.tags.values() for tag in space.items()]
    named = (sensors.find(value) for name, value in tags if name.strip().lower() in _SENSOR_TAGS)
    return next((sensor for sensor in named if sensor), None)


def apply_sensor(
    bands: Sequence[Band], sensor: Sensor, unnamed: frozenset[int] = frozenset()
) -> tuple[list[Band], list[str]]:
    """Fill wavelength, width, instant and group of bands from a preset; the bands, and notes.

    `unnamed` are the 0-based bands whose name says no more than their place; they get the preset's.
    """
    matched, how = match(bands, sensor, unnamed)
    filled = [
        b if own is None else _fill(replace(b, name=own.name) if i in unnamed else b, own)
        for i, (b, own) in enumerate(zip(bands, matched, strict=True))
    ]
    notes = [f"sensor {sensor.name} ({sensor.title}); its bands are matched by {how}"]
    without = [b.name for b, own in zip(bands, matched, strict=True) if own is None]
    if without:
        notes.append(f"{sensor.name} knows nothing of {', '.join(without)}")
    offsets = [b.time_status for b in matched if b is not None and b.time_offset is not None]
    if sensors.UNVERIFIED in offsets:
        notes.append(f"some time offsets of {sensor.name} are not verified")
    if sensor.wavelength_status == sensors.UNVERIFIED:
        notes.append(f"the wavelengths of {sensor.name} are not verified")
    return filled, notes


def match(
    bands: Sequence[Band], sensor: Sensor, unnamed: frozenset[int] = frozenset()
) -> tuple[list[SensorBand | None], str]:
    """The preset's band for every band of a file, and by what they were matched."""
    by_name = _unique([None if i in unnamed else named_in(b.name, sensor) for i, b in enumerate(bands)])
    if any(by_name):
        return by_name, "name"
    if all(b.wavelength for b in bands):
        by_wavelength = _unique([_nearest(b.wavelength or 0.0, sensor) for b in bands])
        if all(by_wavelength):
            return by_wavelength, "wavelength"
    product = sensor.product(len(bands))
    far = [
        b
        for b, own in zip(bands, product or (), strict=False)
        if abs((b.wavelength or own.wavelength) - own.wavelength) > _SAME_BAND
    ]
    if not product or far:
        raise BandError(_why_not(bands, sensor, product))
    if product == sensor.bands:
        return list(product), "order"
    assumed = ", ".join(b.name for b in product)
    return list(product), f"their number: the file is assumed to hold {assumed}, in this order"


def _why_not(bands: Sequence[Band], sensor: Sensor, product: Sequence[SensorBand]) -> str:
    own = ", ".join(b.name for b in sensor.bands)
    if not sensor.ordered:
        why = "its products come in more than one band order, and no band name fits"
    elif not product:
        counts = " or ".join(map(str, sensor.counts))
        why = f"no band name fits, and {len(bands)} bands are not {counts}, as its products have"
    else:
        why = "the wavelengths in the file are not those of the preset"
    fits = len(bands) <= len(sensor.bands)
    example = ",".join(b.name for b in sensor.bands[: len(bands)]) if fits else example_names(len(bands))
    return (
        f"sensor {sensor.name} does not fit the file: {why}. The file has {', '.join(b.name for b in bands)}; the "
        f"preset has {own}. Leave the sensor out, or name the {len(bands)} bands in the file's order, such as "
        f'--bands "{example}".'
    )


def named_in(name: str, sensor: Sensor) -> SensorBand | None:
    """The band of a preset that a name means: by name or alias, without words for what its values are, or by code."""
    answers = [b for wanted in (name, plain_name(name)) for b in sensor.bands if b.answers_to(wanted)]
    if answers:
        return answers[0]
    code = band_code(name)
    fits = [b for b in sensor.bands if code and code in map(band_code, (b.name, *b.aliases))]
    return fits[0] if len(fits) == 1 else None


def _nearest(wavelength: float, sensor: Sensor) -> SensorBand | None:
    best = min(sensor.bands, key=lambda b: abs(b.wavelength - wavelength))
    return best if abs(best.wavelength - wavelength) <= _NEAR_BAND else None


def _unique(found: list[SensorBand | None]) -> list[SensorBand | None]:
    taken = [b for b in found if b is not None]
    return found if len({b.name for b in taken}) == len(taken) else [None] * len(found)


def _fill(band: Band, own: SensorBand) -> Band:
    facts = ("wavelength", "width", "time_offset", "group")
    return replace(band, **{name: getattr(own, name) for name in facts if getattr(band, name) is None})
