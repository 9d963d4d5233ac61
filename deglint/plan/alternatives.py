"""What else to do where every heading of a flight line has glint: fly at another time, or tilt the sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..physics import sun
from .mission import SUN_LIMIT, Mission
from .missionfile import tables_of
from .swath import FREE, FieldOfView, Line, flight_line

HEADINGS = np.arange(0.0, 360.0, 15.0)
"""Headings that alternatives are tried with [degree]."""
TIME_STEP = 30
"""Step between the times that are tried [minute]."""
TILTS = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
"""Pitch and roll that are tried, to either side [degree]."""
GAIN = 0.5
"""An alternative with glint is worth a word if it has less than this share of the glint of the plan."""


@dataclass(frozen=True)
class Alternative:
    """A flight line with less glint.

    Attributes
    ----------
    heading : float
        [degree]
    fraction : float
        Share of the field of view in glint [1].
    time : numpy.datetime64 or None
        When to fly, UTC; None at the time of the plan.
    pitch, roll : float
        Of the sensor [degree].
    """

    heading: float
    fraction: float
    time: np.datetime64 | None
    pitch: float
    roll: float

    def words(self, view: FieldOfView) -> str:
        """What to do, in a sentence; `view` is that of the plan."""
        end = f"fly heading {self.heading:03.0f}: {100 * self.fraction:.0f} % of the view in glint."
        if self.time is not None:
            return f"Another time: at {str(self.time)[:16].replace('T', ' ')} UTC {end}"
        if self.pitch != view.pitch:
            way = "forward" if self.pitch > 0 else "back"
            return f"Another view angle: look {abs(self.pitch):.0f} degrees {way} and {end}"
        way = "right" if self.roll > 0 else "left"
        return f"Another view angle: look {abs(self.roll):.0f} degrees to the {way} and {end}"


def alternatives(mission: Mission, line: Line) -> tuple[Alternative, ...]:
    """What else to do; empty where a heading of the line is good, or nothing is better.

    Parameters
    ----------
    mission : Mission
    line : Line
        The flight lines of the mission.

    Returns
    -------
    tuple of Alternative
        At most one of another time and one of another view angle: the nearest that is free of glint, or else the one
        with the least glint.
    """
    if line.is_good:
        return ()
    found = (_nearest(tried, line) for tried in (_times(mission, line.view), _tilts(mission, line.view)))
    return tuple(one for one in found if one is not None)


def _nearest(tried: Iterator[Alternative], line: Line) -> Alternative | None:
    """The first that is free of glint, else the one with the least, if that is much less than now."""
    least = None
    for one in tried:
        if one.fraction <= FREE:
            return one
        if least is None or one.fraction < least.fraction:
            least = one
    return least if least is not None and least.fraction < GAIN * line.fraction[line.best] else None


def _times(mission: Mission, view: FieldOfView) -> Iterator[Alternative]:
    """Times of the day around that of the mission, the nearest first."""
    if mission.latitude is None or mission.longitude is None or mission.sun_zenith is not None:
        return
    assert mission.moment is not None
    steps = np.arange(TIME_STEP, 12 * 60 + 1, TIME_STEP)
    when = mission.moment + np.stack([steps, -steps], axis=1).ravel() * np.timedelta64(60, "s")
    for time, zenith in zip(when, sun.position(mission.latitude, mission.longitude, when).zenith, strict=True):
        if zenith <= SUN_LIMIT:
            yield _tried(mission.at(time), view, time)


def _tilts(mission: Mission, view: FieldOfView) -> Iterator[Alternative]:
    """Pitch and roll, the smallest first."""
    for tilt in TILTS:
        for change in ({"roll": tilt}, {"roll": -tilt}, {"pitch": tilt}, {"pitch": -tilt}):
            if abs(next(iter(change.values()))) + 0.5 * max(view.across, view.along) < 80.0:
                yield _tried(mission, replace(view, **change), None)


def _tried(mission: Mission, view: FieldOfView, time: np.datetime64 | None) -> Alternative:
    line = flight_line(mission, view, HEADINGS)
    k = line.best
    return Alternative(float(line.heading[k]), float(line.fraction[k]), time, view.pitch, view.roll)


def words(line: Line, others: tuple[Alternative, ...]) -> list[str]:
    """The plan in sentences: the heading to fly, or that there is none, and what else to do."""
    out = [line.words(), *(one.words(line.view) for one in others)]
    if not line.is_good and not others:
        out.append("No other time of the day and no tilt up to 60 degrees is much better: wait for less wind.")
    return out


def numbers(mission: Mission, line: Line, others: tuple[Alternative, ...]) -> dict[str, Any]:
    """The flight lines and the alternatives for JSON."""
    return {
        "mission": tables_of(mission),
        "view": asdict(line.view),
        "best": {"heading": line.heading[line.best], "fraction": line.fraction[line.best]},
        "alternatives": [
            {name: value for name, value in asdict(one).items() if name != "time"}
            | ({} if one.time is None else {"time": f"{one.time}Z"})
            for one in others
        ],
        "words": " ".join(words(line, others)),
        "heading": line.heading,
        "fraction": line.fraction,
        "mean_glint": line.mean,
    }
