"""Ships found in real ports, with and without deglinting; a table of `python -m benchmarks detection`.

Its DIRECTORY (by default beside the project) holds real/PORT/B02.tiff ... B08.tiff with ships.tif (hand-drawn numbers)
and water.tif (1 = sea). A ship counts where six tenths of the ring 5 to 15 pixels off it are sea. It is found where an
object lies within 2 pixels. An object in the sea that is near no label is false; some of these are unlabelled boats.
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
BANDS = ("B02", "B03", "B04", "B08")
RATES = (0.1, 1.0)
"""False objects per km2 at which ships are counted."""
REMOVALS = {"raw": None, "hedley": Recipe(method="hedley", compensate="off"), "default": Recipe()}
WINDOW = {"inner": 15, "outer": 31}
LOWEST = 3e-3
"""Share of the water whose scores are looked at for objects."""


@dataclass(frozen=True, eq=False)
class Port:
    """Labels of a port, and where an object counts."""

    name: str
    labels: npt.NDArray[np.int64]
    water: Mask
    searched: Mask
    near: dict[int, Mask]
    km2: float

    @classmethod
    def read(cls, folder: Path) -> Port:
        """Read a port's labels."""
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
        """Ships found at each of `RATES`, from (score, footprint, box) of every object."""
        labelled, best = grown(self.labels > 0, 5), [0] * len(RATES)
        seen: set[int] = set()
        false = 0
        for _score, footprint, box in sorted(objects, key=lambda o: -o[0]):
            if (labelled[box] & footprint).any():
                seen |= {n for n, mask in self.near.items() if (mask[box] & footprint).any()}
            elif (self.searched[box] & footprint).any():
                false += 1
            best = [max(b, len(seen)) if false / self.km2 <= r else b for b, r in zip(best, RATES, strict=True)]
        return best


def peer(image: npt.NDArray[Any], where: Mask) -> npt.NDArray[np.float64]:
    """Global RX of the package spectral, with statistics of the same pixels."""
    import spectral

    pixels = image[:, where].T[None]
    stats = spectral.calc_stats(pixels.astype(np.float64))
    return np.asarray(spectral.rx(np.moveaxis(image, 0, -1).astype(np.float64), background=stats))


ORFEO = shutil.which("otbcli_LocalRxDetection")


def orfeo(image: npt.NDArray[Any], _where: Mask) -> npt.NDArray[np.float32]:
    """Local RX of the Orfeo Toolbox in the same window. It takes no mask: land within the window is background."""
    with tempfile.TemporaryDirectory() as scratch:
        source, out = Path(scratch) / "image.tif", Path(scratch) / "scores.tif"
        values = np.nan_to_num(image.astype(np.float32))
        profile = dict(zip(("count", "height", "width"), values.shape, strict=True))
        with rasterio.open(source, "w", driver="GTiff", dtype="float32", **profile) as data:
            data.write(values)
        radii = ["-ir", str(WINDOW["inner"] // 2), "-er", str(WINDOW["outer"] // 2)]
        command = [str(ORFEO), "-in", str(source), "-out", str(out), "float", *radii]
        subprocess.run(command, check=True, capture_output=True)
        return plane(out)


DETECTORS = {
    "global": lambda image, where: rx(image, mask=where),
    "local 15,31": lambda image, where: local_rx(image, mask=where, **WINDOW),
    "spectral, global": peer,
} | ({"OTB, local 15,31": orfeo} if ORFEO else {})
"""What is compared with `rxdetect score`, all on the same sea."""


def others(port: Port, image: npt.NDArray[Any], detector: Any) -> list[int]:
    """Ships found by a detector on the hand-drawn sea, holes that a ship could fill included."""
    scores = np.nan_to_num(np.asarray(detector(image, port.searched), np.float64), nan=-np.inf)
    scores[~port.searched] = -np.inf
    lowest = np.quantile(scores[port.water], 1 - LOWEST)
    return port.found([(o.score_max, o.footprint, np.s_[slice(*o.bounds[0]), slice(*o.bounds[1])])
                       for o in find(scores > lowest, scores)])  # fmt: skip


def ours(port: Port, source: list[Path] | Path, scratch: Path) -> list[int]:
    """Ships found by `rxdetect score` as it comes."""
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
    """Name, head and rows: ships found by every detector, raw and after two removals, at each of `RATES`."""
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
            source: list[Path] | Path = [folder / port.name / f"{band}.tiff" for band in BANDS]
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
