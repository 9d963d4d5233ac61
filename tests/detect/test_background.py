"""Backgrounds: covariance rules against scikit-learn and closed forms, tiles against the whole, saving and reading."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from deglint.errors import FitError, InputError
from detect import covariance
from detect.background import COVARIANCES, RIDGE, Background, Part, fit, sample_share

from ..common import image_of


def flat(image):
    return image.reshape(len(image), -1).T


def standard(x):
    return (x - x.mean(axis=0)) / x.std(axis=0)


@pytest.mark.parametrize("offset", [0.0, 1e8])
def test_empirical_is_mean_and_covariance(offset):
    image = image_of(4, 60, offset=offset)
    found = fit(image)
    exact = flat(image).astype(np.longdouble)
    exact = exact - exact.mean(axis=0)
    np.testing.assert_allclose(found.covariance, (exact.T @ exact / (len(exact) - 1)).astype(float), rtol=1e-13)
    assert (found.n, found.rank, found.bands) == (3000, 4, 4)


def test_ledoit_wolf_is_sklearns_on_standardised_bands():
    from sklearn.covariance import LedoitWolf

    image = image_of(4, 6, 5, offset=0) * np.array([1, 10, 1e3, 1e-4])[:, None, None] + 5
    oracle = LedoitWolf(assume_centered=True).fit(standard(flat(image)))
    found = fit(image, covariance="ledoit-wolf")
    assert 0 < found.shrinkage < 1
    assert found.shrinkage == pytest.approx(oracle.shrinkage_, rel=1e-12)
    scale = flat(image).std(axis=0, ddof=1)
    np.testing.assert_allclose(found.covariance / np.outer(scale, scale), oracle.covariance_, rtol=1e-12)


def test_oas_is_sklearns_on_standardised_bands():
    from sklearn.covariance import OAS

    image = image_of(4, 6, 5, offset=0)
    oracle = OAS(assume_centered=True).fit(standard(flat(image)))
    assert fit(image, covariance="oas").shrinkage == pytest.approx(oracle.shrinkage_, rel=1e-12)


def test_ridge_is_a_share_of_each_bands_variance():
    image = image_of(4)
    found, plain = fit(image, covariance="ridge", ridge=0.5).covariance, fit(image).covariance
    np.testing.assert_allclose(found - plain, np.diag(0.5 * np.diag(plain)), atol=1e-15)


def test_robust_is_not_moved_by_a_fifth_of_anything():
    clean = image_of(4, 100, 100, seed=1, offset=0)
    spoilt = clean.copy()
    spoilt[:, :20] = 50 + np.random.default_rng(2).normal(size=(4, 20, 100))
    found, truth = fit(spoilt, covariance="mcd"), fit(clean[:, 20:])
    scale = np.sqrt(np.diag(truth.covariance))
    np.testing.assert_allclose(found.mean / scale, truth.mean / scale, atol=0.03)
    # where every odd pixel lies far out, none of the clean ones is trimmed, and the factor for it is the error
    factor = 0.975 / chi2.cdf(chi2.ppf(0.975, 4), 6)
    ratio = (found.covariance - truth.covariance) / np.outer(scale, scale)
    assert np.abs(ratio).max() < factor - 1 + 0.02


def test_robust_core_is_no_larger_than_sklearns():
    """The determinant of the core's covariance is what the estimator minimises."""
    from sklearn.covariance import fast_mcd

    rng = np.random.default_rng(3)
    x = np.vstack([rng.normal(size=(160, 3)), rng.normal(8, 0.5, size=(40, 3))])
    _, theirs, _, _ = fast_mcd(x, support_fraction=0.75, random_state=0)
    scaled = (x - np.median(x, axis=0)) / (1.4826 * np.median(np.abs(x - np.median(x, axis=0)), axis=0))
    cores = [covariance._concentrate(scaled, 150, *s) for s in covariance._starts(scaled, 150)]
    spread = 1.4826 * np.median(np.abs(x - np.median(x, axis=0)), axis=0)
    _, ours, _ = min(cores, key=lambda c: c[2])
    ours = ours * np.outer(spread, spread) * 149 / 150
    assert np.linalg.det(ours) <= np.linalg.det(theirs) * (1 + 1e-9)


