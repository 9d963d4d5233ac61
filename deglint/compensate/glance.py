"""A first look at S that costs a few additions a pixel, so that hardly any sparkle is weighed in full.

Sparkle is a Markov chain over the bins of neighbouring instants, and a thing is nearly one, too: its next band follows
from the last by its shape. So the log-likelihood of every shape over that of sparkle is a sum of steps that depend on
two bins each, and can be looked up. The steps of all shapes lie side by side, as small whole numbers: a pixel takes one
row of the tables for each pair of bands. What is lost against the full likelihood is that brightness and bends are
told by pairs of bands, not by all of them, and the width of the bins.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ._protect_kernels import FLOOR, LANES, LEAST, MOST, SPREAD, Steps
from .evidence import BINS, HIGH, LOW, TEXTURE, UNIT, WATER_HIDDEN, Protection, bends

Float64 = npt.NDArray[np.float64]

QUARTERS = 4
"""Steps are rounded to one by this [ln]."""
ROOM = 4.5
"""How much S may be above the largest sum of steps and still be found; of 23,000 pixels in things 4 were not."""
ROOM_OF_SHAPE = 6.0
"""The same for one shape, which need not be the one with the largest sum."""
BLOCKED = -30000
"""Sum to start from for a shape that does not exist."""


def cells(edges: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """How many edges lie at or below all float32 numbers that begin with the same 12 bits: sign, exponent, 3 more.

    Examples
    --------
    >>> found = cells(np.array([0.9, 1.05]))
    >>> bits = np.array([0.5, 1.0, 1.2], np.float32).view(np.int32) >> 20
    >>> found[bits].tolist()  # 1.0 begins like 1.05, so that one more comparison is needed there
    [0, 1, 2]
    """
    with np.errstate(invalid="ignore"):
        ends = [(np.arange(4096, dtype=np.uint32) << np.uint32(20)) + np.uint32(e) for e in (0, (1 << 20) - 1)]
        lowest = np.fmin(*(e.view(np.float32) for e in ends)).astype(np.float64)
    found = np.searchsorted(edges, np.where(np.isnan(lowest), -np.inf, lowest), side="right")
    return found.astype(np.uint8)


def steps(protection: Protection) -> Steps:
    """The tables; some 20 ms for eight bands."""
    s, first, following = protection.shapes, protection.first, protection.following
    assert s is not None and first is not None and following is not None  # noqa: PT018
    count, kinds = len(protection.bands), len(s.weight)
    lanes = -(-kinds // LANES) * LANES
    start = np.full(lanes, BLOCKED, np.int16)
    start[:kinds] = np.rint(QUARTERS * (np.log(s.weight) - math.log(SPREAD)))
    step = np.full((count - 1, BINS, BINS, lanes), 0, np.int8)
    for i in range(count - 1):
        gain = QUARTERS * (_followed(protection, i) - following[i][:, :, None])
        step[i, :, :, :kinds] = np.rint(np.clip(gain, -128, 127))
    edges = np.sinh(LOW + np.arange(1, BINS) * (HIGH - LOW) / BINS).astype(np.float32)
    alone = np.rint(-QUARTERS * first).astype(np.int16)
    # not a number: nothing, not even infinity, is at or above the edge beyond the last one
    return Steps(cells(edges), np.append(edges, np.float32(np.nan)), start, alone, step.reshape(-1, lanes))


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
