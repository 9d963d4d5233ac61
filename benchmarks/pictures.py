"""Pictures of simulated scenes for docs/: raw, truth, `--method hedley` and `deglint remove`, in one stretch.

`python -m benchmarks pictures [--directory FOLDER]`. Glint is white. Below each stands the error of the whole scene.
The scenes lie beside the project, but for one of its samples; those that are not there are left out.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from deglint import Recipe, correct, fit_scene, open_scene

from .error import DATA
from .readme_picture import SAMPLES, beside, stretched, write
from .scenes import Known
from .timing import ROOT

SIDE = 140
"""Of the part that is shown, drawn twice as large [pixel]: four of them stay below 250 kB."""
HEDLEY = Recipe(method="hedley", compensate="off")
SUBTRACT = Recipe(method="nir-subtraction", compensate="off")
POSTERIOR = Recipe(compensate="targets, remove, posterior")


@dataclass(frozen=True)
class View:
    """A scene, the upper left corner of what is shown [pixel], the percentile of the raw image that is white [%].

    The error of a remedy is printed, too, where the default fails and another recipe does not.
    """

    path: Path
    row: int
    column: int
    name: str
    percentile: float = 75.0
    remedy: Recipe | None = None


VIEWS = (
    View(DATA / "wide" / "shallow_patches_w7_0ms.tif", 90, 150, "case_shallow.png"),
    View(DATA / "wide" / "resampled_cubic_w9_60ms.tif", 90, 150, "case_resampled.png"),
    View(DATA / "wide" / "p124_w9_wv3.tif", 90, 150, "case_worldview.png"),
    View(DATA / "wide" / "into_glint_w9_60ms.tif", 90, 150, "case_into_glint.png"),
    View(DATA / "wide" / "sentinel2_w5.tif", 90, 150, "case_sheet.png", remedy=SUBTRACT),
    View(SAMPLES / "sea_025m.tif", 90, 150, "case_reef.png", remedy=POSTERIOR),
)


def drawn(view: View, target: Path) -> None:
    """Write the picture of a scene, and print the errors and what was chosen."""
    known, scene = Known.of(view.path), open_scene(view.path)
    cover = view.path.with_name(f"{view.path.stem}_cover.tif")
    if cover.exists():  # foam and boats are no open water, nor are the pixels that optics blur them into
        covered = (open_scene(cover).read() > 0).any(axis=0).astype(np.uint8)
        known = replace(known, counts=cv2.dilate(covered, np.ones((9, 9), np.uint8)) == 0)
    images = {"raw": scene.read().astype(float), "truth": known.truth}
    images["--method hedley"] = correct(scene, fit_scene(scene, HEDLEY)).astype(float)
    fitted = fit_scene(scene)
    images["deglint remove"] = correct(scene, fitted).astype(float)
    part = slice(None), slice(view.row, view.row + SIDE), slice(view.column, view.column + SIDE)
    panels = stretched({name: image[part] for name, image in images.items()}, scene, view.percentile)
    large = [panel.repeat(2, axis=0).repeat(2, axis=1) for panel in panels]
    errors = {name: known.error(image) for name, image in images.items() if name != "truth"}
    titles = [f"{name}: error {errors[name]:.0f} %" if name in errors else name for name in images]
    write(target, beside(large, titles))
    said = ", ".join(f"{name} {error:.1f} %" for name, error in errors.items())
    if view.remedy:
        better = known.error(correct(scene, fit_scene(scene, view.remedy)).astype(float))
        said += f", {view.remedy.method} {view.remedy.compensate} {better:.1f} %"
    print(f"{view.path.stem}: {said}; {fitted.model.method}, {fitted.chain.text or 'no stages'}")


def main(directory: Path | None) -> None:
    """Write the pictures."""
    logging.getLogger("deglint").setLevel(logging.ERROR)
    for view in VIEWS:
        if view.path.exists():
            drawn(view, (directory or ROOT / "docs") / view.name)
        else:
            print(f"{view.name}: {view.path.name} is not at hand")
