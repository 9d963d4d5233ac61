"""Compiled: `deglint.compensate.codes`, and what is done with the codes of levels and of outlines.

Vectors (`deglint.compensate._lanes`) over all pixels of a band, in whatever rows they lie; there are `LANES` or more.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from .. import jit as nb
from ._lanes import FLOATS, LANES, constant, if_more, lanes, larger, load, plus, pointer, smaller, spread, store, times

_CODES, _BITS = ir.VectorType(ir.IntType(16), LANES), ir.VectorType(ir.IntType(32), LANES)
_BITS_OF_ONE = 0x3F800000
"""1.0 as bits."""
_DROPPED = 13
"""Bits of 1 + |q| that are left out: 10 of the fraction are kept."""
_NOTHING = 32767
ZERO, ONE, MINUS = (np.float32(x) for x in (0, 1, -1))
WIDE = 256
"""Most pixels of all bands that are worked on at a time."""


def _told(_typing: Any, codes: Any, _index: Any, _centre: Any, _unit: Any) -> Any:
    """Values of codes of an array."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        spot = pointer(context, builder, signature.args[0], given[0], given[1], _CODES)
        code = builder.sext(builder.load(spot, align=2), _BITS)
        below = builder.icmp_signed("<", code, constant(_BITS, 0))
        size = builder.select(below, builder.neg(code), code)
        bits = builder.add(builder.shl(size, constant(_BITS, _DROPPED)), constant(_BITS, _BITS_OF_ONE))
        away = builder.fmul(builder.fsub(builder.bitcast(bits, FLOATS), constant(FLOATS, 1.0)), given[3])
        value = builder.select(below, builder.fsub(given[2], away), builder.fadd(given[2], away))
        none = builder.icmp_signed("==", size, constant(_BITS, _NOTHING))
        return builder.select(none, constant(FLOATS, float("nan")), value)

    return lanes(codes, types.intp, lanes, lanes), made


def _tell(_typing: Any, codes: Any, _index: Any, _values: Any, _centre: Any, _per_unit: Any) -> Any:
    """Put the codes of values into an array."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        codes, index, values, centre, per_unit = given
        away = builder.fmul(builder.fsub(values, centre), per_unit)
        bits = builder.and_(builder.bitcast(away, _BITS), constant(_BITS, 0x7FFFFFFF))
        size = builder.bitcast(builder.fadd(builder.bitcast(bits, FLOATS), constant(FLOATS, 1.0)), _BITS)
        size = builder.add(size, constant(_BITS, (1 << (_DROPPED - 1)) - _BITS_OF_ONE))
        code = builder.ashr(size, constant(_BITS, _DROPPED))
        most = constant(_BITS, _NOTHING - 1)
        code = builder.select(builder.icmp_signed("<", code, most), code, most)
        code = builder.select(builder.fcmp_ordered("<", values, centre), builder.neg(code), code)
        code = builder.select(builder.fcmp_ordered("ord", values, values), code, constant(_BITS, _NOTHING))
        spot = pointer(context, builder, signature.args[0], codes, index, _CODES)
        builder.store(builder.trunc(code, _CODES), spot, align=2)
        return context.get_dummy_value()

    return types.void(codes, types.intp, lanes, lanes, lanes), made


def _put(_typing: Any, out: Any, replaced: Any, _at: Any, _value: Any, _level: Any, _rise: Any, _full: Any) -> Any:
    """Values, or the level where they exceed it by more than the rise or are full, and there is one; and where."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        out, replaced, at, value, level, rise, full = given
        above = builder.fcmp_ordered(">", value, builder.fadd(level, rise))
        hit = builder.or_(above, builder.fcmp_ordered(">=", value, full))
        known = builder.fcmp_ordered("==", builder.fsub(level, level), constant(FLOATS, 0.0))
        hit = builder.and_(hit, known)
        spot = pointer(context, builder, signature.args[0], out, at, FLOATS)
        builder.store(builder.select(hit, level, value), spot, align=4)
        marks = ir.VectorType(ir.IntType(8), LANES)
        spot = pointer(context, builder, signature.args[1], replaced, at, marks)
        builder.store(builder.zext(hit, marks), spot, align=1)
        return context.get_dummy_value()

    return types.void(out, replaced, types.intp, lanes, lanes, lanes, lanes), made


