"""Flight lines: share of the field of view in glint for each heading, and the heading with the least glint.

If every heading has too much glint, `alternatives` searches for another time to fly and another tilt of the sensor.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np
import numpy.typing as npt

from ..physics import EARTH_RADIUS, glint, sun
from ..physics._checks import Checked, Floats, ranged
from .mission import SUN_LIMIT, Mission, tables_of

FREE = 0.02  # a heading is good if at most this share of the view is in glint [1]
USABLE = 0.5  # largest share of the view in glint for which a heading is recommended [1]: half of the line is of use
_ACROSS, _ALONG = 121, 31  # number of points across and along the field of view
HEADINGS = np.arange(0.0, 360.0, 15.0)  # headings that are tried for alternatives [degree]
TIME_STEP = 30  # step between the times that are tried [minute]
TILTS = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)  # pitch and roll that are tried, to either side [degree]
WORTHWHILE = 0.5  # an alternative above `FREE` must have less than this fraction of the glint on the best heading [1]


@dataclass(frozen=True, kw_only=True)
class FieldOfView(Checked):
    """Field of view of a sensor (of one image, or of a scan line), its tilt, and the altitude of the sensor [m].

    `across` and `along` are full angles across and along the track [degree]; `along` is 0 for a line scanner. `pitch`
    (forward positive) and `roll` (to the right positive) tilt the middle of the view away from nadir [degree].
    """

    across: float = ranged(40.0, 0.0, 160.0, "degrees", "Give the full angle across the track.")
    along: float = ranged(0.0, 0.0, 160.0, "degrees", "Give the full angle along the track; 0 is a line scanner.")
    pitch: float = ranged(0.0, -80.0, 80.0, "degrees", "Give how far its middle looks forward; 0 is straight down.")
    roll: float = ranged(0.0, -80.0, 80.0, "degrees", "Give how far its middle looks to the right.")
    altitude: float = ranged(300.0, 1.0, 4e7, "m", "Give metres above the sea: the Earth is round.")


class Line:
    """Glint in the field of view on flight lines with several headings [degree], by default every 5 degrees.

    Points beyond the largest zenith angle of the glint model, 89 degrees, or above the horizon count as in glint.
    """

    def __init__(self, mission: Mission, view: FieldOfView, headings: npt.ArrayLike | None = None) -> None:
        self.mission, self.view = mission, view
        self.heading = np.arange(0.0, 360.0, 5.0) if headings is None else np.atleast_1d(np.asarray(headings, float))
        zenith, azimuth = viewing_geometries(view, self.heading)
        seen, wind = zenith < glint.VIEW_LIMIT, mission.slope_wind
        strength = glint.sun_glint(*mission.sun, np.where(seen, zenith, 0.0), azimuth, **wind.options).radiance
        kept = np.where(seen, strength, 0.0)
        # share of the view, in equal steps of angle, whose glint exceeds the limit, (heading,) [1]
        self.fraction = (~seen | (strength > mission.limits.glint)).mean(axis=(1, 2))
        self.mean = kept.mean(axis=(1, 2))  # mean glint strength, with 0 where it is not modelled, (heading,) [1/sr]
        self.across = np.linspace(-0.5, 0.5, _ACROSS) * view.across  # angles across the track, right positive [degree]
        # largest glint along the track at each angle across it, (heading, across) [1/sr]; NaN where not modelled
        self.profile = np.where(seen.any(axis=1), kept.max(axis=1), np.nan)
        # indices of the headings with the smallest and the largest share of the view in glint; where shares are equal,
        # with the least and the most mean glint
        share = self.fraction.round(3)
        self.best, self.worst = int(np.lexsort((self.mean, share))[0]), int(np.lexsort((-self.mean, -share))[0])
        least, most = float(self.fraction[self.best]), float(self.fraction[self.worst])
        self.is_good = least <= FREE  # whether at most `FREE` of the view is in glint on the best heading
        self.is_any = most < 5e-4  # whether any heading will do: less than 0.05 % of the view is in glint on the worst
        self.is_recommended = not self.is_any and least <= USABLE  # whether the best heading is recommended

    def words(self) -> str:
        """Text that recommends a heading, or states that any heading will do, or that none is good."""
        where = f"{self.view.across:g} degrees across" + (f" by {self.view.along:g}" if self.view.along else "")
        if self.is_any:
            return f"Any heading will do: no part of the view ({where}) is in glint."
        (best, least), (worst, most) = (
            (f"{self.heading[k]:03.0f}", f"{100 * self.fraction[k]:.0f} %") for k in (self.best, self.worst)
        )
        if self.fraction[self.best] > 0.995:
            return f"No heading is good: all of the view ({where}) is in glint on every one."
        if self.fraction[self.best] > USABLE:
            return f"No heading is good: at least {least} of the view ({where}) is in glint; least on heading {best}."
        return f"Fly heading {best}: {least} of the view ({where}) in glint; worst is {worst} with {most}."


def viewing_geometries(view: FieldOfView, heading: npt.ArrayLike) -> tuple[Floats, Floats]:
    """Viewing geometries of a grid of points in the field of view, for headings of any shape (...) [degree].

    Returns zenith angles and azimuths of the sensor as seen from the sea, (..., along, across) [degree]. Zenith angles
    are NaN where the line of sight misses the Earth.
    """
    across = np.radians(np.linspace(-0.5, 0.5, _ACROSS) * view.across)
    along = np.radians(np.linspace(-0.5, 0.5, _ALONG if view.along else 1) * view.along)[:, None]
    right, ahead = np.tan(across) + 0.0 * along, np.tan(along) + 0.0 * across
    down = np.ones_like(right)
    pitch, roll = np.radians(view.pitch), np.radians(view.roll)
    right, down = right * np.cos(roll) + down * np.sin(roll), down * np.cos(roll) - right * np.sin(roll)
    ahead, down = ahead * np.cos(pitch) + down * np.sin(pitch), down * np.cos(pitch) - ahead * np.sin(pitch)
    level = np.hypot(right, ahead)
    sine = level / np.hypot(level, down) * (1.0 + view.altitude / EARTH_RADIUS)
    zenith = np.degrees(np.arcsin(np.where((sine <= 1.0) & (down > 0.0), sine, np.nan)))
    towards = np.degrees(np.arctan2(right, ahead)) + np.asarray(heading, np.float64)[..., None, None]
    return np.broadcast_to(zenith, towards.shape), (towards + 180.0) % 360.0


@dataclass(frozen=True)
class Alternative:
    """A flight line with less glint, at another time or with another tilt of the sensor."""

    heading: float  # [degree]
    fraction: float  # share of the field of view in glint [1]
    time: np.datetime64 | None  # when to fly, UTC; None: at the time of the plan
    pitch: float  # of the sensor, forward positive [degree]
    roll: float  # of the sensor, to the right positive [degree]

    def words(self) -> str:
        """Text that recommends the alternative: its time, or else its pitch and roll (those that are not 0)."""
        end = f"fly heading {self.heading:03.0f}: {100 * self.fraction:.0f} % of the view in glint."
        if self.time is not None:
            return f"Another time: at {str(self.time)[:16].replace('T', ' ')} UTC {end}"
        pitch = f"{abs(self.pitch):.0f} degrees {'forward' if self.pitch > 0 else 'back'}"
        roll = f"{abs(self.roll):.0f} degrees to the {'right' if self.roll > 0 else 'left'}"
        tilts = [text for text, angle in ((pitch, self.pitch), (roll, self.roll)) if angle]
        return f"Another view angle: look {' and '.join(tilts)} and {end}"


def alternatives(mission: Mission, line: Line) -> tuple[Alternative, ...]:
    """Find at most one other time and one other tilt of the sensor for which a flight line has less glint.

    A time (or tilt) is suitable if at most the share `FREE` of the view is in glint. The nearest suitable time and the
    smallest suitable tilt are selected. If there is none, the time (or tilt) with the smallest share is selected, if
    this share is below `WORTHWHILE` times that on the best heading of `line`. The result is empty if `line.is_good`.
    """
    if line.is_good:
        return ()
    found = (_nearest(tried, line) for tried in (_times(mission, line.view), _tilts(mission, line.view)))
    return tuple(one for one in found if one is not None)


def _nearest(tried: Iterator[Alternative], line: Line) -> Alternative | None:
    """Select one of `tried`, or None, as in `alternatives`; the nearest time or the smallest tilt must come first."""
    found = []
    for one in tried:
        if one.fraction <= FREE:
            return one
        found.append(one)
    least = min(found, key=lambda one: one.fraction, default=None)
    return least if least and least.fraction < WORTHWHILE * line.fraction[line.best] else None


def _times(mission: Mission, view: FieldOfView) -> Iterator[Alternative]:
    """Yield the best line at each time within 12 hours with the sun up, nearest first; none if sun angles are given."""
    if mission.place is None or mission.moment is None or mission.sun_zenith is not None:
        return
    steps = np.arange(TIME_STEP, 12 * 60 + 1, TIME_STEP)
    when = mission.moment + np.stack([steps, -steps], axis=1).ravel() * np.timedelta64(60, "s")
    for time, zenith in zip(when, sun.position(*mission.place, when).zenith, strict=True):
        if zenith <= SUN_LIMIT:
            yield _tried(replace(mission, time=time), view, time)


def _tilts(mission: Mission, view: FieldOfView) -> Iterator[Alternative]:
    """Yield the best line with roll or pitch set to plus or minus each of `_angles(view)`, smallest angle first."""
    for tilt in _angles(view):
        for change in ({"roll": tilt}, {"roll": -tilt}, {"pitch": tilt}, {"pitch": -tilt}):
            yield _tried(mission, replace(view, **change), None)


def _angles(view: FieldOfView) -> list[float]:
    """Tilts in `TILTS` [degree] whose sum with half of the larger angle of the view is below 80 degrees."""
    return [tilt for tilt in TILTS if tilt + 0.5 * max(view.across, view.along) < 80.0]


def _tried(mission: Mission, view: FieldOfView, time: np.datetime64 | None) -> Alternative:
    line = Line(mission, view, HEADINGS)
    k = line.best
    return Alternative(float(line.heading[k]), float(line.fraction[k]), time, view.pitch, view.roll)


def words(line: Line, others: tuple[Alternative, ...]) -> list[str]:
    """Lines of text that recommend a heading, or state that any or none is good; then alternatives, or other advice."""
    out = [line.words(), *(one.words() for one in others)]
    if not line.is_good and not others:
        tried = ["other time of the day"] if line.mission.place and line.mission.sun_zenith is None else []
        tried += [f"tilt up to {tilt:g} degrees" for tilt in _angles(line.view)[-1:]]
        better = f"No {' and no '.join(tried)} is much better" if tried else "No other time and no tilt could be tried"
        out.append(f"{better}: wait for less wind.")
    return out


def numbers(mission: Mission, line: Line, others: tuple[Alternative, ...]) -> dict[str, object]:
    """Values for JSON via `raster.output.plain`: mission, view, best heading, alternatives, glint of all headings."""
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
