"""Several float32 side by side, for compiled functions: what loops over single numbers leave to the compiler's luck.

Every operation is LLVM's own on a vector. Products are fused with sums only where `fused` says so, and then everywhere,
so that a result is the same to the bit wherever a number lies, and on every processor; one that has no fused
multiply-add (x86 from before 2013) is slow. Indices count numbers of a contiguous array of any shape, and are not
looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.registry import cpu_target
from numba.extending import intrinsic, models, register_model

FEATURES = cpu_target.target_context.codegen().magic_tuple()[2].split(",")  # what compiled code is kept for on disk
LANES = 16 if "+avx512f" in FEATURES else 8
_INDEX = ir.IntType(32)
_BYTE = ir.IntType(8)


class Vector(types.Type):
    """So many numbers side by side: float32 where they have no bits, else whole numbers of so many."""

    def __init__(self, count: int, bits: int = 0) -> None:
        self.count, self.bits = count, bits
        super().__init__(name=f"int{bits}x{count}" if bits else f"float32x{count}")

    @property
    def made_of(self) -> ir.VectorType:
        """As LLVM has it."""
        return ir.VectorType(ir.IntType(self.bits) if self.bits else ir.FloatType(), self.count)


@register_model(Vector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.made_of)


lanes = Vector(LANES)
FLOATS = lanes.made_of


def fma(builder: Any, x: Any, y: Any, z: Any) -> Any:
    """x * y + z, rounded once."""
    kind = ir.FunctionType(FLOATS, [FLOATS] * 3)
    return builder.call(builder.module.declare_intrinsic(f"llvm.fma.v{LANES}f32", (), kind), [x, y, z])


def pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any, what: Any) -> Any:
    """To something in an array of this kind."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), what.as_pointer())


def loaded(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """A vector from an array of this kind."""
    return builder.load(pointer(context, builder, kind, array, index, FLOATS), align=4)


def stored(context: Any, builder: Any, kind: Any, array: Any, index: Any, values: Any) -> None:
    """A vector into an array of this kind."""
    builder.store(values, pointer(context, builder, kind, array, index, FLOATS), align=4)


def everywhere(builder: Any, number: Any, kind: Any = FLOATS) -> Any:
    """A number in every lane of a vector of this kind."""
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), number, _INDEX(0))
    return builder.shuffle_vector(one, one, constant(ir.VectorType(_INDEX, kind.count), 0))


def constant(kind: Any, number: float | int) -> Any:
    """The same number in every lane."""
    return ir.Constant(kind, [number] * kind.count)


def chosen(builder: Any, sign: str, x: Any, y: Any) -> Any:
    """The first where it compares so with the second; the second where either is NaN."""
    return builder.select(builder.fcmp_ordered(sign, x, y), x, y)


def _operation(count: int, emit: Callable[..., Any]) -> Any:
    """Something that makes a vector from so many vectors."""

    def made(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        return emit(builder, *given)

    kinds: dict[int, Callable[..., Any]] = {
        2: lambda _typing, _a, _b: (lanes(*[lanes] * 2), made),
        3: lambda _typing, _a, _b, _c: (lanes(*[lanes] * 3), made),
        4: lambda _typing, _a, _b, _c, _d: (lanes(*[lanes] * 4), made),
    }
    return intrinsic(kinds[count])


plus = _operation(2, lambda b, x, y: b.fadd(x, y))
times = _operation(2, lambda b, x, y: b.fmul(x, y))
over = _operation(2, lambda b, x, y: b.fdiv(x, y))
fused = _operation(3, fma)
larger = _operation(2, lambda b, x, y: chosen(b, ">", x, y))
"""The second where the first is NaN."""
smaller = _operation(2, lambda b, x, y: chosen(b, "<", x, y))
if_same = _operation(4, lambda b, x, y, same, other: b.select(b.fcmp_ordered("==", x, y), same, other))
if_more = _operation(4, lambda b, x, y, more, other: b.select(b.fcmp_ordered(">", x, y), more, other))


def _spread(_typing: Any, _number: Any) -> Any:
    """A number in every lane."""
    return lanes(types.float32), lambda _context, builder, _signature, given: everywhere(builder, given[0])


def _load(_typing: Any, array: Any, _index: Any) -> Any:
    """Numbers of an array."""

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return loaded(context, builder, signature.args[0], *given)

    return lanes(array, types.intp), lower


def _store(_typing: Any, array: Any, _index: Any, _values: Any) -> Any:
    """Put numbers into an array."""

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        stored(context, builder, signature.args[0], *given)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), lower


def _ahead(_typing: Any, array: Any, _index: Any) -> Any:
    """What lies there will be wanted soon; it need not be in the array."""

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        spot = pointer(context, builder, signature.args[0], given[0], given[1], _BYTE)
        kind = ir.FunctionType(ir.VoidType(), [spot.type, _INDEX, _INDEX, _INDEX])
        ask = builder.module.declare_intrinsic("llvm.prefetch", [spot.type], kind)
        builder.call(ask, [spot, _INDEX(0), _INDEX(2), _INDEX(1)])  # to read, into the second cache, data
        return context.get_dummy_value()

    return types.void(array, types.intp), lower


def _turn(_typing: Any, array: Any, _at: Any, _step: Any, out: Any, _to: Any, _stride: Any) -> Any:
    """Transpose a square: its rows, `step` apart in the array from `at` on, are put `stride` apart from `to` on."""

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        array, at, step, out, to, stride = given
        source, target = signature.args[0], signature.args[3]

        def row(i: int, first: Any, apart: Any) -> Any:
            return builder.add(first, builder.mul(apart, ir.Constant(apart.type, i)))

        rows = [loaded(context, builder, source, array, row(i, at, step)) for i in range(LANES)]
        for d in (1 << n for n in range(LANES.bit_length() - 1)):  # swap blocks of d x d numbers beside the diagonal
            low, high = (
                ir.Constant(
                    ir.VectorType(_INDEX, LANES), [n + (LANES - d + back if n & d else back) for n in range(LANES)]
                )
                for back in (0, d)
            )
            for i in (i for i in range(LANES) if not i & d):
                pair = rows[i], rows[i + d]
                rows[i], rows[i + d] = (builder.shuffle_vector(*pair, order) for order in (low, high))
        for i, values in enumerate(rows):
            stored(context, builder, target, out, row(i, to, stride), values)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, out, types.intp, types.intp), lower


spread: Any = intrinsic(_spread)
load: Any = intrinsic(_load)
store: Any = intrinsic(_store)
ahead: Any = intrinsic(_ahead)
turn: Any = intrinsic(_turn)
