"""Are standard errors as large as the errors? On simulated scenes, whose truth is known.

Ratio: root mean square of the error over root mean square of the standard error, of clean pixels and of replaced ones;
spread: half of what lies between the 16th and the 84th percentile of error over standard error, 1 for a normal one.
No scene here set a constant. With `--set` it is the scenes that did.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from deglint.pipeline.uncertain import with_stderr

from deglint import Recipe, fit_scene, open_scene
from deglint.compensate.uncertainty import Parts, stderr
from deglint.errors import FitError
from deglint.physics.presets import preset
from deglint.pipeline.correct import Correction
from deglint.pipeline.overview import raster_of
from deglint.raster.output import Layout
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate, thesis_array
from deglint.tiles import Tile
from detect.bench.measure import VISIBLE

from .error import DATA
from .timing import machine, say

Array = npt.NDArray[np.floating]
SIDE, LEAST = 320, 200
SEEDS, OTHERS = (13, 14), 141
"""Of the usual scenes, and the first of the others."""
SET_ON, OTHERS_SET_ON = (1, 2, 3), 241
"""The same of the scenes that constants were set on."""


def deglinted(path: Path, compensate: str = "auto") -> tuple[Parts, Array, tuple[int, ...]]:
    """A scene's parts, the standard errors, and their bands."""
    scene = open_scene(path)
    with raster_of(scene):
        fitted = fit_scene(scene, Recipe(mask="none", compensate=compensate), threads=1)
        info = raster_of(scene).info
        layout = Layout(info, tuple(range(len(scene.bands))), "float32", None, {})
        work = Correction(scene, fitted.model, False, False, layout, None, None, (), fitted.chain)
        whole = Tile(0, scene.height, 0, scene.width)
        work = with_stderr(work, [whole], (), 1)
        parts = replace(work, uncertainty=None)(whole).parts
    assert parts is not None
    assert work.uncertainty is not None
    return parts, stderr(parts, work.uncertainty), tuple(work.changed)


def compare(
    parts: Parts, claimed: Array, bands: tuple[int, ...], truth: Array
) -> tuple[dict[str, tuple[Array, Array]], Ratios]:
    """Error and standard error of visible and other bands, all pixels, clean and replaced ones, in units of the water's
    level; and their ratios in single bands."""
    out: dict[str, list[tuple[Array, Array]]] = {}
    for i, band in enumerate(bands):
        level = np.median(truth[band])
        error, se = (parts.after[band] - truth[band]) / level, claimed[i] / level
        replaced = np.zeros_like(parts.where) if parts.replaced is None else parts.replaced[band]
        kept = np.zeros_like(parts.where) if parts.kept is None else parts.kept
        for name, where in (("all", ~kept), ("clean", ~replaced & ~kept), ("replaced", replaced & ~kept)):
            if where.sum() >= LEAST:
                kind = f"{'visible' if band < VISIBLE else 'longer'} {name}"
                out.setdefault(kind, []).append((error[where], se[where]))
    both = {k: (np.concatenate([e for e, _ in v]), np.concatenate([s for _, s in v])) for k, v in out.items()}
    return both, {k: [ratio(e, s) for e, s in v] for k, v in out.items()}


KINDS = ("visible clean", "visible replaced", "longer clean", "longer replaced")
WITHIN = 0.2
"""A standard error that is so near to the error is right."""
Ratios = dict[str, list[float]]


def ratio(error: Array, claimed: Array) -> float:
    """Root mean square of errors over that of standard errors."""
    return float(np.sqrt((error**2).mean() / (claimed.astype(np.float64) ** 2).mean()))


def row(name: str, path: Path, compensate: str = "auto", ratios: Ratios | None = None) -> list[str]:
    """A row of the table; the ratios of the kinds, and those of single bands, are added to `ratios`."""
    truth = open_scene(path.with_name(f"{path.stem}_truth.tif")).read().astype(np.float64)
    try:
        found, single = compare(*deglinted(path, compensate), truth)
    except FitError:  # removal has nothing to take away
        found, single = {}, {}
    cells = []
    for kind in KINDS:
        if kind not in found:
            cells.append("-")
            continue
        error, se = found[kind]
        low, high = np.percentile(error / se, [16, 84])
        cells.append(f"{100 * np.sqrt((error**2).mean()):.2f} %, {ratio(error, se):.2f}, {(high - low) / 2:.2f}")
    if ratios is not None:
        for kind, of_all in found.items():
            ratios.setdefault(kind, []).append(ratio(*of_all))
            ratios.setdefault(f"{kind}, single bands", []).extend(single[kind])
    return [name, *cells]


