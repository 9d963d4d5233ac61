"""Speed of the kernels on an array in memory: `python -m detect.bench.kernels SIDE ROUNDS`; prints seconds as JSON.

Reading the array once (numpy's sum, band by band) is the yardstick: nothing that looks at every value can be faster.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping

import numpy as np

from .processes import output_of
from .seas import tile
from .section import Cell, Effort, Number, Section, Table, timed

NIR = 6
ONCE = "read once (sum of each band)"
SLUGS = {
    "copy": "copy", "moments, numpy": "moments-numpy", "moments, compiled": "moments-compiled",
    "moments, numpy, uint16": "moments-uint16", "apply": "apply", "apply, where": "apply-where",
    "numpy.cov, float64": "numpy-cov",
}  # fmt: skip
OURS = ("moments-compiled", "moments-numpy", "moments-uint16", "apply", "apply-where")


def in_turns(jobs: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Wall seconds of each job, run in turns, after one run that does not count."""
    found: dict[str, list[float]] = {name: [] for name in jobs}
    for turn in range(rounds + 1):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            if turn:
                found[name].append(time.perf_counter() - start)
    return found


def jobs(side: int) -> dict[str, Callable[[], object]]:
    """What is timed: eight bands of float32, and of counts."""
    from deglint import remove
    from deglint.moments import moments

    block = tile(0, 0, side, (side, side))
    model = remove.fit("hedley", block[:, : side // 8, -side // 8 :], nir=NIR, correct=range(NIR))
    where = np.ones(block.shape[1:], np.bool_)
    where[::7, ::5] = False
    counts = (block / 1e-4).clip(0, 65535).astype(np.uint16)
    return {
        ONCE: lambda: [float(band.sum()) for band in block],
        "copy": lambda: block.copy(),
        "moments, numpy": lambda: moments(block),
        "moments, compiled": lambda: moments(block, compiled=True),
        "moments, numpy, uint16": lambda: moments(counts),
        "apply": lambda: remove.apply(block, model),
        "apply, where": lambda: remove.apply(block, model, where=where),
        "numpy.cov, float64": lambda: np.cov(block.reshape(8, -1).astype(np.float64)),
    }


def run(effort: Effort) -> Section:
    """A table of the kernels on one thread, in a process of its own."""
    side, rounds = (512, 3) if effort.quick else (2048, 5)
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    said = output_of([sys.executable, "-m", "detect.bench.kernels", str(side), str(rounds)],
                     environment=dict.fromkeys(names, "1"))  # fmt: skip
    found: dict[str, list[float]] = json.loads(said)
    numbers: dict[str, Number] = {}
    rows: list[tuple[Cell, ...]] = []
    for name, seconds in found.items():
        reads = timed([s / once for s, once in zip(seconds, found[ONCE], strict=True)], "",
                      "lower" if SLUGS.get(name) in OURS else "")  # fmt: skip
        if name in SLUGS:
            numbers[f"peers/kernels/{SLUGS[name]}/reads"] = reads
        rows.append((name, timed([1e3 * s for s in seconds], "ms"), reads, 8e-6 * side**2 / min(seconds)))
    head = ("", "wall time [ms]", "in reads of the array", "million values a second, best")
    note = f"One thread; 8 bands of {side} x {side} float32 in memory, {rounds} rounds."
    return Section("peers/kernels", "Kernels", tables=(Table.of("Kernels", head, rows, note),), numbers=numbers)


def main(side: int, rounds: int) -> None:
    """Print seconds."""
    json.dump(in_turns(jobs(side), rounds), sys.stdout)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
