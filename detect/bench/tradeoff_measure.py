"""Every choice of method and stages, on every scene: its error, the objects it loses, and its processor time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from deglint import Recipe, correct, fit_scene
from deglint.errors import DeglintError
from deglint.physics.presets import preset
from deglint.remove import METHODS, REGRESSIONS

from .measure import Float64, curves, rms_error, rx_scores
from .section import Effort, Number, over_seeds, timed
from .simulated import REFLECTANCES, Seen, forget, see, setups

WINDS, DELAYS = (2.0, 5.0, 9.0, 12.0), (0.0, 0.060)
QUICK_WINDS = (9.0,)
AUTO, ALONE = "auto", "auto, sample found"
ITERATIONS = (1, 2, 3, 4, 5)
STAGES = "identify-level:13, replace-level, remove"
"""One opening and nothing else; the default chain has two iterations of the PSF before it and an opening after it."""


@dataclass(frozen=True)
class Choice:
    """One way to take glint off: name parts as they stand in the names of numbers, and the recipe."""

    name: str
    recipe: dict[str, Any]


def chain(iterations: int) -> str:
    """The default chain with another number of iterations; 0: without them."""
    return (f"psf:{iterations}, " if iterations else "") + f"{STAGES}, identify-level:11, replace-level"


def choices(quick: bool) -> list[Choice]:
    """Every method and regression alone, every method with each compensation, and every number of iterations."""
    out = []
    for method, entry in METHODS.items():
        regressions = tuple(REGRESSIONS) if entry.regresses and not (quick and method != "joyce") else ("",)
        for regression in regressions:
            recipe = {"method": method, "compensate": "off", "regression": regression or "auto"}
            out.append(Choice(f"{method}/{regression or 'ols'}/off" if entry.regresses else f"{method}/off", recipe))
        out += [
            Choice(f"{method}/{compensate}", {"method": method, "compensate": compensate})
            for compensate in ("thesis", "auto")
            if not quick or (method in ("joyce", "multiband") and compensate == "auto")
        ]
    steps = (0, 2, 4) if quick else (0, *ITERATIONS)
    out += [Choice(f"multiband/psf{n}", {"method": "multiband", "compensate": chain(n)}) for n in steps]
    out.append(Choice("multiband/opening", {"method": "multiband", "compensate": STAGES}))
    out.append(Choice("auto/off", {"compensate": "off"}))
    return [*out, Choice(AUTO, {}), Choice(ALONE, {"sample": "auto"})]


@dataclass
class Found:
    """What was measured; lists over scenes, by choice.

    Attributes
    ----------
    conditions : list of str
        Of each scene.
    rms : dict of str to list of float
        Whole scene [% of the water level]; NaN where a scene cannot be fitted so.
    deep : dict of str to list of float
        The same of deep water, without objects.
    loss : dict of str to list of float
        Of AUC, mean over the objects' reflectances, against the truth with noise.
    fit, apply : dict of str to list of float
        Processor time [ns per pixel and band].
    raw, noise : list of float
        Error of doing nothing, and of noise alone [%].
    """

    conditions: list[str] = field(default_factory=list)
    rms: dict[str, list[float]] = field(default_factory=dict)
    deep: dict[str, list[float]] = field(default_factory=dict)
    loss: dict[str, list[float]] = field(default_factory=dict)
    fit: dict[str, list[float]] = field(default_factory=dict)
    apply: dict[str, list[float]] = field(default_factory=dict)
    raw: list[float] = field(default_factory=list)
    noise: list[float] = field(default_factory=list)

    @property
    def usable(self) -> list[str]:
        """Choices that fit every scene."""
        return [name for name, values in self.rms.items() if not any(map(math.isnan, values))]

    def typical(self, values: Sequence[float], where: Sequence[int] | None = None) -> float:
        """Geometric mean over scenes (some of them), in which no scene outweighs the rest."""
        chosen = values if where is None else [values[i] for i in where]
        return math.exp(float(np.mean(np.log(np.maximum(chosen, 1e-12)))))

    def seconds(self, name: str) -> float:
        """Median processor time of fit and apply [ns per pixel and band]."""
        return float(np.median(np.add(self.fit[name], self.apply[name])))

    def kinds(self) -> dict[str, list[int]]:
        """Which scenes are of each condition."""
        return {c: [i for i, own in enumerate(self.conditions) if own == c] for c in dict.fromkeys(self.conditions)}


def measure(effort: Effort, also: Callable[[Seen], None] | None = None) -> Found:
    """Every choice on every scene, one after the other; and what else is `also` done with those at one instant."""
    found = Found()
    every = choices(effort.quick)
    for number, (condition, seen) in enumerate(scenes(effort)):
        if not number:  # what is loaded or compiled at the first use is no time of a choice
            for choice in every:
                cleaned(seen, choice)
        if also and condition.endswith(", 0 ms"):
            also(seen)
        found.conditions.append(condition)
        found.raw.append(rms_error(seen.raw, seen.truth))
        found.noise.append(rms_error(seen.noisy, seen.truth))
        best = auc(seen, seen.noisy)
        for choice in every[number:] + every[:number]:
            clean, fit, apply = cleaned(seen, choice)
            values = (math.nan,) * 3 if clean is None else (*errors(seen, clean), best - auc(seen, clean))
            lists = found.rms, found.deep, found.loss, found.fit, found.apply
            for kept, value in zip(lists, (*values, fit, apply), strict=True):
                kept.setdefault(choice.name, []).append(value)
    return found


def scenes(effort: Effort) -> Iterator[tuple[str, Seen]]:
    """Scenes of every wind and delay, a seed after the other; each file is there until the next is asked for."""
    for seed in range(1 if effort.quick else min(effort.seeds, 2)):
        for wind in QUICK_WINDS if effort.quick else WINDS:
            sensors = [preset("thesis").delayed(delay) for delay in DELAYS]
            made = see(setups(sensors, wind, seed), effort.directory, f"tradeoff-{wind:g}-{seed}")
            for delay, seen in zip(DELAYS, made, strict=True):
                yield f"{wind:g} m/s, {1e3 * delay:g} ms", seen
            forget(made)


def cleaned(seen: Seen, choice: Choice) -> tuple[Float64 | None, float, float]:
    """The scene without glint (None where it cannot be fitted so), and time of fit and apply [ns per pixel, band]."""
    rows, columns = seen.made.setup.size
    recipe = Recipe(**({"sample": f"0,0,{columns // 2},{rows}", "mask": "none"} | choice.recipe))
    try:
        fit, fitted = spent(lambda: fit_scene(seen.scene, recipe, threads=1))
        apply, clean = spent(lambda: correct(seen.scene, fitted))
    except DeglintError:
        return None, math.nan, math.nan
    values = 1e-9 * clean.size
    return clean.astype(np.float64), fit / values, apply / values


def spent(work: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time of some work [s], and what it gives."""
    start = time.process_time()
    out = work()
    return time.process_time() - start, out


