"""The command `python -m benchmarks NAME [--quick]`; `--help` lists the names."""

from __future__ import annotations

import argparse
from importlib import import_module
from inspect import signature
from pathlib import Path

BENCHMARKS = (
    "ablation", "choice", "compare", "depths", "detection", "docs", "error", "field", "peers", "pictures", "plan",
    "plan_figures", "rates", "scale", "size", "sparkle", "spreading", "stress", "targets", "uncertainty", "varied",
    "workers",
)  # fmt: skip
"""Modules that can be run by name. `main` of each gets those of the options below that it has parameters for."""


def main() -> None:
    """Run one benchmark and print its tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Measure deglint.",
        epilog="docs: writes docs/benchmark.md. Users compare removal methods by rxdetect bench.",
    )
    parser.add_argument("what", choices=BENCHMARKS)
    parser.add_argument("files", nargs="*", type=Path, help="compare: OLD.json and NEW.json of rxdetect bench")
    parser.add_argument("--quick", action="store_true", help="less of everything")
    parser.add_argument("--rounds", type=int, help="rates, plan: runs of everything; sparkle: seeds")
    parser.add_argument("--wind", type=float, default=9.0, help="sparkle, spreading: at 10 m [m/s]; 9 by default")
    parser.add_argument(
        "--directory",
        type=Path,
        help="rates, scale, workers: where scratch files go; detection: where the scenes lie; "
        "field: where the other programs lie; pictures, plan_figures: where they go, docs by default",
    )
    parser.add_argument("--docs", action="store_true", help="detection, field, scale, spreading: write into docs/, too")
    given = vars(parser.parse_args())
    run = import_module(f"benchmarks.{given['what']}").main
    run(**{name: value for name, value in given.items() if name in signature(run).parameters})


if __name__ == "__main__":
    main()
