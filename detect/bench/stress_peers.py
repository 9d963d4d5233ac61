"""Correct digits of what others do with the same pixels: numpy, scikit-learn, spectral, and two programs' formulas.

sensingpy 3.0.4 fits `numpy.polyfit` for Hedley, takes `numpy.cov` for the slope of Lyzenga, and computes in the type of
the image; sungc subtracts in the type of the image and truncates. Both are written out here in a line each.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np

from .stress_cases import NIR, Block, digits
from .stress_ours import GIVEN, INNER, OUTER, Found
from .stress_truth import PERCENTILE, Truth, local_scores

SIDE = 22
"""Side of the square on which spectral's local RX is tried, which goes pixel by pixel [pixel]."""
Steps = Iterator[tuple[str, Callable[[], Any], Any, Any]]
"""Operation, how the peer does it, what is right, and what errors are relative to."""


def programs() -> dict[str, str]:
    """Every peer, and "" or why it is not here."""
    module = {"numpy": "numpy", "scikit-learn": "sklearn", "spectral": "spectral"}
    found = {name: "" if find_spec(m) else "not installed" for name, m in module.items()}
    return found | {"sensingpy's formula": "", "sungc's formula": ""}


def measure(right: Truth) -> dict[str, Found]:
    """Digits by program and operation, or what was said where it was refused."""
    parts: dict[str, Callable[[Truth], Steps]] = {
        "numpy": _numpy, "scikit-learn": _sklearn, "spectral": _spectral, "sensingpy's formula": _sensingpy,
        "sungc's formula": _sungc,
    }  # fmt: skip
    out: dict[str, Found] = {}
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for program, missing in programs().items():
            found: Found = {}
            for operation, compute, expected, size in () if missing else parts[program](right):
                if not right.case.squares and operation.startswith(("slope", "RX", "local")):
                    continue
                try:
                    found[operation] = digits(compute(), expected, size)
                except (ValueError, TypeError, ArithmeticError, IndexError, NotImplementedError) as error:
                    found[operation] = f"refused: {error}".splitlines()[0]
            out[program] = found
    return out


def _moments(mean: Any, covariance: Any, right: Truth) -> Steps:
    off = ~np.eye(len(right.mean), dtype=np.bool_)
    yield "mean", mean, right.mean, None
    yield "variance", lambda: np.diag(covariance()), np.diag(right.covariance), None
    yield "covariance", lambda: covariance()[off], right.covariance[off], None


def _numpy(right: Truth) -> Steps:
    flat = right.case.block.reshape(len(right.case.block), -1)
    yield from _moments(lambda: flat.mean(axis=1), lambda: np.cov(flat), right)
    yield "slope, ols", lambda: [np.polyfit(flat[NIR], y, 1)[0] for y in flat[:NIR]], right.slopes, None
    yield "level, percentile", lambda: np.percentile(flat[NIR], PERCENTILE), right.percentile, None


def _sklearn(right: Truth) -> Steps:
    from sklearn.covariance import EmpiricalCovariance
    from sklearn.linear_model import LinearRegression

    pixels = np.ascontiguousarray(right.case.block.reshape(len(right.case.block), -1).T)
    more = len(pixels) / (len(pixels) - 1)

    def fitted() -> Any:
        return EmpiricalCovariance().fit(pixels)

    def slopes() -> Any:
        return LinearRegression().fit(pixels[:, NIR:], pixels[:, :NIR]).coef_[:, 0]

    yield from _moments(lambda: fitted().location_, lambda: fitted().covariance_ * more, right)
    yield "slope, ols", slopes, right.slopes, None
    shape = right.case.block.shape[1:]
    yield "RX", lambda: (fitted().mahalanobis(pixels) / more).reshape(shape), *right.scores


def _spectral(right: Truth) -> Steps:
    import spectral

    spectral.settings.show_progress = False
    case = right.case
    image = np.ascontiguousarray(case.block.transpose(1, 2, 0))
    yield from _moments(lambda: spectral.calc_stats(image).mean, lambda: spectral.calc_stats(image).cov, right)
    yield "RX", lambda: spectral.rx(image), *right.scores
    if case.large or not case.squares or min(case.block.shape[1:]) < SIDE:
        return
    places = np.argwhere(np.ones((SIDE - OUTER + 1,) * 2, np.bool_))[::7] + OUTER // 2
    small = image[:SIDE, :SIDE]
    expected = local_scores(case.block, case.independent, INNER, OUTER, places)
    size = np.fmax(expected, len(case.independent))
    yield "local RX", lambda: spectral.rx(small, window=(INNER, OUTER))[tuple(places.T)], expected, size


def _sensingpy(right: Truth) -> Steps:
    """`deglinting.hedley` and `lyzenga` of sensingpy 3.0.4."""
    block = right.case.block
    sample = block[:, np.isfinite(block).all(axis=0)]
    yield "slope, ols", lambda: [np.polyfit(sample[NIR], y, 1)[0] for y in sample[:NIR]], right.slopes, None
    yield "slope, Lyzenga", lambda: [np.cov(sample[NIR], y)[0, 1] for y in sample[:NIR]], right.slopes, None
    expected, size = right.corrected(GIVEN, sample[NIR].min())
    expected = np.where(expected < 0, np.nan, expected)

    def corrected() -> Block:
        out = block[:NIR].copy()
        for i, slope in enumerate(GIVEN):
            out[i] = out[i] - slope * (block[NIR] - np.nanmin(sample[NIR]))
            out[i][out[i] < 0] = np.nan
        return out

    yield _correction(block), corrected, expected, size


def _correction(block: Block) -> str:
    return "correction, as stored" if block.dtype.kind in "iu" else "correction"


def _sungc(right: Truth) -> Steps:
    """Hedley and NIR subtraction in the image's type; integers are truncated, and wrap."""
    bands, nir = right.case.block[:NIR], right.case.block[NIR]
    least = right.pixels[NIR].min().astype(bands.dtype)
    expected, size = right.corrected(GIVEN, least)

    def corrected() -> Block:
        return np.stack(
            [(y - slope * (nir - least)).astype(bands.dtype) for y, slope in zip(bands, GIVEN, strict=True)]
        )

    yield _correction(bands), corrected, expected, size
    yield "NIR subtraction", lambda: bands - nir, *right.corrected((1, 1, 1), 0)
