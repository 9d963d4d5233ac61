"""Noise by second differences, and how it grows with the level, against draws whose noise is known."""

import numpy as np
import pytest
from scipy.stats import chi2, truncnorm

from deglint.compensate.noise import HALF_OF_SQUARES, growth_by_level, noise_by_level


def test_noise_grows_with_the_level_and_sparkle_is_none():
    """Some bright squares in a wide dark sea, and sparkle in a twentieth of it."""
    rng = np.random.default_rng(3)
    level = np.full((300, 300), 10.0, np.float32)
    for row, column, height in ((30, 40, 30.0), (150, 60, 45.0), (200, 220, 60.0), (80, 200, 90.0)):
        level[row : row + 24, column : column + 24] = height
    rest = (np.sqrt(0.5 + 0.04 * level) * rng.standard_normal(level.shape)).astype(np.float32)
    flashes = rng.random((20, 20)) < 0.05
    rest += np.where(np.kron(flashes, np.ones((15, 15), bool)), rng.exponential(20, level.shape), 0).astype(np.float32)
    rest[:3] = np.nan
    fixed, growing = noise_by_level(rest, level)
    for height in (10.0, 45.0, 90.0):
        assert fixed + growing * height == pytest.approx(0.5 + 0.04 * height, rel=0.25)


def test_noise_of_whole_numbers_of_an_even_sea_and_of_next_to_nothing():
    rng = np.random.default_rng(4)
    even = np.full((200, 200), 50.0, np.float32)
    counts = np.rint(rng.normal(50.3, 1.5, even.shape)).astype(np.float32)
    fixed, growing = noise_by_level(counts - even, even)
    assert fixed + 50 * growing == pytest.approx(1.5**2 + 1 / 12, rel=0.1)
    assert noise_by_level(even[:5, :5], even[:5, :5]) == (0.0, 0.0)
    assert noise_by_level(0 * even, even) == (0.0, 0.0)
    assert noise_by_level(even[:, :2], even[:, :2]) == (0.0, 0.0)


def test_half_of_the_squares_is_what_a_normal_distribution_has():
    middle = np.sqrt(chi2.median(1))
    assert pytest.approx(truncnorm.var(-middle, middle), rel=1e-4) == HALF_OF_SQUARES


def shot(level, fixed=0.0, per_unit=1.0, seed=0):
    """Noise about a level, of which the variance is a line in it."""
    rng = np.random.default_rng(seed)
    return (np.sqrt(fixed + per_unit * level) * rng.standard_normal(level.shape)).astype(np.float32)


def steps(*heights, side=100):
    """Stripes of even level, one below the other."""
    return np.repeat(np.float32(heights), side * side).reshape(-1, side)


@pytest.mark.parametrize("fixed", [0.0, 20.0, 500.0])
def test_growth_is_the_chord_of_the_standard_deviation(fixed):
    level = steps(100, 250, 400)
    slope, most = growth_by_level([(shot(level, fixed), level)], 100.0)
    true = np.sqrt((fixed + 400) / (fixed + 100)) - 1
    assert 1 + most == pytest.approx(1 + true, rel=0.03)
    assert slope == pytest.approx(most / 300, rel=1e-6)


def test_growth_in_parts_is_that_of_the_whole_and_scales():
    level = steps(100, 250, 400)
    rest = shot(level)
    whole = growth_by_level([(rest, level)], 100.0)
    assert growth_by_level([(rest[:150], level[:150]), (rest[150:], level[150:])], 100.0) == pytest.approx(
        whole, rel=1e-6
    )
    slope, most = growth_by_level([(8 * rest, 8 * level)], 800.0)
    assert (8 * slope, most) == pytest.approx(whole, rel=1e-6)


def test_even_noise_a_dark_scene_and_next_to_nothing_do_not_grow():
    level = steps(100, 400)
    rest = shot(np.full_like(level, 100))
    slope, most = growth_by_level([(rest, level)], 100.0)
    assert most < 0.05
    assert slope * 300 == pytest.approx(most)
    assert growth_by_level([(rest, level)], 500.0) == (0.0, 0.0)  # nothing is brighter than the water
    assert growth_by_level([(shot(level), level)], -1.0) == (0.0, 0.0)  # a line through noise says nothing below 0
    assert growth_by_level([(0 * rest, level)], 100.0) == (0.0, 0.0)
    assert growth_by_level([(rest[:3, :3], level[:3, :3])], 100.0) == (0.0, 0.0)
    assert growth_by_level([(np.full_like(rest, np.nan), level)], 100.0) == (0.0, 0.0)


def test_beyond_the_levels_that_were_seen_nothing_is_claimed():
    """Ten pixels as bright as a ship do not stretch it."""
    level = steps(100, 400)
    level[50, 50:60] = 40_000
    _, most = growth_by_level([(shot(level), level)], 100.0)
    assert most == pytest.approx(1.0, rel=0.06)
