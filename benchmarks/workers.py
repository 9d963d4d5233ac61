"""How much faster is a removal with more workers? Numbers of workers are measured in turns, on this machine.

A worker is a process of one thread. The time to start the workers does not count: they correct a small scene first. If
others use the machine, see the processor time, not the wall time. The last column is the peak memory of a worker.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from deglint import Recipe, remove_glint
from deglint.cluster import connect

from .scale import mosaic
from .timing import machine, table

TIMED_SIDES = {"full": 8192, "quick": 2048}
ROUNDS = 3


def once(cluster: Any, scene: Path, out: Path) -> dict[str, float]:
    """Remove glint on a cluster. Return the wall times of the parts, and processor times of workers and caller [s]."""
    begun: dict[str, float] = {}
    before, own = sum(cluster.client.run(time.process_time).values()), time.process_time()

    def progress(stage: str, _done: int, _total: int) -> None:
        begun[stage] = time.perf_counter()  # the last word on a stage is its end

    start = time.perf_counter()
    recipe = Recipe(method="joyce", sample="all", mask="none", compensate="off")
    remove_glint(scene, out, recipe, cluster=cluster, progress=progress, overwrite=True, options={"COMPRESS": "ZSTD"})
    end = time.perf_counter()
    workers = sum(cluster.client.run(time.process_time).values()) - before
    return {"fit": begun["fit"] - start, "correct": end - begun["fit"], "whole": end - start, "workers": workers,
            "caller": time.process_time() - own}  # fmt: skip


def main(quick: bool, directory: Path | None, counts: Sequence[int] = (1, 2)) -> None:
    """Print the times for each number of workers. `directory` is for scratch files."""
    side = TIMED_SIDES["quick" if quick else "full"]
    with tempfile.TemporaryDirectory(dir=directory) as scratch:
        place = directory or Path(scratch)
        scene, out = mosaic(place, side), Path(scratch) / "out.tif"
        runs: dict[int, list[dict[str, float]]] = {n: [] for n in counts}
        most: dict[int, float] = {}
        for _ in range(ROUNDS):
            for n in counts:
                with connect(workers=n) as cluster:
                    once(cluster, mosaic(place, 1024), out)
                    runs[n].append(once(cluster, scene, out))
                    most[n] = max(cluster.memory().values()) / 1e6
        middle = {n: {k: statistics.median(r[k] for r in found) for k in found[0]} for n, found in runs.items()}
        first = middle[counts[0]]
        head = ("workers", "fit [s]", "correct [s]", "whole [s]", "faster than the first", "CPU of the workers [s]",
                "CPU of the calling process [s]", "most that one held [MB]")  # fmt: skip
        rows = [[str(n), f"{m['fit']:.2f}", f"{m['correct']:.2f}", f"{m['whole']:.2f}",
                 f"{first['whole'] / m['whole']:.2f}", f"{m['workers']:.1f}", f"{m['caller']:.2f}", f"{most[n]:.0f}"]
                for n, m in middle.items()]  # fmt: skip
        print(f"## Workers\n\n{machine()} {side} x {side} pixels, 8 bands, medians of {ROUNDS}.\n")
        print(table(head, rows))
