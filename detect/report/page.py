"""The report as one HTML page, plots by matplotlib and page by jinja2: no script, nothing fetched, names escaped."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import numpy as np

from deglint.shown import shown

from . import plots, words
from .evaluate import Evaluation, Judged

MOST_ROWS = 200
"""Objects listed on the page."""


def render(package: str, **values: Any) -> str:
    """Fill the template `report.html.jinja` of a package, with the style that all pages share."""
    from jinja2 import Environment

    style = files("detect.report").joinpath("style.css").read_text(encoding="utf-8")
    template = files(package).joinpath("report.html.jinja").read_text(encoding="utf-8")
    return shown(Environment(autoescape=True).from_string(template).render(style=style, **values))


def page(found: Evaluation, made: Mapping[str, Any]) -> str:
    """The whole page; `made` says with what it was made, and is shown at the end as it stands."""
    bands, objects = found.detectors[0].bands, found.detectors[0].objects
    drawn = {"roc": plots.as_uri(plots.roc_curves(found)), "precision": plots.as_uri(plots.precision_curves(found))}
    if objects is not None:
        drawn["objects"] = plots.as_uri(plots.object_curves(found))
    places = [
        (d.name, plots.as_uri(plots.scene(d, found), "png"),
         plots.as_uri(plots.chips(d, found), "png") if d.worst else "", f"{_level(d):.3g}")
        for d in found.detectors
    ]  # fmt: skip
    return render(
        "detect.report", found=found, numbers=found.numbers, made=made, lead=words.lead(found.numbers), plots=drawn,
        interval=words.interval, level=f"{bands.level:.0%}" if bands else "", places=places,
        objects=None if objects is None else _objects(found),
    )  # fmt: skip


def _objects(found: Evaluation) -> tuple[list[str], list[list[str]]]:
    """Head and rows of a table: every object, and by which detector it is found at which Pfa."""
    sign = -1 if found.request.lower else 1
    scored = [{o.number: o for o in d.objects.objects} for d in found.detectors if d.objects is not None]
    order = sorted(scored[0].values(), key=lambda o: (min(s[o.number].pfa for s in scored), o.number))
    rows = []
    for o in order[:MOST_ROWS]:
        (row0, row1), (col0, col1) = o.bounds
        rows.append([str(o.number), str(o.size), f"{(col0 + col1 - 1) / 2:g}, {(row0 + row1 - 1) / 2:g}",
                     *(f"{s[o.number].pfa:.3g} ({sign * s[o.number].score_max:.5g})" for s in scored)])  # fmt: skip
    return ["object", "pixels", "column, row", *(d.name for d in found.detectors)], rows


def _level(d: Judged) -> float:
    """The Pfa at which false alarms are shown."""
    background = d.roc.background
    return float(len(background) - np.searchsorted(background, d.worst_threshold, "right")) / len(background)
