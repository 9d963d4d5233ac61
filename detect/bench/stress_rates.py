"""Correct digits of what is read off scores: areas, their standard errors, thresholds and p-values.

Areas and DeLong's variances are compared with whole numbers, counted pair by pair; thresholds with 60 digits of mpmath.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from detect.roc import Roc, auc_interval, compare
from detect.threshold import from_chi2, from_f, p_value

from .stress_cases import digits

Scores = npt.NDArray[Any]
ByCase = dict[tuple[str, str], dict[str, dict[str, float]]]
"""Digits by the scores' name and key, program and operation."""
TARGETS, BACKGROUND = 60, 20_000
QUANTILES = ((3, 1e-3), (8, 1e-6), (8, 1e-15), (200, 1e-4), (8, 1e-300), (8, 0.5), (1, 1e-9), (8, 1 - 1e-9))
"""Bands and false-alarm rates of the thresholds."""
SMALL_SAMPLES = ((3, 1000, 1e-4), (8, 10, 1e-3), (8, 9, 1e-10), (200, 250, 1e-6), (8, 10**8, 1e-12))
"""Bands, pixels of the background and rates of the thresholds by F."""
DISTANCES = ((3, 5.0), (8, 80.0), (8, 1200.0), (200, 150.0), (8, 1e-3))
FAR = ((3, 1000, 40.0), (8, 10, 1e5), (200, 250, 1e7), (8, 10**8, 100.0))
"""Bands, pixels and squared distances of the p-values by F."""


def score_cases() -> Iterator[tuple[str, str, Scores, Scores, npt.NDArray[np.bool_]]]:
    """Name, key, two detectors' scores, and truth."""
    rng = np.random.default_rng(4)
    truth = np.arange(TARGETS + BACKGROUND) < TARGETS
    first = rng.standard_normal(len(truth)) + 1.5 * truth
    second = 0.8 * first + 0.6 * rng.standard_normal(len(truth))
    yield "plain scores", "plain", first, second, truth
    yield "offset 1e8", "offset1e8", first + 1e8, second + 1e8, truth
    yield "scale 1e-12", "scale1e-12", first * 1e-12, second * 1e-12, truth
    yield "scale 1e12", "scale1e12", first * 1e12, second * 1e12, truth
    yield "denormal", "denormal", first * 1e-310, second * 1e-310, truth
    yield "float32", "float32", first.astype(np.float32), second.astype(np.float32), truth
    whole = [np.clip(np.rint(20 * s + 100), 0, 255).astype(np.uint8) for s in (first, second)]
    yield "uint8: most are tied", "ties", whole[0], whole[1], truth
    extreme = first.copy()
    extreme[-1] = 1e300
    yield "one background pixel of 1e300", "extreme", extreme, second, truth
    apart, away = first + 40 * truth, second + 40 * truth
    apart[0], away[1] = np.sort(apart[TARGETS:])[-3:-1]
    yield "all but parted: area 1 - 1e-6", "parted", apart, away, truth
    large = (first * 1e6).astype(np.int64) + 2**60
    yield "int64 beyond 2^53", "int64", large, (second * 1e6).astype(np.int64) + 2**60, truth


def exact(first: Scores, second: Scores, truth: npt.NDArray[np.bool_]) -> dict[str, float]:
    """Area, DeLong's standard error, the difference of two areas and its standard error, from all pairs."""
    parts = [_pairs(s[truth], s[~truth]) for s in (first, second)]
    m, n = (int(np.count_nonzero(x)) for x in (truth, ~truth))
    area = [Fraction(sum(v10), 2 * m * n) for v10, _ in parts]
    change = [[a - b for a, b in zip(x, y, strict=True)] for x, y in zip(*parts, strict=True)]
    return {
        "AUC": float(area[0]),
        "DeLong error": _root(_variance(parts[0][0], n) / m + _variance(parts[0][1], m) / n),
        "AUC difference": float(area[0] - area[1]),
        "DeLong difference": _root(_variance(change[0], n) / m + _variance(change[1], m) / n),
        "average precision": float(_precision(first, truth)),
    }


def _pairs(targets: Scores, background: Scores) -> tuple[list[int], list[int]]:
    """Twice the background below each target, and twice the targets above each background pixel; ties are one."""
    above = np.array([2 * (t > background) + (t == background).astype(int) for t in targets], np.int64)
    return [int(v) for v in above.sum(axis=1)], [int(v) for v in above.sum(axis=0)]


def _variance(values: list[int], others: int) -> Fraction:
    """Sample variance of components held in halves."""
    n = len(values)
    return Fraction(n * sum(v * v for v in values) - sum(values) ** 2, n * (n - 1) * (2 * others) ** 2)


