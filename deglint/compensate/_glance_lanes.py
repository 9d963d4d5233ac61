"""Several numbers side by side, for the first look: bins of float32, and sums of tabled bytes (see `._lanes`).

Whole numbers and comparisons with the edges decide, so that results are the same on every processor.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ._lanes import FLOATS, LANES, Vector, chosen, constant, everywhere, fma, loaded, pointer

GROUPS = 16
"""Sums of 16 bits side by side, each of one group of shapes."""
PIECES = 64
"""Bins, and one more than there are edges."""
MIDDLE = 698_000
"""What is added to the bits of the highest tangent: for a logarithm they are too low by 0 to twice this."""
sums, bins = Vector(GROUPS, 16), Vector(LANES, 32)
_SUMS, _INTS = sums.made_of, bins.made_of


def _each(value: float | int) -> Any:
    """A constant in every lane."""
    return constant(_INTS if isinstance(value, int) else FLOATS, value)


def _row(_typing: Any, array: Any, _index: Any) -> Any:
    """`GROUPS` numbers of an array of int8 or int16."""

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        bits = signature.args[0].dtype.bitwidth
        kind = ir.VectorType(ir.IntType(bits), GROUPS)
        values = builder.load(pointer(context, builder, signature.args[0], given[0], given[1], kind), align=1)
        return builder.sext(values, _SUMS) if bits < 16 else values

    return sums(array, types.intp), lower


def _each_sum(_typing: Any, _number: Any) -> Any:
    """A number in every sum."""

    def lower(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        return everywhere(builder, builder.trunc(given[0], ir.IntType(16)), _SUMS)

    return sums(types.int64), lower


def _add(_typing: Any, _a: Any, _b: Any) -> Any:
    return sums(sums, sums), lambda _context, builder, _signature, given: builder.add(*given)


def _put(_typing: Any, _sums: Any, array: Any, _index: Any) -> Any:
    """Put sums into an array of int16."""

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        spot = pointer(context, builder, signature.args[1], given[1], given[2], _SUMS)
        builder.store(given[0], spot, align=2)
        return context.get_dummy_value()

    return types.void(sums, array, types.intp), lower


def _above(_typing: Any, _a: Any, _b: Any) -> Any:
    """Whether any sum is above the other of its place."""

    def lower(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        bits = ir.IntType(GROUPS)
        return builder.icmp_unsigned("!=", builder.bitcast(builder.icmp_signed(">", *given), bits), bits(0))

    return types.boolean(sums, sums), lower


def _highest(_typing: Any, _sums: Any) -> Any:
    """The largest of the sums."""

    def lower(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(16), [_SUMS])
        found = builder.module.declare_intrinsic(f"llvm.vector.reduce.smax.v{GROUPS}i16", (), kind)
        return builder.sext(builder.call(found, given), ir.IntType(64))

    return types.int64(sums), lower


def _looked_up(context: Any, builder: Any, kind: Any, table: Any, index: Any) -> Any:
    """Numbers of a table of `PIECES`, which is in four registers where there are 32 of 512 bits."""
    if LANES == 16:
        call = ir.FunctionType(FLOATS, [FLOATS, _INTS, FLOATS])
        choose = builder.module.declare_intrinsic("llvm.x86.avx512.vpermi2var.ps.512", (), call)
        parts = [loaded(context, builder, kind, table, ir.IntType(64)(LANES * n)) for n in range(4)]
        low, high = (builder.call(choose, [parts[n], index, parts[n + 1]]) for n in (0, 2))
        return builder.select(builder.icmp_signed("<", index, _each(2 * LANES)), low, high)
    found = ir.Constant(FLOATS, ir.Undefined)
    for n in range(LANES):
        lane = ir.IntType(32)(n)
        place = builder.sext(builder.extract_element(index, lane), ir.IntType(64))
        value = builder.load(pointer(context, builder, kind, table, place, ir.FloatType()))
        found = builder.insert_element(found, value, lane)
    return found


def _binned(_typing: Any, z: Any, _at: Any, edges: Any, _begin: Any, _scale: Any) -> Any:
    """How many edges lie at or below numbers of an array: a guess, and one comparison.

    Edges are equally far apart in asinh(z) = ln(|z| + sqrt(z^2 + 1)), with the sign of z. For the root and |z| the
    highest of three tangents is taken, and for the logarithm its bits, times `scale`: right within a third of a bin.
    `begin` is half a bin lower than where zero lies, so that the guess is right or one too low.
    """

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        z, at, edges, begin, scale = given
        value = loaded(context, builder, signature.args[0], z, at)
        bits = builder.bitcast(value, _INTS)
        size = builder.bitcast(builder.and_(bits, _each(0x7FFFFFFF)), FLOATS)
        root = 2**-0.5
        tangents = [fma(builder, size, _each(a), _each(b)) for a, b in ((1.0, 1.0), (1 + root, root), (2.0, 0.0))]
        grown = chosen(builder, ">", chosen(builder, ">", *tangents[:2]), tangents[2])
        log = builder.sitofp(builder.sub(builder.bitcast(grown, _INTS), _each(0x3F800000 - MIDDLE)), FLOATS)
        sign = builder.and_(bits, _each(-0x80000000))
        log = builder.bitcast(builder.or_(builder.bitcast(log, _INTS), sign), FLOATS)
        guess = fma(builder, log, everywhere(builder, scale), everywhere(builder, begin))
        guess = chosen(builder, ">", guess, _each(0.0))
        guess = chosen(builder, "<", guess, _each(PIECES - 1.0))
        low = builder.fptosi(guess, _INTS)
        edge = _looked_up(context, builder, signature.args[2], edges, low)
        return builder.add(low, builder.zext(builder.fcmp_ordered(">=", value, edge), _INTS))

    return bins(z, types.intp, edges, types.float32, types.float32), lower


def _pair(_typing: Any, _before: Any, _now: Any, _base: Any, out: Any, _at: Any) -> Any:
    """Put places in a table of pairs of bins, from `base` on, into an array of uint16."""

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        before, now, base, out, at = given
        place = builder.add(builder.mul(before, _each(PIECES)), now)
        place = builder.add(place, everywhere(builder, base, _INTS))
        kind = ir.VectorType(ir.IntType(16), LANES)
        spot = pointer(context, builder, signature.args[3], out, at, kind)
        builder.store(builder.trunc(place, kind), spot, align=2)
        return context.get_dummy_value()

    return types.void(bins, bins, types.int32, out, types.intp), lower


row: Any = intrinsic(_row)
each: Any = intrinsic(_each_sum)
add: Any = intrinsic(_add)
put: Any = intrinsic(_put)
above: Any = intrinsic(_above)
highest: Any = intrinsic(_highest)
binned: Any = intrinsic(_binned)
pair: Any = intrinsic(_pair)
