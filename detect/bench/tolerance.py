"""A sample that is read until its slopes are known well enough: the error claimed, the error made, the time saved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from deglint import Recipe, fit_scene, open_scene
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.scene import Scene
from deglint.simulate import Setup, simulate

from ..report.svg import Axis, Series, plot
from .section import Effort, Figure, Number, Section, Table, timed
from .simulated import SEED, SKY
from .tradeoff_measure import spent

TOLERANCES = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
WINDS = (3.0, 5.0, 9.0)
SIDE, QUICK_SIDE = 1536, 1024
PLAIN: dict[str, Any] = {"method": "hedley", "sample": "all", "mask": "none", "compensate": "off"}


@dataclass
class Kept:
    """Fits of every scene at every tolerance; lists over scenes, arrays over bands.

    Attributes
    ----------
    claimed, slopes : dict of list of ndarray
        Relative standard errors, and slopes; tolerance 0 is the whole scene.
    read, seconds : dict of list of float
        Share of the pixels read, and processor time of the fit [s].
    met : dict of list of bool
    winds : list of float
    """

    claimed: dict[float, list[Any]] = field(default_factory=dict)
    slopes: dict[float, list[Any]] = field(default_factory=dict)
    read: dict[float, list[float]] = field(default_factory=dict)
    seconds: dict[float, list[float]] = field(default_factory=dict)
    met: dict[float, list[bool]] = field(default_factory=dict)
    winds: list[float] = field(default_factory=list)

    def add(self, scene: Scene, wind: float) -> None:
        """Fit one scene at every tolerance, and whole; twice, the quicker of which counts."""
        self.winds.append(wind)
        for tolerance in (0.0, *TOLERANCES):
            recipe = Recipe(**PLAIN, tolerance=tolerance)
            first, fitted = spent(lambda r=recipe: fit_scene(scene, r, threads=1))  # type: ignore[misc]
            again, _ = spent(lambda r=recipe: fit_scene(scene, r, threads=1))  # type: ignore[misc]
            fits, said = fitted.model.fits, fitted.numbers["sample"].get("tolerance")
            self.slopes.setdefault(tolerance, []).append(np.array([f.slope for f in fits]))
            self.claimed.setdefault(tolerance, []).append(np.array([(f.stderr or np.nan) / f.slope for f in fits]))
            total = scene.height * scene.width
            self.read.setdefault(tolerance, []).append(said["pixels_read"] / total if said else 1.0)
            self.met.setdefault(tolerance, []).append(said["met"] if said else True)
            self.seconds.setdefault(tolerance, []).append(min(first, again))

    def real(self, tolerance: float) -> list[Any]:
        """How far the slopes of each scene are from those of all scenes of its wind, read whole.

        Of S scenes each is one of those that the mean is of, so that it is nearer to it by sqrt(1 - 1 / S).
        """
        every = {w: np.array([s for s, own in zip(self.slopes[0.0], self.winds, strict=True) if own == w])
                 for w in set(self.winds)}  # fmt: skip
        factor = {w: np.sqrt(len(s) / max(len(s) - 1, 1)) if len(s) > 1 else 1.0 for w, s in every.items()}
        return [factor[w] * (s / every[w].mean(axis=0) - 1)
                for s, w in zip(self.slopes[tolerance], self.winds, strict=True)]  # fmt: skip


def measure(effort: Effort) -> Kept:
    """Scenes of several winds and seeds, bands at one instant."""
    kept = Kept()
    side = QUICK_SIDE if effort.quick else SIDE
    for wind in WINDS[1:2] if effort.quick else WINDS:
        for seed in range(1 if effort.quick else min(effort.seeds, 3)):
            setup = Setup(sensor=preset("thesis").delayed(0.0), size=(side, side), wind=wind, sky=SKY, supersample=2,
                          seed=SEED + seed)  # fmt: skip
            made = simulate(setup, workers=effort.threads)
            files = write_scene(made, effort.directory / "tolerance", overwrite=True, truth=False)
            del made
            kept.add(open_scene(files[0]), wind)
            for path in files:
                path.unlink()
    return kept


def section(kept: Kept) -> Section:
    """The chapter."""
    rows: list[tuple[Any, ...]] = []
    out: dict[str, Number] = {}
    for tolerance in TOLERANCES:
        claimed, real = _rms(kept.claimed[tolerance]), _rms(kept.real(tolerance))
        worst = max(float(np.abs(r).max()) for r in kept.real(tolerance))
        saved = [1 - a / b for a, b in zip(kept.seconds[tolerance], kept.seconds[0.0], strict=True)]
        name = f"tradeoff/tolerance{tolerance:g}"
        out[f"{name}/claimed"] = Number(claimed, better="lower")
        out[f"{name}/real"] = Number(real, better="lower")
        out[f"{name}/read"] = Number(float(np.mean(kept.read[tolerance])), better="lower")
        out[f"{name}/saved"] = timed(saved, better="higher")
        met = sum(kept.met[tolerance])
        rows.append((f"{tolerance:g}", f"{met} of {len(saved)}", f"{out[f'{name}/read'].value:.0%}",
                     out[f"{name}/saved"], claimed, real, worst))  # fmt: skip
    rows.append(("whole", "", "100%", "", _rms(kept.claimed[0.0]), _rms(kept.real(0.0)),
                 max(float(np.abs(r).max()) for r in kept.real(0.0))))  # fmt: skip
    head = ("tolerance", "reached in scenes", "pixels read", "time of the fit saved", "claimed error", "real error",
            "real, worst band of all")  # fmt: skip
    many = len(kept.winds) > len(set(kept.winds))
    against = "the mean of all scenes of the wind, read whole" if many else "the same scene, read whole"
    table = Table.of("Claimed and real error of slopes", head, rows,
                     f"Relative; root mean square over bands and scenes. Real: against {against}.")  # fmt: skip
    return Section("tradeoff/tolerance", "Reading no more than the slopes need", _said(kept), (table,),
                   (_figure(kept),), out)  # fmt: skip


def _said(kept: Kept) -> tuple[str, ...]:
    inside = [np.abs(r) <= 2 * c for t in TOLERANCES for r, c in zip(kept.real(t), kept.claimed[t], strict=True)]
    loose = np.mean(kept.read[TOLERANCES[0]])
    said = (
        f"{len(kept.winds)} scene{'s' * (len(kept.winds) > 1)}; ordinary least squares of a whole scene as the sample. "
        "A tolerance of "
        f"{TOLERANCES[0]:g} reads {loose:.0%} of the pixels, and never less than a first look at a scene does. Of all "
        f"slopes, {np.mean(inside):.0%} lie within twice the standard error that was claimed for them (95 % would be "
        "right for independent cells of a Gaussian sea); a sample in which few cells hold most of the glint is not "
        "believed, and more is read."
    )
    return (said,)


def _figure(kept: Kept) -> Figure:
    x = Axis("tolerance", min(TOLERANCES), max(TOLERANCES), log=True)
    known = [_rms(v[t]) for v in (kept.claimed,) for t in TOLERANCES]
    real = [_rms(kept.real(t)) for t in TOLERANCES]
    low = min(v for v in (*known, *real) if v > 0) / 2 if max(real) > 0 else 1e-4
    y = Axis("relative error of slopes", max(low, 1e-5), 0.2, log=True)
    at = np.array(TOLERANCES[::-1])
    lines = [Series(name, at, np.array(v[::-1]), None, tuple(zip(at, v[::-1], strict=True)))
             for name, v in (("claimed", known), ("real", real))]  # fmt: skip
    drawn = plot(lines, x, y, title="claimed and real error against tolerance", legend=True, chance=(at, at))
    return Figure("Error against tolerance", drawn, "Dotted: as large as the tolerance itself.")


def _rms(values: Sequence[Any]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
