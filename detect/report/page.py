"""The report as one HTML page: no script, nothing fetched, every name escaped; it reads on paper, too."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from . import sections, words
from .evaluate import Evaluation
from .style import STYLE


def page(found: Evaluation, provenance: Mapping[str, Any]) -> str:
    """The whole page.

    Parameters
    ----------
    found : Evaluation
    provenance : mapping
        With what it was made: shown at the end as it stands.
    """
    parts = [
        _head(found),
        sections.curves(found),
        sections.areas(found),
        sections.points(found),
        sections.compared(found) if len(found.detectors) > 1 else "",
        sections.places(found),
        sections.objects(found) if found.detectors[0].objects is not None else "",
        sections.three_d(found),
        words.READING,
        _provenance(provenance),
    ]
    title = escape(f"ROC: {', '.join(found.inputs.names)}")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{title}</title><style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(parts)
        + "\n</main></body></html>\n"
    )


def _head(found: Evaluation) -> str:
    pixels, scene = found.numbers["pixels"], found.numbers["scene"]
    facts = [
        (f"{pixels['judged']:,}", "pixels judged"),
        (f"{pixels['targets']:,}", "target pixels"),
        (f"{pixels['objects']:,}", "objects in the truth"),
        (f"{pixels['total'] - pixels['judged']:,}", "pixels left out"),
    ]
    if scene["area_km2"] is not None:
        facts.append((words.short(scene["area_km2"]), "km² judged"))
    boxes = "".join(f"<div><b>{escape(a)}</b><span>{escape(b)}</span></div>" for a, b in facts)
    left = [f"{n:,} {escape(why)}" for why, n in pixels["left_out"].items()]
    aside = f'<p class="small">Left out: {"; ".join(left)}.</p>' if left else ""
    notes = "".join(f"<li>{escape(words.sentence(n))}</li>" for n in found.numbers["notes"])
    note = f'<div class="note"><ul>{notes}</ul></div>' if notes else ""
    return (
        f'<h1>ROC report</h1><p class="sub">How well targets were told from background. Truth: '
        f"{escape(found.request.truth)}</p>"
        f'<p class="lead">{words.lead(found)}</p><div class="facts">{boxes}</div>{aside}{note}'
    )


def _provenance(provenance: Mapping[str, Any]) -> str:
    rows = "".join(f"<dt>{escape(str(k))}</dt><dd>{_value(v)}</dd>" for k, v in provenance.items())
    return f"<h2>How this was made</h2><dl>{rows}</dl>"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return escape(", ".join(f"{k} {v}" for k, v in value.items()))
    if isinstance(value, (list, tuple)):
        return "<br>".join(_value(v) for v in value)
    return f"<code>{escape(value)}</code>" if str(value).startswith("rxdetect ") else escape(str(value))
