"""The tables of docs/evidence-detection.md: `python -m benchmarks detection [--docs] [--directory DIRECTORY]`.

Ships found in ports, observed false-alarm rates, and probabilities of detection of small targets.
"""

from __future__ import annotations

from pathlib import Path

from . import alarms, pd, ships
from .timing import ROOT, fill, say, table


def main(directory: Path | None, docs: bool) -> None:
    """Print every table; with `docs`, also write them into the page. `directory` holds the scenes."""
    found = []
    for make in (ships.tables, alarms.tables, pd.tables):
        for name, head, rows in make(directory):
            say(name, head, rows)
            found.append(table(head, rows))
    if docs:
        fill(ROOT / "docs" / "evidence-detection.md", found)
