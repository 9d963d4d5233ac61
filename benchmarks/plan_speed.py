"""How long the planner takes: the reticle, its picture, the page's answer, and the command from start to end."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from .processes import in_turns

PLACE = ("--lat", "36.8", "--lon", "-122", "--time", "2026-06-21T18:00Z", "--wind", "7@310")
TARGETS = {"reticle": 100, "answer of the page": 200, "deglint plan -o plan.png": 2000}


def inside(rounds: int) -> dict[str, list[float]]:
    """Times within one process after a first call [ms]."""
    from deglint.plan import Mission, reticle
    from deglint.plan.draw import png
    from deglint.plan.picture import picture
    from deglint.plan.serve import answer

    mission = Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T18:00Z", wind=7.0, wind_from=310.0)
    plan = reticle(mission)
    steps = {
        "reticle": lambda: reticle(mission).combined,
        "picture": lambda: picture(plan),
        "picture as PNG": lambda: png(drawn),
        "answer of the page": lambda: answer(mission, {"wind": "7.5"}),
    }
    drawn = picture(plan)
    for step in steps.values():
        step()
    found: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(rounds):
        for name, step in steps.items():
            start = time.perf_counter()
            step()
            found[name].append(1e3 * (time.perf_counter() - start))
    return found


def main(quick: bool, rounds: int | None = None) -> None:
    """Print the table."""
    rounds = rounds or (2 if quick else 15)
    with tempfile.TemporaryDirectory() as directory:
        out = str(Path(directory) / "plan.png")
        command = [sys.executable, "-m", "deglint", "plan", *PLACE, "-o", out, "--overwrite", "-q"]
        angles = [
            sys.executable,
            "-m",
            "deglint",
            "plan",
            "--sun",
            "31@106",
            "--wind",
            "7@310",
            "-o",
            out,
            "--overwrite",
        ]
        runs = in_turns({"deglint plan -o plan.png": command, "the same, sun by angles": angles}, min(rounds, 7))
    found = inside(rounds) | {
        name: [1e3 * run.wall for run in got] for name, got in runs.items() if not isinstance(got, str)
    }
    print("361 x 81 viewing geometries of 1 degree, 8 bands, all masks; after a first call, but for the commands.")
    print(f"Load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.\n")
    print("| what | fastest / median [ms] | wanted [ms] |")
    print("|------|-----------------------|-------------|")
    for name, times in found.items():
        print(f"| {name} | {min(times):.0f} / {median(times):.0f} | {TARGETS.get(name, '')} |")
