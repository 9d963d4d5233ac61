"""Conversion between a mission and tables of plain values, as in a TOML file or the command's options.

The command's options override single values of the file.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields, replace
from datetime import date, datetime
from typing import Any

from ..errors import InputError
from ..physics.atmosphere import Air
from ..physics.presets import preset
from ..physics.sensor import Sensor, SensorBand
from .mission import Limits, Mission

Tables = Mapping[str, Mapping[str, Any]]  # table: {key: value}

_TABLES: dict[str, dict[str, str]] = {  # table: {key: field of `Mission`, or "" where it is none}
    "place": {}, "sun": {}, "wind": {}, "air": {f.name: "" for f in fields(Air) if "wind" not in f.name}, "water": {},
    "object": {}, "sensor": dict.fromkeys(("preset", "bands", "band", *(f.name for f in fields(Sensor))), ""),
    "limits": {f.name: "" for f in fields(Limits)}, "view": {}, "models": {},
}  # fmt: skip
for _field in fields(Mission):
    if "file" in _field.metadata:
        _table, _key = _field.metadata["file"].split(".")
        _TABLES[_table][_key] = _field.name
_TABLES["wind"]["mean"] = ""
# keys whose values are no numbers
_NO_NUMBERS = ("time", "model", "slopes", "sky", "pressure", "preset", "bands", "band", "name")
# pressure of one unit [hPa]
_HECTOPASCALS = {"hpa": 1.0, "mbar": 1.0, "mb": 1.0, "kpa": 10.0, "pa": 0.01, "mmhg": 1.333224, "inhg": 33.86389}


def mission_from(tables: Tables, name: str = "the mission") -> Mission:
    """Make a mission from tables; `name` names their source, such as the file, in error messages.

    Raises InputError: a table or key is not known, or a value cannot be used.

    Examples
    --------
    >>> mission_from({"sun": {"zenith": 30, "azimuth": 180}, "wind": {"speed": 7, "from": 310}}).wind
    7.0
    """
    read: dict[str, dict[str, Any]] = {}
    for table, values in tables.items():
        known = "view" if table == "look" else table  # [look] is the old name of [view]
        if known not in _TABLES:
            raise InputError(f"{name} has no table [{table}]; it knows {', '.join(f'[{t}]' for t in _TABLES)}.")
        read[known] = _read(table, values, _TABLES[known], name)
    given = {
        field: read[table][key]
        for table, keys in _TABLES.items()
        for key, field in keys.items()
        if field and key in read.get(table, {})
    }
    if isinstance(given.get("time"), date) and not isinstance(given["time"], datetime):
        raise InputError(f"{name}: time in [place] is a date without an hour. Write 2026-06-21T18:00:00Z.")
    if "sensor" in read:
        given["sensor"], given["bands"] = _sensor(read["sensor"], name)
    mission = Mission(limits=Limits(**read.get("limits", {})), **given)
    air = read.get("air", {})
    if "pressure" in air:
        air["pressure"] = pressure(air["pressure"])
    if "mean" in read.get("wind", {}):
        air["wind_mean"] = read["wind"]["mean"]
    return replace(mission, air=replace(mission.weather, **air)) if air else mission


def tables_of(mission: Mission) -> dict[str, dict[str, Any]]:
    """All parameters of a mission, with defaults, as tables that `mission_from` can read."""
    out = {
        table: {key: getattr(mission, field) for key, field in keys.items() if field} for table, keys in _TABLES.items()
    }
    out["place"]["time"] = None if mission.moment is None else f"{mission.moment}Z"
    air = asdict(mission.weather)
    del air["wind"]
    out["wind"]["mean"] = air.pop("wind_mean")
    sensor = asdict(mission.sensor) | {"band": [asdict(b) for b in mission.channels]}
    del sensor["bands"]
    out |= {"air": air, "sensor": sensor, "limits": asdict(mission.limits)}
    if mission.sun_zenith is None:
        del out["sun"]
    kept = {table: {key: v for key, v in values.items() if v is not None} for table, values in out.items()}
    return {table: values for table, values in kept.items() if values}


def merged(below: Tables, above: Tables) -> dict[str, dict[str, Any]]:
    """Tables `below`, overridden by the values of `above`; angles of the sun replace place and time, and vice versa."""
    out = {table: dict(values) if isinstance(values, Mapping) else values for table, values in below.items()}
    for table, other in (("sun", "place"), ("place", "sun")):
        if table in above:
            out.pop(other, None)
    for table, values in above.items():
        own = out.get(table, {})
        out[table] = {**(own if isinstance(own, Mapping) else {}), **values}
    return out


def pressure(value: Any) -> float:
    """Pressure [hPa] from a number in hPa, or a text such as "29.9 inHg" or "762 mmHg".

    Raises InputError: the value is neither.

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


def _read(table: str, values: Any, known: Iterable[str], name: str) -> dict[str, Any]:
    """The checked values of a table; raises InputError for an unknown key, or a value that is no finite number."""
    if not isinstance(values, Mapping):
        raise InputError(f"{name}: {table} must be a table; write [{table}] with its values below.")
    out: dict[str, Any] = {}
    for key, value in values.items():
        if key not in known:
            raise InputError(f"{name}: [{table}] has no {key}; it knows {', '.join(known)}.")
        if key in _NO_NUMBERS:
            out[key] = value
        elif isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise InputError(f"{name}: {key} in [{table}] must be a number, got {value!r}.")
        else:
            out[key] = float(value)
    return out


def _sensor(values: dict[str, Any], name: str) -> tuple[Sensor, tuple[str, ...]]:
    """Make the sensor of the table [sensor] from a preset; return it and the names of the bands to use (empty: all)."""
    own, bands = dict(values), values.get("bands", ())
    for key in ("bands", "band"):
        if not isinstance(own.pop(key, []), (list, tuple, str)):
            raise InputError(f"{name}: {key} in [sensor] must be a list, got {values[key]!r}.")
    base = preset(str(own.pop("preset", "thesis")))
    if "band" in values:
        own = {"name": "custom"} | own | {"bands": tuple(_band(b, name) for b in values["band"])}
    if "bits" in own:
        own["bits"] = int(own["bits"])
    return replace(base, **own), (bands,) if isinstance(bands, str) else tuple(map(str, bands))


def _band(values: Any, name: str) -> SensorBand:
    read = _read("sensor.band", values, [f.name for f in fields(SensorBand)], name)
    if not {"name", "low", "high", "full_scale"} <= set(read):
        raise InputError(f"{name}: a [[sensor.band]] has name, low, high [nm] and full_scale [W m-2 sr-1 nm-1].")
    if not 300.0 <= read["low"] < read["high"] or read["low"] > 999.0 or read["full_scale"] <= 0.0:
        raise InputError(
            f"{name}: band {read['name']} must have 300 <= low < high (low to 999 nm), full_scale above 0."
        )
    return SensorBand(**read | {"name": str(read["name"])})
