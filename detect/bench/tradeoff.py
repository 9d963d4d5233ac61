"""Run time against error: every method and chain of stages, and whether the automatic choice is worth its time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..report.scatter import scatter
from ..report.svg import Axis, Size
from . import tolerance
from .front import dominated, front
from .section import Cell, Effort, Figure, Number, Section, Table
from .tradeoff_measure import ALONE, AUTO, ITERATIONS, Found, measure, numbers
from .tradeoff_parts import Parts, medians, samples

LEAST_LOSS = 1e-4
"""Loss of AUC below which choices are alike."""
PLOT = Size(960, 540)
Points = Mapping[str, tuple[float, float]]


def run(effort: Effort) -> Section:
    """Measure, and write the chapter."""
    parts = Parts()
    found = measure(effort, parts.add)
    return section(found, parts, tolerance.measure(effort))


def section(found: Found, parts: Parts, kept: tolerance.Kept) -> Section:
    """The chapter of what was found."""
    error, loss = by_error(found), by_loss(found)
    chapters = (_conditions(found), _psf(found), samples(parts), medians(parts), tolerance.section(kept))
    figures = (
        _figure(error, Axis("fit and correction [ns per pixel and band]", 1.0, 2000.0, log=True),
                "Time against error", "RMS error [% of water level]"),
        _figure(by_error(found, applied=True), Axis("correction alone [ns per pixel and band]", 1.0, 300.0, log=True),
                "Time of large scenes against error", "RMS error [% of water level]"),
        _figure(loss, Axis("fit and correction [ns per pixel and band]", 1.0, 2000.0, log=True),
                "Time against objects lost", "loss of AUC"),
    )  # fmt: skip
    every = numbers(found) | _distances(found, error)
    return Section("tradeoff", "Run time against error", _said(found, error, loss), (_table(found, error, loss),),
                   figures, every, chapters, finding(found, error))  # fmt: skip


def by_error(found: Found, *, applied: bool = False) -> dict[str, tuple[float, float]]:
    """Processor time and error of every choice that fits every scene; of the correction alone, where `applied`."""

    def time(name: str) -> float:
        return float(np.median(found.apply[name])) if applied else found.seconds(name)

    return {name: (time(name), found.typical(found.rms[name])) for name in found.usable}


def by_loss(found: Found) -> dict[str, tuple[float, float]]:
    """Processor time and loss of AUC, in steps of what counts."""
    return {
        name: (found.seconds(name), max(LEAST_LOSS, round(float(np.mean(found.loss[name])) / LEAST_LOSS) * LEAST_LOSS))
        for name in found.usable
    }  # fmt: skip


def distance(points: Points, name: str = AUTO) -> tuple[float, float]:
    """How many times the error of the best choice that takes no longer, and the time of the quickest as good."""
    x, y = points[name]
    best = min(b for a, b in points.values() if a <= x)
    quickest = min(a for a, b in points.values() if b <= y)
    return y / best, x / quickest


def finding(found: Found, error: Points) -> str:
    """For the head of the report."""
    off, slow = distance(error)
    raw, own = found.typical(found.raw), error[AUTO][1]
    return (
        f"Over {len(found.conditions)} scenes --method auto leaves {own:.2g} % of the water level, of {raw:.3g} %; the "
        f"best choice of no longer run time leaves {1 / off:.0%} of that, and the quickest as good takes "
        f"{1 / slow:.0%} of its time."
    )  # fmt: skip


def _said(found: Found, error: Points, loss: Points) -> tuple[str, ...]:
    best = front(error)
    beaten = dominated(error)
    status = "No choice is both quicker than --method auto and leaves less, beyond what varies from run to run"
    if AUTO in beaten:
        status = f"--method auto is beaten by {beaten[AUTO]}"
    off, slow = distance(error)
    scenes = (
        f"{len(found.conditions)} simulated scenes ({', '.join(found.kinds())}), squares of four reflectances at 5 m, "
        "the deep half as the sample. Time is processor time on one thread, of the fit and of the correction; error is "
        "the geometric mean over scenes; the loss of AUC is that of RX against the same scene without glint."
    )  # fmt: skip
    said = (
        f"On the front, the quickest first: {', '.join(best)}. {status}: its error is {off:.2f} "
        f"times that of the best of no longer run time, and its time {slow:.2f} times that of the quickest as good."
    )  # fmt: skip
    worst = [n for n in beaten if error[n][1] > found.typical(found.raw)]
    hurts = f" Worse than doing nothing: {', '.join(worst)}." if worst else ""
    lost = max((n for n in loss if n in beaten), key=lambda n: loss[n][1], default=AUTO)
    rest = (
        f"{len(beaten)} of {len(error)} choices are beaten in both, by what the table names.{_robust(found, error)}"
        f"{hurts} Objects are lost most by {lost} ({loss[lost][1]:.2g} of AUC)."
    )  # fmt: skip
    return scenes, said, rest


def _robust(found: Found, error: Points) -> str:
    """What robust regressions cost and leave, against least squares."""
    pairs = [(n, n.replace(r, "ols")) for r in ("huber", "theil-sen") for n in error if f"/{r}/" in n]
    pairs = [(a, b) for a, b in pairs if b in error]
    if not pairs:
        return ""
    cost = float(np.median([np.median(found.fit[a]) / np.median(found.fit[b]) for a, b in pairs]))
    left = [error[a][1] / error[b][1] for a, b in pairs]
    return (
        f" Robust regressions take {cost:.2g} times as long to fit as least squares and leave {min(left):.2f} to "
        f"{max(left):.2f} times its error."
    )


def _table(found: Found, error: Points, loss: Points) -> Table:
    best, beaten = front(error), dominated(error)
    on_loss = front(loss)
    rows: list[tuple[Cell, ...]] = []
    for name in sorted(error, key=lambda n: error[n][1]):
        where = f"beaten by {beaten[name]}" if name in beaten else "beside the front"
        where = "on the front" if name in best else where
        costs = error[name][1], found.typical(found.deep[name]), float(np.mean(found.loss[name]))
        times = (float(np.median(values[name])) for values in (found.fit, found.apply))
        rows.append((name, *costs, *times, where, "on the front" if name in on_loss else ""))
    missing = [n for n in found.rms if n not in error]
    note = f"Sorted by error. Not for these bands: {', '.join(missing)}." if missing else "Sorted by error."
    head = ("choice", "RMS error [%]", "in deep water [%]", "loss of AUC", "fit [ns]", "correction [ns]",
            "time against error", "time against AUC")  # fmt: skip
    return Table.of("Every choice", head, rows, f"{note} Times per pixel and band.")


def _distances(found: Found, error: Points) -> dict[str, Number]:
    """How far the automatic choice is from the front, overall and scene by scene."""
    out = {}
    for name in (AUTO, ALONE):
        off, slow = distance(error, name)
        key = "tradeoff/" + name.replace(", ", "-").replace(" ", "-")
        out[f"{key}/times-best-error"] = Number(off, better="lower")
        out[f"{key}/times-quickest"] = Number(slow, better="lower", exact=False)
    out["tradeoff/choices"] = Number(len(error))
    out["tradeoff/dominated"] = Number(len(dominated(error)), exact=False)
    out["tradeoff/raw/rms"] = Number(found.typical(found.raw), "%")
    return out


def _conditions(found: Found) -> Section:
    """The automatic choice beside the best of each kind of scene."""
    rows: list[tuple[Cell, ...]] = []
    ratios = {}
    for condition, where in found.kinds().items():
        means = {n: found.typical(found.rms[n], where) for n in found.usable}
        times = {n: float(np.median([found.fit[n][i] + found.apply[n][i] for i in where])) for n in means}
        best = min(means, key=lambda n: means[n])
        near = min((n for n in means if means[n] <= 1.1 * means[AUTO]), key=lambda n: times[n])
        ratios[condition] = means[AUTO] / means[best]
        noise, raw = (found.typical(values, where) for values in (found.noise, found.raw))
        rows.append((condition, raw, noise, means[AUTO], best, means[best], near, f"{times[near] / times[AUTO]:.0%}"))
    worst = max(ratios, key=lambda c: ratios[c])
    said = (
        f"Choosing for a kind of scene after the truth is known gains little: at most a factor of {ratios[worst]:.2f}, "
        f"at {worst}; the automatic choice must serve all of them unseen."
    )  # fmt: skip
    head = ("scenes", "raw [%]", "noise alone [%]", "auto [%]", "best", "its error [%]",
            "quickest within 10 % of auto", "its time, of auto's")  # fmt: skip
    out = {
        f"tradeoff/regret/wind{c.replace(' m/s, ', '-delay').replace(' ms', '')}": Number(r, better="lower")
        for c, r in ratios.items()
    }  # fmt: skip
    table = Table.of("The automatic choice, scene by scene", head, rows)
    return Section("tradeoff/conditions", "Which choice for which scene", (said,), (table,), numbers=out)


def _psf(found: Found) -> Section:
    """Iterations of the PSF."""
    names = [n for n in (f"multiband/psf{i}" for i in (0, *ITERATIONS)) if n in found.usable]
    kinds = {"at once": [i for i, c in enumerate(found.conditions) if c.endswith(", 0 ms")],
             "apart": [i for i, c in enumerate(found.conditions) if not c.endswith(", 0 ms")]}  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for name in names:
        cells = [found.typical(v[name], where) for where in kinds.values() for v in (found.rms, found.deep)]
        losses = [float(np.mean([found.loss[name][i] for i in where])) for where in kinds.values()]
        rows.append((int(name[-1]), *cells, *losses, float(np.median(found.apply[name]))))
    best = [min(names, key=lambda n, w=w: found.typical(found.rms[n], w))[-1] for w in kinds.values()]  # type: ignore[misc]
    deep = [min(names, key=lambda n, w=w: found.typical(found.deep[n], w))[-1] for w in kinds.values()]  # type: ignore[misc]
    at_once = next(iter(kinds.values()))
    plain, twice = (found.typical(found.deep[f"multiband/psf{i}"], at_once) for i in (0, 2))
    said = (
        "Iterations of Richardson-Lucy before the first opening; each costs as much again. Where bands look at one "
        f"instant the error of the whole scene is least with {best[0]} and that of deep water with {deep[0]}; where "
        f"they do not, with {best[1]} and {deep[1]}. The default takes two, and none where bands look at one "
        f"instant: there deep water comes out at {twice:.3g} % with two, at {plain:.3g} % without."
    )
    errors = [f"{where}, {k} [%]" for k in kinds for where in ("whole", "deep")]
    head = ("iterations", *errors, *(f"AUC loss, {k}" for k in kinds), "correction [ns]")
    note = "RMS error of the whole scene and of deep water; bands that look at one instant (at once), and apart."
    table = Table.of("Iterations of the PSF", head, rows, note)
    return Section("tradeoff/psf", "How often to sharpen", (said,), (table,))


def _figure(points: Points, x: Axis, title: str, label: str) -> Figure:
    ys = [p[1] for p in points.values()]
    xs = [p[0] for p in points.values()]
    y = Axis(label, min(ys) / 1.5, max(ys) * 1.5, log=True)
    x = Axis(x.label, min(x.low, min(xs)), max(x.high, max(xs)), log=True)
    best = front(points)
    drawn = scatter(points, x, y, title=f"{title}: a point a choice", line=best, named=best, marked=(AUTO,), size=PLOT)
    said = "Left and low is better. The line joins what no other choice beats in both; the diamond is --method auto."
    return Figure(title, drawn, said)
