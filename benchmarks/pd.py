"""Probability of detection of small targets at 1 false object per km2, before and after deglinting.

Targets of 2 to 5 pixels stand in the real water of ports at 10 m; targets as large as swimmers and boats stand in
simulated seas at 0.25 m and 1.24 m whose bands look one after the other.
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

from deglint import Recipe, open_scene, remove_glint
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.readers.place import ground_area
from deglint.simulate import Setup, simulate
from detect.objects import find
from detect.pipeline import Recipe as Search
from detect.pipeline import score_file

from .error import DATA
from .ships import BANDS, REMOVALS, Port

Mask = npt.NDArray[np.bool_]
Place = tuple[slice, slice]
RATE = 1.0
"""False objects per km2."""
REFLECTANCES = (0.05, 0.1, 0.2, 0.3)
SHAPES = ((1, 2), (3, 1), (2, 2), (1, 5))
"""Rows and columns of targets of 2 to 5 pixels."""
APART = 12
"""Least distance of a target from land, ships and other targets [pixel]."""
MOST = 80
"""Targets in a scene."""
UNIT = 65535
"""Digital number of reflectance 1 in the real scenes."""
BLUR = 0.5
"""Standard deviation of the point spread function of Sentinel-2's 10 m bands [pixel]: MTF 0.3 at the Nyquist rate."""
LOWEST = 1e-3
"""Share of the sea that is looked at for objects: far more than 1 object per km2."""
FLOATING = {"swimmer 0.5 m": (0.5, 0.25), "boat 2.5 m": (2.5, 0.3), "boat 6 m": (6.0, 0.3)}
"""Side of a square [m], and its reflectance."""


def places(free: Mask, shapes: tuple[tuple[int, int], ...] = SHAPES) -> list[Place]:
    """Where targets stand: on a grid over the free water, evenly thinned."""
    room = cv2.erode(free.astype(np.uint8), np.ones((2 * APART + 1, 2 * APART + 1), np.uint8), borderValue=0) > 0
    corners = np.argwhere(room[:: 2 * APART, :: 2 * APART]) * 2 * APART
    chosen = corners[:: max(len(corners) // MOST, 1)][:MOST]
    sides = [shapes[i % len(shapes)] for i in range(len(chosen))]
    return [(slice(r, r + h), slice(c, c + w)) for (r, c), (h, w) in zip(chosen, sides, strict=True)]


def probability(scores: npt.NDArray[Any], targets: list[Place], near: Mask, km2: float) -> float:
    """Share of the targets on which an object lies, where `RATE` false objects per km2 score higher.

    Objects near no target are false, except near what is labelled (`near`).
    """
    lowest = np.nanquantile(scores, 1 - LOWEST)
    objects = find(np.nan_to_num(scores, nan=-np.inf) > lowest, scores)
    number = np.zeros(scores.shape, np.int32)
    for i, (rows, columns) in enumerate(targets, start=1):
        number[max(rows.start - 2, 0) : rows.stop + 2, max(columns.start - 2, 0) : columns.stop + 2] = i
    found: set[int] = set()
    false = 0
    for o in objects:  # the highest score first
        box = tuple(slice(*b) for b in o.bounds)
        hit = set(np.unique(number[box][o.footprint]).tolist()) - {0}
        if hit:
            found |= hit
        elif not near[box][o.footprint].any():
            false += 1
            if false > RATE * km2:
                break
    return len(found) / max(len(targets), 1)


def _scored(source: Any, scratch: Path, **recipe: Any) -> dict[str, npt.NDArray[Any]]:
    """Scores of the default search after every removal."""
    out = {}
    for name, removal in REMOVALS.items():
        image = source
        if removal is not None:
            image = scratch / f"{name}.tif"
            remove_glint(source, image, removal, overwrite=True)
        score_file(image, scratch / "scores.tif", Search(**recipe), overwrite=True)
        with rasterio.open(scratch / "scores.tif") as data:
            out[name] = data.read(1)
    return out


def real(folder: Path, ports: tuple[str, ...] = ("athens", "klang", "cartagena")) -> Iterator[list[str]]:
    """One row a port and reflectance: probability of detection after every removal."""
    for name in ports:
        port = Port.read(folder / "real" / name)
        near = cv2.dilate((port.labels > 0).astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
        targets = places(port.water & ~near)
        for reflectance in REFLECTANCES:
            with tempfile.TemporaryDirectory() as place:
                scratch = Path(place)
                files = [_planted(folder / "real" / name / f"{b}.tiff", scratch, targets, reflectance) for b in BANDS]
                found = {k: probability(s, targets, near, port.km2) for k, s in _scored(files, scratch).items()}
            yield [name, f"{100 * reflectance:g} %", str(len(targets)), *(f"{v:.2f}" for v in found.values())]


def _planted(source: Path, folder: Path, targets: list[Place], reflectance: float) -> Path:
    """A copy of a band with targets in it, blurred as the sensor does."""
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
    """One row a sensor and kind of target, at a wind of 5 m/s: probability of detection after every removal."""
    from deglint.simulate.light import light

    for name in ("thesis", "worldview3"):
        sensor = preset(name)
        if name == "thesis":
            sensor = sensor.delayed(0.06) if hasattr(sensor, "delayed") else sensor
        setup = Setup(sensor=sensor, size=(512, 512), wind=5.0, seed=11, objects=(), sky="cardioidal")
        path = folder / f"{name}.tif"
        write_scene(simulate(setup), path)
        lit = light(setup)
        white = np.asarray((lit.direct + lit.diffuse) / np.pi)
        scene = open_scene(path)
        area = ground_area(scene.transform, scene.crs, scene.height, scene.width) or sensor.gsd**2
        near = np.zeros((scene.height, scene.width), np.bool_)
        for kind, (side, reflectance) in FLOATING.items():
            pixels = max(round(side / sensor.gsd), 1)
            share = min((side / sensor.gsd) ** 2, 1.0)
            targets = places(~near, ((pixels, pixels),))
            with rasterio.open(path) as data:
                image, profile = data.read().astype(np.float64), data.profile
                tags, names = [data.tags(i) for i in data.indexes], data.descriptions
                scales = data.scales
            for band in range(len(image)):
                for t in targets:
                    own = reflectance * white[band] / scales[band]
                    image[band][t] = image[band][t] * (1 - share) + share * own
            with rasterio.open(folder / "there.tif", "w", **profile) as out:
                out.write(np.clip(np.rint(image), 0, sensor.levels).astype(profile["dtype"]))
                out.descriptions, out.scales = names, scales
                for i, known in enumerate(tags, start=1):
                    out.update_tags(i, **known)
            scored = _scored(folder / "there.tif", folder)
            found = {k: probability(s, targets, near, s.size * area / 1e6) for k, s in scored.items()}
            yield [f"{name}, {sensor.gsd:g} m", kind, str(len(targets)), *(f"{v:.2f}" for v in found.values())]


def tables(directory: Path | None) -> Iterator[tuple[str, tuple[str, ...], list[list[str]]]]:
    """Title, head and rows of both tables."""
    head = ("", "target", "number", *REMOVALS)
    yield "pd-real", head, list(real(directory or DATA))
    with tempfile.TemporaryDirectory() as place:
        yield "pd-simulated", head, list(simulated(Path(place)))
