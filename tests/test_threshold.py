"""Thresholds: published quantiles, scipy's own distributions and fits, simulations; tails merged in any order."""

import re

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from deglint.errors import FitError, InputError
from detect.threshold import Tail, fit_pareto, from_chi2, from_f, from_gpd, from_quantile, from_tail, p_value


@pytest.mark.parametrize(
    ("pfa", "bands", "printed"),
    [(0.05, 1, 3.841), (0.01, 4, 13.277), (0.001, 8, 26.124), (0.001, 10, 29.588), (0.01, 100, 135.807)],
)
def test_chi2_is_that_of_the_printed_tables(pfa, bands, printed):
    """NIST/SEMATECH e-Handbook, table of upper critical values of chi-square (sec. 1.3.6.7.4)."""
    assert round(from_chi2(pfa, bands).value, 3) == printed


@pytest.mark.parametrize("bands", [1, 4, 8, 200])
@pytest.mark.parametrize("pfa", [0.3, 1e-3, 1e-9, 1e-15])
def test_quantiles_and_p_values_agree_with_mpmath(pfa, bands):
    """Probabilities beyond the quantiles, in 40 digits (scipy.stats.f.isf is off by 1e-5 at 1e-15)."""
    n = 400
    chi2, f = from_chi2(pfa, bands), from_f(pfa, bands, n)
    with mpmath.workdps(40):
        half, rest = mpmath.mpf(bands) / 2, mpmath.mpf(n - bands) / 2
        beyond = mpmath.gammainc(half, mpmath.mpf(chi2.value) / 2, regularized=True)
        assert float(beyond / pfa - 1) == pytest.approx(0, abs=1e-11)
        w = mpmath.mpf(f.value) * n / (n * n - 1)
        beyond = mpmath.betainc(rest, half, 0, 1 / (1 + w), regularized=True)
        assert float(beyond / pfa - 1) == pytest.approx(0, abs=1e-10)
    np.testing.assert_allclose(p_value([chi2.value], bands), [pfa], rtol=1e-11)
    np.testing.assert_allclose(p_value([f.value], bands, n), [pfa], rtol=1e-10)
    assert chi2.value < f.value


def test_masked_scores_do_not_count():
    scores = np.ma.masked_greater(np.concatenate([np.arange(1000.0), np.full(50, 1e6)]), 1e5)
    found = from_quantile(scores, 0.01)
    assert (found.value, found.n) == (989, 1000)


def test_f_becomes_chi2_as_the_statistics_become_sure():
    assert from_f(1e-4, 8, 10**9).value == pytest.approx(from_chi2(1e-4, 8).value, rel=1e-7)


def test_f_holds_its_rate_where_chi2_does_not():
    """New Gaussian pixels against statistics of 30 others: F has the requested rate, chi-squared three times that."""
    rng = np.random.default_rng(1)
    bands, n, trials, each = 5, 30, 4000, 10
    background = rng.normal(size=(trials, n, bands))
    mean = background.mean(axis=1, keepdims=True)
    covariance = np.einsum("tni,tnj->tij", background - mean, background - mean) / (n - 1)
    new = rng.normal(size=(trials, each, bands)) - mean
    distance = np.einsum("tni,tni->tn", new, np.linalg.solve(covariance, new.transpose(0, 2, 1)).transpose(0, 2, 1))
    rate = (distance > from_f(0.01, bands, n).value).mean()
    assert rate == pytest.approx(0.01, abs=0.0015)
    assert (distance > from_chi2(0.01, bands).value).mean() > 0.025
    assert np.mean(p_value(distance, bands, n)) == pytest.approx(0.5, abs=0.01)


def test_p_values_keep_shape_and_nan():
    scores = np.array([[0.0, 3.0], [np.nan, 1e6]], np.float32)
    p = p_value(scores, 3)
    assert p.shape == (2, 2)
    assert p[0, 0] == 1
    assert np.isnan(p[1, 0])
    assert p[1, 1] == 0


@given(st.lists(st.integers(-5, 30), min_size=2, max_size=300), st.floats(0.01, 0.9))
def test_quantile_is_the_least_score_that_few_enough_exceed(values, pfa):
    scores = np.array(values, np.float32)
    allowed = int(np.floor(pfa * len(values) * (1 + 1e-12)))
    if allowed < 1:
        with pytest.raises(InputError, match="less than one"):
            from_quantile(scores, pfa)
        return
    found = from_quantile(scores, pfa)
    assert (scores > found.value).sum() <= allowed
    assert found.pfa_observed == (scores > found.value).mean()
    lower = scores[scores < found.value]
    assert lower.size == 0 or (scores > lower.max()).sum() > allowed


def test_quantile_leaves_nan_out():
    scores = np.concatenate([np.arange(1000.0), np.full(5000, np.nan)]).reshape(60, 100)
    found = from_quantile(scores, 0.01)
    assert (found.value, found.n, found.pfa_observed) == (989.0, 1000, 0.01)


@given(st.integers(1, 50), st.integers(1, 6), st.randoms(use_true_random=False))
def test_tails_merge_to_the_same_bits_in_any_order(keep, cuts, random):
    rng = np.random.default_rng(keep)
    scores = rng.integers(0, 40, 300).astype(np.float32)
    scores[::17] = np.nan
    parts = [Tail.of(p, keep) for p in np.array_split(scores, cuts)]
    random.shuffle(parts)
    merged, whole = Tail.merge(parts), Tail.of(scores, keep)
    assert merged.n == whole.n == np.isfinite(scores).sum()
    np.testing.assert_array_equal(merged.values, whole.values)
    np.testing.assert_array_equal(whole.values, np.sort(scores[np.isfinite(scores)])[::-1][:keep])
    for value in (0.0, 20.0, 38.5, 50.0):
        assert whole.above(value) == (int((scores > value).sum()) if value >= whole.values[-1] else None)
    assert whole.above(float(whole.values[-1])) == (scores > whole.values[-1]).sum()


