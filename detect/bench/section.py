"""What an experiment gives: words, tables, plots, pictures, and every number by name."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import mean, stdev
from typing import Literal

Better = Literal["lower", "higher", ""]


@dataclass(frozen=True)
class Effort:
    """How much to do.

    Attributes
    ----------
    quick : bool
        Least of everything: all experiments together in under three minutes on two cores; else under thirty.
    seeds : int
        Scenes of each kind.
    directory : Path
        Where scratch files may go; removed by whoever made it.
    threads : int
        For what is not measured.
    peers : str
        Interpreter of an environment in which other programs are installed; "" for this one.
    """

    quick: bool
    seeds: int
    directory: Path
    threads: int = 2
    peers: str = ""


@dataclass(frozen=True)
class Number:
    """A measured number.

    Attributes
    ----------
    value : float
    unit : str
        "%", "s", "MB", "" ...
    low, high : float
        Interval of the mean over seeds, or the spread of repeated timings; NaN where there is one value only.
    better : {"lower", "higher", ""}
        Which way is better; "" where neither is.
    exact : bool
        The same for the same seeds and versions on any machine; false for times and memory.
    """

    value: float
    unit: str = ""
    low: float = math.nan
    high: float = math.nan
    better: Better = ""
    exact: bool = True

    def __str__(self) -> str:
        text = f"{self.value:.3g}"
        return text if math.isnan(self.low) else f"{text} ({self.low:.3g}-{self.high:.3g})"


def over_seeds(values: Sequence[float], unit: str = "", better: Better = "lower") -> Number:
    """Mean over seeds and its 95 % interval (Student's t)."""
    from scipy.stats import t

    centre = mean(values)
    if len(values) < 2:
        return Number(centre, unit, better=better)
    half = float(t.ppf(0.975, len(values) - 1)) * stdev(values) / math.sqrt(len(values))
    return Number(centre, unit, centre - half, centre + half, better)


def timed(values: Sequence[float], unit: str = "s", better: Better = "lower") -> Number:
    """Median of repeated timings (or ratios of paired ones) and their range."""
    ordered = sorted(values)
    middle = len(ordered) // 2
    centre = ordered[middle] if len(ordered) % 2 else 0.5 * (ordered[middle - 1] + ordered[middle])
    return Number(centre, unit, ordered[0], ordered[-1], better, exact=False)


Cell = str | float | int | Number


@dataclass(frozen=True)
class Table:
    """A table: its title, heads of columns, rows, and what is to be said of it."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        if any(len(row) > len(self.head) for row in self.rows):
            raise ValueError(f"table {self.title!r} has rows that are longer than its head of {len(self.head)}")

    @classmethod
    def of(cls, title: str, head: Iterable[str], rows: Iterable[Iterable[Cell]], note: str = "") -> Table:
        """From any sequences."""
        return cls(title, tuple(head), tuple(tuple(row) for row in rows), note)


@dataclass(frozen=True)
class Figure:
    """A plot or picture: an SVG element (pictures are PNG inside it, as data), and its caption."""

    title: str
    svg: str
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A chapter of the report.

    Attributes
    ----------
    name : str
        As in `--only`, and the first part of its numbers' names.
    title : str
    words : tuple of str
        Paragraphs of plain text: what was done, what it shows, where a method hurts. Figures in them are computed.
    tables : tuple of Table
    figures : tuple of Figure
    numbers : dict of Number
        By name, parts separated by "/": "thesis/wind09/delay60/joyce/compensated/rms".
    parts : tuple of Section
        Sub-chapters, with names of their own.
    finding : str
        A sentence or two for the head of the report: what it found, in computed figures.
    """

    name: str
    title: str
    words: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    numbers: dict[str, Number] = field(default_factory=dict)
    parts: tuple[Section, ...] = ()
    finding: str = ""

    def every_number(self) -> dict[str, Number]:
        """Its own and its parts' numbers."""
        found = dict(self.numbers)
        for part in self.parts:
            found |= part.every_number()
        return found
