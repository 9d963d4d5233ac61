"""Simulated scenes whose truth is known, and the errors of images after removal.

Recorded scenes lie beside the project and are no part of it: NAME.tif, NAME_truth.tif and, if not all pixels count,
NAME_mask.tif (band 2: pixels that count; tag `level`: water level of each band). Own scenes are simulated here.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rasterio

from deglint import Recipe, correct, fit_scene, open_scene
from deglint.morphology import grown
from deglint.physics.presets import preset
from deglint.pipeline import Fitted
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, SubmergedObject, simulate
from deglint.simulate.artefacts import Artefacts, Kernel
from deglint.simulate.cover import FOAM

from .files import DATA, values

Array = npt.NDArray[np.floating[Any]]
SCENE_SIDE = 384
"""Side of own scenes [pixel]; their left half is deep water without objects."""
OBJECT_REFLECTANCES, OBJECT_WIDTH = (0.02, 0.05, 0.10, 0.20), 4.0
"""Reflectance of the objects in each column of the right half, at a depth of 5 m; and their width [m]."""
VISIBLE = 690.0
"""Errors are those of bands of shorter wavelengths [nm], or of all but the last if wavelengths are unknown."""


def outline(kind: str, right: float, down: float) -> tuple[tuple[float, float], ...]:
    """Corners of a square or disc 4 m wide, or of a diamond of the square's area, around (right, down) [m]."""
    turn = np.linspace(0, 2 * np.pi, 48 if kind == "disc" else 4, endpoint=False) + np.pi / 4 * (kind == "square")
    radius = OBJECT_WIDTH / 2 * (1 if kind == "disc" else np.sqrt(2))
    return tuple((right + radius * float(np.cos(t)), down + radius * float(np.sin(t))) for t in turn)


