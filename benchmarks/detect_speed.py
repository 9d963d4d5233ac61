"""Time and memory of `rxdetect score` and of the detectors beside other programs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from .speed import Case, clear
from .timing import ROOT, Command, in_turns, machine, rows_of, say

HEAD = ("", "wall min / median [s]", "ratio to reading twice, median (range)", "CPU [s]", "peak [MB]")
TWICE = "read twice, write one band"


def in_memory(quick: bool) -> None:
    """Arrays in memory, on one BLAS thread and on as many as BLAS takes."""
    head = ("", "", "wall min / median [s]", "ns a pixel", "times the time of detect")
    for threads in ("1", ""):
        asked = [sys.executable, "-m", "benchmarks.detect_kernels", *(["--quick"] if quick else [])]
        found = json.loads(_output(asked, threads))
        say(f"In memory, float32, BLAS threads: {threads or 'its own choice'}", head, found)


def first_call() -> None:
    """What compiling costs, once after installation, and loading what was compiled."""
    with tempfile.TemporaryDirectory() as cache:
        rows = []
        for what in ("compiled, once", "loaded, from then on"):
            asked = [sys.executable, "-m", "benchmarks.detect_kernels", "--first"]
            rows.append([what, json.loads(_output(asked, "1", NUMBA_CACHE_DIR=cache))])
    say("The first local score of a process", ("kernel", "CPU [s]"), rows)


def _output(command: Command, threads: str, **extra: str) -> str:
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    settings = {k: v for k, v in os.environ.items() if k not in names} | extra
    if threads:
        settings |= dict.fromkeys(names, threads)
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, env=settings)
    return done.stdout.splitlines()[-1]


def files(case: Case, place: Path, rounds: int) -> None:
    """From file to file."""
    scene, out = place / "scene.tif", place / "out.tif"
    case.make(scene)
    python = sys.executable
    score: Command = [python, "-m", "detect", "score", "-q", str(scene), str(out)]
    commands: dict[str, Command] = {
        TWICE: [python, "-m", "benchmarks.read_twice", str(scene), str(out)],
        "rxdetect score": score,
        "... --pfa 1e-4 --objects": [*score, "--pfa", "1e-4", "--objects", str(place / "out.tif.geojson")],
        "... --covariance mcd": [*score, "--covariance", "mcd"],
        "... --method local": [*score, "--method", "local"],
    }
    try:
        say(str(case), HEAD, rows_of(in_turns(commands, rounds, lambda: clear(place, "out.tif*")), TWICE))
    finally:
        clear(place, "*.tif*")


def main(quick: bool, directory: Path | None, rounds: int | None) -> None:
    """Measure and print everything."""
    print("## Speed of detection\n\n" + machine("numba", "spectral", "scikit-learn"))
    in_memory(quick)
    first_call()
    rounds = rounds or (1 if quick else 5)
    with tempfile.TemporaryDirectory(dir=directory) as name:
        for case in [Case(512)] if quick else [Case(512), Case(4096), Case(4096, "uint16", "deflate")]:
            files(case, Path(name), rounds)
