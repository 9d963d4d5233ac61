"""Line plots as inline SVG: small, sharp in print, and of nothing but text.

Colours are those of Okabe and Ito, distinguished by most colour-blind readers; lines also differ in their dashes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
import numpy.typing as npt

Float64 = npt.NDArray[np.float64]
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B8860B", "#56B4E9", "#444444")
DASHES = ("", "9 4", "2.5 3", "11 4 2.5 4", "6 3 2.5 3 2.5 3", "15 5", "4 4")
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 16, 14, 52


@dataclass(frozen=True)
class Size:
    """Width and height of a plot, in the units of its letters (13 high)."""

    width: int
    height: int


WIDE, HALF = Size(960, 470), Size(480, 350)


@dataclass(frozen=True)
class Axis:
    """One axis of a plot."""

    label: str
    low: float
    high: float
    log: bool = False

    def at(self, values: npt.ArrayLike) -> Float64:
        """Fraction of the axis where values lie; what is outside is put on its ends."""
        v = np.clip(np.asarray(values, np.float64), self.low, self.high)
        if self.log:
            return np.asarray(np.log(v / self.low) / math.log(self.high / self.low))
        return np.asarray((v - self.low) / (self.high - self.low))

    def ticks(self) -> tuple[list[float], list[float]]:
        """Values with a number, and values with a faint line only."""
        if not self.log:
            step = _nice((self.high - self.low) / 5)
            first = math.ceil(self.low / step - 1e-9)
            return [i * step for i in range(first, math.floor(self.high / step + 1e-9) + 1)], []
        decades = range(math.floor(math.log10(self.low) + 1e-9), math.ceil(math.log10(self.high) - 1e-9) + 1)
        inside = [10.0**d for d in decades if self.low * (1 - 1e-9) <= 10.0**d <= self.high * (1 + 1e-9)]
        if len(inside) < 3:  # a decade or two: 1, 2 and 5 of each, or numbers at even steps within less than that
            return self._few(decades)
        every = max(1, -(-len(inside) // 8))
        minor = [m * 10.0**d for d in decades for m in range(2, 10) if self.low < m * 10.0**d < self.high]
        return inside[::-1][::every][::-1], minor if len(inside) <= 8 else []

    def _few(self, decades: range) -> tuple[list[float], list[float]]:
        """Ticks of a logarithmic axis that is short."""
        every = [float(f"{m}e{d}") for d in decades for m in range(1, 10) if self.low <= float(f"{m}e{d}") <= self.high]
        round_ones = [v for v in every if f"{v:e}"[0] in "125"]
        if len(round_ones) >= 3:
            return round_ones, [v for v in every if v not in round_ones]
        step = _nice((self.high - self.low) / 4)
        return [i * step for i in range(math.ceil(self.low / step), math.floor(self.high / step + 1e-9) + 1)], []


@dataclass(frozen=True, eq=False)
class Series:
    """A line of a plot, with a band around it and points on it where they are known."""

    name: str
    x: Float64
    y: Float64
    band: tuple[Float64, Float64, Float64] | None = None
    dots: tuple[tuple[float, float], ...] = ()


def plot(
    series: Sequence[Series], x: Axis, y: Axis, *, title: str, size: Size = WIDE,
    chance: tuple[Float64, Float64] | None = None,
) -> str:  # fmt: skip
    """A plot as an SVG element.

    Parameters
    ----------
    series : sequence of Series
    x, y : Axis
    title : str
        Said to readers who do not see the plot.
    size : Size
    chance : (x, y), optional
        A faint line to compare with.
    """
    field = _Field(x, y, size)
    parts = [_frame(field)]
    if chance is not None:
        parts.append(f'<path d="{field.path(*chance)}" fill="none" stroke="#888" stroke-dasharray="1 4"/>')
    for i, one in enumerate(series):
        if one.band is not None:
            at, low, high = one.band
            edge = field.path(np.concatenate([at, at[::-1]]), np.concatenate([low, high[::-1]]))
            parts.append(f'<path d="{edge}Z" fill="{colour(i)}" fill-opacity=".13"/>')
    for i, one in reversed(list(enumerate(series))):  # the first lies on top
        dash = f' stroke-dasharray="{dashes(i)}"' if dashes(i) else ""
        parts.append(f'<path d="{field.path(one.x, one.y)}" fill="none" stroke="{colour(i)}" stroke-width="2.2" '
                     f'stroke-linejoin="round"{dash}><title>{escape(one.name)}</title></path>')  # fmt: skip
        for cx, cy in zip(*field.place([p[0] for p in one.dots], [p[1] for p in one.dots]), strict=True):
            parts.append(f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="3.6" fill="#fff" stroke="{colour(i)}" '
                         'stroke-width="1.8"/>')  # fmt: skip
    said = escape(title, quote=True)
    return f'<svg viewBox="0 0 {size.width} {size.height}" role="img" aria-label="{said}">{"".join(parts)}</svg>'


def key(i: int) -> str:
    """A short piece of the line of series i, for a legend or a table."""
    dash = f' stroke-dasharray="{dashes(i)}"' if dashes(i) else ""
    return (f'<svg class="key" viewBox="0 0 34 10" aria-hidden="true"><path d="M1 5H33" fill="none" '
            f'stroke="{colour(i)}" stroke-width="2.6"{dash}/></svg>')  # fmt: skip


def colour(i: int) -> str:
    """Colour of series i."""
    return COLOURS[i % len(COLOURS)]


def dashes(i: int) -> str:
    """Dashes of series i; the second round of colours is dashed otherwise."""
    return DASHES[(i + i // len(COLOURS)) % len(DASHES)]


def on_log(x: Float64, y: Float64, low: float) -> tuple[Float64, Float64]:
    """A polyline with the corners that its slanting parts need on a logarithmic axis, where they are bent."""
    xs, ys = [x[:1]], [y[:1]]
    for i in range(len(x) - 1):
        start, end = max(x[i], low), x[i + 1]
        if y[i + 1] > y[i] + 2e-3 and end > start * 1.02:
            between = np.geomspace(start, end, 24)
            xs.append(between)
            ys.append(np.interp(between, x[i : i + 2], y[i : i + 2]))
        else:
            xs.append(x[i + 1 : i + 2])
            ys.append(y[i + 1 : i + 2])
    return np.concatenate(xs), np.concatenate(ys)


@dataclass(frozen=True)
class _Field:
    """Where a plot's axes lie on the paper."""

    x: Axis
    y: Axis
    size: Size

    @property
    def top(self) -> int:
        return _TOP

    @property
    def right(self) -> int:
        return self.size.width - _RIGHT

    @property
    def bottom(self) -> int:
        return self.size.height - _BOTTOM

    def place(self, xs: npt.ArrayLike, ys: npt.ArrayLike) -> tuple[Float64, Float64]:
        """Points on the paper."""
        return (
            _LEFT + self.x.at(xs) * (self.right - _LEFT),
            self.bottom - self.y.at(ys) * (self.bottom - self.top),
        )

    def path(self, xs: npt.ArrayLike, ys: npt.ArrayLike) -> str:
        """Path data, without the points that fall on one another at the size they are seen in."""
        px, py = (np.round(p, 1) for p in self.place(xs, ys))
        keep = np.ones(len(px), np.bool_)
        keep[1:] = (np.diff(px) != 0) | (np.diff(py) != 0)
        px, py = px[keep], py[keep]
        if len(px) > 2:  # what lies between two others on a horizontal or vertical line
            level = ((py[1:-1] == py[:-2]) & (py[1:-1] == py[2:])) | ((px[1:-1] == px[:-2]) & (px[1:-1] == px[2:]))
            kept = np.concatenate([[True], ~level, [True]])
            px, py = px[kept], py[kept]
        return "M" + "L".join(f"{a:g} {b:g}" for a, b in zip(px, py, strict=True))


