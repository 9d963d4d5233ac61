"""Measured numbers with their intervals, and the comparison of two runs of the benchmark.

A number is better or worse when its interval does not overlap the old one. A time must also move by more than 10 %, and
times of different machines are not compared.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import mean, median, stdev
from typing import Any, Literal, get_args

from deglint.errors import InputError

Better = Literal["lower", "higher"]
Verdict = Literal["worse", "slower", "better", "faster", "changed", "gone", "new"]
ORDER: tuple[Verdict, ...] = get_args(Verdict)
ROUNDING = 1e-6  # relative change below which a number is the same: other processors sum in another order
TIME_CHANGE = 0.1  # relative change above which a time is faster or slower


@dataclass(frozen=True)
class Number:
    """A measured number; its range is the 95 % interval of the mean over seeds, or that of repeated timings."""

    value: float
    low: float = math.nan  # of a single value
    high: float = math.nan
    unit: str = ""  # "%", "s", "ns", or "" for a ratio
    better: Better = "lower"
    exact: bool = True  # the same on every machine for the same seeds and versions; False for times

    def __str__(self) -> str:
        spread = "" if math.isnan(self.low) else f" ({short(self.low)}-{short(self.high)})"
        return short(self.value) + spread


def short(value: float) -> str:
    """A value with three digits, and no power of ten where it is large."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def over_seeds(values: Sequence[float], unit: str = "", better: Better = "lower", most: float = math.inf) -> Number:
    """Mean over seeds and its 95 % interval (Student's t), cut at 0 and at `most`, where the values cannot be."""
    from scipy.stats import t

    centre = mean(values)
    if len(values) < 2 or math.isnan(centre):
        return Number(centre, unit=unit, better=better)
    half = float(t.ppf(0.975, len(values) - 1)) * stdev(values) / math.sqrt(len(values))
    return Number(centre, max(centre - half, 0.0), min(centre + half, most), unit, better)


def timed(values: Sequence[float], unit: str = "s") -> Number:
    """Median of repeated timings and their range."""
    return Number(median(values), min(values), max(values), unit, exact=False)


@dataclass(frozen=True)
class Change:
    """A number that differs between two runs."""

    name: str
    verdict: Verdict
    old: Number | None
    new: Number | None

    def __str__(self) -> str:
        return f"{self.verdict:8} {self.name}  {self.old or '-'} -> {self.new or '-'}"


def as_json(numbers: Mapping[str, Number], made: Mapping[str, Any], refused: Mapping[str, str]) -> dict[str, Any]:
    """A run as plain values for JSON, with None for NaN."""
    from deglint.raster.output import plain

    values = {name: asdict(number) for name, number in numbers.items()}
    out: dict[str, Any] = plain({"made": made, "numbers": values, "refused": refused})
    return out


def compare(old: Any, new: Any) -> list[Change]:
    """Changes between two runs that were read from JSON, the worst first.

    Raises
    ------
    InputError
        One of them is not a run of the benchmark.
    """
    before, after = _numbers(old, "OLD.json"), _numbers(new, "NEW.json")
    same_machine = _machine(old) == _machine(new)
    found = []
    for name in sorted(before.keys() | after.keys()):
        a, b = before.get(name), after.get(name)
        verdict: Verdict | None = "new" if a is None else "gone" if b is None else judge(a, b, same_machine)
        if verdict is not None:
            found.append(Change(name, verdict, a, b))
    return sorted(found, key=lambda c: (ORDER.index(c.verdict), c.name))


def judge(old: Number, new: Number, same_machine: bool = True) -> Verdict | None:
    """Change of a number; None if it is not significant or not known."""
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


def _numbers(run: Any, name: str) -> dict[str, Number]:
    try:
        _machine(run)
        return {str(name): _number(value) for name, value in run["numbers"].items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{name} does not hold a benchmark: give the JSON file that rxdetect bench wrote.") from error


def _number(value: Mapping[str, Any]) -> Number:
    v, low, high = (math.nan if value[key] is None else float(value[key]) for key in ("value", "low", "high"))
    return Number(v, low, high, str(value["unit"]), value["better"], bool(value["exact"]))
