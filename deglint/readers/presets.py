"""Put a sensor preset's facts on the bands of a file: by name, else by wavelength, else by order.

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

_NEAR = 30.0  # [nm] a band this near to a preset's band may be that band
_SAME = 60.0  # [nm] a band farther off than this is not the one that its place in the order says
_SENSOR_TAGS = ("sensor", "sensor_type", "sensor type", "satelliteid", "satellite", "platform", "instrument")


def sensor_in_tags(info: RasterInfo) -> Sensor | None:
    """The preset that a tag of the dataset names (SATELLITEID, sensor type, platform ...), if any."""
    for tags in info.tags.values():
        for name, value in tags.items():
            found = sensors.find(value) if name.strip().lower() in _SENSOR_TAGS else None
            if found:
                return found
    return None


def apply_sensor(bands: Sequence[Band], sensor: Sensor) -> tuple[list[Band], list[str]]:
    """Fill wavelength, width, instant and group of bands from a preset.

    Returns
    -------
    bands : list of Band
    notes : list of str

    Raises
    ------
    BandError
        The bands cannot be told apart; the message lists those of the file and of the preset.
    """
    matched, how = match(bands, sensor)
    filled = [b if own is None else _fill(b, own) for b, own in zip(bands, matched, strict=True)]
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


def match(bands: Sequence[Band], sensor: Sensor) -> tuple[list[SensorBand | None], str]:
    """The preset's band for every band of a file, and by what they were matched.

    Raises
    ------
    BandError
        Neither names nor wavelengths nor the order tell the bands apart.
    """
    by_name = _unique([_named(b.name, sensor) for b in bands])
    if any(by_name):
        return by_name, "name"
    if all(b.wavelength for b in bands):
        by_wavelength = _unique([_nearest(b.wavelength or 0.0, sensor) for b in bands])
        if all(by_wavelength):
            return by_wavelength, "wavelength"
    if len(bands) != len(sensor.bands) or not sensor.ordered or not _agree(bands, sensor):
        raise BandError(_why_not(bands, sensor))
    return list(sensor.bands), "order"


def _why_not(bands: Sequence[Band], sensor: Sensor) -> str:
    if not sensor.ordered:
        why = "its products come in more than one band order, and no band name fits"
    elif len(bands) != len(sensor.bands):
        why = f"no band name fits, and {len(bands)} bands are not {len(sensor.bands)}"
    else:
        why = "the wavelengths in the file are not those of the preset"
    return (
        f"sensor {sensor.name} does not fit the file: {why}. "
        f"The file has {', '.join(b.name for b in bands)}; "
        f"the preset has {', '.join(b.name for b in sensor.bands)}. Name the bands, or leave the sensor out."
    )


def _named(name: str, sensor: Sensor) -> SensorBand | None:
    return next((b for b in sensor.bands if b.answers_to(name)), None)


def _nearest(wavelength: float, sensor: Sensor) -> SensorBand | None:
    best = min(sensor.bands, key=lambda b: abs(b.wavelength - wavelength))
    return best if abs(best.wavelength - wavelength) <= _NEAR else None


def _unique(found: list[SensorBand | None]) -> list[SensorBand | None]:
    taken = [b for b in found if b is not None]
    return found if len({b.name for b in taken}) == len(taken) else [None] * len(found)


def _agree(bands: Sequence[Band], sensor: Sensor) -> bool:
    pairs = zip(bands, sensor.bands, strict=True)
    return all(b.wavelength is None or abs(b.wavelength - own.wavelength) <= _SAME for b, own in pairs)


def _fill(band: Band, own: SensorBand) -> Band:
    return replace(
        band,
        wavelength=own.wavelength if band.wavelength is None else band.wavelength,
        width=own.width if band.width is None else band.width,
        time_offset=own.time_offset if band.time_offset is None else band.time_offset,
        group=own.group if band.group is None else band.group,
    )
