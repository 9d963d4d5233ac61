"""Outlines of a mask along the edges of its pixels: rings that are closed and never touch themselves.

The edges of a part form closed walks. Where a walk meets a corner again, pixels touch at that corner only, and the walk
is cut there; so every ring is simple, and a part's outer ring is the only one with a positive area.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.bool_]
Ring = tuple[tuple[float, float], ...]


def polygons(footprint: Mask) -> list[list[list[tuple[int, int]]]]:
    """Outlines of a mask: for each 4-connected part its outer ring and its holes, of (column, row) corners.

    As the image is seen, rows downwards, outer rings run clockwise and holes the other way round.
    """
    import cv2

    count, parts = cv2.connectedComponents(np.asarray(footprint).astype(np.uint8), connectivity=4)
    out = []
    for part in range(1, count):
        rings = [ring for walk in _walks(parts == part) for ring in _simple(walk)]
        rings.sort(key=signed_area, reverse=True)  # the outer ring is the only one with a positive area
        out.append([_straightened(ring) for ring in rings])
    return out


def _walks(part: Mask) -> list[list[tuple[int, int]]]:
    """Closed walks along the edges of a part, its pixels always at the same hand."""
    p = np.pad(part, 1)
    inner = p[1:-1, 1:-1]
    steps: dict[tuple[int, int], list[tuple[int, int]]] = {}
    sides = (
        (inner & ~p[:-2, 1:-1], (0, 0), (1, 0)),  # upper edges, to the right
        (inner & ~p[1:-1, 2:], (1, 0), (1, 1)),  # right edges, downwards
        (inner & ~p[2:, 1:-1], (1, 1), (0, 1)),  # lower edges, to the left
        (inner & ~p[1:-1, :-2], (0, 1), (0, 0)),  # left edges, upwards
    )
    for edges, start, end in sides:
        for r, c in np.argwhere(edges).tolist():
            steps.setdefault((c + start[0], r + start[1]), []).append((c + end[0], r + end[1]))
    walks = []
    while steps:
        first = next(iter(steps))
        walk, at = [first], first
        while at in steps:
            onward = steps[at]
            at_next = onward.pop()
            if not onward:
                del steps[at]
            at = at_next
            walk.append(at)
        walks.append(walk)
    return walks


def _simple(walk: list[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """A closed walk cut into rings that meet no corner twice."""
    rings: list[list[tuple[int, int]]] = []
    path: list[tuple[int, int]] = []
    seen: dict[tuple[int, int], int] = {}
    for corner in walk:
        if corner in seen:
            start = seen[corner]
            rings.append([*path[start:], corner])
            for gone in path[start + 1 :]:
                del seen[gone]
            del path[start + 1 :]
        else:
            seen[corner] = len(path)
            path.append(corner)
    return rings


def signed_area(ring: Sequence[tuple[int, int]]) -> int:
    """Twice the area, positive clockwise as the image is seen (rows downwards)."""
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring))


def _straightened(ring: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """A closed ring without the corners that lie on a straight edge."""
    corners = ring[:-1]
    kept = [
        corner
        for i, corner in enumerate(corners)
        if not (corners[i - 1][0] == corner[0] == corners[(i + 1) % len(corners)][0])
        and not (corners[i - 1][1] == corner[1] == corners[(i + 1) % len(corners)][1])
    ]
    return [*kept, kept[0]]
