"""Plans of a mission at several times, or under all winds of an interval; the best time and viewing geometry."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product

import numpy as np

from ..errors import InputError
from ..physics import slopes, sun
from ..physics._checks import check_quantity, within
from .dataset import excluded_share
from .mission import SUN_LIMIT, Mission, tables_of
from .reticle import Reticle, ViewingGeometry, best_geometry, compass, one_in, reticle, sentence

DAYLIGHT = 15.0  # least solar elevation with enough light under water [degree]
SPEEDS, TURNS = 5, 7  # numbers of speeds and directions in the interval of a wind; the mission's speed is added


@dataclass(frozen=True)
class Moment:
    """Summary of the plan of a mission at one time."""

    time: np.datetime64  # UTC
    sun_zenith: float  # [degree]
    sun_azimuth: float  # [degree]
    geometry: ViewingGeometry | None  # the best one; None where all are excluded, or the sun is too low
    excluded_share: float  # share of the solid angle of all viewing geometries that is excluded [1]


def times(start: sun.Time, end: sun.Time, minutes: float) -> list[np.datetime64]:
    """Times (UTC) from `start` to `end`, `minutes` apart; the end is included if a step falls on it.

    `start` and `end` are ISO 8601 texts, datetime or numpy.datetime64, in UTC if they have no time zone. Raises
    InputError if the end lies before the start, or if `minutes` is not 0.02 to 1e6.
    """
    first, last = sun.moment(start), sun.moment(end)
    if last < first:
        raise InputError(f"--to must not lie before --from, got {first}Z to {last}Z.")
    check_quantity("minutes", minutes, 0.02, 1e6, "", "Give the minutes from one time to the next, such as 30.")
    step = np.timedelta64(round(60 * minutes), "s")
    return [first + k * step for k in range(int((last - first) / step) + 1)]


def next_daylight(latitude: float, longitude: float, start: sun.Time | None = None) -> np.datetime64:
    """First time (UTC), in steps of 10 minutes from `start`, when the sun is at least `DAYLIGHT` degrees high.

    If the sun is not so high within 24 hours, the result is the time of the highest sun. By default, `start` is now.

    >>> str(next_daylight(36.8, -122.0, "2026-06-21T05:00Z"))
    '2026-06-21T14:20:00'
    """
    first = np.datetime64("now", "s") if start is None else sun.moment(start)
    when = first + np.arange(0, 145) * np.timedelta64(600, "s")
    high = 90.0 - sun.position(latitude, longitude, when).zenith
    return np.datetime64(when[int(np.argmax(high >= min(DAYLIGHT, high.max())))], "s")


def plans(mission: Mission, when: list[np.datetime64]) -> Iterator[tuple[Moment, Reticle | None]]:
    """Yield summary and reticle of a mission at each time in `when` (UTC); the reticle is None if the sun is too low.

    Viewing geometries are those of `mission.coarse()`. Raises InputError if the mission has no place.
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
    """Table as lines of text: the titles of the columns, then one line for each time."""
    out = [f"{'UTC':<17}{'sun':>5}{'best viewing geometry':>32}{'x noise':>9}{'glint':>9}{'excluded':>10}"]
    best = best_moment(moments)
    for m in moments:
        head = f"{str(m.time)[:16].replace('T', ' '):<17}{90 - m.sun_zenith:>4.0f}°"
        if m.geometry is None:
            why = "none: all are excluded" if m.sun_zenith <= SUN_LIMIT else "the sun is down"
            out.append(f"{head}{why:>32}")
            continue
        seen = m.geometry
        where = "straight down" if seen.zenith < 1 else f"{seen.zenith:.0f}° off nadir, {compass(seen.azimuth)}"
        figures = f"{seen.contrast:>9.0f}{seen.glint_probability:>9.0e}{m.excluded_share:>10.0%}"
        out.append(f"{head}{where:>32}{figures}" + ("  <- best" if m is best else ""))
    return out


