"""The best viewing geometry of a plan, and its description as text."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from .reticle import Reticle

MARGIN = 3.0  # least angle between the best viewing geometry and any excluded one, where possible [degree]
_POINTS = (  # points of the compass, clockwise from north
    "north", "north-north-east", "north-east", "east-north-east", "east", "east-south-east", "south-east",
    "south-south-east", "south", "south-south-west", "south-west", "west-south-west", "west", "west-north-west",
    "north-west", "north-north-west",
)  # fmt: skip
_AROUND = 16  # number of points at `MARGIN` around a viewing geometry that must not be excluded


@dataclass(frozen=True)
class ViewingGeometry:
    """A direction from which the sensor sees the object, with the contrast and the glint there."""

    zenith: float  # zenith angle of the sensor, seen from the object [degree]
    azimuth: float  # azimuth of the sensor, seen from the object [degree]
    contrast: float  # contrast over noise, all usable bands together [1]
    bands: tuple[str, ...]  # usable bands, the band with the highest contrast first
    glint: float  # glint radiance per irradiance of a plane facing the sun [1/sr]
    glint_probability: float  # share of the sea that mirrors the sun [1]
    margin: bool  # True if no excluded viewing geometry lies within `MARGIN`

    @property
    def heading(self) -> float:
        """Azimuth in which the sensor looks, towards the object [degree]."""
        return (self.azimuth + 180.0) % 360.0


def best_geometry(
    plan: Reticle, contrast: npt.NDArray[Any] | None = None, *, band: str | None = None
) -> ViewingGeometry | None:
    """The viewing geometry with the highest contrast; None if all are excluded.

    Where possible, no excluded viewing geometry lies within `MARGIN` of it. `contrast` (zenith, azimuth) is contrast
    over noise [1], 0 where excluded; by default it is the contrast of `band`, or of all bands together.

    Raises BandError: there is no such band.
    """
    bands = list(range(len(plan.bands))) if band is None else [plan.index(band)]
    if contrast is None:
        contrast = plan.combined if band is None else plan.by_band[bands[0]]
    good = contrast > 0
    if not good.any():
        return None
    safe = good & good[_ring(good.shape, plan.mission.widest)].all(axis=0)
    has_margin = bool(safe.any())
    chosen = np.where(safe if has_margin else good, contrast, -1.0)
    i, j = np.unravel_index(int(np.argmax(chosen)), chosen.shape)
    usable = sorted((k for k in bands if plan.by_band[k, i, j] > 0), key=lambda k: -plan.by_band[k, i, j])
    return ViewingGeometry(
        zenith=float(plan.zenith[i]),
        azimuth=float(plan.azimuth[j]) % 360.0 if i else 0.0,
        contrast=float(contrast[i, j]),
        bands=tuple(plan.bands[k] for k in usable),
        glint=float(plan.glint_strength[i, j]),
        glint_probability=float(plan.glint_probability[i, j]),
        margin=has_margin,
    )


def description(geometry: ViewingGeometry | None) -> str:
    """Text that says from where to look, and how much contrast and glint to expect there."""
    return sentence(geometry) if geometry is None else f"{sentence(geometry)} {quality(geometry)}"


def sentence(geometry: ViewingGeometry | None) -> str:
    """Sentence that says from where to look; for None, that no viewing geometry is good.

    Examples
    --------
    >>> sentence(ViewingGeometry(24.0, 225.0, 41.2, ("BLUE", "GREEN"), 1e-4, 3.2e-7, True))
    'Look from the south-west (azimuth 225), 24 degrees off nadir, towards 045.'
    """
    if geometry is None:
        return "No viewing geometry is good: sun glint, mirrored sky, noise or saturation spoils every one."
    if geometry.zenith < 1.0:
        return "Look straight down."
    where = f"{compass(geometry.azimuth)} (azimuth {geometry.azimuth:03.0f})"
    return f"Look from the {where}, {geometry.zenith:.0f} degrees off nadir, towards {geometry.heading:03.0f}."


def quality(geometry: ViewingGeometry) -> str:
    """Text on the contrast and the glint of a viewing geometry, and on excluded viewing geometries near it."""
    stand = "" if geometry.zenith < 1.0 else f"Stand off {np.tan(np.radians(geometry.zenith)):.2f} x your height. "
    edge = "" if geometry.margin else f" Excluded viewing geometries lie within {MARGIN:g} degrees of it."
    return (
        f"{stand}Contrast {geometry.contrast:.3g} x noise in {', '.join(geometry.bands[:4])}."
        f" Sun glint on {one_in(geometry.glint_probability)} of the sea.{edge}"
    )


def one_in(share: float) -> str:
    """A small share as text: 3.1e-6 is "1 in 320 000"."""
    if share < 1e-9:
        return "less than 1 in a billion"
    if share > 0.05:
        return f"{100 * share:.0f} %"
    return f"1 in {float(f'{1 / share:.2g}'):,.0f}".replace(",", " ")


def compass(azimuth: float) -> str:
    """Name of the compass point nearest to an azimuth [degree].

    >>> compass(225.0)
    'south-west'
    """
    return _POINTS[round(azimuth / 22.5) % 16]


@lru_cache(maxsize=4)
def _ring(shape: tuple[int, int], widest: float) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Points at the distance `MARGIN` around every viewing geometry: their indices of zenith angle and of azimuth.

    Both arrays are (point, zenith, azimuth). `shape` is (zenith, azimuth) of the reticle, `widest` its largest zenith
    angle [degree]. Points outside the reticle are moved to its edge.
    """
    zenith = np.radians(np.linspace(0.0, widest, shape[0]))[:, None]
    azimuth = np.radians(np.linspace(0.0, 360.0, shape[1]))
    turn = np.arange(_AROUND)[:, None, None] * (2.0 * np.pi / _AROUND)
    away = np.radians(MARGIN)
    cosine = np.cos(zenith) * np.cos(away) - np.sin(zenith) * np.sin(away) * np.cos(turn)
    to = np.arccos(np.clip(cosine, -1.0, 1.0))
    out = np.cos(away) * np.sin(zenith) + np.sin(away) * np.cos(zenith) * np.cos(turn)
    side = np.arctan2(np.sin(turn) * np.sin(away), out)
    i = np.clip(np.rint(np.degrees(to) / widest * (shape[0] - 1)), 0, shape[0] - 1).astype(np.int32)
    j = np.rint(np.degrees(azimuth + side) % 360.0 / 360.0 * (shape[1] - 1)).astype(np.int32)
    return i, np.broadcast_to(j, (_AROUND, *shape))
