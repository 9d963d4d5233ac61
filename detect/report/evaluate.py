"""Compare score rasters with the truth, a map of targets on the same grid; the results are plain numbers and text."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from deglint.errors import InputError
from deglint.pipeline.overview import Progress, raster_of
from deglint.readers import open_scene
from deglint.readers.areas import open_area, polygons
from deglint.readers.grid import at, ground_area, same_grid
from deglint.readers.text import read_json
from deglint.scene import Scene

from ..arrays import Array, Int32, Mask
from ..objects import Object, label
from ..roc.bootstrap import Bands, bootstrap, default_grid
from ..roc.curve import OperatingPoint, Roc, auc_interval, compare
from ..roc.per_object import RATES, ObjectCurve, count_false_alarms, false_alarms, number_objects, object_curve

_WORST = 8  # maximum number of false alarms in the report of a detector
_CURVE_POINTS = 400  # maximum number of points of a curve in the report


@dataclass(frozen=True)
class Request:
    """Options of `rxdetect roc`."""

    scores: tuple[str, ...]  # one raster for each detector
    truth: str  # raster or GeoJSON file
    mask: str | None = None  # where to compare: raster, GeoJSON file or window
    pfa_max: float = 0.1  # maximum false-alarm rate of partial areas and object curves
    draws: int = 1000  # number of draws of the bootstrap; 0: no bootstrap
    seed: int = 0  # seed of the draws
    block: int | None = None  # side of the blocks of the bootstrap [pixel]; None: `default_block`
    per_object: bool = False  # count objects, too
    lower: bool = False  # low scores are anomalous
    connected: bool = False  # each connected part of the truth is one object, whatever its numbers

    @property
    def sign(self) -> float:
        """Factor from scores in the files to those in `Inputs`: -1 if low scores in the files are anomalous, else 1."""
        return -1.0 if self.lower else 1.0


@dataclass(frozen=True, eq=False)
class Inputs:
    """Data from the files of a request: scores of detectors, and the truth; arrays are (row, column)."""

    scores: dict[str, Array]  # by name of the detector; higher is more anomalous
    objects: Int32  # number of the object of each pixel, 0 for background
    valid: Mask  # valid in every score raster and in the truth, and inside the mask
    left_out: dict[str, int]  # number of pixels that are not valid, by reason; a pixel may have several reasons
    grid: Scene  # the first score raster, which defines the grid
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Judged:
    """The evaluation of one detector: its scores, its ROC curve, and the results."""

    name: str
    scores: Array  # (row, column), higher is more anomalous
    roc: Roc
    numbers: dict[str, Any]  # all results as plain values
    bands: Bands | None  # confidence intervals; None without bootstrap
    objects: ObjectCurve | None  # None without `Request.per_object`
    worst: tuple[Object, ...]  # false alarms with the highest scores
    worst_at: OperatingPoint  # point nearest to a Pfa of 1e-3; the worst false alarms exceed its threshold


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Results of `evaluate` for all detectors; `numbers` holds them as plain values for JSON."""

    request: Request
    inputs: Inputs
    detectors: tuple[Judged, ...]
    numbers: dict[str, Any]


def evaluate(request: Request, progress: Progress | None = None) -> Evaluation:
    """Read score rasters and truth, evaluate each detector, and compare the detectors.

    Parameters
    ----------
    request : Request
    progress : callable, optional
        Called as progress(stage, done, total), where `done` and `total` are numbers of detectors.

    Raises
    ------
    InputError
        Files or options do not allow an evaluation; for example, the grids differ, or all scores are equal.
    ReadError
        A file cannot be read.
    """
    inputs = read_inputs(request)
    area = ground_area(inputs.grid.transform, inputs.grid.crs, *inputs.valid.shape)
    tell = progress or (lambda *_: None)
    judged = []
    for done, (name, scores) in enumerate(inputs.scores.items()):
        tell("judge", done, len(inputs.scores))
        try:
            judged.append(_judge(name, scores, inputs, request, area))
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
    tell("judge", len(judged), len(judged))
    grid, roc, notes = inputs.grid, judged[0].roc, list(inputs.notes)
    for j in judged:
        notes += j.bands.notes if j.bands is not None else ()
        if j.objects is not None and j.objects.unseen:
            notes.append(f"objects without a valid pixel, neither found nor missed: {len(j.objects.unseen)}")
    n = len(roc.targets) + len(roc.background)
    scene = {"rows": grid.height, "columns": grid.width, "crs": None if grid.crs is None else grid.crs.to_string()}
    scene |= {"pixel_area_m2": area, "area_km2": None if area is None else n * area / 1e6}
    objects = np.unique(inputs.objects[inputs.valid & (inputs.objects != 0)])
    pixels = {"total": inputs.valid.size, "judged": n, "targets": len(roc.targets), "background": len(roc.background)}
    numbers = {
        "scene": scene,
        "pixels": pixels | {"left_out": dict(inputs.left_out), "objects": len(objects)},
        "detectors": [j.numbers for j in judged],
        "comparisons": [_comparison(a, b, inputs) for a, b in combinations(judged, 2)],
        "notes": list(dict.fromkeys(notes)),
    }
    return Evaluation(request, inputs, tuple(judged), numbers)


