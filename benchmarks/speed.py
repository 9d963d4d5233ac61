"""Time and memory of `deglint remove`, beside a plain block copy of the same file and other programs."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from .timing import ROOT, Command, Run, in_turns, machine, rows_of, run_once, say

HEAD = ("", "wall min / median [s]", "ratio to the copy, median (range)", "CPU [s]", "peak [MB]")
COPY = "block copy"
REMOVE = "deglint remove"
PLAIN = "deglint remove, hedley, window, no mask"


@dataclass(frozen=True)
class Case:
    """A synthetic scene: side [pixel], type, compression, how its bands are laid out."""

    side: int
    dtype: str = "float32"
    compress: str = ""
    interleave: str = "pixel"

    def __str__(self) -> str:
        return f"8 x {self.side}^2 {self.dtype} {self.compress or 'uncompressed'}, {self.interleave} interleaved"

    def make(self, path: Path) -> None:
        """Write it."""
        options = ["--side", str(self.side), "--dtype", self.dtype, "--interleave", self.interleave]
        options += ["--compress", self.compress] if self.compress else []
        run_once([sys.executable, "-m", "benchmarks.scenes", str(path), *options])

    @property
    def window(self) -> str:
        """A window of open water, as `--sample` takes it."""
        return f"{self.side // 2},{self.side // 4},{self.side // 8},{self.side // 8}"

    def commands(self, scene: Path, out: Path, result: Path, peers: str | None) -> dict[str, Command]:
        """What is measured on it; `result` is the scene without glint, which compresses differently."""
        python, both = sys.executable, [str(scene), str(out)]
        found: dict[str, Command] = {COPY: [python, "-m", "benchmarks.block_copy", *both]}
        if self.compress:
            found["block copy, compressing on all cores"] = [*found[COPY], "--all-cpus"]
            found["block copy of the result"] = [python, "-m", "benchmarks.block_copy", str(result), str(out)]
        remove = [python, "-m", "deglint", "remove", "-q", *both]
        found[REMOVE] = remove
        found[PLAIN] = [*remove, "--method", "hedley", "--sample", self.window, "--mask", "none"]
        if peers and self.side <= 4096 and self.dtype == "float32":
            program = str(ROOT / "benchmarks" / "peers.py")
            found["whole array in numpy, hedley, window"] = [python, program, "numpy", *both, self.window]
            found[f"sensingpy {_installed(peers)}, hedley, window"] = [peers, program, "sensingpy", *both, self.window]
        return found


def _installed(peers: str) -> str:
    asked = [peers, str(ROOT / "benchmarks" / "peers.py"), "--version", "sensingpy"]
    found = subprocess.run(asked, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "(not installed)"


def cases(quick: bool) -> list[Case]:
    """What is measured."""
    small = [Case(2048), Case(2048, "uint16", "deflate"), Case(2048, "uint16", "zstd")]
    if quick:
        return [*small, Case(4096)]
    compressed = [Case(4096, "uint16", "deflate"), Case(4096, "uint16", "zstd")]
    return [*small, *compressed, Case(4096), Case(4096, interleave="band"), Case(8192)]


def measure(case: Case, directory: Path, rounds: int, peers: str | None) -> dict[str, list[Run] | str]:
    """Make a scene, run everything on it in turns, and take it away again."""
    scene, out, result = (directory / name for name in ("scene.tif", "out.tif", "result.tif"))
    case.make(scene)
    if case.compress:
        run_once([sys.executable, "-m", "deglint", "remove", "-q", str(scene), str(result)])
    try:
        return in_turns(case.commands(scene, out, result, peers), rounds, lambda: clear(directory, "out.tif*"))
    finally:
        clear(directory, "*.tif*")


def clear(directory: Path, pattern: str) -> None:
    """Remove the files of this pattern."""
    for left in directory.glob(pattern):
        left.unlink()


def start_up(directory: Path, rounds: int) -> None:
    """What a run costs before any pixel, and a small scene."""
    scene, out = directory / "small.tif", directory / "out.tif"
    Case(512).make(scene)
    python = sys.executable
    commands: dict[str, Command] = {
        "interpreter": [python, "-c", "pass"],
        "import numpy": [python, "-c", "import numpy"],
        "import rasterio": [python, "-c", "import rasterio"],
        "import deglint": [python, "-c", "import deglint"],
        "deglint --help": [python, "-m", "deglint", "--help"],
        "deglint remove --help": [python, "-m", "deglint", "remove", "--help"],
        "block copy, 8 x 512^2 float32": [python, "-m", "benchmarks.block_copy", str(scene), str(out)],
        "deglint remove, 8 x 512^2 float32": [python, "-m", "deglint", "remove", "-q", str(scene), str(out)],
    }

    in_turns(commands, 1, lambda: clear(directory, "out.tif*"))
    rows = rows_of(in_turns(commands, rounds, lambda: clear(directory, "out.tif*")), "interpreter")
    say("Start-up and a small scene, warm", ("", HEAD[1], "ratio to the interpreter", *HEAD[3:]), rows)


def kernels(quick: bool) -> None:
    """Arrays in memory."""
    asked = [sys.executable, "-m", "benchmarks.kernels", "--side", "1024" if quick else "2048"]
    found = json.loads(subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout)
    title = f"Kernels on one thread, {found['bands']} x {found['side']}^2 float32 in memory"
    say(title, ("", "Mpx-band/s, best / median", "time, in reads of the array"), found["rows"])


def main(quick: bool, directory: Path | None, rounds: int | None, peers: str | None) -> None:
    """Measure and print everything."""
    print("## Speed\n\n" + machine("numba"))
    rounds = rounds or (3 if quick else 7)
    print(f"\n{rounds} rounds, each running every command once; input in the page cache, output on disk.")
    kernels(quick)
    with tempfile.TemporaryDirectory(dir=directory) as name:
        place = Path(name)
        start_up(place, rounds)
        memory = []
        for case in cases(quick):
            found = measure(case, place, rounds, peers)
            say(str(case), HEAD, rows_of(found, COPY))
            if case.dtype == "float32" and case.interleave == "pixel":
                memory.append([str(case.side), *(_peak(found[name]) for name in (COPY, REMOVE, PLAIN))])
    say("Peak memory against scene size [MB], float32", ("side [pixel]", COPY, REMOVE, PLAIN), memory)


def _peak(runs: list[Run] | str) -> str:
    return runs if isinstance(runs, str) else f"{max(r.peak for r in runs):.0f}"
