"""The report as one HTML page: no script, nothing fetched, every name escaped; it reads on paper, too."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from ..report import pieces, words
from .collect import Collected
from .section import Cell, Figure, Number, Section, Table

STYLE = """
nav ol{columns:2;column-gap:40px;padding-left:22px;margin:8px 0}
nav li{break-inside:avoid;margin:2px 0}nav a,a{color:#0b5394;text-decoration:none}nav a:hover{text-decoration:underline}
nav small{color:var(--soft);font-variant-numeric:tabular-nums}
h2{font-size:24px}h3{font-size:19px;margin-top:34px}h4{font-size:15px;margin:24px 0 4px}
td.t,th.t{text-align:left;white-space:normal}
td.t:not(:first-child),th.t:not(:first-child){padding-left:10px}
td small.span{font-size:12.5px}
td small.in{font-size:12.5px;min-width:6.6em;text-align:left;padding-left:8px}
.many table{font-size:12.5px}.many th{white-space:normal;font-size:11.5px}
.many th,.many td{padding:3px 6px 3px 0}
.many th:first-child,.many td:first-child{min-width:6em}
.three{grid-template-columns:repeat(auto-fit,minmax(290px,1fr));gap:18px}
figure h4{margin-top:10px}
@media print{nav ol{columns:2}h4{break-after:avoid}h2{margin:24px 0 6px;padding-top:8px;font-size:20px}
.facts{margin:12px 0 4px}.lead{font-size:15px}.facts div{padding:7px 16px}
.pair{gap:12px;grid-template-columns:1fr 1fr}
.three{grid-template-columns:1fr 1fr 1fr}figure>svg{max-height:320px}
.many table{font-size:7.5pt}.many th{font-size:7pt}}
@media(max-width:560px){nav ol{columns:1}}
"""
SMALL = 560
"""Figures no wider than this stand side by side."""
MOST_BESIDE = 4
"""Columns of numbers up to which intervals stand beside their values, not below."""

MANY = 8
"""Tables of more columns than this are set smaller."""

READING = """<p class="small">A figure with a range beside or below it is a mean over scenes of different seeds with its
95 % interval (Student's t), or the median of repeated timings and the range of them. Ratios of times are taken within
one round, in which everything ran once, so that a busy machine slows all alike. Figures that are not times or memory
come out the same again for the same seeds and versions, to rounding.</p>"""


def page(found: Collected, made: Mapping[str, Any]) -> str:
    """The whole page.

    Parameters
    ----------
    found : Collected
    made : mapping
        As `machine.provenance` gives it.
    """
    parts = [_head(found, made), _contents(found), _how(made), *(section(s) for s in found.sections)]
    return pieces.document(f"Benchmark of deglint, {made['date']}", parts, STYLE)


def _head(found: Collected, made: Mapping[str, Any]) -> str:
    effort = "quick run" if made["quick"] else "full run"
    findings = "".join(
        f'<li>{escape(s.finding)} <a href="#{anchor(s.name)}">{escape(s.title)}</a></li>'
        for s in found.sections
        if s.finding
    )
    lead = f'<ul class="findings">{findings}</ul>' if findings else ""
    counts = [
        (f"{len(found.sections)}", "experiments"),
        (f"{len(found.numbers()):,}", "numbers"),
        (f"{made['seeds']}", "seeds"),
        (duration(made["seconds"]), "to measure it all"),
    ]
    notes = [f"{escape(name)} failed, and is missing here: {escape(why)}" for name, why in found.failed.items()]
    if busy := _busy(made["machine"]):
        notes.append(escape(busy))
    note = '<div class="note"><ul>' + "".join(f"<li>{n}</li>" for n in notes) + "</ul></div>" if notes else ""
    sub = f"deglint {made['versions'].get('deglint', '')}, {made['date']}, {effort}"
    return f'<h1>Benchmark</h1><p class="sub">{escape(sub)}</p>{lead}{pieces.facts(counts)}{note}'


def _busy(machine: Mapping[str, Any]) -> str:
    """What is to be said of a machine that did other things, too."""
    load, cores = machine.get("load at the start"), machine["cores"]
    if load is None or load <= 0.5 * cores:
        return ""
    return f"The machine was busy when this started (load {load:g} on {cores} cores): trust ratios more than seconds."


def _contents(found: Collected) -> str:
    items = "".join(
        f'<li><a href="#{anchor(s.name)}">{escape(s.title)}</a> '
        f"<small>{escape(duration(found.seconds.get(s.name, 0)))}</small></li>"
        for s in found.sections
    )
    return f"<nav><h2>Contents</h2><ol>{items}</ol></nav>"


def _how(made: Mapping[str, Any]) -> str:
    machine = made["machine"]
    facts = {k: v for k, v in made.items() if k in ("command", "date", "seeds", "threads", "versions")}
    facts["machine"] = [
        f"{machine['processor']}, {machine['cores']} cores, {machine['memory']} memory, {machine['system']}",
        f"load {_load(machine, 'start')} at the start, {_load(machine, 'end')} at the end",
    ]
    return f'<h2 id="how">How this was made</h2>{pieces.made(facts)}{READING}'


def _load(machine: Mapping[str, Any], when: str) -> str:
    load = machine.get(f"load at the {when}")
    return "not known" if load is None else f"{load:g}"


def section(one: Section, level: int = 2) -> str:
    """A chapter, its tables and figures, and its sub-chapters."""
    heading = f'<h{level} id="{anchor(one.name)}">{escape(one.title)}</h{level}>'
    said = "".join(f"<p>{escape(text)}</p>" for text in one.words)
    own = said + figures(one.figures) + "".join(table(t) for t in one.tables)
    return heading + own + "".join(section(part, min(level + 1, 3)) for part in one.parts)


def figures(found: Sequence[Figure]) -> str:
    """Figures, small ones side by side."""
    out: list[str] = []
    side: list[str] = []
    for one in (*found, None):
        if one is not None and width(one.svg) <= SMALL:
            side.append(figure(one))
            continue
        if side:
            three = " three" * (len(side) % 3 == 0)
            out.append(f'<div class="pair{three}">{"".join(side)}</div>')
            side = []
        if one is not None:
            out.append(figure(one))
    return "".join(out)


def figure(one: Figure) -> str:
    """A figure with its title and caption."""
    caption = f"<figcaption>{escape(one.caption)}</figcaption>" if one.caption else ""
    return f"<figure><h4>{escape(one.title)}</h4>{one.svg}{caption}</figure>"


def width(svg: str) -> float:
    """Width of a drawing in its own units; infinite where it does not say."""
    found = re.search(r'viewBox="\s*\S+\s+\S+\s+([\d.]+)\s', svg[:2000])
    return float(found[1]) if found else math.inf


def table(one: Table) -> str:
    """A table with its title and note; columns of text lie to the left."""
    columns = [[row[i] for row in one.rows if i < len(row)] for i in range(len(one.head))]
    texts = [_is_text(column) for column in columns]
    head = [f'<th class="t">{escape(h)}</th>' if t else escape(h) for h, t in zip(one.head, texts, strict=True)]
    ranged = [any(isinstance(c, Number) and shown(c)[1] for c in column) for column in columns]
    beside = [r and sum(ranged) <= MOST_BESIDE for r in ranged]
    rows = []
    for row in one.rows:
        cells = [cell(c, beside=b) for c, b in zip(row, beside, strict=False)]
        rows.append([f'<td class="t">{c}</td>' if t else c for c, t in zip(cells, texts, strict=False)])
    note = f'<p class="small">{escape(one.note)}</p>' if one.note else ""
    drawn = pieces.table(head, rows)
    if len(one.head) > MANY:
        drawn = f'<div class="many">{drawn}</div>'
    return f"<h4>{escape(one.title)}</h4>{drawn}{note}"


def cell(value: Cell, *, beside: bool = False) -> str:
    """A cell of a table as HTML; an interval stands below its value, or beside it."""
    if isinstance(value, Number):
        middle, span = shown(value)
        if beside:
            return f'{middle}<small class="in">{span}</small>'
        return middle + (f'<small class="span">{span}</small>' if span else "")
    if isinstance(value, str):
        return escape(value)
    return f"{value:,}" if isinstance(value, int) else words.short(value)


def shown(number: Number) -> tuple[str, str]:
    """A value, and its interval where it has one, as HTML; no more digits than the interval leaves certain."""
    half = (number.high - number.low) / 2
    if not half > 0 or not math.isfinite(half) or not 1e-3 <= abs(number.value) < 1e6:
        return words.short(number.value), ""
    most = 3 - math.floor(math.log10(abs(number.value)))
    places = max(0, min(1 - math.floor(math.log10(half)), most))
    middle, low, high = (f"{v:,.{places}f}".replace("-", "&minus;") for v in (number.value, number.low, number.high))
    return middle, f"{low}&ndash;{high}" if number.low >= 0 else f"{low} to {high}"


def _is_text(cells: Sequence[Cell]) -> bool:
    """Whether a column holds words, but for a few that stand in for numbers."""
    said = [isinstance(c, str) and re.match(r"\s*[A-Za-z(]", c) and c not in ("nan", "inf") for c in cells if c != ""]
    return 2 * sum(map(bool, said)) > len(said)


def anchor(name: str) -> str:
    """A name as the target of a link."""
    return re.sub(r"[^\w-]+", "-", name)


def duration(seconds: float) -> str:
    """A time in words."""
    if seconds < 99.5:
        return f"{seconds:.0f} s" if seconds >= 9.95 else f"{seconds:.1f} s"
    return f"{int(seconds + 0.5) // 60} min {int(seconds + 0.5) % 60:02d} s"
