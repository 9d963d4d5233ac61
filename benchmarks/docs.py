"""Write docs/benchmark.md from one run: `python -m benchmarks docs [--quick]`."""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path

from detect.bench.report import Table, tables
from detect.bench.run import Effort, measure, removals

from . import peers, stress
from .timing import ROOT, machine, table

PAGE = ROOT / "docs" / "benchmark.md"
HEAD = """# Benchmark

`python -m benchmarks docs` measures everything on this page and writes it. Users make the same report, with plots, by

```sh
rxdetect bench report.html                    # about two minutes; --quick: ten seconds
rxdetect bench report.html --only hedley,default --seeds 10
rxdetect bench compare old.json new.json      # what got better or worse; --fail-on worse: exit code 1
```

(`pip install 'deglint[reports]'` brings matplotlib and jinja2, which the report needs.)

The scenes are simulated ([simulator](simulator.md)), so the sea without glint is known: the sensor of the thesis
with eight bands and pixels of 25 cm, sun at 40 degrees, view from nadir. The left half is deep water, the sample of
every fit. The right half holds submerged objects. Each method of `deglint.remove.METHODS` runs without compensation;
`default` is `deglint remove` without options; `noise only` is the truth with sensor noise, the limit of any removal.
Methods that need a band that this sensor lacks are marked as refused.
"""
TAIL = """## Compare two runs

`rxdetect bench compare OLD.json NEW.json` lists what is worse, slower, better, faster, changed, gone and new. A
number is better or worse when its interval does not overlap the old one. A time must also move by more than 10 %, and
times of different machines are not compared.

Other measurements: `python -m benchmarks --help`.
"""


def markdown(found: Table) -> str:
    """A table with its title and note."""
    return f"## {found.title}\n\n{table(found.head, found.rows)}\n\n{found.note}\n"


def main(quick: bool) -> None:
    """Measure, and write the page."""
    logging.getLogger("deglint").setLevel(logging.ERROR)
    effort = Effort.of(tuple(removals()), quick=quick, seeds=None)
    with tempfile.TemporaryDirectory() as place:
        found = tables(measure(effort, Path(place), lambda stage, done, total: print(stage, done, total, flush=True)))
    found.append(Table("RX beside other programs", peers.HEAD, tuple(map(tuple, peers.rows(quick))), peers.NOTE))
    head, rows = stress.rows()
    found.append(Table("Correct digits", tuple(head), tuple(map(tuple, rows)), stress.NOTE))
    PAGE.write_text("\n".join([HEAD, machine() + "\n", *map(markdown, found), TAIL]), encoding="utf-8")
    print(f"{PAGE} written")
