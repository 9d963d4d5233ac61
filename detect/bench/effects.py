"""Noise, optics, smear and delay, one at a time: error and objects found, before removal and after.

Sections 5.3.1 and 6.2 of Fink (2014), Glint Avoidance and Removal in the Maritime Environment, Rochester Institute of
Technology: one sea seen by sensors that differ from an ideal one in a single thing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deglint.physics.presets import preset
from deglint.physics.sensor import Sensor

from ..report.svg import Axis, Series, Size, plot
from . import effects_words, simulated
from .measure import VISIBLE, Float64, bounded, curves, rms_error, rx_scores
from .section import Cell, Effort, Figure, Number, Section, Table, over_seeds

WIND = 9.0
"""[m/s]"""
PLOT = Size(480, 340)
STATES = {"raw": ("none", "off"), "joyce": ("joyce", "off"), "default": ("auto", "auto")}
"""Method and compensation of each state."""


@dataclass(frozen=True)
class Effect:
    """Something that sensors do to a scene.

    Attributes
    ----------
    name : str
        In names of numbers.
    title, unit : str
    levels, quick : tuple of float
        The first is that of the ideal sensor.
    on : callable
        The ideal sensor with a level of it.
    """

    name: str
    title: str
    unit: str
    levels: tuple[float, ...]
    quick: tuple[float, ...]
    on: Callable[[Sensor, float], Sensor]

    def chosen(self, quick: bool) -> tuple[float, ...]:
        """Levels to look at."""
        return self.quick if quick else self.levels

    def said(self, level: float) -> str:
        """A level in words."""
        if self.unit == "f/":
            return f"f/{level:g}"
        if not level or (level == 1 and self.name == "noise"):
            return f"{'the usual' if level else 'no'} {self.title.lower()}"
        return f"{level:g} {self.unit}"


def _noisy(sensor: Sensor, times: float) -> Sensor:
    """With this many times the noise of the thesis' sensor: shot noise, by the well, and read noise for the well."""
    if not times:
        return sensor
    usual = preset("thesis")
    return replace(sensor, well=usual.well / times**2, read_noise=usual.read_noise / times, bits=usual.bits)


EFFECTS = (
    Effect("noise", "Noise", "times the usual", (0.0, 0.5, 1.0, 2.0, 4.0), (0.0, 1.0, 4.0), _noisy),
    Effect("f-number", "Optics", "f/", (2.0, 10.0, 20.0, 30.0, 40.0), (2.0, 10.0, 30.0),
           lambda s, f: replace(s, f_number=f)),
    Effect("smear", "Smear", "pixels", (0.0, 0.5, 1.0, 2.0, 4.0), (0.0, 0.5, 4.0), lambda s, d: replace(s, smear=d)),
    Effect("delay", "Delay", "ms", (0.0, 10.0, 20.0, 60.0), (0.0, 10.0, 60.0), lambda s, ms: s.delayed(ms / 1000)),
)  # fmt: skip
ALL = "all"
"""The thesis' sensor: every effect at its usual level."""

Key = tuple[str, float]
"""Effect and level."""


@dataclass(frozen=True, eq=False)
class Image:
    """What was found in one image: RMS error [%], and AUC by reflectance."""

    error: float
    auc: Float64


@dataclass(frozen=True)
class Found:
    """All that was measured: by effect and level, then by state, one a seed; the state "limit" has no glint."""

    quick: bool
    images: dict[Key, dict[str, list[Image]]]

    def error(self, key: Key, state: str) -> Number:
        """RMS error with its interval."""
        return bounded(over_seeds([i.error for i in self.images[key][state]], "%"), 0)

    def auc(self, key: Key, state: str, kind: int) -> Number:
        """Area under the curve with its interval."""
        values = [float(i.auc[kind]) for i in self.images[key][state]]
        return bounded(over_seeds(values, better="higher"), 0, 1)

    def change(self, key: Key, base: Key, state: str, kind: int | None = None) -> Number:
        """How a level changes the error, or the area of a kind of object, against another, on the same seas."""
        pairs = zip(self.images[key][state], self.images[base][state], strict=True)
        if kind is None:
            return over_seeds([a.error - b.error for a, b in pairs], "%")
        return over_seeds([float(a.auc[kind] - b.auc[kind]) for a, b in pairs])


def sensors(quick: bool) -> dict[Key, Sensor]:
    """Every sensor that looks; the ideal one stands for the first level of every effect."""
    ideal = simulated.ideal()
    every = {(e.name, level): e.on(ideal, level) for e in EFFECTS for level in e.chosen(quick)}
    return every | {(ALL, 1.0): preset("thesis")}


def run(effort: Effort) -> Section:
    """Measure, and write the chapter."""
    return section(measure(effort), effort.seeds)


