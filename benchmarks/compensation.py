"""Compensation measured: on recorded scenes with truth, on the project's own, piece by piece, and in time.

Recorded scenes lie beside the project and are no part of it; without them a line says so. The project's own are made
here: a grid of 4 m objects at 5 m depth on the right, deep water on the left.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deglint import Recipe, open_scene, remove_glint
from deglint.compensate import THESIS, identify, level
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.scene import Window
from deglint.simulate import Setup, SubmergedObject, simulate
from detect.bench.measure import VISIBLE, curves, rms_error, rx_scores

from .error import DATA, DEEP
from .timing import machine, say

REFLECTANCES = (0.02, 0.05, 0.10, 0.20)
SIDE, PIXELS, GSD = 384, 16, 0.25
PATCHES = (0.06, 0.005)
METHODS = ("hedley", "lyzenga", "joyce", "multiband")
DEFAULT = "psf:2, identify-level:13, replace-level, remove, identify-level:11, replace-level"


@dataclass(frozen=True)
class Condition:
    """One kind of scene."""

    name: str
    wind: float
    delay: float = 0.06
    sun: float = 40.0
    sensor: str = "thesis"


CONDITIONS = (
    Condition("wind02_delay60", 2.0), Condition("wind05_delay60", 5.0), Condition("wind09_delay00", 9.0, 0.0),
    Condition("wind09_delay60", 9.0), Condition("wind09_delay60_f30", 9.0, sensor="thesis-f30"),
    Condition("wind12_delay60_sun30", 12.0, sun=30.0),
)  # fmt: skip
ROUND = ("wind05_delay60", "wind09_delay60")
"""Own scenes in which objects of other outlines are tried, too."""


def outline(kind: str, right: float, down: float) -> tuple[tuple[float, float], ...]:
    """Corners of an object 16 pixels wide (squares, discs) or as large as such a square (diamonds) [m]."""
    half = PIXELS / 2 * GSD
    if kind == "disc":
        turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        return tuple((right + half * float(np.cos(t)), down + half * float(np.sin(t))) for t in turn)
    if kind == "diamond":
        half *= np.sqrt(2)
        return (right, down - half), (right + half, down), (right, down + half), (right - half, down)
    return (
        (right - half, down - half),
        (right + half, down - half),
        (right + half, down + half),
        (right - half, down + half),
    )


def objects(*kinds: str) -> tuple[SubmergedObject, ...]:
    """Four columns of objects, one a reflectance, in the right half; of several kinds, row by row."""
    across, down = SIDE / 2 / len(REFLECTANCES), 64
    places = [(kinds[i % len(kinds)], SIDE / 2 + (j + 0.5) * across, (i + 0.5) * down, r)
              for i in range(SIDE // down) for j, r in enumerate(REFLECTANCES)]  # fmt: skip
    return tuple(
        SubmergedObject(corners=outline(kind, x * GSD, y * GSD), reflectance=r, depth=5.0) for kind, x, y, r in places
    )


def setup(condition: Condition, seed: int, patch: float, kind: str, sky: str) -> Setup:
    """A scene to simulate."""
    return Setup(sensor=preset(condition.sensor).delayed(condition.delay), size=(SIDE, SIDE), wind=condition.wind,
                 sun_zenith=condition.sun, sky=sky, patch=patch, seed=seed, objects=objects(kind))  # fmt: skip


def scores(
    image: np.ndarray, labels: np.ndarray, covariance: str = "empirical", background: int | None = None
) -> list[float]:
    """Area under the ROC curve of global RX on the visible bands, objects of each reflectance against the rest; the
    background is that of so many columns, all by default."""
    sample = np.zeros(labels.shape, np.bool_)
    sample[:, :background] = True
    distances = rx_scores(image[:VISIBLE], sample, covariance)
    kinds = np.where(labels > 0, (labels.astype(int) - 1) % len(REFLECTANCES) + 1, 0)
    return [roc.auc for roc in curves(distances, kinds, range(1, len(REFLECTANCES) + 1))]


def run(source: Path, place: Path, recipe: Recipe | None = None) -> np.ndarray:
    """The scene without glint, as physical values."""
    remove_glint(source, place / "out.tif", recipe, overwrite=True)
    return open_scene(place / "out.tif").read().astype(np.float64)


@contextmanager
def changed(home: Any, name: str, value: Any) -> Iterator[None]:
    """Something in a module replaced for a while."""
    before = getattr(home, name)
    setattr(home, name, value)
    try:
        yield
    finally:
        setattr(home, name, before)


def pair(image: np.ndarray, truth: np.ndarray) -> str:
    """Errors of deep water and of the whole, as text."""
    return f"{rms_error(image, truth, slice(DEEP)):.2f} / {rms_error(image, truth, slice(None)):.2f}"


def recorded(place: Path, quick: bool) -> None:
    """Methods by compensation on the recorded scenes."""
    folder = DATA / "simulated"
    names = [c.name for c in CONDITIONS if not quick or c.name in ("wind02_delay60", "wind09_delay60")]
    truths, labels = ({n: truth_of(folder / n)[i] for n in names} for i in (0, 1))
    raws = {n: open_scene(folder / f"{n}.tif").read().astype(np.float64) for n in names}
    rows = [["nothing done", "", *(pair(raws[n], truths[n]) for n in names)]]
    for method in METHODS:
        for compensate in ("off", "thesis", "auto"):
            recipe = Recipe(method=method, compensate=compensate, sample=f"0,0,{DEEP},{SIDE}", mask="none")
            rows.append([method, compensate, *(pair(run(folder / f"{n}.tif", place, recipe), truths[n])
                                               for n in names)])  # fmt: skip
    cleans = {n: run(folder / f"{n}.tif", place) for n in names}
    rows.append(["all by default", "auto", *(pair(cleans[n], truths[n]) for n in names)])
    note = "Deep water / whole crop, in percent of the water level (noise alone: 2.7). The sample is the deep water."
    say("Recorded scenes: methods by compensation [%]", ("method", "compensation", *names), rows, note)
    rows = [[what, *(aucs([scores(images[n], labels[n], background=DEEP)]) for n in names)]
            for what, images in (("AUC, nothing done", raws), ("AUC, all by default", cleans))]  # fmt: skip
    note = "Global RX on COASTAL to RED, deep water as background; objects of 2, 5, 10 and 20 %."
    say("Recorded scenes: objects found", ("", *names), rows, note)


@dataclass(frozen=True)
class Measured:
    """One scene of our own: errors raw and clean (deep, whole), AUC clean, with deep water as background, by a robust
    background, and of truth with noise."""

    raw: float
    deep: float
    whole: float
    clean_auc: list[float]
    deep_auc: list[float]
    robust_auc: list[float]
    truth_auc: list[float]


def measure(place: Path, made: Setup) -> Measured:
    """Simulate, remove and compare."""
    scene = simulate(made)
    write_scene(scene, place / "own", overwrite=True)
    scale = np.array([made.sensor.scale(b) for b in made.sensor.bands])[:, None, None]
    truth = scene.truth.astype(np.float64)
    clean = run(place / "own.tif", place)
    deep, whole = (rms_error(clean, truth, slice(n)) for n in (DEEP, None))
    raw = rms_error(scene.image * scale, truth, slice(None))
    found, labels = scores(clean, scene.objects), scene.objects
    truth_auc = scores(scene.truth_image * scale, labels)
    deep_auc = scores(clean, labels, background=DEEP)
    return Measured(raw, deep, whole, found, deep_auc, scores(clean, labels, "mcd"), truth_auc)


def own(place: Path, quick: bool) -> None:
    """The project's own scenes."""
    seeds = range(1 if quick else 5)
    rows = []
    cases = [(c, p, k, "cardioidal") for p in PATCHES for c in CONDITIONS
             for k in (("square", "disc", "diamond") if c.name in ROUND else ("square",))]  # fmt: skip
    cases += [(c, PATCHES[0], "square", "harrison-coombes") for c in CONDITIONS]
    for condition, patch, kind, sky in cases[:: 5 if quick else 1]:
        found = [measure(place, setup(condition, s, patch, kind, sky)) for s in seeds]
        rows.append([condition.name, f"{patch:g}", kind, sky, f"{np.mean([f.raw for f in found]):.0f}",
                     spread([f.deep for f in found]), spread([f.whole for f in found]),
                     aucs([f.clean_auc for f in found]), aucs([f.deep_auc for f in found]),
                     aucs([f.robust_auc for f in found]), aucs([f.truth_auc for f in found])])  # fmt: skip
    head = ("scene", "patch [m]", "objects", "sky", "raw [%]", "deep [%]", "whole [%]", "AUC 2/5/10/20 %",
            "of deep water", "robust", "of truth + noise")  # fmt: skip
    note = (f"Mean and standard deviation over {len(seeds)} seeds. AUC: global RX on COASTAL to RED, all pixels as "
            "background; of deep water: that as background; robust: a background by minimum covariance determinant. "
            "Under a Harrison-Coombes sky the truth holds the mirrored bright sky near the sun, which no method can "
            "tell from glint.")  # fmt: skip
    say("Own scenes, all by default", head, rows, note)


