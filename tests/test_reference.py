"""References with ships, surf and land replaced: the same in tiles as in the whole."""

from dataclasses import replace

import numpy as np
import pytest

from deglint.remove.reference import ReferenceRule, clean, fit_reference

SHIP = np.s_[60:64, 40:52]


@pytest.fixture
def nir_with_ship():
    """Glint with a ship; at the right darker water, with a target fainter than anything bright at the left."""
    rng = np.random.default_rng(1)
    values = (40 + rng.gamma(2.0, 3.0, (160, 220))).astype(np.float32)
    values[:, 140:] = rng.normal(10, 0.1, (160, 80))
    values[30:33, 180:183] = 107  # between the least value and the least local mean of the sample, plus the limit
    values[SHIP] += 300
    return values


def rule_of(nir_with_ship):
    sample = np.zeros(nir_with_ship.shape, bool)
    sample[100:, :128] = True
    return fit_reference([(nir_with_ship, sample)], 3)


def test_ships_take_the_mean_of_the_water_around(nir_with_ship):
    cleaned, exceeds = clean(nir_with_ship, np.ones(nir_with_ship.shape, bool), rule_of(nir_with_ship))
    assert exceeds[SHIP].all()
    assert cleaned[SHIP] == pytest.approx(46, abs=3)
    np.testing.assert_array_equal(cleaned[~exceeds], nir_with_ship[~exceeds])


@pytest.mark.parametrize("noise", [0.0, 2.0])
@pytest.mark.parametrize("land", [False, True])
def test_tiles_are_the_whole_to_the_bit(nir_with_ship, land, noise):
    """A ship in one tile changes nothing in another, where darker water holds what is fainter than any sample."""
    rule, water = replace(rule_of(nir_with_ship), noise=noise), np.ones(nir_with_ship.shape, bool)
    if land:
        water[:20, :60] = False
    whole, _ = clean(nir_with_ship, water, rule)
    for columns in (slice(0, 110), slice(110, 220)):
        low, high = max(columns.start - rule.halo, 0), columns.stop + rule.halo
        part, _ = clean(nir_with_ship[:, low:high], water[:, low:high], rule)
        np.testing.assert_array_equal(part[:, columns.start - low :][:, :110], whole[:, columns])


def test_noise_is_averaged_where_there_is_no_more_and_glint_stays():
    rng = np.random.default_rng(2)
    calm = rng.normal(50, 2, (120, 120)).astype(np.float32)
    calm[60:63, 60:63] += 100
    every = np.ones(calm.shape, bool)
    rule = fit_reference([(calm, every)], 3, sparkle=True, smooth=True)
    assert rule.noise == pytest.approx(2, rel=0.05)
    cleaned, _ = clean(calm, every, replace(rule, limit=np.inf))
    assert cleaned[:50].std() < 0.4 * 2
    assert abs(cleaned - calm)[60:63, 60:63].max() < 2


def test_nothing_is_copied_where_nothing_exceeds():
    values = np.full((40, 40), 5, np.float32)
    cleaned, exceeds = clean(values, np.ones(values.shape, bool), ReferenceRule(0, 10.0, 1.0, 0.0, 1e-3))
    assert cleaned is values
    assert exceeds is None


@pytest.mark.parametrize("sparkle", [False, True])
def test_too_few_pixels_for_a_local_mean_set_no_limit(sparkle):
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    assert fit_reference([(values, np.ones(values.shape, bool))], 3, sparkle=sparkle).limit == np.inf
