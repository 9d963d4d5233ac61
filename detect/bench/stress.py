"""Numerical stress: how many digits are right, operation by operation, on pixels that are hard in one way each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.util import find_spec

import numpy as np

from detect.report.heat import heat

from . import stress_certified, stress_ours, stress_peers, stress_rates, stress_truth
from .section import Cell, Effort, Figure, Number, Section, Table
from .stress_cases import Case, cases
from .stress_words import finding, paragraphs

LARGEST = 100_000_000
"""Pixels of the scene that is streamed, in full."""
OPERATIONS = (
    "mean", "variance", "covariance", "slope, ols", "slope, Lyzenga", "slope, detrended", "slope, Theil-Sen",
    "slope, Huber", "level, minimum", "level, percentile", "level, mode", "correction", "correction, as stored",
    "NIR subtraction", "RX", "local RX",
)  # fmt: skip
EXACT = {"level, minimum", "correction", "correction, as stored", "NIR subtraction"}
"""Computed pixel by pixel or counted: the same on any machine. Sums depend on the width of its vectors."""
Digits = dict[str, dict[str, dict[str, float | str]]]
"""By program, operation and name of the block."""


def run(effort: Effort) -> Section:
    """Measure everything; reads and writes no file.

    Returns
    -------
    Section
        Numbers are named stress/OPERATION/BLOCK/PROGRAM/digits.
    """
    found: Digits = {}
    seen: list[Case] = []
    double = set()
    for case in cases(effort.quick):
        right = stress_truth.Truth(case)
        measured = {"deglint": stress_ours.measure(right)} | stress_peers.measure(right)
        for program, row in measured.items():
            for operation, value in row.items():
                found.setdefault(program, {}).setdefault(operation, {})[case.name] = value
        seen.append(Case(case.name, case.key, np.empty(0)))
        if case.block.dtype == np.float64:
            double.add(case.name)
    rates, thresholds = stress_rates.measure()
    certified = stress_certified.certified()
    numbers = _numbers(found, seen) | _more_numbers(rates, thresholds, certified)
    tables = [_table(program, found[program], seen) for program in found]
    tables += [_rates_table(rates), _thresholds_table(thresholds), _certified_table(certified)]
    if not effort.quick:
        table, more = _streamed()
        tables.append(table)
        numbers |= more
    return Section(
        "stress",
        "Numerical stress",
        paragraphs(found, rates, thresholds, _missing(), double),
        tuple(tables),
        _figures(found, [c.name for c in seen]),
        numbers,
        finding=finding(found),
    )


def slug(text: str) -> str:
    """A name as a part of a number's name."""
    kept = "".join(c if c.isalnum() or c in "-.+" else " " for c in text.replace("'s formula", "").lower())
    return "-".join(kept.split())


def _number(value: float, *, exact: bool) -> Number:
    """Digits, to a tenth; sums may differ by their last bits on another machine."""
    value = round(value, 1)
    if exact:
        return Number(value, "digits", better="higher")
    return Number(value, "digits", max(value - 1, 0.0), min(value + 1, 16.0), "higher", exact=False)


def _numbers(found: Digits, seen: Iterable[Case]) -> dict[str, Number]:
    key = {c.name: c.key for c in seen}
    return {
        f"stress/{slug(operation)}/{key[name]}/{slug(program)}/digits": _number(value, exact=operation in EXACT)
        for program, rows in found.items()
        for operation, row in rows.items()
        for name, value in row.items()
        if isinstance(value, float)
    }


def _more_numbers(
    rates: stress_rates.ByCase, thresholds: Mapping[str, Mapping[str, float]], certified: list[stress_certified.Row]
) -> dict[str, Number]:
    """Of areas, thresholds and certified values."""
    out = {}
    for (_, key), programs in rates.items():
        for program, row in programs.items():
            for operation, value in row.items():
                out[f"stress/{slug(operation)}/{key}/{slug(program)}/digits"] = _number(value, exact=True)
    for program, worst in thresholds.items():
        for operation, value in worst.items():
            out[f"stress/{slug(operation)}/worst/{slug(program)}/digits"] = _number(value, exact=False)
    for quantity, row in certified:
        data, what = quantity.split(", ", 1)
        for program, value in row.items():
            out[f"stress/{slug(what)}/nist-{slug(data)}/{slug(program)}/digits"] = _number(value, exact=False)
    return out


def _shown(value: float | str | None) -> Cell:
    if value is None:
        return "-"
    return "refused" if isinstance(value, str) else f"{value:.1f}"