def read_inputs(request: Request) -> Inputs:
    """Read the files of a request: score rasters, truth (a raster or a GeoJSON file) and mask."""
    scores, truth, notes = request.scores, request.truth, list[str]()
    scenes = [open_scene(path) for path in scores]
    for path, scene in zip(scores, scenes, strict=True):
        _check_grid(scene, f"SCORES {path}", scenes[0], f"SCORES {scores[0]}")
        if len(scene.bands) > 1:
            notes.append(f"{path} has {len(scene.bands)} bands; the first, {scene.bands[0].name}, is judged")
    objects, known = _truth(request, scenes[0], notes)
    signed = {name: request.sign * _first_band(scene) for name, scene in zip(_names(scores), scenes, strict=True)}
    reasons = {"not valid in the truth": known}
    reasons |= {f"not valid, or not finite, in {n}": ~np.isnan(array) for n, array in signed.items()}
    reasons = {why: ok for why, ok in reasons.items() if not ok.all()}
    if request.mask is not None:
        whole = (0, scenes[0].height), (0, scenes[0].width)
        reasons["outside the mask"] = open_area(request.mask, scenes[0], "--mask").read(whole)
    left_out = {why: int(np.count_nonzero(~ok)) for why, ok in reasons.items()}
    valid = np.logical_and.reduce([known, *reasons.values()])
    parts, many = int(label(objects != 0).max(initial=0)), len(np.unique(objects[objects != 0]))
    if parts > many:  # a number may be a class of objects
        notes.append(
            f"{truth}: {many} object numbers in {parts} separate parts; parts with the same number are one object "
            "(--connected: each part is one object)"
        )
    return Inputs(signed, objects, valid, left_out, scenes[0], tuple(notes))


def _first_band(scene: Scene) -> Array:
    """The first band of a scene, (row, column); the file of the scene is closed afterwards."""
    with raster_of(scene):
        return scene.read(bands=[0])[0]


def _truth(request: Request, grid: Scene, notes: list[str]) -> tuple[Int32, Mask]:
    """Read the truth: object number of each pixel (0: background) and valid mask, on `grid`; add lines to `notes`."""
    path = request.truth
    if Path(path).suffix.lower() in (".geojson", ".json"):
        drawn = _drawn(path, grid, notes)
        return label(drawn != 0) if request.connected else drawn, np.ones(drawn.shape, np.bool_)
    scene = open_scene(path)
    _check_grid(scene, f"TRUTH {path}", grid, f"SCORES {request.scores[0]}")
    if len(scene.bands) > 1:
        raise InputError(f"TRUTH {path} has {len(scene.bands)} bands; want one, of 0 or an object's number.")
    if raster_of(scene).info.nodatas[0] == 0:
        notes.append(f"{path} declares 0 as nodata; 0 is taken as background")
        scene = open_scene(path, nodata="none")
    marks = _first_band(scene)
    known = np.isfinite(marks)
    return number_objects(np.where(known, marks, 0), connected=request.connected), known


def _drawn(path: str, grid: Scene, notes: list[str]) -> Int32:
    """Number, from 1, of the last GeoJSON feature at each pixel's centre, (row, column); 0: none. Extends `notes`."""
    document = read_json(path, "TRUTH")
    given = document.get("features")
    features = given if isinstance(given, list) and given else [document]
    out = np.zeros((grid.height, grid.width), np.int32)
    for number, feature in enumerate(features, start=1):
        one = {"type": "FeatureCollection", "features": [feature]} | {k: document[k] for k in ("crs",) if k in document}
        area = polygons(one, grid, path)
        (top, bottom), (left, right) = np.clip(area.bounds.window, 0, np.array(out.shape)[:, None]).tolist()
        out[top:bottom, left:right][area.read(((top, bottom), (left, right)))] = number
    if not out.any():
        raise InputError(f"TRUTH {path}: no feature contains a pixel centre of the scores. Check its position and CRS.")
    if lost := len(features) - np.count_nonzero(np.unique(out)):
        notes.append(f"{lost} of {len(features)} features of {path} contain no pixel centre of their own: left out")
    return out


def _check_grid(scene: Scene, name: str, grid: Scene, reference: str) -> None:
    """Raise InputError if `scene` is not on the pixel grid of `grid`; the message names them `name` and `reference`."""
    if not same_grid(raster_of(scene).info, grid):
        sizes = [f"{s.height} x {s.width} pixels" for s in (scene, grid)]
        raise InputError(
            f"{name} ({sizes[0]}) and {reference} ({sizes[1]}) must have the same size, geotransform and CRS. "
            "Warp one to the other, for example with rio warp --like."
        )


def _names(paths: Sequence[str]) -> tuple[str, ...]:
    """Short names of files: their stems, or paths where a stem is not unique. Raises InputError if a path repeats."""
    if twice := [path for path in paths if paths.count(path) > 1]:
        raise InputError(f"SCORES {twice[0]} is given twice: leave one out.")
    stems = [Path(p).stem for p in paths]
    return tuple(stem if stems.count(stem) == 1 else path for stem, path in zip(stems, paths, strict=True))


