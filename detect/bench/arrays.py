"""RX on arrays in memory, ours and other programs': `python -m detect.bench.arrays`, tasks as JSON on stdin.

A process of its own, so that threads of BLAS and peak memory are what the caller asked for. Every program gets the
array in the order that it likes; all run in turns. Prints, for every task, seconds by program, or bytes.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Float32 = npt.NDArray[np.float32]
Job = Callable[[], object]
OURS, SKLEARN, SPECTRAL = "detect", "scikit-learn", "spectral"


@dataclass(frozen=True)
class Task:
    """What is to be measured.

    Attributes
    ----------
    bands, side : int
        Of the array.
    programs : tuple of str
    rounds : int
        Of all programs in turns; 0: the memory that one of them takes.
    window : (int, int), optional
        Inner and outer window of local RX; global RX without.
    """

    bands: int
    side: int
    programs: tuple[str, ...]
    rounds: int
    window: tuple[int, int] | None = None

    def __str__(self) -> str:
        kind = f"local, window {self.window[0]}, {self.window[1]}" if self.window else "global"
        return f"{kind}, {self.bands} bands of {self.side} x {self.side}"

    @property
    def slug(self) -> str:
        """As a part of a number's name."""
        kind = f"local{self.window[0]}-{self.window[1]}" if self.window else "global"
        return f"{kind}_{self.bands}x{self.side}"


def image(bands: int, side: int) -> Float32:
    """Correlated normal bands, float32."""
    rng = np.random.default_rng(20)
    out = np.empty((bands, side, side), np.float32)
    for i, band in enumerate(out):
        rng.standard_normal(dtype=np.float32, out=band)
        if i:
            band += out[i - 1] * np.float32(0.9)
    out += np.float32(10)
    return out


def ours(block: Float32, window: tuple[int, int] | None, threads: int) -> object:
    """RX by this package."""
    from detect.local import local_rx
    from detect.rx import rx

    if window is None:
        return rx(block, threads=threads)
    return local_rx(block, inner=window[0], outer=window[1], threads=threads)


def by_spectral(cube: Float32, window: tuple[int, int] | None) -> object:
    """RX by spectral, (row, column, band)."""
    import spectral

    return spectral.rx(cube) if window is None else spectral.rx(cube, window=window)


def by_sklearn(pixels: Float32) -> object:
    """RX by scikit-learn, (pixel, band)."""
    from sklearn.covariance import EmpiricalCovariance

    return EmpiricalCovariance().fit(pixels).mahalanobis(pixels)


def jobs(task: Task) -> dict[str, Job]:
    """What each program is to do."""
    block = image(task.bands, task.side)
    cube = block
    if any(not p.startswith(OURS) for p in task.programs):
        cube = np.ascontiguousarray(block.transpose(1, 2, 0))
    pixels = cube.reshape(-1, task.bands)
    out: dict[str, Job] = {}
    for program in task.programs:
        if program == SPECTRAL:
            out[program] = lambda: by_spectral(cube, task.window)
        elif program == SKLEARN:
            out[program] = lambda: by_sklearn(pixels)
        else:
            threads = int(program.split(",")[1].split()[0]) if "," in program else 1
            out[program] = lambda threads=threads: ours(block, task.window, threads)  # type: ignore[misc]
    return out


def seconds(task: Task) -> dict[str, list[float]]:
    """Wall time of every program, round by round, after one that does not count."""
    todo = jobs(task)
    found: dict[str, list[float]] = {name: [] for name in todo}
    for turn in range(task.rounds + 1):
        for name, job in todo.items():
            start = time.perf_counter()
            job()
            if turn:
                found[name].append(time.perf_counter() - start)
    return found


def memory(task: Task) -> float | None:
    """What one program takes beside its input [MB]; None where the system does not tell."""
    (small,) = jobs(Task(task.bands, max(24, 2 * (task.window or (0, 0))[1]), task.programs, 0, task.window)).values()
    small()  # libraries and kernels are loaded
    (job,) = jobs(task).values()
    try:
        Path("/proc/self/clear_refs").write_text("5")  # the highest mark so far is now what is held now
        before = _high()
        job()
        return _high() - before
    except OSError:
        return None


def _high() -> float:
    """Largest resident memory since the mark was set [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024 / 1e6


def measured(tasks: list[Task], threads: int = 1) -> list[Any]:
    """Do tasks in a process of its own, BLAS limited to so many threads."""
    from .processes import output_of

    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    said = output_of([sys.executable, "-m", "detect.bench.arrays"], json.dumps([asdict(task) for task in tasks]),
                     dict.fromkeys(names, str(threads)))  # fmt: skip
    found: list[Any] = json.loads(said)
    return found


def _task(asked: Mapping[str, Any]) -> Task:
    window = asked["window"]
    return Task(asked["bands"], asked["side"], tuple(asked["programs"]), asked["rounds"],
                None if window is None else (window[0], window[1]))  # fmt: skip


def main() -> None:
    """Do what stdin says."""
    tasks = [_task(one) for one in json.load(sys.stdin)]
    json.dump([seconds(task) if task.rounds else memory(task) for task in tasks], sys.stdout)


if __name__ == "__main__":
    main()