def _mark(_typing: Any, out: Any, _at: Any, _values: Any, _limit: Any) -> Any:
    """Note where values exceed a limit."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        out, at, values, limit = given
        marks = ir.VectorType(ir.IntType(8), LANES)
        spot = pointer(context, builder, signature.args[0], out, at, marks)
        builder.store(builder.zext(builder.fcmp_ordered(">", values, limit), marks), spot, align=1)
        return context.get_dummy_value()

    return types.void(out, types.intp, lanes, lanes), made


def _wanted(_typing: Any, where: Any, _at: Any, _values: Any) -> Any:
    """Values where an array of marks has one; 0 elsewhere."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        where, at, values = given
        marks = ir.VectorType(ir.IntType(8), LANES)
        found = builder.load(pointer(context, builder, signature.args[0], where, at, marks), align=1)
        here = builder.icmp_signed("!=", found, constant(marks, 0))
        return builder.select(here, values, constant(FLOATS, 0.0))

    return lanes(where, types.intp, lanes), made


told: Any = intrinsic(_told)
wanted: Any = intrinsic(_wanted)
mark: Any = intrinsic(_mark)
put: Any = intrinsic(_put)
tell: Any = intrinsic(_tell)


@nb.njit(cache=True, nogil=True)
def encode(numbers, per_row, columns, centre, per_unit, out):  # type: ignore[no-untyped-def]
    """Codes of a band, of which a row begins so many numbers after the one before."""
    middle, scale = spread(centre), spread(per_unit)
    for i in range(out.size // columns):
        for first in range(0, columns, LANES):
            p = min(first, columns - LANES)
            tell(out, i * columns + p, load(numbers, i * per_row + p), middle, scale)


@nb.njit(cache=True, nogil=True)
def decode(codes, centre, unit, out):  # type: ignore[no-untyped-def]
    """Values of codes."""
    middle, scale = spread(centre), spread(unit)
    for first in range(0, codes.size, LANES):
        p = min(first, codes.size - LANES)
        store(out, p, told(codes, p, middle, scale))


@nb.njit(cache=True, nogil=True)
def exceed(codes, at, per_row, levels, columns, grid, limit, shown, share, out):  # type: ignore[no-untyped-def]
    """Where a part of a band exceeds its level by more than a limit, and a share of what is shown there; the part
    begins there, and its rows are so far apart."""
    middle, unit, most, part = spread(grid[0]), spread(grid[1]), spread(limit), spread(-share)
    for i in range(levels.size // columns):
        for first in range(0, columns, LANES):
            p = min(first, columns - LANES)
            to = i * columns + p
            under = times(told(levels, to, middle, unit), spread(MINUS))
            above = plus(told(codes, at + i * per_row + p, middle, unit), under)
            mark(out, to, plus(above, times(load(shown, to), part)), most)


@nb.njit(cache=True, nogil=True)
def capped(detail, before, around, after, factor):  # type: ignore[no-untyped-def]
    """Of a detail no more than the factor times the best pair: two before, one on either side, two after."""
    most = larger(larger(smaller(*before), smaller(*around)), smaller(*after))
    return smaller(times(most, factor), detail)


@nb.njit(cache=True, nogil=True)
def anywhere(where, at, count):  # type: ignore[no-untyped-def]
    """Whether there is a mark among so many from there on."""
    found = False
    for i in range(at, at + count):
        found |= where[i]
    return found


@nb.njit(cache=True, nogil=True)
def exceeding(codes, spots, grid, glint, where, x, to, line):  # type: ignore[no-untyped-def]
    """By how much outlines exceed the level in a part of a row, where they are wanted, and that in units of glint.

    spots : where that part begins in the codes of all bands, and in what there is of one
    """
    levels, outlines = codes
    middle, unit, per_glint = spread(grid[0]), spread(grid[1]), spread(np.float32(1) / glint)
    for first in range(0, line, LANES):
        p = min(first, line - LANES)
        level = told(levels, spots[0] + p, middle, unit)
        more = plus(told(outlines, spots[0] + p, middle, unit), times(level, spread(MINUS)))
        more = larger(more, spread(ZERO))
        if where.size:
            more = wanted(where, spots[1] + p, more)
        store(x, to + p, times(more, per_glint))
        store(x, to + x.size // 2 + p, more)


@nb.njit(cache=True, nogil=True)
def beyond(x, glint, some, witness, line):  # type: ignore[no-untyped-def]
    """Take off what is glint, as the witness shows it, of what `exceeding` has found in each band."""
    more, common = x.size // 2, (witness + 2) * line
    for first in range(0, line, LANES):
        p = min(first, line - LANES)
        shown = times(load(x, common + p), spread(MINUS))
        for n in range(some):
            to = (n + 2) * line + p
            left = larger(plus(load(x, to), shown), spread(ZERO)) if n != witness else spread(ZERO)
            store(x, to, left)
            store(x, to + more, times(left, spread(glint[n])))


@nb.njit(cache=True, nogil=True)
def stand_out(codes, spot, grids, order, some, glint, witness, where, x, line):  # type: ignore[no-untyped-def]
    """`exceeding` in so many bands, but for glint, where there is a witness."""
    size = codes[0].size // len(grids)
    for n in range(some):
        exceeding(codes, (order[n] * size + spot, spot), grids[order[n]], glint[n], where, x, (n + 2) * line, line)
    if some and witness >= 0:
        beyond(x, glint, some, witness, line)


@nb.njit(cache=True, nogil=True)
def agree(codes, grids, order, last, bands, glint, slack, columns, limits, witness, image, least, where, out):  # type: ignore[no-untyped-def]
    """`deglint.compensate.level.Opened`: the level and outlines, where they are wanted, and what is left of an image.

    codes : levels and outlines, (band x row x column); grids : centre and unit; order : bands, of which so many
    agree, up to the last, and then the others; witness : which of those shows all glint, -1 for none; bands : which
    they are of the image, and of what is written; image : numbers, from band to band, from row to row; least : of each
    band, by how much its outline exceeds the level where outlines are told: where half of those that agree do; where :
    (row x column), where outlines count, empty for everywhere; out : level, image, what was replaced in it, outlines
    (row x column): empty where not wanted
    """
    level, clean, replaced, outlined = out
    numbers, per_band, per_row = image
    size, pieces = codes[0].size // len(grids), -(-columns // WIDE)
    wide = min(columns, -(-columns // (pieces * LANES)) * LANES)  # alike: the last one overlaps by little
    x = np.zeros(2 * (len(order) + 4) * wide, np.float32)  # nothing agrees beyond the first and the last band
    more, half = x.size // 2, spread(np.float32((last + 1) // 2 - 0.5))
    for begin in range(0, size, columns):
        for first in range(0, columns, wide):
            at = begin + min(first, columns - wide)
            some = last if not where.size or anywhere(where, at, wide) else 0
            stand_out(codes, at, grids, order, some, glint, witness, where, x, wide)
            for n in range(len(order)):
                b, s = order[n], n * wide
                band, middle, unit = bands[b], spread(grids[b, 0]), spread(grids[b, 1])
                to, beside = band * size + at, band * per_band + begin // columns * per_row + at - begin
                factor = spread(slack * glint[n])
                offset, rise, full = (spread(limits[band, 0]), spread(limits[band, 1]), spread(limits[band, 2]))
                below, slope, most = (spread(-limits[band, 3]), spread(limits[band, 4]), spread(limits[band, 5]))
                share = spread(limits[band, 6])
                for place in range(0, wide, LANES):
                    p = min(place, wide - LANES)
                    found, detail = told(codes[0], b * size + at + p, middle, unit), spread(ZERO)
                    if n < some:
                        around = load(x, s + p + wide), load(x, s + p + 3 * wide)
                        before, after = (load(x, s + p), around[0]), (around[1], load(x, s + p + 4 * wide))
                        detail = capped(load(x, s + p + 2 * wide + more), before, around, after, factor)
                        found = plus(found, detail)
                        store(x, s + p + 2 * wide + more, detail)
                    above = rises = spread(ZERO)
                    if limits.size:
                        above = larger(plus(found, below), above)
                        noise = plus(spread(ONE), smaller(times(above, slope), most))
                        found, rises = plus(found, times(offset, noise)), plus(times(rise, noise), times(share, above))
                    if level.size:
                        store(level, to + p, found)
                    if clean.size:
                        put(clean, replaced, to + p, load(numbers, beside + p), found, rises, full)
            for place in range(0, wide if outlined.size else 0, LANES):
                p, count = min(place, wide - LANES), spread(ZERO)
                for n in range(some):
                    detail, away = load(x, (n + 2) * wide + more + p), spread(least[bands[order[n]]])
                    count = plus(count, if_more(detail, away, spread(ONE), spread(ZERO)))
                mark(outlined, at + p, count, half)
