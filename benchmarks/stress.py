"""Correct digits of every operation on hard pixels: prints what `detect.bench.stress` measures."""

from __future__ import annotations

from pathlib import Path

from detect.bench import stress
from detect.bench.section import Effort

from .timing import machine, say


def main(quick: bool) -> None:
    """Measure and print."""
    section = stress.run(Effort(quick=quick, seeds=1, directory=Path.cwd()))
    print(f"## {section.title}\n\n" + machine())
    for paragraph in section.words:
        print(f"\n{paragraph}")
    for table in section.tables:
        say(table.title, table.head, [[str(cell) for cell in row] for row in table.rows], table.note)
