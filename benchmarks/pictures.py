"""The pictures of simulated scenes in the README and in docs/: `python -m benchmarks pictures [--directory FOLDER]`.

Images are in natural colours, and all images of a picture have the same contrast stretch. Their errors are written
below them. Scenes are samples of the project, are simulated here, or lie beside the project; missing ones are left out.
"""

from __future__ import annotations

import json
import logging
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

import detect
from deglint import Recipe, open_scene, remove_glint
from deglint.physics.presets import preset
from deglint.plotting import natural_colour
from deglint.raster.simulated import write_scene
from deglint.scene import Scene
from deglint.simulate import Setup, SubmergedObject, simulate
from detect.bench.numbers import rms_error

from .files import DATA, values
from .scenes import Known, deglinted
from .timing import ROOT

Image = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]

SAMPLES = ROOT / "sample_data"
RGB = (660.0, 555.0, 480.0)
"""Wavelengths of the bands that are shown as red, green and blue [nm]."""
BAR = 30
"""Height of the line of text below an image [pixel]."""
MARKED_PFA = 1e-4
"""Requested false-alarm rate of the anomalies that are marked, per pixel."""
MARK_COLOUR = (255, 210, 0)
"""Colour (red, green, blue) of the circles around these anomalies."""

VIEW_SIDE = 140
"""Side of the shown part of a scene, before it is drawn twice as large [pixel]: four parts take less than 250 kB."""
HEDLEY = Recipe(method="hedley", compensate="off")
SUBTRACT = Recipe(method="nir-subtraction", compensate="off")
OPENING = Recipe(compensate="psf:2, identify-level:13, targets, replace-level, remove")


@dataclass(frozen=True)
class View:
    """A scene, and the upper left corner of the part that is shown [pixel]; `name` is that of the picture's file.

    If there is a recipe `remedy`, its error is printed, too.
    """

    path: Path
    row: int
    column: int
    name: str
    remedy: Recipe | None = None


VIEWS = (
    View(DATA / "wide" / "shallow_patches_w7_0ms.tif", 90, 150, "case_shallow.png"),
    View(DATA / "wide" / "resampled_cubic_w9_60ms.tif", 90, 150, "case_resampled.png"),
    View(DATA / "wide" / "p124_w9_wv3.tif", 90, 150, "case_worldview.png"),
    View(DATA / "wide" / "into_glint_w9_60ms.tif", 90, 150, "case_into_glint.png"),
    View(DATA / "wide" / "sentinel2_w5.tif", 90, 150, "case_sheet.png", remedy=SUBTRACT),
    View(SAMPLES / "sea_025m.tif", 90, 150, "case_reef.png", remedy=OPENING),
)


def drawn(view: View, target: Path) -> None:
    """Write the picture of a view to `target`; print the errors, and the method and chain that were chosen."""
    known, scene = Known.of(view.path), open_scene(view.path)
    images = {"raw": scene.read().astype(float), "truth": known.truth}
    images["--method hedley"] = deglinted(view.path, HEDLEY)[0]
    images["deglint remove"], fitted = deglinted(view.path)
    part = slice(None), slice(view.row, view.row + VIEW_SIDE), slice(view.column, view.column + VIEW_SIDE)
    panels = stretched({name: image[part] for name, image in images.items()}, scene)
    errors = {name: known.error(image) for name, image in images.items() if name != "truth"}
    titles = [f"{name}: error {errors[name]:.0f} %" if name in errors else name for name in images]
    write(target, beside(map(doubled, panels), titles))
    said = ", ".join(f"{name} {error:.1f} %" for name, error in errors.items())
    if view.remedy:
        better = known.error(deglinted(view.path, view.remedy)[0])
        said += f", {view.remedy.method} {view.remedy.compensate} {better:.1f} %"
    print(f"{view.path.stem}: {said}; {fitted.model.method}, {fitted.chain.text or 'no stages'}")


