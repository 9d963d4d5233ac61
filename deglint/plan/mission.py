"""The input of a plan: place and time, wind, air, water, object, sensor, and limits.

A `Mission` has defaults, and rejects values outside the range of the models. `mission_from` makes one from tables of
numbers and text, `tables_of` does the opposite, and `merged` lets options of the command override a TOML file.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import date, datetime
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np

from ..errors import BandError, InputError
from ..physics import slopes, sun
from ..physics._checks import Checked, check_quantity, one_of, ranged
from ..physics.atmosphere import CLEAR_AIR, Air, ozone
from ..physics.presets import preset
from ..physics.sensor import Sensor, SensorBand
from ..physics.sky import SKY_MODELS as SKIES
from ..physics.sun import Time
from .skylight import Wind

WATERS = ("scattering", "absorption")  # models of light propagation from an object under water
MEASURED_WIND = 14.0  # largest wind at which Cox and Munk measured slopes [m/s]
SUN_LIMIT = 89.0  # sun zenith angle beyond which no plan is computed [degree]
COARSE_STEP = 2.0  # least step between viewing geometries in plans that need many reticles [degree]


@dataclass(frozen=True, kw_only=True)
class Limits(Checked):
    """Limits beyond which a viewing geometry is excluded.

    Attributes
    ----------
    glint : float
        Largest glint radiance per irradiance of a plane facing the sun [1/sr]. In ocean colour, 1e-4 counts as moderate
        glint and 5e-3 as high glint.
    glint_probability : float, optional
        Largest share of the sea that may reflect the sun [1]; by default there is no such limit.
    tolerance : float, optional
        The glint probability is the share of the sea that reflects the sky within this angle of the centre of the sun
        [degree]. By default, the angle is the radius of the solar disk.
    sky_ratio, sky_probability : float
        A band is excluded where more than the share `sky_probability` [1] of the sea reflects skylight that is brighter
        than `sky_ratio` [1] times the radiance of deep water.
    snr, ner : float
        Contrast over noise above which the object is detectable in a band [1]; noise-equivalent radiance of all bands
        [W m-2 sr-1 nm-1], which by default is computed from the sensor.
    """

    glint: float = ranged(1e-3, 1e-12, 10.0, "1/sr", "1e-3 is the default, 1e-4 strict.")
    glint_probability: float | None = ranged(None, 0.0, 1.0, "", "Give a share, such as 1e-5.")
    tolerance: float | None = ranged(None, 1e-3, 20.0, "degrees", "The solar disk has 0.27.")
    sky_ratio: float = ranged(2.0, 1e-3, 1e6, "", "2 means: the sky twice as bright as the water.")
    sky_probability: float = ranged(0.1, 0.0, 1.0, "", "Give a share, such as 0.1.")
    snr: float = ranged(3.0, 0.0, 1e6, "", "3 is usual: contrast of three times the noise.")
    ner: float | None = ranged(None, 1e-9, 10.0, "W m-2 sr-1 nm-1", "5e-4 is usual.")


@dataclass(frozen=True, kw_only=True)
class Mission(Checked):
    """All parameters of a plan. Give latitude and longitude, or both angles of the sun; the rest has defaults.

    Raises InputError if a value is out of the range of its model, or if the sun is unknown or less than 1 degree high;
    BandError if a band is unknown, or two bands of the sensor have the same name.

    Attributes
    ----------
    latitude, longitude : float, optional
        Place of the object, north and east positive [degree].
    time : str, datetime or numpy.datetime64, optional
        Time, UTC if it has no time zone; by default the current time.
    sun_zenith, sun_azimuth : float, optional
        Zenith angle and azimuth of the sun, instead of place and time [degree].
    wind, wind_from, wind_height : float
        Wind speed [m/s], azimuth from which the wind blows [degree], and height at which it is measured [m].
    air : Air, optional
        State of the atmosphere. Its field `wind` is ignored: the wind of the mission at 10 m is used. By default,
        `wind_mean` is this wind, too, humidity is 80 %, water vapour 2.5 cm, visibility 40 km, and ozone has its
        climatological value for the place and day (300 DU without a place).
    chlorophyll : float
        Chlorophyll of the case-1 water [mg m-3].
    depth, reflectance : float
        Depth below the surface [m] and reflectance [1] of the object.
    sensor, bands : Sensor, tuple of str
        The sensor, and the names of the bands to use; an empty tuple selects all bands.
    slopes, sky : str
        Slope model, a key of `deglint.physics.slopes.MODELS`; sky model, one of `deglint.physics.sky.SKY_MODELS`.
    water : {"scattering", "absorption"}
        Model of the light from the object: scattering and absorbing water (Lee et al. 1999), or only absorbing water.
    limits : Limits
        Limits beyond which a viewing geometry is excluded.
    step, widest : float
        Step between viewing geometries, rounded to fit `widest` and 360; largest zenith angle of the sensor [degree].
    """

    # `file` is the table and key of a field in a mission file
    latitude: float | None = ranged(None, -90, 90, "degrees", "North is positive.", file="place.latitude")
    longitude: float | None = ranged(None, -180, 360, "degrees", "East is positive.", file="place.longitude")
    time: Time | None = field(default=None, metadata={"file": "place.time"})
    sun_zenith: float | None = ranged(None, 0, SUN_LIMIT, "degrees", "Give a sun that is up.", file="sun.zenith")
    sun_azimuth: float | None = ranged(None, -360, 360, "degrees", "Give an azimuth from north.", file="sun.azimuth")
    wind: float = field(default=5.0, metadata={"file": "wind.speed"})
    wind_from: float = ranged(0.0, -360, 360, "degrees", "Give the azimuth it blows from.", file="wind.from")
    wind_height: float = ranged(10.0, 1, 100, "m", "Give the height of the mast.", file="wind.height")
    air: Air | None = None
    chlorophyll: float = ranged(
        0.5, 0.01, 30, "mg m-3", "0.5 is usual on a shelf, 0.05 offshore.", file="water.chlorophyll"
    )
    depth: float = ranged(5.0, 0, 1000, "m", "Give metres below the surface, positive down.", file="object.depth")
    reflectance: float = ranged(0.15, 0, 1, "", "Give a share, not per cent.", file="object.reflectance")
    sensor: Sensor = field(default_factory=lambda: preset("thesis"))
    bands: tuple[str, ...] = ()
    slopes: str = one_of("cox-munk", slopes.MODELS, file="models.slopes")
    sky: str = one_of("harrison-coombes", SKIES, file="models.sky")
    water: Literal["scattering", "absorption"] = one_of("scattering", WATERS, file="water.model")
    limits: Limits = field(default_factory=Limits)
    step: float = ranged(
        1.0, 0.25, 10, "degrees", "1 is usual; memory grows with its inverse square.", file="view.step"
    )
    widest: float = ranged(80.0, 10, 85, "degrees", "Beyond it waves shadow each other.", file="view.widest")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_quantity("wind", self.wind, 0.1, self.strongest_wind, "m/s", "The slope models hold in this range only.")
        object.__setattr__(self, "wind", float(self.wind))  # JSON has no numbers of numpy
        if len({b.name.casefold() for b in self.sensor.bands}) < len(self.sensor.bands):
            names = ", ".join(b.name for b in self.sensor.bands)
            raise BandError(
                f"two bands of sensor {self.sensor.name} have one name: {names}. Give each a name of its own."
            )
        for name in self.bands:
            self.sensor.band(name)
        if (self.sun_zenith is None) != (self.sun_azimuth is None):
            raise InputError("sun_zenith and sun_azimuth go together; give both, or place and time.")
        if self.sun_zenith is None:
            self._check_place()

    def _check_place(self) -> None:
        if self.place is None:
            raise InputError(
                "where the sun stands is not known: give latitude and longitude (--lat and --lon, or --place), or the "
                "angles of the sun (--sun)."
            )
        if self.sun[0] > SUN_LIMIT:
            assert self.moment is not None  # it is known if the latitude is
            rise = sun.next_rise(*self.place, self.moment, zenith=SUN_LIMIT) + np.timedelta64(59, "s")  # whole minutes
            remedy = f"It is {90 - SUN_LIMIT:g} degree high at {str(rise)[:16]}Z: choose that or a later time."
            if np.isnat(rise):
                remedy = f"It is never {90 - SUN_LIMIT:g} degree high within a day; choose another date."
            what = f"{'below the horizon' if self.sun[0] > 90.0 else 'too low'} ({90 - self.sun[0]:.1f} degrees)"
            where = f"{self.moment}Z, latitude {self.latitude:g}, longitude {self.longitude:g}"
            raise InputError(f"the sun is {what} at {where}. {remedy}")

    @property
    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude [degree]; None if one of them is not given."""
        return None if self.latitude is None or self.longitude is None else (self.latitude, self.longitude)

    @property
    def strongest_wind(self) -> float:
        """Largest wind speed at `wind_height` for which the models of slopes and atmosphere are valid [m/s]."""
        wanted = slopes.MODELS[self.slopes].height
        at_own = slopes.wind_at_height(slopes.WIND_RANGE[1], measured_at=wanted, wanted_at=self.wind_height)
        at_ten = slopes.wind_at_height(20.0, measured_at=10.0, wanted_at=self.wind_height)
        return float(np.floor(100.0 * min(at_own, at_ten)) / 100.0)

    @cached_property
    def moment(self) -> np.datetime64 | None:
        """Time of the plan (UTC), by default the time of first access; None if neither time nor latitude is given."""
        if self.time is not None:
            return sun.moment(self.time)
        return None if self.latitude is None else np.datetime64("now", "s")

    @cached_property
    def sun(self) -> tuple[float, float]:
        """Zenith angle and azimuth of the sun [degree], as given or computed from place and time."""
        if self.sun_zenith is not None and self.sun_azimuth is not None:
            return float(self.sun_zenith), float(self.sun_azimuth) % 360.0
        assert self.place is not None
        assert self.moment is not None
        zenith, azimuth = sun.position(*self.place, self.moment)
        return float(zenith), float(azimuth)

    @property
    def day(self) -> float | None:
        """Day of the year, from which the distance of the sun follows; None if `moment` is None."""
        return None if self.moment is None else float(sun.day_of_year(self.moment))

    @cached_property
    def weather(self) -> Air:
        """State of the atmosphere: `air` or its default, with the wind of the mission converted to a height of 10 m."""
        ten = float(slopes.wind_at_height(self.wind, measured_at=self.wind_height, wanted_at=10.0))
        ten = min(ten, 20.0)  # only rounding can exceed the limit
        if self.air is not None:
            return replace(self.air, wind=ten)
        usual = 300.0 if self.place is None or self.day is None else float(ozone(*self.place, self.day))
        return replace(CLEAR_AIR, wind=ten, wind_mean=ten, ozone=usual)

    @property
    def slope_wind(self) -> Wind:
        """Wind at the reference height of the slope model, limited to the range of the slope models."""
        height = slopes.MODELS[self.slopes].height
        speed = slopes.wind_at_height(self.wind, measured_at=self.wind_height, wanted_at=height)
        return Wind(float(np.clip(speed, *slopes.WIND_RANGE)), float(self.wind_from) % 360.0, self.slopes)

    @property
    def channels(self) -> tuple[SensorBand, ...]:
        """The bands of the sensor that the plan uses."""
        return tuple(dict.fromkeys(self.sensor.band(name) for name in self.bands)) or self.sensor.bands

    @property
    def cautions(self) -> tuple[str, ...]:
        """Texts that warn of a wind or a sun elevation for which the models of the plan are less valid."""
        wind, high = f"wind {self.wind:g} m/s: slope model extrapolated", 90 - self.sun[0]
        known = {
            f"{wind} beyond {MEASURED_WIND:g} m/s; foam is not modelled.": self.wind > MEASURED_WIND,
            f"{wind} below 1 m/s; swell is not modelled.": self.wind < 1.0,
            f"sun {high:.0f} degrees high: underwater light is computed for 15 degrees.": high < 15.0,
        }
        return tuple(text for text, holds in known.items() if holds)

    def coarse(self) -> Self:
        """The same mission with a step between viewing geometries of at least `COARSE_STEP` [degree]."""
        return replace(self, step=max(self.step, COARSE_STEP))


