"""Points with their names on two axes as inline SVG, and the line through those that no other beats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from .svg import COLOURS, WIDE, Axis, Size, _Field, _frame

_LETTER, _LINE = 6.4, 14.0
"""Width and height of a letter in a label, in the units of the plot."""


def scatter(
    points: Mapping[str, tuple[float, float]], x: Axis, y: Axis, *, title: str, line: Sequence[str] = (),
    named: Sequence[str] = (), marked: Sequence[str] = (), size: Size = WIDE,
) -> str:  # fmt: skip
    """A plot as an SVG element.

    Parameters
    ----------
    points : dict of (x, y)
        By name, which shows where the pointer rests.
    x, y : Axis
    title : str
        Said to readers who do not see the plot.
    line : sequence of str
        Points that a stepped line joins, left to right.
    named : sequence of str
        Points whose names are written beside them, as far as there is room.
    marked : sequence of str
        Points drawn larger, as diamonds.
    size : Size
    """
    field = _Field(x, y, size)
    place = {name: tuple(float(v[0]) for v in field.place([p[0]], [p[1]])) for name, p in points.items()}
    parts = [_frame(field)]
    if line:
        steps = [place[n] for n in line]
        path = f"M{steps[0][0]:.1f} {field.top}V{steps[0][1]:.1f}" + "".join(f"H{a:.1f}V{b:.1f}" for a, b in steps[1:])
        parts.append(f'<path d="{path}H{field.right}" fill="none" stroke="{COLOURS[0]}" stroke-width="1.4" '
                     'stroke-dasharray="5 3"/>')  # fmt: skip
    for name, (px, py) in place.items():
        said = f"<title>{escape(name)}</title>"
        if name in marked:
            parts.append(f'<path d="M{px:.1f} {py - 8:.1f}l8 8l-8 8l-8 -8Z" fill="{COLOURS[1]}">{said}</path>')
        else:
            ink = COLOURS[0] if name in line else "#9a9a9a"
            parts.append(f'<circle cx="{px:.1f}" cy="{py:.1f}" r="4" fill="{ink}">{said}</circle>')
    parts += _labels(place, [n for n in (*marked, *named) if n in place], field)
    return (f'<svg viewBox="0 0 {size.width} {size.height}" role="img" aria-label="{escape(title, quote=True)}">'
            f'{"".join(parts)}</svg>')  # fmt: skip


def _labels(place: Mapping[str, tuple[float, ...]], names: Sequence[str], field: _Field) -> list[str]:
    """Names beside their points, each at the first of some places where it covers no point and no other name."""
    taken = [(px - 5, py - 5, px + 5, py + 5) for px, py in place.values()]
    out = []
    for name in dict.fromkeys(names):
        px, py = place[name]
        wide = _LETTER * len(name)
        spots = [(px + 9 + dx, py + dy) for dy in (-10, 14, -24, 28, -38, 42, 4) for dx in (0, 12)]
        spots += [(px - 9 - wide - dx, py + dy) for dy in (-10, 14, -24, 28, -38, 42, 4) for dx in (0, 12)]
        for left, base in spots:
            box = (left, base - _LINE + 3, left + wide, base + 3)
            inside = left > 64 and box[2] < field.right and box[1] > field.top and box[3] < field.bottom
            if inside and not any(_meet(box, other) for other in taken):
                taken.append(box)
                edge = left if left > px else left + wide
                out.append(f'<path d="M{px:.1f} {py:.1f}L{edge:.1f} {base - 4:.1f}" stroke="#bbb" fill="none"/>'
                           f'<text x="{left:.1f}" y="{base:.1f}" font-size="12">{escape(name)}</text>')  # fmt: skip
                break
    return out


def _meet(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
