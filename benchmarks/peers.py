"""Processor time of RX on arrays in memory beside scikit-learn and spectral: `python -m benchmarks peers [--quick]`."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.util import find_spec
from statistics import median

import numpy as np
import numpy.typing as npt
from threadpoolctl import threadpool_limits

from detect.bench.compare import short
from detect.local import local_rx
from detect.rx import rx

from .timing import in_turns, machine, say

Float32 = npt.NDArray[np.float32]
WINDOW = (5, 21)
"""Inner and outer window of local RX [pixel]."""


def image(bands: int, side: int) -> Float32:
    """Correlated normal bands."""
    out = np.random.default_rng(20).standard_normal((bands, side, side), np.float32)
    for i in range(1, bands):
        out[i] += np.float32(0.9) * out[i - 1]
    return out + np.float32(10)


def global_jobs(block: Float32) -> dict[str, Callable[[], object]]:
    """Global RX by every program, each with the array in the order that it likes."""
    from sklearn.covariance import EmpiricalCovariance

    cube = np.ascontiguousarray(block.transpose(1, 2, 0))
    pixels = cube.reshape(-1, len(block))
    jobs: dict[str, Callable[[], object]] = {
        "detect": lambda: rx(block, threads=1),
        "scikit-learn": lambda: EmpiricalCovariance().fit(pixels).mahalanobis(pixels),
    }
    if find_spec("spectral"):
        import spectral

        jobs["spectral"] = lambda: spectral.rx(cube)
    return jobs


def local_jobs(block: Float32) -> dict[str, Callable[[], object]]:
    """Local RX by every program that has it."""
    cube = np.ascontiguousarray(block.transpose(1, 2, 0))
    jobs: dict[str, Callable[[], object]] = {
        "detect": lambda: local_rx(block, inner=WINDOW[0], outer=WINDOW[1], threads=1)
    }
    if find_spec("spectral"):
        import spectral

        spectral.settings.show_progress = False
        jobs["spectral"] = lambda: spectral.rx(cube, window=WINDOW)
    return jobs


def rows(quick: bool) -> list[list[str]]:
    """One row for each program and array: time, and ratio to the time of detect in the same round."""
    tasks = [(global_jobs, 8, 512 if quick else 2048), (global_jobs, 64, 128 if quick else 512),
             (local_jobs, 8, 40 if quick else 96)]  # fmt: skip
    out = []
    with threadpool_limits(1):
        for jobs, bands, side in tasks:
            found = in_turns(jobs(image(bands, side)), 3, time.process_time)
            kind = "global RX" if jobs is global_jobs else f"local RX, windows {WINDOW[0]} and {WINDOW[1]}"
            for name, seconds in found.items():
                ratio = median(s / own for s, own in zip(seconds, found["detect"], strict=True))
                cost = short(1e9 * median(seconds) / (bands * side**2))
                out.append([f"{kind}, {bands} bands of {side} x {side}", name, cost, f"{ratio:.1f}"])
    return out


HEAD = ("", "program", "processor time [ns per value]", "times detect")
NOTE = "float32 in memory, one thread, fit and score, median of 3 rounds in turns."


def main(quick: bool) -> None:
    """Print the table."""
    print("## Peers\n\n" + machine())
    say("RX beside other programs", HEAD, rows(quick), NOTE)
