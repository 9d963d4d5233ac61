"""The report of `rxdetect bench`: one HTML page with tables and matplotlib plots, without scripts or other files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..report.page import as_uri, new_figure, render
from .numbers import short
from .run import DEFAULT, GRID, LIMIT, PFA, RAW, Condition, Results
from .scenes import REFLECTANCES, SIDE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FIGURE_SIZE = (9.0, 4.2)  # width and height of a figure [inch]
_ERROR = "RMS error [% of the water level]"


def page(results: Results, made: Mapping[str, object]) -> str:
    """The complete report (HTML) of the results; `made` comes from `detect.bench.numbers.provenance`."""
    drawn = {"Run time against error": time_against_error, "ROC curves of submerged objects": roc_curves}
    if len(results.effort.winds) > 1:
        drawn = {"Error against wind": against_wind} | drawn
    plots = {title: as_uri(draw(results)) for title, draw in drawn.items()}
    return render("detect.bench", made=made, plots=plots, tables=tables(results), refused=results.refused)


def _style(name: str) -> dict[str, Any]:
    """matplotlib style of a removal's line: grey for raw image and noisy truth, thick and black for the default."""
    if name in (RAW, LIMIT):
        return {"color": "0.5", "linestyle": "--" if name == RAW else ":"}
    return {"linewidth": 3.0, "color": "black"} if name == DEFAULT else {}


def against_wind(results: Results) -> Figure:
    """Plot the error against the wind, with a panel for each delay between bands and a line for each removal."""
    effort = results.effort
    figure, panels = new_figure(*_FIGURE_SIZE, len(effort.delays))
    panels[0].set_ylabel(_ERROR)
    for ax, delay in zip(panels, effort.delays, strict=True):
        for name in (RAW, *results.used, LIMIT):
            found = [results.error((wind, delay), name) for wind in effort.winds]
            value, low, high = np.array([(n.value, n.low, n.high) for n in found]).T
            spread = np.nan_to_num(np.maximum([value - low, high - value], 0))
            ax.errorbar(effort.winds, value, spread, marker=".", label=name, **_style(name))
        ax.set(yscale="log", xlabel="wind [m/s]", title=f"{1000 * delay:g} ms between bands")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")
    return figure


def time_against_error(results: Results) -> Figure:
    """Plot error against processor time; a marker is filled if no other removal has both less time and less error."""
    wind, _delay = results.effort.shown
    figure, panels = new_figure(*_FIGURE_SIZE, len(results.effort.delays))
    panels[0].set_ylabel(_ERROR)
    times = {name: 1e3 * (results.fit[name].value + results.apply[name].value) for name in results.used}
    for ax, delay in zip(panels, results.effort.delays, strict=True):
        errors = {name: results.error((wind, delay), name).value for name in results.used}
        for name, error in errors.items():
            beaten = any(times[n] < times[name] and errors[n] < error for n in results.used)
            ax.plot(times[name], error, "o", label=name, fillstyle="none" if beaten else "full", **_style(name))
        ax.set(xscale="log", yscale="log")
        ax.set(xlabel="processor time of fit and apply [ms]", title=f"{named((wind, delay))} between bands")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")
    return figure


def roc_curves(results: Results) -> Figure:
    """Plot ROC curves (at `Effort.shown`) for the two lowest object reflectances: Pd, mean over seeds, against Pfa."""
    figure, panels = new_figure(*_FIGURE_SIZE, 2)
    panels[0].set_ylabel("Pd")
    for kind, ax in enumerate(panels):
        for name in (RAW, *results.used, LIMIT):
            images = results.images[results.effort.shown, name]
            ax.plot(GRID, np.mean([image.curve[kind] for image in images], axis=0), label=name, **_style(name))
        ax.set(xscale="log", xlabel="Pfa", title=f"objects of {100 * REFLECTANCES[kind]:g} %")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")
    return figure


@dataclass(frozen=True)
class Table:
    """A table of the report: title, column heads, rows of cells, and a note on how the numbers were measured."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str


def named(condition: Condition) -> str:
    """Text of a condition: wind [m/s] and delay between bands [ms]."""
    return f"{condition[0]:g} m/s, {1000 * condition[1]:g} ms"


def tables(results: Results) -> list[Table]:
    """All tables of the report."""
    return [overview(results), *([by_condition(results)] if len(results.conditions) > 1 else []), objects(results)]


def overview(results: Results) -> Table:
    """Table of error and processor time of the raw image, every removal and the noisy truth, at `Effort.shown`."""
    shown = results.effort.shown
    rows = []
    for name in (RAW, *results.effort.names, LIMIT):
        if name in results.refused:
            rows.append((name, *["refused"] * 4))
            continue
        errors = [str(results.error(shown, name, part)) for part in ("whole", "deep")]
        times = [short(1e3 * times[name].value) if name in times else "-" for times in (results.fit, results.apply)]
        rows.append((name, *errors, *times))
    side = results.effort.side
    note = (
        "Error: RMSE over the visible bands relative to the water level, mean over seeds and its 95 % interval. Time: "
        f"processor time on one thread, scene of 8 bands of {side} x {side} pixels, median of "
        f"{results.effort.rounds} runs. Methods run without compensation; default is deglint remove without options; "
        "noise only is the truth with the noise of the sensor."
    )
    head = ("removal", "error, whole scene [%]", "error, deep water [%]", "fit [ms]", "apply [ms]")
    return Table(f"Error and run time at {named(shown)} between bands", head, tuple(rows), note)


def by_condition(results: Results) -> Table:
    """Table of the error of the raw image, every removal and the noisy truth, in every condition (wind and delay)."""
    rows = [
        (name, *(short(results.error(condition, name).value) for condition in results.conditions))
        for name in (RAW, *results.used, LIMIT)
    ]
    head = ("removal", *map(named, results.conditions))
    note = f"Whole scene of {SIDE} x {SIDE} pixels, mean over {results.effort.seeds} seeds [% of the water level]."
    return Table("Error by wind and delay between bands", head, tuple(rows), note)


def objects(results: Results) -> Table:
    """Table of the share of objects found and the AUC, by removal and reflectance, in the condition `Effort.shown`."""
    shown = results.effort.shown
    rows = []
    for name in (RAW, *results.used, LIMIT):
        found = [f"{100 * results.rate(shown, name, kind, 'found').value:.0f}" for kind in range(len(REFLECTANCES))]
        auc = [f"{results.rate(shown, name, kind, 'auc').value:.3f}" for kind in range(len(REFLECTANCES))]
        rows.append((name, *found, *auc))
    kinds = [f"{100 * reflectance:g} %" for reflectance in REFLECTANCES]
    head = ("removal", *(f"found, {kind} [%]" for kind in kinds), *(f"AUC, {kind}" for kind in kinds))
    note = (
        f"Submerged squares of 4 m at a depth of 5 m, by reflectance. Global RX on the visible bands. An object is "
        f"found when one of its pixels exceeds the threshold at a pixel false-alarm rate of {PFA:g}. AUC is by pixels."
    )
    return Table(f"Objects found at {named(shown)} between bands", head, tuple(rows), note)
