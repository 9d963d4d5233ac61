"""Multiband removal against numpy's least squares and scikit-learn's ridge, and against Hedley with one reference."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint import remove
from deglint.errors import FitError
from deglint.remove import METHODS, gather, merge
from deglint.remove.model import GlintIndex
from deglint.remove.multiband import REFERENCE_RIDGE, references
from deglint.remove.request import FitRequest
from deglint.scene import Band

WAVELENGTHS = (480.0, 560.0, 660.0, 725.0, 832.5, 950.0)
BANDS = tuple(Band(f"L{w:g}", w) for w in WAVELENGTHS)
NIR = 4
SLOPES = np.array([1.1, 1.0, 0.9, 0.85, 0.8, 0.7])
WATER = np.array([90.0, 70.0, 40.0, 20.0, 10.0, 8.0])


def linear_glint(noise=0.5, shape=(60, 70), seed=0):
    rng = np.random.default_rng(seed)
    glint = rng.gamma(0.5, 30.0, shape)
    glint[:3] = 0
    return WATER[:, None, None] + SLOPES[:, None, None] * glint + noise * rng.standard_normal((6, *shape))


def fitted(block, bands=BANDS, nir=NIR, **options):
    return remove.fit("multiband", block, nir=nir, bands=bands, **options)


def request(bands, nir):
    index = GlintIndex((nir,), (1.0,))
    return FitRequest(tuple(bands), (0,), (index,), (0,))


def test_references_are_the_longer_bands_from_640_nm_on():
    asked = request(BANDS, 5)
    assert [references(asked, b) for b in range(5)] == [(2, 3, 4, 5), (2, 3, 4, 5), (3, 4, 5), (4, 5), (5,)]
    assert references(request((*BANDS, Band("SWIR", 1600.0)), 4), 0) == (2, 3, 4, 5)
    assert references(request((*BANDS, Band("SWIR", 1600.0)), 6), 0) == (2, 3, 4, 5, 6)
    assert references(request([Band("a"), Band("b"), Band("c")], 2), 0) == (2,)
    assert references(request([Band("640", 640.0), Band("639", 639.0), Band("830", 830.0)], 2), 1) == (0, 2)


@pytest.mark.parametrize("noise", [0.5, 5.0])
def test_weights_are_those_of_ridge_regression(noise):
    from sklearn.linear_model import Ridge

    block = linear_glint(noise)
    model = fitted(block)
    assert len(model.fits) == 4
    for fit in model.fits:
        index = model.indexes[fit.index]
        x = block[list(index.bands)].reshape(len(index.bands), -1)
        y = block[fit.band].ravel()
        x, y = x - x.mean(axis=1, keepdims=True), y - y.mean()
        scale = np.sqrt((x**2).sum(axis=1, keepdims=True))
        theirs = Ridge(alpha=REFERENCE_RIDGE, fit_intercept=False).fit((x / scale).T, y).coef_ / scale[:, 0]
        np.testing.assert_allclose(index.weights, theirs, rtol=1e-8)
        if noise == 5.0:  # the ridge is next to nothing where references are not collinear
            np.testing.assert_allclose(index.weights, np.linalg.lstsq(x.T, y, rcond=None)[0], rtol=0.01, atol=2e-3)
        rest = y - np.array(index.weights) @ x
        assert fit.r2 == pytest.approx(1 - (rest @ rest) / (y @ y), abs=1e-9)
        mixture = np.array(index.weights) @ block[list(index.bands)].reshape(len(index.bands), -1)
        assert index.level == pytest.approx(np.percentile(mixture, 5.0), rel=1e-6)


def test_what_is_left_is_the_band_less_the_mixture_above_its_level():
    block = linear_glint()
    model = fitted(block)
    out = remove.apply(block, model)
    for fit in model.fits:
        index = model.indexes[fit.index]
        mixture = np.tensordot(index.weights, block[list(index.bands)], 1)
        np.testing.assert_allclose(out[fit.band], block[fit.band] - mixture + index.level, rtol=1e-6)
    np.testing.assert_array_equal(out[NIR:], block[NIR:])


def test_exact_on_linear_glint():
    block = linear_glint(noise=0.0)
    model = fitted(block, floor_percentile=1e-9)
    out = remove.apply(block, model)
    assert [f.r2 for f in model.fits] == pytest.approx([1.0] * 4, abs=1e-6)
    # the ridge leaves a ten-thousandth of the glint
    np.testing.assert_allclose(out[:4], np.broadcast_to(WATER[:4, None, None], out[:4].shape), atol=2e-4 * block.max())


def test_one_reference_and_the_lowest_percentile_is_hedley_but_for_the_ridge():
    block = linear_glint()[[0, 1, 4]]
    bands = (BANDS[0], BANDS[1], BANDS[4])
    ours = fitted(block, bands, 2, floor_percentile=1e-9)
    theirs = remove.fit("hedley", block, nir=2, bands=bands)
    for a, b in zip(ours.fits, theirs.fits, strict=True):
        assert ours.indexes[a.index].weights[0] * (1 + REFERENCE_RIDGE) == pytest.approx(b.slope, rel=1e-9)
        assert a.r2 == pytest.approx(b.r2, abs=1e-6)
    np.testing.assert_allclose(
        remove.apply(block, ours), remove.apply(block, theirs), atol=2 * REFERENCE_RIDGE * 1.1 * np.ptp(block[2])
    )


@settings(max_examples=10)
@given(factor=st.floats(1e-6, 1e6))
def test_scaling_and_shifting(factor):
    block = linear_glint()
    plain = remove.apply(block, fitted(block))
    np.testing.assert_allclose(remove.apply(block * factor, fitted(block * factor)), plain * factor, rtol=1e-6)
    np.testing.assert_allclose(remove.apply(block + 1e6, fitted(block + 1e6)) - 1e6, plain, atol=1e-5)


def test_order_of_bands_does_not_matter():
    block, turn = linear_glint(), [3, 5, 0, 4, 1, 2]
    turned = fitted(block[turn], [BANDS[b] for b in turn], turn.index(NIR), correct=[turn.index(b) for b in range(4)])
    found = remove.apply(block[turn], turned)
    np.testing.assert_allclose(found, remove.apply(block, fitted(block, correct=range(4)))[turn], rtol=1e-9)


def test_several_references_are_better_than_one_where_each_has_noise():
    rng = np.random.default_rng(1)
    block = linear_glint(0.0) + rng.standard_normal((6, 60, 70)) * np.array([0.1, 0.1, 4, 4, 4, 4])[:, None, None]
    left = {m: remove.apply(block, remove.fit(m, block, nir=NIR, bands=BANDS))[0].std() for m in ("joyce", "multiband")}
    assert left["multiband"] < 0.7 * left["joyce"]


def test_collinear_references_do_not_blow_up():
    block = linear_glint(0.0)
    block[3] = block[4] * 2
    model = fitted(block)
    assert max(abs(w) for i in model.indexes for w in i.weights) < 2
    assert np.isfinite(remove.apply(block, model)).all()


def test_nan_stays_and_does_not_spread_and_the_input_is_as_it_was():
    block = linear_glint()
    block[2, 5, 6] = np.nan
    block[0, 9, 9] = np.nan
    before = block.copy()
    out = remove.apply(block, fitted(block))
    np.testing.assert_array_equal(block, before)
    assert np.isfinite(out[:, 20:]).all()
    assert np.isnan(out[2, 5, 6])
    assert np.isnan(out[0, 9, 9])


def test_a_model_goes_through_json_and_to_bands_in_another_order():
    block = linear_glint()
    model = fitted(block)
    again = remove.GlintModel.from_json(model.to_json())
    assert again == model
    turn = [5, 4, 3, 2, 1, 0]
    moved = model.for_bands(tuple(BANDS[b].name for b in turn))
    np.testing.assert_allclose(remove.apply(block[turn], moved), remove.apply(block, model)[turn], rtol=1e-12)


@pytest.mark.parametrize("shape", [(7, 9), (1, 1)])
def test_a_sample_that_is_too_small_is_refused(shape):
    with pytest.raises(FitError, match="64 are needed"):
        fitted(linear_glint(shape=shape))


def test_a_constant_nir_is_named():
    block = linear_glint()
    block[NIR] = 7
    with pytest.raises(FitError, match=r"L832.5 is constant \(7\)"):
        fitted(block)


@pytest.mark.parametrize("dead", [2, 3])
def test_a_constant_reference_counts_for_nothing(dead):
    block = linear_glint(shape=(256, 256))
    alive = [b for b in range(6) if b != dead]
    expected = fitted(block[alive], [BANDS[b] for b in alive], NIR - 1).fits[0]
    block[dead] = 7
    asked = remove.nir_request(BANDS, [NIR])
    plan = METHODS["multiband"].plan(asked)
    stats = merge([gather(block[list(plan.read_bands)], np.ones((256, 256), bool), plan)], plan)
    model = METHODS["multiband"].fit(asked, stats)
    assert model.fits[0].r2 == pytest.approx(expected.r2, rel=1e-9)
