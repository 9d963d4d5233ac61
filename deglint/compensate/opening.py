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

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..scene import Window
from .codes import NOTHING, Codes
from .state import Float32Array

Point = tuple[int, int]
"""Rows down and columns right."""
Ints = npt.NDArray[np.int64]

GUIDE = 3
"""Element under whose opening a detail may grow back [pixel]."""
_NOTHING = np.finfo(np.float32).max
_PATCH = ((0, 0), (0, 1), (0, 0), (1, 0), (1, 1))


class Steps(NamedTuple):
    """Steps in order, as `deglint.compensate._opening_kernels.run` takes them.

    kind, points : (step,), what it does and with how many pixels; source, down, right : (step, point), of which step,
    and where; behind : (step,), rows after the input; keep : (step,), rows that are kept; widen : (step,), columns
    that are repeated beyond the edges; level : the step that is the level
    """

    kind: Ints
    points: Ints
    source: Ints
    down: Ints
    right: Ints
    behind: Ints
    keep: Ints
    widen: Ints
    level: int


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


@dataclass
class _Plan:
    """Steps as they are written down; one that is there already is not written again."""

    steps: list[tuple[int, tuple[tuple[int, Point], ...]]] = field(default_factory=list)

    def add(self, kind: int, *looks: tuple[int, Point]) -> int:
        """A step that looks at these pixels of earlier ones."""
        if (kind, looks) not in self.steps:
            self.steps.append((kind, looks))
        return self.steps.index((kind, looks))

    def eroded(self, source: int, size: int, shape: str) -> int:
        """The steps of an element."""
        from ._opening_kernels import LEAST

        for element in elements(size, shape):
            source = self.add(LEAST, *((source, point) for point in element))
        return source

    def opened(self, source: int, size: int, shape: str, corners: bool) -> int:
        """The steps of an opening."""
        from ._opening_kernels import CORNERS, LEAST, MEDIAN

        low = self.eroded(source, size, shape)
        rows = [(low, (down, 0)) for down in (-1, 0, 1)]
        if not corners:
            return self.eroded(self.add(MEDIAN, *rows), size, shape)
        patch = self.add(LEAST, *((low, point) for point in _PATCH))
        return self.eroded(self.add(CORNERS, *rows, (patch, (-1, 0)), (patch, (0, 0))), size, shape)

    def written(self, level: int) -> Steps:
        """What the compiled function takes."""
        from ._opening_kernels import LEAST

        count, most = len(self.steps), max(len(looks) for _, looks in self.steps)
        source, down, right = np.zeros((3, count, max(most, 1)), np.int64)
        behind, keep, widen = np.zeros(count, np.int64), np.ones(count, np.int64), np.zeros(count, np.int64)
        for n, (kind, looks) in enumerate(self.steps):
            for k, (of, (below, beside)) in enumerate(looks):
                source[n, k], down[n, k], right[n, k] = of, below, beside
                behind[n] = max(behind[n], behind[of] + max(below, 0))
                widen[of] = max(widen[of], abs(beside) if kind == LEAST else 1)
        for n, (_, looks) in enumerate(self.steps):
            for of, (below, _) in looks:
                keep[of] = max(keep[of], behind[n] - behind[of] - below + 1)
        kinds, points = (np.array(v, np.int64) for v in zip(*((k, len(at)) for k, at in self.steps), strict=True))
        return Steps(kinds, points, source, down, right, behind, keep, widen, level)


@lru_cache(maxsize=64)
def _steps(size: int, shape: str, corners: bool, detail: int = 0) -> Steps:
    """One opening, and the details beside it."""
    from ._opening_kernels import INPUT, OUTLINES

    plan = _Plan()
    band = plan.add(INPUT)
    base = plan.opened(band, size, shape, corners)
    if detail:
        octagon = plan.opened(band, detail, "octagon", corners=True)
        guide = plan.opened(band, GUIDE, "square", corners=False)
        diamond = plan.opened(band, diamond_of(size), "diamond", corners=True)
        around = [(octagon, (down, 0)) for down in (-1, 0, 1)]
        plan.add(OUTLINES, *around, (guide, (0, 0)), (diamond, (0, 0)))
    return plan.written(base)


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
    Cost, one core: 1.5 ns a pixel for a square of 13.

    Examples
    --------
    >>> import numpy as np
    >>> sea = np.ones((9, 9), np.float32)
    >>> sea[4, 4] = 7
    >>> float(rank_opening(sea, 3).max())
    1.0
    """
    steps = _steps(_odd(size), shape, corners)
    missing = np.isnan(band)
    found = np.empty(band.shape, np.float32)
    if band.size:
        _run(np.where(missing, _NOTHING, band), _NOTHING, steps, None, (found, found[:0]))
    found[found == -_NOTHING] = np.nan
    return found


def openings(codes: Codes, size: int, detail: int = 0, *, within: Window, out: tuple[Codes, Codes]) -> None:
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
        Receive the opening and the others; minus `deglint.compensate.codes.NOTHING` where no pixel within reach is
        valid.

    Notes
    -----
    Cost, one core: 4 ns a pixel for 13 and 13, 1 ns for the square alone.
    """
    if codes.size:
        _run(codes, NOTHING, _steps(_odd(size), "square", True, detail and _odd(detail)), within, out)


def _odd(size: int) -> int:
    if size < 1 or size % 2 == 0:
        raise InputError(f"an element must have an odd size of 1 pixel or more, got {size}.")
    return size


def _run(values: Any, nothing: Any, steps: Steps, within: Window | None, out: tuple[Any, Any]) -> None:
    from ._opening_kernels import run

    corner = (0, 0) if within is None else (within[0][0], within[1][0])
    run(np.ascontiguousarray(values), nothing, steps, corner, *out)
