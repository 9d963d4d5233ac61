"""Detection counted by objects instead of pixels.

An object is found when one of its pixels is detected. Connected detected pixels that touch an object belong to it;
every other connected part is one false alarm, whatever its size.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from deglint.errors import InputError

from ..arrays import Array, Float64, Int32, Int64, Mask
from ..objects import Object, find, label
from .curve import Roc, usable

RATES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""False-alarm rates of the operating points; rates below one pixel of background are left out."""
_MOST_THRESHOLDS = 40


@dataclass(frozen=True)
class ObjectScore:
    """Score of an object of the truth."""

    number: int  # in the truth
    size: int  # valid pixels
    left_out: int  # pixels that are not valid
    score_max: float
    score_mean: float
    pfa: float  # least pixel Pfa at which it is found: background that scores at least as high
    bounds: tuple[tuple[int, int], tuple[int, int]]  # ((row0, row1), (col0, col1))


@dataclass(frozen=True, eq=False)
class ObjectCurve:
    """Objects found against false alarms, as the threshold falls."""

    objects: tuple[ObjectScore, ...]  # the highest score first; those without a valid pixel are not among them
    unseen: tuple[int, ...]  # numbers of the objects without a valid pixel: they cannot be found, and are not counted
    thresholds: Float64  # (steps,), descending; detected is what is not less
    found: Int64  # (steps,): objects
    false_alarms: Int64  # (steps,): connected parts that touch no object
    pfa: Float64  # (steps,): of pixels

    @property
    def pd(self) -> Float64:
        """Fraction of the objects found."""
        return np.asarray(self.found / len(self.objects))


def number_objects(truth: Array, *, connected: bool = False) -> Int32:
    """Object numbers, 0 elsewhere: those of the truth where it holds several, else its connected parts.

    `truth` is (row, column): 0, or an object's number; NaN is no object. With `connected`, parts are taken whatever
    their numbers, as of a map of classes. Numbers that are not integers are an InputError.
    """
    names = np.unique(truth[np.isfinite(truth) & (truth != 0)])
    if len(names) <= 1 or connected:
        return label(np.isin(truth, names))
    if truth.dtype.kind == "f" and (names != np.rint(names)).any():
        raise InputError(
            f"truth: allowed are 0 and integers, the numbers of objects, got {names[names != np.rint(names)][0]:g}. "
            "SCORES come first, TRUTH last."
        )
    return np.where(np.isin(truth, names), truth, 0).astype(np.int32)


def object_curve(
    scores: Array, objects: Array, roc: Roc, valid: Mask | None = None, *, pfa_max: float = 0.1
) -> ObjectCurve:
    """Scores of all objects, and number found against false alarms.

    `objects` come from `number_objects`; `roc` is of the same pixels. Thresholds of a pixel Pfa above `pfa_max` are
    left out: false alarms run into one another there.
    """
    ok = usable(scores, objects, valid)
    scored = tuple(sorted(_scored(scores, objects, ok, roc), key=lambda o: (-o.score_max, o.number)))
    unseen = np.setdiff1d(objects[objects != 0], [o.number for o in scored]).tolist()
    every = np.array([o.score_max for o in scored])
    levels = np.unique(every[np.array([o.pfa for o in scored]) <= pfa_max])[::-1]
    if len(levels) > _MOST_THRESHOLDS:
        levels = levels[np.linspace(0, len(levels) - 1, _MOST_THRESHOLDS).astype(int)]
    n, own = len(roc.background), roc.background.dtype.type
    # and round values of Pfa, so that the curve goes on where no object is found
    limits = np.array([roc.point(r).threshold for r in RATES if 1 / n <= r <= pfa_max], own)
    levels = np.unique(np.append(levels, np.nextafter(limits, own(np.inf)).astype(np.float64)))[::-1]
    exact = levels.astype(own)
    return ObjectCurve(
        objects=scored,
        unseen=tuple(unseen),
        thresholds=levels,
        found=np.array([np.count_nonzero(every >= t) for t in levels], np.int64),
        false_alarms=np.array([count_false_alarms(scores >= t, objects, ok) for t in exact], np.int64),
        pfa=(n - np.searchsorted(roc.background, exact)) / n,
    )


def false_alarms(scores: Array, objects: Array, threshold: float, valid: Mask | None = None) -> list[Object]:
    """Connected parts above a threshold that touch no object, the highest score first."""
    mask = (scores > threshold) & usable(scores, objects, valid)
    labels, touched = _parts(mask, objects)
    return find(mask & ~np.isin(labels, touched), scores)


def count_false_alarms(mask: Mask, objects: Array, valid: Mask) -> int:
    """Connected parts of a detection mask that touch no object."""
    labels, touched = _parts(mask & valid, objects)
    return int(labels.max(initial=0)) - len(touched)


def _parts(mask: Mask, objects: Array) -> tuple[Int32, Int32]:
    """Numbers of connected parts, and those that touch an object."""
    labels = label(mask)
    return labels, np.unique(labels[mask & (objects != 0)])


def _scored(scores: Array, objects: Array, ok: Mask, roc: Roc) -> Iterator[ObjectScore]:
    """Every object that has a valid pixel."""
    rows, columns = np.nonzero(objects)
    numbers = objects[rows, columns]
    order = np.argsort(numbers, kind="stable")
    cuts = np.flatnonzero(np.diff(numbers[order])) + 1
    n = len(roc.background)
    for at in np.split(order, cuts) if len(order) else ():
        r, c = rows[at], columns[at]
        values = scores[r, c][ok[r, c]]
        if len(values):
            highest = values.max()
            pfa = (n - int(np.searchsorted(roc.background, highest, "left"))) / n
            box = ((int(r.min()), int(r.max()) + 1), (int(c.min()), int(c.max()) + 1))
            mean, left_out = float(values.mean(dtype=np.float64)), len(at) - len(values)
            yield ObjectScore(int(numbers[at[0]]), len(values), left_out, float(highest), mean, pfa, box)
