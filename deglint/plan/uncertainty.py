"""A plan with uncertain wind: intervals of glint and contrast, and the share of winds that exclude a geometry."""

from dataclasses import asdict, replace
from itertools import product
from typing import Any

import numpy as np

from ..physics import slopes
from ..physics._checks import within
from .advice import ViewingGeometry, best_geometry, one_in, sentence
from .mission import Mission
from .missionfile import tables_of
from .reticle import reticle

SPEEDS, TURNS = 5, 7  # number of speeds and of directions in the interval, ends included


class WindEnsemble:
    """Glint and contrast of a mission under all winds of an interval.

    The speed is known to plus or minus `speed` [m/s], limited to the range of the models; the direction is known to
    plus or minus `turn` [degree], 180 for any direction.

    Raises InputError: a value is out of range.
    """

    def __init__(self, mission: Mission, *, speed: float = 2.0, turn: float = 30.0) -> None:
        within("wind speed uncertainty", speed, 0.0, 20.0, "m/s", "Give plus or minus how much.")
        within("wind direction uncertainty", turn, 0.0, 180.0, "degrees", "180 stands for not known at all.")
        self.speed, self.turn = speed, turn
        low, high = max(mission.wind - speed, slopes.WIND_RANGE[0]), min(mission.wind + speed, mission.strongest_wind)
        speeds = np.unique([*(np.linspace(low, high, SPEEDS) if speed else ()), mission.wind])
        turns = mission.wind_from + (np.linspace(-turn, turn, TURNS) if turn else np.zeros(1))
        self.winds = speeds.tolist(), (turns % 360.0).tolist()  # speeds [m/s] and directions [degree]
        coarse = mission.coarse()
        self.middle = reticle(coarse)  # reticle under the wind of the mission
        plans = (reticle(replace(coarse, wind=one, wind_from=azimuth)) for one, azimuth in product(*self.winds))
        layers = zip(*((p.glint_strength, p.glint_probability, p.combined, p.excluded) for p in plans), strict=True)
        *held, excluded = (np.array(layer) for layer in layers)
        # lowest and highest value of layers of `Reticle` (contrast: `combined`), (2, zenith, azimuth)
        self.glint, self.glint_probability, self.contrast = (np.stack([v.min(axis=0), v.max(axis=0)]) for v in held)
        self.risk = excluded.mean(axis=0)  # share of the winds that exclude a viewing geometry, (zenith, azimuth) [1]

    @property
    def best(self) -> ViewingGeometry | None:
        """The viewing geometry with the highest contrast under the worst wind; None if none is good under all winds."""
        return best_geometry(self.middle, self.contrast[0])

    def at(self, geometry: ViewingGeometry) -> dict[str, tuple[float, float]]:
        """Lowest and highest glint [1/sr], glint probability [1] and contrast over noise [1] at a viewing geometry."""
        i, j = self.middle.nearest(geometry.zenith, geometry.azimuth)
        pairs = {"glint": self.glint, "glint_probability": self.glint_probability, "contrast": self.contrast}
        return {name: (float(pair[0, i, j]), float(pair[1, i, j])) for name, pair in pairs.items()}


def words(found: WindEnsemble) -> list[str]:
    """Text: the best viewing geometry, and its intervals."""
    geometry = found.best
    if geometry is None:
        return ["No viewing geometry is good under all of these winds."]
    at = found.at(geometry)
    low, high = (one_in(share) for share in at["glint_probability"])
    least, most = at["contrast"]
    return [
        sentence(geometry),
        f"Whatever the wind: contrast {least:.3g} to {most:.3g} x noise; sun glint on {low} to {high} of the sea.",
    ]


def numbers(found: WindEnsemble) -> dict[str, Any]:
    """The intervals as values for JSON, with the share of winds that exclude each viewing geometry."""
    geometry = found.best
    return {
        "mission": tables_of(found.middle.mission),
        "wind_within": {"speed": found.speed, "turn": found.turn},
        "winds": {"speed": found.winds[0], "from": found.winds[1]},
        "best": None if geometry is None else asdict(geometry) | {"intervals": found.at(geometry)},
        "words": " ".join(words(found)),
        "zenith": found.middle.zenith,
        "azimuth": found.middle.azimuth,
        "risk": found.risk.round(3),
    }
