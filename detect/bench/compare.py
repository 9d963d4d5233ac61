"""What changed from one benchmark to another, beyond noise.

A number with an interval is better or worse when the two intervals do not overlap. A number without one that is the
same on any machine has no noise: it is better or worse when it moves by more than a tenth. Any smaller move of such
numbers, beyond rounding, is a change. A time or memory must lie outside the other's range, and by more than a tenth.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from deglint.errors import InputError

from .section import Number

Verdict = Literal["worse", "slower", "better", "faster", "changed", "gone", "new", "same", "left out"]
SHOWN: tuple[Verdict, ...] = ("worse", "slower", "better", "faster", "changed", "gone", "new")
"""Verdicts that are listed, in this order."""
ROUNDING, MARGIN = 1e-6, 0.1
"""Relative changes: below the first it is rounding; times and numbers without an interval must change by the second."""


@dataclass(frozen=True)
class Run:
    """A benchmark that was read back.

    Attributes
    ----------
    name : str
        Of its file.
    made : dict
    numbers : dict of Number
        A value that was not finite is NaN.
    failed : dict of str to str
    """

    name: str
    made: dict[str, Any]
    numbers: dict[str, Number]
    failed: dict[str, str]

    @classmethod
    def of(cls, name: str, data: Any) -> Run:
        """From JSON.

        Raises
        ------
        InputError
            It is not a benchmark's.
        """
        try:
            numbers = {str(key): _number(value) for key, value in data["numbers"].items()}
            made, failed = dict(data["made"]), {str(k): str(v) for k, v in data["failed"].items()}
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"{name} does not hold the numbers of a benchmark. Give the JSON file that rxdetect bench "
                             "wrote.") from error  # fmt: skip
        return cls(name, made, numbers, failed)


def _number(value: Mapping[str, Any]) -> Number:
    v, low, high = (math.nan if value[k] is None else float(value[k]) for k in ("value", "low", "high"))
    return Number(v, str(value["unit"]), low, high, value["better"], bool(value["exact"]))


@dataclass(frozen=True)
class Change:
    """One number that is not as it was; `size` is the change over the larger of both, 0 to 2."""

    name: str
    verdict: Verdict
    old: Number | None
    new: Number | None
    size: float = 0.0


@dataclass(frozen=True)
class Comparison:
    """What changed, the largest first; what must be known to read it; and how many numbers each verdict got.

    `failed` names experiments that went well in the old one and not in the new one.
    """

    changes: tuple[Change, ...]
    notes: tuple[str, ...]
    counts: dict[Verdict, int]
    failed: tuple[str, ...] = ()

    def fails(self, on: Literal["worse", "changed"]) -> bool:
        """Whether something got worse or slower or went missing; or, with "changed", anything that was there moved."""
        bad = {"worse", "slower", "gone"} | ({"changed", "better", "faster"} if on == "changed" else set())
        return bool(self.failed) or any(change.verdict in bad for change in self.changes)


def compare(old: Run, new: Run) -> Comparison:
    """Every number of both."""
    same_machine, same_scenes = _machine(old) == _machine(new), _scenes(old) == _scenes(new)
    changes, counts = [], dict.fromkeys((*SHOWN, "same", "left out"), 0)
    for name in sorted(n for n in old.numbers.keys() | new.numbers.keys() if _both_ran(n, old, new)):
        a, b = old.numbers.get(name), new.numbers.get(name)
        if a is None or b is None:
            verdict: Verdict = "new" if a is None else "gone"
        else:
            verdict = judge(a, b, same_machine=same_machine, same_scenes=same_scenes)
        counts[verdict] += 1
        if verdict in SHOWN:
            changes.append(Change(name, verdict, a, b, 0.0 if a is None or b is None else moved(a.value, b.value)))
    changes.sort(key=lambda c: (SHOWN.index(c.verdict), -c.size, c.name))
    failed = tuple(sorted(new.failed.keys() - old.failed.keys()))
    return Comparison(tuple(changes), tuple(_notes(old, new, counts["left out"])), counts, failed)


def _both_ran(number: str, old: Run, new: Run) -> bool:
    """Whether the experiment of a number was asked for, and went well, in both."""
    name = number.partition("/")[0]
    return all(name in run.made.get("experiments", (name,)) and name not in run.failed for run in (old, new))


def judge(old: Number, new: Number, *, same_machine: bool = True, same_scenes: bool = True) -> Verdict:
    """What became of a number.

    Parameters
    ----------
    old, new : Number
    same_machine : bool
        Times and memory of different machines are left out; ratios (no unit) are not.
    same_scenes : bool
        Scenes and seeds are the same; of others, only what lies apart is told.
    """
    if not new.exact and new.unit and not same_machine:
        return "left out"
    if old.unit != new.unit or math.isnan(old.value) != math.isnan(new.value):
        return "changed"
    size = moved(old.value, new.value)
    if math.isnan(old.value) or size <= ROUNDING:
        return "same"
    ranged = not any(math.isnan(v) for v in (old.low, old.high, new.low, new.high))
    apart = ranged and (new.low > old.high or new.high < old.low)
    if new.exact:
        if apart or (not ranged and same_scenes and size > MARGIN):
            return _direction(old, new)
        return "changed" if same_scenes else "same"
    if size <= MARGIN:
        return "same"
    if ranged:
        return _direction(old, new) if apart else "same"
    return "changed"


def moved(old: float, new: float) -> float:
    """Change over the larger of both: 0.5 for twice or half as much, above 1 where the sign changed."""
    return 0.0 if old == new else abs(new - old) / max(abs(old), abs(new))


def _direction(old: Number, new: Number) -> Verdict:
    if not new.better:
        return "changed"
    good = (new.value < old.value) == (new.better == "lower")
    if not new.exact and re.match(r"(n|u|µ|m)?s\b|min\b|.*/s$", new.unit):
        return "faster" if good else "slower"
    return "better" if good else "worse"


def _machine(run: Run) -> tuple[Any, ...]:
    machine = run.made.get("machine") or {}
    return machine.get("processor"), machine.get("cores")


def _scenes(run: Run) -> tuple[Any, ...]:
    return run.made.get("quick"), run.made.get("seeds")


def _notes(old: Run, new: Run, left_out: int) -> list[str]:
    """What must be known before any number is believed."""
    out = []
    for said, run in (("old", old), ("new", new)):
        made = run.made
        processor, cores = _machine(run)
        effort = "quick" if made.get("quick") else "full"
        out.append(f"{said}: {run.name}, {made.get('date', 'no date')}, deglint "
                   f"{(made.get('versions') or {}).get('deglint', '?')}, {processor}, {cores} cores, {effort}, "
                   f"seeds {made.get('seeds', '?')}")  # fmt: skip
    for said, run in (("old", old), ("new", new)):
        machine = run.made.get("machine") or {}
        loads = [
            load for when in ("start", "end") if isinstance(load := machine.get(f"load at the {when}"), (int, float))
        ]
        if loads and max(loads) > (machine.get("cores") or 1):
            out.append(f"{said} ran on a busy machine (load {max(loads):g}): what is said of times may be chance")
    if _machine(old) != _machine(new):
        out.append(f"the machines differ: {left_out} times and sizes of memory are left out; ratios are compared")
    if _scenes(old) != _scenes(new):
        out.append("the scenes differ (--quick, --seeds): only numbers whose intervals lie apart are told")
    before, after = (run.made.get("versions") or {} for run in (old, new))
    differ = [f"{k} {before.get(k, 'none')} -> {after.get(k, 'none')}"
              for k in sorted(before.keys() | after.keys()) if before.get(k) != after.get(k)]  # fmt: skip
    out += [f"versions differ: {', '.join(differ)}"] if differ else []
    out += [f"{name} failed in {said}: {why}" for said, run in (("old", old), ("new", new))
            for name, why in run.failed.items()]  # fmt: skip
    for said, run, other in (("old", old, new), ("new", new, old)):
        alone = [n for n in run.made.get("experiments", ()) if n not in other.made.get("experiments", (n,))]
        out += [f"only {said} ran {', '.join(alone)}: not compared"] if alone else []
    return out
