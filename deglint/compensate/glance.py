"""A first look at S that costs a few additions a pixel, so that hardly any sparkle is weighed in full.

Sparkle is a Markov chain over the bins of neighbouring instants, and a thing is nearly one, too: its next band follows
from the last by its shape. So the log-likelihood of every shape over that of sparkle is a sum of steps that depend on
two bins each, and can be looked up. The steps of all shapes lie side by side, as small whole numbers: a pixel takes one
row of the tables for each pair of bands. Most pixels need less: shapes are put into a few groups, and where the most
that any shape of a group adds, step by step, is too little for all groups, it is for all shapes.

All of that is whole numbers, side by side in the processor's lanes. What is lost against the full likelihood is that
brightness and bends are told by pairs of bands, not by all of them, and the width of the bins.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ._explain_kernels import FLOOR, LEAST, MOST, SPREAD
from ._glance_kernels import KINDS, Block, Steps
from ._glance_lanes import GROUPS
from .evidence import BINS, HIGH, LOW, TEXTURE, UNIT, WATER_HIDDEN, Protection, bends

Float64 = npt.NDArray[np.float64]
Places = npt.NDArray[np.int64]
Steps8 = npt.NDArray[np.int8]
Steps16 = npt.NDArray[np.int16]

QUARTERS = 4
"""Steps are rounded to one by this [ln]."""
ROOM = 4.5
"""How much S may be above the largest sum of steps and still be found; of 23,000 pixels in things 4 were not."""
ROOM_OF_SHAPE = 6.0
"""The same for one shape, which need not be the one with the largest sum."""
BLOCKED = -30000
"""Sum to start from for a shape that does not exist."""
MOST_ROOM = 20000
"""Steps by which a sum may be below zero and still be looked at, so that all fits into 16 bits."""
LOWEST = -40
"""Steps below this count as this when shapes are grouped: they decide anyway."""
GUESS = 0.5
"""Bins by which the guess of a bin (`deglint.compensate._glance_lanes`) begins lower."""
USUAL = 1e-4
"""Chance of a step of sparkle from which it counts when shapes are grouped."""


def block(image: npt.NDArray[Any], *, written: bool = False) -> Block:
    """A (band, row, column) array, a part of another one if need be, for the kernels; nothing is copied if it can be.

    What is to be written to can not be copied: rows must be one piece each.

    Examples
    --------
    >>> whole = np.arange(24.0).reshape(2, 3, 4)
    >>> part = block(whole[:, 1:, 2:])
    >>> part.band, part.row, float(part.numbers[part.band + part.row])
    (12, 4, 22.0)
    """
    size = image.itemsize
    if image.flags.c_contiguous:
        numbers = image.reshape(-1)
        numbers.flags.writeable = written
        return Block(numbers, image.shape[1] * image.shape[2], image.shape[2])
    if image.size == 0 or image.strides[2] != size or min(image.strides) < 0 or any(s % size for s in image.strides):
        if written:
            raise ValueError("rows are to be one piece each.")
        image = image.copy()
    band, row = image.strides[0] // size, image.strides[1] // size
    count = sum((n - 1) * s // size for n, s in zip(image.shape, image.strides, strict=True)) + 1
    return Block(np.lib.stride_tricks.as_strided(image, (max(count, 0),), (size,), writeable=written), band, row)


def steps(protection: Protection) -> Steps:
    """The tables; some 30 ms for eight bands."""
    s, first, following = protection.shapes, protection.first, protection.following
    assert s is not None and first is not None and following is not None  # noqa: PT018
    count, kinds, width = len(protection.bands), len(s.weight), (HIGH - LOW) / BINS
    if kinds > KINDS:
        raise InputError(f"at most {KINDS} shapes can be told apart, got {kinds}")
    start = np.full(KINDS, BLOCKED, np.int16)
    start[:kinds] = np.rint(QUARTERS * (np.log(s.weight) - math.log(SPREAD)))
    step = np.zeros((count - 1, BINS, BINS, KINDS), np.int8)
    for i in range(count - 1):
        gain = QUARTERS * (_followed(protection, i) - following[i][:, :, None])
        step[i, :, :, :kinds] = np.rint(np.clip(gain, -128, 127))
    edges = np.sinh(LOW + np.arange(1, BINS) * width).astype(np.float32)
    alone = np.rint(-QUARTERS * first).astype(np.int16)
    packed = _packed(step[..., :kinds], start[:kinds], alone, _chance(protection))
    # not a number: nothing, not even infinity, is at or above the edge beyond the last one
    edges_and_end = np.append(edges, np.float32(np.nan))
    begin, bins = np.float32(-LOW / width - GUESS), np.float32(math.log(2) / 2**23 / width)
    return Steps(edges_and_end, begin, bins, alone, start, step.ravel(), *packed)


def _chance(protection: Protection) -> Float64:
    """Of each step of sparkle, (band - 1, bin, bin)."""
    first, following = protection.first, protection.following
    assert first is not None and following is not None  # noqa: PT018
    width = (HIGH - LOW) / BINS
    here, found = np.exp(first) * width, []
    for table in following:
        found.append(here[:, None] * np.exp(table) * width)
        here = found[-1].sum(axis=0)
    return np.array(found)


def _packed(step: Steps8, start: Steps16, first: Steps16, chance: Float64) -> tuple[Steps16, Steps8]:
    """The most that a shape of each group adds, as it begins and with each step."""
    common = np.maximum(step, LOWEST)[chance > USUAL]
    groups = grouped(common, start, chance[chance > USUAL], GROUPS)
    begin = [first + start[g].max() for g in groups]
    more = [step[..., g].max(axis=-1).ravel() for g in groups]
    return np.stack(begin, axis=1).ravel(), np.stack(more, axis=1).ravel()


def grouped(step: Steps8, start: Steps16, chance: Float64, count: int) -> list[list[int]]:
    """Groups of shapes, so that the most that any of a group adds to sparkle is little.

    Two at a time are put together, of which the mean of the sum would then be lowest.

    Parameters
    ----------
    step : (step, shape) ndarray
    start : (shape,) ndarray
    chance : (step,) ndarray
        Of each step; those of one pair of bands sum to one.
    count : int
        Of groups.

    Examples
    --------
    >>> grouped(np.array([[5, 4, -9], [-9, -8, 5]]), np.zeros(3), np.array([0.5, 0.5]), 2)
    [[0, 1], [2]]
    """
    groups = [[k] for k in range(len(start))]
    most, begin, chance = step.T.astype(np.float32), start.astype(np.float32), chance.astype(np.float32)
    mean = np.full((len(groups), len(groups)), np.inf, np.float32)
    for i in range(len(groups) - 1):
        mean[i, i + 1 :] = np.maximum(most[i], most[i + 1 :]) @ chance + np.maximum(begin[i], begin[i + 1 :])
    while sum(map(bool, groups)) > count:
        i, j = divmod(int(np.argmin(mean)), len(groups))
        groups[i], groups[j] = sorted(groups[i] + groups[j]), []
        most[i], begin[i] = np.maximum(most[i], most[j]), max(begin[i], begin[j])
        gone = np.array([not g for g in groups])
        beside = np.where(gone, np.inf, np.maximum(most[i], most) @ chance + np.maximum(begin[i], begin))
        mean[i, i + 1 :], mean[:i, i], mean[j], mean[:, j] = beside[i + 1 :], beside[:i], np.inf, np.inf
    found = [g for g in groups if g]
    return found + found[:1] * (count - len(found))


def _followed(protection: Protection, i: int) -> Float64:
    """Log density in bins of the step from band i to band i + 1, (bin, bin, shape).

    That of the band in which the shape is darker given the one in which it is brighter, at whichever place of the two
    bins suits it best: in bins, which are logarithms, every brightness is as likely as any other, and so is every bin.
    """
    s = protection.shapes
    assert s is not None
    width = (HIGH - LOW) / BINS
    z = LOW + (np.arange(BINS) + 0.5) * width
    y, stretch = UNIT * np.sinh(z), UNIT * np.cosh(z)
    water, bent = np.array(protection.water), bends(protection.wavelength)
    fixed, rising = np.array(protection.noise).T
    white, shape = np.array(protection.irradiance), []
    for b in (i, i + 1):
        noise = (fixed[b] + rising[b] * np.maximum(y + water[b], 0.0) * white[b]) / white[b] ** 2
        shape.append((y + WATER_HIDDEN[0] * water[b], noise + (TEXTURE * water[b]) ** 2, s.values[:, b]))
    (x0, n0, v0), (x1, n1, v1) = shape
    x0, n0, half0 = (a[:, None, None] for a in (x0, n0, width / 2 * stretch))
    x1, n1, half1 = (a[None, :, None] for a in (x1, n1, width / 2 * stretch))
    a = np.clip((x0 * v0 + x1 * v1) / (v0**2 + v1**2), LEAST, MOST)
    away = np.maximum(np.abs(v1 * x0 - v0 * x1) - v1 * half0 - v0 * half1, 0.0)
    rough = (v1 * v0 * s.rough) ** 2 * 2 + (v0**2 + v1**2) * FLOOR**2
    slope, bend = (bent[:, i] - bent[:, i + 1])[:, None] * np.array([s.slope, s.bend])
    hidden = WATER_HIDDEN[1] * (v1 * water[i] - v0 * water[i + 1])
    spread = v1**2 * n0 + v0**2 * n1 + a**2 * (rough + (v0 * v1) ** 2 * (slope**2 + bend**2)) + hidden**2
    darker = np.where(v0 < v1, np.log(stretch)[:, None, None], np.log(stretch)[None, :, None])
    found = darker + np.log(np.maximum(v0, v1)) - 0.5 * (away**2 / spread + np.log(2 * math.pi * spread))
    return np.where((s.odd == i) | (s.odd == i + 1), -math.log(SPREAD), found)
