"""How much of the sparkle lasts through all instants, as bright as it is: that is all that a thing is.

A pixel is lit where it stands out of the noise, and steady for as long as it changes by no more than a quarter from one
instant to the next. Of the pixels that are lit at the first instant, or backwards in time at the last, n stay steady
for all instants but one. Flashes grow rarer with every instant by a factor r, and so some n (r + r^2 + ...) last
through all of them. What is seen to do so is not counted: it may be things. But a thing that moves, or that a flash
lights up, is steady for a part of the time, and among the few flashes that are steady for long such things may be most.
They spoil the ratio of one count to the one before, here or there, by making it too large: r is the least of all.

Assumes that flashes end as often late as they do early; exact where they have no memory (lifetimes that are
exponentially distributed), too low by up to a half where some last much longer than others. Fails where flashes are
few: none then stays for all instants but one, and nothing is told. Costs less than the histograms that are made of the
same sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..scene import FloatArray
from .evidence import BoolArray, Places, Protection

LIT = 8.0
"""A pixel is lit where it exceeds the level by this many standard deviations of noise."""
STEADY = 1.25
"""Factor by which a pixel that is lit may change from one instant to the next and be steady."""
MOST_RATIO = 0.95
"""Of r: beyond, the sum grows without bounds."""
MOST_LASTING = 0.0025
"""Of the pixels that sparkle lights at the first instant, the share that may stay steady through all of them."""


def steady(sensor: Protection, pair: tuple[FloatArray, FloatArray], valid: BoolArray) -> Places:
    """Count the pixels of a look that are lit at the first instant, or the last, by how long they stay steady.

    Parameters
    ----------
    sensor : Protection
        Its noise and irradiance are looked at.
    pair : (raw, level)
        (band, row, column) each, bands in the order of time.
    valid : (row, column) bool ndarray

    Returns
    -------
    (band + 1,) ndarray of int
        Pixels that are steady for 0, 1, 2, ... instants from the first on, and from the last on backwards.

    Examples
    --------
    >>> sensor = Protection(irradiance=(1.0,) * 4, noise=((0.01, 0.0),) * 4)
    >>> raw = np.array([9.0, 8.0, 3.0, 0.0]).reshape(4, 1, 1)
    >>> steady(sensor, (raw, np.zeros_like(raw)), np.ones((1, 1), bool)).tolist()
    [0, 0, 1, 0, 0]
    """
    raw, level = (part[:, valid] for part in pair)
    noise, white = np.array(sensor.noise)[:, :, None], np.array(sensor.irradiance)[:, None]
    excess = (raw - level) / white
    lit = excess > LIT * np.sqrt(noise[:, 0] + noise[:, 1] * np.maximum(raw, 0)) / white
    like = lit[1:] & lit[:-1] & (excess[1:] < STEADY * excess[:-1]) & (excess[:-1] < STEADY * excess[1:])
    ways = (like, lit[0]), (like[::-1], lit[-1])
    runs = [1 + np.cumprod(way, axis=0)[:, first].sum(axis=0) for way, first in ways]
    return np.bincount(np.concatenate(runs), minlength=len(lit) + 1)


def lasting(counts: Sequence[Places]) -> float:
    """Share of the flashes seen first, or last, that stay steady through all instants.

    Parameters
    ----------
    counts : sequence of (band + 1,) ndarray of int
        Of some looks, as `steady` has them; of three instants at least.

    Examples
    --------
    >>> lasting([np.array([0, 800, 400, 200, 100])])  # and 100 + 50 + 25 + ... of 1500 more
    0.13333333333333333
    >>> lasting([np.array([0, 800, 40, 2, 0, 0, 9, 12, 300])]) == 0.0  # twelve of the 300 things, disturbed once
    True
    """
    total = np.sum(counts, axis=0)
    times = total[1:-1]
    ratio = min(float((times[1:] / np.maximum(times[:-1], 1)).min()), MOST_RATIO)
    return float(times[-1] * ratio / (1 - ratio) / max(total.sum(), 1))
