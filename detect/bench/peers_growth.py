"""How time and memory grow with scene size, bands, threads and window."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

from ..report import svg
from .arrays import OURS, SKLEARN, SPECTRAL, Task, measured
from .peers_files import COPY, PLAIN, REMOVE, SCORE, SLUGS, Case, Found, measure
from .processes import Run
from .section import Better, Cell, Effort, Figure, Number, Section, Table, timed

WINDOWS = (5, 9, 15, 21, 31, 41)


def curve_axis(label: str, values: Sequence[float]) -> svg.Axis:
    """A logarithmic axis around values."""
    return svg.Axis(label, min(values) / 1.3, max(values) * 1.3, log=True)


def drawn(title: str, lines: Mapping[str, Mapping[float, float]], x: str, y: str, caption: str = "") -> Figure:
    """A small plot of lines, both axes logarithmic."""
    series = [svg.Series(name, np.array(list(own)), np.array(list(own.values())), dots=tuple(own.items()))
              for name, own in lines.items()]  # fmt: skip
    xs = [v for own in lines.values() for v in own]
    ys = [v for own in lines.values() for v in own.values()]
    plot = svg.plot(series, curve_axis(x, xs), curve_axis(y, ys), title=title, size=svg.HALF, legend=True)
    return Figure(title, plot, caption)


def sizes(effort: Effort, place: Path, known: Mapping[int, Found]) -> Section:
    """Processor time and memory against the side of the scene; `known` sides were measured already."""
    sides = (256, 1024) if effort.quick else (512, 1024, 2048, 4096, 8192)
    numbers: dict[str, Number] = {}
    cpu: dict[str, dict[float, float]] = {COPY: {}, REMOVE: {}, SCORE: {}}
    peak: dict[str, dict[float, float]] = {COPY: {}, REMOVE: {}, SCORE: {}}
    rows: list[tuple[Cell, ...]] = []
    for side in sides:
        case, rounds = Case(side), 2 if effort.quick else 3 if side <= 4096 else 1
        found = known.get(side) or measure(case, effort, rounds, pick(case, effort, place, cpu), place)
        for name in cpu:
            runs = found.get(name, "")
            if isinstance(runs, str):
                continue
            stem = f"peers/growth/size/{side}/{SLUGS[name]}"
            better: Better = "" if name == COPY else "lower"
            time, memory = timed([r.cpu for r in runs], "s", better), timed([r.peak for r in runs], "MB", better)
            numbers |= {f"{stem}/cpu": time, f"{stem}/peak": memory}
            values = case.bands * side**2 / 1e6
            cpu[name][values], peak[name][values] = time.value, memory.value
            rows.append((f"{side} x {side}", name, time, 1e3 * time.value / values, memory))
        if side > 4096:
            (place / f"{case.slug}.tif").unlink(missing_ok=True)
    head = ("scene", "program", "processor time [s]", "[ms] a megapixel-band", "peak memory [MB]")
    across = "size [megapixel-bands]"
    return Section(
        "peers/growth/size", "Scene size",
        tables=(Table.of("Time and memory against scene size", head, rows, "8 bands, float32, from file to file."),),
        figures=(drawn("Time against scene size", cpu, across, "processor time [s]"),
                 drawn("Memory against scene size", peak, across, "peak memory [MB]")),
        numbers=numbers,
    )  # fmt: skip


def pick(case: Case, effort: Effort, place: Path, names: Mapping[str, object]) -> dict[str, Sequence[str]]:
    """Commands of these names."""
    commands = case.commands(place / f"{case.slug}.tif", effort.directory / "out.tif", "")
    return {name: commands[name] for name in names}


def bands(effort: Effort, place: Path, peers: tuple[str, ...]) -> Section:
    """Time against the number of bands: removal from file to file, and global RX in memory, values kept the same."""
    many = (4, 8, 16) if effort.quick else (4, 8, 16, 32, 64)
    pixels = 2**17 if effort.quick else 2**20
    numbers: dict[str, Number] = {}
    cpu: dict[str, dict[float, float]] = {PLAIN: {}}
    for n in many[:: 2 if effort.quick else 1]:
        case = Case(512 if effort.quick else 1024, bands=n)
        found = measure(case, effort, 2, pick(case, effort, place, cpu), place)[PLAIN]
        if not isinstance(found, str):
            number = timed([r.cpu for r in found], "s", "lower")
            numbers[f"peers/growth/bands/{n}/{SLUGS[PLAIN]}/cpu"] = number
            cpu[PLAIN][n] = 1e9 * number.value / (n * case.side**2)
    others = tuple(p for p in peers if p == SKLEARN)
    todo = [Task(n, round((8 * pixels / n) ** 0.5), (OURS, *others), 3) for n in many]
    wall: dict[str, dict[float, float]] = {f"{OURS}, global RX": {}, **{p: {} for p in others}}
    for task, times in zip(todo, measured(todo), strict=True):
        for name, label in zip((OURS, *others), wall, strict=True):
            number = timed(times[name], "s", "lower" if name == OURS else "")
            numbers[f"peers/growth/bands/{task.bands}/{name}/wall"] = number
            wall[label][task.bands] = 1e9 * number.value / (task.bands * task.side**2)
    figures = (drawn("Removal against bands", cpu, "bands", "processor time a value [ns]",
                     f"From file to file, {case.side} x {case.side} pixels, start-up in it."),
               drawn("Global RX against bands", wall, "bands", "time a value [ns]",
                     f"In memory, one thread, {8 * pixels / 1e6:.0f} million values."))  # fmt: skip
    return Section("peers/growth/bands", "Bands", figures=figures, numbers=numbers)


def threads(effort: Effort, place: Path) -> Section:
    """Wall time against threads: removal from file to file."""
    many = [n for n in (1, 2, 4, 8, 16, 32) if n <= effort.threads]
    case = Case(1024 if effort.quick else 4096)
    commands = {str(n): case.commands(place / f"{case.slug}.tif", effort.directory / "out.tif", "", n)[REMOVE]
                for n in many}  # fmt: skip
    found = measure(case, effort, 2 if effort.quick else 3, commands, place)
    runs: dict[int, list[Run]] = {int(n): own for n, own in found.items() if not isinstance(own, str)}
    numbers: dict[str, Number] = {}
    rows: list[tuple[Cell, ...]] = []
    for n, own in runs.items():
        wall, cpu = timed([r.wall for r in own], "s", "lower"), timed([r.cpu for r in own], "s", "lower")
        faster = timed([a.wall / b.wall for a, b in zip(runs[1], own, strict=True)], "", "higher")
        numbers |= {f"peers/growth/threads/{n}/{key}": v
                    for key, v in {"wall": wall, "cpu": cpu, "faster": faster}.items()}  # fmt: skip
        rows.append((n, wall, cpu, faster, max(r.peak for r in own)))
    head = ("threads", "wall time [s]", "processor time [s]", "times as fast as one", "peak memory [MB]")
    table = Table.of(f"{REMOVE} on threads, {case}", head, rows, "Start-up and the writing of the file stay on one.")
    return Section("peers/growth/threads", "Threads", tables=(table,), numbers=numbers)


def windows(effort: Effort, peers: tuple[str, ...]) -> Section:
    """Time of local RX against its outer window."""
    outer = WINDOWS[::2] if effort.quick else WINDOWS
    side = 36 if effort.quick else 96
    others = tuple(p for p in peers if p == SPECTRAL)
    todo = [Task(8, side, (OURS, *others), 1 if effort.quick else 2, (3, w)) for w in outer]
    large = [replace(task, side=256 if effort.quick else 512, programs=(OURS,), rounds=3) for task in todo]
    numbers: dict[str, Number] = {}
    lines: dict[str, dict[float, float]] = {OURS: {}, **{p: {} for p in others}}
    for task, times in zip((*todo, *large), measured([*todo, *large]), strict=True):
        assert task.window is not None
        for name, seconds in times.items():
            if name == OURS and task in todo:
                continue  # too small to be timed well
            number = timed(seconds, "s", "lower" if name == OURS else "")
            numbers[f"peers/growth/window/{task.window[1]}/{name}/wall"] = number
            lines[name][task.window[1]] = 1e6 * median(seconds) / task.side**2
    caption = f"8 bands; {OURS} on {large[0].side} x {large[0].side} pixels"
    caption += f", {SPECTRAL} on {side} x {side}, since it takes long." if others else "."
    figure = drawn("Local RX against its outer window", lines, "outer window [pixel]", "time a pixel [us]", caption)
    return Section("peers/growth/window", "Window of local RX", figures=(figure,), numbers=numbers)