def _judge(name: str, scores: Array, inputs: Inputs, request: Request, area: float | None) -> Judged:
    """Evaluate the detector `name` by its `scores`; `area` is the area of a pixel [m2], None if it is not known."""
    roc = Roc.of(scores, inputs.objects, inputs.valid)
    rates = [r for r in RATES if r * len(roc.background) >= 1]
    bands = None
    if request.draws:
        grid = np.unique(np.concatenate([default_grid(len(roc.background)), rates]))
        bands = bootstrap(
            scores, inputs.objects, inputs.valid, draws=request.draws, seed=request.seed, block=request.block, pfa=grid
        )
    most = request.pfa_max
    found = object_curve(scores, inputs.objects, roc, inputs.valid, pfa_max=most) if request.per_object else None
    sign, square_km = request.sign, np.count_nonzero(inputs.valid) * (area or math.nan) / 1e6
    points: list[dict[str, object]] = []
    for point in map(roc.point, rates):
        rate = point.pfa_requested
        low, high = (bands and float(np.interp(rate, bands.pfa, getattr(bands, end))) for end in ("low", "high"))
        points.append(asdict(point) | {"threshold": sign * point.threshold, "pd_low": low, "pd_high": high})
        if found is not None:
            alarms = count_false_alarms(scores > point.threshold, inputs.objects, inputs.valid)
            seen = sum(o.score_max > point.threshold for o in found.objects)
            points[-1] |= {"objects_found": seen, "objects": len(found.objects)}
            points[-1] |= {"false_alarms": alarms, "false_alarms_per_km2": alarms / square_km}
    worst_at = roc.point(min(rates, key=lambda r: abs(math.log(r / 1e-3)), default=1.0))
    worst = false_alarms(scores, inputs.objects, worst_at.threshold, inputs.valid)[:_WORST]
    said: list[dict[str, object]] = []
    for o in worst:
        row, column = o.centroid
        said.append({"score_max": sign * o.score_max, "pixels": o.size, "row": row, "column": column})
        if inputs.grid.transform is not None:
            said[-1]["x"], said[-1]["y"] = at(inputs.grid.transform, column + 0.5, row + 0.5)
    numbers = _figures(name, roc, request, bands) | {"operating_points": points, "worst_false_alarms": said}
    if found is not None:
        numbers["objects"] = _objects(found, sign, square_km)
    return Judged(name, scores, roc, numbers, bands, found, tuple(worst), worst_at)


def _figures(name: str, roc: Roc, request: Request, bands: Bands | None) -> dict[str, object]:
    """Summary numbers of a ROC curve, up to 400 points as arrays, and the bootstrap intervals `bands`, if any."""
    pfa, pd = roc.vertices
    keep = np.unique(np.linspace(0, len(pfa) - 1, _CURVE_POINTS).astype(int))
    most, drawn = request.pfa_max, None
    if bands is not None:
        same = {name: getattr(bands, name) for name in ("level", "draws", "seed", "block", "objects", "blocks", "pfa")}
        area = {"low": bands.auc[0], "high": bands.auc[1], "standard_error": bands.auc_error}
        drawn = area | same | {"pd_low": bands.low, "pd_high": bands.high}
    return {
        "name": name,
        "auc": roc.auc,
        "delong": {k: v for k, v in asdict(auc_interval(roc)).items() if k != "auc"},
        "bootstrap": drawn,
        "partial_auc": {"pfa_max": most, "raw": roc.partial_auc(most), "mcclish": roc.mcclish(most)},
        "average_precision": roc.average_precision,
        "three_d": roc.three_d(),
        "curve": {"pfa": pfa[keep], "pd": pd[keep]},
    }


def _objects(found: ObjectCurve, sign: float, square_km: float) -> dict[str, object]:
    """An `ObjectCurve` as values for JSON; `sign` is `Request.sign`, `square_km` is the area of valid pixels [km2]."""
    curve = {"threshold": sign * found.thresholds, "pfa": found.pfa, "found": found.found}
    curve |= {"false_alarms": found.false_alarms, "false_alarms_per_km2": found.false_alarms / square_km}
    table = [asdict(replace(o, score_max=sign * o.score_max, score_mean=sign * o.score_mean)) for o in found.objects]
    return {"curve": curve, "unseen": list(found.unseen), "table": table}


def _comparison(a: Judged, b: Judged, inputs: Inputs) -> dict[str, object]:
    """Difference of the AUC of two detectors: DeLong's test, and a bootstrap interval from the same draws for both."""
    low = high = None
    if a.bands is not None and b.bands is not None:
        low, high = map(float, np.percentile(a.bands.areas - b.bands.areas, [2.5, 97.5]))
    test = compare(a.scores, b.scores, inputs.objects, inputs.valid)
    return asdict(test) | {"first": a.name, "second": b.name, "bootstrap_low": low, "bootstrap_high": high}
