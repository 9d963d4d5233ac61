"""The parts of the page between its head and its end: plots, tables, pictures."""

from __future__ import annotations

import math
from html import escape
from typing import Any

import numpy as np

from . import pictures, svg, words
from .evaluate import Evaluation, Judged
from .pieces import table


def _legend(found: Evaluation) -> str:
    items = "".join(f"<span>{svg.key(i)}{escape(d.name)}</span>" for i, d in enumerate(found.detectors))
    return f'<div class="legend">{items}</div>'


def curves(found: Evaluation) -> str:
    """ROC curves, precision over recall, and objects found over false alarms."""
    low = 10.0 ** math.floor(math.log10(1 / len(found.detectors[0].roc.background)))
    x, y = svg.Axis("Pfa: background pixels detected", low, 1, log=True), svg.Axis("Pd: target pixels detected", 0, 1)
    grid = np.geomspace(low, 1, 100)
    series, precision = [], []
    for d in found.detectors:
        pfa, pd = svg.on_log(*d.roc.vertices, low)
        band = None if d.bands is None else (d.bands.pfa, d.bands.low, d.bands.high)
        if band is not None:  # to the left edge: no false alarm at all
            band = (np.append(low, band[0]), np.append(band[1][0], band[1]), np.append(band[2][0], band[2]))
        dots = tuple((p["pfa_designed"], p["pd"]) for p in d.numbers["operating_points"])
        series.append(svg.Series(d.name, pfa, pd, band, dots))
        p, r = d.roc.precision_recall
        precision.append(svg.Series(d.name, r, p))
    roc = svg.plot(series, x, y, title="ROC curves", chance=(grid, grid))
    recall, exact = svg.Axis("Pd (recall)", 0, 1), svg.Axis("Precision", 0, 1)
    shaded = ""
    if found.detectors[0].bands is not None:
        shaded = (
            f" Shaded: {found.detectors[0].bands.level:.0%} of bootstrap draws of objects and blocks, point by point."
        )
    out = (
        f"<h2>ROC curves</h2>{_legend(found)}<figure>{roc}<figcaption>Fraction of target pixels detected over the "
        "fraction of background pixels detected, on a logarithmic axis, as the threshold falls. Dotted: chance. "
        f"Rings: the operating points below.{shaded}</figcaption></figure>"
    )
    second = svg.plot(precision, recall, exact, title="Precision over recall", size=svg.HALF)
    told = "Precision, the fraction of detected pixels that are targets, over recall: how far to trust a detection."
    side = f"<figure>{second}<figcaption>{told}</figcaption></figure>"
    return out + f'<div class="pair">{side}{_object_plot(found)}</div>'


def _object_plot(found: Evaluation) -> str:
    curves = [(d.name, d.objects) for d in found.detectors if d.objects is not None]
    if not curves:
        return ""
    area = found.numbers["scene"]["area_km2"]
    most = max(10, max(int(c.false_alarms.max()) for _, c in curves))
    x = svg.Axis("False alarms in the scene (none is drawn at 0.5)", 0.5, most * 1.1, log=True)
    series = []
    for name, c in curves:
        cost = np.minimum.accumulate(c.false_alarms[::-1])[::-1]  # parts may run together as the threshold falls
        at = np.concatenate([[0.5], np.repeat(np.maximum(cost, 0.5), 2), [most * 1.1]])
        up = np.concatenate([[0, 0], np.repeat(c.pd, 2)])
        series.append(svg.Series(name, at, up))
    y = svg.Axis("Objects found", 0, 1)
    drawn = svg.plot(series, x, y, title="Objects found over false alarms", size=svg.HALF)
    per = f" The scene has {words.short(area)} km²." if area is not None else ""
    return (f"<figure>{drawn}<figcaption>Objects found over false alarms (connected parts that touch no object), for "
            f"pixel Pfa up to {found.request.pfa_max:g}.{per}</figcaption></figure>")  # fmt: skip


