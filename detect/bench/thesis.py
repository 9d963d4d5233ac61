"""Error against wind, band delay, method and compensation: chapter 6 of the thesis, remade on scenes with truth.

Figures 6.13, 6.14, 6.18, 6.19, 6.23 and 6.24 of Fink (2014), Glint Avoidance and Removal in the Maritime Environment,
Rochester Institute of Technology, with their intervals over seeds, and the same for two more methods.
"""

from __future__ import annotations

import numpy as np

from ..report.svg import Axis, Series, Size, plot
from . import chips, thesis_words
from .section import Cell, Effort, Figure, Number, Section, Table
from .thesis_measure import CHAINS, METHODS, Found, measure, numbers

WINDS, DELAYS = (2.0, 3.0, 5.0, 7.0, 9.0, 12.0), (0.0, 0.010, 0.020, 0.060)
QUICK_WINDS, QUICK_DELAYS = (2.0, 5.0, 9.0), (0.0, 0.060)
TITLES = {"raw": "No removal", "hedley": "Hedley", "lyzenga": "Lyzenga", "joyce": "Joyce", "multiband": "Multiband",
          "auto": "Automatic method"}  # fmt: skip
SAID = {"alone": "no compensation", "thesis-chain": "the thesis' chain", "compensated": "--compensate auto"}
PLOT = Size(480, 340)


def run(effort: Effort) -> Section:
    """Measure, and write the chapter."""
    winds, delays = (QUICK_WINDS, QUICK_DELAYS) if effort.quick else (WINDS, DELAYS)
    return section(measure(effort, winds, delays), effort.seeds)


def section(found: Found, seeds: int) -> Section:
    """The chapter of what was found."""
    return Section(
        "thesis",
        "Error against wind and band delay",
        thesis_words.opening(found, seeds),
        (_summary(found),),
        numbers=numbers(found),
        parts=tuple(_part(found, method) for method in METHODS),
        finding=thesis_words.finding(found),
    )


def _part(found: Found, method: str) -> Section:
    figures = [_against_wind(found, method, chain) for chain in CHAINS]
    if found.pictures:
        figures.append(_before_and_after(found, method))
    return Section(f"thesis/{method}", TITLES[method], thesis_words.of_method(found, method), (_table(found, method),),
                   tuple(figures))  # fmt: skip


def _cell(number: Number | None) -> Cell:
    return "-" if number is None else number


def _against_wind(found: Found, method: str, chain: str) -> Figure:
    """A line for each delay; the faint one is noise alone."""
    x = Axis("wind [m/s]", min(found.winds) - 0.5, max(found.winds) + 0.5)
    y = Axis("RMS error [% of water level]", 1.0, 1000.0, log=True)
    lines = []
    for delay in found.delays:
        known = [(w, n) for w in found.winds if (n := found.mean(w, delay, method, chain)) is not None]
        at, mean = np.array([w for w, _ in known]), np.array([n.value for _, n in known])
        low, high = (np.array([getattr(n, end) for _, n in known]) for end in ("low", "high"))
        band = None if np.isnan(low).any() else (at, low, high)
        lines.append(Series(f"{1000 * delay:g} ms", at, mean, band, tuple(zip(at, mean, strict=True))))
    noise = [n.value for w in found.winds if (n := found.mean(w, found.delays[0], "noise", "alone")) is not None]
    title = f"{TITLES[method]}, {SAID[chain]}"
    drawn = plot(lines, x, y, title=f"error against wind: {title}", size=PLOT, legend=True,
                 chance=(np.array(found.winds), np.array(noise)))  # fmt: skip
    return Figure(title, drawn, "A line a delay from band to band; shaded: 95 % interval; dotted: noise alone.")


def _before_and_after(found: Found, method: str) -> Figure:
    names = {
        "truth": "truth",
        "raw/alone": "what the sensor gives",
        f"{method}/alone": "removal alone",
        f"{method}/thesis-chain": "with the thesis' chain",
        f"{method}/compensated": "--compensate auto",
    }
    if method == "raw":
        names |= {"raw/alone": "what the sensor gives", "raw/thesis-chain": "the thesis' chain"}
    shown = [(name, found.pictures[key]) for key, name in names.items() if key in found.pictures]
    where = f"{found.shown:g} m/s, {1000 * max(found.delays):g} ms from band to band"
    return Figure(
        f"{TITLES[method]}, before and after: {where}",
        chips.strip(f"{TITLES[method]}: before and after", shown),
        f"Red, green and blue, all drawn alike: {chips.DRAWN}. The squares are objects of 2, 5, 10 and 20 %, from left "
        "to right, 5 m deep.",
    )


def _table(found: Found, method: str) -> Table:
    rows = [
        (f"{1000 * d:g} ms", SAID[c], *(_cell(found.mean(w, d, method, c)) for w in found.winds))
        for d in found.delays for c in CHAINS
    ]  # fmt: skip
    return Table.of(f"{TITLES[method]}: error by delay and compensation", _head(found, "compensation"), rows,
                    "Whole scene [% of the water level]: mean over seeds, and its 95 % interval.")  # fmt: skip


def _summary(found: Found) -> Table:
    """Every method at the wind that is shown, without delay and at the longest; deep water beside the whole."""
    ends = sorted({min(found.delays), max(found.delays)})
    rows: list[list[Cell]] = []
    for method in METHODS:
        for what, name in (("whole", "whole scene"), ("deep", "deep water")):
            cells = [_cell(found.mean(found.shown, d, method, c, what)) for d in ends for c in CHAINS]
            rows.append([TITLES[method], name, *cells])
    for what, name in (("whole", "whole scene"), ("deep", "deep water")):
        noise = [_cell(found.mean(found.shown, d, "noise", "alone", what)) for d in ends]
        rows.append(["Noise alone", name, *(cell for n in noise for cell in (n, "", ""))])
    note = "Error [% of the water level]: mean over seeds, and its 95 % interval. Deep water has no objects."
    if found.failed:
        note += f" -: could not be fitted in some scene ({len(found.failed)} of all combinations)."
    short = {"alone": "alone", "thesis-chain": "thesis' chain", "compensated": "auto"}
    head = ["method", "error of", *(f"{1000 * d:g} ms, {short[c]}" for d in ends for c in CHAINS)]
    return Table.of(f"Every method at {found.shown:g} m/s", head, rows, note)


def _head(found: Found, second: str) -> list[str]:
    return ["delay", second, *(f"{w:g} m/s" for w in found.winds)]