def spread(values: list[float]) -> str:
    """Mean and standard deviation as text."""
    return f"{np.mean(values):.2f} +- {np.std(values, ddof=1) if len(values) > 1 else 0:.2f}"


def aucs(values: list[list[float]]) -> str:
    """Mean areas as text."""
    return " ".join(f"{v:.3f}" for v in np.mean(values, axis=0))


def sharp(band: np.ndarray, _psf: Any, within: Window, *, out: np.ndarray, **_rest: Any) -> None:
    """In the place of `deglint.compensate.level.blurred`: the level as it is."""
    (top, bottom), (left, right) = within
    out[...] = band[top:bottom, left:right]


def ablation(place: Path, quick: bool) -> None:
    """What each piece of the default chain is worth."""
    conditions = [c for c in CONDITIONS if c.name in ("wind05_delay60", "wind09_delay60", "wind09_delay60_f30",
                                                      "wind12_delay60_sun30")][: 2 if quick else None]  # fmt: skip
    sources: dict[str, tuple[Path, np.ndarray, np.ndarray]] = {}
    for c in conditions:
        folder = DATA / "simulated"
        if folder.exists():
            sources[c.name] = (folder / f"{c.name}.tif", *truth_of(folder / c.name))
        made = simulate(setup(c, 0, PATCHES[0], "square", "cardioidal"))
        write_scene(made, place / c.name)
        sources[f"own {c.name}"] = (place / f"{c.name}.tif", *truth_of(place / c.name))
    second = DEFAULT.replace("psf:2, ", "")
    variants: dict[str, tuple[Recipe, Any]] = {
        "all of it": (Recipe(compensate=DEFAULT), None),
        "no psf": (Recipe(compensate=second), None),
        "no detail": (Recipe(compensate=DEFAULT), (identify, "MOST_COVER_FOR_DETAIL", -1.0)),
        "level not blurred again": (Recipe(compensate=DEFAULT), (level, "blurred", sharp)),
        "no second opening": (Recipe(compensate=DEFAULT.split(", identify-level:11")[0]), None),
        "joyce for multiband": (Recipe(compensate=DEFAULT, method="joyce"), None),
        "nothing but multiband": (Recipe(compensate="off", method="multiband"), None),
        "thesis": (Recipe(compensate=THESIS), None),
    }
    rows = []
    for name, (recipe, change) in variants.items():
        cells = []
        for source, truth, labels in sources.values():
            with changed(*change) if change else changed(identify, "LEVEL_K", identify.LEVEL_K):
                clean = run(source, place, recipe)
            cells.append(f"{pair(clean, truth)} ({scores(clean, labels)[0]:.3f})")
        rows.append([name, *cells])
    note = "Deep water / whole [%] (AUC of objects of 2 %)."
    say("Without a piece", ("", *sources), rows, note)


def truth_of(stem: Path) -> tuple[np.ndarray, np.ndarray]:
    """Truth and objects beside a scene."""
    parts = (open_scene(stem.with_name(f"{stem.name}_{what}.tif")).read() for what in ("truth", "objects"))
    truth, labels = parts
    return truth.astype(np.float64), labels[0].astype(int)


def main(quick: bool) -> None:
    """Measure and print."""
    print("## Compensation\n\n" + machine())
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        if (DATA / "simulated").exists():
            recorded(place, quick)
        else:
            print("\nSkipped: the recorded scenes do not lie beside the project.")
        ablation(place, quick)
        own(place, quick)
