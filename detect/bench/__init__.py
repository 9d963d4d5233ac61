"""The benchmark: run time against error, ROC against synthetic truth, skipping, and numerical stress.

Every experiment is a module with `run(effort) -> Section`; the table of them, the report and the comparison of two runs
stand beside them.
"""

EXPERIMENTS = {
    "thesis": "error against wind, delay and method, on scenes with truth",
    "roc": "objects found, before and after system effects",
    "effects": "noise, f-number, smear and delay, one at a time",
    "tradeoff": "run time against error",
    "skipping": "what a scene does not need, and what leaving it out saves",
    "stress": "digits that are right where numbers are hard",
    "peers": "speed and memory beside other programs, and how both grow",
}
"""Experiments in the order of the report, each a module of this package, and what `--help` says of it."""


def present() -> tuple[str, ...]:
    """Experiments that this installation has."""
    from importlib.util import find_spec

    return tuple(name for name in EXPERIMENTS if find_spec(f".{name}", __name__) is not None)
