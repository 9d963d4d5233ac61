"""Rank openings: what is left of a band without what is bright and smaller than an element.

Picture a cloth pressed up from below against the image: it reaches into broad hills, not into needles. Large elements
are put together from small steps that take the least of three or five pixels; elements that begin with the same steps
share them. Arrays only, one band. Local: a tile with `opening_halo` pixels around it gives what the whole image gives,
to the bit.

References
----------
Serra (1982), Image Analysis and Mathematical Morphology, ISBN 0-12-637240-3; Soille (2002), "On morphological
operators based on rank filters", Pattern Recognition 35, 527-535, doi:10.1016/S0031-3203(01)00047-4 (rank openings)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..scene import Window
from .codes import Codes
from .state import Float32Array

Point = tuple[int, int]
"""Rows down and columns right."""
Ints = npt.NDArray[np.int64]

GUIDE = 3
"""Element under whose opening a detail may grow back [pixel]."""
LONGEST = 9
"""Reach of a line of pixels that is looked at in one step; longer ones are put together."""
AT_ONCE, NARROW = (4, 8), 800
"""Rows that a step makes at a time, fours: the more, the less often one is loaded, and the more of them are kept, which
is to fit into the processor's cache. They are the more up to this width [number]."""
WIDTH = 1024
"""At which pieces laid side by side begin another row [pixel], about."""
_NOTHING = np.iinfo(np.int32).max


class Steps(NamedTuple):
    """Steps in order, as `deglint.compensate._opening_kernels.run` takes them.

    kind, reach : (step,), what it does and how far apart the pixels are that it looks at; sources : (step,), how many
    steps it looks at; source, up, rows : (step, source), those, how far above the row they are looked at first, and in
    how many rows; behind : (step,), rows after the input; keep : (step,), rows that are kept; widen : (step,), columns
    that are repeated beyond the edges; level : the step that is the level; at_once : rows that a step makes at a time
    """

    kind: Ints
    reach: Ints
    sources: Ints
    source: Ints
    up: Ints
    rows: Ints
    behind: Ints
    keep: Ints
    widen: Ints
    level: int
    at_once: int


def diamond_of(size: int) -> int:
    """Width of the diamond that is as large as a square of this width, odd [pixel]."""
    return 2 * round(size / 2**0.5 - 0.5) + 1


