"""Requested and observed false-alarm rates of scenes; a table of `python -m benchmarks detection`.

Every scene is deglinted and scored with the default options. A false alarm is a pixel above the threshold. Only those
pixels count that have a score, lie in the hand-checked water (if the scene has such a mask), and lie farther than 7
pixels from labelled ships and other targets. Boats that nobody labelled are counted as false alarms.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deglint import remove_glint
from deglint.morphology import grown
from detect.pipeline import Recipe, score_file

from .files import DATA, plane
from .ships import PORT_BANDS, PORTS

REQUESTED_RATES = (1e-3, 1e-4)
NEAR = 15
"""Side of the square that grows labels [pixel]: a ship's blur and its nearest wake are no false alarms."""


@dataclass(frozen=True)
class Labelled:
    """A scene: its name and image files, and the masks of its targets and of its water, if it has them."""

    name: str
    source: tuple[Path, ...]
    targets: Path | None = None
    water: Path | None = None


def scenes(folder: Path) -> list[Labelled]:
    """Every labelled scene whose image files exist in the folder."""
    found = []
    for name in PORTS:
        place = folder / "real" / name
        bands = tuple(place / f"{b}.tiff" for b in PORT_BANDS)
        found.append(Labelled(name, bands, place / "ships.tif", place / "water.tif"))
    for name in ("casablanca", "honolulu"):
        place = folder / "sentinel2"
        found.append(Labelled(name, (place / f"{name}.tif",), place / f"{name}_ships.tif", place / f"{name}_water.tif"))
    for path in sorted((folder / "simulated").glob("*_objects.tif")):
        name = path.stem.removesuffix("_objects")
        found.append(Labelled(name, (path.with_name(f"{name}.tif"),), path))
    for name in ("sentinel2_w5", "p050_w9_60ms", "p124_w9_wv3", "p200_w9_wv3", "p300_w5_60ms"):
        place = folder / "wide"
        found.append(Labelled(name, (place / f"{name}.tif",), place / f"{name}_mask.tif"))
    return [s for s in found if all(p.exists() for p in s.source)]


def observed(scene: Labelled, scratch: Path) -> list[tuple[float, str, int]]:
    """For each requested rate: observed over requested rate, law of the threshold, expected number of false alarms."""
    clean = scratch / "clean.tif"
    remove_glint([str(p) for p in scene.source], clean, overwrite=True)
    out = []
    for rate in REQUESTED_RATES:
        score_file(clean, scratch / "scores.tif", Recipe(pfa=rate), overwrite=True)
        scores = plane(scratch / "scores.tif")
        counted = np.isfinite(scores)
        if scene.targets is not None:
            counted &= ~grown(plane(scene.targets) > 0, NEAR)
        if scene.water is not None:
            counted &= plane(scene.water) > 0
        said: dict[str, Any] = json.loads((scratch / "scores.tif.json").read_text())["threshold"]
        share = float((scores[counted] > said["value"]).mean()) / rate
        out.append((share, said["method"], round(rate * np.count_nonzero(counted))))
    return out


def tables(directory: Path | None) -> Iterator[tuple[str, tuple[str, ...], list[list[str]]]]:
    """Name, head and rows of the table: one row for each scene in `directory`, by default `DATA`."""
    rows = []
    for scene in scenes(directory or DATA):
        with tempfile.TemporaryDirectory() as scratch:
            rows.append([scene.name, *(f"{s:.2f} ({law}, {n})" for s, law, n in observed(scene, Path(scratch)))])
    yield "alarms", ("scene", *(f"{r:g}" for r in REQUESTED_RATES)), rows
