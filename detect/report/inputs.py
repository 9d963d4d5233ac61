"""Read scores, truth and mask as arrays on one grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deglint.errors import InputError
from deglint.pipeline.overview import raster_of
from deglint.readers import open_scene
from deglint.readers.areas import open_area, polygons
from deglint.readers.grid import same_grid
from deglint.readers.text import read_json
from deglint.scene import Scene

from ..arrays import Array, Int32, Mask
from ..objects import label
from ..roc import number_objects


@dataclass(frozen=True, eq=False)
class Inputs:
    """Names and scores of the detectors (higher is more anomalous), and the truth.

    Pixels are valid in every score raster and in the truth, and inside the mask; `left_out` counts the others by
    reason, and a pixel may count for several. `objects` has the number of the object of each pixel, 0 for background.
    """

    names: tuple[str, ...]
    scores: tuple[Array, ...]
    objects: Int32
    valid: Mask
    left_out: dict[str, int]
    grid: Scene
    notes: tuple[str, ...]


def read_inputs(
    scores: Sequence[str], truth: str, mask: str | None = None, *, lower: bool = False, connected: bool = False
) -> Inputs:
    """Read score rasters, and truth from a raster or a GeoJSON file."""
    notes: list[str] = []
    scenes = [open_scene(path) for path in scores]
    for path, scene in zip(scores[1:], scenes[1:], strict=True):
        _check_grid(scene, f"SCORES {path}", scenes[0], f"SCORES {scores[0]}")
    marks, known = _truth(truth, scenes[0], scores[0], notes)
    for path, scene in zip(scores, scenes, strict=True):
        if len(scene.bands) > 1:
            notes.append(f"{path} has {len(scene.bands)} bands; the first, {scene.bands[0].name}, is judged")
    arrays = [_first_band(scene) for scene in scenes]
    names = _names(scores)
    reasons = {"not valid in the truth": known}
    reasons |= {f"not valid, or not finite, in {n}": ~np.isnan(array) for n, array in zip(names, arrays, strict=True)}
    reasons = {why: ok for why, ok in reasons.items() if not ok.all()}
    if mask is not None:
        whole = (0, scenes[0].height), (0, scenes[0].width)
        reasons["outside the mask"] = open_area(mask, scenes[0], "--mask").read(whole)
    left_out = {why: int(np.count_nonzero(~ok)) for why, ok in reasons.items()}
    valid = np.logical_and.reduce([known, *reasons.values()])
    turned = tuple(-array for array in arrays) if lower else tuple(arrays)
    objects = number_objects(marks, connected=connected)
    parts, many = int(label(objects != 0).max(initial=0)), len(np.unique(objects[objects != 0]))
    if parts > many:  # a number may be a class of objects
        notes.append(f"{many} numbers of {truth} lie in {parts} separate parts; what has one number is judged as one "
                     "object (--connected: each part is one)")  # fmt: skip
    return Inputs(names, turned, objects, valid, left_out, scenes[0], tuple(notes))


def _first_band(scene: Scene) -> Array:
    """The first band of a scene, (row, column)."""
    with raster_of(scene) as source:
        return np.asarray(source.read(((0, scene.height), (0, scene.width)), [0])[0])


def _truth(path: str, grid: Scene, scores: str, notes: list[str]) -> tuple[Array, Mask]:
    """Number of the object of each pixel (0: background), and the mask of pixels whose truth is valid."""
    if Path(path).suffix.lower() in (".geojson", ".json"):
        marks = _drawn(path, grid, notes)
        return marks, np.ones(marks.shape, np.bool_)
    scene = open_scene(path)
    _check_grid(scene, f"TRUTH {path}", grid, f"SCORES {scores}")
    if len(scene.bands) > 1:
        raise InputError(f"TRUTH {path} has {len(scene.bands)} bands; want one, of 0 or an object's number.")
    if raster_of(scene).info.nodatas[0] == 0:
        notes.append(f"{path} declares 0 as nodata; 0 is taken as background")
        scene = open_scene(path, nodata="none")
    marks = _first_band(scene)
    known = np.isfinite(marks)
    return np.where(known, marks, 0), known


def _drawn(path: str, grid: Scene, notes: list[str]) -> Int32:
    """Features of a GeoJSON file drawn with their numbers, from 1; a pixel is in where its centre is."""
    document = read_json(path, "TRUTH")
    given = document.get("features")
    features = given if isinstance(given, list) and given else [document]
    out = np.zeros((grid.height, grid.width), np.int32)
    empty = 0
    for number, feature in enumerate(features, start=1):
        one = {"type": "FeatureCollection", "features": [feature]} | {k: document[k] for k in ("crs",) if k in document}
        area = polygons(one, grid, path)
        (top, bottom), (left, right) = (
            np.clip(ends, 0, size).tolist() for ends, size in zip(area.bounds, out.shape, strict=True)
        )
        inside = area.read(((top, bottom), (left, right)))
        out[top:bottom, left:right][inside] = number
        empty += not inside.any()
    if empty:
        notes.append(f"{empty} of {len(features)} features of {path} hold no pixel's centre in the scene: left out")
    return out


def _check_grid(scene: Scene, name: str, grid: Scene, reference: str) -> None:
    """Check that a scene has the grid of the reference."""
    if not same_grid(raster_of(scene).info, grid):
        sizes = [f"{s.height} x {s.width} pixels" for s in (scene, grid)]
        raise InputError(
            f"{name} ({sizes[0]}) and {reference} ({sizes[1]}) must lie on one grid, of one size, place and CRS. "
            "Warp one to the other, for example with rio warp --like."
        )


def _names(paths: Sequence[str]) -> tuple[str, ...]:
    """Short names: the files' stems, or their paths where stems repeat."""
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise InputError(f"SCORES {twice} is given twice: leave one out.")
    stems = [Path(p).stem for p in paths]
    return tuple(stem if stems.count(stem) == 1 else path for stem, path in zip(stems, paths, strict=True))
