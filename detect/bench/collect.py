"""Run experiments one after another; one that fails does not lose the others."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from deglint.raster.output import plain

from .section import Effort, Number, Section


@dataclass(frozen=True)
class Collected:
    """What experiments gave.

    Attributes
    ----------
    sections : tuple of Section
        Of those that did not fail, in their order.
    failed : dict of str to str
        Why the others did, in a line.
    seconds : dict of str to float
        Wall time of each [s].
    traces : dict of str to str
        Where the failed ones failed.
    """

    sections: tuple[Section, ...]
    failed: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    traces: dict[str, str] = field(default_factory=dict)

    def numbers(self) -> dict[str, Number]:
        """Every number; each name begins with its experiment's."""
        return {
            name if name.startswith(f"{section.name}/") else f"{section.name}/{name}": number
            for section in self.sections
            for name, number in section.every_number().items()
        }


def collect(
    names: Sequence[str], effort: Effort, before: Callable[[str], None], after: Callable[[str, float, str], None]
) -> Collected:
    """Run experiments.

    Parameters
    ----------
    names : sequence of str
        Of `EXPERIMENTS`.
    effort : Effort
    before : callable
        Called with an experiment's name when it starts.
    after : callable
        Called with its name, the seconds it took, and the line it failed with, if any.
    """
    sections, failed, seconds, traces = [], {}, {}, {}
    for name in names:
        before(name)
        start = time.perf_counter()
        try:
            sections.append(import_module(f".{name}", __package__).run(effort))
        except Exception as error:  # noqa: BLE001  (whatever it is: hours of other experiments must not be lost by it)
            failed[name] = line_of(error)
            traces[name] = traceback.format_exc()
        seconds[name] = time.perf_counter() - start
        after(name, seconds[name], failed.get(name, ""))
    return Collected(tuple(sections), failed, seconds, traces)


def line_of(error: Exception) -> str:
    """What went wrong, in a line."""
    said = " ".join(str(error).split())
    if isinstance(error, ModuleNotFoundError):
        return f"{said}. Install what the benchmark needs: pip install 'deglint[bench]'"
    return f"{type(error).__name__}: {said}" if said else type(error).__name__


def as_json(found: Collected, made: Mapping[str, Any]) -> dict[str, Any]:
    """Every number as JSON has it: NaN and infinity are None."""
    keys = ("value", "low", "high", "unit", "better", "exact")
    numbers = {name: {key: getattr(n, key) for key in keys} for name, n in found.numbers().items()}
    out: dict[str, Any] = plain({"made": made, "numbers": numbers, "failed": found.failed})
    return out