def test_thresholds_from_tiles_are_those_of_the_whole():
    rng = np.random.default_rng(3)
    scores = rng.chisquare(8, (400, 500)).astype(np.float32)
    tiles = Tail.merge([Tail.of(scores[r : r + 128], 5000) for r in range(0, 400, 128)])
    for find in (from_quantile, from_gpd):
        a, b = find(scores, 1e-3), find(tiles, 1e-3)
        assert (a.value, a.pfa_observed, a.standard_error) == (b.value, b.pfa_observed, b.standard_error)


@pytest.mark.parametrize("shape", [-0.3, -0.1, 0.0, 0.2, 0.8])
def test_pareto_fit_is_that_of_scipy(shape):
    sample = np.sort(stats.genpareto.rvs(shape, scale=3.0, size=3000, random_state=7))
    found, scale = fit_pareto(sample)
    theirs = stats.genpareto.fit(sample, floc=0)
    mine = stats.genpareto.logpdf(sample, found, 0, scale).sum()
    assert mine >= stats.genpareto.logpdf(sample, *theirs).sum() - 1e-4
    assert found == pytest.approx(theirs[0], abs=2e-4)
    assert scale == pytest.approx(theirs[2], rel=3e-4)
    assert found == pytest.approx(shape, abs=4 * (1 + shape) / np.sqrt(3000))


def test_gpd_reaches_beyond_the_last_pixel_and_its_error_is_honest():
    """Exponential scores: the threshold for Pfa p is -log(p) exactly; z-scores of 200 fits are standard normal."""
    rng = np.random.default_rng(11)
    pfa, truth = 1e-6, -np.log(1e-6)
    found = [from_gpd(rng.exponential(size=100_000), pfa) for _ in range(200)]
    z = np.array([(f.value - truth) / f.standard_error for f in found])
    assert 0.8 < z.std() < 1.25
    assert abs(np.median(z)) < 0.3
    assert all(f.numbers["kolmogorov"] < 0.06 for f in found)


def test_gpd_of_chi2_scores_comes_near_the_law():
    scores = np.random.default_rng(5).chisquare(8, 1_000_000).astype(np.float32)
    for pfa in (1e-3, 1e-5):
        found, exact = from_gpd(scores, pfa), from_chi2(pfa, 8).value
        assert found.value == pytest.approx(exact, abs=max(4 * found.standard_error, 0.01 * exact))
        assert found.pfa_observed == np.mean(scores > found.value)


def test_a_threshold_says_both_rates():
    line = str(from_quantile(np.arange(10_000.0), 1e-2))
    assert "Pfa requested 0.01, observed 0.01" in line
    assert "not measured" in str(from_chi2(1e-3, 8))
    assert "observed 0.02" in str(from_chi2(1e-3, 8).measured(20, 1000))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: from_chi2(0, 8), "pfa: allowed is above 0 and below 1"),
        (lambda: from_chi2(float("nan"), 8), "pfa: allowed"),
        (lambda: from_chi2(0.1, 0), "bands: allowed is 1 or more"),
        (lambda: from_f(0.1, 8, 8), "n: allowed is more than the 8 bands"),
        (lambda: from_quantile(np.full(9, np.nan), 0.1), "no valid pixel"),
        (lambda: from_quantile(np.arange(9.0), 0.1), "less than one"),
        (lambda: from_quantile(np.array([1.0, np.inf]), 0.5), "infinity"),
        (lambda: from_quantile(Tail.of(np.arange(900.0), 10), 0.1), "the tail keeps 10"),
        (lambda: from_gpd(np.ones(5000), 1e-5), "too few different"),
        (lambda: from_gpd(np.arange(20.0), 1e-5), "too few different"),
        (lambda: from_gpd(np.arange(5000.0), 1e-5), "ends abruptly"),
        (lambda: from_gpd(np.random.default_rng(0).exponential(size=5000), 0.8), "Take a threshold by quantile"),
    ],
)
def test_refusals_are_one_line(call, said):
    with pytest.raises((InputError, FitError), match=said) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_poor_and_heavy_tails_are_said():
    rng = np.random.default_rng(2)
    heavy = from_gpd(rng.pareto(1.0, 50_000), 1e-4)
    assert any("heavy" in note for note in heavy.notes)
    two = np.concatenate([rng.normal(0, 1, 99_000), rng.normal(50, 1, 500)])
    assert any("poor" in note for note in from_gpd(two, 1e-4).notes)


def test_a_tail_that_no_law_fits_gives_its_quantile():
    scores = np.arange(50_000.0)
    found = from_tail(scores, 1e-3)
    assert found.method == "quantile"
    assert "ends abruptly" in found.notes[-1]
    assert found.value == from_quantile(scores, 1e-3).value


def test_a_threshold_beyond_double_precision_is_no_fit():
    scores = np.random.default_rng(0).pareto(0.7, 5000)
    with pytest.raises(FitError, match="beyond double precision"):
        from_gpd(scores, 1e-300)
    huge = np.random.default_rng(0).chisquare(4, 5000)
    huge[0] = 1e300
    assert from_tail(huge, 0.01).method == "quantile"


@pytest.mark.parametrize("n", [100, 225, 227, 1000, 4999])
def test_the_rate_that_a_refusal_names_is_allowed(n):
    scores = np.arange(n)
    with pytest.raises(InputError, match="less than one") as refused:
        from_quantile(scores, 0.9 / n)
    assert from_quantile(scores, float(re.search("Give (.*?) or", str(refused.value))[1])).n == n
