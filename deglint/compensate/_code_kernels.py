"""Compiled: `deglint.compensate.codes`, and what is done with the codes of levels and of outlines.

Vectors (`deglint.compensate._lanes`) over all pixels of a band, in whatever rows they lie; there are `LANES` or more.
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ._lanes import FLOATS, LANES, lanes, larger, load, pointer, plus, smaller, spread, store, times

_CODES, _BITS = ir.VectorType(ir.IntType(16), LANES), ir.VectorType(ir.IntType(32), LANES)
_ONE = 0x3F800000
"""1.0 as bits."""
_DROPPED = 13
"""Bits of 1 + |q| that are left out: 10 of the fraction are kept."""
_NOTHING = 32767
ZERO, MINUS = np.float32(0), np.float32(-1)


def _every(kind: Any, number: Any) -> Any:
    return ir.Constant(kind, [number] * LANES)


def _told(_typing: Any, codes: Any, _index: Any, _centre: Any, _unit: Any) -> Any:
    """Values of codes of an array."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        spot = pointer(context, builder, signature.args[0], given[0], given[1], _CODES)
        code = builder.sext(builder.load(spot, align=2), _BITS)
        below = builder.icmp_signed("<", code, _every(_BITS, 0))
        size = builder.select(below, builder.neg(code), code)
        bits = builder.add(builder.shl(size, _every(_BITS, _DROPPED)), _every(_BITS, _ONE))
        away = builder.fmul(builder.fsub(builder.bitcast(bits, FLOATS), _every(FLOATS, 1.0)), given[3])
        value = builder.select(below, builder.fsub(given[2], away), builder.fadd(given[2], away))
        none = builder.icmp_signed("==", size, _every(_BITS, _NOTHING))
        return builder.select(none, _every(FLOATS, float("nan")), value)

    return lanes(codes, types.intp, lanes, lanes), made


def _tell(_typing: Any, codes: Any, _index: Any, _values: Any, _centre: Any, _per_unit: Any) -> Any:
    """Put the codes of values into an array."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        codes, index, values, centre, per_unit = given
        away = builder.fmul(builder.fsub(values, centre), per_unit)
        bits = builder.and_(builder.bitcast(away, _BITS), _every(_BITS, 0x7FFFFFFF))
        size = builder.bitcast(builder.fadd(builder.bitcast(bits, FLOATS), _every(FLOATS, 1.0)), _BITS)
        size = builder.add(size, _every(_BITS, (1 << (_DROPPED - 1)) - _ONE))
        code = builder.ashr(size, _every(_BITS, _DROPPED))
        most = _every(_BITS, _NOTHING - 1)
        code = builder.select(builder.icmp_signed("<", code, most), code, most)
        code = builder.select(builder.fcmp_ordered("<", values, centre), builder.neg(code), code)
        code = builder.select(builder.fcmp_ordered("ord", values, values), code, _every(_BITS, _NOTHING))
        spot = pointer(context, builder, signature.args[0], codes, index, _CODES)
        builder.store(builder.trunc(code, _CODES), spot, align=2)
        return context.get_dummy_value()

    return types.void(codes, types.intp, lanes, lanes, lanes), made


told: Any = intrinsic(_told)
tell: Any = intrinsic(_tell)


@nb.njit(cache=True, nogil=True)
def encode(band, centre, per_unit, out):  # type: ignore[no-untyped-def]
    """Codes of a band."""
    middle, scale = spread(centre), spread(per_unit)
    for first in range(0, band.size, LANES):
        p = min(first, band.size - LANES)
        tell(out, p, load(band, p), middle, scale)


@nb.njit(cache=True, nogil=True)
def decode(codes, centre, unit, out):  # type: ignore[no-untyped-def]
    """Values of codes."""
    middle, scale = spread(centre), spread(unit)
    for first in range(0, codes.size, LANES):
        p = min(first, codes.size - LANES)
        store(out, p, told(codes, p, middle, scale))


@nb.njit(cache=True, nogil=True)
def capped(level, detail, before, around, after, factor):  # type: ignore[no-untyped-def]
    """Add of a detail no more than the factor times the best pair: two before, one on either side, two after."""
    most = larger(larger(smaller(*before), smaller(*around)), smaller(*after))
    return plus(level, smaller(times(most, factor), detail))


@nb.njit(cache=True, nogil=True)
def agree(levels, outlines, grids, order, glint, slack, out):  # type: ignore[no-untyped-def]
    """`deglint.compensate.level.agreeing`; grids are centre and unit, glint is the spectrum in the order of bands."""
    count, size = len(order), levels[0].size
    alone = np.ones(len(levels), np.bool_)
    alone[order] = False
    for b in range(len(levels)):
        if alone[b]:
            decode(levels[b], grids[b, 0], grids[b, 1], out[b])
    none = spread(ZERO)
    for first in range(0, size if count else 0, LANES):
        p = min(first, size - LANES)
        a = b = c = d = none  # scaled details of bands n - 4 to n - 1; nothing agrees beyond the first and the last
        level = level_before = detail = detail_before = none
        for n in range(count + 2):
            e, level_now, detail_now = none, none, none
            if n < count:
                at = order[n] * size + p
                middle, unit = spread(grids[order[n], 0]), spread(grids[order[n], 1])
                level_now = told(levels, at, middle, unit)
                detail_now = larger(plus(told(outlines, at, middle, unit), times(level_now, spread(MINUS))), none)
                e = times(detail_now, spread(np.float32(1) / glint[n]))
            if n > 1:
                factor = spread(slack * glint[n - 2])
                found = capped(level_before, detail_before, (a, b), (b, d), (d, e), factor)
                store(out, order[n - 2] * size + p, found)
            a, b, c, d = b, c, d, e
            level_before, level = level, level_now
            detail_before, detail = detail, detail_now
