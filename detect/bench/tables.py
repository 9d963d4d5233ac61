"""Tables of the results, as the report and the documentation show them."""

from __future__ import annotations

from dataclasses import dataclass

from .numbers import short
from .run import LIMIT, PFA, RAW, Condition, Results
from .scenes import REFLECTANCES, SIDE


@dataclass(frozen=True)
class Table:
    """A table: title, column heads, rows of cells, and a note on how it was measured."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def named(condition: Condition) -> str:
    """A condition as text."""
    return f"{condition[0]:g} m/s, {1000 * condition[1]:g} ms"


def tables(results: Results) -> list[Table]:
    """Every table."""
    found = [overview(results)]
    if len(results.conditions) > 1:
        found.append(by_condition(results))
    return [*found, objects(results)]


def overview(results: Results) -> Table:
    """Error and processor time of every removal in one condition."""
    shown = results.effort.shown
    rows = []
    for name in (RAW, *results.effort.names, LIMIT):
        if name in results.refused:
            rows.append((name, *["refused"] * 4))
            continue
        errors = [str(results.error(shown, name, part)) for part in ("whole", "deep")]
        times = [short(1e3 * times[name].value) if name in times else "-" for times in (results.fit, results.apply)]
        rows.append((name, *errors, *times))
    side = results.effort.side
    note = (
        "Error: RMSE over the visible bands relative to the water level, mean over seeds and its 95 % interval. Time: "
        f"processor time on one thread, scene of 8 bands of {side} x {side} pixels, median of "
        f"{results.effort.rounds} runs. Methods run without compensation; default is deglint remove without options."
    )
    head = ("removal", "error, whole scene [%]", "error, deep water [%]", "fit [ms]", "apply [ms]")
    return Table(f"Error and run time at {named(shown)} between bands", head, tuple(rows), note)


def by_condition(results: Results) -> Table:
    """Error of every removal in every condition."""
    rows = [
        (name, *(short(results.error(condition, name).value) for condition in results.conditions))
        for name in (RAW, *results.used, LIMIT)
    ]
    head = ("removal", *map(named, results.conditions))
    note = f"Whole scene of {SIDE} x {SIDE} pixels, mean over {results.effort.seeds} seeds [% of the water level]."
    return Table("Error by wind and delay between bands", head, tuple(rows), note)


def objects(results: Results) -> Table:
    """Objects found, and areas under the ROC curve, by reflectance."""
    shown = results.effort.shown
    rows = []
    for name in (RAW, *results.used, LIMIT):
        found = [f"{100 * results.rate(shown, name, kind, 'found').value:.0f}" for kind in range(len(REFLECTANCES))]
        auc = [f"{results.rate(shown, name, kind, 'auc').value:.3f}" for kind in range(len(REFLECTANCES))]
        rows.append((name, *found, *auc))
    kinds = [f"{100 * reflectance:g} %" for reflectance in REFLECTANCES]
    head = ("removal", *(f"found, {kind} [%]" for kind in kinds), *(f"AUC, {kind}" for kind in kinds))
    note = (
        f"Submerged squares of 4 m at a depth of 5 m, by reflectance. Global RX on the visible bands. An object is "
        f"found when one of its pixels exceeds the threshold at a pixel false-alarm rate of {PFA:g}. AUC is by pixels."
    )
    return Table(f"Objects found at {named(shown)} between bands", head, tuple(rows), note)
