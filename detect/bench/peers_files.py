"""From file to file: removal and scoring beside a block copy, a whole array in numpy, and sensingpy."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from deglint.errors import DeglintError

from .processes import Command, Run, in_turns
from .seas import write_sea
from .section import Better, Cell, Effort, Number, Section, Table, timed

COPY, TWICE = "block copy", "read twice, write one band"
ALL_CPUS, RESULT = "block copy, compressing on all cores", "block copy of the result"
REMOVE, PLAIN, SCORE = "deglint remove", "deglint remove, hedley, window", "rxdetect score"
NUMPY, SENSINGPY = "whole array in numpy, hedley, window", "sensingpy, hedley, window"
SLUGS = {COPY: "copy", TWICE: "read-twice", REMOVE: "remove", PLAIN: "remove-hedley", SCORE: "score", NUMPY: "numpy",
         SENSINGPY: "sensingpy", ALL_CPUS: "copy-all-cores", RESULT: "copy-result"}  # fmt: skip
OURS = (REMOVE, PLAIN, SCORE)
Found = Mapping[str, list[Run] | str]


@dataclass(frozen=True)
class Case:
    """A synthetic scene: side [pixel], type, compression, bands."""

    side: int
    dtype: str = "float32"
    compress: str = ""
    bands: int = 8

    def __str__(self) -> str:
        return f"{self.bands} bands of {self.side} x {self.side}, {self.dtype}, {self.compress or 'uncompressed'}"

    @property
    def slug(self) -> str:
        """As a part of a number's name."""
        return "_".join(filter(None, (f"{self.bands}x{self.side}", self.dtype, self.compress)))

    @property
    def window(self) -> str:
        """A window of open water, as `--sample` takes it."""
        return f"{self.side // 2},{self.side // 4},{self.side // 8},{self.side // 8}"

    def make(self, path: Path) -> None:
        """Write it."""
        write_sea(path, self.side, dtype=self.dtype, compress=self.compress or None, bands=self.bands)

    def commands(self, scene: Path, out: Path, peers: str, threads: int | None = None) -> dict[str, Command]:
        """What is measured on it; other programs only where they do not fail on its type."""
        python, both = sys.executable, [str(scene), str(out)]
        told = [] if threads is None else ["--threads", str(threads)]
        remove = [python, "-m", "deglint", "remove", "-q", *told, *both]
        found: dict[str, Command] = {
            COPY: [python, "-m", "detect.bench.floor", "copy", *both],
            REMOVE: remove,
            PLAIN: [*remove, "--method", "hedley", "--sample", self.window, "--mask", "none", "--compensate", "off"],
        }
        if self.compress:
            found[ALL_CPUS] = [*found[COPY], "--all-cpus"]
            result = str(scene.with_name("result.tif"))
            found[RESULT] = [python, "-m", "detect.bench.floor", "copy", result, str(out)]
        if self.dtype == "float32" and self.bands == 8:
            found[NUMPY] = [python, "-I", others(), "numpy", *both, self.window]
            if peers:
                found[SENSINGPY] = [peers, "-I", others(), "sensingpy", *both, self.window]
        found[TWICE] = [python, "-m", "detect.bench.floor", "twice", *both]
        found[SCORE] = [python, "-m", "detect", "score", "-q", *told, *both]
        return found


def others() -> str:
    """The script that runs other programs."""
    return str(Path(__file__).with_name("others.py"))


def interpreter(asked: str) -> tuple[str, str]:
    """Interpreter that has sensingpy, or "", and its version or why there is none."""
    python = asked or sys.executable
    try:
        found = subprocess.run([python, "-I", others(), "--version", "sensingpy"], capture_output=True, text=True,
                               check=False)  # fmt: skip
    except OSError as error:
        return "", f"sensingpy is left out: cannot start {python} ({error.strerror})."
    if found.returncode:
        return "", ("sensingpy is not installed here and is left out; --peers PYTHON names an interpreter of an "
                    "environment that has it.")  # fmt: skip
    return python, found.stdout.strip()