def readme(out: Path) -> None:
    """Write before_after.png, found.png (anomalies in a result), and simulated.png (a scene and its truth)."""
    fine, middle, coarse = (SAMPLES / f"{name}.tif" for name in ("sea_025m", "sea_1m", "sea"))
    known, scene = Known.of(fine), open_scene(fine)
    truth = values(fine.with_stem("sea_025m_truth"))
    images = {"raw": values(fine), "truth": truth, "deglint remove": deglinted(fine)[0]}
    titles = [n if n == "truth" else f"{n}: error {known.error(image):.0f} %" for n, image in images.items()]
    write(out / "before_after.png", beside(stretched(images, scene), titles))
    with tempfile.TemporaryDirectory() as place:
        result, objects = Path(place) / "clean.tif", Path(place) / "found.geojson"
        remove_glint(coarse, result)
        detect.score_file(result, Path(place) / "scores.tif", detect.Recipe(pfa=MARKED_PFA), objects=objects)
        found = [f["properties"] for f in json.loads(objects.read_text(encoding="utf-8"))["features"]]
        *_, panel = stretched({"raw": values(coarse), "clean": values(result)}, open_scene(coarse))
    write(out / "found.png", marked(panel, [(o["column"], o["row"]) for o in found]))
    pair = {"raw": values(middle), "truth": values(middle.with_stem("sea_1m_truth"))}
    write(out / "simulated.png", beside(stretched(pair, open_scene(middle)), list(pair)))


def wiener(out: Path) -> None:
    """Write pictures of seas with round shoals under 3, 6 and 9 m of water: raw, truth, and two methods."""
    seas = ("sentinel2", 6.0, 43.0, "wiener_10m.png"), ("worldview3", 8.0, 40.0, "wiener_1m.png")
    for name, wind, sun_zenith, target in seas:
        sensor, turns = preset(name), np.linspace(0, 2 * np.pi, 24, endpoint=False)
        disc = 15 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        shoals = []
        for n in range(3):
            corners = sensor.gsd * (disc + np.array([30 + 40 * n, 40 + 30 * n]))
            shoals.append(SubmergedObject(corners=tuple(map(tuple, corners)), reflectance=0.06, depth=3.0 * n + 3))
        setup = Setup(sensor=sensor, size=(384, 384), wind=wind, sun_zenith=sun_zenith, objects=tuple(shoals), seed=5)
        with tempfile.TemporaryDirectory() as place:
            write_scene(simulate(setup, workers=2), path := Path(place) / "sea")
            scene = open_scene(path := path.with_suffix(".tif"))
            images = {"raw": values(path), "truth": values(path.with_stem("sea_truth"))}
            for method in ("hedley", "wiener"):
                images[method] = deglinted(path, Recipe(method=method, mask="none", compensate="off"))[0]
        bands = rgb(scene)
        errors = {n: rms_error(i[bands], images["truth"][bands], slice(None)) for n, i in images.items()}
        titles = [n if n == "truth" else f"{n}: {error:.1f} %" for n, error in errors.items()]
        panels = stretched({n: i[:, :VIEW_SIDE, :VIEW_SIDE] for n, i in images.items()}, scene)
        write(out / target, beside(map(doubled, panels), titles))


def rgb(scene: Scene) -> list[int]:
    """Indices of the bands nearest to red, green and blue."""
    return [int(np.argmin([abs((b.wavelength or 0.0) - w) for b in scene.bands])) for w in RGB]


def stretched(images: dict[str, Image], scene: Scene) -> list[Picture]:
    """Pictures of images in natural colours, all with the same contrast stretch."""
    return natural_colour([image[rgb(scene)] for image in images.values()])


def doubled(panel: Picture) -> Picture:
    """The picture with every pixel twice as large."""
    return panel.repeat(2, axis=0).repeat(2, axis=1)


def beside(panels: Iterable[Picture], titles: list[str]) -> Picture:
    """One picture of several side by side, each with its title below it."""
    parts = []
    for panel, title in zip(panels, titles, strict=True):
        bar = np.full((BAR, panel.shape[1], 3), 255, np.uint8)
        cv2.putText(bar, title, (4, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
        column = np.vstack([panel, bar])
        parts += [column, np.full((column.shape[0], 6, 3), 255, np.uint8)]
    return np.hstack(parts[:-1])


def marked(panel: Picture, places: list[tuple[float, float]]) -> Picture:
    """A picture, twice as large, with a circle around each place (column, row)."""
    large: Any = doubled(panel)
    for column, row in places:
        cv2.circle(large, (round(2 * column) + 1, round(2 * row) + 1), 18, MARK_COLOUR, 1, cv2.LINE_AA)
    return np.asarray(large, np.uint8)


def write(path: Path, picture: Picture) -> None:
    """Write a picture as PNG, and print the size of the file."""
    cv2.imwrite(str(path), picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def main(directory: Path | None) -> None:
    """Write all pictures into a folder, by default docs/."""
    logging.getLogger("deglint").setLevel(logging.ERROR)
    out = directory or ROOT / "docs"
    readme(out)
    wiener(out)
    for view in VIEWS:
        if view.path.exists():
            drawn(view, out / view.name)
        else:
            print(f"{view.name}: {view.path.name} is not at hand")
