"""Processor time of RX in detect, scikit-learn and spectral, in memory: `python -m benchmarks peers [--quick]`."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.util import find_spec
from statistics import median

import numpy as np
import numpy.typing as npt
from sklearn.covariance import EmpiricalCovariance
from threadpoolctl import threadpool_limits

from detect.bench.numbers import short
from detect.global_rx import rx
from detect.local import local_rx

from .timing import in_turns, machine, say

Float32 = npt.NDArray[np.float32]
Window = tuple[int, int]
TIMED_WINDOW: Window = (5, 21)
"""Sides of the inner and outer windows of local RX [pixel]."""


def image(bands: int, side: int) -> Float32:
    """A random image (band, row, column) of normally distributed, correlated bands."""
    out = np.random.default_rng(20).standard_normal((bands, side, side), np.float32)
    for i in range(1, bands):
        out[i] += np.float32(0.9) * out[i - 1]
    return out + np.float32(10)


def jobs_of(block: Float32, window: Window | None) -> dict[str, Callable[[], object]]:
    """Functions of no argument that compute global RX, or local RX if there is a window, by the program's name."""
    cube = np.ascontiguousarray(block.transpose(1, 2, 0))
    jobs: dict[str, Callable[[], object]] = {}
    if window is None:
        pixels = cube.reshape(-1, len(block))
        jobs["detect"] = lambda: rx(block, threads=1)
        jobs["scikit-learn"] = lambda: EmpiricalCovariance().fit(pixels).mahalanobis(pixels)
    else:
        jobs["detect"] = lambda: local_rx(block, inner=window[0], outer=window[1], threads=1)
    if find_spec("spectral"):
        import spectral

        spectral.settings.show_progress = False
        jobs["spectral"] = lambda: spectral.rx(cube, window=window)
    return jobs


def rows(quick: bool) -> list[list[str]]:
    """Rows of the table, one for each array and program: processor time, and its ratio to that of detect."""
    tasks = (None, 8, 512 if quick else 2048), (None, 64, 128 if quick else 512), (TIMED_WINDOW, 8, 40 if quick else 96)
    out = []
    with threadpool_limits(1):
        for window, bands, side in tasks:
            found = in_turns(jobs_of(image(bands, side), window), 3, time.process_time)
            kind = "local RX, windows {} and {}".format(*window) if window else "global RX"
            for name, seconds in found.items():
                ratio = median(s / own for s, own in zip(seconds, found["detect"], strict=True))
                cost = short(1e9 * median(seconds) / (bands * side**2))
                out.append([f"{kind}, {bands} bands of {side} x {side}", name, cost, f"{ratio:.1f}"])
    return out


HEAD = ("", "program", "processor time [ns per value]", "times detect")
RX_NOTE = "float32 in memory, one thread, fit and score, median of 3 rounds in turns."


def main(quick: bool) -> None:
    """Print the table."""
    print("## Peers\n\n" + machine())
    say("RX beside other programs", HEAD, rows(quick), RX_NOTE)
