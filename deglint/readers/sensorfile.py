"""The sensor of a scene: a preset, or a user's file in the format of `deglint/sensors.toml`."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from .. import sensors
from ..checks import described
from ..errors import InputError
from ..raster import RasterInfo
from ..scene import Scene
from ..sensors import Optics, Sensor, SensorBand
from .text import number, positive, read_toml

_KINDS: Mapping[str, tuple[str, Any]] = {
    "str": ("a text", str),
    "float": ("a number", (int, float)),
    "bool": ("true or false", bool),
    "Optics": ("a table", dict),
}
"""For each type of a field that is not a list: its name in messages, and the Python type of its value."""
_BAND, _OPTICS, _SENSOR = (
    {f.name: str(f.type).removesuffix(" | None") for f in fields(kind)} for kind in (SensorBand, Optics, Sensor)
)
_OF_FILE = {k: v for k, v in _SENSOR.items() if k != "name"} | {"time_status": "str"}
"""Types of the entries in a file of a sensor, as text."""
_USUAL_WIDTH = 50.0  # width of a band if not given [nm], as most bands of multispectral sensors have
_CENTRE_RANGE = (300.0, 20_000.0)  # allowed range of centre wavelengths [nm]


def sensor_of(name: str) -> Sensor:
    """The preset called `name`, or the sensor in the ``.toml`` file called `name`; InputError if it is not valid."""
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
    if not all(isinstance(product, list) and set(product) <= set(own) for product in entry.get("products", ())):
        raise InputError(f"{where}: products: want lists of {', '.join(own)}.")
    if "optics" in entry:
        _check(f"{where} optics", entry["optics"], _OPTICS)
        checked["optics"] = {"status": "defined"} | dict(entry["optics"])
    return sensors.sensor_from(name, checked)


@dataclass(frozen=True, slots=True)
class KnownOptics:
    """Parameters of the point spread function of a sensor: optics, detector and motion."""

    f_number: float  # focal length divided by the diameter of the aperture
    pitch: float  # distance between elements of the detector [m]
    smear: float  # motion during the exposure, along a column [pixel]
    source: str  # where the numbers come from, as text


def optics_of(scene: Scene) -> KnownOptics | None:
    """Optics from the tags F_NUMBER, PIXEL_PITCH_UM and SMEAR_PIXELS, or from the preset; None if unknown."""
    info: RasterInfo | None = getattr(scene.source, "info", None)
    spaces = [] if info is None else info.tags.values()
    tags = {k.upper(): v for part in spaces for k, v in part.items()}
    f_number, pitch = positive(tags.get("F_NUMBER")), positive(tags.get("PIXEL_PITCH_UM"))
    if f_number and pitch:
        smear = number(tags.get("SMEAR_PIXELS"))
        return KnownOptics(f_number, 1e-6 * pitch, 0.5 if smear is None else smear, "the file's tags")
    sensor = sensor_of(scene.sensor) if scene.sensor else None
    optics = sensor.optics if sensor else None
    if sensor is None or optics is None or optics.pixel_pitch is None or optics.f_number is None:
        return None
    return KnownOptics(optics.f_number, 1e-6 * optics.pixel_pitch, 0.5, f"preset {sensor.name} ({optics.status})")


def _band(where: str, band: Any) -> dict[str, Any]:
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
    if missing := [key for key in needed if key not in entry]:
        raise InputError(f"{where}: {missing[0]} is missing; needed are {', '.join(needed)}.")
