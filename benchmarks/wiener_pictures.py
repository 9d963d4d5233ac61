"""Pictures for docs/methods.md: simulated seas before and after removal by Hedley's method and by the Wiener filter."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from deglint import Recipe, open_scene, remove_glint
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, SimulatedScene, SubmergedObject, simulate
from detect.bench.measure import rms_error

Image = npt.NDArray[np.float64]

DOCS = Path(__file__).parents[1] / "docs"
SHOWN = 140
"""Side of the part of a scene that is shown [pixel]; pixels are drawn twice as large."""
GAMMA = 1.3


@dataclass(frozen=True)
class View:
    """A scene to show: preset of the sensor, wind [m/s], zenith of the sun [degree], name of the picture."""

    sensor: str
    wind: float
    sun_zenith: float
    name: str


VIEWS = (View("sentinel2", 6.0, 43.0, "wiener_10m.png"), View("worldview3", 8.0, 40.0, "wiener_1m.png"))


def simulated(view: View) -> SimulatedScene:
    """A sea with three patches of the bottom under 3, 6 and 9 m of water, 30 pixels wide."""
    sensor = preset(view.sensor)
    places = [(sensor.gsd * (30 + 40 * n), sensor.gsd * (40 + 30 * n), 3.0 * n + 3) for n in range(3)]
    shoals = tuple(
        SubmergedObject(corners=_disc(x, y, sensor.gsd * 15), reflectance=0.06, depth=depth) for x, y, depth in places
    )
    return simulate(
        Setup(sensor=sensor, size=(384, 384), wind=view.wind, sun_zenith=view.sun_zenith, objects=shoals, seed=5),
        workers=2,
    )  # fmt: skip


def _disc(x: float, y: float, radius: float) -> tuple[tuple[float, float], ...]:
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    return tuple((float(x + radius * np.cos(a)), float(y + radius * np.sin(a))) for a in angles)


def cleaned(scene: SimulatedScene) -> dict[str, Image]:
    """Physical values of a scene: raw, true, and after each method."""
    found = {}
    with tempfile.TemporaryDirectory() as place:
        path = Path(place)
        write_scene(scene, path / "sea")
        found["raw"] = open_scene(path / "sea.tif").read().astype(np.float64)
        found["truth"] = open_scene(path / "sea_truth.tif").read().astype(np.float64)
        for method in ("hedley", "wiener"):
            recipe = Recipe(method=method, mask="none", compensate="off")
            remove_glint(path / "sea.tif", path / f"{method}.tif", recipe)
            found[method] = open_scene(path / f"{method}.tif").read().astype(np.float64)
    return found


def panel(images: dict[str, Image], wavelengths: list[float]) -> npt.NDArray[np.uint8]:
    """The images side by side, in one stretch that makes glint white; below, the error of the three bands."""
    rgb = [int(np.argmin(np.abs(np.array(wavelengths) - w))) for w in (660.0, 555.0, 480.0)]
    truth = images["truth"]
    glint = (images["raw"][rgb] - truth[rgb]).mean(axis=(1, 2))[:, None, None]  # is white
    white = max(np.percentile(truth[rgb] / glint, 99.5), np.percentile(images["raw"][rgb] / glint, 85))
    tiles = []
    for name, image in images.items():
        unit = np.clip(image[rgb, :SHOWN, :SHOWN] / glint / white, 0, 1) ** (1 / GAMMA)
        picture = (unit * 255).astype(np.uint8).transpose(1, 2, 0).repeat(2, axis=0).repeat(2, axis=1)
        said = name if name == "truth" else f"{name}: {rms_error(image[rgb], truth[rgb], slice(None)):.1f} %"
        bar = np.full((26, picture.shape[1], 3), 255, np.uint8)
        cv2.putText(bar, said, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
        tiles += [np.vstack([picture, bar]), np.full((picture.shape[0] + 26, 6, 3), 255, np.uint8)]
    return np.hstack(tiles[:-1])


def main(folder: Path | None = None) -> None:
    """Write the pictures."""
    for view in VIEWS:
        scene = simulated(view)
        images = cleaned(scene)
        drawn: Any = panel(images, [float(b.wavelength or 0) for b in scene.setup.sensor.bands])
        target = (folder or DOCS) / view.name
        cv2.imwrite(str(target), drawn[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
        print(f"{target}: {target.stat().st_size / 1000:.0f} KB")