def _frame(field: _Field) -> str:
    """Axes with their lines, numbers and names."""
    right, bottom, top = field.right, field.bottom, field.top
    lines, numbers = [], []
    for axis, across in ((field.x, False), (field.y, True)):
        major, minor = axis.ticks()
        for values, ink in ((minor, "#f0f0f0"), (major, "#d9d9d9")):
            for v in values:
                at = field.place(field.x.low, v)[1] if across else field.place(v, field.y.low)[0]
                way = f"M{_LEFT} {at:.1f}H{right}" if across else f"M{at:.1f} {top}V{bottom}"
                lines.append(f'<path d="{way}" stroke="{ink}"/>')
        for v in major:
            px, py = field.place(field.x.low, v) if across else field.place(v, field.y.low)
            spot = f'x="{_LEFT - 9}" y="{py + 4.5:.1f}" text-anchor="end"' if across else (
                f'x="{px:.1f}" y="{bottom + 19}" text-anchor="middle"')  # fmt: skip
            numbers.append(f"<text {spot}>{_number(v, axis.log)}</text>")
    box = f'<rect x="{_LEFT}" y="{top}" width="{right - _LEFT}" height="{bottom - top}" fill="none" stroke="#555"/>'
    below = f'x="{(_LEFT + right) / 2:.0f}" y="{field.bottom + _BOTTOM - 9}"'
    beside = f'transform="translate(17 {(top + bottom) / 2:.0f}) rotate(-90)"'
    names = "".join(f'<text class="name" {spot} text-anchor="middle">{escape(axis.label)}</text>'
                    for spot, axis in ((below, field.x), (beside, field.y)))  # fmt: skip
    return "".join(lines) + box + "".join(numbers) + names


def _number(value: float, log: bool) -> str:
    if not log or 1e-3 < value < 1e4 or f"{value:e}"[0] != "1":
        return f"{value:g}"
    power = round(math.log10(value))
    sign = "&minus;" if power < 0 else ""
    return f'10<tspan dy="-5" font-size="10">{sign}{abs(power)}</tspan>'


def _nice(step: float) -> float:
    """A round step near a value."""
    unit = 10.0 ** math.floor(math.log10(step))
    return min((1, 2, 2.5, 5, 10), key=lambda m: abs(m * unit - step)) * unit
