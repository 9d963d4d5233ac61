"""`python -m benchmarks NAME [--quick]`; `--help` lists the names."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path

BENCHMARKS = {
    "ablation": ("ablation", ("quick",)),
    "alarms": ("alarms", ("directory",)),
    "away": ("away", ("quick",)),
    "choice": ("choice", ("quick",)),
    "detection": ("detection", ("directory", "docs")),
    "depths": ("depths", ()),
    "docs": ("docs", ("quick",)),
    "effects": ("effects", ("quick",)),
    "error": ("error", ("quick",)),
    "field": ("field", ("quick", "directory", "docs")),
    "targets": ("targets", ("quick",)),
    "uncertainty": ("uncertainty", ("quick",)),
    "peers": ("peers", ("quick",)),
    "pictures": ("pictures", ("directory",)),
    "rates": ("rates", ("quick", "rounds", "directory")),
    "plan": ("plan_speed", ("quick", "rounds")),
    "scale": ("scale", ("quick", "directory", "docs")),
    "ships": ("ships", ("directory",)),
    "size": ("size", ()),
    "stress": ("stress", ()),
    "wiener-pictures": ("wiener_pictures", ("directory",)),
    "workers": ("workers", ("quick", "directory")),
}
"""Module of each benchmark, and the options that its `main` takes."""


def main() -> None:
    """Run one benchmark and print its tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Measure deglint.",
        epilog="docs: writes docs/benchmark.md. Users compare removal methods by rxdetect bench.",
    )
    parser.add_argument("what", choices=list(BENCHMARKS))
    parser.add_argument("--quick", action="store_true", help="less of everything")
    parser.add_argument("--rounds", type=int, help="rates, plan: runs of everything")
    parser.add_argument(
        "--directory",
        type=Path,
        help="rates, scale, workers: where scratch files go; alarms, detection, ships: where the scenes lie; "
        "field: where the other programs lie; pictures, wiener-pictures: where they go, docs by default",
    )
    parser.add_argument("--docs", action="store_true", help="field, scale: write the pages of docs/, too")
    given = parser.parse_args()
    module, options = BENCHMARKS[given.what]
    import_module(f"benchmarks.{module}").main(*(getattr(given, option) for option in options))


if __name__ == "__main__":
    main()
