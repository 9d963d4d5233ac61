"""Ships found in real ports, with and without deglinting; a table of `python -m benchmarks detection`.

Its DIRECTORY (by default beside the project) holds real/PORT/B02.tiff ... B08.tiff with ships.tif (hand-drawn, numbers
of ships) and water.tif (1 = sea). A ship counts if over 60 % of the ring 5 to 15 pixels from it is sea. It is found if
an object lies within 2 pixels of it. An object in the sea farther from all labels is false; some are unlabelled boats.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio

from deglint import Recipe, open_scene, remove_glint
from deglint.morphology import grown
from deglint.readers.grid import ground_area
from detect import local_rx
from detect.global_rx import rx
from detect.objects import find
from detect.pipeline import Recipe as Search
from detect.pipeline import score_file

from .files import DATA, plane

Mask = npt.NDArray[np.bool_]
PORTS = ("gdynia", "athens", "klang", "cartagena")
PORT_BANDS = ("B02", "B03", "B04", "B08")
FALSE_PER_KM2 = (0.1, 1.0)
"""False objects per km2 at which ships are counted."""
REMOVALS = {"raw": None, "hedley": Recipe(method="hedley", compensate="off"), "default": Recipe()}
LOCAL_WINDOW = {"inner": 15, "outer": 31}
SEARCHED_WATER = 3e-3
"""Share of the water's pixels, those of the highest scores, in which objects are searched."""


@dataclass(frozen=True, eq=False)
class Port:
    """A port: its labelled ships and its water."""

    name: str
    labels: npt.NDArray[np.int64]  # number of the ship in each pixel, or 0
    water: Mask  # the hand-drawn sea
    searched: Mask  # this sea, and its holes that a ship could fill: objects count there
    near: dict[int, Mask]  # the pixels up to 2 pixels from each ship that counts
    km2: float  # area of `searched`

    @classmethod
    def read(cls, folder: Path) -> Port:
        """Read the labels and the water of a port from its folder."""
        with rasterio.open(folder / "ships.tif") as data:
            labels = data.read(1).astype(np.int64)
            area = ground_area(data.transform, data.crs, *labels.shape) or np.nan
        water = plane(folder / "water.tif") > 0
        _, parts, stats, _ = cv2.connectedComponentsWithStats((~water).astype(np.uint8), connectivity=8)
        small = stats[:, 4] < 400
        small[0] = False
        searched = water | small[parts]
        near = {}
        for number in range(1, int(labels.max()) + 1):
            own = labels == number
            if own.any() and water[grown(own, 31) & ~grown(own, 11)].mean() > 0.6:
                near[number] = grown(own, 5)
        return cls(folder.name, labels, water, searched, near, float(searched.sum() * area / 1e6))

    def found(self, objects: list[tuple[float, Mask, tuple[slice, slice]]]) -> list[int]:
        """Number of ships found at each of `FALSE_PER_KM2`, given the score, footprint and box of every object."""
        labelled, best = grown(self.labels > 0, 5), [0] * len(FALSE_PER_KM2)
        seen: set[int] = set()
        false = 0
        for _score, footprint, box in sorted(objects, key=lambda o: -o[0]):
            if (labelled[box] & footprint).any():
                seen |= {n for n, mask in self.near.items() if (mask[box] & footprint).any()}
            elif (self.searched[box] & footprint).any():
                false += 1
            best = [max(b, len(seen)) if false / self.km2 <= r else b for b, r in zip(best, FALSE_PER_KM2, strict=True)]
        return best


def peer(image: npt.NDArray[Any], where: Mask) -> npt.NDArray[np.float64]:
    """Global RX scores by the package spectral, with the mean and covariance of the pixels in `where`."""
    import spectral

    pixels = image[:, where].T[None]
    stats = spectral.calc_stats(pixels.astype(np.float64))
    return np.asarray(spectral.rx(np.moveaxis(image, 0, -1).astype(np.float64), background=stats))


ORFEO = shutil.which("otbcli_LocalRxDetection")