def measure(case: Case, effort: Effort, rounds: int, commands: Mapping[str, Command], place: Path) -> Found:
    """Run everything on a scene in turns; the scene is made where it is not there yet.

    Raises
    ------
    DeglintError
        One that is not of other programs fails: there is nothing to compare with.
    """
    scene = place / f"{case.slug}.tif"
    if not scene.exists():
        case.make(scene)
    if RESULT in commands:  # corrected water compresses otherwise than glint
        in_turns({REMOVE: [sys.executable, "-m", "deglint", "remove", "-q", str(scene), str(place / "result.tif")]}, 1)
    found = in_turns(commands, rounds, [str(effort.directory / "out.tif*")])
    for name, runs in found.items():
        if isinstance(runs, str) and name not in (NUMPY, SENSINGPY):
            raise DeglintError(f"{name} failed on {case}: {runs}")
    return found


def beside(case: Case, effort: Effort, rounds: int, peers: str, place: Path) -> tuple[Section, Found]:
    """One scene: a table, and its numbers."""
    commands = case.commands(place / f"{case.slug}.tif", effort.directory / "out.tif", peers)
    found = measure(case, effort, rounds, commands, place)
    numbers: dict[str, Number] = {}
    rows: list[tuple[Cell, ...]] = []
    wrong = []
    for name, runs in found.items():
        if isinstance(runs, str):
            wrong.append(f"{name} failed: {runs}")
            continue
        own = of(name, runs, found)
        rows.append((name, own["ratio"], own["cpu"], own["wall"], own["peak"]))
        numbers |= {f"peers/files/{case.slug}/{SLUGS[name]}/{key}": number for key, number in own.items()}
    head = ("", "ratio to its floor", "processor time [s]", "wall time [s]", "peak memory [MB]")
    note = f"{rounds} rounds, everything once a round; input in the page cache, output on disk. "
    note += f"The floor of {SCORE} is: {TWICE}; of all else the block copy. Ratios of wall times within a round."
    table = Table.of(str(case), head, rows, " ".join([note, *wrong]))
    return Section(f"peers/files/{case.slug}", str(case), tables=(table,), numbers=numbers), found


def start_up(effort: Effort) -> Section:
    """What a run costs before any pixel."""
    python = sys.executable
    commands: dict[str, Command] = {
        "interpreter": [python, "-c", "pass"], "import numpy": [python, "-c", "import numpy"],
        "import rasterio": [python, "-c", "import rasterio"], "import deglint": [python, "-c", "import deglint"],
        "deglint --help": [python, "-m", "deglint", "--help"], "rxdetect --help": [python, "-m", "detect", "--help"],
    }  # fmt: skip
    found = in_turns(commands, 2 if effort.quick else 7)
    numbers: dict[str, Number] = {}
    rows: list[tuple[Cell, ...]] = []
    for name, runs in found.items():
        if not isinstance(runs, str):
            better: Better = "lower" if "deglint" in name or "rxdetect" in name else ""
            cpu = timed([r.cpu for r in runs], "s", better)
            numbers[f"peers/start/{name.replace(' ', '-')}/cpu"] = cpu
            rows.append((name, cpu, timed([r.wall for r in runs], "s"), max(r.peak for r in runs)))
    head = ("", "processor time [s]", "wall time [s]", "peak memory [MB]")
    return Section("peers/start", "Start-up", tables=(Table.of("Start-up", head, rows),), numbers=numbers)


def of(name: str, runs: list[Run], found: Found) -> dict[str, Number]:
    """Numbers of one program; which way is better is said of our own."""
    better: Better = "lower" if name in OURS else ""
    floor = found[TWICE if name in (SCORE, TWICE) else COPY]
    ratios = [a.wall / b.wall for a, b in zip(runs, floor, strict=True)] if not isinstance(floor, str) else []
    return {
        "ratio": timed(ratios, "", better) if ratios else Number(float("nan"), exact=False),
        "cpu": timed([r.cpu for r in runs], "s", better),
        "wall": timed([r.wall for r in runs], "s", better),
        "peak": timed([r.peak for r in runs], "MB", better),
    }  # fmt: skip
