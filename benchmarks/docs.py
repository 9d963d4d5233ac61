"""Write the measured part of docs/benchmark.md from one run: `python -m benchmarks docs [--quick]`."""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path

from detect.bench.report import Table, tables
from detect.bench.run import Effort, measure, removals

from . import peers, stress
from .timing import ROOT, fill, machine, table

PAGE = ROOT / "docs" / "benchmark.md"


def main(quick: bool) -> None:
    """Measure, and replace the measured part of the page."""
    logging.getLogger("deglint").setLevel(logging.ERROR)
    effort = Effort.of(tuple(removals()), quick=quick, seeds=None)
    with tempfile.TemporaryDirectory() as place:
        found = tables(measure(effort, Path(place), lambda stage, done, total: print(stage, done, total, flush=True)))
    found.append(Table("RX beside other programs", peers.HEAD, tuple(map(tuple, peers.rows(quick))), peers.RX_NOTE))
    head, rows = stress.rows()
    found.append(Table("Correct digits", tuple(head), tuple(map(tuple, rows)), stress.DIGITS_NOTE))
    parts = [f"## {t.title}\n\n{table(t.head, t.rows)}\n\n{t.note}" for t in found]
    fill(PAGE, ["\n\n".join([machine(), *parts])])
    print(f"{PAGE} written")
