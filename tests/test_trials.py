"""Trials: what is laid where, noise as it grows with the level, and what a second trial says of the first."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deglint.compensate._variances import weighted_line
from deglint.compensate.trials import Sea, Trial, growth, own, shared


def sea(seed=0, shape=(2, 7, 9), usable=0.8):
    rng = np.random.default_rng(seed)
    level = rng.uniform(5, 15, shape).astype(np.float32)
    values = level + rng.standard_normal(shape).astype(np.float32)
    return Sea(values, level, rng.random(shape) < 0.3, rng.random(shape[1:]) < usable)


@given(st.integers(0, 30), st.integers(-9, 9), st.integers(-9, 9))
def test_sparkle_is_laid_as_it_is_and_noise_as_large_as_it_is_there(seed, down, right):
    """Against a loop over pixels."""
    here = sea(seed)
    scale = np.random.default_rng(seed + 100).uniform(0.5, 2, here.values.shape).astype(np.float32)
    scale[0, 2, 3] = 0
    found = here.laid(scale, (down, right))
    _, rows, columns = here.values.shape
    for b, r, c in np.ndindex(here.values.shape):
        if not here.usable[r, c]:
            assert found[b, r, c] == here.values[b, r, c]
            continue
        y, x = (r - down) % rows, (c - right) % columns
        rest = float(here.values[b, y, x]) - float(here.level[b, y, x]) if here.usable[y, x] else 0.0
        if not here.replaced[b, y, x] and scale[b, y, x] > 0:
            rest *= float(scale[b, r, c]) / float(scale[b, y, x])
        assert found[b, r, c] == pytest.approx(float(here.level[b, r, c]) + rest, abs=1e-4)


@given(st.integers(0, 30))
def test_a_steady_level_holds_what_is_neither_noise_nor_sparkle(seed):
    """Against a loop over pixels."""
    here = sea(seed)
    scale = np.random.default_rng(seed + 100).uniform(0, 0.5, here.values.shape).astype(np.float32)
    scale[0, 2, 3] = 0
    found = here.steady(scale)
    for b, r, c in np.ndindex(here.values.shape):
        far = abs(float(here.values[b, r, c]) - float(here.level[b, r, c])) > 4 * float(scale[b, r, c]) > 0
        own_level = far and here.usable[r, c] and not here.replaced[b, r, c]
        assert found.level[b, r, c] == (here.values if own_level else here.level)[b, r, c]
    assert found.values is here.values
    assert found.replaced is here.replaced


def test_laid_nowhere_else_it_is_the_sea_itself():
    here = sea()
    np.testing.assert_allclose(here.laid(here.noise(), (0, 0)), here.values, rtol=1e-6)


def trial(error, replaced=None):
    error = np.asarray(error, np.float32)
    where = np.ones(error.shape[1:], np.bool_)
    return Trial(error, np.ones(error.shape, np.bool_) if replaced is None else replaced, where, error, error)


def test_moments_and_what_a_second_trial_says():
    """Variances 4 and 9 in the first, 1 and 4 in the second, about any mean: 3 is the root of 4 times 9/4."""
    rng = np.random.default_rng(5)
    draws = rng.standard_normal((2, 100, 90))
    draws = (draws - draws.mean(axis=(1, 2), keepdims=True)) / draws.std(axis=(1, 2), keepdims=True)
    first = trial(draws * np.array([2.0, 3.0])[:, None, None] + 7)
    second = trial(draws * np.array([1.0, 2.0])[:, None, None] - 3)
    assert growth(first.moments(), second.moments()) == pytest.approx(3.0, rel=1e-4)
    assert growth(second.moments(), first.moments()) == 1.0
    nothing = trial(draws, np.zeros(draws.shape, np.bool_)).moments()
    assert growth(nothing, nothing) == 1.0
    gap = draws.copy()
    gap[0, :50] = np.nan
    np.testing.assert_array_equal(trial(gap).moments()[:, 0], [50 * 90, 100 * 90])


@given(st.floats(0, 10), st.floats(0, 5))
def test_a_line_through_variances_is_found(fixed, growing):
    place = np.linspace(1, 20, 24)
    found = weighted_line(place, fixed + growing * place, np.full(24, 500.0))
    assert found == (pytest.approx(fixed, abs=1e-6), pytest.approx(growing, abs=1e-6))


@given(st.integers(0, 30))
def test_what_neighbours_share(seed):
    """Against a loop over pairs."""
    rng = np.random.default_rng(seed)
    away, clean = rng.standard_normal((6, 8)) + 3, rng.random((6, 8)) < 0.7
    mean = away[clean].mean()
    pairs = [((r, c), (r + 1, c)) for r in range(5) for c in range(8)]
    pairs += [((r, c), (r, c + 1)) for r in range(6) for c in range(7)]
    both = [(away[p] - mean) * (away[q] - mean) for p, q in pairs if clean[p] and clean[q]]
    assert tuple(shared(away, clean)) == (pytest.approx(sum(both)), len(both))
    assert tuple(shared(away, np.zeros_like(clean))) == (0, 0)


def test_the_waters_own_texture_is_told_from_noise_and_from_errors_of_the_level():
    """A texture of a known covariance; a level that errs, and in the trial errs once more alike."""
    rng = np.random.default_rng(6)

    def smooth(height):
        rough = rng.standard_normal((402, 402))
        return height * (rough[1:-1, 1:-1] + rough[:-2, 1:-1] + rough[1:-1, :-2] + rough[:-2, :-2]) / 2

    everywhere = np.ones((400, 400), np.bool_)
    texture, once, again = smooth(1.0), smooth(0.6), smooth(0.6)
    away = texture + 3 * rng.standard_normal((400, 400)) + once
    found = own(shared(away, everywhere), shared(away + again, everywhere))
    assert found == pytest.approx(0.5 * 1.0**2, abs=0.1)  # neighbours share half of the variance of such a texture
    noise = 3 * rng.standard_normal((400, 400))
    assert own(shared(noise, everywhere), shared(noise + again, everywhere)) == pytest.approx(0.0, abs=0.05)
