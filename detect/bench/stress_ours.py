"""Correct digits of the project's own statistics, slopes, levels, corrections and scores on one block of pixels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from deglint import remove
from deglint.errors import DeglintError
from deglint.moments import Moments, cell_moments
from deglint.raster.encode import retype
from deglint.remove.levels import mode
from deglint.remove.request import regression_plan
from deglint.scene import Band
from detect.background import estimate
from detect.local import local_rx
from detect.rx import detector, score

from . import stress_truth as truth
from .stress_cases import NIR, Block, Case, digits

INNER, OUTER = 3, 11
GIVEN = (0.9, 0.8, 0.5)
"""Slopes for corrections that are compared."""
ROBUST = (15, 20)
"""Rows and columns of the corner that the robust regressions look at."""
LOCAL_STEP = 11
"""Every so many rows and columns a local score is looked at."""
Found = dict[str, float | str]
Steps = Iterator[tuple[str, float | str]]


def measure(right: truth.Truth) -> Found:
    """Digits by operation, or what was said where it was refused."""
    found: Found = {}
    with np.errstate(under="ignore"):
        for part in (_statistics, _slopes, _robust, _levels, _scores, _local):
            found |= dict(part(right))
    return found


def _moments(case: Case, *, compiled: bool) -> Moments:
    return cell_moments(case.block, cell=case.cell, compiled=compiled).total()


def _statistics(right: truth.Truth) -> Steps:
    """Of mean, variance and covariance, the worse of the two engines."""
    covariance = right.covariance
    off = ~np.eye(len(covariance), dtype=np.bool_)
    both = [_moments(right.case, compiled=compiled) for compiled in (False, True)]
    yield "mean", min(digits(m.mean, right.mean) for m in both)
    yield "variance", min(digits(np.diag(m.covariance()), np.diag(covariance)) for m in both)
    yield "covariance", min(digits(m.covariance()[off], covariance[off]) for m in both)


def _physical(block: Block) -> Block:
    """What readers make of file numbers."""
    return block if block.dtype in (np.float32, np.float64) else block.astype(np.float64)


def _fitted(block: Block, regression: str) -> Any:
    """Slopes of all bands on the NIR."""
    request = remove.nir_request([Band(f"band {i + 1}") for i in range(len(block))], [NIR], regression=regression)
    plan = regression_plan(request, keep_index=True)
    block = _physical(block)[list(plan.read_bands)]
    stats = remove.merge([remove.gather(block, np.ones(block.shape[1:], np.bool_), plan)], plan)
    return remove.REGRESSIONS[regression](stats).slope[:, 0]


def _slopes(right: truth.Truth) -> Steps:
    """Of the slopes of three bands on the NIR, by least squares."""
    if not right.case.squares:
        yield "slope, ols", _refusal("lyzenga", right)
        return
    yield "slope, ols", digits(_fitted(right.case.block, "ols"), right.slopes)
    fits = remove.fit("lyzenga", _physical(right.case.block), nir=NIR).fits
    yield "slope, Lyzenga", digits([f.slope for f in fits], right.slopes)


def _refusal(method: str, right: truth.Truth) -> str:
    """What is said where nothing can be fitted."""
    try:
        remove.fit(method, _physical(right.case.block), nir=NIR)
    except DeglintError as error:
        return f"refused: {error}"
    return "not refused"


def _robust(right: truth.Truth) -> Steps:
    """Of the slopes of the other regressions."""
    case = right.case
    if case.large or not case.squares:
        return
    local = truth.detrended(case.block, 15)
    yield (
        "slope, detrended",
        digits(_fitted(case.block, "detrended"), [truth.slope(local, b, NIR) for b in range(NIR)]),
    )
    corner = case.block[:, : ROBUST[0], : ROBUST[1]]
    few = truth.pixels(corner)
    yield "slope, Theil-Sen", digits(_fitted(corner, "theil-sen"), [truth.theil_sen(few, b, NIR) for b in range(NIR)])
    found = _fitted(corner, "huber")
    yield "slope, Huber", digits(found, [truth.huber(few, b, NIR, float(found[b])) for b in range(NIR)])


def _levels(right: truth.Truth) -> Steps:
    """Of the NIR's levels, and of the pixels corrected with them."""
    block, case = _physical(right.case.block), right.case
    if not case.squares:
        return
    nir = right.pixels[NIR]
    darkest = remove.fit("hedley", block, nir=NIR)
    level = remove.fit("hedley", block, nir=NIR, floor_percentile=truth.PERCENTILE).indexes[0].level
    yield "level, minimum", digits(darkest.indexes[0].level, nir.min())
    yield "level, percentile", digits(level, right.percentile)
    yield "correction", _corrected(block, darkest, right)
    if case.block.dtype.kind in "iu":
        given = replace(darkest, fits=tuple(replace(f, slope=s) for f, s in zip(darkest.fits, GIVEN, strict=True)))
        stored = retype(remove.apply(block, given), case.block.dtype)[0][:NIR]
        yield "correction, as stored", digits(stored, *right.corrected(GIVEN, nir.min()))
    yield "NIR subtraction", _corrected(block, remove.fit("nir-subtraction", block, nir=NIR), right)
    if not case.large:
        middle = float(nir.min())
        moved = mode((nir - np.longdouble(middle)).astype(float))
        yield "level, mode", digits(mode(nir.astype(float)), np.longdouble(moved) + np.longdouble(middle))


def _corrected(block: Block, model: remove.GlintModel, right: truth.Truth) -> float:
    expected, size = right.corrected([f.slope for f in model.fits], model.indexes[0].level)
    return digits(remove.apply(block, model)[:NIR], expected, size)


def _scores(right: truth.Truth) -> Steps:
    """Of RX scores, the worse of the two engines."""
    try:
        ready = detector("rx", estimate(_moments(right.case, compiled=True)))
    except DeglintError as error:
        yield "RX", f"refused: {error}"
        return
    found = [score(right.case.block, ready, compiled=compiled) for compiled in (False, True)]
    yield "RX", min(digits(f, *right.scores) for f in found)


def _local(right: truth.Truth) -> Steps:
    """Of some local scores."""
    case, half = right.case, OUTER // 2
    rows, columns = (np.arange(half, n - half, LOCAL_STEP) for n in case.block.shape[1:])
    if case.large or not case.squares or not (len(rows) and len(columns)):
        return
    places = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
    scores = local_rx(case.block, inner=INNER, outer=OUTER)[places[:, 0], places[:, 1]]
    expected = truth.local_scores(case.block, case.independent, INNER, OUTER, places)
    yield "local RX", digits(scores, expected, np.fmax(expected, len(case.independent)))
