"""RX on arrays in memory: time and memory beside spectral and scikit-learn."""

from __future__ import annotations

from importlib import metadata

from .arrays import OURS, SKLEARN, SPECTRAL, Task, measured
from .section import Effort, Number, Section, Table, timed

PEERS = {SKLEARN: "scikit-learn", SPECTRAL: "spectral"}
"""Other programs and their distributions."""


def installed() -> tuple[tuple[str, ...], str]:
    """Other programs that are there, and a line for those that are not."""
    there = []
    for name, package in PEERS.items():
        try:
            metadata.version(package)
            there.append(name)
        except metadata.PackageNotFoundError:
            continue
    missing = [name for name in PEERS if name not in there]
    return tuple(there), f"{' and '.join(missing)} not installed: left out." if missing else ""


def tasks(effort: Effort, peers: tuple[str, ...]) -> list[Task]:
    """What is timed."""
    mine = (OURS, f"{OURS}, {effort.threads} threads") if effort.threads > 1 else (OURS,)
    window = tuple(p for p in peers if p == SPECTRAL)
    if effort.quick:
        return [Task(8, 512, (*mine, *peers), 3), Task(8, 40, (OURS, *window), 2, (5, 21))]
    return [Task(8, 4096, (*mine, *peers), 3), Task(200, 256, (*mine, *peers), 5),
            Task(8, 128, (*mine, *window), 3, (5, 21))]  # fmt: skip


def run(effort: Effort) -> Section:
    """Time in turns, memory of each alone."""
    peers, missing = installed()
    todo = tasks(effort, peers)
    space = [Task(8, 512 if effort.quick else 2048, (name,), 0) for name in (OURS, *peers)]
    times = measured(todo)
    taken = {task.programs[0]: measured([task])[0] for task in space}
    numbers: dict[str, Number] = {}
    rows = []
    for task, found in zip(todo, times, strict=True):
        for name, seconds in found.items():
            ratio = timed([s / o for s, o in zip(seconds, found[OURS], strict=True)], "")
            wall = timed(seconds, "s", "lower" if name.startswith(OURS) else "")
            stem = f"peers/arrays/{task.slug}/{name.replace(', ', '-').replace(' ', '-')}"
            numbers |= {f"{stem}/wall": wall, f"{stem}/ratio": ratio}
            pixels = 1e9 / task.side**2
            rows.append([str(task), name, wall, round(wall.value * pixels), ratio])
    more = []
    for name, size in taken.items():
        if size is not None:
            number = Number(size, "MB", better="lower" if name == OURS else "", exact=False)
            numbers[f"peers/arrays/{space[0].slug}/{name}/memory"] = number
            more.append([name, number, size * 1e6 / (space[0].side ** 2 * 4 * space[0].bands)])
    note = (
        f"One thread of BLAS; float32. Ratio: times the time of {OURS} on one thread, round by round. {missing}"
    ).strip()
    tables = [Table.of("Time", ("", "program", "wall time [s]", "ns a pixel", f"times {OURS}"), rows, note)]
    if more:
        tables.append(Table.of("Memory beside the image", ("program", "[MB]", "of the image"), more,
                               f"{space[0]}, float32."))  # fmt: skip
    return Section("peers/arrays", "RX on arrays in memory", tables=tuple(tables), numbers=numbers)
