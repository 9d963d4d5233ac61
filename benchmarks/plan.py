"""How long does the planner take for a reticle, its picture, and an answer of the web page; and the whole command?"""

from __future__ import annotations

import sys
import tempfile
from statistics import median

from .processes import in_turns as processes_in_turns
from .timing import in_turns, machine, say

PLACE = ("--lat", "36.8", "--lon", "-122", "--time", "2026-06-21T18:00Z", "--wind", "7@310")


def inside(rounds: int) -> dict[str, list[float]]:
    """Times of the planner's functions in this process, by name [s]; a first call of each is not counted."""
    from deglint.plan import Mission, reticle
    from deglint.plan.draw import png
    from deglint.plan.picture import picture
    from deglint.plan.serve import answer

    mission = Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T18:00Z", wind=7.0, wind_from=310.0)
    plan = reticle(mission)
    drawn = picture(plan)
    return in_turns({
        "reticle": lambda: reticle(mission).combined,
        "picture": lambda: picture(plan),
        "picture as PNG": lambda: png(drawn),
        "answer of the page": lambda: answer(mission, {"wind": "7.5"}),
    }, rounds)  # fmt: skip


def commands(rounds: int) -> dict[str, list[float]]:
    """Wall times of whole commands `deglint plan`, by name [s]."""
    with tempfile.TemporaryDirectory() as directory:
        start = [sys.executable, "-m", "deglint", "plan", "-o", f"{directory}/plan.png", "--overwrite", "-q"]
        runs = processes_in_turns({
            "deglint plan -o plan.png": [*start, *PLACE],
            "the same, sun by angles": [*start, "--sun", "31@106", "--wind", "7@310"],
        }, rounds)  # fmt: skip
    return {name: [run.wall for run in found] for name, found in runs.items() if not isinstance(found, str)}


def main(quick: bool, rounds: int | None = None) -> None:
    """Print the table."""
    rounds = rounds or (2 if quick else 15)
    rows = []
    for name, times in (inside(rounds) | commands(min(rounds, 7))).items():
        rows.append([name, f"{1e3 * min(times):.0f} / {1e3 * median(times):.0f}"])
    note = "361 x 81 viewing geometries of 1 degree, 8 bands, all masks; after a first call, but for the commands."
    say("Planner", ("what", "fastest / median [ms]"), rows, f"{note}\n{machine()}")
