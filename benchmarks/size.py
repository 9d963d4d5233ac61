"""Lines of Python in each room (group of packages) and its limit, and modules and functions that are too large.

Run it by `python -m benchmarks size`. Lines are counted as by `wc -l`: blank lines and comments count.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .timing import ROOT, say

MODULE, FUNCTION, PARAMETERS = 400, 60, 7
"""Most lines of a module, most lines of a function, and most parameters of a function."""
TOTAL = 30_000
"""Most lines of deglint and detect together."""
GOALS: dict[str, tuple[tuple[str, ...], int]] = {
    "foundations": (("deglint/errors", "deglint/scene", "deglint/moments", "deglint/tiles", "deglint/cluster"), 900),
    "physics": (("deglint/physics",), 3700),
    "sensors": (("deglint/sensors",), 450),
    "raster, readers": (("deglint/raster", "deglint/readers"), 4500),
    "masks": (("deglint/masks",), 900),
    "remove": (("deglint/remove",), 2000),
    "compensate": (("deglint/compensate",), 2500),
    "choose": (("deglint/choose",), 900),
    "pipeline, batch": (("deglint/pipeline", "deglint/batch"), 2200),
    "plan, simulate": (("deglint/plan", "deglint/simulate"), 3800),
    "xr, report, info, cli": (("deglint/xr", "deglint/report", "deglint/info", "deglint/cli"), 1700),
    "detect": (("detect",), 5500),
    "detect/bench": (("detect/bench",), 800),
    "benchmarks (not in the wheel)": (("benchmarks",), 4000),
}
"""Rooms by name: the modules and packages in each, and the most lines that they should have together."""
REST = "deglint, the rest"


def modules(root: Path = ROOT) -> dict[str, str]:
    """Text of every module of deglint, detect and benchmarks, by path."""
    paths = (p for folder in ("deglint", "detect", "benchmarks") for p in sorted((root / folder).rglob("*.py")))
    return {p.relative_to(root).as_posix(): p.read_text(encoding="utf-8") for p in paths}


def room_of(path: str) -> str:
    """Room of a module. If several rooms hold it, that with the longest package name; if none does, `REST`."""
    own = path.removesuffix(".py")
    fits = [(len(part), room) for room, (parts, _) in GOALS.items() for part in parts
            if own == part or own.startswith(f"{part}/")]  # fmt: skip
    return max(fits)[1] if fits else REST


def functions(text: str) -> Iterator[tuple[str, int, int, int]]:
    """Name, lines, lines without the docstring, and number of parameters (self and cls apart) of every function."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            named = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
            count = len(named) - (named[:1] in (["self"], ["cls"]))
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            first = node.body[0]
            documented = ast.get_docstring(node) is not None
            yield node.name, lines, lines - documented * ((first.end_lineno or 0) - first.lineno + 1), count


def sizes(found: dict[str, str]) -> dict[str, int]:
    """Number of lines in every room, given the modules by path."""
    out = dict.fromkeys((*GOALS, REST), 0)
    for path, text in found.items():
        out[room_of(path)] += text.count("\n")
    return out


def too_large(found: dict[str, str]) -> list[tuple[str, tuple[str, ...], list[list[str]]]]:
    """Title, head and rows of tables of modules and functions of deglint and detect that are too large."""
    product = {path: text for path, text in found.items() if not path.startswith("benchmarks/")}
    long = [(text.count("\n"), path) for path, text in product.items() if text.count("\n") > MODULE]
    every = [(f"{path}: {name}", *counts) for path, text in product.items() for name, *counts in functions(text)]
    deep = [(lines, bare, name) for name, lines, bare, _ in every if lines > FUNCTION]
    wide = [(count, name) for name, _, _, count in every if count > PARAMETERS]
    return [
        (f"Modules above {MODULE} lines", ("", "lines"), _rows(long)),
        (f"Functions above {FUNCTION} lines", ("", "lines", "without docstring"), _rows(deep)),
        (f"Functions with more than {PARAMETERS} parameters", ("", "parameters"), _rows(wide)),
    ]


def _rows(found: list[Any]) -> list[list[str]]:
    return [[name, *map(str, numbers)] for *numbers, name in sorted(found, reverse=True)]


def main() -> None:
    """Print the tables."""
    found = modules()
    counted = sizes(found)
    total = sum(n for room, n in counted.items() if not room.startswith("benchmarks"))
    limits = {room: goal for room, (_, goal) in GOALS.items()} | {"deglint and detect": TOTAL}
    rows = []
    for room, lines in (counted | {"deglint and detect": total}).items():
        goal = limits.get(room)
        over = "" if goal is None or lines <= goal else f"{lines - goal:,}"
        rows.append([room, f"{lines:,}", "" if goal is None else f"{goal:,}", over])
    say("Lines of Python", ("room", "lines", "goal", "too many"), rows)
    for title, head, large in too_large(found):
        say(f"{title}: {len(large)}", head, large)
