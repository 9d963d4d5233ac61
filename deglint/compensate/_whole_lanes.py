"""Several whole numbers side by side, for compiled functions: vectors of int16 or of int32, as an array holds them.

Every operation is LLVM's own on a vector. Indices count numbers of a contiguous array and are not looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ._lanes import FEATURES, Vector, constant, everywhere, pointer

BYTES = 64 if "+avx512bw" in FEATURES else 32
"""Of a vector."""
_INDEX = ir.IntType(32)


def _of(array: Any) -> Vector:
    """The vectors of an array."""
    bits = array.dtype.bitwidth
    return Vector(8 * BYTES // bits, bits)


def _choice(sign: str) -> Any:
    """The one of two."""

    def typed(_typing: Any, a: Any, b: Any) -> Any:
        def made(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
            return builder.select(builder.icmp_signed(sign, *given), *given)

        return a(a, b), made

    return intrinsic(typed)


def _negative(_typing: Any, a: Any) -> Any:
    """Of each; the largest number there is stays."""

    def made(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        largest = constant(a.made_of, (1 << (a.bits - 1)) - 1)
        return builder.select(builder.icmp_signed("==", given[0], largest), given[0], builder.neg(given[0]))

    return a(a), made


def _load(_typing: Any, array: Any, _index: Any) -> Any:
    """Numbers of an array."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return _loaded(context, builder, signature.args[0], *given)

    return _of(array)(array, types.intp), made


def _store(_typing: Any, array: Any, _index: Any, values: Any) -> Any:
    """Put numbers into an array."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        _stored(context, builder, signature.args[0], *given)
        return context.get_dummy_value()

    return types.void(array, types.intp, values), made


def _loaded(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    spot = pointer(context, builder, kind, array, index, _of(kind).made_of)
    return builder.load(spot, align=kind.dtype.bitwidth // 8)


def _stored(context: Any, builder: Any, kind: Any, array: Any, index: Any, values: Any) -> None:
    spot = pointer(context, builder, kind, array, index, values.type)
    builder.store(values, spot, align=kind.dtype.bitwidth // 8)


def _before(_typing: Any, values: Any, _first: Any) -> Any:
    """Each number a lane further, and the first number of `first` in front."""

    def made(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        order = [values.count, *range(values.count - 1)]
        return builder.shuffle_vector(*given, ir.Constant(ir.VectorType(_INDEX, values.count), order))

    return values(values, values), made


def _behind(_typing: Any, values: Any, number: Any, _lane: Any) -> Any:
    """Each number a lane back, and in this lane another number."""

    def made(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        kind, size = values.made_of, values.count
        order = ir.Constant(ir.VectorType(_INDEX, size), [*range(1, size), 0])
        lane = everywhere(builder, builder.trunc(given[2], kind.element), kind)
        here = builder.icmp_signed("==", lane, ir.Constant(kind, list(range(size))))
        moved = builder.shuffle_vector(given[0], given[0], order)
        return builder.select(here, everywhere(builder, given[1], kind), moved)

    return values(values, number, types.intp), made


def _count(_typing: Any, array: Any) -> Any:
    """Numbers of an array in a vector."""

    def made(context: Any, _builder: Any, signature: Any, _given: Any) -> Any:
        return context.get_constant(types.intp, _of(signature.args[0]).count)

    return types.intp(array), made


def _turn(_typing: Any, array: Any, _at: Any, _step: Any, _to: Any, _stride: Any) -> Any:
    """Transpose a square: its rows, `step` apart from `at` on, are put `stride` apart from `to` on, in order."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        x, at, step, to, stride = given
        kind = signature.args[0]
        count = _of(kind).count

        def row(i: int, first: Any, apart: Any) -> Any:
            return builder.add(first, builder.mul(apart, ir.Constant(apart.type, i)))

        rows = [_loaded(context, builder, kind, x, row(i, at, step)) for i in range(count)]
        rows = _transposed(builder, rows, 128 // kind.dtype.bitwidth)
        for i, values in enumerate(rows):
            _stored(context, builder, kind, x, row(i, to, stride), values)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, types.intp, types.intp), made


def _transposed(builder: Any, rows: list[Any], some: int) -> list[Any]:
    """A square, by what processors shuffle quickly: numbers within so many of a vector, and then those as a whole."""
    count = len(rows)
    blocks = count // some

    def shuffled(a: Any, b: Any, order: list[int]) -> Any:
        return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_INDEX, count), order))

    def whole(a: Any, b: Any, places: list[int]) -> Any:
        return shuffled(a, b, [some * place + k for place in places for k in range(some)])

    zipped = [
        [block * some + half + n // 2 + n % 2 * count for block in range(blocks) for n in range(some)]
        for half in (0, some // 2)
    ]
    groups = [rows[first : first + some] for first in range(0, count, some)]
    for n, group in enumerate(groups):
        for _ in range(some.bit_length() - 1):
            pairs = zip(group[: some // 2], group[some // 2 :], strict=True)
            group = [shuffled(a, b, order) for a, b in pairs for order in zipped]
        groups[n] = group
    found: list[Any] = [None] * count
    for r in range(some):
        parts = [group[r] for group in groups]
        if blocks == 4:
            halves = [[0, 1, 4, 5], [2, 3, 6, 7]]
            parts = [whole(parts[k], parts[k + 1], half) for half in halves for k in (0, 2)]
        ends = [list(range(first, 2 * blocks, 2)) for first in (0, 1)]
        parts = [whole(parts[k], parts[k + 1], end) for k in range(0, blocks, 2) for end in ends]
        for q, values in enumerate(parts):
            found[q * some + r] = values
    return found


least: Callable[..., Any] = _choice("<")
most: Callable[..., Any] = _choice(">")
negative: Any = intrinsic(_negative)
before: Any = intrinsic(_before)
behind: Any = intrinsic(_behind)
load: Any = intrinsic(_load)
store: Any = intrinsic(_store)
count: Any = intrinsic(_count)
turn: Any = intrinsic(_turn)