def measure(effort: Effort, side: int = simulated.SIDE) -> Found:
    """Look at every sea with every sensor."""
    every = sensors(effort.quick)
    different = list(dict.fromkeys(every.values()))
    seas = simulated.each(lambda seed: _one_sea(effort, different, seed, side), range(effort.seeds), effort.threads)
    place = {sensor: i for i, sensor in enumerate(different)}
    states = (*STATES, "limit")
    return Found(effort.quick, {
        key: {state: [sea[place[sensor]][state] for sea in seas] for state in states} for key, sensor in every.items()
    })  # fmt: skip


def _one_sea(effort: Effort, different: Sequence[Sensor], seed: int, side: int) -> list[dict[str, Image]]:
    """What every sensor sees of a sea, by state."""
    out = []
    made = simulated.setups(different, WIND, seed, side=side)
    for seen in simulated.see(made, effort.directory, f"effects-{seed}"):
        images = {state: _image(seen, seen.cleaned(*told)) for state, told in STATES.items()}
        out.append(images | {"limit": _image(seen, seen.noisy)})
        simulated.forget([seen])
    return out


def _image(seen: simulated.Seen, image: Float64) -> Image:
    rocs = curves(rx_scores(image[:VISIBLE], seen.sample), seen.kinds, range(1, len(simulated.REFLECTANCES) + 1))
    return Image(rms_error(image, seen.truth), np.array([roc.auc for roc in rocs]))


def section(found: Found, seeds: int) -> Section:
    """The chapter of what was found."""
    return Section(
        "effects",
        "Noise, optics, smear and delay, one at a time",
        effects_words.opening(seeds),
        (_together(found),),
        numbers=numbers(found),
        parts=tuple(_part(found, effect) for effect in EFFECTS),
        finding=effects_words.finding(found),
    )


def _part(found: Found, effect: Effect) -> Section:
    kinds = range(len(simulated.REFLECTANCES))
    rows: list[list[Cell]] = []
    for level in effect.chosen(found.quick):
        key = effect.name, level
        for state, name in (*effects_words.SAID.items(), ("limit", "without glint")):
            areas = [found.auc(key, state, k) for k in kinds]
            rows.append([effect.said(level), name, found.error(key, state), *areas])
    head = [effect.title.lower(), "image", "error [%]", *(f"AUC {100 * r:g} %" for r in simulated.REFLECTANCES)]
    table = Table.of(f"{effect.title}: error and area under the curve", head, rows)
    return Section(f"effects/{effect.name}", f"{effect.title} alone", effects_words.of_effect(found, effect), (table,),
                   (_plot(found, effect, None), _plot(found, effect, 0)))  # fmt: skip


def _plot(found: Found, effect: Effect, kind: int | None) -> Figure:
    """Error, or area for a kind of object, against the level."""
    levels = np.array(effect.chosen(found.quick))
    lines = []
    for state, name in effects_words.SAID.items():
        keys = [(effect.name, float(level)) for level in levels]
        values = [found.error(key, state) if kind is None else found.auc(key, state, kind) for key in keys]
        mean, low, high = (np.array([getattr(v, part) for v in values]) for part in ("value", "low", "high"))
        band = None if np.isnan(low).any() else (levels, low, high)
        lines.append(Series(name, levels, mean, band, tuple(zip(levels.tolist(), mean.tolist(), strict=True))))
    x = Axis(f"{effect.title.lower()} [{effect.unit}]" if effect.unit != "f/" else "f-number",
             float(levels[0]), float(levels[-1]))  # fmt: skip
    error = Axis("RMS error [% of water level]", 0.1, 1000.0, log=True)
    what = "error" if kind is None else f"objects of {100 * simulated.REFLECTANCES[kind]:g} %"
    title = f"{effect.title} alone, {what}"
    drawn = plot(lines, x, error if kind is None else Axis("AUC", 0.4, 1.0), title=title, size=PLOT, legend=True)
    return Figure(title, drawn, "Shaded: 95 % interval over seeds.")


def _together(found: Found) -> Table:
    rows: list[list[Cell]] = []
    base = EFFECTS[0].name, EFFECTS[0].chosen(found.quick)[0]
    for key, name in ((base, "none"), ((ALL, 1.0), "all, as in the thesis' sensor")):
        for state, said in (*effects_words.SAID.items(), ("limit", "without glint")):
            areas = [found.auc(key, state, k) for k in range(len(simulated.REFLECTANCES))]
            rows.append([name, said, found.error(key, state), *areas])
    head = ["effects", "image", "error [%]", *(f"AUC {100 * r:g} %" for r in simulated.REFLECTANCES)]
    return Table.of("No effect, and all of them", head, rows, "Mean over seeds and its 95 % interval.")


def numbers(found: Found) -> dict[str, Number]:
    """Every number by name."""
    out = {}
    for (effect, level), states in found.images.items():
        for state in states:
            stem = f"effects/{effect}/{level:g}/{state}"
            out[f"{stem}/rms"] = found.error((effect, level), state)
            for kind, reflectance in enumerate(simulated.REFLECTANCES):
                out[f"{stem}/object{100 * reflectance:02.0f}/auc"] = found.auc((effect, level), state, kind)
    return out
