"""What changed between two runs of `rxdetect bench`: `python -m benchmarks compare OLD.json NEW.json`.

A number is better or worse if its new interval does not overlap its old interval. A time must also change by more than
10 %, and times of different machines are not compared.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from deglint.readers.text import read_json
from detect.bench.numbers import Number

Verdict = Literal["worse", "slower", "better", "faster", "changed", "gone", "new"]
ORDER: tuple[Verdict, ...] = get_args(Verdict)
ROUNDING = 1e-6  # relative change below which a number is the same: other processors sum in another order
TIME_CHANGE = 0.1  # relative change above which a time is faster or slower


@dataclass(frozen=True)
class Change:
    """A number that differs between two runs, or that only one of them has."""

    name: str
    verdict: Verdict
    old: Number | None
    new: Number | None

    def __str__(self) -> str:
        return f"{self.verdict:8} {self.name}  {self.old or '-'} -> {self.new or '-'}"


def compare(old: Any, new: Any) -> list[Change]:
    """Changes between two runs, the worst first. A run is the content of a JSON file."""
    before, after = _numbers(old), _numbers(new)
    same_machine = _machine(old) == _machine(new)
    found = []
    for name in sorted(before.keys() | after.keys()):
        a, b = before.get(name), after.get(name)
        verdict: Verdict | None = "new" if a is None else "gone" if b is None else judge(a, b, same_machine)
        if verdict is not None:
            found.append(Change(name, verdict, a, b))
    return sorted(found, key=lambda c: (ORDER.index(c.verdict), c.name))


def judge(old: Number, new: Number, same_machine: bool = True) -> Verdict | None:
    """Verdict on a number; None if its change is not significant, or if its values cannot be compared."""
    if not new.exact and not same_machine:
        return None
    if math.isnan(old.value) or math.isnan(new.value):
        return None if math.isnan(old.value) and math.isnan(new.value) else "changed"
    moved = abs(new.value - old.value) / max(abs(old.value), abs(new.value), 1e-300)
    if moved <= (ROUNDING if new.exact else TIME_CHANGE):
        return None
    if not (new.low > old.high or new.high < old.low):  # intervals overlap, or there are none
        return "changed" if new.exact else None
    better = (new.value < old.value) == (new.better == "lower")
    if new.exact:
        return "better" if better else "worse"
    return "faster" if better else "slower"


def _machine(run: Mapping[str, Any]) -> Any:
    machine = dict(run["made"]["machine"])
    return machine.get("processor"), machine.get("cores")


def _numbers(run: Mapping[str, Any]) -> dict[str, Number]:
    return {name: _number(value) for name, value in run["numbers"].items()}


def _number(value: Mapping[str, Any]) -> Number:
    v, low, high = (math.nan if value[key] is None else float(value[key]) for key in ("value", "low", "high"))
    return Number(v, low, high, str(value["unit"]), value["better"], bool(value["exact"]))


def main(files: list[Path]) -> None:
    """Print the changes from the first to the second file; exit code 1 if a number got worse or slower, or is gone."""
    if len(files) != 2:
        raise SystemExit("compare takes two files: OLD.json NEW.json")
    found = compare(*(read_json(str(file), "run") for file in files))
    print("\n".join(map(str, found)) or "nothing changed beyond the intervals")
    if any(change.verdict in ("worse", "slower", "gone") for change in found):
        raise SystemExit(1)