Tables = Mapping[str, Mapping[str, object]]  # table: {key: value}

# (table, key) of a mission file: field of `Mission`
_FIELDS = {tuple(f.metadata["file"].split(".")): f.name for f in fields(Mission) if "file" in f.metadata}
_TABLES = ("place", "sun", "wind", "air", "water", "object", "sensor", "limits", "view", "models")
_KEYS: dict[str, tuple[str, ...]] = {  # further keys of some tables
    "wind": ("mean",),
    "air": tuple(f.name for f in fields(Air) if "wind" not in f.name),
    "sensor": ("preset", "bands", "band", *(f.name for f in fields(Sensor))),
    "limits": tuple(f.name for f in fields(Limits)),
}
# keys whose values need not be numbers; `_read` returns them unchecked
_NO_NUMBERS = ("time", "model", "slopes", "sky", "pressure", "preset", "bands", "band", "name")
# pressure of one unit [hPa]
_HECTOPASCALS = {"hpa": 1.0, "mbar": 1.0, "mb": 1.0, "kpa": 10.0, "pa": 0.01, "mmhg": 1.333224, "inhg": 33.86389}


def mission_from(tables: Tables, name: str = "the mission") -> Mission:
    """Make a mission from tables {table: {key: value}}, as in a mission file; `name` is for error messages.

    Raises InputError if a table or key is unknown, or a value cannot be used; BandError if a band is unknown.

    >>> mission_from({"sun": {"zenith": 30, "azimuth": 180}, "wind": {"speed": 7, "from": 310}}).wind
    7.0
    """
    read: dict[str, dict[str, Any]] = {}
    for table, values in tables.items():
        known = "view" if table == "look" else table  # [look] is the old name of [view]
        if known not in _TABLES:
            raise InputError(f"{name}: {table} is not one of its tables, {', '.join(f'[{t}]' for t in _TABLES)}.")
        keys = [key for other, key in _FIELDS if other == known]
        read[known] = _read(table, values, (*keys, *_KEYS.get(known, ())), name)
    given = {own: read[table][key] for (table, key), own in _FIELDS.items() if key in read.get(table, {})}
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