def opening_halo(size: int, detail: int = 0) -> int:
    """Pixels that `openings` needs around a tile."""
    diamond = 2 * (diamond_of(size) // 2) + 1
    return max(2 * (size // 2) + 1, 2 * (detail // 2) + 2 if detail else 0, diamond if detail else 0)


def elements(size: int, shape: str) -> list[tuple[Point, ...]]:
    """Small elements which, one after the other, are one of this size: an octagon is some crosses and a square."""
    radius = size // 2
    if shape == "square":
        across = _line(radius)
        return [tuple((0, p) for p in step) for step in across] + [tuple((p, 0) for p in step) for step in across]
    if shape == "diamond":
        steps: list[int] = []
        while sum(steps) < radius:
            steps.append(min(max(sum(steps), 1), radius - sum(steps)))
        return [_star(step) for step in steps]
    reach = round(1.45 * radius)  # |row| + |column| at most
    return [_star(1)] * (2 * radius - reach) + elements(2 * (reach - radius) + 1, "square")


def _line(radius: int) -> list[tuple[int, ...]]:
    """Three or five places at a time which, one after the other, are all places so far from the middle."""
    steps: list[tuple[int, ...]] = []
    done = 0
    while done < radius:
        wide, left = 2 * done + 1, radius - done
        reach = left if left <= wide else min(wide, left // 2)
        steps.append((-reach, 0, reach) if left <= wide else (-2 * reach, -reach, 0, reach, 2 * reach))
        done += abs(steps[-1][0])
    return steps


def _star(reach: int) -> tuple[Point, ...]:
    """A pixel, and the four so far from it along the axes."""
    return ((-reach, 0), (0, -reach), (0, 0), (0, reach), (reach, 0))


Look = tuple[int, int, int]
"""At which step, how many rows up and how many down."""


@dataclass
class _Plan:
    """Steps as they are written down; one that is there already is not written again."""

    steps: list[tuple[int, int, tuple[Look, ...]]] = field(default_factory=list)

    def add(self, kind: int, reach: int, *looks: Look) -> int:
        """A step of a kind, with pixels so far apart, that looks at these rows of earlier ones."""
        step = kind, reach, looks
        if step not in self.steps:
            self.steps.append(step)
        return self.steps.index(step)

    def eroded(self, source: int, size: int, shape: str) -> int:
        """The steps of an element; those of a line of a few pixels are one, and so are those of a square of 3."""
        from ._opening_kernels import ACROSS, ACROSS3, ACROSS5, DOWN, DOWN3, DOWN5, SQUARE, STAR

        lines: dict[int, list[Sequence[int]]] = {0: [], 1: []}
        for element in elements(size, shape):
            down, across = (sorted({point[axis] for point in element}) for axis in (0, 1))
            if len(down) > 1 and len(across) > 1:
                source = self.add(STAR, down[-1], (source, down[-1], down[-1]))
            else:
                lines[len(down) > 1].append(across if len(across) > 1 else down)
        if lines[0] == lines[1] == [[-1, 0, 1]]:
            return self.add(SQUARE, 1, (source, 1, 1))
        for upright, steps in lines.items():
            radius = sum(step[-1] for step in steps)
            if 1 < radius <= LONGEST:
                source = self.add(DOWN if upright else ACROSS, radius, (source, radius * upright, radius * upright))
                continue
            for step in steps:
                reach = step[-1] * upright
                kinds = (DOWN3, DOWN5) if upright else (ACROSS3, ACROSS5)
                source = self.add(kinds[len(step) == 5], step[-1] - step[-2], (source, reach, reach))
        return source

    def opened(self, source: int, size: int, shape: str, corners: bool) -> int:
        """The steps of an opening."""
        from ._opening_kernels import CORNERS, MEDIAN

        low = self.eroded(source, size, shape)
        return self.eroded(self.add(CORNERS if corners else MEDIAN, 1, (low, 1, 1)), size, shape)

    def written(self, level: int, at_once: int) -> Steps:
        """What the compiled function takes."""
        from ._opening_kernels import ACROSS5, DOWN, DOWN3, DOWN5, INPUT

        total = len(self.steps)
        source, up, rows = np.zeros((3, total, 3), np.int64)
        behind, keep, widen = np.zeros(total, np.int64), np.full(total, at_once), np.zeros(total, np.int64)
        for n, (kind, reach, looks) in enumerate(self.steps):
            for k, (of, above, below) in enumerate(looks):
                source[n, k], up[n, k], rows[n, k] = of, above, above + at_once + below
                behind[n] = max(behind[n], behind[of] + below)
                if kind not in (INPUT, DOWN, DOWN3, DOWN5):
                    widen[of] = max(widen[of], 2 * reach if kind == ACROSS5 else reach)
        for n, (_, _, looks) in enumerate(self.steps):
            for of, above, _ in looks:
                keep[of] = max(keep[of], behind[n] - behind[of] + at_once + above)
        kinds, reach, sources = np.array([(kind, by, len(looks)) for kind, by, looks in self.steps], np.int64).T.copy()
        return Steps(kinds, reach, sources, source, up, rows, behind, keep, widen, level, at_once)


@lru_cache(maxsize=64)
def _steps(at_once: int, size: int, shape: str, corners: bool, detail: int = 0, alone: bool = False) -> Steps:
    """One opening, and the details beside it, or these alone; so many rows at a time."""
    from ._opening_kernels import INPUT, OUTLINES

    plan = _Plan()
    band = plan.add(INPUT, 0)
    base = -1 if alone else plan.opened(band, size, shape, corners)
    if detail:
        octagon = plan.opened(band, detail, "octagon", corners=True)
        guide = plan.opened(band, GUIDE, "square", corners=False)
        diamond = plan.opened(band, diamond_of(size), "diamond", corners=True)
        plan.add(OUTLINES, 1, (octagon, 1, 1), (guide, 0, 0), (diamond, 0, 0))
    return plan.written(base, at_once)


def rank_opening(band: Float32Array, size: int, *, shape: str = "square", corners: bool = False) -> Float32Array:
    """Take away what is brighter than its surroundings and smaller than an element.

    ``m = dilate_n(median_3(e)), e = erode_n(a)``, or with corners ``m = dilate_n(max(median_3(e), open_2(e)))``

    Parameters
    ----------
    band : (row, column) float32 ndarray
        Any unit; NaN is not valid.
    size : int
        n, odd [pixel].
    shape : {"square", "octagon", "diamond"}
        Of the element; of the width n.
    corners : bool
        The median takes no patch of 2 x 2 minima or more away: it would cut the corners off an object into which the
        element just fits, whose minima are a patch of a few pixels.

    Returns
    -------
    (row, column) float32 ndarray
        NaN where no pixel within reach is valid.

    Notes
    -----
    The median makes the opening blind to single dark pixels of noise (or of a pit) in the minima. Assumes that every
    patch of water as large as the element has a pixel without glint somewhere within reach: under heavier glint the
    level rises with it. Anything brighter than the water around it and narrower than n is taken for sparkle.

    Examples
    --------
    >>> import numpy as np
    >>> sea = np.ones((9, 9), np.float32)
    >>> sea[4, 4] = 7
    >>> float(rank_opening(sea, 3).max())
    1.0
    """
    steps = _steps(_at_once(band), _odd(size), shape, corners)
    missing = np.isnan(band)
    found = np.empty(band.shape, np.int32)
    if band.size:
        _run(np.where(missing, _NOTHING, _in_order(np.asarray(band, np.float32))), steps, None, (found, found[:0]))
    return np.where(found == -_NOTHING, np.float32(np.nan), _in_order(found).view(np.float32))


def _in_order(values: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
    """Whole numbers in the order of float32, or back: the bits, without the sign turned where that is set."""
    bits = np.ascontiguousarray(values).view(np.int32)
    return bits ^ ((bits >> 31) & np.int32(0x7FFFFFFF))


def openings(codes: Codes, size: int, detail: int = 0, *, within: Window, out: tuple[Codes | None, Codes]) -> None:
    """The opening by a square that keeps corners, and the brightest of other openings.

    Those are one by an octagon, grown back by one pixel under the opening by a square of 3, and one by a diamond as
    large as the square: outlines of objects, and clumps of sparkle.

    Parameters
    ----------
    codes : (row, column) int16 ndarray
        A band (`deglint.compensate.codes`).
    size, detail : int
        Of the square and of the octagon, odd [pixel]; a detail of 0 for the square alone.
    within : ((row0, row1), (col0, col1))
        Rows and columns that are wanted.
    out : two (row, column) int16 ndarrays
        Receive the opening, or None where it is not wanted, and the others; minus `deglint.compensate.codes.NOTHING`
        where no pixel within reach is valid.

    Notes
    -----
    Cost, one core: 3.3 ns a pixel for 13 and 13, 1.2 ns for the square alone (`python -m benchmarks stages`).
    """
    if codes.size:
        level, outline = out
        steps = _steps(_at_once(codes), _odd(size), "square", True, detail and _odd(detail), level is None)
        _run(codes, steps, within, (outline if level is None else level, outline))


def openings_of_pieces(
    codes: Codes, size: int, detail: int, corners: npt.NDArray[np.int64], side: int, *, within: Window, out: Codes
) -> None:
    """The others in squares of a window alone, which are laid out side by side with what they look at.

    Parameters
    ----------
    codes, size, detail, within
        As for `openings`.
    corners : (square, 2) int64 ndarray
        First row and column in the window.
    side : int
        Of each square [pixel].
    out : (row, column) int16 ndarray
        Receives them in the squares; the rest of the window is left as it is.
    """
    from ._opening_kernels import lay, pick

    halo, begin = opening_halo(size, detail), np.array([first for first, _last in within])
    wide = side + 2 * halo
    first = corners + begin - halo
    inside = np.all((first >= 0) & (first + wide <= codes.shape), axis=1)
    for row, column in (corners[~inside] + begin).tolist():  # at the band's edges, which count
        top, left = max(row - halo, 0), max(column - halo, 0)
        inner, (i, j) = ((row - top, row - top + side), (column - left, column - left + side)), (row, column) - begin
        around, found = codes[top : row + side + halo, left : column + side + halo], np.empty((side, side), np.int16)
        openings(around, size, detail, within=inner, out=(None, found))
        out[i : i + side, j : j + side] = found
    if inside.any():
        count = int(inside.sum())
        down = -(-count * wide // WIDTH)
        across = -(-count // down)
        laid = np.zeros((down * wide, across * wide), np.int16)
        found = np.empty_like(laid)
        lay(codes, first[inside], wide, laid)
        openings(laid, size, detail, within=((0, laid.shape[0]), (0, laid.shape[1])), out=(None, found))
        pick(found, corners[inside], halo, side, out)


def _at_once(band: npt.NDArray[Any]) -> int:
    return AT_ONCE[band.shape[1] <= NARROW]


def _odd(size: int) -> int:
    if size < 1 or size % 2 == 0:
        raise InputError(f"an element must have an odd size of 1 pixel or more, got {size}.")
    return size


def _run(values: npt.NDArray[Any], steps: Steps, within: Window | None, out: tuple[Any, Any]) -> None:
    from ._opening_kernels import run

    corner = (0, 0) if within is None else (within[0][0], within[1][0])
    run(np.ascontiguousarray(values), steps, corner, *out)