def orfeo(image: npt.NDArray[Any], _where: Mask) -> npt.NDArray[np.float32]:
    """Local RX scores by the Orfeo Toolbox, in the same window. It takes no mask: land in the window is background."""
    with tempfile.TemporaryDirectory() as scratch:
        source, out = Path(scratch) / "image.tif", Path(scratch) / "scores.tif"
        values = np.nan_to_num(image.astype(np.float32))
        profile = dict(zip(("count", "height", "width"), values.shape, strict=True))
        with rasterio.open(source, "w", driver="GTiff", dtype="float32", **profile) as data:
            data.write(values)
        radii = ["-ir", str(LOCAL_WINDOW["inner"] // 2), "-er", str(LOCAL_WINDOW["outer"] // 2)]
        command = [str(ORFEO), "-in", str(source), "-out", str(out), "float", *radii]
        subprocess.run(command, check=True, capture_output=True)
        return plane(out)


DETECTORS = {
    "global": lambda image, where: rx(image, mask=where),
    "local 15,31": lambda image, where: local_rx(image, mask=where, **LOCAL_WINDOW),
    "spectral, global": peer,
} | ({"OTB, local 15,31": orfeo} if ORFEO else {})
"""Detectors that are compared with `rxdetect score`, all on the same sea."""


def others(port: Port, image: npt.NDArray[Any], detector: Any) -> list[int]:
    """Numbers of ships that a detector finds in the hand-drawn sea and in those holes of it that a ship could fill."""
    scores = np.nan_to_num(np.asarray(detector(image, port.searched), np.float64), nan=-np.inf)
    scores[~port.searched] = -np.inf
    lowest = np.quantile(scores[port.water], 1 - SEARCHED_WATER)
    return port.found([(o.score_max, o.footprint, np.s_[slice(*o.bounds[0]), slice(*o.bounds[1])])
                       for o in find(scores > lowest, scores)])  # fmt: skip


def ours(port: Port, source: list[Path] | Path, scratch: Path) -> list[int]:
    """Numbers of ships that `rxdetect score --pfa 1e-3` finds; all other options have their defaults."""
    marked = scratch / "found.geojson"
    score_file(source, scratch / "scores.tif", Search(pfa=1e-3), objects=marked, overwrite=True)
    objects = []
    for feature in json.loads(marked.read_text())["features"]:
        known = feature["properties"]
        left, top, width, height = known["window"]
        box = np.s_[top : top + height, left : left + width]
        objects.append((known["score"], np.ones((height, width), np.bool_), box))
    return port.found(objects)


def tables(directory: Path | None) -> Iterator[tuple[str, tuple[str, ...], list[list[str]]]]:
    """Name, head and rows of the table: ships found by every detector, in the raw image and after two removals."""
    folder = (directory or DATA) / "real"
    if not (folder / PORTS[0] / "ships.tif").exists():
        raise SystemExit("detection: --directory names the folder that holds real/gdynia/ships.tif and the like.")
    ports = [Port.read(folder / name) for name in PORTS]
    if not ORFEO:
        print("Orfeo Toolbox (otbcli_LocalRxDetection) is not installed: its row is left out.", file=sys.stderr)
    rows = []
    for removal, recipe in REMOVALS.items():
        cells: dict[str, list[list[int]]] = {}
        for port in ports:
            source: list[Path] | Path = [folder / port.name / f"{band}.tiff" for band in PORT_BANDS]
            with tempfile.TemporaryDirectory() as place:
                scratch = Path(place)
                if recipe is not None:
                    remove_glint(source, scratch / "clean.tif", recipe)
                    source = scratch / "clean.tif"
                image = open_scene(source).read()
                for name, detector in DETECTORS.items():
                    cells.setdefault(name, []).append(others(port, image, detector))
                cells.setdefault("auto", []).append(ours(port, source, scratch))
        for name, counts in cells.items():
            rows.append([removal, name, *("; ".join(map(str, c)) for c in counts)])
    yield "ships", ("input", "detector", *(f"{p.name} ({len(p.near)})" for p in ports)), rows
