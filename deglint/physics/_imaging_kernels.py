"""The loop of `deglint.physics.imaging` that is compiled by numba."""

import math

from ..jit import njit


@njit(nogil=True, cache=True)
def fold(spectrum, out, first, last, row_factor, column_factor, limit):  # type: ignore[no-untyped-def]
    """Multiply the spectrum of a scene on a fine grid by an MTF, and alias (fold) its rows onto the rows of pixels.

    `spectrum`, of a real FFT, is (fine row, fine column // 2 + 1); `out` is (pixel row, fine column // 2 + 1). Rows
    `first` to `last` - 1 of `out` are filled. `row_factor` and `column_factor` are (frequencies [cycles/pixel], complex
    MTF without diffraction) along each axis. The diffraction MTF is computed here; it is 0 from `limit` [cycles/pixel].
    """
    rows, half = out.shape
    row_frequency, row_values = row_factor
    column_frequency, column_values = column_factor
    fold_count = spectrum.shape[0] // rows
    for r in range(first, last):
        for c in range(half):
            out[r, c] = 0.0
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