def _table(program: str, rows: Mapping[str, Mapping[str, float | str]], seen: Iterable[Case]) -> Table:
    operations = [o for o in OPERATIONS if o in rows]
    said = sorted({f"{o} of {n} {v.rstrip('.')}" for o in operations for n, v in rows[o].items() if isinstance(v, str)})
    body = [[c.name, *(_shown(rows[o].get(c.name)) for o in operations)] for c in seen]
    note = "Correct digits, -log10 of the relative error of the worst value; 16 is all that float64 holds."
    if said:
        note += f" Refused {len(said)} times; the first: {said[0]}."
    return Table.of(f"Digits: {program}", ("block", *operations), body, note)


def _rates_table(rates: stress_rates.ByCase) -> Table:
    operations = list(next(iter(rates.values()))["deglint"])
    body = []
    for (name, _), programs in rates.items():
        pairs = [[_shown(p.get(o)) for p in (programs["deglint"], programs["scikit-learn"])] for o in operations]
        body.append([name, *(" / ".join(map(str, pair)) for pair in pairs)])
    return Table.of(
        "Digits of areas under the ROC curve: deglint / scikit-learn",
        ("scores", *operations),
        body,
        f"{stress_rates.TARGETS} targets, {stress_rates.BACKGROUND} background pixels, every pair counted.",
    )


def _thresholds_table(thresholds: Mapping[str, Mapping[str, float]]) -> Table:
    operations = sorted({o for worst in thresholds.values() for o in worst})
    body = [[o, *(_shown(thresholds[p].get(o)) for p in thresholds)] for o in operations]
    least = min(pfa for _, pfa in stress_rates.QUANTILES)
    tried = (stress_rates.QUANTILES, stress_rates.SMALL_SAMPLES, stress_rates.DISTANCES, stress_rates.FAR)
    counts = [len(x) for x in tried]
    note = (
        f"The worst of {counts[0]} thresholds by chi-squared (rates from {least:g}), {counts[1]} by F, and of "
        f"{counts[2]} and {counts[3]} p-values."
    )
    return Table.of("Digits of thresholds and p-values", ("", *thresholds), body, note)


def _certified_table(certified: list[stress_certified.Row]) -> Table:
    programs = list(dict.fromkeys(p for _, row in certified for p in row))
    body = [[quantity, *(_shown(row.get(p)) for p in programs)] for quantity, row in certified]
    note = (
        "NIST Statistical Reference Datasets; certified to 15 digits. 'As stored' is the exact answer for the data as "
        "float64 holds them."
    )
    return Table.of("Digits of certified values", ("quantity", *programs), body, note)


def _streamed() -> tuple[Table, dict[str, Number]]:
    """The large scene, strip by strip."""
    pixels, rows = stress_certified.streamed(LARGEST)
    programs = list(dict.fromkeys(p for _, row in rows for p in row))
    body = [[operation, *(_shown(row.get(p)) for p in programs)] for operation, row in rows]
    table = Table.of(f"Digits over {pixels:.3g} pixels of float32, streamed", ("", *programs), body)
    numbers = {
        f"stress/{slug(operation)}/pixels1e8/{slug(program)}/digits": _number(value, exact=False)
        for operation, row in rows
        for program, value in row.items()
    }
    return table, numbers


def _missing() -> list[str]:
    """What could not be compared, a sentence each."""
    out = [f"{name} is not compared: {why}." for name, why in stress_peers.programs().items() if why]
    if not find_spec("mpmath"):
        out.append("Thresholds are not compared: mpmath is not installed.")
    if not stress_truth.WIDE:
        out.append("A long double is a double on this machine: digits above 13 say as much of the reference.")
    return out


def _figures(found: Digits, names: list[str]) -> tuple[Figure, ...]:
    """Ours, and what others have of the same."""
    ours = {(o, n): _letter(v) for o, row in found["deglint"].items() for n, v in row.items()}
    theirs = {
        (f"{o}: {program}", n): _letter(v)
        for program, rows in found.items()
        if program != "deglint"
        for o, row in rows.items()
        for n, v in row.items()
    }
    order = [o for o in OPERATIONS if o in found["deglint"]]
    rows = [f"{o}: {p}" for o in OPERATIONS for p in found if p != "deglint" and o in found[p]]
    caption = "Whole digits that are right, 0 (dark) to 16 (pale); r: refused with a message."
    return (
        Figure("Digits of deglint", heat(order, names, ours, most=16, title="correct digits of deglint"), caption),
        Figure("Digits of others", heat(rows, names, theirs, most=16, title="correct digits of others"), caption),
    )


def _letter(value: float | str) -> float | str:
    return "r" if isinstance(value, str) else value
