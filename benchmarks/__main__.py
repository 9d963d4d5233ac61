"""`python -m benchmarks NAME [--quick]`; `--help` lists the names."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path

BENCHMARKS = {
    "speed": ("speed", ("quick", "directory", "rounds", "peers")),
    "error": ("error", ("quick",)),
    "digits": ("stress", ("quick",)),
    "targets": ("targets", ("quick",)),
    "uncertainty": ("uncertainty", ("quick",)),
    "compensation": ("compensation", ("quick",)),
    "plan": ("plan_speed", ("quick", "rounds")),
    "scale": ("scale", ("quick", "directory", "docs")),
    "detect": ("detect_speed", ("quick", "directory", "rounds")),
    "ships": ("ships", ("directory",)),
}
"""Module of each, and the options that its `main` takes."""


def main() -> None:
    """Run one benchmark and print its tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure deglint.")
    parser.add_argument("what", choices=list(BENCHMARKS))
    parser.add_argument("--quick", action="store_true", help="less of everything")
    parser.add_argument("--rounds", type=int, help="speed, plan, detect: runs of everything")
    parser.add_argument("--directory", type=Path,
                        help="speed, scale, detect: where scratch files go; ships: where the scenes lie")  # fmt: skip
    parser.add_argument("--docs", action="store_true", help="scale: write the picture and the tables of docs/, too")
    parser.add_argument("--peers", default=sys.executable, metavar="PYTHON",
                        help="speed: interpreter of an environment in which sensingpy is installed")  # fmt: skip
    given = parser.parse_args()
    module, options = BENCHMARKS[given.what]
    import_module(f"benchmarks.{module}").main(*(getattr(given, option) for option in options))


if __name__ == "__main__":
    main()