def objects(*kinds: str, gsd: float = 0.25) -> tuple[SubmergedObject, ...]:
    """Objects in four columns of the right half. Each column has one reflectance, and kinds take turns by rows."""
    across, down = SCENE_SIDE / 2 / len(OBJECT_REFLECTANCES), 64
    places = [(kinds[i % len(kinds)], SCENE_SIDE / 2 + (j + 0.5) * across, (i + 0.5) * down, r)
              for i in range(SCENE_SIDE // down) for j, r in enumerate(OBJECT_REFLECTANCES)]  # fmt: skip
    return tuple(SubmergedObject(corners=outline(k, x * gsd, y * gsd), reflectance=r, depth=5.0)
                 for k, x, y, r in places)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A scene to simulate. `delay` is the time between neighbouring bands [s]; with None, the sensor's own."""

    wind: float
    delay: float | None = 0.06
    gsd: float = 0.25
    seed: int = 0
    sensor: str = "thesis"
    patch: float = 0.06
    kinds: tuple[str, ...] = ("square", "disc", "diamond")
    resampling: Kernel | None = None

    @property
    def name(self) -> str:
        """Name of the files of the scene, without their suffixes."""
        delay = "wv3" if self.delay is None else f"{1000 * self.delay:.0f}ms"
        more = f"_{self.resampling}" * bool(self.resampling) + "_f30" * self.sensor.endswith("f30")
        return f"p{100 * self.gsd:03.0f}_w{self.wind:g}_{delay}{more}_seed{self.seed}"

    @property
    def setup(self) -> Setup:
        """Parameters of the simulation."""
        sensor = replace(preset(self.sensor), gsd=self.gsd)
        sensor = sensor if self.delay is None else sensor.delayed(self.delay)
        there, artefacts = objects(*self.kinds, gsd=self.gsd), Artefacts(resampling=self.resampling)
        return Setup(sensor=sensor, size=(SCENE_SIDE, SCENE_SIDE), wind=self.wind, patch=self.patch, seed=self.seed,
                     objects=there, artefacts=artefacts)  # fmt: skip

    def written(self, folder: Path) -> Path:
        """Simulate the scene, write it to a folder, and return its image file."""
        write_scene(simulate(self.setup), folder / self.name, overwrite=True)
        return folder / f"{self.name}.tif"


OWN = (
    Case(9, 0.06, seed=9103), Case(9, 0.0, 1.0, 9108, "worldview3"), Case(6, None, 1.24, 9109, "worldview3"),
    Case(5, 0.0, seed=9104), Case(7, 0.02, 0.5, 9106), Case(3, 0.06, seed=9102), Case(7, 0.06, 0.12, 9101),
    Case(12, 0.02, seed=9105), Case(9, None, 0.5, 9107, "worldview3"), Case(12, None, 1.24, 9110, "worldview3"),
    Case(8, 0.06, seed=9111, sensor="thesis-f30"), Case(8, 0.06, seed=9112, resampling="cubic"),
)  # fmt: skip
"""Own scenes. No constant was set on their seeds. With `--quick`, only the first three are used."""
QUICK_SCENES = {
    "simulated": ("wind05_delay60", "wind09_delay60"),
    "wide": ("p124_w9_wv3", "f30_w12_0ms", "shallow_texture_w7_0ms", "resampled_cubic_w9_60ms", "discs_w9_60ms"),
}
"""Recorded scenes of each folder that are used with `--quick`."""
WITHOUT_FOAM = 1.1  # largest NIR of water without foam, over the level of the water: foam in 0.1 % of a pixel adds more
FOAM_BESIDE = 3  # side of the square around a pixel without foam [pixel]: bands are misregistered by less than a pixel


@dataclass(frozen=True, eq=False)
class Known:
    """A scene's file, its truth, the water level of each band, and the pixels and bands whose errors count."""

    path: Path
    truth: Array
    level: Array
    counts: npt.NDArray[np.bool_]
    visible: tuple[int, ...]

    @classmethod
    def of(cls, path: Path) -> Known:
        """Read the truth of a scene, and its mask and cover if there are any, from the files beside it."""
        bands = open_scene(path).bands
        truth = values(path.with_name(f"{path.stem}_truth.tif"))
        level, counts = np.median(truth, axis=(1, 2)), np.ones(truth.shape[1:], np.bool_)
        mask = path.with_name(f"{path.stem}_mask.tif")
        if mask.exists():
            with rasterio.open(mask) as given:
                counts, level = given.read(2) > 0, np.array(json.loads(given.tags()["level"]))
        cover = path.with_name(f"{path.stem}_cover.tif")
        if cover.exists():  # foam and boats are no open water, nor are the pixels that optics blur them into
            covers = open_scene(cover).read()
            counts = ~grown((covers > 0).any(axis=0), 9)
            if (covers == FOAM).any():  # less of it than half a pixel is not marked, and is part of the truth
                counts &= ~grown(truth[-1] > WITHOUT_FOAM * level[-1], FOAM_BESIDE)
        visible = tuple(i for i, b in enumerate(bands) if b.wavelength and b.wavelength < VISIBLE)
        return cls(path, truth, level, counts, visible or tuple(range(len(bands) - 1)))

    def error(self, image: Array) -> float:
        """Root mean square error of an image in the pixels and bands that count [% of the water level]."""
        parts = [np.nanmean(((image[b] - self.truth[b]) / self.level[b])[self.counts] ** 2) for b in self.visible]
        return 100 * float(np.sqrt(np.mean(parts)))


def deglinted(path: Path, recipe: Recipe | None = None) -> tuple[Array, Fitted]:
    """Remove the glint of a file, by default or by a recipe. Return the physical values, and what was fitted."""
    scene = open_scene(path)
    fitted = fit_scene(scene, recipe)
    return correct(scene, fitted).astype(np.float64), fitted


def scenes(quick: bool, say: Callable[[str], None] = print) -> Iterator[tuple[str, Known]]:
    """Group and scene, of the recorded and then of the own scenes, whose files are deleted after the last one."""
    for group, few in QUICK_SCENES.items():
        stems = [p.name.removesuffix("_truth.tif") for p in sorted((DATA / group).glob("*_truth.tif"))]
        if not stems:
            say(f"\nSkipped: the scenes of {group}/ do not lie beside the project.")
        for stem in few if quick and stems else stems:
            yield f"{group}/", Known.of(DATA / group / f"{stem}.tif")
    with tempfile.TemporaryDirectory() as folder:
        for case in OWN[: 3 if quick else None]:
            yield "own seeds", Known.of(case.written(Path(folder)))
