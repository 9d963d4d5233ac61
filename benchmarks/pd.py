"""Probability of detection of small targets at 1 false object per km2, before and after deglinting.

Targets of 2 to 5 pixels are put into real images of ports, with pixels of 10 m. Swimmers and boats float in simulated
seas, with pixels of 0.25 m and 1.24 m and with bands that are not simultaneous.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio

from deglint import remove_glint
from deglint.morphology import grown
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import FloatingTarget, Setup, simulate
from detect.objects import find
from detect.pipeline import Recipe as Search
from detect.pipeline import score_file

from .alarms import NEAR
from .files import DATA, plane
from .ships import PORT_BANDS, REMOVALS, Port

Mask = npt.NDArray[np.bool_]
Place = tuple[slice, slice]
FALSE_RATE = 1.0
"""False objects per km2 at which the probability of detection is determined."""
TARGET_REFLECTANCES = (0.05, 0.1, 0.2, 0.3)
SHAPES = ((1, 2), (3, 1), (2, 2), (1, 5))
"""Rows and columns of targets of 2 to 5 pixels."""
APART = 12
"""Least distance of a target from land, ships and other targets [pixel]."""
PORT_TARGETS = 80
"""Most targets in the image of a port."""
SEA_TARGETS = 16
"""Most targets in a simulated sea: more would be no anomalies there."""
UNIT = 65535
"""Digital number of reflectance 1 in the real scenes."""
BLUR = 0.5
"""Standard deviation of the point spread function of Sentinel-2's 10 m bands [pixel]: MTF 0.3 at the Nyquist rate."""
SEARCHED_SHARE = 1e-3
"""Objects are searched in this share of pixels, those of the highest scores: far more than 1 object per km2."""
WIND = 5.0
"""Wind over the simulated seas [m/s]."""
SEA_SHAPE = (384, 384)
"""Rows and columns of the simulated seas. They are so small that `FALSE_RATE` allows not one false object."""
FLOATING: dict[str, dict[str, Any]] = {
    "swimmer": {"length": 0.6, "width": 0.4, "material": "skin"},
    "boat of 3 m, 2 m/s": {"length": 3.0, "width": 1.5, "speed": 2.0},
    "boat of 8 m, 5 m/s": {"length": 8.0, "width": 2.5, "speed": 5.0},
}
"""Floating targets, whose headings differ."""


