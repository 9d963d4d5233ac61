"""Correct digits of means, covariances and slopes on certified and hard data, against exact arithmetic.

Digits are -log10 of the relative error (16 where there is none), the worst of a data set's variables. The truth is that
of the numbers as stored: rational arithmetic up to 10,000 pixels, two passes in long double above.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from importlib.util import find_spec

import numpy as np

from deglint.moments import moments

from .timing import machine, say

EXACT = 10_000
"""Pixels up to which the truth is computed in rational numbers."""
# NIST StRD Norris, y then x
NORRIS = np.fromstring(
    """0.1 338.8 118.1 888.0 9.2 228.1 668.5 998.5 449.1 778.9 559.2 0.3 0.1 778.1 668.8 339.3 448.9 10.8 557.7 228.3
    998.0 888.8 119.6 0.3 0.6 557.6 339.3 888.0 998.5 778.9 10.2 117.6 228.9 668.4 449.2 0.2
    0.2 337.4 118.2 884.6 10.1 226.5 666.3 996.3 448.6 777.0 558.2 0.4 0.6 775.5 666.9 338.0 447.5 11.6 556.0 228.1
    995.8 887.6 120.2 0.3 0.3 556.8 339.1 887.2 999.0 779.0 11.1 118.3 229.2 669.1 448.9 0.5""",
    sep=" ",
).reshape(2, 36)  # fmt: skip
Truth = tuple[np.ndarray, np.ndarray]
Statistics = Callable[[np.ndarray], Truth]


def accuracy(middle: float, step: float) -> np.ndarray:
    """NIST StRD NumAcc2-4: one value, then a thousand that alternate about it; the second variable is its mirror."""
    low, high = middle - step, middle + step
    values = np.array([middle] + [low, high] * 500)
    return np.stack([values, values[::-1]])


def image(n: int, offset: float, scale: float, dtype: str) -> np.ndarray:
    """Two correlated bands of n pixels: (offset + noise of 1) * scale."""
    rng = np.random.default_rng(n)
    noise = rng.standard_normal((2, n))
    noise[0] = 0.7 * noise[1] + 0.5 * noise[0]
    return ((noise + offset) * scale).astype(dtype)


def data_sets(quick: bool) -> dict[str, np.ndarray]:
    """Name and values (variable, pixel)."""
    sets = {
        "NIST NumAcc1": np.array([[10000001.0, 10000003.0, 10000002.0], [10000003.0, 10000001.0, 10000002.0]]),
        "NIST NumAcc2": accuracy(1.2, 0.1),
        "NIST NumAcc3": accuracy(1000000.2, 0.1),
        "NIST NumAcc4": accuracy(10000000.2, 0.1),
        "NIST Norris": NORRIS,
    }
    counts = (10_000, 100_000) if quick else (10_000, 1_000_000, 10_000_000)
    for n in counts:
        sets[f"float64, 1e8 + noise of 1, {n:.0e} px"] = image(n, 1e8, 1.0, "float64")
    for scale in (1e-12, 1e12):
        sets[f"float64, (5 + noise of 1) x {scale:g}, 1e+04 px"] = image(10_000, 5, scale, "float64")
    for n in counts:
        sets[f"float32, reflectance 0.05 +- 0.01, {n:.0e} px"] = image(n, 5, 0.01, "float32")
        sets[f"float32, counts 10000 +- 10, {n:.0e} px"] = image(n, 1000, 10.0, "float32")
    return sets


def truth(x: np.ndarray) -> Truth:
    """Mean and covariance of the numbers as stored, in float64 rounded at the end."""
    n = x.shape[1]
    if n > EXACT:
        wide = x.astype(np.longdouble)
        mean = wide.mean(axis=1)
        wide -= mean[:, None]
        residue = wide.mean(axis=1)
        wide -= residue[:, None]
        covariance = [[(a * b).sum() / (n - 1) for b in wide] for a in wide]
        return np.array(mean + residue, float), np.array(covariance, float)
    rows = [[Fraction(float(v)) for v in row] for row in x]
    means = [sum(row) / n for row in rows]
    away = [[v - m for v in row] for row, m in zip(rows, means, strict=True)]
    covariance = [[float(sum(map(Fraction.__mul__, a, b)) / (n - 1)) for b in away] for a in away]
    return np.array([float(m) for m in means]), np.array(covariance)


def as_image(x: np.ndarray) -> np.ndarray:
    """The same pixels as (variable, row, column), near to square where that comes out even."""
    n = x.shape[1]
    rows = next(r for r in range(math.isqrt(n), 0, -1) if n % r == 0)
    return x.reshape(len(x), rows, -1)


def by_deglint(compiled: bool) -> Statistics:
    def statistics(x: np.ndarray) -> Truth:
        found = moments(as_image(x), compiled=compiled)
        return found.mean, found.covariance()

    return statistics


def by_numpy(x: np.ndarray) -> Truth:
    return x.mean(axis=1), np.cov(x, dtype=x.dtype)


def by_numpy_pixels_first(x: np.ndarray) -> Truth:
    """As an array (pixel, band) is averaged."""
    pixels = np.ascontiguousarray(x.T)
    mean = pixels.mean(axis=0)
    pixels -= mean
    return mean, pixels.T @ pixels / pixels.dtype.type(len(pixels) - 1)


def by_sklearn(x: np.ndarray) -> Truth:
    from sklearn.covariance import EmpiricalCovariance

    n = x.shape[1]
    found = EmpiricalCovariance(store_precision=False).fit(np.ascontiguousarray(x.T))
    return found.location_, found.covariance_ * (n / (n - 1))


def by_spectral(x: np.ndarray) -> Truth:
    import spectral

    found = spectral.calc_stats(np.ascontiguousarray(x.T)[None])
    return found.mean, found.cov


PROGRAMS: dict[str, tuple[Statistics, str]] = {
    "deglint": (by_deglint(False), "numpy"),
    "deglint, compiled": (by_deglint(True), "numba"),
    "numpy, own dtype": (by_numpy, "numpy"),
    "numpy, (pixel, band)": (by_numpy_pixels_first, "numpy"),
    "scikit-learn": (by_sklearn, "sklearn"),
    "spectral": (by_spectral, "spectral"),
}


def digits(found: object, expected: np.ndarray) -> str:
    """Correct digits of the worst value, as text."""
    error = np.max(np.abs(np.asarray(found, float) - expected) / np.abs(expected))
    return f"{16.0 if error == 0 else min(max(-math.log10(error), 0.0), 16.0):.0f}" if np.isfinite(error) else "NaN"


def score(statistics: Statistics, x: np.ndarray, expected: Truth) -> str:
    """Digits of mean / covariance / slope."""
    mean, covariance = statistics(x)
    slope = covariance[0, 1] / covariance[1, 1]
    right = expected[1][0, 1] / expected[1][1, 1]
    return " / ".join((digits(mean, expected[0]), digits(covariance, expected[1]), digits(slope, np.array(right))))


def main(quick: bool) -> None:
    """Measure and print."""
    print("## Correct digits\n\n" + machine())
    installed = {name: find_spec(module) is not None for name, (_, module) in PROGRAMS.items()}
    rows = []
    for name, x in data_sets(quick).items():
        expected = truth(x)
        row = [score(f, x, expected) if installed[p] else "not installed" for p, (f, _) in PROGRAMS.items()]
        rows.append([name, *row])
    say("Digits of mean / covariance / slope", ("", *PROGRAMS), rows)
