"""Objects found before and after system effects, and after compensation: chapter 5 of the thesis, remade with truth.

Figures 5.2 to 5.5 and 5.12 of Fink (2014), Glint Avoidance and Removal in the Maritime Environment, Rochester Institute
of Technology: ROC curves of objects of 2, 5, 10 and 20 % at 5 m from five looks, by Mahalanobis distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deglint.physics.presets import preset
from deglint.simulate.experiments import LOOKS

from ..report.svg import Axis, Series, Size, plot
from . import roc_words, simulated
from .measure import VISIBLE, Float64, bounded, curves, rms_error, rx_scores
from .section import Cell, Effort, Figure, Number, Section, Table, over_seeds

WIND = 9.0
"""[m/s]"""
STATES = {"before": "before", "after": "after", "thesis-chain": "thesis' chain", "compensated": "default",
          "limit": "no glint"}  # fmt: skip
"""What each image is, in the heads of tables."""
SHOWN = ("before", "after", "thesis-chain", "compensated")
"""States that are plotted."""
RATES = (1e-3, 1e-2)
"""Pfa at which Pd is read."""
GRID = np.geomspace(1e-4, 1.0, 161)
PLOT = Size(480, 340)

Look = tuple[float, float]
Key = tuple[Look, str]


@dataclass(frozen=True, eq=False)
class Image:
    """What was found in one image.

    Attributes
    ----------
    error : float
        RMS error [% of the water level].
    auc : (reflectance,) ndarray
    pd : (reflectance, rate) ndarray
        At `RATES`.
    curve : (reflectance, Pfa) ndarray
        Pd at `GRID`.
    """

    error: float
    auc: Float64
    pd: Float64
    curve: Float64


@dataclass(frozen=True)
class Found:
    """All that was measured; lists have one entry a seed.

    Attributes
    ----------
    looks : tuple of Look
    images : dict
        By look and state.
    glint : dict
        By look: share of NIR pixels where glint exceeds a quarter of the radiance without it [%].
    """

    looks: tuple[Look, ...]
    images: dict[Key, list[Image]]
    glint: dict[Look, list[float]]

    def auc(self, look: Look, state: str, kind: int) -> Number:
        """Area under the curve with its interval."""
        values = [float(i.auc[kind]) for i in self.images[look, state]]
        return bounded(over_seeds(values, better="higher"), 0, 1)

    def pd(self, look: Look, state: str, kind: int, rate: int) -> Number:
        """Pd at a rate with its interval."""
        values = [float(i.pd[kind, rate]) for i in self.images[look, state]]
        return bounded(over_seeds(values, better="higher"), 0, 1)

    def error(self, look: Look, state: str) -> Number:
        """RMS error with its interval."""
        return bounded(over_seeds([i.error for i in self.images[look, state]], "%"), 0)

    def gain(self, look: Look, state: str, other: str, kind: int) -> Number:
        """By how much the area of one state exceeds that of another, on the same scenes."""
        pairs = zip(self.images[look, state], self.images[look, other], strict=True)
        return over_seeds([float(a.auc[kind] - b.auc[kind]) for a, b in pairs])


def run(effort: Effort) -> Section:
    """Measure, and write the chapter."""
    return section(measure(effort, LOOKS), effort.seeds)


def measure(effort: Effort, looks: tuple[Look, ...], side: int = simulated.SIDE) -> Found:
    """Look for the objects in every state of every scene."""
    tasks = [(look, seed) for look in looks for seed in range(effort.seeds)]
    results = simulated.each(lambda t: _one_sea(effort, t[0], t[1], side), tasks, effort.threads)
    images: dict[Key, list[Image]] = {(look, state): [] for look in looks for state in STATES}
    glint: dict[Look, list[float]] = {look: [] for look in looks}
    for (look, _), (found, share) in zip(tasks, results, strict=True):
        glint[look].append(share)
        for state, image in found.items():
            images[look, state].append(image)
    return Found(tuple(looks), images, glint)


def _one_sea(effort: Effort, look: Look, seed: int, side: int) -> tuple[dict[str, Image], float]:
    made = simulated.setups([simulated.ideal(), preset("thesis")], WIND, seed, look, side)
    name = f"roc-{look[0]:g}-{look[1]:g}-{seed}"
    before, after = scenes = simulated.see(made, effort.directory, name)
    found = {
        "before": _image(before, before.glinting),
        "after": _image(after, after.raw),
        "thesis-chain": _image(after, after.cleaned("joyce", "thesis")),
        "compensated": _image(after, after.cleaned("auto", "auto")),
        "limit": _image(after, after.noisy),
    }
    nir = [b.name for b in after.made.setup.sensor.bands].index("NIR1")
    share = 100 * float(after.made.glint_mask[nir].mean())
    simulated.forget(scenes)
    return found, share


def _image(seen: simulated.Seen, image: Float64) -> Image:
    scores = rx_scores(image[:VISIBLE], seen.sample)
    rocs = curves(scores, seen.kinds, range(1, len(simulated.REFLECTANCES) + 1))
    read = []
    for roc in rocs:
        pfa, pd = roc.vertices
        read.append(pd[np.searchsorted(pfa, GRID * (1 + 1e-12), side="right") - 1])
    rates = np.array([[roc.point(rate).pd for rate in RATES] for roc in rocs])
    return Image(rms_error(image, seen.truth), np.array([roc.auc for roc in rocs]), rates, np.stack(read))


def section(found: Found, seeds: int) -> Section:
    """The chapter of what was found."""
    return Section(
        "roc",
        "Objects found, before and after system effects",
        (*roc_words.opening(seeds), roc_words.of_errors(found)),
        (_errors(found),),
        numbers=numbers(found),
        parts=tuple(_part(found, kind) for kind in range(len(simulated.REFLECTANCES))),
        finding=roc_words.finding(found),
    )


def _part(found: Found, kind: int) -> Section:
    percent = 100 * simulated.REFLECTANCES[kind]
    head = ["look", *STATES.values()]
    areas: list[list[Cell]] = [
        [roc_words.look(at), *(found.auc(at, state, kind) for state in STATES)] for at in found.looks
    ]
    tables = [
        Table.of(f"Area under the curve, objects of {percent:g} %", head, areas, "Mean and 95 % interval over seeds.")
    ]
    for number, rate in enumerate(RATES):
        rows: list[list[Cell]] = [
            [roc_words.look(at), *(found.pd(at, state, kind, number) for state in STATES)] for at in found.looks
        ]
        tables.append(Table.of(f"Pd at a Pfa of {rate:g}, objects of {percent:g} %", head, rows))
    return Section(f"roc/object{percent:02.0f}", f"Objects of {percent:g} %", roc_words.of_object(found, kind),
                   tuple(tables), tuple(_plot(found, kind, state) for state in SHOWN))  # fmt: skip


def _plot(found: Found, kind: int, state: str) -> Figure:
    """A line for each look."""
    lines = []
    for at in found.looks:
        stack = np.stack([image.curve[kind] for image in found.images[at, state]])
        points = [bounded(over_seeds(list(column)), 0, 1) for column in stack.T]
        low, high = (np.array([getattr(p, end) for p in points]) for end in ("low", "high"))
        band = None if np.isnan(low).any() else (GRID, low, high)
        lines.append(Series(roc_words.look(at), GRID, np.array([p.value for p in points]), band))
    title = f"Objects of {100 * simulated.REFLECTANCES[kind]:g} %, {roc_words.TITLES[state]}"
    drawn = plot(lines, Axis("Pfa", 1e-4, 1.0, log=True), Axis("Pd", 0.0, 1.0), title=f"ROC curves: {title}", size=PLOT,
                 chance=(GRID, GRID), legend=True)  # fmt: skip
    return Figure(title, drawn, "Mean over seeds at each Pfa; shaded: its 95 % interval; dotted: chance.")


def _errors(found: Found) -> Table:
    rows: list[list[Cell]] = []
    for at in found.looks:
        glint = bounded(over_seeds(found.glint[at], "%", ""), 0, 100)
        rows.append([roc_words.look(at), glint, *(found.error(at, state) for state in STATES)])
    head = ["look", "NIR with glint [%]", *STATES.values()]
    note = ("Share of NIR1 pixels whose glint exceeds a quarter of the radiance without it; then the RMS error of the "
            "whole scene [% of water level] against the truth of the same sensor.")  # fmt: skip
    return Table.of("Glint and error by look", head, rows, note)


def numbers(found: Found) -> dict[str, Number]:
    """Every number by name."""
    out = {}
    for at in found.looks:
        stem = f"roc/look{at[0]:02g}-{at[1]:03g}"
        out[f"{stem}/glint"] = bounded(over_seeds(found.glint[at], "%", ""), 0, 100)
        for state in STATES:
            out[f"{stem}/{state}/rms"] = found.error(at, state)
            for kind, reflectance in enumerate(simulated.REFLECTANCES):
                name = f"{stem}/{state}/object{100 * reflectance:02.0f}"
                out[f"{name}/auc"] = found.auc(at, state, kind)
                for number, rate in enumerate(RATES):
                    out[f"{name}/pd-at-{rate:g}"] = found.pd(at, state, kind, number)
    return out
