"""`python -m tests.promises`: run the tests that hold what is promised, and print docs/promises.md from their counts.

Each line of the page names tests; how often something was tried is how many cases of them ran, or what they counted
themselves (pytest's `record_property("tried", n)`). `--write` puts the page in its place.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "promises.md"
_ROWS = tomllib.loads((ROOT / "tests" / "promises.toml").read_text(encoding="utf-8"))["row"]
PROMISES = {name: [r for r in _ROWS if r["promise"] == name] for name in dict.fromkeys(r["promise"] for r in _ROWS)}
"""For each promise what was tried ("tried"), and the tests: their "file", and "tests" by name."""
_HEAD = """# What is promised, and how it is tested

`python -m tests.promises --write` runs the tests of this page, counts their cases and writes it. The second column
says how often something was tried, the third how often the promise held.

A command *refuses* with one line that says what is wrong and what to do, with exit code 1, before it touches any file.
*Scratch files* are the hidden files beside an output until it is complete. The files *behind* an input are all files
that are read with it: headers, masks, overviews, sources of VRTs at any depth.
"""
_LIMITS = """
## What is not promised

- A power cut, or `kill -9` in the very moment in which outputs are moved, may leave new sidecars and flags without
  their image: the image goes last. An old output that was to be replaced is then called `.NAME...old.tif`.
- Two runs that write the same outputs at the same time may leave the files of both.
- Files on servers have no fingerprint: that they change is not noticed.
- Overviews and `.aux.xml` that a viewer writes beside a scene while a run reads it do not stop the run.
- A VRT reads what it names, wherever that lies.
"""


class Counts:
    """A plugin of pytest that counts what was tried, and what held."""

    def __init__(self) -> None:
        self.tried: Counter[str] = Counter()
        self.held: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Count a case where it ran, or failed before."""
        if report.when != "call" and not report.failed:
            return
        name = report.nodeid.partition("[")[0].rpartition("/")[2]
        times = dict(report.user_properties).get("tried", 1)
        self.tried[name] += times
        self.held[name] += times * report.passed


def page(counts: Counts) -> str:
    """The page."""
    out, tried = [_HEAD], 0
    for promise, rows in PROMISES.items():
        out += ["", f"## {promise}", "", "| tried | times | held | by |", "|---|---:|---:|---|"]
        for row in rows:
            names = [f"{row['file']}.py::{test}" for test in row["tests"]]
            times, held = (sum(c[name] for name in names) for c in (counts.tried, counts.held))
            tried += times
            out.append(f"| {row['tried']} | {times} | {'all' if held == times else held} | `tests/{row['file']}.py` |")
    return "\n".join([*out, "", f"{tried} tries in all.", _LIMITS])


def main() -> int:
    """Run the tests, and print or write the page."""
    import pytest

    parser = argparse.ArgumentParser(prog="python -m tests.promises", description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help=f"write {PAGE.relative_to(ROOT)}")
    given = parser.parse_args()
    named = [f"{ROOT / 'tests' / row['file']}.py::{test}" for row in _ROWS for test in row["tests"]]
    counts = Counts()
    code = pytest.main(["-q", "-p", "no:cacheprovider", *named], plugins=[counts])
    text = page(counts)
    if given.write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text)  # noqa: T201
    return int(code)


if __name__ == "__main__":
    sys.exit(main())
