"""`python -m benchmarks speed|error|digits|targets [--quick]`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def main() -> None:
    """Run one benchmark and print its tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure deglint.")
    parser.add_argument("what", choices=["speed", "error", "digits", "targets", "compensation"])
    parser.add_argument("--quick", action="store_true", help="less of everything")
    parser.add_argument("--rounds", type=int, help="speed: runs of every command")
    parser.add_argument("--directory", type=Path, help="speed: where scratch files go")
    parser.add_argument("--peers", default=sys.executable, metavar="PYTHON",
                        help="speed: interpreter of an environment in which sensingpy is installed")  # fmt: skip
    given = parser.parse_args()
    if given.what == "speed":
        from .speed import main as speed

        speed(given.quick, given.directory, given.rounds, given.peers)
    elif given.what == "error":
        from .error import main as error

        error(given.quick)
    elif given.what == "targets":
        from .targets import main as targets

        targets(given.quick)
    elif given.what == "compensation":
        from .compensation import main as compensation

        compensation(given.quick)
    else:
        from .digits import main as digits

        digits(given.quick)


if __name__ == "__main__":
    main()
