"""The loop of `deglint.physics.imaging` that is compiled by numba."""

import math

from ..jit import njit


@njit(nogil=True, cache=True)
def fold(spectrum, out, first, last, row_factor, column_factor, limit):  # type: ignore[no-untyped-def]
    """Multiply the spectrum of a scene by an MTF; average the rows that sampling at the pixels maps to one frequency.

    `spectrum`, from a real FFT of the fine grid, is (fine rows, fine columns // 2 + 1); `out` is (rows of pixels, fine
    columns // 2 + 1), of which rows `first` to `last` - 1 are filled. Each factor is a pair of arrays along the rows
    or columns of `spectrum`: frequency [cycles/pixel], and complex transfer function there without diffraction. The
    diffraction MTF, computed here, is 0 at `limit` [cycles/pixel] and above.
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
