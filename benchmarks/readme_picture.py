"""The picture of the README: a sample scene, its truth, and what `deglint remove` makes of it.

`python -m benchmarks.readme_picture [OUT.png]` writes docs/before_after.png. All panels have one stretch, in which sun
glint is white; below each stands its error against the truth.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from deglint import open_scene, remove_glint
from detect.bench.measure import rms_error

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "sample_data" / "sea.tif"
RGB = (660.0, 555.0, 480.0)
"""Wavelengths that are shown as red, green and blue [nm]."""
GAMMA = 1.5
"""Of the display: deep water is dark beside glint."""
BAR = 30
"""Height of the line of text [pixel]."""


def main(out: Path) -> None:
    """Write the picture."""
    scene = open_scene(SCENE)
    bands = [int(np.argmin([abs((b.wavelength or 0.0) - w) for b in scene.bands])) for w in RGB]
    with tempfile.TemporaryDirectory() as place:
        clean = Path(place) / "clean.tif"
        remove_glint(SCENE, clean)
        paths = {"raw": SCENE, "truth": SCENE.with_name("sea_truth.tif"), "deglint remove": clean}
        images = {name: open_scene(path).read(bands=bands).astype(np.float64) for name, path in paths.items()}
    drawn: Any = picture(images)
    cv2.imwrite(str(out), drawn[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    sys.stdout.write(f"{out}: {out.stat().st_size / 1000:.0f} kB\n")


def picture(images: dict[str, npt.NDArray[np.float64]]) -> npt.NDArray[np.uint8]:
    """The images side by side, each with its error in percent of the water below it."""
    truth = images["truth"]
    glint = (images["raw"] - truth).mean(axis=(1, 2))[:, None, None]  # divides each band, so that glint is white
    white = max(np.percentile(truth / glint, 99.9), np.percentile(images["raw"] / glint, 75))
    parts = []
    for name, image in images.items():
        unit = np.clip(image / glint / white, 0, 1) ** (1 / GAMMA)
        panel = (unit * 255).astype(np.uint8).transpose(1, 2, 0)
        text = name if name == "truth" else f"{name}: error {rms_error(image, truth, slice(None)):.0f} %"
        bar = np.full((BAR, panel.shape[1], 3), 255, np.uint8)
        cv2.putText(bar, text, (4, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
        column = np.vstack([panel, bar])
        parts += [column, np.full((column.shape[0], 6, 3), 255, np.uint8)]
    return np.hstack(parts[:-1])


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "before_after.png")
