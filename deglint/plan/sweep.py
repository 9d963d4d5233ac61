"""A mission over a span of time: the best time, and the viewing geometries at each time."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..physics import sun
from .advice import ViewingGeometry, best_geometry, compass
from .dataset import excluded_share
from .mission import SUN_LIMIT, Mission
from .missionfile import tables_of
from .reticle import Reticle, reticle

DAYLIGHT = 15.0  # least solar elevation with enough light under water [degree]


@dataclass(frozen=True)
class Moment:
    """Summary of a mission at one time."""

    time: np.datetime64  # UTC
    sun_zenith: float  # [degree]
    sun_azimuth: float  # [degree]
    geometry: ViewingGeometry | None  # the best one; None where all are excluded, or the sun is too low
    excluded_share: float  # share of the solid angle of all viewing geometries that is excluded [1]


def times(start: Any, end: Any, minutes: float) -> list[np.datetime64]:
    """Times (UTC) from start to end, `minutes` apart; the end is included if a step falls on it.

    Raises InputError: the end lies before the start.
    """
    first, last = sun.moment(start), sun.moment(end)
    if last < first:
        raise InputError(f"--to must not lie before --from, got {first}Z to {last}Z.")
    step = np.timedelta64(round(60 * minutes), "s")
    return [first + k * step for k in range(int((last - first) / step) + 1)]


def highest_sun(latitude: float, longitude: float, when: list[np.datetime64]) -> np.datetime64:
    """The time in `when` (UTC) with the highest solar elevation, at a latitude and longitude [degree]."""
    zenith = sun.position(latitude, longitude, np.array(when, dtype="datetime64[s]")).zenith
    return when[int(np.argmin(zenith))]


def next_daylight(latitude: float, longitude: float, start: Any = None) -> np.datetime64:
    """First time (UTC), in steps of 10 minutes from `start`, when the sun is at least `DAYLIGHT` degrees high.

    If it never is within 24 hours: the time when the sun is highest. `start` is now by default.

    Examples
    --------
    >>> str(next_daylight(36.8, -122.0, "2026-06-21T05:00Z"))
    '2026-06-21T14:20:00'
    """
    first = np.datetime64("now", "s") if start is None else sun.moment(start)
    when = first + np.arange(0, 145) * np.timedelta64(600, "s")
    high = 90.0 - sun.position(latitude, longitude, when).zenith
    return np.datetime64(when[int(np.argmax(high >= min(DAYLIGHT, high.max())))], "s")


def plans(mission: Mission, when: list[np.datetime64]) -> Iterator[tuple[Moment, Reticle | None]]:
    """Summary and reticle of a mission at each of several times (UTC); the reticle is None where the sun is too low.

    Raises InputError: the mission has no place.
    """
    if mission.place is None:
        raise InputError("a sweep over time needs a place: give latitude and longitude, not the sun's angles.")
    zeniths, azimuths = sun.position(*mission.place, np.array(when, dtype="datetime64[s]"))
    for time, zenith, azimuth in zip(when, zeniths, azimuths, strict=True):
        if zenith > SUN_LIMIT:
            yield Moment(time, float(zenith), float(azimuth), None, 1.0), None
            continue
        plan = reticle(replace(mission.coarse(), time=time))
        yield Moment(time, float(zenith), float(azimuth), best_geometry(plan), excluded_share(plan)), plan


def best_moment(moments: Sequence[Moment]) -> Moment | None:
    """The summary of the time with the highest contrast; None if no time has a good viewing geometry."""
    good = [m for m in moments if m.geometry is not None]
    return max(good, key=lambda m: m.geometry.contrast if m.geometry else 0.0, default=None)


def table(moments: list[Moment]) -> list[str]:
    """The sweep as lines of text, one line for each time."""
    out = [f"{'UTC':<17}{'sun':>5}{'best viewing geometry':>32}{'x noise':>9}{'glint':>9}{'excluded':>10}"]
    best = best_moment(moments)
    for m in moments:
        head = f"{str(m.time)[:16].replace('T', ' '):<17}{90 - m.sun_zenith:>4.0f}°"
        if m.geometry is None:
            why = "none: all are spoilt" if m.sun_zenith <= SUN_LIMIT else "the sun is down"
            out.append(f"{head}{why:>32}")
            continue
        seen = m.geometry
        where = "straight down" if seen.zenith < 1 else f"{seen.zenith:.0f}° off nadir, {compass(seen.azimuth)}"
        figures = f"{seen.contrast:>9.0f}{seen.glint_probability:>9.0e}{m.excluded_share:>10.0%}"
        out.append(f"{head}{where:>32}{figures}" + ("  <- best" if m is best else ""))
    return out


def numbers(mission: Mission, moments: list[Moment]) -> dict[str, Any]:
    """The sweep as values for JSON."""
    best = best_moment(moments)
    rows = {id(m): asdict(m) | {"time": f"{m.time}Z"} for m in moments}
    fixed = tables_of(mission)
    fixed.get("place", {}).pop("time", None)
    return {"mission": fixed, "best": None if best is None else rows[id(best)], "moments": list(rows.values())}
