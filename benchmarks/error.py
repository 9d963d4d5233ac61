"""Error of every method and regression on simulated scenes, whose truth is known, and on a real scene.

The scenes lie beside the project and are no part of it. If they are missing, a line says so.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from deglint import Recipe, fit_scene, open_scene, remove
from deglint.errors import DeglintError
from deglint.readers.areas import open_area
from deglint.remove import METHODS, REGRESSIONS
from deglint.scene import Scene
from detect.bench.numbers import rms_error

from .files import DATA, values
from .timing import machine, say

NIR1 = 6
DEEP = 184
"""Number of columns at the left of the simulated scenes that are deep water; they are the sample."""
QUICK_TRIALS = ("wind09_delay00", "wind09_delay60")
PUBLISHED = {"B02": (0.856348, 13.45), "B03": (0.869187, 12.72), "B04": (0.806518, 19.30)}
"""By other software, in the hand-drawn sample: slope on B08, and standard deviation after correction [DN]."""


def combinations(quick: bool) -> list[tuple[str, str]]:
    """Pairs (method, regression): all regressions (two if `quick`), or "" if the method takes no regression."""
    regressions = ("ols", "detrended") if quick else tuple(REGRESSIONS)
    return [(m, r) for m, method in METHODS.items() for r in (regressions if "regression" in method.options else ("",))]


def simulated(quick: bool) -> None:
    """Print errors of all methods and regressions on the simulated scenes, then beside those of another program."""
    trial = json.loads((DATA / "simulated" / "trial_errors.json").read_text())
    names = [n for n in trial if not quick or n in QUICK_TRIALS]
    rows: dict[tuple[str, str], list[str]] = {c: [] for c in combinations(quick)}
    raw, checks = [], []
    for name in names:
        scene = open_scene(DATA / "simulated" / f"{name}.tif")
        image = scene.read().astype(np.float64)
        truth = values(DATA / "simulated" / f"{name}_truth.tif")
        raw.append("{:.1f} / {:.1f}".format(*whole_and_deep(image, truth)))
        for method, regression in rows:
            try:
                whole, deep = whole_and_deep(cleaned(scene, image, method, regression), truth)
            except DeglintError:
                rows[method, regression].append("-")
                continue
            rows[method, regression].append(f"{whole:.1f} / {deep:.1f}")
            if regression == "ols" and method in trial[name]:
                recorded = trial[name][method]
                checks.append([name, method, *(f"{e:.2f}" for e in (whole, recorded["all"], deep, recorded["deep"]))])
    floor = [f"{trial[n]['floor']['all']:.1f} / {trial[n]['floor']['deep']:.1f}" for n in names]
    body = [["noise alone", *floor], ["nothing done", *raw]]
    body += [[f"{method} {regression}".strip(), *errors] for (method, regression), errors in rows.items()]
    note = ("Whole crop / deep water, in percent of the water level; the sample is the deep water, the NIR is NIR1. "
            "\"-\": the method needs a band that the sensor lacks.")  # fmt: skip
    say("Error against truth [%]", ("", *names), body, note)
    note = "A trial of the same methods on the same crops, made by another program, recorded these."
    head = ("scene", "method", "whole", "recorded", "deep", "recorded")
    say("The same beside recorded errors [%]", head, checks, note)


def whole_and_deep(image: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Error of the whole image and of its deep water [% of the water level]."""
    return float(rms_error(image, truth, slice(None))), float(rms_error(image, truth, slice(DEEP)))


def cleaned(scene: Scene, image: np.ndarray, method: str, regression: str) -> np.ndarray:
    """Remove the glint of an image by a method that is fitted to the deep water of the image."""
    sample = np.zeros(image.shape[1:], np.bool_)
    sample[:, :DEEP] = True
    options: dict[str, Any] = {"regression": regression} if regression else {}
    return remove.apply(image, remove.fit(method, image, nir=NIR1, sample=sample, bands=scene.bands, **options))


def real(quick: bool) -> None:
    """Print, for a real reef under strong wave glint, the slopes and what is left of the waves in deep water."""
    folder = DATA / "sentinel2"
    scene = open_scene(folder / "palau.tif")
    block, polygon = scene.read(), str(folder / "palau_deep_water.geojson")
    inside = open_area(polygon, scene, "--sample").read(((0, scene.height), (0, scene.width)))
    place = [scene.names.index(b) for b in PUBLISHED]
    rows = [["nothing done", "", *(f"{block[b][inside].std(dtype=float):.2f}" for b in place), "", "", ""]]
    published = [f"{slope:.6f}" for slope, _ in PUBLISHED.values()], [f"{left:.2f}" for _, left in PUBLISHED.values()]
    rows.append(["recorded: hedley ols", "polygon", *published[1], *published[0]])
    regressed = [c for c in combinations(quick) if c[1]]
    for said, sample, found in (("polygon", polygon, combinations(quick)), ("auto", "auto", regressed)):
        for method, regression in found:
            recipe = Recipe(method=method, sample=sample, regression=regression or "auto", nir=("B08",), mask="none",
                            compensate="off")  # fmt: skip
            label = f"{method} {regression}".strip()
            try:
                model = fit_scene(scene, recipe).model
            except DeglintError:
                rows.append([label, said, *["-"] * 6])
                continue
            clean = remove.apply(block, model)
            slopes = {f.band: f.slope for f in model.fits}
            left = [f"{clean[b][inside].std(dtype=float):.2f}" for b in place]
            rows.append([label, said, *left, *(f"{slopes[b]:.6f}" if b in slopes else "-" for b in place)])
    head = ("", "sample", *(f"std {b}" for b in PUBLISHED), *(f"slope {b}" for b in PUBLISHED))
    note = ("Standard deviation [DN] inside the hand-drawn deep-water polygon after correction, whatever the sample. "
            "\"-\": the method needs a band that the sensor lacks.")  # fmt: skip
    say("Sentinel-2, Palau, NIR B08", head, rows, note)


def main(quick: bool) -> None:
    """Print the tables of the simulated and of the real scenes."""
    print("## Error\n\n" + machine())
    if (DATA / "simulated" / "trial_errors.json").exists():
        simulated(quick)
    else:
        print("\nSkipped: the simulated scenes do not lie beside the project.")
    if (DATA / "sentinel2" / "palau.tif").exists():
        real(quick)
    else:
        print("\nSkipped: the real scenes do not lie beside the project.")
