"""The report as one HTML page: plots by matplotlib, page by jinja2; no script, and nothing is fetched."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..report.page import render
from ..report.plots import as_uri
from .run import DEFAULT, GRID, LIMIT, RAW, Results
from .scenes import REFLECTANCES
from .tables import named, tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURE_WIDTH, HEIGHT = 9.0, 4.2
"""Size of a figure [inch]."""


def page(results: Results, made: Mapping[str, Any]) -> str:
    """The whole page; `made` is the machine, versions and command of the run."""
    drawn = [
        ("Error against wind", against_wind(results)) if len(results.effort.winds) > 1 else None,
        ("Run time against error", time_against_error(results)),
        ("ROC curves of submerged objects", roc_curves(results)),
    ]
    plots = [(title, as_uri(figure)) for title, figure in filter(None, drawn)]
    return render("detect.bench", made=made, plots=plots, tables=tables(results), refused=results.refused)


def _axes(panels: int) -> tuple[Figure, list[Any]]:
    """A figure with panels side by side; drawn without a window or a global state."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(FIGURE_WIDTH, HEIGHT), layout="constrained")
    return figure, list(figure.subplots(1, panels, sharey=True, squeeze=False)[0])


def _style(name: str) -> dict[str, Any]:
    """Lines of the references are grey, the default is thick."""
    if name in (RAW, LIMIT):
        return {"color": "0.5", "linestyle": "--" if name == RAW else ":"}
    return {"linewidth": 3.0, "color": "black"} if name == DEFAULT else {}


def _with_legend(figure: Any, ax: Any) -> Figure:
    figure.legend(*ax.get_legend_handles_labels(), loc="outside right")
    return figure


def against_wind(results: Results) -> Figure:
    """Error against wind, a panel for each delay and a line for each removal."""
    effort = results.effort
    figure, panels = _axes(len(effort.delays))
    for ax, delay in zip(panels, effort.delays, strict=True):
        for name in (RAW, *results.used, LIMIT):
            found = [results.error((wind, delay), name) for wind in effort.winds]
            spread = [[max(n.value - n.low, 0) for n in found], [max(n.high - n.value, 0) for n in found]]
            ax.errorbar(effort.winds, [n.value for n in found], np.nan_to_num(spread), marker=".", label=name,
                        **_style(name))  # fmt: skip
        ax.set(yscale="log", xlabel="wind [m/s]", title=f"{1000 * delay:g} ms between bands")
    panels[0].set_ylabel("RMS error [% of the water level]")
    return _with_legend(figure, panels[0])


def time_against_error(results: Results) -> Figure:
    """Processor time of fit and apply against error; filled where no other removal is both quicker and better."""
    wind, _delay = results.effort.shown
    figure, panels = _axes(len(results.effort.delays))
    times = {name: 1e3 * (results.fit[name].value + results.apply[name].value) for name in results.used}
    for ax, delay in zip(panels, results.effort.delays, strict=True):
        errors = {name: results.error((wind, delay), name).value for name in results.used}
        for name, error in errors.items():
            beaten = any(times[n] < times[name] and errors[n] < error for n in results.used)
            ax.plot(times[name], error, "o", label=name, fillstyle="none" if beaten else "full", **_style(name))
        ax.set(xscale="log", yscale="log", xlabel="processor time of fit and apply [ms]",
               title=f"{named((wind, delay))} between bands")  # fmt: skip
    panels[0].set_ylabel("RMS error [% of the water level]")
    return _with_legend(figure, panels[0])


def roc_curves(results: Results) -> Figure:
    """Mean Pd against Pfa of the two darkest reflectances."""
    figure, panels = _axes(2)
    for kind, ax in enumerate(panels):
        for name in (RAW, *results.used, LIMIT):
            images = results.images[results.effort.shown, name]
            ax.plot(GRID, np.mean([image.curve[kind] for image in images], axis=0), label=name, **_style(name))
        ax.set(xscale="log", xlabel="Pfa", title=f"objects of {100 * REFLECTANCES[kind]:g} %")
    panels[0].set_ylabel("Pd")
    return _with_legend(figure, panels[0])
