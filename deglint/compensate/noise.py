"""How large noise is, and how it grows with the brightness, told by second differences of what lies about a level.

Shot noise has a variance that is a line in the signal. Second differences along a row take off whatever is smooth; the
smaller half of their squares counts, so that sparkle, which is in the larger, does not.

References
----------
Immerkaer (1996), Computer Vision and Image Understanding 64, 300-302, doi:10.1006/cviu.1996.0060 (noise from second
differences)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ._variances import Float64, weighted_line
from .state import Float32Array

GROUPS = 24
"""Groups of pixels of like level through whose noise a line is laid."""
FEWEST = 100
"""Fewest pixels in one of them."""
MOST = 200_000
"""Most pixels that the noise is told by."""
HALF_OF_SQUARES = 0.142652
"""Mean of the smaller half of the squares of a standard normal distribution."""
EXTREMES = 0.1, 99.9
"""Percentiles of the level that count as its lowest and its highest."""


class Spread(NamedTuple):
    """How pixels of a band without glint lie about the level that an opening puts in the place of others.

    Attributes
    ----------
    band : int
        0-based.
    sigma : float
        Their standard deviation.
    middle, slope, most : float
        Level from which on that grows, by what share of itself per unit, and at most.
    share : float
        Of what the level lies above that: by so much more glint exceeds it.
    """

    band: int
    sigma: float
    middle: float = 0.0
    slope: float = 0.0
    most: float = 0.0
    share: float = 0.0


def noise_by_level(rest: Float32Array, level: Float32Array) -> tuple[float, float]:
    """Variance of noise as a line in the level: at 0, and per unit.

    Groups lie evenly between the lowest level and the highest, so that a few bright objects are seen in a wide sea.
    Where sparkle covers much of the sea it passes for noise, and grows with the level as sparkle does.

    Parameters
    ----------
    rest : (row, column) float32 ndarray
        What lies above and below the level, NaN where not known.
    level : (row, column) float32 ndarray
    """
    return _line(*_differences(rest, level))


def growth_by_level(looks: Sequence[tuple[Float32Array, Float32Array]], middle: float) -> tuple[float, float]:
    """By what share of itself the standard deviation of noise grows with the level, per unit, and at most.

    The chord from the middle to the highest level that is seen often enough; beyond, nothing is known.

    Parameters
    ----------
    looks : sequence of (rest, level)
        As in `noise_by_level`, of parts of a scene.
    middle : float
        The level of water.

    Examples
    --------
    >>> level = np.repeat(np.float32([100, 400]), 5000).reshape(100, 100)
    >>> noise = np.random.default_rng(0).normal(0, np.sqrt(level)).astype(np.float32)
    >>> [round(g, 3) for g in growth_by_level([(noise, level)], 100.0)]
    [0.003, 1.0]
    """
    squares, place = (np.concatenate(parts) for parts in zip(*(_differences(*look) for look in looks), strict=True))
    fixed, growing = _line(squares, place)
    least = fixed + growing * middle
    if not (growing > 0 and least > 0):
        return 0.0, 0.0
    top = float(np.percentile(place, EXTREMES[1]))
    if top <= middle:
        return 0.0, 0.0
    most = float(np.sqrt((fixed + growing * top) / least)) - 1
    return most / (top - middle), most


def _differences(rest: Float32Array, level: Float32Array) -> tuple[Float64, Float64]:
    """Variances by single second differences, and the level at each, where both are known."""
    bent = rest[:, :-2] - 2 * rest[:, 1:-1] + rest[:, 2:]
    known = np.flatnonzero(np.isfinite(bent))
    known = known[:: max(known.size // MOST, 1)]
    squares = bent.ravel()[known].astype(np.float64) ** 2 / 6
    return squares, np.maximum(level[:, 1:-1].ravel()[known].astype(np.float64), 0.0)


def _line(squares: Float64, place: Float64) -> tuple[float, float]:
    """The line through variances at these levels."""
    if squares.size < FEWEST:
        return 0.0, 0.0
    low, high = np.percentile(place, EXTREMES)
    group = np.floor((place - low) / max(high - low, np.finfo(np.float64).tiny) * GROUPS)
    group[place == high] = GROUPS - 1
    groups = [squares[group == g] for g in range(GROUPS)]
    used = [g for g in range(GROUPS) if groups[g].size >= FEWEST]
    if not used:
        return float(np.sort(squares)[: squares.size // 2].mean() / HALF_OF_SQUARES), 0.0
    halves = [np.partition(groups[g], groups[g].size // 2)[: groups[g].size // 2].mean() for g in used]
    where = np.array([place[group == g].mean() for g in used])
    return weighted_line(where, np.array(halves) / HALF_OF_SQUARES, np.array([float(groups[g].size) for g in used]))
