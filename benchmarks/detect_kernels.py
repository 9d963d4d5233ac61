"""Speed of RX on arrays in memory beside spectral and scikit-learn: `python -m benchmarks.detect_kernels`; prints JSON.

Every program gets the array in the order that it likes, (row, column, band) for the others; all run in turns.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from statistics import median

import numpy as np

from detect.local import local_rx
from detect.rx import rx

from .kernels import timed


def image(bands: int, side: int) -> np.ndarray:
    """Correlated normal bands, float32."""
    rng = np.random.default_rng(20)
    out = rng.standard_normal((bands, side, side), np.float32)
    out[1:] += out[:-1] * np.float32(0.9)
    out += np.float32(10)
    return out


def spectral_rx(cube: np.ndarray, **options: object) -> np.ndarray | str:
    """RX by spectral."""
    import spectral

    return spectral.rx(cube, **options)


def sklearn_rx(pixels: np.ndarray) -> np.ndarray:
    """RX by scikit-learn."""
    from sklearn.covariance import EmpiricalCovariance

    return EmpiricalCovariance().fit(pixels).mahalanobis(pixels)


def compare(title: str, jobs: dict[str, Callable[[], object]], rounds: int, pixels: int) -> list[list[str]]:
    """Rows: what, seconds best and median, nanoseconds a pixel, and how many times the first one's, round by round."""
    found = timed(jobs, rounds)
    ours = next(iter(found.values()))
    rows = []
    for name, seconds in found.items():
        ratio = median([s / o for s, o in zip(seconds, ours, strict=True)])
        best = f"{min(seconds):.3f} / {median(seconds):.3f}"
        rows.append([title, name, best, f"{min(seconds) / pixels * 1e9:.0f}", f"{ratio:.1f}"])
    return rows


def global_rx(bands: int, side: int, rounds: int) -> list[list[str]]:
    """Global RX, every pixel scored against all of them."""
    block = image(bands, side)
    cube = np.ascontiguousarray(block.transpose(1, 2, 0))
    pixels = cube.reshape(-1, bands)
    jobs = {
        "detect": lambda: rx(block),
        "detect, 2 threads": lambda: rx(block, threads=2),
        "scikit-learn": lambda: sklearn_rx(pixels),
        "spectral": lambda: spectral_rx(cube),
    }
    return compare(f"global, {bands} x {side}^2", jobs, rounds, side * side)


def local(bands: int, side: int, window: tuple[int, int], rounds: int, *, others: bool) -> list[list[str]]:
    """Local RX; spectral takes minutes, so it may be left out."""
    block = image(bands, side)
    jobs = {"detect": lambda: local_rx(block, inner=window[0], outer=window[1])}
    if others:
        cube = np.ascontiguousarray(block.transpose(1, 2, 0))
        jobs["spectral"] = lambda: spectral_rx(cube, window=window)
    return compare(f"local {window}, {bands} x {side}^2", jobs, rounds, side * side)


def first_call() -> str:
    """Processor seconds of the first local score in this process: loading the kernel, or compiling it."""
    start = time.process_time()
    local_rx(image(2, 16), inner=1, outer=3)
    return f"{time.process_time() - start:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--first", action="store_true", help="only what the first local score costs")
    given = parser.parse_args()
    if given.first:
        print(json.dumps(first_call()))
        return
    rounds = 1 if given.quick else 3
    rows = global_rx(8, 1024 if given.quick else 4096, rounds)
    rows += global_rx(200, 64 if given.quick else 256, rounds)
    rows += local(8, 48 if given.quick else 256, (5, 21), rounds, others=True)
    for window in ((3, 9), (5, 21), (9, 41)):
        rows += local(8, 128 if given.quick else 512, window, rounds, others=False)
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
