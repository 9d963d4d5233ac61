"""Simulated scenes with truth, recorded beside the project or made here, and the error of an image of them.

A recorded scene is NAME.tif with NAME_truth.tif, and NAME_mask.tif (band 2: pixels that count; tag `level`: water in
each band) where not all pixels count. Recorded scenes are no part of the project; without them only the own are used.
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
SIDE = 384
"""Of own scenes [pixel]; the left half is deep water without objects."""
REFLECTANCES, WIDTH = (0.02, 0.05, 0.10, 0.20), 4.0
"""Of the objects at 5 m depth on the right, a column each, and how wide they are [m]."""
VISIBLE = 690.0
"""Wavelength up to which bands are judged [nm]; all but the last where wavelengths are not known."""


def outline(kind: str, right: float, down: float) -> tuple[tuple[float, float], ...]:
    """Corners of a square or disc 4 m wide, or of a diamond with the area of such a square [m]."""
    turn = np.linspace(0, 2 * np.pi, 48 if kind == "disc" else 4, endpoint=False) + np.pi / 4 * (kind == "square")
    radius = WIDTH / 2 * (1 if kind == "disc" else np.sqrt(2))
    return tuple((right + radius * float(np.cos(t)), down + radius * float(np.sin(t))) for t in turn)


def objects(*kinds: str, gsd: float = 0.25) -> tuple[SubmergedObject, ...]:
    """Four columns of objects, one a reflectance, in the right half; of several kinds, row by row."""
    across, down = SIDE / 2 / len(REFLECTANCES), 64
    places = [(kinds[i % len(kinds)], SIDE / 2 + (j + 0.5) * across, (i + 0.5) * down, r)
              for i in range(SIDE // down) for j, r in enumerate(REFLECTANCES)]  # fmt: skip
    return tuple(SubmergedObject(corners=outline(k, x * gsd, y * gsd), reflectance=r, depth=5.0)
                 for k, x, y, r in places)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A scene to simulate; `delay` between neighbouring bands [s], None for those of the sensor itself."""

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
        """Name of the files of the scene, without suffix."""
        delay = "wv3" if self.delay is None else f"{1000 * self.delay:.0f}ms"
        more = f"_{self.resampling}" * bool(self.resampling) + "_f30" * self.sensor.endswith("f30")
        return f"p{100 * self.gsd:03.0f}_w{self.wind:g}_{delay}{more}_seed{self.seed}"

    @property
    def setup(self) -> Setup:
        """Setup of the simulation."""
        sensor = replace(preset(self.sensor), gsd=self.gsd)
        sensor = sensor if self.delay is None else sensor.delayed(self.delay)
        there, artefacts = objects(*self.kinds, gsd=self.gsd), Artefacts(resampling=self.resampling)
        return Setup(sensor=sensor, size=(SIDE, SIDE), wind=self.wind, patch=self.patch, seed=self.seed, objects=there,
                     artefacts=artefacts)  # fmt: skip

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
"""Scenes of seeds that no constant was set on; the first are the quick ones."""
QUICK = {
    "simulated": ("wind05_delay60", "wind09_delay60"),
    "wide": ("p124_w9_wv3", "f30_w12_0ms", "shallow_texture_w7_0ms", "resampled_cubic_w9_60ms", "discs_w9_60ms"),
}

WITHOUT_FOAM = 1.1  # largest NIR of water without foam, over the level of the water: foam in 0.1 % of a pixel adds more
FOAM_BESIDE = 3  # side of the square around a pixel without foam [pixel]: bands are misregistered by less than a pixel


@dataclass(frozen=True, eq=False)
class Known:
    """A scene's file, its truth, the water's level in each band, pixels that count and bands that are judged."""

    path: Path
    truth: Array
    level: Array
    counts: npt.NDArray[np.bool_]
    visible: tuple[int, ...]

    @classmethod
    def of(cls, path: Path) -> Known:
        """With what lies beside the file."""
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
        """Root mean square error of the visible bands [% of the water's level]."""
        parts = [np.nanmean(((image[b] - self.truth[b]) / self.level[b])[self.counts] ** 2) for b in self.visible]
        return 100 * float(np.sqrt(np.mean(parts)))


def deglinted(path: Path, recipe: Recipe | None = None) -> tuple[Array, Fitted]:
    """The scene without glint, as physical values, and what was fitted."""
    scene = open_scene(path)
    fitted = fit_scene(scene, recipe)
    return correct(scene, fitted).astype(np.float64), fitted


def scenes(quick: bool, say: Callable[[str], None] = print) -> Iterator[tuple[str, Known]]:
    """Group and scene: those beside the project, and the own, whose files are there until the last is done."""
    for group, few in QUICK.items():
        stems = [p.name.removesuffix("_truth.tif") for p in sorted((DATA / group).glob("*_truth.tif"))]
        if not stems:
            say(f"\nSkipped: the scenes of {group}/ do not lie beside the project.")
        for stem in few if quick and stems else stems:
            yield f"{group}/", Known.of(DATA / group / f"{stem}.tif")
    with tempfile.TemporaryDirectory() as folder:
        for case in OWN[: 3 if quick else None]:
            yield "own seeds", Known.of(case.written(Path(folder)))
