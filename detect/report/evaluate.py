"""Compare score rasters with truth: all results of the report as plain numbers and text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from deglint.errors import InputError
from deglint.readers.grid import at
from deglint.readers.place import ground_area

from ..arrays import Array
from ..objects import Object
from ..roc.bootstrap import Bands, bootstrap, default_grid
from ..roc.curve import OperatingPoint, Roc, auc_interval, compare
from ..roc.per_object import RATES, ObjectCurve, count_false_alarms, false_alarms, object_curve
from .inputs import Inputs, read_inputs

_WORST = 8
_CURVE_POINTS = 400


@dataclass(frozen=True)
class Request:
    """Options of `rxdetect roc`; with 0 draws there is no bootstrap."""

    scores: tuple[str, ...]
    truth: str
    mask: str | None = None
    pfa_max: float = 0.1
    draws: int = 1000
    seed: int = 0
    block: int | None = None
    per_object: bool = False
    lower: bool = False
    connected: bool = False


@dataclass(frozen=True, eq=False)
class Judged:
    """One detector: its scores, its ROC curve, and the results."""

    name: str
    scores: Array
    roc: Roc
    numbers: dict[str, Any]
    bands: Bands | None
    objects: ObjectCurve | None
    worst: tuple[Object, ...]
    worst_at: OperatingPoint  # threshold that the worst false alarms exceed


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Results of all detectors; `numbers` holds them as plain values for JSON."""

    request: Request
    inputs: Inputs
    detectors: tuple[Judged, ...]
    numbers: dict[str, Any]


def evaluate(request: Request, progress: Any = None) -> Evaluation:
    """Read score rasters and truth, evaluate each detector, and compare the detectors.

    Parameters
    ----------
    request : Request
    progress : callable, optional
        Called as progress(stage, done, total), where the numbers count detectors.

    Raises
    ------
    InputError
        The grids differ, there is no target or no background, or all scores are equal.
    ReadError
        A file cannot be read.
    """
    inputs = read_inputs(request.scores, request.truth, request.mask, lower=request.lower, connected=request.connected)
    area = ground_area(inputs.grid.transform, inputs.grid.crs, *inputs.valid.shape)
    tell = progress or (lambda *_: None)
    judged = []
    for done, (name, scores) in enumerate(zip(inputs.names, inputs.scores, strict=True)):
        tell("judge", done, len(inputs.names))
        try:
            judged.append(_judge(name, scores, inputs, request, area))
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
    tell("judge", len(judged), len(judged))
    numbers = _scene_numbers(inputs, judged[0].roc, area) | {
        "detectors": [j.numbers for j in judged],
        "comparisons": [_comparison(a, b, inputs) for a, b in combinations(judged, 2)],
        "notes": [*inputs.notes, *_notes(judged)],
    }
    return Evaluation(request, inputs, tuple(judged), numbers)


def _judge(name: str, scores: Array, inputs: Inputs, request: Request, area: float | None) -> Judged:
    """Evaluate one detector; `area` is that of a pixel [m2]."""
    roc = Roc.of(scores, inputs.objects, inputs.valid)
    rates = [r for r in RATES if r * len(roc.background) >= 1]
    bands = None
    if request.draws:
        grid = np.unique(np.concatenate([default_grid(len(roc.background)), rates]))
        bands = bootstrap(scores, inputs.objects, inputs.valid, draws=request.draws, seed=request.seed,
                          block=request.block, pfa=grid)  # fmt: skip
    found = None
    if request.per_object:
        found = object_curve(scores, inputs.objects, roc, inputs.valid, pfa_max=request.pfa_max)
    sign = -1.0 if request.lower else 1.0
    square_km = None if area is None else np.count_nonzero(inputs.valid) * area / 1e6
    worst_at = roc.point(min(rates, key=lambda r: abs(math.log(r / 1e-3)), default=1.0))
    worst = false_alarms(scores, inputs.objects, worst_at.threshold, inputs.valid)[:_WORST]
    numbers = _figures(name, roc, request, bands) | {
        "operating_points": [_point(roc, r, bands, sign) for r in rates],
        "worst_false_alarms": [
            {"score_max": sign * o.score_max, "pixels": o.size, "row": o.centroid[0], "column": o.centroid[1]}
            for o in worst
        ],
    }
    if inputs.grid.transform is not None:
        for alarm in numbers["worst_false_alarms"]:
            alarm["x"], alarm["y"] = at(inputs.grid.transform, alarm["column"] + 0.5, alarm["row"] + 0.5)
    if found is not None:
        for point in numbers["operating_points"]:
            point |= _called(sign * point["threshold"], scores, found, inputs, square_km)
        numbers["objects"] = _objects(found, sign, square_km)
    return Judged(name, scores, roc, numbers, bands, found, tuple(worst), worst_at)