def places(free: Mask, shapes: tuple[tuple[int, int], ...] = SHAPES, most: int = PORT_TARGETS) -> list[Place]:
    """Places of up to `most` targets, taken evenly from a grid over the free water. `shapes` are used in turn."""
    largest = max(max(shape) for shape in shapes)
    step, side = 2 * APART + largest, 2 * (APART + largest) + 1
    room = cv2.erode(free.astype(np.uint8), np.ones((side, side), np.uint8), borderValue=0) > 0
    corners = np.argwhere(room[::step, ::step]) * step
    chosen = corners[:: max(len(corners) // most, 1)][:most]
    sides = [shapes[i % len(shapes)] for i in range(len(chosen))]
    return [(slice(r, r + h), slice(c, c + w)) for (r, c), (h, w) in zip(chosen, sides, strict=True)]


def probability(scores: npt.NDArray[Any], targets: list[Place], near: Mask, km2: float) -> float:
    """Share of the targets that are found before there are more than `FALSE_RATE` false objects per km2.

    Objects count in the order of their scores, the highest first. A target is found if an object lies within 2 pixels
    of it. Any other object is false, unless it lies in `near`, the surroundings of labelled ships.
    """
    number = np.zeros(scores.shape, np.int32)
    for i, (rows, columns) in enumerate(targets, start=1):
        number[max(rows.start - 2, 0) : rows.stop + 2, max(columns.start - 2, 0) : columns.stop + 2] = i
    lowest = np.nanquantile(scores[(number == 0) & ~near], 1 - SEARCHED_SHARE)
    objects = find(np.nan_to_num(scores, nan=-np.inf) > lowest, scores)
    found: set[int] = set()
    false = 0
    for o in objects:  # the highest score first
        box = tuple(slice(*b) for b in o.bounds)
        hit = set(np.unique(number[box][o.footprint]).tolist()) - {0}
        if hit:
            found |= hit
        elif not near[box][o.footprint].any():
            false += 1
            if false > FALSE_RATE * km2:
                break
    return len(found) / max(len(targets), 1)


def _scored(source: Any, scratch: Path) -> dict[str, npt.NDArray[Any]]:
    """Scores of the default search in the raw image and after every removal, by the removal's name."""
    out = {}
    for name, removal in REMOVALS.items():
        image = source
        if removal is not None:
            image = scratch / f"{name}.tif"
            remove_glint(source, image, removal, overwrite=True)
        score_file(image, scratch / "scores.tif", Search(), overwrite=True)
        out[name] = plane(scratch / "scores.tif")
    return out


def real(folder: Path) -> Iterator[list[str]]:
    """Rows of the table: for each port and reflectance, the probability of detection after every removal."""
    for name in ("athens", "klang", "cartagena"):
        port = Port.read(folder / "real" / name)
        near = grown(port.labels > 0, NEAR)
        targets = places(port.water & ~near)
        bands = [folder / "real" / name / f"{b}.tiff" for b in PORT_BANDS]
        for reflectance in TARGET_REFLECTANCES:
            with tempfile.TemporaryDirectory() as place:
                scratch = Path(place)
                files = [_planted(band, scratch, targets, reflectance) for band in bands]
                found = {k: probability(s, targets, near, port.km2) for k, s in _scored(files, scratch).items()}
            yield [name, f"{100 * reflectance:g} %", str(len(targets)), *(f"{v:.2f}" for v in found.values())]


def _planted(source: Path, folder: Path, targets: list[Place], reflectance: float) -> Path:
    """Write a copy of a band into `folder`, with targets that are blurred as by the sensor. Return its path."""
    with rasterio.open(source) as data:
        image, profile = data.read(1), data.profile
    share = np.zeros(image.shape, np.float32)
    for t in targets:
        share[t] = 1
    share = cv2.GaussianBlur(share, (0, 0), BLUR)
    profile.pop("photometric", None)
    with rasterio.open(folder / source.name, "w", **profile) as out:
        out.write(np.rint(image * (1 - share) + share * reflectance * UNIT).astype(image.dtype), 1)
    return folder / source.name


def simulated(folder: Path) -> Iterator[list[str]]:
    """Rows of the table: for each sensor and kind of target, the probability of detection after every removal."""
    for name in ("thesis", "worldview3"):
        sensor = preset(name)
        free = np.ones(SEA_SHAPE, np.bool_)
        for kind, hull in FLOATING.items():
            sides = (max(round(hull["length"] / sensor.gsd), 1),) * 2
            targets = places(free, (sides,), SEA_TARGETS)
            floating = []
            for i, (rows, columns) in enumerate(targets):
                middle = {"right": (columns.start + sides[1] / 2) * sensor.gsd,
                          "down": (rows.start + sides[0] / 2) * sensor.gsd}  # fmt: skip
                floating.append(FloatingTarget(**middle, heading=37.0 * i % 360, **hull))
            setup = Setup(sensor=sensor, size=SEA_SHAPE, wind=WIND, seed=11, targets=tuple(floating))
            write_scene(simulate(setup), folder / "scene", overwrite=True)
            scored = _scored(folder / "scene.tif", folder)
            near, km2 = ~free, free.size * sensor.gsd**2 / 1e6
            found = {k: probability(s, targets, near, km2) for k, s in scored.items()}
            yield [f"{sensor.gsd:g} m", kind, str(len(targets)), *(f"{v:.2f}" for v in found.values())]


def tables(directory: Path | None) -> Iterator[tuple[str, tuple[str, ...], list[list[str]]]]:
    """Name, head and rows of both tables. `directory` holds the ports, by default `DATA`."""
    head = ("", "target", "number", *REMOVALS)
    yield "pd-real", head, list(real(directory or DATA))
    with tempfile.TemporaryDirectory() as place:
        yield "pd-simulated", head, list(simulated(Path(place)))
