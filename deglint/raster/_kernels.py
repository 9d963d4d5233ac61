"""The compiled inner loops of `deglint.raster.encode`; their numpy twins stand in the tests."""

from typing import Any

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def look(values, mask, everywhere, flags, with_flags, negative_mark):  # type: ignore[no-untyped-def]
    """Count (and flag) negative values of one band that is already in place."""
    rows, columns = values.shape
    negative: Any = 0
    for r in range(rows):
        row = values[r]
        if everywhere and not with_flags:
            count = 0
            for c in range(columns):
                count += row[c] < 0
            negative += count
            continue
        for c in range(columns):
            if row[c] < 0 and (everywhere or mask[r, c]):
                negative += 1
                if with_flags:
                    flags[r, c] |= negative_mark
    return negative


@njit(nogil=True, cache=True)
def put_integers(physical, raw, mask, everywhere, scale, offset, low, high, flags, with_flags, mark_neg, mark_clip):  # type: ignore[no-untyped-def]
    """Round, saturate and store one band as integers; return how many were negative, and how many clipped."""
    rows, columns = physical.shape
    negative: Any = 0
    clipped: Any = 0
    plain = scale == 1.0 and offset == 0.0
    for r in range(rows):
        for c in range(columns):
            x = np.float64(physical[r, c])
            if not (everywhere or mask[r, c]) or not np.isfinite(x):
                continue
            value = np.rint(x) if plain else np.rint((x - offset) / scale)
            below = x < 0
            outside = value < low or value > high
            raw[r, c] = min(max(value, low), high)
            negative += below
            clipped += outside
            if with_flags:
                flags[r, c] |= (mark_neg if below else 0) | (mark_clip if outside else 0)
    return negative, clipped


@njit(nogil=True, cache=True)
def put_floats(physical, raw, mask, everywhere, scale, offset, flags, with_flags, mark_neg):  # type: ignore[no-untyped-def]
    """Store one band as floating point; return how many were negative."""
    rows, columns = physical.shape
    negative: Any = 0
    plain = scale == 1.0 and offset == 0.0
    for r in range(rows):
        for c in range(columns):
            x = np.float64(physical[r, c])
            if not (everywhere or mask[r, c]) or not np.isfinite(x):
                continue
            raw[r, c] = x if plain else (x - offset) / scale
            below = x < 0
            negative += below
            if with_flags and below:
                flags[r, c] |= mark_neg
    return negative
