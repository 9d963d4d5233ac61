"""`python -m benchmarks [NAME] [--quick]`; without a name all of `rxdetect bench`; `--help` lists the names."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path

from detect.bench import EXPERIMENTS

BENCHMARKS = {
    "away": ("away", ("quick",)),
    "depths": ("depths", ()),
    "error": ("error", ("quick",)),
    "targets": ("targets", ("quick",)),
    "uncertainty": ("uncertainty", ("quick", "those_that_set")),
    "compensation": ("compensation", ("quick",)),
    "rates": ("rates", ("quick", "rounds", "directory")),
    "plan": ("plan_speed", ("quick", "rounds")),
    "scale": ("scale", ("quick", "directory", "docs")),
    "ships": ("ships", ("directory",)),
    "stages": ("stages", ("quick",)),
    "wiener-pictures": ("wiener_pictures", ("directory",)),
    "workers": ("workers", ("quick", "directory")),
}
"""What is no experiment of `rxdetect bench`: module of each, and the options that its `main` takes."""


def bench(arguments: list[str]) -> int:
    """`rxdetect bench`: `report`, an experiment's name, `compare`, `docs`, or its options."""
    from detect.cli import run

    first, *rest = arguments or ["report"]
    if first == "report":
        return run(["bench", *rest])
    if first == "docs":
        return run(["bench", "--docs", "docs", *rest])
    if first in EXPERIMENTS:
        return run(["bench", "--only", first, *rest])
    return run(["bench", *arguments])


def main() -> None:
    """Run one benchmark and print its tables, or all experiments and write their report."""
    first = sys.argv[1] if len(sys.argv) > 1 else ""
    if first not in BENCHMARKS and first not in ("-h", "--help"):
        sys.exit(bench(sys.argv[1:]))
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Measure deglint.",
        epilog="Without a name, or with 'report': rxdetect bench. 'docs': the same, and remakes docs/benchmark.md. "
        f"'compare OLD.json NEW.json': what changed. {', '.join(EXPERIMENTS)}: these alone.",
    )  # fmt: skip
    parser.add_argument("what", choices=list(BENCHMARKS))
    parser.add_argument("--quick", action="store_true", help="less of everything")
    parser.add_argument("--rounds", type=int, help="rates, plan: runs of everything")
    parser.add_argument(
        "--directory",
        type=Path,
        help="rates, scale, workers: where scratch files go; ships: where the scenes lie; "
        "wiener-pictures: where they go, docs by default",
    )
    parser.add_argument("--docs", action="store_true", help="scale: write the picture and the tables of docs/, too")
    parser.add_argument(
        "--set",
        action="store_true",
        dest="those_that_set",
        help="uncertainty: the scenes that set its constants",
    )
    given = parser.parse_args()
    module, options = BENCHMARKS[given.what]
    import_module(f"benchmarks.{module}").main(*(getattr(given, option) for option in options))


if __name__ == "__main__":
    main()