def test_robust_of_a_normal_background_is_its_covariance():
    """The factors that make up for the trimming."""
    image = np.random.default_rng(5).normal(size=(3, 300, 300))
    np.testing.assert_allclose(fit(image, covariance="mcd").covariance, np.eye(3), atol=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("rule", COVARIANCES)
@given(rows=st.integers(1, 4), columns=st.integers(1, 4), holes=st.booleans())
@settings(max_examples=6)
def test_tiles_are_the_whole_to_the_bit(rule, rows, columns, holes):
    image = image_of(bands=3, rows=150, columns=200).astype(np.float32)
    mask = np.random.default_rng(4).random(image.shape[1:]) < 0.6 if holes else None
    if holes:
        image[1, 40:50] = np.nan
    whole = fit(image, mask=mask, covariance=rule)
    share, down, across = sample_share(rule, 150 * 200), 64 * rows, 64 * columns

    def piece(r, c):
        at = (slice(r, r + down), slice(c, c + across))
        return Part.of(image[(slice(None), *at)], None if mask is None else mask[at], (r, c), share)

    lines = [Part.merge([piece(r, c) for c in range(0, 200, across)]) for r in range(0, 150, down)]
    tiled = Part.merge(lines).background(rule, RIDGE)
    np.testing.assert_array_equal(tiled.covariance, whole.covariance)
    np.testing.assert_array_equal(tiled.mean, whole.mean)
    assert (tiled.n, tiled.shrinkage) == (whole.n, whole.shrinkage)


def test_masked_is_removed():
    image = image_of(4)
    mask = np.ones(image.shape[1:], bool)
    mask[10:] = False
    removed = fit(image[:, :10]).covariance
    np.testing.assert_allclose(fit(np.where(mask, image, 1e30), mask=mask).covariance, removed, rtol=1e-13)
    np.testing.assert_allclose(fit(np.where(mask, image, np.nan)).covariance, removed, rtol=1e-13)


@pytest.mark.parametrize("rule", COVARIANCES)
def test_constant_and_collinear_bands_are_told(rule):
    image = image_of(bands=3)
    image = np.concatenate([image, np.full((1, 40, 50), 7.0), image[:1]])
    found = fit(image, covariance=rule)
    assert found.rank == (3 if rule in ("empirical", "mcd") else 4)
    whiten = covariance.whitener(found.covariance)
    assert (whiten[:, 3] == 0).all()


@pytest.mark.parametrize("rule", COVARIANCES)
def test_saved_and_read_is_the_same(rule):
    found = fit(image_of(4), covariance=rule, names=("a", "b", "c", "d"))
    again = Background.from_json(found.to_json())
    np.testing.assert_array_equal(again.covariance, found.covariance)
    np.testing.assert_array_equal(again.mean + again.rest, found.mean + found.rest)
    assert (again.n, again.rule, again.shrinkage, again.names) == (found.n, rule, found.shrinkage, found.names)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"background": 2}', '{"background": 1, "mean": [1]}', "[" * 100_000],
    ids=["empty", "list", "nothing", "format", "mean", "nested"],
)  # fmt: skip
def test_what_is_no_background_is_refused(text):
    with pytest.raises(InputError, match="not a saved background"):
        Background.from_json(text)


def test_damaged_numbers_are_refused():
    numbers = fit(image_of(4)).numbers()
    for name, value in (("covariance", [[1.0]]), ("mean", [np.nan] * 4), ("names", ["a"]),
                        ("rest", [np.nan] * 4), ("n", np.inf)):  # fmt: skip
        with pytest.raises(InputError, match="not a saved background"):
            Background.from_json(json.dumps(numbers | {name: value}))


def test_a_background_that_cannot_be_fitted_is_refused():
    image = image_of(4)
    with pytest.raises(FitError, match="0 valid pixels"):
        fit(np.full((2, 4, 4), np.nan))
    with pytest.raises(FitError, match="1 valid pixel,"):
        fit(np.ones((2, 1, 1)))
    with pytest.raises(InputError, match="not one of empirical"):
        fit(image, covariance="nonsense")
    with pytest.raises(InputError, match="ridge"):
        fit(image, covariance="ridge", ridge=-1)
    with pytest.raises(InputError, match="mask has shape"):
        fit(image, mask=np.ones((2, 2), bool))
    for wrong in (np.ones((3, 3)), np.ones((0, 3, 3)), np.ones((1, 2, 2), complex)):
        with pytest.raises(InputError, match="expected"):
            fit(wrong)


def test_integers_are_taken_as_they_are():
    image = np.random.default_rng(0).integers(0, 4000, (3, 80, 70)).astype(np.uint16)
    np.testing.assert_array_equal(fit(image).covariance, fit(image.astype(np.float64)).covariance)
