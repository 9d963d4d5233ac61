"""Loops of `surface` and `imaging` that numba compiles; each call processes some of the rows, for use with threads."""

import math

from ..jit import njit

ELFOUHAILY, HALF_ANGLE, FULL_ANGLE = 0, 1, 2  # codes of the directional spreading functions


@njit(nogil=True, cache=True)
def frequency(i: int, n: int, step: float) -> float:
    """Signed wavenumber [rad/m] at index `i` of an FFT of length `n` in steps of `step`; positive at i = n / 2."""
    return (i if i <= n // 2 else i - n) * step


@njit(nogil=True, cache=True)
def fill_amplitudes(noise, sums, slab, steps, table, how, along):  # type: ignore[no-untyped-def]
    """Multiply `noise` (row, column), whose real and imaginary parts are standard normal, to get wave amplitudes [m].

    Rows slab[0] to slab[1] - 1 are processed in place. `steps` are the wavenumber steps from row to row and from column
    to column [rad/m]. The contributions of the waves in each row to the variances of height [m2], east slope and north
    slope, and to the covariance of both slopes, are added to `sums` (row, 4). `table` is (first ln wavenumber, step of
    ln wavenumber, ln omnidirectional spectral density (n,), result of `spectra.elfouhaily_spread` (n,)); `along` is the
    unit vector (east, north) downwind. `how` is (code of the directional spreading, exponent s, result of
    `spectra.spreading_norm`, share of energy that goes upwind). The mean and Nyquist frequencies get amplitude 0.
    """
    rows, columns = noise.shape
    row_step, column_step = steps
    log_start, log_step, log_density, spread = table
    kind, exponent, norm, opposing = how
    cell = row_step * column_step
    for r in range(slab[0], slab[1]):
        north = -frequency(r, rows, row_step)
        for c in range(columns):
            east = frequency(c, columns, column_step)
            if 2 * r == rows or 2 * c == columns or (r == 0 and c == 0):
                noise[r, c] = 0.0
                continue
            k2 = east * east + north * north
            x = (0.5 * math.log(k2) - log_start) / log_step
            j = min(max(int(x), 0), len(log_density) - 2)
            w = x - j
            density = math.exp((1 - w) * log_density[j] + w * log_density[j + 1])
            cosine = (east * along[0] + north * along[1]) / math.sqrt(k2)
            if kind == ELFOUHAILY:
                even = 1 + ((1 - w) * spread[j] + w * spread[j + 1]) * (2 * cosine * cosine - 1)
                side = 1.0 if cosine == 0 else (2 * (1 - opposing) if cosine > 0 else 2 * opposing)
                density *= side * even / (2 * math.pi)
            elif kind == HALF_ANGLE:
                density *= norm * (0.5 * (1 + cosine)) ** exponent
            else:
                density *= norm * max(cosine, 0.0) ** (2 * exponent)
            variance = density / math.sqrt(k2) * cell
            noise[r, c] *= math.sqrt(0.25 * variance)
            sums[r, 0] += variance
            sums[r, 1] += east * east * variance
            sums[r, 2] += north * north * variance
            sums[r, 3] += east * north * variance


@njit(nogil=True, cache=True)
def evolve(amplitudes, out, slab, steps, time, slopes, physics):  # type: ignore[no-untyped-def]
    """Fill `out` with the spectrum of height at a time [s], or of east slope + i * north slope if `slopes` is True.

    `out` and `amplitudes`, from `fill_amplitudes`, are (row, column). Row r and its mirror row (number of rows - r)
    depend on the same amplitudes; one call fills both, for r from slab[0] to slab[1] - 1 (at most half of all rows).
    `steps` are as in `fill_amplitudes`. `physics` is (surface tension / density [m3/s2], gravity [m/s2]).
    """
    rows, columns = amplitudes.shape
    row_step, column_step = steps
    tension, gravity = physics
    for r in range(slab[0], slab[1]):
        north = -frequency(r, rows, row_step)
        other = rows - r if r else 0
        for c in range(columns):
            mirror = columns - c if c else 0
            a = amplitudes[r, c]
            b = amplitudes[other, mirror]
            east = frequency(c, columns, column_step)
            k = math.sqrt(east * east + north * north)
            phase = math.sqrt(gravity * k + tension * k * k * k) * time
            turn = complex(math.cos(phase), -math.sin(phase))
            z = complex(a) * turn + (complex(b) * turn).conjugate()
            tilt = complex(-north, east) if slopes else complex(1.0, 0.0)
            out[r, c] = z * tilt
            if other != r:  # a row that is its own mirror image is filled by the loop over c
                out[other, mirror] = z.conjugate() * (-tilt if slopes else tilt)


@njit(nogil=True, cache=True)
def fold(spectrum, out, first, last, row_factor, column_factor, limit):  # type: ignore[no-untyped-def]
    """Multiply the spectrum of a scene by the MTF, and average rows whose frequencies are aliases on the pixel grid.

    `spectrum`, from a real FFT of the fine grid, is (fine rows, fine columns // 2 + 1); `out` is (rows of pixels, fine
    columns // 2 + 1). The result is added to the rows `first` to `last` - 1 of `out`. `row_factor` and `column_factor`
    are pairs of arrays along the rows and the columns of `spectrum`: frequency [cycles/pixel], and complex transfer
    function without diffraction. The diffraction MTF, computed here, is 0 at `limit` [cycles/pixel] and above.
    """
    rows, half = out.shape
    row_frequency, row_values = row_factor
    column_frequency, column_values = column_factor
    fold_count = spectrum.shape[0] // rows
    for r in range(first, last):
        for a in range(fold_count):
            fine = r + a * rows
            y2 = row_frequency[fine] ** 2
            factor = row_values[fine] / fold_count
            for c in range(half):
                x = math.sqrt(y2 + column_frequency[c] ** 2) / limit
                if x >= 1.0:
                    break
                diffraction = 2.0 / math.pi * (math.acos(x) - x * math.sqrt(1.0 - x * x))
                out[r, c] += spectrum[fine, c] * (factor * column_values[c] * diffraction)
