"""Correlation of vectors (`deglint.compensate._lanes`) with taps, for compiled functions: four sums at a time.

Written out tap by tap for each small radius, four sums take two thirds of the time that they take in a loop; and what
writes them out is this, not a function compiled for each radius, so that all radii together are compiled in a second.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from ._lanes import FLOATS, LANES, everywhere, fma, lanes, loaded, pointer

GROUP = 4
"""Sums at a time: what is loaded once serves all of them."""
MOST = 10
"""Largest radius whose taps are written out; system PSFs are no larger unless asked for."""
_INT = ir.IntType(64)
At = Callable[[Any], Any]


def _int(number: int) -> Any:
    return ir.Constant(_INT, number)


class _Sums:
    """Correlations of vectors with kernels: vector 0 is under the middle of the first sum, tap 0 the middle.

    Where `even`, taps are the same from either end. Written out or in a loop, a sum is the same to the bit.
    """

    def __init__(self, builder: Any, vector: At, kernels: Sequence[At], even: bool) -> None:
        self.builder, self.vector, self.kernels, self.even = builder, vector, kernels, even

    def first(self, under: Callable[[Any, int], Any]) -> list[Any]:
        """The middle taps, of each kernel in turn."""
        middles = [kernel(_int(0)) for kernel in self.kernels]
        return [self.builder.fmul(k, under(_int(0), u)) for k in middles for u in range(GROUP)]

    def more(self, t: Any, back: Any, sums: list[Any], under: Callable[[Any, int], Any]) -> list[Any]:
        """Add the taps t and `back` = -t."""
        sides = [(under(back, u), under(t, u)) for u in range(GROUP)]
        found: list[Any] = []
        if self.even:
            pairs = [self.builder.fadd(*side) for side in sides]
            for kernel in self.kernels:
                k = kernel(t)
                found += [fma(self.builder, k, x, total) for x, total in zip(pairs, sums[len(found) :], strict=False)]
            return found
        for kernel in self.kernels:
            k, q = kernel(back), kernel(t)
            for (left, right), total in zip(sides, sums[len(found) : len(found) + GROUP], strict=True):
                found.append(fma(self.builder, q, right, fma(self.builder, k, left, total)))
        return found

    def written_out(self, radius: int) -> Iterator[list[Any]]:
        """The sums tap by tap, for one radius; each vector is loaded once."""
        window: dict[int, Any] = {}

        def under(t: Any, u: int) -> Any:
            i = t.constant + u
            if i not in window:
                window[i] = self.vector(_int(i))
            return window[i]

        sums = self.first(under)
        yield sums
        for t in range(1, radius + 1):
            sums = self.more(_int(t), _int(-t), sums, under)
            yield sums

    def in_a_loop(self, radius: Any) -> list[Any]:
        """The sums, for any radius."""

        def under(t: Any, u: int) -> Any:
            return self.vector(self.builder.add(t, _int(u)))

        spots = [cgutils.alloca_once_value(self.builder, value) for value in self.first(under)]
        with cgutils.for_range_slice(self.builder, _int(1), self.builder.add(radius, _int(1)), _int(1), _INT) as (t, _):
            sums = self.more(t, self.builder.neg(t), [self.builder.load(spot) for spot in spots], under)
            for value, spot in zip(sums, spots, strict=True):
                self.builder.store(value, spot)
        return [self.builder.load(spot) for spot in spots]


def _by_radius(builder: Any, radius: Any, several: Sequence[_Sums]) -> list[Any]:
    """The sums of each, one after the other, by code of its own for each small radius."""
    spots = [cgutils.alloca_once(builder, FLOATS) for sums in several for _ in range(GROUP * len(sums.kernels))]
    large, end = builder.append_basic_block(), builder.append_basic_block()
    choice = builder.switch(radius, large)
    for r in range(MOST + 1):
        block = builder.append_basic_block()
        choice.add_case(_int(r), block)
        builder.position_at_end(block)
        *_, last = zip(*(sums.written_out(r) for sums in several), strict=True)  # in turn: each waits for its last sum
        _put(builder, [value for values in last for value in values], spots, end)
    builder.position_at_end(large)
    _put(builder, [value for sums in several for value in sums.in_a_loop(radius)], spots, end)
    builder.position_at_end(end)
    return [builder.load(spot) for spot in spots]


def _put(builder: Any, values: list[Any], spots: list[Any], end: Any) -> None:
    """Keep values, and go on."""
    for value, spot in zip(values, spots, strict=True):
        builder.store(value, spot)
    builder.branch(end)


def _kernel(context: Any, builder: Any, kind: Any, x: Any, middle: Any) -> At:
    """Its taps, each in every lane."""

    def tap(t: Any) -> Any:
        place = pointer(context, builder, kind, x, builder.add(middle, t), ir.FloatType())
        return everywhere(builder, builder.load(place))

    return tap


def _down_sums(
    _typing: Any, x: Any, at: Any, _first: Any, _j: Any, _k: Any, _q: Any, _radius: Any, lopsided: Any
) -> Any:
    """Vectors j of four rows with a column of taps, k its middle, and with another; at : places of rows, of which the
    four begin with `first`; lopsided : None where taps are the same from either end."""

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        x, at, first, j, k, q, radius, _ = given
        kind, integers = signature.args[:2]

        def vector(i: Any) -> Any:
            row = builder.load(pointer(context, builder, integers, at, builder.add(first, i), _INT))
            return loaded(context, builder, kind, x, builder.add(row, j))

        kernels = [_kernel(context, builder, kind, x, middle) for middle in (k, q)]
        found = _by_radius(builder, radius, [_Sums(builder, vector, kernels, signature.args[-1] == types.none)])
        return context.make_tuple(builder, signature.return_type, found)

    return types.UniTuple(lanes, 2 * GROUP)(x, at, *[types.int64] * 5, lopsided), lower


def _across_sums(_typing: Any, x: Any, _m: Any, _n: Any, _k: Any, _q: Any, _radius: Any, lopsided: Any) -> Any:
    """Four vectors from m on with a row of taps, k its middle, plus four from n on with another."""

    def lower(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        x, m, n, k, q, radius, _ = given
        kind, even = signature.args[0], signature.args[-1] == types.none

        def vectors(start: Any) -> At:
            return lambda i: loaded(context, builder, kind, x, builder.add(start, builder.mul(i, _int(LANES))))

        several = [
            _Sums(builder, vectors(start), [_kernel(context, builder, kind, x, middle)], even)
            for start, middle in ((m, k), (n, q))
        ]
        found = _by_radius(builder, radius, several)
        both = [builder.fadd(a, b) for a, b in zip(found[:GROUP], found[GROUP:], strict=True)]
        return context.make_tuple(builder, signature.return_type, both)

    return types.UniTuple(lanes, GROUP)(x, *[types.int64] * 5, lopsided), lower


down_sums: Any = intrinsic(_down_sums)
across_sums: Any = intrinsic(_across_sums)
