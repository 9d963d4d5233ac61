"""Time functions in turns, and print measurements as markdown tables or write them into pages of docs/."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from detect.bench.numbers import load_now, versions
from detect.bench.numbers import machine as machine_now

ROOT = Path(__file__).resolve().parents[1]
"""Folder of the packages. Child processes import them from there, whatever else is installed."""
PART_MARK = "<!-- measured -->"
"""Text before and after each part of a page that a benchmark writes."""


def in_turns(
    jobs: Mapping[Any, Callable[[], object]], rounds: int, clock: Callable[[], Any] = time.perf_counter
) -> dict[Any, list[Any]]:
    """Times of each job by a clock [s]. Jobs run in turns; one more round at the start compiles and does not count."""
    found: dict[Any, list[Any]] = {name: [] for name in jobs}
    for turn in range(rounds + 1):
        for name, job in jobs.items():
            start = clock()
            job()
            if turn:
                found[name].append(clock() - start)
    return found


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A markdown table with aligned columns."""
    cells = [list(head), *([str(c) for c in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    lines = ["| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |" for row in cells]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)


def say(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], note: str = "") -> None:
    """Print a table with a title and, if there is one, a note above it."""
    print(f"\n### {title}\n" + (f"\n{note}\n" if note else "") + f"\n{table(head, rows)}", flush=True)


def fill(page: Path, texts: Sequence[str]) -> None:
    """Replace the measured parts of a page by texts, in order.

    Raises ValueError: the page has fewer or more such parts than there are texts.
    """
    parts = page.read_text(encoding="utf-8").split(PART_MARK)
    if len(parts) != 2 * len(texts) + 1:
        raise ValueError(f"{page.name} needs {PART_MARK} before and after each of {len(texts)} parts.")
    parts[1::2] = [f"\n\n{text}\n\n" for text in texts]
    page.write_text(PART_MARK.join(parts), encoding="utf-8")


def machine() -> str:
    """The machine, its load, and the versions of packages, as text."""
    now, load = machine_now(), load_now()
    where = f"{now['processor']}, {now['cores']} cores, {now['system']}"
    where += "" if load is None else f", load {load:.1f} at the start"
    return f"Machine: {where}.\nVersions: {', '.join(f'{k} {v}' for k, v in versions().items())}."
