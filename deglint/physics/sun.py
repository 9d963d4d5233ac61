"""Position, distance and solid angle of the sun.

Positions are computed by the solar position algorithm of pvlib, which is imported at first use. Zenith angle and
azimuth are as seen from a place on the ground; by default the zenith angle includes refraction.

References
----------
Reda, Andreas (2004), "Solar position algorithm for solar radiation applications", Solar Energy 76,
577-589, doi:10.1016/j.solener.2003.12.003. Gregg, Carder (1990); see `deglint.physics.atmosphere`.
"""

from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cache
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ._checks import Array, coordinates, day_number, within

Time = str | datetime | np.datetime64  # a str is in ISO 8601 format
Times = Time | Sequence[Time] | npt.NDArray[np.datetime64]
MEAN_SOLID_ANGLE = 6.794e-5  # solid angle of the solar disk at mean distance [sr]; its radius is 0.2665 degrees
_DELTA_T = 69.2  # terrestrial minus universal time [s], 2020 to 2030; an error of 10 s moves the sun by 1e-4 degrees


class Position(NamedTuple):
    """Position of the sun: zenith angle and azimuth clockwise from north, both [degree]."""

    zenith: Array
    azimuth: Array


def position(
    latitude: npt.ArrayLike,
    longitude: npt.ArrayLike,
    time: Times,
    *,
    pressure: float = 1013.25,
    temperature: float = 15.0,
    refraction: bool = True,
) -> Position:
    """Compute the position of the sun, accurate to about 0.001 degrees (Reda and Andreas 2004).

    The zenith angle is above 90 where the sun is below the horizon.

    Parameters
    ----------
    latitude, longitude : array_like
        Latitude and longitude of the place, north and east positive [degree].
    time : datetime, str or numpy.datetime64, or a sequence of them
        Times; a str must be in ISO 8601 format. A time without a time zone is in UTC.
    pressure, temperature : float
        Pressure [hPa] and temperature [degree Celsius] of the air, for refraction.
    refraction : bool
        If True, the zenith angle is the apparent one, with refraction by the air. If False, it is the geometric one.

    Examples
    --------
    >>> zenith, azimuth = position(36.8, -122.0, "2026-06-21T18:00Z")
    >>> float(zenith.round(1)), float(azimuth.round(1))
    (30.9, 106.4)
    """
    latitude, longitude = coordinates(latitude, longitude)
    pressure = float(within("pressure", pressure, 300.0, 1100.0, "hPa", "One inch of mercury is 33.86 hPa."))
    temperature = float(within("temperature", temperature, -90.0, 60.0, "degrees Celsius", "0 Celsius is 273 kelvin."))
    moments, latitude, longitude = np.broadcast_arrays(_seconds(time), latitude, longitude)
    place = (latitude.ravel(), longitude.ravel(), 0.0, pressure, temperature, _DELTA_T, 0.5667)
    apparent, geometric, _, _, azimuth, _ = _spa().solar_position_numpy(moments.ravel(), *place, 1)
    zenith = apparent if refraction else geometric
    return Position(np.reshape(zenith, moments.shape), np.reshape(azimuth, moments.shape))


def next_rise(latitude: float, longitude: float, time: Time, *, zenith: float = 90.0) -> np.datetime64:
    """Time in UTC of the next sunrise, accurate to about a minute; NaT if the sun does not rise within a day.

    At sunrise the centre of the sun, with refraction, rises above the zenith angle `zenith` [degree], by default that
    of the horizon. The search starts at `time`; other arguments are as in `position`.

    Examples
    --------
    >>> str(next_rise(0.0, 0.0, "2026-03-20T00:00Z"))[:15]
    '2026-03-20T06:0'
    """
    moments = np.asarray(_seconds(time) * 1e3).astype("datetime64[ms]") + np.arange(1442).astype("timedelta64[m]")
    up = position(latitude, longitude, moments).zenith <= zenith
    rises = np.flatnonzero(~up[:-1] & up[1:])
    if not rises.size:
        return np.datetime64("NaT", "s")
    return np.datetime64(moments[rises[0] + 1], "s")


def distance_factor(day: npt.ArrayLike) -> Array:
    """Solar irradiance on a day of the year, relative to the irradiance at the mean distance of the sun [1].

        [1 + 0.0167 cos(2 pi (day - 3) / 365)]^2

    Examples
    --------
    >>> distance_factor([3, 186]).round(4).tolist()
    [1.0337, 0.9669]
    """
    return np.square(1.0 + 0.0167 * np.cos(2.0 * np.pi * (day_number(day) - 3.0) / 365.0))


def solid_angle(day: npt.ArrayLike | None = None) -> Array:
    """Solid angle [sr] of the solar disk on a day of the year; without a day, at the mean distance of the sun.

    Examples
    --------
    >>> float(solid_angle())
    6.794e-05
    """
    return np.asarray(MEAN_SOLID_ANGLE * (1.0 if day is None else distance_factor(day)))


def day_of_year(time: Times) -> Array:
    """Day of the year with its fraction, 1.0 at the start of the first of January UTC; `time` is as in `position`.

    Examples
    --------
    >>> float(day_of_year("2026-02-01T12:00"))
    32.5
    """
    moments = (_seconds(time) * 1e3).astype("datetime64[ms]")
    return (moments - moments.astype("datetime64[Y]")) / np.timedelta64(1, "D") + 1.0


def moment(time: Time) -> np.datetime64:
    """Convert one time, in a form that `position` accepts, to UTC, rounded down to seconds.

    Raises InputError if the time is NaT, or if its text is not in ISO 8601 format.

    Examples
    --------
    >>> str(moment("2026-06-21T20:00+02:00"))
    '2026-06-21T18:00:00'
    """
    if np.isnan(seconds := _seconds(time)):
        raise InputError("time must be like 2026-06-21T18:00Z, got NaT. Leave it out for now.")
    return np.datetime64(int(np.floor(seconds)), "s")


@cache
def _spa() -> ModuleType:
    """Import the module pvlib.spa without the rest of pvlib, whose import takes a second; spa needs only numpy."""
    package: Any = find_spec("pvlib")
    found: Any = spec_from_file_location("spa", Path(package.origin).with_name("spa.py"))
    module = module_from_spec(found)
    found.loader.exec_module(module)
    return module


def _seconds(time: Times) -> Array:
    """Convert one time or an array of times, as `position` accepts them, to seconds since the start of 1970 UTC."""
    array = np.asarray(time)
    if np.issubdtype(array.dtype, np.datetime64):
        return np.asarray((array - np.datetime64(0, "s")) / np.timedelta64(1, "s"), dtype=np.float64)
    return np.array([_moment(item).timestamp() for item in array.ravel().tolist()]).reshape(array.shape)


def _moment(time: str | datetime) -> datetime:
    """Convert a datetime or ISO 8601 text to a datetime with a time zone (default UTC), or raise InputError."""
    try:
        moment = time if isinstance(time, datetime) else datetime.fromisoformat(time)
    except (TypeError, ValueError):
        raise InputError(f"time must be like 2026-06-21T18:00Z, got {time!r}. Write it in ISO 8601.") from None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)
