"""Digits on data whose statistics are certified, and on 1e8 pixels whose sums are whole numbers."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint import remove
from deglint.moments import CellMoments, cell_moments, moments
from deglint.remove.regression import least_squares
from deglint.remove.request import regression_plan
from deglint.scene import Band
from detect.covariance import whitener

from . import stress_cases as data
from .stress_cases import digits

Pixels = npt.NDArray[Any]
Row = tuple[str, dict[str, float]]
STRIP, WIDTH = 64, 10_000
"""Rows and columns of a strip of the large scene [pixel]."""


def certified() -> list[Row]:
    """Digits of NIST's certified values by quantity and program; "as stored": those that float64 leaves in the data."""
    rows: list[Row] = []
    for name, (values, mean, deviation) in data.UNIVARIATE.items():
        exact = [Fraction(float(v)) for v in values]
        middle = sum(exact) / len(exact)
        spread = np.sqrt(float(sum((v - middle) ** 2 for v in exact) / (len(exact) - 1)))
        found = {program: of(values) for program, of in _univariate().items()}
        found["as stored"] = (float(middle), float(spread))
        for i, (what, right) in enumerate((("mean", mean), ("standard deviation", deviation))):
            rows.append((f"{name}, {what}", {p: digits(f[i], right) for p, f in found.items()}))
    rows.extend(_norris())
    rows.append(("Longley, worst of six slopes", {p: digits(f, data.LONGLEY_SLOPES) for p, f in _longley().items()}))
    return rows


def _univariate() -> dict[str, Callable[[Pixels], tuple[float, float]]]:
    """Mean and standard deviation by each program."""

    def ours(x: Pixels) -> tuple[float, float]:
        found = moments(x[None])
        return float(found.mean[0]), float(np.sqrt(found.covariance()[0, 0]))

    def sklearn(x: Pixels) -> tuple[float, float]:
        from sklearn.covariance import EmpiricalCovariance

        found = EmpiricalCovariance(store_precision=False).fit(x[:, None])
        return float(found.location_[0]), float(np.sqrt(found.covariance_[0, 0] * len(x) / (len(x) - 1)))

    def spectral(x: Pixels) -> tuple[float, float]:
        from spectral import calc_stats

        found = calc_stats(np.stack([x, x], axis=-1)[None])
        return float(found.mean[0]), float(np.sqrt(found.cov[0, 0]))

    by: dict[str, Callable[[Pixels], tuple[float, float]]] = {
        "deglint": ours,
        "numpy": lambda x: (float(x.mean()), float(x.std(ddof=1))),
        "scikit-learn": sklearn,
    }
    return by | ({"spectral": spectral} if find_spec("spectral") else {})


def _norris() -> list[Row]:
    """Slope, its standard error and R2 of a line."""
    from scipy.stats import linregress

    request = remove.nir_request((Band("y"), Band("x")), [1])
    plan = regression_plan(request, keep_index=False)
    block = data.NORRIS.reshape(2, 6, 6)
    found = least_squares(remove.merge([remove.gather(block, np.ones((6, 6), np.bool_), plan)], plan))
    peer = linregress(data.NORRIS[1], data.NORRIS[0])
    right = (data.NORRIS_SLOPE, data.NORRIS_ERROR, data.NORRIS_R2)
    ours = (float(found.slope[0, 0]), float(found.stderr[0, 0]), float(found.r2[0, 0]))
    theirs = (peer.slope, peer.stderr, peer.rvalue**2)
    names = ("slope", "standard error of the slope", "R2")
    return [
        (f"Norris, {name}", {"deglint": digits(a, c), "SciPy": digits(b, c)})
        for name, a, b, c in zip(names, ours, theirs, right, strict=True)
    ]


def _longley() -> dict[str, Pixels]:
    """Slopes of six collinear variables: by the moments' whitener, by QR of the data, by scikit-learn."""
    from sklearn.linear_model import LinearRegression

    covariance = moments(data.LONGLEY).covariance()
    inverse = whitener(covariance[1:, 1:])
    y, x = data.LONGLEY[0], data.LONGLEY[1:].T
    return {
        "deglint": inverse.T @ (inverse @ covariance[1:, 0]),
        "numpy": np.linalg.lstsq(np.c_[np.ones(len(x)), x], y, rcond=None)[0][1:],
        "scikit-learn": LinearRegression().fit(x, y).coef_,
    }


def streamed(pixels: int) -> tuple[int, list[Row]]:
    """Pixels, and digits of float32 counts of 1000 +- 10 that come in strips, against sums of whole numbers.

    numpy's mean over the first axis of an array (pixel, band) is made strip by strip as numpy adds it: that is what
    scikit-learn and spectral take as the mean.
    """
    base = np.rint(data.sea(STRIP, WIDTH, 5)[[0, 3]] + 950).astype(np.int64)
    sums, products = np.zeros(2, np.int64), np.zeros((2, 2), np.int64)
    running, parts = np.zeros(2, np.float32), []
    strips = -(-pixels // (STRIP * WIDTH))
    for i in range(strips):
        strip = np.roll(base, 101 * i, axis=2) + i % 7
        flat = strip.reshape(2, -1)
        sums += flat.sum(axis=1)
        products += np.array([[(a * b).sum() for b in flat] for a in flat])
        block = strip.astype(np.float32)
        parts.append(CellMoments.from_moments(cell_moments(block, compiled=True).total()))
        running = np.add.reduce(np.ascontiguousarray(np.vstack([running, block.reshape(2, -1).T])), axis=0)
    total = CellMoments.concatenate(parts).total()
    n = strips * STRIP * WIDTH
    mean = [float(Fraction(int(s), n)) for s in sums]
    central = [[n * int(products[i, j]) - int(sums[i]) * int(sums[j]) for j in (0, 1)] for i in (0, 1)]
    covariance = np.array([[float(Fraction(c, n * (n - 1))) for c in row] for row in central])
    slope = float(Fraction(central[0][1], central[1][1]))
    return n, [
        ("mean", {"deglint": digits(total.mean, mean), "numpy, (pixel, band)": digits(running / np.float32(n), mean)}),
        ("covariance", {"deglint": digits(total.covariance(), covariance)}),
        ("slope, ols", {"deglint": digits(total.comoment[0, 1] / total.comoment[1, 1], slope)}),
    ]