def areas(found: Evaluation) -> str:
    """Areas with their intervals, a detector a row."""
    rows = []
    for i, d in enumerate(found.detectors):
        n = d.numbers
        boot, delong, part = n["bootstrap"], n["delong"], n["partial_auc"]
        rows.append([
            svg.key(i) + escape(d.name), f"<b>{n['auc']:.4f}</b>",
            words.interval(boot["low"], boot["high"]) if boot else "&ndash;",
            words.interval(delong["low"], delong["high"]), f"{part['raw']:.5f}", f"{part['mcclish']:.4f}",
            f"{n['average_precision']:.4f}",
        ])  # fmt: skip
    top = f"{found.request.pfa_max:g}"
    head = ["Detector", "AUC", "bootstrap 95 %", "DeLong 95 %", f"partial AUC<br>to Pfa {top}",
            "McClish<br>(0.5 to 1)", "average<br>precision"]  # fmt: skip
    return (
        f"<h2>Areas</h2>{table(head, rows)}<p class=small>DeLong's interval takes every pixel as independent "
        "evidence, which pixels of one scene are not: as a rule it is too narrow. The bootstrap draws whole objects "
        "and blocks of background; of fewer than ten of either it cannot know how much they vary.</p>"
    )


def points(found: Evaluation) -> str:
    """What each detector does at round false-alarm rates."""
    out = ["<h2>Operating points</h2>"]
    for i, d in enumerate(found.detectors):
        rows = []
        counted = d.objects is not None
        per_area = counted and found.numbers["scene"]["area_km2"] is not None
        for p in d.numbers["operating_points"]:
            span = words.interval(p["pd_low"], p["pd_high"]) if p["pd_low"] is not None else "&ndash;"
            row = [words.rate(p["pfa_designed"]), words.rate(p["pfa"]), f"{p['threshold']:.6g}"]
            row += [f"<b>{p['pd']:.4f}</b>", span]
            if counted:
                row += [f"{p['objects_found']} of {p['objects']}", f"{p['false_alarms']:,}"]
            if per_area:
                row.append(words.short(p["false_alarms_per_km2"]))
            rows.append(row)
        head = ["Pfa requested", "Pfa observed", "threshold", "Pd", "bootstrap 95 %"]
        head += ["objects found", "false alarms"] if counted else []
        head += ["per km²"] if per_area else []
        out.append(f"<h3>{svg.key(i)}{escape(d.name)}</h3>{table(head, rows)}")
    return "".join(out)


def objects(found: Evaluation) -> str:
    """Every object, and by which detector it is found at which Pfa."""
    first = found.detectors[0].objects
    assert first is not None
    scored = [{o.number: o for o in d.objects.objects} for d in found.detectors if d.objects is not None]
    order = sorted(first.objects, key=lambda o: (min(s[o.number].pfa for s in scored), o.number))
    rows = []
    for o in order[: words.MOST_ROWS]:
        (row0, row1), (col0, col1) = o.bounds
        aside = f"<small>{o.left_out} not valid</small>" if o.left_out else ""
        row = [str(o.number), f"{o.size}{aside}", f"{(col0 + col1 - 1) / 2:g}, {(row0 + row1 - 1) / 2:g}"]
        for s, d in zip(scored, found.detectors, strict=True):
            own = s[o.number]
            first_at = _first_pfa(own.pfa, len(d.roc.background))
            row.append(f'{first_at} <small class="in">{_signed(own.score_max, found):.5g}</small>')
        rows.append(row)
    head = ["Object", "pixels", "column, row"]
    head += [f'<span class="who">{svg.key(i)}<br>{escape(d.name)}</span>' for i, d in enumerate(found.detectors)]
    more = len(order) - len(rows)
    aside = f"<p class=small>{more} more are in the JSON beside this page.</p>" if more > 0 else ""
    return (
        f"<h2>Objects</h2><p>An object counts as found when one of its pixels is. For each detector: the least pixel "
        f"false-alarm rate at which that happens, and the object's highest score.</p>{table(head, rows)}{aside}"
    )


def _first_pfa(pfa: float, background: int) -> str:
    return f"below {words.rate(1 / background)}" if pfa == 0 else words.rate(pfa)


def _signed(value: float, found: Evaluation) -> float:
    return -value if found.request.lower else value


