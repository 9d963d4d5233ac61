"""Conversion between a mission and tables of plain values, as in a TOML file or the command's options.

The command's options override single values of the file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from datetime import date, datetime
from typing import Any

from ..errors import InputError
from ..physics.presets import preset
from ..physics.sensor import Sensor, SensorBand
from .mission import Limits, Mission

Tables = Mapping[str, Mapping[str, Any]]

_MISSION_FIELDS = {  # table, key: field of the mission; [sun] is in place of [place]
    "place": {"latitude": "latitude", "longitude": "longitude", "time": "time"},
    "sun": {"zenith": "sun_zenith", "azimuth": "sun_azimuth"},
    "wind": {"speed": "wind", "from": "wind_from", "height": "wind_height", "mean": ""},
    "air": dict.fromkeys(("air_mass_type", "humidity", "water_vapour", "visibility", "ozone", "pressure"), ""),
    "water": {"chlorophyll": "chlorophyll", "model": "water"},
    "object": {"depth": "depth", "reflectance": "reflectance"},
    "sensor": {},
    "limits": {f.name: "" for f in fields(Limits)},
    "view": {"step": "step", "widest": "widest"},
    "models": {"slopes": "slopes", "sky": "sky"},
}
_WORD_FIELDS = ("time", "model", "slopes", "sky")
_HECTOPASCALS = {"hpa": 1.0, "mbar": 1.0, "mb": 1.0, "kpa": 10.0, "pa": 0.01, "mmhg": 1.333224, "inhg": 33.86389}
_SENSOR_KEYS = ("preset", "bands", "band", "name", *(f.name for f in fields(Sensor) if f.name not in ("name", "bands")))


def mission_from(tables: Tables, name: str = "the mission") -> Mission:
    """A mission from tables; `name` is the name of the file for messages.

    Raises InputError: a table or key is not known, or a value cannot be used.

    Examples
    --------
    >>> mission_from({"sun": {"zenith": 30, "azimuth": 180}, "wind": {"speed": 7, "from": 310}}).wind
    7.0
    """
    given: dict[str, Any] = {}
    tables = {"view" if table == "look" else table: values for table, values in tables.items()}  # its old name
    for table, values in tables.items():
        _check(table, values, name)
        for key, value in values.items():
            target = _MISSION_FIELDS[table].get(key)
            if target:
                given[target] = value if key in _WORD_FIELDS else _number(table, key, value, name)
    if "sensor" in tables:
        given["sensor"], given["bands"] = _sensor(tables["sensor"], name)
    limits = {k: _number("limits", k, v, name) for k, v in tables.get("limits", {}).items()}
    if isinstance(given.get("time"), date) and not isinstance(given["time"], datetime):
        raise InputError(f"{name}: time in [place] is a date without an hour. Write 2026-06-21T18:00:00Z.")
    mission = Mission(limits=Limits(**limits), **given)
    air = {k: _number("air", k, v, name) for k, v in tables.get("air", {}).items() if k != "pressure"}
    if "pressure" in tables.get("air", {}):
        air["pressure"] = pressure(tables["air"]["pressure"])
    if "mean" in tables.get("wind", {}):
        air["wind_mean"] = _number("wind", "mean", tables["wind"]["mean"], name)
    return replace(mission, air=replace(mission.weather, **air)) if air else mission


def tables_of(mission: Mission) -> dict[str, dict[str, Any]]:
    """All parameters of a mission, with defaults, as tables that `mission_from` can read."""
    out: dict[str, dict[str, Any]] = {}
    for table, keys in _MISSION_FIELDS.items():
        found = {key: getattr(mission, field) for key, field in keys.items() if field}
        out[table] = {key: value for key, value in found.items() if value is not None}
    if mission.moment is not None:
        out["place"]["time"] = f"{mission.moment}Z"
    if mission.sun_zenith is None:
        del out["sun"]
    air = asdict(mission.weather)
    out["wind"]["mean"] = air.pop("wind_mean")
    air.pop("wind")
    out["air"] = air
    out["limits"] = {k: v for k, v in asdict(mission.limits).items() if v is not None}
    sensor = asdict(mission.sensor)
    bands = [asdict(b) for b in mission.channels]
    out["sensor"] = {k: v for k, v in sensor.items() if k != "bands"} | {"band": bands}
    return {table: values for table, values in out.items() if values}


def merged(below: Tables, above: Tables) -> dict[str, dict[str, Any]]:
    """Tables of one mission, overridden by another's; the sun's angles replace place and time, and vice versa."""
    out = {table: dict(values) if isinstance(values, Mapping) else values for table, values in below.items()}
    if "sun" in above:
        out.pop("place", None)
    if "place" in above:
        out.pop("sun", None)
    for table, values in above.items():
        own = out.get(table, {})
        out[table] = {**(own if isinstance(own, Mapping) else {}), **values}
    return out


def pressure(value: Any) -> float:
    """Pressure [hPa] from a number in hPa, or a text such as "29.9 inHg" or "762 mmHg".

    Raises InputError: it is neither.

    Examples
    --------
    >>> round(pressure("30 inHg"), 1)
    1015.9
    """
    found = re.fullmatch(r"\s*([0-9]+\.?[0-9]*|\.[0-9]+)\s*([A-Za-z]*)\s*", str(value))
    unit = found[2].lower() or "hpa" if found else ""
    if found and unit in _HECTOPASCALS:
        return float(found[1]) * _HECTOPASCALS[unit]
    raise InputError(f"pressure must be like 1013 hPa, 29.9 inHg or 760 mmHg, got {value!r}. Name the unit.")


def _check(table: str, values: Any, name: str) -> None:
    if table not in _MISSION_FIELDS:
        raise InputError(f"{name} has no table [{table}]; it knows {', '.join(f'[{t}]' for t in _MISSION_FIELDS)}.")
    if not isinstance(values, Mapping):
        raise InputError(f"{name}: {table} must be a table; write [{table}] with its values below.")
    known = _SENSOR_KEYS if table == "sensor" else tuple(_MISSION_FIELDS[table])
    for key in values:
        if key not in known:
            raise InputError(f"{name}: [{table}] has no {key}; it knows {', '.join(known)}.")


def _number(table: str, key: str, value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(f"{name}: {key} in [{table}] must be a number, got {value!r}.")
    return float(value)


def _sensor(values: Mapping[str, Any], name: str) -> tuple[Sensor, tuple[str, ...]]:
    """The sensor described by a table: a preset, with changed values and bands; and the selected bands."""
    base = preset(str(values.get("preset", "thesis")))
    own = {k: v for k, v in values.items() if k not in ("preset", "bands", "band")}
    for key in ("bands", "band"):
        if not isinstance(values.get(key, []), (list, tuple, str)):
            raise InputError(f"{name}: {key} in [sensor] must be a list, got {values[key]!r}.")
    if "band" in values:
        own["bands"] = tuple(_band(b, name) for b in values["band"])
        own.setdefault("name", "custom")
    for key, value in own.items():
        if key not in ("name", "bands"):
            own[key] = _number("sensor", key, value, name)
    if "bits" in own:
        own["bits"] = int(own["bits"])
    bands = values.get("bands", ())
    chosen = (bands,) if isinstance(bands, str) else tuple(str(b) for b in bands)
    return replace(base, **own), chosen


def _band(values: Any, name: str) -> SensorBand:
    needed = {"name", "low", "high", "full_scale"}
    known = needed | {"time_offset"}
    if not isinstance(values, Mapping) or not needed <= set(values) <= known:
        raise InputError(f"{name}: a [[sensor.band]] has name, low, high [nm] and full_scale [W m-2 sr-1 nm-1].")
    numbers = {k: _number("sensor.band", k, v, name) for k, v in values.items() if k != "name"}
    if not 300.0 <= numbers["low"] < numbers["high"] or numbers["low"] > 999.0 or numbers["full_scale"] <= 0.0:
        raise InputError(
            f"{name}: band {values['name']} must have 300 <= low < high (low to 999 nm), full_scale above 0."
        )
    return SensorBand(name=str(values["name"]), **numbers)