def tables_of(mission: Mission) -> dict[str, dict[str, object]]:
    """Convert a mission, with its defaults, to tables {table: {key: value}} that `mission_from` can read."""
    out: dict[str, dict[str, object]] = {table: {} for table in _TABLES}
    for (table, key), own in _FIELDS.items():
        out[table][key] = getattr(mission, own)
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


def merged(below: Tables, above: Tables) -> dict[str, dict[str, object]]:
    """Merge tables: `above` overrides `below`; a table "sun" in `above` replaces "place" in `below`, and vice versa."""
    instead = {"sun": "place", "place": "sun"}
    out: dict[str, Any] = {table: values for table, values in below.items() if instead.get(table) not in above}
    for table, values in above.items():
        own = out.get(table, {})
        out[table] = {**(own if isinstance(own, Mapping) else {}), **values}
    return out


def pressure(value: object) -> float:
    """Convert a number [hPa], or a text such as "29.9 inHg", "762 mmHg" or "1013" (hPa), to a pressure [hPa].

    Raises InputError if the value is neither.

    >>> round(pressure("30 inHg"), 1)
    1015.9
    """
    found = re.fullmatch(r"\s*([0-9]+\.?[0-9]*|\.[0-9]+)\s*([A-Za-z]*)\s*", str(value))
    unit = found[2].lower() or "hpa" if found else ""
    if found and unit in _HECTOPASCALS:
        return float(found[1]) * _HECTOPASCALS[unit]
    raise InputError(f"pressure must be like 1013 hPa, 29.9 inHg or 760 mmHg, got {value!r}. Name the unit.")