def numbers(mission: Mission, moments: list[Moment]) -> dict[str, object]:
    """Values for JSON via `raster.output.plain`: mission, summary of the best time, and summaries of all times."""
    best = best_moment(moments)
    rows = {id(m): asdict(m) | {"time": f"{m.time}Z"} for m in moments}
    fixed = tables_of(mission)
    fixed.get("place", {}).pop("time", None)
    return {"mission": fixed, "best": None if best is None else rows[id(best)], "moments": list(rows.values())}


class WindEnsemble:
    """Glint and contrast of a mission under all winds of an interval, for a wind that is not exactly known.

    The speed is that of the mission plus or minus `speed` [m/s], within the range of the models. The direction is that
    of the mission plus or minus `turn` [degree]; 180 means any. Raises InputError if `speed` or `turn` is out of range.
    """

    def __init__(self, mission: Mission, *, speed: float = 2.0, turn: float = 30.0) -> None:
        within("wind speed uncertainty", speed, 0.0, 20.0, "m/s", "Give a plus-or-minus value.")
        within("wind direction uncertainty", turn, 0.0, 180.0, "degrees", "180 stands for not known at all.")
        self.speed, self.turn = speed, turn
        low, high = max(mission.wind - speed, slopes.WIND_RANGE[0]), min(mission.wind + speed, mission.strongest_wind)
        speeds = np.unique(np.round([*np.linspace(low, high, SPEEDS), mission.wind], 9))
        around = np.linspace(-turn, turn, TURNS)[turn == 180.0 :] if turn else np.zeros(1)  # -180 equals 180
        self.winds = speeds.tolist(), ((mission.wind_from + around) % 360.0).tolist()  # [m/s], [degree]
        coarse = mission.coarse()
        self.middle = reticle(coarse)  # reticle under the wind of the mission
        plans = (reticle(replace(coarse, wind=one, wind_from=azimuth)) for one, azimuth in product(*self.winds))
        layers = zip(*((p.glint_strength, p.glint_probability, p.combined, p.excluded) for p in plans), strict=True)
        *held, excluded = (np.array(layer) for layer in layers)
        # lowest and highest value over all winds of layers of `Reticle`, (2, zenith, azimuth); contrast is `combined`
        self.glint, self.glint_probability, self.contrast = (np.stack([v.min(axis=0), v.max(axis=0)]) for v in held)
        # the viewing geometry with the highest contrast under the worst wind; None if none is good under all winds
        self.best = best_geometry(self.middle, self.contrast[0])
        self.risk = excluded.mean(axis=0)  # share of the winds that exclude a viewing geometry, (zenith, azimuth) [1]

    def at(self, geometry: ViewingGeometry) -> dict[str, tuple[float, float]]:
        """Lowest and highest "glint" [1/sr], "glint_probability" [1], "contrast" [1] at a geometry under all winds."""
        i, j = self.middle.nearest(geometry.zenith, geometry.azimuth)
        pairs = {"glint": self.glint, "glint_probability": self.glint_probability, "contrast": self.contrast}
        return {name: (float(pair[0, i, j]), float(pair[1, i, j])) for name, pair in pairs.items()}

    def words(self) -> list[str]:
        """Lines of text: best viewing geometry; range of contrast and of glint probability there over all winds."""
        geometry = self.best
        if geometry is None:
            return ["No viewing geometry is good under all of these winds."]
        at = self.at(geometry)
        low, high = (one_in(share) for share in at["glint_probability"])
        least, most = at["contrast"]
        return [
            sentence(geometry),
            f"Whatever the wind: contrast {least:.3g} to {most:.3g} x noise; sun glint on {low} to {high} of the sea.",
        ]

    def numbers(self) -> dict[str, object]:
        """Values for JSON via `raster.output.plain`: winds, best geometry, share of winds that exclude a geometry."""
        geometry = self.best
        return {
            "mission": tables_of(self.middle.mission),
            "wind_within": {"speed": self.speed, "turn": self.turn},
            "winds": {"speed": self.winds[0], "from": self.winds[1]},
            "best": None if geometry is None else asdict(geometry) | {"intervals": self.at(geometry)},
            "words": " ".join(self.words()),
            "zenith": self.middle.zenith,
            "azimuth": self.middle.azimuth,
            "risk": self.risk.round(3),
        }
