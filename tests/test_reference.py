"""The NIR that removal follows: brute force, tiles, and ships of real scenes."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint.compensate.reference import LEAST_WATER, ReferenceRule, fit_reference, reference
from deglint.errors import FitError, InputError

REAL = Path(__file__).resolve().parents[2] / "shared" / "data" / "sentinel2"


def brute_force(nir, water, rule):
    """Pixel by pixel, sums of float64 by hand."""
    rows, columns = nir.shape
    h, kept = rule.size // 2, water & np.isfinite(nir)
    for _ in range(2):
        stands, means = np.zeros(nir.shape, bool), np.zeros(nir.shape)
        for r in range(rows):
            for c in range(columns):
                square = slice(max(r - h, 0), r + h + 1), slice(max(c - h, 0), c + h + 1)
                around = nir[square][kept[square]]
                if np.isfinite(nir[r, c]) and around.size >= LEAST_WATER:
                    means[r, c] = np.mean(around, dtype=np.float64)
                    stands[r, c] = nir[r, c] > means[r, c] + rule.limit
        kept = kept & ~stands
    return np.where(stands, means, nir)


@settings(max_examples=15)
@given(st.integers(0, 10_000), st.sampled_from([3, 5, 15]))
def test_it_is_the_mean_of_the_water_around_where_something_stands_out(seed, size):
    rng = np.random.default_rng(seed)
    nir = rng.gamma(2.0, 10.0, (20, 23))
    nir[rng.random(nir.shape) < 0.05] += 300.0
    nir[rng.random(nir.shape) < 0.05] = np.nan
    water = rng.random(nir.shape) < 0.8
    rule = ReferenceRule(limit=100.0, deviation=12.5, pixels=100, size=size)
    out, wanted = reference(nir, water, rule), brute_force(nir, water, rule)
    assert np.array_equal(np.isnan(out), np.isnan(nir))
    assert out == pytest.approx(wanted, rel=1e-12, nan_ok=True)
    same = wanted == nir
    assert np.array_equal(out[same], nir[same])


@settings(max_examples=15)
@given(st.integers(1, 59), st.integers(1, 69))
def test_tiles_are_the_whole(row, column):
    rng = np.random.default_rng(5)
    nir = rng.gamma(2.0, 10.0, (60, 70)).astype(np.float32)
    nir[rng.random(nir.shape) < 0.02] += 400.0
    water = rng.random(nir.shape) < 0.9
    rule = ReferenceRule(limit=100.0, deviation=12.5, pixels=100)
    whole, h = reference(nir, water, rule), rule.halo
    for top, bottom in ((0, row), (row, 60)):
        for left, right in ((0, column), (column, 70)):
            a, b = max(top - h, 0), max(left - h, 0)
            window = slice(a, bottom + h), slice(b, right + h)
            part = reference(nir[window], water[window], rule)
            inside = part[top - a : bottom - a, left - b : right - b]
            assert np.array_equal(inside, whole[top:bottom, left:right])


def test_the_limit_is_that_of_deep_water():
    rng = np.random.default_rng(6)
    nir = 100.0 + 3.0 * rng.standard_normal((200, 200)) + np.linspace(0, 50, 200)
    rule = fit_reference([(nir, np.ones(nir.shape, bool))])
    assert rule.deviation == pytest.approx(3.0, rel=0.05)  # the slow rise does not count
    assert rule.limit == 8 * rule.deviation
    assert rule.halo == 14
    assert np.array_equal(reference(nir, np.ones(nir.shape, bool), rule), nir)


def test_a_ship_gets_the_nir_of_the_sea_and_integers_stay_integers():
    rng = np.random.default_rng(7)
    nir = rng.integers(90, 111, (60, 60)).astype(np.uint16)
    deep = np.ones(nir.shape, bool)
    rule = fit_reference([(nir, deep)])
    nir[20:24, 20:32] = 5000
    nir[40, 40] = 0
    out = reference(nir, deep, rule)
    assert out.dtype == nir.dtype
    assert abs(out[20:24, 20:32].astype(int) - 100).max() <= 3
    outside = np.ones(nir.shape, bool)
    outside[20:24, 20:32] = False
    assert np.array_equal(out[outside], nir[outside])
    as_float = reference(nir.astype(np.float32), deep, rule)
    assert np.array_equal(np.rint(as_float), out)


def test_without_water_or_pixels_nothing_changes():
    nir = np.full((9, 9), 7.0)
    nir[4, 4] = 900.0
    rule = ReferenceRule(limit=1.0, deviation=0.1, pixels=64)
    assert np.array_equal(reference(nir, np.zeros(nir.shape, bool), rule), nir)
    assert np.isnan(reference(np.full((1, 1), np.nan), np.ones((1, 1), bool), rule)).all()
    assert reference(np.ones((1, 1)), np.ones((1, 1), bool), rule) == 1.0
    far = 1e8 + nir
    assert reference(far, nir < 10, rule)[4, 4] == pytest.approx(1e8 + 7)


def test_what_cannot_be_used_is_refused():
    nir, deep = np.ones((20, 20)), np.ones((20, 20), bool)
    with pytest.raises(FitError, match="0 pixels"):
        fit_reference([(nir, ~deep)])
    with pytest.raises(InputError, match="odd"):
        fit_reference([(nir, deep)], size=4)
    with pytest.raises(InputError, match="above 0"):
        fit_reference([(nir, deep)], deviations=0)
    with pytest.raises(InputError, match="alike"):
        reference(nir, deep[:5], ReferenceRule(limit=1.0, deviation=0.1, pixels=64))


@pytest.mark.shared
@pytest.mark.skipif(not REAL.exists(), reason="the real scenes do not lie beside the project")
@pytest.mark.parametrize("name", ["casablanca", "honolulu"])
def test_ships_of_real_scenes_keep_their_contrast(name):
    from benchmarks.harbours import RECIPES, kept

    plain, found = (kept(REAL, name, recipe) for recipe in RECIPES.values())
    assert len(found.shares) >= 10
    assert (np.median(found.shares, axis=0) >= 0.95).all()
    assert ((found.shares >= 0.8).mean(axis=0) >= 0.9).all()
    assert (found.noise <= 1.01 * plain.noise).all()
