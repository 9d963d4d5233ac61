"""Speed of the kernels on an array in memory: `python -m benchmarks.kernels --side 2048`; prints JSON.

Reading the array once (numpy's sum, band by band) is the yardstick: nothing that looks at every value can be faster.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from statistics import median

import numpy as np

from deglint import remove
from deglint.moments import moments

from .scenes import NAMES, tile

NIR = 6


def timed(jobs: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Seconds of each job, run in turns, after one run that does not count."""
    found: dict[str, list[float]] = {name: [] for name in jobs}
    for turn in range(rounds + 1):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            if turn:
                found[name].append(time.perf_counter() - start)
    return found


def rates(values: int, seconds: list[float]) -> str:
    """Millions of values a second, best and median, as text."""
    return f"{values / 1e6 / min(seconds):.0f} / {values / 1e6 / median(seconds):.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--side", type=int, default=2048)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    block = tile(0, 0, given.side, (given.side, given.side))
    model = remove.fit("hedley", block[:, :256, -256:], nir=NIR, correct=range(NIR))
    where = np.ones(block.shape[1:], np.bool_)
    where[::7, ::5] = False
    counts = (block / 1e-4).clip(0, 65535).astype(np.uint16)
    jobs = {
        "read once (sum of each band)": lambda: [float(band.sum()) for band in block],
        "copy": lambda: block.copy(),
        "moments, numpy": lambda: moments(block),
        "moments, compiled": lambda: moments(block, compiled=True),
        "moments, numpy, uint16": lambda: moments(counts),
        "apply": lambda: remove.apply(block, model),
        "apply, where": lambda: remove.apply(block, model, where=where),
        "numpy.cov, float64": lambda: np.cov(block.reshape(8, -1).astype(np.float64)),
    }
    found = timed(jobs, given.rounds)
    once = median(found["read once (sum of each band)"])
    rows = [[name, rates(block.size, s), f"{median(s) / once:.1f}"] for name, s in found.items()]
    print(json.dumps({"bands": len(NAMES), "side": given.side, "rows": rows}))


if __name__ == "__main__":
    main()