def counted(ratios: Ratios) -> list[list[str]]:
    """How many ratios are right, of each kind."""
    return [
        [
            k,
            f"{sum(abs(r - 1) <= WITHIN for r in v)} of {len(v)}",
            f"{np.median(v):.2f}",
            f"{min(v):.2f} to {max(v):.2f}",
        ]
        for k, v in ratios.items()
    ]


@dataclass(frozen=True)
class Case:
    """One scene to simulate; every second one has squares on the ground."""

    wind: float
    patch: float
    delay: float
    seed: int
    sensor: str = "thesis"

    @property
    def squares(self) -> bool:
        """Squares of 16 pixels on the ground."""
        return (self.seed + (self.delay > 0)) % 2 == 1

    def __str__(self) -> str:
        text = f"{self.wind:g} m/s, patch {self.patch:g}, {1e3 * self.delay:g} ms, seed {self.seed}"
        return text + ", f/30" * (self.sensor != "thesis") + ", squares" * self.squares

    def written(self, folder: Path) -> Path:
        """The scene's file."""
        things = thesis_array((SIDE, SIDE), 0.25, sides=(16,)) if self.squares else ()
        setup = Setup(
            sensor=preset(self.sensor).delayed(self.delay), size=(SIDE, SIDE), wind=self.wind, patch=self.patch,
            sky="cardioidal", seed=self.seed, objects=things,
        )  # fmt: skip
        path = folder / f"{self.sensor}-{self.wind:g}-{self.patch:g}-{self.delay:g}-{self.seed}.tif"
        write_scene(simulate(setup), path)
        return path


def usual(seeds: Sequence[int]) -> list[Case]:
    """The usual winds, patches and delays."""
    return [
        Case(wind, patch, delay, seed)
        for seed in seeds for wind in (2.0, 5.0, 9.0) for patch in (0.005, 0.06) for delay in (0.06, 0.0)
    ]  # fmt: skip


def others(first: int) -> list[Case]:
    """Other winds, delays and optics, each of a seed of its own, from this one on."""
    return [
        Case(wind, patch, delay, first + 9 * i + 3 * j + k, sensor)
        for i, wind in enumerate((3.0, 7.0, 12.0))
        for j, (patch, sensor) in enumerate(((0.005, "thesis"), (0.02, "thesis"), (0.005, "thesis-f30")))
        for k, delay in enumerate((0.01, 0.02, 0.06))
        if sensor == "thesis" or delay > 0.02
    ]


HEAD = ("", *KINDS)
NOTE = ("Root mean square of the error in percent of the water's level, its ratio to that of the standard error, "
        "spread of error over standard error.")  # fmt: skip


def crops() -> list[Path]:
    """Recorded scenes of another simulator."""
    return sorted(p for p in (DATA / "simulated").glob("wind*.tif") if p.stem.count("_") == 1 + ("f30" in p.stem)
                  + ("sun30" in p.stem) and not p.stem.endswith(("_truth", "_glint", "_objects")))  # fmt: skip


def main(quick: bool, those_that_set: bool) -> None:
    """Measure and print."""
    print("## Standard errors\n\n" + machine())
    ratios: Ratios = {}
    seeds, first = (SET_ON, OTHERS_SET_ON) if those_that_set else (SEEDS, OTHERS)
    if crops() and not quick and not those_that_set:
        say("Scenes of another simulator", HEAD, [row(p.stem, p, ratios=ratios) for p in crops()], NOTE)
    with tempfile.TemporaryDirectory() as folder:
        plain = []
        for title, cases in (("Simulated here", usual(seeds)), ("Other winds, delays and optics", others(first))):
            rows = []
            for case in cases[:1] if quick else cases:
                path = case.written(Path(folder))
                rows.append(row(str(case), path, ratios=ratios))
                if case.delay == 0:
                    plain.append(row(str(case), path, "off"))
            say(title, HEAD, rows, NOTE)
        if plain:
            say("Removal alone, bands at one instant", HEAD, plain, NOTE)
    note = f"Ratios from {1 - WITHIN:g} to {1 + WITHIN:g}, their median, and the least and the largest."
    say("How many are right", ("", "right", "median", "range"), counted(ratios), note)
