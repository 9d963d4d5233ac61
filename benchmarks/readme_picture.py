"""The pictures of the README: `python -m benchmarks.readme_picture [DIRECTORY]` writes them to docs/.

`before_after.png`: a sample scene, its truth, and what `deglint remove` makes of it, in one stretch in which sun glint
is white; below each stands its error. `found.png`: anomalies that `rxdetect score` finds in the result.
`simulated.png`: the other sample scene, as the sensor sees it and without sun glint.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from deglint import open_scene, remove_glint
from deglint.scene import Scene
from detect import Recipe, score_file
from detect.bench.measure import rms_error

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_data"
RGB = (660.0, 555.0, 480.0)
"""Wavelengths that are shown as red, green and blue [nm]."""
GAMMA = 1.5
"""Of the display: deep water is dark beside glint."""
BAR = 30
"""Height of the line of text [pixel]."""
RATE = 1e-4
"""Requested false-alarm rate of the anomalies that are marked, per pixel."""
MARK = (255, 210, 0)
"""Colour of their circles."""

Image = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]


def main(out: Path) -> None:
    """Write the pictures."""
    scene = open_scene(SAMPLES / "sea.tif")
    with tempfile.TemporaryDirectory() as place:
        result, objects = Path(place) / "clean.tif", Path(place) / "found.geojson"
        remove_glint(SAMPLES / "sea.tif", result)
        clean = open_scene(result).read().astype(np.float64)
        score_file(result, Path(place) / "scores.tif", Recipe(pfa=RATE), objects=objects)
        found = [f["properties"] for f in json.loads(objects.read_text(encoding="utf-8"))["features"]]
    truth = values("sea_truth.tif")
    images = {"raw": values("sea.tif"), "truth": truth, "deglint remove": clean}
    panels = stretched(images, scene, 75.0)
    titles = [
        name if name == "truth" else f"{name}: error {rms_error(image, truth):.0f} %" for name, image in images.items()
    ]
    write(out / "before_after.png", beside(panels, titles))
    write(out / "found.png", marked(panels[-1], [(o["column"], o["row"]) for o in found]))
    fine = open_scene(SAMPLES / "sea_025m.tif")
    parts = {"raw": values("sea_025m.tif"), "truth": values("sea_025m_truth.tif")}
    write(out / "simulated.png", beside(stretched(parts, fine, 50.0), list(parts)))


def values(name: str) -> Image:
    """Physical values of a file beside the samples."""
    return open_scene(SAMPLES / name).read().astype(np.float64)


def rgb(scene: Scene) -> list[int]:
    """The bands nearest to red, green and blue."""
    return [int(np.argmin([abs((b.wavelength or 0.0) - w) for b in scene.bands])) for w in RGB]


def stretched(images: dict[str, Image], scene: Scene, percentile: float) -> list[Picture]:
    """Pictures in one stretch: white is the 99.9th percentile of the truth, or this one of the raw image [%]."""
    bands = rgb(scene)
    truth = images["truth"][bands]
    glint = (images["raw"][bands] - truth).mean(axis=(1, 2))[:, None, None]  # divides each band, so that glint is white
    white = max(np.percentile(truth / glint, 99.9), np.percentile(images["raw"][bands] / glint, percentile))
    units = (np.clip(image[bands] / glint / white, 0, 1) ** (1 / GAMMA) for image in images.values())
    return [np.ascontiguousarray((unit * 255).astype(np.uint8).transpose(1, 2, 0)) for unit in units]


def beside(panels: list[Picture], titles: list[str]) -> Picture:
    """Pictures side by side, each with a line of text below it."""
    parts = []
    for panel, title in zip(panels, titles, strict=True):
        bar = np.full((BAR, panel.shape[1], 3), 255, np.uint8)
        cv2.putText(bar, title, (4, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
        column = np.vstack([panel, bar])
        parts += [column, np.full((column.shape[0], 6, 3), 255, np.uint8)]
    return np.hstack(parts[:-1])


def marked(panel: Picture, places: list[tuple[float, float]]) -> Picture:
    """A picture with a circle around each place (column, row)."""
    large: Any = panel.repeat(2, axis=0).repeat(2, axis=1)
    for column, row in places:
        cv2.circle(large, (round(2 * column) + 1, round(2 * row) + 1), 18, MARK, 1, cv2.LINE_AA)
    return np.asarray(large, np.uint8)


def write(path: Path, picture: Picture) -> None:
    """Write a PNG and say how large it is."""
    cv2.imwrite(str(path), picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    sys.stdout.write(f"{path}: {path.stat().st_size / 1000:.0f} kB\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs")
