"""The tables of docs/detection.md: `python -m benchmarks detection [--docs] [--directory DIRECTORY]`.

Ships found in ports, observed false-alarm rates, and probabilities of detection of small targets. With --docs they
replace the tables of the page, each between a line `<!-- table NAME -->` and the next empty line.
"""

from __future__ import annotations

from pathlib import Path

from . import alarms, pd, ships
from .timing import ROOT, say, table

PAGE = ROOT / "docs" / "detection.md"


def main(directory: Path | None, docs: bool) -> None:
    """Print every table, or write all into the page."""
    for make in (ships.tables, alarms.tables, pd.tables):
        for name, head, rows in make(directory):
            say(name, head, rows)
            if docs:
                PAGE.write_text(replaced(PAGE.read_text(), name, table(head, rows)))


def replaced(page: str, name: str, new: str) -> str:
    """The page with another table below the line that names it."""
    mark = f"<!-- table {name} -->\n"
    before, found, rest = page.partition(mark)
    if not found:
        raise ValueError(f"{PAGE.name} has no line {mark.strip()!r}.")
    _old, _, after = rest.partition("\n\n")
    return f"{before}{mark}{new}\n\n{after}"
