"""The report as one HTML page, plots by matplotlib and page by jinja2: no script, nothing fetched, names escaped."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import numpy as np

from deglint.shown import shown

from . import plots, words
from .evaluate import Evaluation

Table = tuple[list[str], list[list[str]]]
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
        "detect.report", found=found, numbers=found.numbers, made=made, lead=words.lead(found.numbers),
        facts=_facts(found), plots=drawn, level=f"{bands.level:.0%}" if bands else "", areas=_areas(found),
        points=_points(found), compared=_compared(found) if len(found.detectors) > 1 else None, places=places,
        objects=None if objects is None else _objects(found), three_d=_three_d(found),
    )  # fmt: skip


def _facts(found: Evaluation) -> list[tuple[str, str]]:
    pixels, area = found.numbers["pixels"], found.numbers["scene"]["area_km2"]
    counts = [(f"{pixels['judged']:,}", "pixels judged"), (f"{pixels['targets']:,}", "target pixels"),
              (f"{pixels['objects']:,}", "objects in the truth"),
              (f"{pixels['total'] - pixels['judged']:,}", "pixels left out")]  # fmt: skip
    return counts if area is None else [*counts, (f"{area:.4g}", "km² judged")]


def _areas(found: Evaluation) -> Table:
    """Areas with their intervals, a detector a row."""
    head = ["detector", "AUC", "bootstrap 95 %", "DeLong 95 %", f"partial AUC to Pfa {found.request.pfa_max:g}",
            "McClish (0.5 to 1)", "average precision"]  # fmt: skip
    rows = []
    for n in (d.numbers for d in found.detectors):
        boot, delong, part = n["bootstrap"] or {}, n["delong"], n["partial_auc"]
        rows.append([n["name"], f"{n['auc']:.4f}", words.interval(boot.get("low"), boot.get("high")),
                     words.interval(delong["low"], delong["high"]), f"{part['raw']:.5f}", f"{part['mcclish']:.4f}",
                     f"{n['average_precision']:.4f}"])  # fmt: skip
    return head, rows


def _points(found: Evaluation) -> list[tuple[str, list[str], list[list[str]]]]:
    """What each detector does at round false-alarm rates."""
    counted = found.request.per_object
    per_area = counted and found.numbers["scene"]["area_km2"] is not None
    head = ["Pfa requested", "Pfa observed", "threshold", "Pd", "bootstrap 95 %"]
    head += ["objects found", "false alarms"] * counted + ["per km²"] * per_area
    out = []
    for d in found.detectors:
        rows = []
        for p in d.numbers["operating_points"]:
            row = [f"{p['pfa_designed']:.3g}", f"{p['pfa']:.3g}", f"{p['threshold']:.6g}", f"{p['pd']:.4f}",
                   words.interval(p["pd_low"], p["pd_high"])]  # fmt: skip
            if counted:
                row += [f"{p['objects_found']} of {p['objects']}", f"{p['false_alarms']:,}"]
            rows.append([*row, f"{p['false_alarms_per_km2']:.4g}"] if per_area else row)
        out.append((d.name, head, rows))
    return out


def _compared(found: Evaluation) -> Table:
    """Differences of areas, a pair of detectors a row."""
    rows = [
        [f"{c['first']} less {c['second']}", f"{c['difference']:+.4f}",
         words.interval(c["bootstrap_low"], c["bootstrap_high"], "+.4f"), words.interval(c["low"], c["high"], "+.4f"),
         "not known" if np.isnan(c["p"]) else f"{c['p']:.4f}"]
        for c in found.numbers["comparisons"]
    ]  # fmt: skip
    return ["difference of AUC", "", "bootstrap 95 %", "DeLong 95 %", "DeLong p"], rows


def _objects(found: Evaluation) -> Table:
    """Every object, and by which detector it is found at which Pfa."""
    sign = -1 if found.request.lower else 1
    scored = [{o.number: o for o in d.objects.objects} for d in found.detectors if d.objects is not None]
    order = sorted(scored[0].values(), key=lambda o: (min(s[o.number].pfa for s in scored), o.number))
    rows = []
    for o in order[:MOST_ROWS]:
        (row0, row1), (col0, col1) = o.bounds
        rows.append([str(o.number), str(o.size), f"{(col0 + col1 - 1) / 2:g}, {(row0 + row1 - 1) / 2:g}",
                     *(f"{s[o.number].pfa:.3g} ({sign * s[o.number].score_max:.5g})" for s in scored)])  # fmt: skip
    return ["object", "pixels", "column, row", *(d.name for d in found.detectors)], rows


def _three_d(found: Evaluation) -> Table:
    """Chang's measures, a detector a row."""
    keys = ("d_tau", "f_tau", "td", "bs", "tdbs", "od", "snpr")
    rows = [[d.name, f"{d.numbers['auc']:.4f}", *(f"{d.numbers['three_d'][k]:.4g}" for k in keys)]
            for d in found.detectors]  # fmt: skip
    return ["detector", "AUC(D,F)", "AUC(D,τ)", "AUC(F,τ)", "TD", "BS", "TDBS", "OD", "SNPR"], rows


def _level(d: Any) -> float:
    """The Pfa at which false alarms are shown."""
    background = d.roc.background
    return float(len(background) - np.searchsorted(background, d.worst_threshold, "right")) / len(background)