def _read(table: str, values: object, known: Iterable[str], name: str) -> dict[str, Any]:
    """Copy the table `values` with numbers as float; raise InputError for a wrong value or a key not in `known`."""
    if not isinstance(values, Mapping):
        raise InputError(f"{name}: {table} must be a table; write [{table}] with its values below.")
    out: dict[str, Any] = {}
    for key, value in values.items():
        if key not in known:
            raise InputError(f"{name}: unknown key {key} in [{table}]; allowed are {', '.join(known)}.")
        if key in _NO_NUMBERS:
            out[key] = value
        elif isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise InputError(f"{name}: {key} in [{table}] must be a number, got {value!r}.")
        else:
            out[key] = float(value)
    return out


def _sensor(values: dict[str, Any], name: str) -> tuple[Sensor, tuple[str, ...]]:
    """Make a sensor from `values`, the table [sensor] of a mission; return it and the bands to use (empty: all)."""
    own, bands = dict(values), values.get("bands", ())
    for key in ("bands", "band"):
        if not isinstance(own.pop(key, []), (list, tuple, str)):
            raise InputError(f"{name}: {key} in [sensor] must be a list, got {values[key]!r}.")
    base = preset(str(own.pop("preset", "thesis")))
    if "band" in values:
        own = {"name": "custom"} | own | {"bands": tuple(_band(b, name) for b in values["band"])}
    return replace(base, **own), (bands,) if isinstance(bands, str) else tuple(map(str, bands))


def _band(values: object, name: str) -> SensorBand:
    read = _read("sensor.band", values, [f.name for f in fields(SensorBand)], name)
    if not {"name", "low", "high", "full_scale"} <= set(read):
        raise InputError(f"{name}: a [[sensor.band]] has name, low, high [nm] and full_scale [W m-2 sr-1 nm-1].")
    if not 300.0 <= read["low"] < read["high"] or read["low"] > 999.0:
        raise InputError(f"{name}: band {read['name']} must have 300 <= low < high (low to 999 nm).")
    return SensorBand(**read | {"name": str(read["name"])})
