"""Detection counted by objects instead of pixels.

An object is found if at least one of its pixels is detected. A connected part of the detected pixels that contains a
pixel of an object belongs to the object. Every other connected part is one false alarm, of any size.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from deglint.errors import InputError

from ..arrays import Array, Float64, Int32, Int64, Mask
from ..objects import Object, find, label
from .curve import Roc, usable

RATES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)  # Pfa of operating points; those below 1 background pixel are left out
_MOST_THRESHOLDS = 40  # maximum number of thresholds of an `ObjectCurve` that are scores of objects
_HIGHEST = np.iinfo(np.int32).max  # largest number of an object


@dataclass(frozen=True)
class ObjectScore:
    """Scores of one object of the truth, over its valid pixels."""

    number: int  # number of the object in the truth
    size: int  # number of its valid pixels
    left_out: int  # number of its pixels that are not valid
    score_max: float
    score_mean: float
    pfa: float  # smallest Pfa at which it is found: fraction of the background with a score of at least `score_max`
    bounds: tuple[tuple[int, int], tuple[int, int]]  # ((row0, row1), (col0, col1)), half-open


@dataclass(frozen=True, eq=False)
class ObjectCurve:
    """Number of objects found and number of false alarms, at each threshold from the highest to the lowest."""

    objects: tuple[ObjectScore, ...]  # objects with a valid pixel, in order of descending `score_max`
    unseen: tuple[int, ...]  # numbers of the objects without a valid pixel: they cannot be found, and are not counted
    thresholds: Float64  # (steps,), descending; pixels with a score of at least the threshold are detected
    found: Int64  # (steps,): number of objects found
    false_alarms: Int64  # (steps,): number of connected parts that contain no pixel of an object
    pfa: Float64  # (steps,): fraction of background pixels that are detected

    @property
    def pd(self) -> Float64:
        """Fraction of the objects that are found at each threshold, (steps,)."""
        return np.asarray(self.found / len(self.objects))


def number_objects(truth: Array, *, connected: bool = False) -> Int32:
    """Number of the object to which each pixel belongs, (row, column); 0 for background.
    `truth`, (row, column), is 0 or NaN for background, else the number of an object. If only one number occurs, so that
    `truth` is a mask of all targets, or if `connected` is True, each connected part becomes an object with a number of
    its own, from 1. Otherwise, InputError is raised if a number is not an integer of 32 bits.
    """
    names = np.unique(truth[np.isfinite(truth) & (truth != 0)])
    if len(names) <= 1 or connected:
        return label(np.isin(truth, names))
    wrong = names[(names != np.rint(names)) | (np.abs(names.astype(np.float64)) > _HIGHEST)]
    if len(wrong):
        raise InputError(
            f"truth: allowed are 0 and integers up to {_HIGHEST}, the numbers of objects, got {float(wrong[0]):.12g}. "
            "SCORES come first, TRUTH last; --connected takes any numbers."
        )
    return np.where(np.isin(truth, names), truth, 0).astype(np.int32)


def object_curve(
    scores: Array, objects: Array, roc: Roc, valid: Mask | None = None, *, pfa_max: float = 0.1
) -> ObjectCurve:
    """Compute the scores of all objects, and the numbers of objects found and of false alarms at many thresholds.

    `scores`, `objects` (from `number_objects`) and `valid` are (row, column); `roc` is the curve of the same pixels.
    Thresholds that detect a larger fraction of background pixels than `pfa_max` are left out: false alarms merge there.
    """
    ok = usable(scores, objects, valid)
    scored = tuple(sorted(_scored(scores, objects, ok, roc), key=lambda o: (-o.score_max, o.number)))
    every = np.array([o.score_max for o in scored])
    levels = np.unique(every[np.array([o.pfa for o in scored]) <= pfa_max])[::-1]
    if len(levels) > _MOST_THRESHOLDS:
        levels = levels[np.linspace(0, len(levels) - 1, _MOST_THRESHOLDS).astype(int)]
    n, own = len(roc.background), roc.background.dtype.type
    # the thresholds at `RATES` are added, so that the curve has points where no object is found
    limits = np.array([roc.point(r).threshold for r in RATES if 1 / n <= r <= pfa_max], own)
    levels = np.unique(np.append(levels, np.nextafter(limits, own(np.inf)).astype(np.float64)))[::-1]
    exact = levels.astype(own)
    return ObjectCurve(
        objects=scored,
        unseen=tuple(np.setdiff1d(objects[objects != 0], [o.number for o in scored]).tolist()),
        thresholds=levels,
        found=np.array([np.count_nonzero(every >= t) for t in levels], np.int64),
        false_alarms=np.array([count_false_alarms(scores >= t, objects, ok) for t in exact], np.int64),
        pfa=(n - np.searchsorted(roc.background, exact)) / n,
    )


def false_alarms(scores: Array, objects: Array, threshold: float, valid: Mask | None = None) -> list[Object]:
    """Find false alarms: connected pixels above a threshold that contain no pixel of an object; highest score first."""
    mask = (scores > threshold) & usable(scores, objects, valid)
    labels, touched = _parts(mask, objects)
    return find(mask & ~np.isin(labels, touched), scores)


def count_false_alarms(mask: Mask, objects: Array, valid: Mask) -> int:
    """Number of false alarms: connected parts of the detected pixels (`mask & valid`) without a pixel of an object."""
    labels, touched = _parts(mask & valid, objects)
    return int(labels.max(initial=0)) - len(touched)


def _parts(mask: Mask, objects: Array) -> tuple[Int32, Int32]:
    """Label the connected parts of a mask, (row, column); return also the labels of parts with a pixel of an object."""
    labels = label(mask)
    return labels, np.unique(labels[mask & (objects != 0)])


def _scored(scores: Array, objects: Array, ok: Mask, roc: Roc) -> Iterator[ObjectScore]:
    """Yield the score of every object that has a valid pixel (`ok` is True); `roc` is the curve of the valid pixels."""
    rows, columns = np.nonzero(objects)
    numbers = objects[rows, columns]
    order = np.argsort(numbers, kind="stable")
    cuts = np.flatnonzero(np.diff(numbers[order])) + 1
    n = len(roc.background)
    for at in np.split(order, cuts) if len(order) else ():
        r, c = rows[at], columns[at]
        if len(values := scores[r, c][ok[r, c]]):
            highest = values.max()
            pfa = (n - int(np.searchsorted(roc.background, highest, "left"))) / n
            box = ((int(r.min()), int(r.max()) + 1), (int(c.min()), int(c.max()) + 1))
            mean, left_out = float(values.mean(dtype=np.float64)), len(at) - len(values)
            yield ObjectScore(int(numbers[at[0]]), len(values), left_out, float(highest), mean, pfa, box)
