"""Compiled loop over the facets of `deglint.simulate`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def reflect(slopes, sparkle, density, sky, first, last, time, wind, calm, glint, table):  # type: ignore[no-untyped-def]
    """Slope density at the glinting slope, and sky radiance, of each facet.

    slopes: (row, column) complex, east + i north. sparkle: (row, column, 4) amplitudes, (row, column) indexes
    into angular frequencies; empty without sparkle. wind: sine and cosine of its azimuth. calm: factors on
    the slopes of the grid. glint: upwind and crosswind slope that glints, variances about each facet. table:
    sky by upwind and crosswind slope, its first slope, its step.
    """
    amplitudes, choice, frequencies = sparkle
    cosine, sine = np.cos(frequencies * time), np.sin(frequencies * time)
    up_glint, cross_glint, up_variance, cross_variance = glint
    values, start, step = table
    norm = 1.0 / (2.0 * math.pi * math.sqrt(up_variance * cross_variance))
    top = values.shape[0] - 1.001
    for r in range(first, last):
        for c in range(slopes.shape[1]):
            east, north = slopes[r, c].real, slopes[r, c].imag
            up = calm[0] * (east * wind[0] + north * wind[1])
            cross = calm[1] * (east * wind[1] - north * wind[0])
            if amplitudes.size:
                f = choice[r, c]
                up += amplitudes[r, c, 0] * cosine[f] + amplitudes[r, c, 1] * sine[f]
                cross += amplitudes[r, c, 2] * cosine[f] + amplitudes[r, c, 3] * sine[f]
            exponent = (up - up_glint) ** 2 / up_variance + (cross - cross_glint) ** 2 / cross_variance
            density[r, c] = norm * math.exp(-0.5 * exponent) if exponent < 100.0 else 0.0
            x = min(max((up - start) / step, 0.0), top)
            y = min(max((cross - start) / step, 0.0), top)
            i, j = int(x), int(y)
            x, y = x - i, y - j
            below = (1 - y) * values[i, j] + y * values[i, j + 1]
            sky[r, c] = (1 - x) * below + x * ((1 - y) * values[i + 1, j] + y * values[i + 1, j + 1])
