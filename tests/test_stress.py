"""The benchmark of correct digits: its references are right, and deglint keeps its digits."""

import math
from fractions import Fraction

import numpy as np
import pytest

from benchmarks import stress
from benchmarks.stress import HardCase, digits, sea

wide = pytest.mark.skipif(not stress.WIDE, reason="a long double is a double here")


@pytest.mark.parametrize(
    ("found", "right", "expected"),
    [(1.0, 1.0, 16), (1.001, 1.0, 3), (0.0, 0.0, 16), (1e-30, 0.0, 0), (math.nan, 1.0, 0), (math.nan, math.nan, 16),
     (math.inf, math.inf, 16), (3.0, 1.0, 0)],
)  # fmt: skip
def test_digits_are_of_the_relative_error(found, right, expected):
    assert digits(found, right) == pytest.approx(expected, abs=1e-9)


@wide
def test_the_reference_is_exact_arithmetic():
    case = HardCase("", sea(8, 9, seed=3) + 1e8)
    flat = [[Fraction(float(v)) for v in band.ravel()] for band in case.block]
    mean = [sum(b) / len(b) for b in flat]
    away = [[v - m for v in b] for b, m in zip(flat, mean, strict=True)]
    covariance = [[sum(map(Fraction.__mul__, a, b)) / 71 for b in away] for a in away]
    found = stress.mean_and_covariance(case.pixels)
    assert digits(found[0], [float(m) for m in mean]) == 16
    assert digits(found[1], np.array(covariance, float)) > 15.9
    slopes = [float(covariance[band][3] / covariance[3][3]) for band in range(3)]
    assert digits(stress.slopes(HardCase("", case.block - 1e8)), slopes) > 15.5


@wide
def test_scores_of_the_reference_are_distances_by_inverse():
    case = HardCase("", sea(30, 30))
    x = case.block.reshape(4, -1)
    d = x - x.mean(axis=1, keepdims=True)
    expected = np.einsum("ip,ij,jp->p", d, np.linalg.inv(np.cov(x)), d)
    np.testing.assert_allclose(stress.rx_scores(case).astype(float).ravel(), expected, rtol=1e-10)
    ring = np.ones((11, 11), bool)
    ring[4:7, 4:7] = False
    for (row, column), found in zip(stress.PLACES, stress.local_scores(case), strict=True):
        y = case.block[:, row - 5 : row + 6, column - 5 : column + 6][:, ring]
        d = case.block[:, row, column] - y.mean(axis=1)
        assert float(found) == pytest.approx(d @ np.linalg.inv(np.cov(y)) @ d, rel=1e-9)


@wide
@pytest.mark.parametrize("name", ["plain", "offset 1e8", "scale 1e-12", "a constant band", "1 % NaN", "uint8"])
def test_our_digits(name):
    case = next(c for c in stress.cases() if c.name == name)
    right = stress.references(case)
    single = case.block.dtype.itemsize < 4  # scores of integers are float32
    for operation, job in stress.by_deglint(case).items():
        least = 13.5 if "RX" not in operation else 6.5 if single else 12
        assert digits(job(), *right[operation]) > least, operation


def test_every_program_is_compared_and_a_refusal_is_told(monkeypatch):
    (case,) = [c for c in stress.cases() if c.name == "1 % NaN"]
    found = stress.measure(case)
    assert set(found) == {"mean", "covariance", "slope", "RX", "local RX"}
    assert found["mean"]["deglint"] > 14
    assert found["mean"]["numpy"] == 0
    assert found["mean"]["scikit-learn"] is None
    monkeypatch.setattr(stress, "cases", lambda: [case])
    head, body = stress.rows()
    assert body[0][0] == "1 % NaN"
    assert body[0][head.index("mean: " + " / ".join(found["mean"]))].startswith("16 / 0 / -")