def errors(seen: Seen, image: Float64) -> tuple[float, float]:
    """RMS error of the whole scene, and of its deep water [% of the water level]."""
    return rms_error(image, seen.truth), rms_error(image, seen.truth, seen.deep)


def auc(seen: Seen, image: Float64) -> float:
    """Area under the ROC curve of global RX, mean over the objects' reflectances."""
    found = curves(rx_scores(image, seen.sample), seen.kinds, range(1, len(REFLECTANCES) + 1))
    return float(np.mean([roc.auc for roc in found]))


def numbers(found: Found) -> dict[str, Number]:
    """Every measured number by name."""
    out = {}
    for name in found.usable:
        key = "tradeoff/" + name.replace(", ", "-").replace(" ", "-")
        out[f"{key}/rms"] = Number(found.typical(found.rms[name]), "%", better="lower")
        out[f"{key}/deep"] = Number(found.typical(found.deep[name]), "%", better="lower")
        out[f"{key}/auc-loss"] = Number(float(np.mean(found.loss[name])), "", better="lower")
        out[f"{key}/fit"] = timed(found.fit[name], "ns")
        out[f"{key}/apply"] = timed(found.apply[name], "ns")
        for condition, where in found.kinds().items():
            kind = condition.replace(" m/s, ", "-delay").replace(" ms", "")
            out[f"{key}/wind{kind}/rms"] = over_seeds([found.rms[name][i] for i in where], "%")
    return out
