"""Posterior mean of the water after removal: identity, scaling, order of bands, blocks, edges, plumes, calibration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from deglint.compensate import posterior
from deglint.compensate.posterior import LeftOver, posterior_mean
from deglint.compensate.state import Sample, Setting, State
from deglint.scene import Band

BANDS = (Band("GREEN", 545.0), Band("RED", 660.0), Band("NIR", 840.0))
SETTING = Setting(BANDS, (2,))


def state_and_water(shape=(160, 192), seed=0, plume=0.0, target=0.0):
    """A state after removal that left a tenth of sparkle, and its water."""
    rng = np.random.default_rng(seed)
    water = np.ones((3, *shape), np.float32) * np.array([100, 60, 10], np.float32)[:, None, None]
    row, column = np.mgrid[: shape[0], : shape[1]]
    water[:2] += plume * np.exp(-((row - 80) ** 2 + (column - 60) ** 2) / (2 * 30.0**2))
    water[:2, 60:84, 120:144] += target
    sparkle = 300 * np.maximum(gaussian_filter(rng.normal(size=shape), 1.0) * 3.5 - 1.2, 0)
    removed = np.stack([sparkle, 0.8 * sparkle, 0 * sparkle]).astype(np.float32)
    left = 0.1 * removed * rng.normal(size=removed.shape)
    image = (water + rng.normal(size=water.shape) + left).astype(np.float32)
    return State(image + removed, image, np.ones(shape, bool), removed=removed), water


def fitted(state, setting=SETTING):
    return posterior.fit(Sample((state,), (state.water,)), setting)


def error(image, water):
    return float(np.sqrt(np.mean((image - water)[:2] ** 2)))


def test_left_over_glint_is_taken_and_calm_pixels_stay_to_the_bit():
    state, water = state_and_water()
    out = fitted(state).apply(state).image
    assert error(out, water) < 0.3 * error(state.image, water)
    calm = state.removed == 0
    np.testing.assert_array_equal(out[calm], state.image[calm])


def test_nothing_is_done_where_glint_leaves_nothing():
    state, _ = state_and_water()
    even = replace(state, removed=np.zeros_like(state.image))
    np.testing.assert_array_equal(fitted(even).apply(even).image, state.image)
    rng = np.random.default_rng(5)
    noisy = replace(state, image=rng.normal(100, 3, state.image.shape).astype(np.float32))
    found = fitted(noisy, replace(SETTING, pixel=10.0))
    assert not found.resolved
    np.testing.assert_array_equal(found.apply(noisy).image, noisy.image)


@pytest.mark.parametrize(("pixel", "changed"), [(1.2, True), (10.0, False), (0.0, True)])
def test_a_weak_growth_with_glint_may_be_texture_where_pixels_average_waves(pixel, changed):
    state, _ = state_and_water()
    rng = np.random.default_rng(5)
    growing = 1 + 0.005 * state.removed[:1]  # twice the noise under strong glint
    image = (100 + 3 * growing * rng.normal(size=state.image.shape)).astype(np.float32)
    found = fitted(replace(state, image=image), replace(SETTING, pixel=pixel))
    assert all(p.ratio < 3 for p in found.left)
    assert found.resolved == changed


def test_the_unit_does_not_matter():
    state, _ = state_and_water()
    large = State(4 * state.raw, 4 * state.image, state.water, removed=4 * state.removed)
    np.testing.assert_allclose(fitted(large).apply(large).image, 4 * fitted(state).apply(state).image, rtol=1e-4)


def test_the_order_of_bands_does_not_matter():
    state, _ = state_and_water()
    turned = State(state.raw[::-1], state.image[::-1], state.water, removed=state.removed[::-1])
    setting = Setting(BANDS[::-1], (0,))
    out = posterior.fit(Sample((turned,), (turned.water,)), setting).apply(turned).image
    np.testing.assert_array_equal(out[::-1], fitted(state).apply(state).image)


@pytest.mark.parametrize(("row", "column"), [(0, 0), (40, 50), (100, 130)])
def test_a_block_with_its_halo_is_the_whole(row, column):
    state = replace(state_and_water()[0], errors=True)
    stage = fitted(state)
    whole, h = stage.apply(state), stage.halo
    outer = slice(max(row - h, 0), row + 40 + h), slice(max(column - h, 0), column + 40 + h)
    raw, image, removed = (a[:, *outer] for a in (state.raw, state.image, state.removed))
    part = State(raw, image, state.water[outer], removed=removed, errors=True)
    top, left = row - outer[0].start, column - outer[1].start
    for name in ("image", "variance"):
        got = getattr(stage.apply(part), name)[:, top : top + 40, left : left + 40]
        np.testing.assert_allclose(got, getattr(whole, name)[:, row : row + 40, column : column + 40], rtol=2e-4)


def test_plumes_and_objects_keep_their_contrast():
    state, water = state_and_water(plume=20.0, target=15.0)
    out = fitted(state).apply(state).image
    gain = (out[0, 64:96, 44:76] - 100).mean() / (water[0, 64:96, 44:76] - 100).mean()
    assert gain == pytest.approx(1, abs=0.05)
    inside = np.zeros(state.water.shape, bool)
    inside[62:82, 122:142] = True
    assert (out[0][inside].mean() - 100) / (water[0][inside].mean() - 100) == pytest.approx(1, abs=0.08)
    assert out[0, 72, 122:142].mean() - out[0, 72, 100:118].mean() > 10


def test_the_variance_is_that_of_the_error():
    for seed in (1, 2):
        state, water = state_and_water(seed=seed, target=15.0)
        out = fitted(state).apply(replace(state, errors=True))
        ratio = np.sqrt(out.variance[:2].mean() / np.mean((out.image - water)[:2] ** 2))
        assert ratio == pytest.approx(1, abs=0.2)


def test_saturated_pixels_take_the_water_around():
    state, _ = state_and_water()
    raw, image = state.raw.copy(), state.image.copy()
    raw[:, 80, 90], image[:2, 80, 90] = 4095, 900
    stage = replace(fitted(state), saturation=(4095.0,) * 3)
    out = stage.apply(replace(state, raw=raw, image=image))
    assert abs(out.image[0, 80, 90] - 100) < 5


def test_pits_that_end_at_zero_take_the_water_around():
    state, _ = state_and_water()
    raw, image = state.raw.copy(), state.image.copy()
    raw[0, 80, 90], image[0, 80, 90] = 0, 5
    stage = fitted(state)
    out = stage.apply(replace(state, raw=raw, image=image)).image
    assert abs(out[0, 80, 90] - 100) < 5
    assert replace(stage, resolved=False).apply(replace(state, raw=raw, errors=True)).variance[0].max() < 1e4


@pytest.mark.parametrize("red", [0.0, 60.0])
def test_water_that_is_zero_in_a_band_is_no_pit(red):
    state, water = state_and_water()
    dark = np.array([0, 60 - red, 0], np.float32)[:, None, None]
    rng, clear = np.random.default_rng(7), np.arange(192) < 96
    noisy = water + rng.normal(size=water.shape) * np.array([8, 1, 1])[:, None, None]
    image = (np.where(clear, noisy, state.image) - dark).astype(np.float32)
    removed = np.where(clear, 0, state.removed)
    state = State(image + removed, image, state.water, removed=removed)
    out = fitted(state).apply(state).image
    np.testing.assert_array_equal(out[:2, :, :96], image[:2, :, :96])


def test_water_whose_noise_rounding_hides_is_not_zero():
    state, water = state_and_water()
    removed = np.zeros_like(water)
    removed[:2, :, 96:] = 50 + 50 * gaussian_filter(np.random.default_rng(3).random(state.water.shape), 4)[:, 96:]
    left = 0.1 * removed * np.random.default_rng(4).normal(size=water.shape)
    image = np.rint(water + left).astype(np.float32)
    rounded = State(image + removed, image, state.water, removed=removed)
    assert error(fitted(rounded).apply(rounded).image, water) < 0.3 * error(image, water)


def test_the_table_of_variances_is_the_line_between_them():
    left = LeftOver(0, 1.0, (0.0, 2.0, 10.0), (0.0, 0.0, 8.0))
    glint = np.array([[0.0, 1.0, 2.0, 6.0, 10.0, 20.0]], np.float32)
    np.testing.assert_allclose(left.of(glint)[0], [0, 0, 0, 4, 8, 32], atol=0.02)


def test_even_left_over_glint_is_the_filter_of_lee():
    rng = np.random.default_rng(3)
    x = rng.normal(50, 2, (64, 64)).astype(np.float32)
    variance = np.zeros_like(x)
    out = posterior_mean(x, np.full_like(x, 3.0), np.float32(1.0), 9, variance)
    np.testing.assert_array_equal(out, posterior_mean(x, np.full_like(x, 3.0), np.float32(1.0), 9))
    assert out.std() < 0.65 * x.std()
    assert (variance > 0).all()
