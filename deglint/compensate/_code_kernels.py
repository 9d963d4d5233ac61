"""Compiled: `deglint.compensate.codes`, and what is done with the codes of levels and of outlines."""

from __future__ import annotations

import numba as nb
import numpy as np

from ._apart import apart

ONE = np.int32(0x3F800000)
"""1.0 as bits."""
DROPPED = 13
"""Bits of 1 + |q| that are left out: 10 of the fraction are kept."""
LARGEST, NOTHING = np.int32(32766), np.int32(32767)


@nb.njit(cache=True, nogil=True)
def encode_row(row, centre, per_unit, size, bits, out):  # type: ignore[no-untyped-def]
    """Codes of a row; `bits` is `size`, for scratch, seen as integers."""
    apart()
    for j in range(row.size):
        size[j] = abs((row[j] - centre) * per_unit) + np.float32(1)
    for j in range(row.size):
        code = (bits[j] - ONE + np.int32(1 << (DROPPED - 1))) >> np.int32(DROPPED)
        code = code if code < LARGEST else LARGEST
        code = -code if row[j] < centre else code
        out[j] = code if row[j] == row[j] else NOTHING


@nb.njit(cache=True, nogil=True)
def encode(band, centre, per_unit, out):  # type: ignore[no-untyped-def]
    """Codes of a band."""
    size = np.empty(band.shape[1], np.float32)
    bits = size.view(np.int32)
    for i in range(len(band)):
        encode_row(band[i], centre, per_unit, size, bits, out[i])


@nb.njit(cache=True, nogil=True)
def decode_row(codes, centre, unit, bits, size, out):  # type: ignore[no-untyped-def]
    """Values of a row of codes."""
    apart()
    for j in range(out.size):
        bits[j] = (abs(np.int32(codes[j])) << np.int32(DROPPED)) + ONE
    for j in range(out.size):
        away = (size[j] - np.float32(1)) * unit
        value = centre - away if codes[j] < 0 else centre + away
        out[j] = value if abs(np.int32(codes[j])) != NOTHING else np.float32(np.nan)


@nb.njit(cache=True, nogil=True)
def decode(codes, centre, unit, out):  # type: ignore[no-untyped-def]
    """Values of codes."""
    size = np.empty(codes.shape[1], np.float32)
    bits = size.view(np.int32)
    for i in range(len(codes)):
        decode_row(codes[i], centre, unit, bits, size, out[i])


@nb.njit(cache=True, nogil=True)
def beyond(level, outline, per_glint, detail, scaled):  # type: ignore[no-untyped-def]
    """By how much a row of outlines exceeds one of the level, and that in units of glint; 0 where there is neither."""
    apart()
    for j in range(detail.size):
        more = outline[j] - level[j]
        detail[j] = more if more > np.float32(0) else np.float32(0)
        scaled[j] = detail[j] * per_glint


@nb.njit(cache=True, nogil=True)
def capped(a, b, c, d, factor, detail, out):  # type: ignore[no-untyped-def]
    """Add of a detail no more than the factor times the best pair: two before, one on either side, two after."""
    apart()
    for j in range(out.size):
        before = a[j] if a[j] < b[j] else b[j]
        around = b[j] if b[j] < c[j] else c[j]
        after = c[j] if c[j] < d[j] else d[j]
        most = before if before > around else around
        most = (most if most > after else after) * factor
        out[j] = out[j] + (most if most < detail[j] else detail[j])


@nb.njit(cache=True, nogil=True)
def agree(levels, outlines, grids, order, glint, slack, out):  # type: ignore[no-untyped-def]
    """`deglint.compensate.level.agreeing`; grids are centre and unit, glint is the spectrum in the order of bands."""
    count, (bands, rows, columns) = len(order), out.shape
    scaled = np.zeros((bands + 4, columns), np.float32)  # nothing agrees beyond the first and the last band
    details, outline = np.zeros((bands, columns), np.float32), np.empty(columns, np.float32)
    size = np.empty(columns, np.float32)
    bits = size.view(np.int32)
    for i in range(rows):
        for b in range(bands):
            decode_row(levels[b, i], grids[b, 0], grids[b, 1], bits, size, out[b, i])
        for n in range(count):
            b = order[n]
            decode_row(outlines[b, i], grids[b, 0], grids[b, 1], bits, size, outline)
            beyond(out[b, i], outline, np.float32(1) / glint[n], details[n], scaled[n + 2])
        for n in range(count):
            a, b, c, d = scaled[n], scaled[n + 1], scaled[n + 3], scaled[n + 4]
            capped(a, b, c, d, slack * glint[n], details[n], out[order[n], i])
