"""Speed and heading of moving boats, from bands that are not simultaneous.

A boat with velocity v is at p in one band, and at p + v t in a band recorded t later. A detection is a place with high
contrast to the water around it. Every detection in the first band is combined with every detection in the last band
that a boat can reach. The uniform motion between them must meet a detection in each of the other bands. Three bands are
needed, because a uniform motion fits any two detections.

Sparkle and wave crests fit some motion by chance. How bright such motions are is found from the image itself: the
detections of all later bands are displaced, so that no boat is left, and the search is repeated. A boat must be
`_BRIGHTER` times as bright as every motion of these repetitions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from deglint.errors import InputError
from deglint.morphology import box_sum
from deglint.remove.noise import spread

from .arrays import Float32, Float64, Mask
from .background import as_image

FASTEST = 20.0  # maximum speed of a boat [m/s]
_WATER_WINDOW = 31  # side of the window whose mean of water is subtracted for the contrast [pixel]
_SIGMA = 6.0  # minimum contrast of a detection [robust standard deviation]: boats are in all bands, sparkle in one
_REPETITIONS = 10  # displacements of the later bands in which motions by chance are searched
_BRIGHTER = 2.0
"""Least contrast of a boat over the highest contrast of motions by chance: sparkle that moves with its wave reached
1.98 times the latter in simulated seas at 1.24 m."""
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
    column), is the mask of the pixels to search (default: all). The result is in order of descending contrast. Motions
    that are no brighter than motions by chance are left out. Raises InputError if `image` is not (band, row, column)
    with a delay for each band, the mask has another shape, fewer than three delays differ, or `pixel` is not above 0 m.
    """
    found, least = motions_in(image, delays, pixel=pixel, water=water)
    return sorted((m for m in found if m.contrast > least), key=lambda m: -m.contrast)


def motions_in(
    image: npt.ArrayLike, delays: Sequence[float], *, pixel: float, water: npt.ArrayLike | None = None
) -> tuple[list[Mover], float]:
    """All motions in an image, and the least contrast of a boat there; arguments as for `find_moving`."""
    values, mask = as_image(image, water)
    bands, times = values.astype(np.float32, copy=False), np.asarray(delays, np.float64)
    if len(bands) != len(times):
        raise InputError(f"delays: want a delay for each band, got {times.size} for {len(bands)} bands.")
    if len(np.unique(times)) < 3:
        raise InputError("a motion needs three bands with different times: a uniform motion fits any two detections.")
    if not pixel > 0:
        raise InputError(f"pixel: want a side above 0 m, got {pixel}.")
    sea = np.ones(bands.shape[1:], np.bool_) if mask is None else mask
    places = [_peaks(_contrast(band, sea), sea) for band in bands]
    later = times > (times.min() + times.max()) / 2
    chance = 0.0
    for n in range(1, _REPETITIONS + 1):
        # down the image by n equal parts, and across by 3 n: far beyond what a boat moves, and another way each time
        away = np.array([n, 3 * n]) / (_REPETITIONS + 1) * sea.shape
        moved = [_displaced(p, away, sea.shape) if late else p for p, late in zip(places, later, strict=True)]
        chance = max([chance, *(m.contrast for m in _uniform_motions(moved, times, pixel))])
    return _uniform_motions(places, times, pixel), _BRIGHTER * chance


def _displaced(places: Float64, away: Float64, shape: tuple[int, ...]) -> Float64:
    """Detections (n, 3) moved by `away` (row, column); those that leave the image enter at the opposite side."""
    return np.column_stack([(places[:, :2] + away) % shape, places[:, 2]])


def _peaks(contrasts: Float32, sea: Mask) -> Float64:
    """Detections in `sea`, (n, 3): row and column (means of connected pixels, weighted by contrast), peak contrast."""
    from scipy import ndimage

    from .objects import label

    parts, weight = label((contrasts > _SIGMA) & sea), contrasts.astype(np.float64)
    index = np.arange(1, parts.max() + 1)
    places = np.reshape(ndimage.center_of_mass(weight, parts, index), (-1, 2))
    return np.column_stack([places, ndimage.maximum(weight, parts, index)])


def _uniform_motions(places: Sequence[Float64], times: Float64, pixel: float) -> list[Mover]:
    """Motion of each detection of the first band: the uniform motion that fits detections in all bands best, if any
    does, unless it is too slow or too fast. `places`: `_peaks` of each band; `times` [s]; `pixel` [m].
    """
    from scipy.spatial import cKDTree

    if not all(map(len, places)):
        return []
    first, last = int(np.argmin(times)), int(np.argmax(times))
    span = float(times[last] - times[first])
    trees = [cKDTree(p[:, :2]) for p in places]
    reached = trees[first].query_ball_tree(trees[last], FASTEST * span / pixel)
    pairs = np.array([(start, end) for start, ends in enumerate(reached) for end in ends], np.intp).reshape(-1, 2)
    starts, ends = places[first][pairs[:, 0], :2], places[last][pairs[:, 1], :2]
    shares = (times - times[first]) / span
    met = [tree.query(starts + share * (ends - starts)) for tree, share in zip(trees, shares, strict=True)]
    away, nearest = zip(*met, strict=True)
    fits = (np.array(away) <= _NEAR).all(axis=0)  # each band has a detection where the motion expects it
    track = np.stack([p[n[fits]] for p, n in zip(places, nearest, strict=True)])  # (band, motion, 3)
    mean, lag = track[:, :, :2].mean(axis=0), (times - times.mean())[:, None, None]
    velocity = (lag * track[:, :, :2]).sum(axis=0) / (lag**2).sum()  # by least squares [pixel/s]
    error = np.sqrt(((track[:, :, :2] - mean - lag * velocity) ** 2).sum(axis=2).mean(axis=0))
    origin, speed = mean - times.mean() * velocity, np.hypot(*velocity.T)
    heading, contrast = np.degrees(np.arctan2(velocity[:, 1], -velocity[:, 0])) % 360, track[:, :, 2].min(axis=0)
    best = {}  # motion with the least error, by the detection in the first band
    for n in np.argsort(-error, kind="stable").tolist():
        best[int(pairs[fits][n, 0])] = n
    return [
        Mover(*origin[n].tolist(), *(float(v[n]) for v in (pixel * speed, heading, error, contrast)))
        for n in best.values()
        if pixel * speed[n] <= FASTEST and speed[n] * span >= max(_SLOWEST, 3 * error[n])
    ]
