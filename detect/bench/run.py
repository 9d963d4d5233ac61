"""Measure every glint removal on simulated scenes: error, objects found, ROC curves and processor time."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from deglint import Fitted, Recipe, correct, fit_scene
from deglint.errors import DeglintError
from deglint.physics.presets import preset
from deglint.remove import METHODS

from ..arrays import Float64
from ..global_rx import rx
from ..roc import Roc, object_curve
from .numbers import VISIBLE_BANDS, Number, over_seeds, rms_error, timed
from .scenes import REFLECTANCES, TrueScene, simulated

DEFAULT, RAW, LIMIT = "default", "raw", "noise only"
"""Names in the results: `deglint remove` without options; the raw image; the truth with the noise of the sensor, which
is the result of a removal that removes all glint and nothing else."""
GRID = np.geomspace(1e-4, 1.0, 121)  # pixel false-alarm rates of the ROC curves
PFA = 1e-3  # pixel false-alarm rate at which objects are counted

Condition = tuple[float, float]  # wind [m/s] and delay from band to band [s]


def removals() -> dict[str, dict[str, str]]:
    """Options of `deglint.Recipe` for every removal, by name: each method without compensation, and the default."""
    return {**{name: {"method": name, "compensate": "off"} for name in METHODS}, DEFAULT: {}}


@dataclass(frozen=True)
class Effort:
    """Extent of a run of the benchmark: removals, winds, delays, and numbers of scenes and of timings."""

    names: tuple[str, ...]  # keys of `removals`
    winds: tuple[float, ...] = (3.0, 5.0, 9.0, 12.0)  # [m/s]
    delays: tuple[float, ...] = (0.0, 0.06)  # delay from band to band [s]
    seeds: int = 5  # number of scenes of each condition
    side: int = 768  # number of rows and of columns of the scene that is timed [pixel]
    rounds: int = 5  # number of repeated timings

    @classmethod
    def of(cls, names: Sequence[str], *, quick: bool, seeds: int | None) -> Self:
        """Extent for the removals `names`. If `quick`: one wind, a small timed scene, 3 rounds, by default 2 seeds."""
        if quick:
            return cls(tuple(names), (9.0,), seeds=seeds or 2, side=256, rounds=3)
        return cls(tuple(names), seeds=seeds or cls.seeds)

    @property
    def shown(self) -> Condition:
        """Wind [m/s] and delay [s] of the ROC curves and run times: the wind nearest to 9 m/s, the longest delay."""
        return min(self.winds, key=lambda w: abs(w - 9)), max(self.delays)


@dataclass(frozen=True, eq=False)
class Quality:
    """Quality of an image: RMS errors [% of the water level], and detection of the objects of each reflectance."""

    whole: float  # error of the whole scene
    deep: float  # error of the deep water alone
    auc: Float64  # (reflectance,): area under the ROC curve of global RX on the visible bands, by pixels
    found: Float64  # (reflectance,): fraction of the objects found at `PFA`
    curve: Float64  # (reflectance, rate): Pd at the rates `GRID`


@dataclass(frozen=True)
class Results:
    """Results of all measurements.

    `images` maps (condition, name) to one `Quality` per seed; names are removals, `RAW` and `LIMIT` (noisy truth).
    `fit` and `apply` map removals to processor times [s] (timed scene, one thread); `refused` maps removals to reasons.
    """

    effort: Effort
    images: dict[tuple[Condition, str], list[Quality]] = field(default_factory=dict)
    fit: dict[str, Number] = field(default_factory=dict)
    apply: dict[str, Number] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    @property
    def used(self) -> list[str]:
        """Names of the removals that failed on no scene."""
        return [name for name in self.effort.names if name not in self.refused]

    @property
    def conditions(self) -> list[Condition]:
        """All combinations of a wind and a delay."""
        return [(wind, delay) for delay in self.effort.delays for wind in self.effort.winds]

    def error(self, condition: Condition, name: str, part: str = "whole") -> Number:
        """RMS error of image `name` [% of the water level], mean over seeds; `part`: "whole" scene or "deep" water."""
        return over_seeds([getattr(image, part) for image in self.images[condition, name]], "%")

    def rate(self, condition: Condition, name: str, kind: int, what: str) -> Number:
        """Mean over seeds of `what` ("auc" or "found" of `Quality`), for image `name` and `REFLECTANCES[kind]`."""
        values = [float(getattr(image, what)[kind]) for image in self.images[condition, name]]
        return over_seeds(values, "", "higher", most=1.0)

    def numbers(self) -> dict[str, Number]:
        """All numbers of the run, by key: "wind09/delay60/hedley/rms-whole", ".../auc/object05", "time/hedley/fit"."""
        out: dict[str, Number] = {}
        for condition, name in self.images:
            stem = f"wind{condition[0]:02g}/delay{1000 * condition[1]:02g}/{name.replace(' ', '-')}"
            out |= {f"{stem}/rms-{part}": self.error(condition, name, part) for part in ("whole", "deep")}
            for kind, reflectance in enumerate(REFLECTANCES):
                for what in ("auc", "found"):
                    out[f"{stem}/{what}/object{100 * reflectance:02g}"] = self.rate(condition, name, kind, what)
        out |= {f"time/{name}/fit": number for name, number in self.fit.items()}
        return out | {f"time/{name}/apply": number for name, number in self.apply.items()}


def measure(effort: Effort, directory: Path, progress: Callable[[str, int, int], None]) -> Results:
    """Measure all removals on scenes that are simulated in `directory`; progress(stage, done, total) is called."""
    results, seas = Results(effort), [(wind, seed) for wind in effort.winds for seed in range(effort.seeds)]
    for step, (wind, seed) in enumerate(seas):
        progress(f"wind {wind:g} m/s", step, len(seas) + 1)
        sensors = [preset("thesis").delayed(delay) for delay in effort.delays]
        for delay, scene in zip(effort.delays, simulated(directory, sensors, wind, seed), strict=True):
            images = {RAW: scene.radiance(scene.made.image), LIMIT: scene.radiance(scene.made.truth_image)}
            images |= cleaned(scene, results)
            for name, image in images.items():
                results.images.setdefault(((wind, delay), name), []).append(quality(scene, image))
    progress("timing", len(seas), len(seas) + 1)
    wind, delay = effort.shown
    (scene,) = simulated(directory, [preset("thesis").delayed(delay)], wind, 0, effort.side)
    for name, seconds in processor_times(scene, results.used, effort.rounds).items():
        results.fit[name], results.apply[name] = (timed(own) for own in zip(*seconds, strict=True))
    return results


def cleaned(scene: TrueScene, results: Results) -> dict[str, Float64]:
    """The scene after each removal, (band, row, column), by name; reasons of failures go to `results.refused`."""
    out = {}
    for name in results.used:
        try:
            out[name] = correct(scene.scene, _fitted(scene, name)).astype(np.float64)
        except DeglintError as error:
            results.refused[name] = str(error)
    return out


def _fitted(scene: TrueScene, name: str) -> Fitted:
    sample = f"0,0,{scene.deep.stop},{scene.made.setup.size[0]}"
    options: dict[str, Any] = {"sample": sample, "mask": "none", **removals()[name]}
    return fit_scene(scene.scene, Recipe(**options), threads=1)


def processor_times(scene: TrueScene, names: Sequence[str], rounds: int) -> dict[str, list[tuple[float, float]]]:
    """Processor times (fit, apply) [s] by removal, one pair for each round. An extra first round compiles the code."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    for turn in range(rounds + 1):
        for name in names:
            start = time.process_time()
            fitted = _fitted(scene, name)
            middle = time.process_time()
            correct(scene.scene, fitted)
            if turn:
                found[name].append((middle - start, time.process_time() - middle))
    return found


def quality(scene: TrueScene, image: Float64) -> Quality:
    """Compare an image of a scene, (band, row, column) [W m-2 sr-1 nm-1], with the truth of the scene."""
    scores, kinds = rx(np.asarray(image[:VISIBLE_BANDS], np.float64), scene.sample, threads=1), scene.kinds
    auc, found, drawn = [], [], []
    for kind in range(1, len(REFLECTANCES) + 1):
        own, valid = np.where(kinds == kind, scene.made.objects, 0), (kinds == 0) | (kinds == kind)
        roc = Roc.of(scores, own, valid)
        counted = object_curve(scores, own, roc, valid, pfa_max=PFA)
        auc.append(roc.auc)
        found.append(np.mean([o.pfa <= PFA for o in counted.objects]) if counted.objects else math.nan)
        pfa, pd = roc.vertices
        drawn.append(pd[np.searchsorted(pfa, GRID * (1 + 1e-12), side="right") - 1])
    whole, deep = rms_error(image, scene.made.truth), rms_error(image, scene.made.truth, scene.deep)
    return Quality(whole, deep, np.array(auc), np.array(found), np.stack(drawn))
