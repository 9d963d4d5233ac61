"""The benchmark as a page of the documentation: markdown between two marks, and its figures in a folder beside it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import unescape
from pathlib import Path
from typing import Any

from deglint.errors import InputError

from .collect import Collected
from .report import duration, shown
from .section import Cell, Figure, Number, Section, Table

PAGE, FOLDER = "benchmark.md", "benchmark"
BEGIN, END = "<!-- measured -->", "<!-- end of what was measured -->"
EMPTY = f"# Which method, and what does it cost?\n\n{BEGIN}\n{END}\n"
MOST_ROWS, MOST_BYTES = 30, 300_000
"""Longer tables and larger figures are left to the report."""
STYLE = (
    "<style>text{font-family:system-ui,-apple-system,'Segoe UI',Roboto,Arial,sans-serif}"
    "text:not([font-size]){font-size:13px}text:not([fill]){fill:#444}"
    "text.name{font-size:14px;fill:#1b1f24}</style>"
)


def pages(found: Collected, made: Mapping[str, Any], old: str) -> dict[str, str]:
    """Texts of files by name: the page, with what stands outside of its marks kept, and its figures.

    Parameters
    ----------
    found : Collected
    made : mapping
        As `machine.provenance` gives it.
    old : str
        The page as it is.

    Raises
    ------
    InputError
        The page has not both marks.
    """
    before, begin, rest = old.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(f"{PAGE} has no lines {BEGIN} and {END} to write between. Put them in, or move the page away.")
    files: dict[str, str] = {}
    parts = [_head(found, made), *(_section(one, 2, files) for one in found.sections)]
    return {PAGE: f"{before}{BEGIN}\n\n" + "\n\n".join(parts) + f"\n\n{END}{after}", **files}


def stale(directory: Path, files: Mapping[str, str]) -> list[Path]:
    """Figures of an earlier page that this one has not."""
    return [path for path in (directory / FOLDER).glob("*.svg") if f"{FOLDER}/{path.name}" not in files]


def _head(found: Collected, made: Mapping[str, Any]) -> str:
    machine = made["machine"]
    findings = [f"- {text(one.finding)}" for one in found.sections if one.finding]
    where = f"{machine['processor']}, {machine['cores']} cores, {machine['memory']} memory"
    load = f", load {machine['load at the start']} at the start" if machine["load at the start"] is not None else ""
    versions = ", ".join(f"{k} {v}" for k, v in made["versions"].items())
    command = re.sub(r"(?<!\S)/\S*/(?=\S)", "", made["command"])  # names, not where they lie on this machine
    said = (
        f"Measured by `{command}` in {duration(made['seconds'])} on {made['date'][:10]}: {where}{load}; "
        f"{versions}. Figures are means over {made['seeds']} seeds and their 95 % interval, or medians of repeated "
        "timings and their range."
    )
    return "\n\n".join(filter(None, [said, "\n".join(findings)]))


def _section(one: Section, level: int, files: dict[str, str]) -> str:
    """A chapter; its figures are added to `files`."""
    parts = [f"{'#' * level} {text(one.title)}", *(text(w) for w in one.words)]
    parts += [_figure(f, one.name, files) for f in one.figures]
    parts += [_table(t) for t in one.tables]
    parts += [_section(part, min(level + 1, 4), files) for part in one.parts]
    return "\n\n".join(parts)


def _figure(one: Figure, section: str, files: dict[str, str]) -> str:
    if len(one.svg) > MOST_BYTES:
        return f"*{text(one.title)}: in the report.*"
    stem = re.sub(r"[^a-z0-9]+", "-", f"{section} {one.title}".lower()).strip("-")[:80]
    while f"{FOLDER}/{stem}.svg" in files:
        stem += "-2"
    files[f"{FOLDER}/{stem}.svg"] = alone(one.svg)
    return f"![{text(one.title)}]({FOLDER}/{stem}.svg)" + (f"\n\n{text(one.caption)}" if one.caption else "")


def alone(svg: str) -> str:
    """A drawing as a file of its own: XML with its name space and its letters."""
    named = re.sub(r"&(?!(?:amp|lt|gt|quot|apos);)\w+;", lambda found: unescape(found[0]), svg)
    head, _, body = named.partition(">")
    space = "" if "xmlns=" in head else ' xmlns="http://www.w3.org/2000/svg"'
    return f"{head.replace('<svg', f'<svg{space}', 1)}>{STYLE}{body}\n"


def _table(one: Table) -> str:
    lines = [f"**{text(one.title)}**"]
    if one.note:
        lines.append(text(one.note))
    if len(one.rows) > MOST_ROWS:
        return "\n\n".join([*lines, f"*{len(one.rows)} rows, in the report.*"])
    rows = [[text(c) for c in one.head], *([_cell(c) for c in row] for row in one.rows)]
    cells = ["| " + " | ".join(row) + " |" for row in rows]
    cells.insert(1, "|" + "---|" * len(one.head))
    return "\n\n".join([*lines, "\n".join(cells)])


def _cell(value: Cell) -> str:
    if isinstance(value, str):
        return text(value)
    middle, span = shown(value if isinstance(value, Number) else Number(float(value)))
    return _unmarked(f"{middle} ({span})" if span else middle)


def _unmarked(html: str) -> str:
    """Numbers without the entities of HTML, but for a power of ten's small digits."""
    return unescape(html).replace("\u2013", "-").replace("\u2212", "-").replace("\u2009", " ").replace("\xd7", "x")


def text(said: str) -> str:
    """Words as markdown: what would be markup is escaped."""
    return re.sub(r"([\\|<>*_`\[\]])", r"\\\1", " ".join(said.split()))