def _figures(name: str, roc: Roc, request: Request, bands: Bands | None) -> dict[str, Any]:
    """Summary numbers of a curve."""
    pfa, pd = roc.vertices
    keep = np.unique(np.linspace(0, len(pfa) - 1, _CURVE_POINTS).astype(int))
    return {
        "name": name,
        "auc": roc.auc,
        "delong": {k: v for k, v in asdict(auc_interval(roc)).items() if k != "auc"},
        "bootstrap": None if bands is None else {
            "low": bands.auc[0], "high": bands.auc[1], "standard_error": bands.auc_error, "level": bands.level,
            "draws": bands.draws, "seed": bands.seed, "block": bands.block, "objects": bands.objects,
            "blocks": bands.blocks, "pfa": bands.pfa, "pd_low": bands.low, "pd_high": bands.high,
        },
        "partial_auc": {"pfa_max": request.pfa_max, "raw": roc.partial_auc(request.pfa_max),
                        "mcclish": roc.mcclish(request.pfa_max) if request.pfa_max < 1 else roc.auc},
        "average_precision": roc.average_precision,
        "three_d": roc.three_d(),
        "curve": {"pfa": pfa[keep], "pd": pd[keep]},
    }  # fmt: skip


def _point(roc: Roc, rate: float, bands: Bands | None, sign: float) -> dict[str, Any]:
    """Threshold, and fractions of detected pixels, at a false-alarm rate."""
    point = roc.point(rate)
    out: dict[str, Any] = asdict(point) | {"threshold": sign * point.threshold, "pd_low": None, "pd_high": None}
    if bands is not None:
        at = int(np.argmin(np.abs(bands.pfa - rate)))
        out |= {"pd_low": bands.low[at], "pd_high": bands.high[at]}
    return out


def _called(
    threshold: float, scores: Array, found: ObjectCurve, inputs: Inputs, square_km: float | None
) -> dict[str, Any]:
    """Objects found and false alarms at a threshold."""
    alarms = count_false_alarms(scores > threshold, inputs.objects, inputs.valid)
    return {
        "objects_found": sum(o.score_max > threshold for o in found.objects), "objects": len(found.objects),
        "false_alarms": alarms, "false_alarms_per_km2": None if square_km is None else alarms / square_km,
    }  # fmt: skip


def _objects(found: ObjectCurve, sign: float, square_km: float | None) -> dict[str, Any]:
    """Every object, and how many are found at how many false alarms."""
    return {
        "curve": {
            "threshold": sign * found.thresholds, "pfa": found.pfa, "found": found.found,
            "false_alarms": found.false_alarms,
            "false_alarms_per_km2": None if square_km is None else found.false_alarms / square_km,
        },
        "unseen": list(found.unseen),
        "table": [
            asdict(replace(o, score_max=sign * o.score_max, score_mean=sign * o.score_mean)) for o in found.objects
        ],
    }  # fmt: skip


def _comparison(a: Judged, b: Judged, inputs: Inputs) -> dict[str, Any]:
    """DeLong's test of two detectors, and the bootstrap's interval of the difference from the same draws."""
    low = high = None
    if a.bands is not None and b.bands is not None:
        low, high = map(float, np.percentile(a.bands.areas - b.bands.areas, [2.5, 97.5]))
    test = compare(a.scores, b.scores, inputs.objects, inputs.valid)
    return asdict(test) | {"first": a.name, "second": b.name, "bootstrap_low": low, "bootstrap_high": high}


def _scene_numbers(inputs: Inputs, roc: Roc, area: float | None) -> dict[str, Any]:
    """The scene, and its pixels."""
    grid = inputs.grid
    n = len(roc.targets) + len(roc.background)
    return {
        "scene": {
            "rows": grid.height, "columns": grid.width, "crs": None if grid.crs is None else grid.crs.to_string(),
            "pixel_area_m2": area, "area_km2": None if area is None else n * area / 1e6,
        },
        "pixels": {
            "total": inputs.valid.size, "judged": n, "targets": len(roc.targets), "background": len(roc.background),
            "left_out": dict(inputs.left_out),
            "objects": len(np.unique(inputs.objects[inputs.valid & (inputs.objects != 0)])),
        },
    }  # fmt: skip


def _notes(judged: Sequence[Judged]) -> list[str]:
    """Warnings for the reader, without repetition."""
    out: list[str] = []
    for j in judged:
        out += j.bands.notes if j.bands is not None else ()
        if j.objects is not None and (many := len(j.objects.unseen)):
            verbs = ("s have", "") if many > 1 else (" has", "s")
            out.append(f"{many} object{verbs[0]} no valid pixel, and count{verbs[1]} neither as found nor as missed")
    return list(dict.fromkeys(out))