def compared(found: Evaluation) -> str:
    """Differences of areas, a pair of detectors a row."""
    rows = []
    for c in found.numbers["comparisons"]:
        low, high = c["bootstrap_low"], c["bootstrap_high"]
        rows.append([
            f"{escape(c['first'])} less {escape(c['second'])}", f"<b>{words.signed(c['difference'])}</b>",
            words.interval(low, high, "+.4f") if low is not None else "&ndash;",
            words.interval(c["low"], c["high"], "+.4f"), words.p_value(c["p"]),
        ])  # fmt: skip
    head = ["Difference of AUC", "", "bootstrap 95 %", "DeLong 95 %", "DeLong p"]
    return (
        f"<h2>Detectors compared</h2>{table(head, rows)}<p class=small>On the same pixels. The bootstrap draws the "
        "same objects and blocks for both; an interval that holds 0 tells no difference. DeLong's p is too small where "
        "pixels are not independent.</p>"
    )


def places(found: Evaluation) -> str:
    """Pictures of the scores, with objects and the worst false alarms."""
    out = ["<h2>Where</h2>"]
    sign = -1.0 if found.request.lower else 1.0
    for i, d in enumerate(found.detectors):
        seen, step = pictures.shrink(d.scores, found.inputs.valid)
        limits = pictures.stretch(seen)
        scored = _scored(d)
        drawn = pictures.overview(seen, step, d.scores.shape, limits, scored, d.worst)
        level = words.rate(_level(d))
        hits = sum(hit for _, hit in scored)
        boxes = f" White boxes: objects; dashed where not found at Pfa {level} ({hits} of {len(scored)} found)."
        looks = "".join(_chip(n, d, found, limits) for n in range(len(d.worst)))
        side = f'<div class="chips">{looks}</div>' if looks else f"<p>No false alarm at Pfa {level}.</p>"
        out.append(
            f'<h3>{svg.key(i)}{escape(d.name)}</h3><div class="look"><figure>{drawn}<figcaption>Scores'
            f"{pictures.colour_bar(limits, sign)}<br>{boxes if scored else ''} Rings: the highest false alarms at Pfa "
            f"{level}; close looks at them, outlined, give column and row.</figcaption></figure>{side}</div>"
        )
    return "".join(out)


def _chip(n: int, d: Judged, found: Evaluation, limits: tuple[float, float]) -> str:
    """The n-th false alarm seen close."""
    alarm, said = d.worst[n], d.numbers["worst_false_alarms"][n]
    drawn = pictures.chip(d.scores, found.inputs.valid, limits, alarm, found.inputs.objects)
    size = f"{alarm.size} pixel{'s' if alarm.size > 1 else ''}"
    return (
        f"<figure>{drawn}<figcaption><b>{n + 1}</b> &middot; score {said['score_max']:.5g}<br>{size} at "
        f"{said['column']:.0f}, {said['row']:.0f}</figcaption></figure>"
    )


def _level(d: Judged) -> float:
    """The Pfa at which false alarms are shown."""
    background = d.roc.background
    return float(len(background) - np.searchsorted(background, d.worst_threshold, "right")) / len(background)


def _scored(d: Judged) -> list[tuple[Any, bool]]:
    if d.objects is None:
        return []
    return [(o, o.size > 0 and o.score_max > d.worst_threshold) for o in d.objects.objects]


def three_d(found: Evaluation) -> str:
    """Chang's measures, a detector a row."""
    rows = []
    for i, d in enumerate(found.detectors):
        t = d.numbers["three_d"]
        rows.append([svg.key(i) + escape(d.name), *(f"{d.numbers['auc']:.4f}" if k == "auc" else words.short(t[k])
                     for k in ("auc", "d_tau", "f_tau", "td", "bs", "tdbs", "od", "snpr"))])  # fmt: skip
    head = ["Detector", "AUC(D,F)", "AUC(D,&tau;)", "AUC(F,&tau;)", "TD", "BS", "TDBS", "OD", "SNPR"]
    return (
        f"<h2>3-D ROC measures</h2>{table(head, rows)}<p class=small>Chang (2021), doi:10.1109/TGRS.2020.3021671; "
        "exact areas over scores brought to 0&ndash;1. They rest on the scene's extreme scores: compare detectors of "
        "one scene by them, not scenes.</p>"
    )
