"""A table of numbers as colours, as inline SVG: what is good is pale, what is bad stands out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

_CELL_WIDTH, _CELL_HEIGHT, _LEFT, _TOP = 25, 19, 300, 150


def shade(share: float) -> str:
    """Colour of 0 (dark red) to 1 (nearly white): lightness alone tells them apart, too."""
    share = min(max(share, 0.0), 1.0)
    ends = ((122, 22, 28), (230, 120, 60), (247, 247, 242))
    low, high, at = (*ends[:2], 2 * share) if share < 0.5 else (*ends[1:], 2 * share - 1)
    return "#" + "".join(f"{round(a + (b - a) * at):02x}" for a, b in zip(low, high, strict=True))


def heat(
    rows: Sequence[str],
    columns: Sequence[str],
    values: Mapping[tuple[str, str], float | str],
    *,
    most: float,
    title: str,
) -> str:
    """A heat map with its numbers as an SVG element.

    Parameters
    ----------
    rows, columns : sequence of str
    values : mapping of (row, column)
        Numbers from 0 to `most`, printed without decimals (downwards); or one letter. What is not there stays empty.
    most : float
        The best.
    title : str
        Said to readers who do not see it.
    """
    left = max(_LEFT, round(7.4 * max(map(len, rows), default=0)) + 12)
    width, height = left + _CELL_WIDTH * len(columns) + 90, _TOP + _CELL_HEIGHT * len(rows) + 8
    parts = []
    for j, name in enumerate(columns):
        x = left + _CELL_WIDTH * (j + 0.5) + 4
        parts.append(f'<text transform="translate({x:g} {_TOP - 7}) rotate(-60)">{escape(name)}</text>')
    for i, name in enumerate(rows):
        y = _TOP + _CELL_HEIGHT * i
        parts.append(f'<text x="{left - 8}" y="{y + 14}" text-anchor="end">{escape(name)}</text>')
        for j, column in enumerate(columns):
            if (name, column) in values:
                parts.append(_cell(values[name, column], most, left + _CELL_WIDTH * j, y, f"{name}, {column}"))
    said = escape(title, quote=True)
    return f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{said}">{"".join(parts)}</svg>'


def _cell(value: float | str, most: float, x: int, y: int, name: str) -> str:
    if isinstance(value, str):
        fill, ink, text, said = "#d8dce2", "#333", value, value
    else:
        share = value / most
        fill, ink = shade(share), "#222" if share > 0.4 else "#fff"
        text, said = str(int(value)), f"{value:.1f}"
    return (
        f'<rect x="{x}" y="{y}" width="{_CELL_WIDTH - 1}" height="{_CELL_HEIGHT - 1}" fill="{fill}">'
        f"<title>{escape(name)}: {escape(said)}</title></rect>"
        f'<text x="{x + (_CELL_WIDTH - 1) / 2:g}" y="{y + 13}" text-anchor="middle" font-size="11" fill="{ink}">'
        f"{escape(text)}</text>"
    )
