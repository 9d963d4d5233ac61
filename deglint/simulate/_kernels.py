"""Compiled loop over facets for `deglint.simulate`: slope density at the glinting slope, and reflected sky."""

import math

import numpy as np

from ..jit import njit


@njit(nogil=True, cache=True)
def reflect(slopes, sparkle, out, rows, wind, glint, table):  # type: ignore[no-untyped-def]
    """Fill the rows rows[0] to rows[1] - 1 of `out`, two arrays (row, column), with the results of `facets.Facets.at`.

    `slopes` (row, column) has the slopes of the surface, east + i * north. `sparkle` is (amplitudes, indices and
    frequencies from `facets._draw_sparkle`, time [s]). `wind` is (sine and cosine of the azimuth that the wind blows
    from, factors on the upwind and on the crosswind slopes of the surface). `glint` is (upwind and crosswind slope that
    reflects the sun into the sensor, variances of upwind and crosswind slope within a facet). `table` is (result of
    `facets._sky_table`, first slope on both of its axes, step of slope).
    """
    amplitudes, choice, frequencies, time = sparkle
    density, sky = out
    cosine = np.cos(frequencies * time).astype(np.float32)
    sine = np.sin(frequencies * time).astype(np.float32)
    east_sine, east_cosine = np.float32(wind[0]), np.float32(wind[1])
    up_scale, cross_scale = np.float32(wind[2]), np.float32(wind[3])
    up_glint, cross_glint = np.float32(glint[0]), np.float32(glint[1])
    up_factor, cross_factor = np.float32(-0.5 / glint[2]), np.float32(-0.5 / glint[3])
    norm = np.float32(1.0 / (2.0 * math.pi * math.sqrt(glint[2] * glint[3])))
    values, start, per_step = table[0], np.float32(table[1]), np.float32(1.0 / table[2])
    zero, one, least, top = np.float32(0.0), np.float32(1.0), np.float32(-50.0), np.float32(values.shape[0] - 1.001)
    for r in range(rows[0], rows[1]):
        for c in range(slopes.shape[1]):
            east, north = slopes[r, c].real, slopes[r, c].imag
            up = up_scale * (east * east_sine + north * east_cosine)
            cross = cross_scale * (east * east_cosine - north * east_sine)
            if amplitudes.size:
                f = choice[r, c]
                up += amplitudes[r, c, 0] * cosine[f] + amplitudes[r, c, 1] * sine[f]
                cross += amplitudes[r, c, 2] * cosine[f] + amplitudes[r, c, 3] * sine[f]
            power = (up - up_glint) ** 2 * up_factor + (cross - cross_glint) ** 2 * cross_factor
            density[r, c] = norm * math.exp(power) if power > least else zero
            x = min(max((up - start) * per_step, zero), top)
            y = min(max((cross - start) * per_step, zero), top)
            i, j = int(x), int(y)
            x, y = x - np.float32(i), y - np.float32(j)
            below = (one - y) * values[i, j] + y * values[i, j + 1]
            sky[r, c] = (one - x) * below + x * ((one - y) * values[i + 1, j] + y * values[i + 1, j + 1])
