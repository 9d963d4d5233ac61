"""Speed and heading of moving boats, from bands that are not simultaneous.

A boat with velocity v is at p in one band, and at p + v t in a band recorded t later. A detection is a place with high
contrast to the water around it. Every detection in the first band is combined with every detection in the last band
that a boat can reach. The uniform motion between them must meet a detection in each of the other bands. Waves and
sparkle are at unrelated places in every band, so that no uniform motion fits them. Three bands are needed, because a
uniform motion fits any two detections.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from deglint.errors import InputError
from deglint.morphology import box_sum
from deglint.remove.noise import spread

from .arrays import Float32, Float64, Mask
from .background import as_mask

FASTEST = 20.0  # maximum speed of a boat [m/s]
_WATER_WINDOW = 31  # side of the window whose mean of water is subtracted for the contrast [pixel]
_SIGMA = 6.0  # minimum contrast of a detection [robust standard deviation]: boats are in all bands, sparkle in one
_CHANCE = 0.05  # maximum expected number of motions by chance in an image: of many wave crests, some fit a motion
_NEAR = 1.0  # maximum distance of a detection from a uniform motion [pixel]
_SLOWEST = 0.25  # minimum displacement between the first and the last band [pixel]; a smaller one cannot be measured


@dataclass(frozen=True)
class Mover:
    """Position and motion of a boat."""

    row: float  # at the time 0 of the delays [pixel]
    column: float  # at the time 0 of the delays [pixel]
    speed: float  # [m/s]
    heading: float  # direction of the motion, clockwise from the upward direction of the image [degree]
    error: float  # root mean square distance of its detections from a uniform motion [pixel]
    contrast: float  # peak contrast in the band where it is lowest [robust standard deviation]


def _contrast(band: Float32, water: Mask) -> Float32:
    """Pixel minus mean of the water around, divided by this difference's robust standard deviation, (row, column)."""
    known = water & np.isfinite(band)
    total, count = (box_sum(v.astype(np.float32), _WATER_WINDOW) for v in (np.where(known, band, 0), known))
    away = np.where(np.isfinite(band), band - total / np.maximum(count, 1), 0)
    return np.asarray(away / (spread(away[known]) or 1.0), np.float32)


def find_moving(
    image: npt.ArrayLike, delays: Sequence[float], *, pixel: float, water: npt.ArrayLike | None = None
) -> list[Mover]:
    """Find moving boats in an image, (band, row, column), whose bands are aligned but recorded at different times.

    `delays` are the times at which the bands are recorded [s], `pixel` is the side of a pixel [m], and `water`, (row,
    column), is the mask of the pixels to search (default: all). The result is in order of descending contrast. It is
    empty if a band has no detection, or so many that some fit a motion by chance. Raises InputError if `image` is not
    (band, row, column) with a delay for each band, the mask has another shape, fewer than three delays differ, or
    `pixel` is not above 0 m.
    """
    bands = np.asarray(image, np.float32)
    times = np.asarray(delays, np.float64)
    if bands.ndim != 3 or len(bands) != len(times):
        raise InputError(f"image: want (band, row, column) and a delay for each band, got {bands.shape}, {times.size}.")
    if len(np.unique(times)) < 3:
        raise InputError("a motion needs three bands with different times: a uniform motion fits any two detections.")
    if not pixel > 0:
        raise InputError(f"pixel: want a side above 0 m, got {pixel}.")
    mask = as_mask(water, bands)
    sea = np.ones(bands.shape[1:], np.bool_) if mask is None else mask
    places = [_peaks(_contrast(band, sea), sea) for band in bands]
    first, last = int(np.argmin(times)), int(np.argmax(times))
    density = [len(p) / max(int(np.count_nonzero(sea)), 1) for p in places]
    meets = [min(math.pi * _NEAR**2 * d, 1.0) for i, d in enumerate(density) if i not in (first, last)]
    reach = math.pi * (FASTEST * float(np.ptp(times)) / pixel) ** 2
    if not all(map(len, places)) or len(places[first]) * reach * density[last] * math.prod(meets) > _CHANCE:
        return []
    found = [m for p in places[first] if (m := _followed(p, first, places, times, pixel)) is not None]
    return sorted(found, key=lambda m: -m.contrast)


def _peaks(contrasts: Float32, sea: Mask) -> Float64:
    """Detections in `sea`, (n, 3): row and column (means of connected pixels, weighted by contrast), peak contrast."""
    from scipy import ndimage

    from .objects import label

    parts, weight = label((contrasts > _SIGMA) & sea), contrasts.astype(np.float64)
    index = np.arange(1, parts.max() + 1)
    places = np.reshape(ndimage.center_of_mass(weight, parts, index), (-1, 2))
    return np.column_stack([places, ndimage.maximum(weight, parts, index)])


def _followed(start: Float64, first: int, places: Sequence[Float64], times: Float64, pixel: float) -> Mover | None:
    """Find the uniform motion from the detection `start` of the band `first` that fits detections in all bands best.

    `places`: `_peaks` of each band; `times` [s]; `pixel` [m]. None if no motion fits, or the best is too fast or slow.
    """
    last = int(np.argmax(times))
    span = float(times[last] - times[first])
    movers = []
    for end in places[last]:
        step = (end[:2] - start[:2]) / span
        if math.hypot(*step) * pixel > FASTEST:
            continue
        expected = start[:2] + np.outer(times - times[first], step)
        away = [np.hypot(*(spots[:, :2] - place).T) for spots, place in zip(places, expected, strict=True)]
        if max(a.min() for a in away) <= _NEAR:
            track = np.array([spots[a.argmin()] for spots, a in zip(places, away, strict=True)])
            velocity, origin = np.polyfit(times, track[:, :2], 1)
            error = np.sqrt(((track[:, :2] - origin - np.outer(times, velocity)) ** 2).sum(axis=1).mean())
            heading = math.degrees(math.atan2(velocity[1], -velocity[0])) % 360
            speed, contrast = math.hypot(*velocity) * pixel, track[:, 2].min()
            row, column = origin.tolist()
            movers.append(Mover(row, column, speed, heading, float(error), float(contrast)))
    best = min(movers, key=lambda m: m.error, default=None)
    if best is None or best.speed > FASTEST or best.speed * span / pixel < max(_SLOWEST, 3 * best.error):
        return None
    return best
