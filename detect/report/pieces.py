"""Pieces that every page is made of: the document, boxes of facts, tables, and with what it was made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from deglint.shown import shown

from .style import STYLE


def document(title: str, parts: Sequence[str]) -> str:
    """A whole page.

    Parameters
    ----------
    title : str
        Plain text.
    parts : sequence of str
        HTML.
    """
    return shown(
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(parts)
        + "\n</main></body></html>\n"
    )


def facts(found: Sequence[tuple[str, str]]) -> str:
    """Boxes of a figure and what it counts; plain text."""
    boxes = "".join(f"<div><b>{escape(a)}</b><span>{escape(b)}</span></div>" for a, b in found)
    return f'<div class="facts">{boxes}</div>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table; cells are HTML already, and may bring their own <th> or <td>."""
    top = "".join(h if h.startswith("<th") else f"<th>{h}</th>" for h in head)
    body = "".join(
        "<tr>" + "".join(c if c.startswith("<td") else f"<td>{c}</td>" for c in row) + "</tr>" for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def made(provenance: Mapping[str, Any]) -> str:
    """With what a page was made, as a list of names and values."""
    rows = "".join(f"<dt>{escape(str(k))}</dt><dd>{_value(v)}</dd>" for k, v in provenance.items())
    return f"<dl>{rows}</dl>"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return escape(", ".join(f"{k} {v}" for k, v in value.items()))
    if isinstance(value, (list, tuple)):
        return "<br>".join(_value(v) for v in value)
    return f"<code>{escape(value)}</code>" if str(value).startswith("rxdetect ") else escape(str(value))