def _root(value: Fraction) -> float:
    return float(np.sqrt(np.longdouble(value.numerator) / np.longdouble(value.denominator)))


def _precision(scores: Scores, truth: npt.NDArray[np.bool_]) -> Fraction:
    total, before = Fraction(0), 0
    for at in np.unique(scores[truth])[::-1]:
        found, called = int((scores[truth] >= at).sum()), int((scores >= at).sum())
        total += Fraction(found - before, int(truth.sum())) * Fraction(found, called)
        before = found
    return total


def by_us(first: Scores, second: Scores, truth: npt.NDArray[np.bool_]) -> dict[str, float]:
    """The same by `detect.roc`."""
    roc, both = Roc.of(first, truth), compare(first, second, truth)
    return {
        "AUC": roc.auc,
        "DeLong error": auc_interval(roc).standard_error,
        "AUC difference": both.difference,
        "DeLong difference": both.standard_error,
        "average precision": roc.average_precision,
    }


def by_sklearn(first: Scores, second: Scores, truth: npt.NDArray[np.bool_]) -> dict[str, float]:
    """The same by scikit-learn, which has no DeLong."""
    from sklearn.metrics import average_precision_score, roc_auc_score

    area = float(roc_auc_score(truth, first))
    return {
        "AUC": area,
        "AUC difference": area - float(roc_auc_score(truth, second)),
        "average precision": float(average_precision_score(truth, first)),
    }


def thresholds() -> Iterator[tuple[str, float, float, float]]:
    """Operation, the right value, ours, and SciPy's distributions'; nothing without mpmath."""
    if not find_spec("mpmath"):
        return
    from scipy import stats

    for bands, pfa in QUANTILES:
        ours = from_chi2(pfa, bands).value
        yield "chi2 threshold", _solve(lambda x, b=bands: _chi2(b, x), pfa, ours), ours, stats.chi2.isf(pfa, bands)
    for bands, n, pfa in SMALL_SAMPLES:
        ours = from_f(pfa, bands, n).value
        peer = stats.f.isf(pfa, bands, n - bands) * bands * (n * n - 1) / (n * (n - bands))
        yield "F threshold", _solve(lambda x, b=bands, k=n: _f(b, k, x), pfa, ours), ours, float(peer)
    for bands, at in DISTANCES:
        yield "chi2 p-value", float(_chi2(bands, at)), float(p_value(np.array(at), bands)), stats.chi2.sf(at, bands)
    for bands, n, at in FAR:
        ratio = at * n * (n - bands) / ((n * n - 1) * bands)
        right, ours = float(_f(bands, n, at)), float(p_value(np.array(at), bands, n))
        yield "F p-value", right, ours, float(stats.f.sf(ratio, bands, n - bands))


def _chi2(bands: int, x: Any) -> Any:
    """P(chi2(bands) > x) in 60 digits."""
    import mpmath

    with mpmath.workdps(60):
        return mpmath.gammainc(mpmath.mpf(bands) / 2, mpmath.mpf(x) / 2, mpmath.inf, regularized=True)


def _f(bands: int, n: int, x: Any) -> Any:
    """Hotelling's tail of one new observation in 60 digits."""
    import mpmath

    with mpmath.workdps(60):
        w = mpmath.mpf(x) * n / (mpmath.mpf(n) * n - 1)
        half = mpmath.mpf(n - bands) / 2
        return mpmath.betainc(half, mpmath.mpf(bands) / 2, 0, 1 / (1 + w), regularized=True)


def _solve(tail: Any, pfa: float, near: float) -> float:
    """Where a tail is `pfa`, by secant steps of its logarithm from a value near it."""
    import mpmath

    with mpmath.workdps(60):
        wanted = mpmath.log(mpmath.mpf(pfa))
        start = (mpmath.mpf(near), mpmath.mpf(near) * (1 + mpmath.mpf(10) ** -8))
        return float(mpmath.findroot(lambda x: mpmath.log(tail(x)) - wanted, start, tol=1e-60, verify=False))


def measure() -> tuple[ByCase, dict[str, dict[str, float]]]:
    """Digits of areas; and by program and operation the fewest digits of thresholds and p-values."""
    by_case: ByCase = {}
    for name, key, first, second, truth in score_cases():
        right = exact(first, second, truth)
        found = {"deglint": by_us(first, second, truth), "scikit-learn": by_sklearn(first, second, truth)}
        by_case[name, key] = {p: {op: digits(v, right[op]) for op, v in f.items()} for p, f in found.items()}
    worst: dict[str, dict[str, float]] = {}
    for operation, expected, ours, peer in thresholds():
        for program, value in (("deglint", ours), ("SciPy", peer)):
            row = worst.setdefault(program, {})
            row[operation] = min(row.get(operation, 16.0), digits(value, expected))
    return by_case, worst
