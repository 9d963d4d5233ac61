"""The report as one HTML page: no script, nothing fetched, every name escaped; it reads on paper, too."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from . import sections, words
from .evaluate import Evaluation
from .pieces import document, facts, made


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
        f"<h2>How this was made</h2>{made(provenance)}",
    ]
    return document(f"ROC: {', '.join(found.inputs.names)}", parts)


def _head(found: Evaluation) -> str:
    pixels, scene = found.numbers["pixels"], found.numbers["scene"]
    counts = [
        (f"{pixels['judged']:,}", "pixels judged"),
        (f"{pixels['targets']:,}", "target pixels"),
        (f"{pixels['objects']:,}", "objects in the truth"),
        (f"{pixels['total'] - pixels['judged']:,}", "pixels left out"),
    ]
    if scene["area_km2"] is not None:
        counts.append((words.short(scene["area_km2"]), "km² judged"))
    left = [f"{n:,} {escape(why)}" for why, n in pixels["left_out"].items()]
    aside = f'<p class="small">Left out: {"; ".join(left)}.</p>' if left else ""
    notes = "".join(f"<li>{escape(words.sentence(n))}</li>" for n in found.numbers["notes"])
    note = f'<div class="note"><ul>{notes}</ul></div>' if notes else ""
    return (
        f'<h1>ROC report</h1><p class="sub">How well targets were distinguished from the background. Truth: '
        f"{escape(found.request.truth)}</p>"
        f'<p class="lead">{words.lead(found)}</p>{facts(counts)}{aside}{note}'
    )
