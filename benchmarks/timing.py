"""Measure whole processes in turns, and print what came out as markdown tables.

Nothing heavy is imported here: on Linux the peak memory of a child is at least what its parent held when it started.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[1]
Command = Sequence[str]


@dataclass(frozen=True)
class Run:
    """One run of a process: wall time and processor time [s], largest resident memory [MB]."""

    wall: float
    cpu: float
    peak: float


class FailedError(Exception):
    """A process ended with an error; the text is the last line that it wrote."""


def run_once(command: Command, cleanup: Callable[[], None] | None = None) -> Run:
    """Run a command and measure it; what earlier runs left to be written to disk is written first."""
    os.sync()
    start = time.perf_counter()
    child = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    said = child.stderr.read()
    _, status, usage = os.wait4(child.pid, 0)
    wall = time.perf_counter() - start
    child.stderr.close()
    child.returncode = os.waitstatus_to_exitcode(status)
    if cleanup:
        cleanup()
    if child.returncode:
        lines = said.decode(errors="replace").strip().splitlines() or [f"exit code {child.returncode}"]
        raise FailedError(lines[-1])
    unit = 1 if sys.platform == "darwin" else 1024
    return Run(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * unit / 1e6)


def in_turns(
    commands: Mapping[str, Command], rounds: int, cleanup: Callable[[], None] | None = None
) -> dict[str, list[Run] | str]:
    """Run every command once a round, so that all see the same machine; a failed one gives its message instead."""
    found: dict[str, list[Run] | str] = {name: [] for name in commands}
    for _ in range(rounds):
        for name, command in commands.items():
            runs = found[name]
            if isinstance(runs, list):
                try:
                    runs.append(run_once(command, cleanup))
                except FailedError as error:
                    found[name] = str(error)
    return found


def spread(values: Sequence[float]) -> str:
    """Median and range of values, as text."""
    return f"{median(values):.2f} ({min(values):.2f}-{max(values):.2f})"


def rows_of(found: Mapping[str, list[Run] | str], against: str) -> list[list[str]]:
    """Rows for a table: what, min and median wall, ratio to `against` in the same round, processor, memory."""
    base = found[against]
    rows = []
    for name, runs in found.items():
        if isinstance(runs, str):
            rows.append([name, runs, "", "", ""])
            continue
        walls = [r.wall for r in runs]
        ratio = "1" if name == against else "-"
        if isinstance(base, list) and name != against:
            ratio = spread([a.wall / b.wall for a, b in zip(runs, base, strict=True)])
        cpu, peak = median(r.cpu for r in runs), max(r.peak for r in runs)
        rows.append([name, f"{min(walls):.2f} / {median(walls):.2f}", ratio, f"{cpu:.2f}", f"{peak:.0f}"])
    return rows


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A markdown table, columns lined up."""
    cells = [list(head), *([str(c) for c in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    lines = ["| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |" for row in cells]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)


def say(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], note: str = "") -> None:
    """Print a titled table."""
    print(f"\n### {title}\n" + (f"\n{note}\n" if note else "") + f"\n{table(head, rows)}", flush=True)


def machine(*packages: str) -> str:
    """What was measured on, and with which versions, as text."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    load = f", load {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else ""
    versions = ", ".join(f"{name} {_version(name)}" for name in ("deglint", "numpy", "rasterio", *packages))
    where = f"{_processor()}, {cores} cores, {platform.system()} {platform.release()}{load}"
    return f"Machine: {where}.\nVersions: Python {platform.python_version()}, {versions}."


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
