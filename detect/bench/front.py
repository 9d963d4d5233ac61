"""Which choices are worth their time: the Pareto front of two costs, and what dominates the rest."""

from __future__ import annotations

from collections.abc import Mapping

Point = tuple[float, float]
"""Two costs, such as time and error; less is better in both."""
SLACK = 1.20, 1.02
"""Times that a cost must be larger to count as larger: times vary from run to run by more than errors do."""


def front(points: Mapping[str, Point]) -> list[str]:
    """Names of the points that no other beats in both costs, the cheapest first.

    Examples
    --------
    >>> front({"quick": (1, 9), "good": (5, 2), "neither": (6, 8)})
    ['quick', 'good']
    """
    found: list[str] = []
    for name in sorted(points, key=lambda n: points[n]):
        if not found or points[name][1] < points[found[-1]][1]:
            found.append(name)
    return found


def dominated(points: Mapping[str, Point], slack: Point = SLACK) -> dict[str, str]:
    """For each point that another beats beyond the slack, what beats it: of several, that with the least second cost.

    Beaten is what costs as much or more in both, and more than the slack in one.

    Examples
    --------
    >>> dominated({"quick": (1, 9), "good": (5, 2), "neither": (6, 8)})
    {'neither': 'good'}
    """
    out = {}
    for name, (x, y) in points.items():
        better = [
            (b, other) for other, (a, b) in points.items()
            if a <= x and b <= y and (a * slack[0] < x or b * slack[1] < y)
        ]  # fmt: skip
        if better:
            out[name] = min(better)[1]
    return out
