"""Further references of the Wiener filter, kernels of faint glint, and levels after compensation."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from deglint import remove
from deglint.remove import GlintModel, further, nir_request, wiener
from deglint.remove.further import more_references
from deglint.remove.levels import LevelSample, apart_from_sparkle, shared_level
from deglint.scene import Band

from .common import whole_tile

BANDS = (Band("BLUE", 480.0), Band("RED", 660.0), Band("EDGE", 715.0), Band("NIR", 840.0))


def sparkle_over_bottom(seed=0, bottom=0.0, shape=(192, 192)):
    """Sparkle with a part that the NIR does not show; a textured bottom that the red edge sees a little."""
    rng = np.random.default_rng(seed)
    sparkle = np.maximum(gaussian_filter(rng.normal(size=shape), 1) * 4 - 1.5, 0) * 200
    own = 1 + 0.1 * gaussian_filter(rng.normal(size=shape), 1) * 4
    texture = gaussian_filter(rng.normal(size=shape), 6) * 20
    water = np.stack([90 + bottom * texture, 40 + bottom * texture, 10 + 0.1 * bottom * texture, 2 + 0 * texture])
    glints = np.stack([sparkle * own, sparkle * own, sparkle * own, sparkle])
    return (water + glints + 0.5 * rng.normal(size=water.shape)).astype(np.float32), water


def parts(block):
    return nir_request(BANDS, [3], regression="detrended"), [whole_tile(block)]


def test_a_red_edge_band_serves_over_deep_water_and_not_over_a_bottom_that_it_sees():
    request, tiles = parts(sparkle_over_bottom()[0])
    assert more_references(replace(request, faint_glint=True), tiles) == (2,)
    request, tiles = parts(sparkle_over_bottom(bottom=6.0)[0])
    assert more_references(replace(request, faint_glint=True), tiles) == ()


def test_a_red_edge_band_does_not_serve_over_a_bottom_that_is_weaker_than_its_noise():
    noise = 5 * np.random.default_rng(9).normal(size=(4, 192, 192)).astype(np.float32)
    block, water = sparkle_over_bottom(bottom=40.0)
    request, tiles = parts(block + noise)
    request = replace(request, faint_glint=True)
    without, more = (wiener.fit(replace(request, more=m), tiles) for m in ((), (2,)))
    errors = [np.std((remove.apply(tiles[0].block, m) - water)[1]) for m in (without, more)]
    assert errors[1] > 1.2 * errors[0]
    assert more_references(request, tiles) == ()


def test_a_reference_with_which_nothing_is_significant_does_not_serve(monkeypatch):
    request, tiles = parts(sparkle_over_bottom()[0])
    fitted = further.fit_without_levels

    def insignificant(ready):
        model, slopes = fitted(ready)
        return (replace(model, fits=()) if ready.request.more else model), slopes

    assert more_references(request, tiles) == (2,)
    monkeypatch.setattr(further, "fit_without_levels", insignificant)
    assert more_references(request, tiles) == ()


def test_a_red_edge_band_that_alone_is_corrected_is_no_reference():
    _, tiles = parts(sparkle_over_bottom()[0])
    assert more_references(nir_request(BANDS, [3], correct=[2], regression="detrended"), tiles) == ()


def test_further_references_lessen_what_is_left_and_are_saved():
    block, water = sparkle_over_bottom()
    request, tiles = parts(block)
    left = {}
    for more in ((), (2,)):
        model = wiener.fit(replace(request, more=more), tiles)
        left[more] = float(np.std((remove.apply(block, model) - water)[0]))
    assert left[(2,)] < 0.6 * left[()]
    again = GlintModel.from_json(model.to_json())
    assert again == model
    np.testing.assert_array_equal(remove.apply(block, again), remove.apply(block, model))


@pytest.mark.slow
def test_a_plume_survives_a_fit_with_it():
    block, _ = sparkle_over_bottom()
    row, column = np.mgrid[:192, :192]
    plume = np.exp(-((row - 96) ** 2 + (column - 96) ** 2) / (2 * 40.0**2)) * np.array([8, 20, 5, 0.5])[:, None, None]
    results = []
    for image in (block, (block + plume).astype(np.float32)):
        request, tiles = parts(image)
        model = wiener.fit(replace(request, more=more_references(request, tiles), faint_glint=True), tiles)
        results.append(remove.apply(image, model))
    kept = (results[1] - results[0])[1, 66:126, 66:126].mean() / plume[1, 66:126, 66:126].mean()
    assert kept == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("options", [{"more": (2,)}, {"more": (2,), "faint_glint": True}])
def test_a_tile_with_its_halo_is_the_whole_to_the_bit(options):
    block, _ = sparkle_over_bottom()
    request, tiles = parts(block)
    model = wiener.fit(replace(request, **options), tiles)
    whole, h = remove.apply(block, model), model.halo
    part = remove.apply(np.ascontiguousarray(block[:, 60 - h : 100 + h, 70 - h : 120 + h]), model)
    np.testing.assert_array_equal(part[:, h:-h, h:-h], whole[:, 60:100, 70:120])


def test_sparkle_on_water_whose_noise_rounding_hides_is_followed():
    rng = np.random.default_rng(0)
    sparkle = gaussian_filter(np.where(rng.random((192, 192)) < 0.02, rng.exponential(30, (192, 192)), 0), 0.6)
    nir = 10 + gaussian_filter(sparkle, 0.5)
    block = np.rint([60 + 0.9 * sparkle, 40 + 0.95 * sparkle, 20 + sparkle, nir]).astype(np.float32)
    model = wiener.fit(replace(nir_request(BANDS, [3]), faint_glint=True), [whole_tile(block)])
    np.testing.assert_allclose([f.slope for f in model.fits], [0.9, 0.95, 1], rtol=0.05)


def test_faint_glint_is_followed_better_than_strong():
    block, water = sparkle_over_bottom()
    block[:3] += 0.002 * (block[3] - 2) ** 2  # strong glint is not linear
    request, tiles = parts(block)
    faint = (block[3] > 10) & (block[3] < 40)
    wrong = []
    for some in (False, True):
        model = wiener.fit(replace(request, faint_glint=some), tiles)
        model = replace(model, fits=tuple(replace(f, floor=None) for f in model.fits))  # a fit to faint glint has none
        wrong.append(remove.apply(block, model)[0] - water[0])
    assert np.std(wrong[1][faint]) < 0.9 * np.std(wrong[0][faint])


def test_strong_glint_leaves_no_pixel_darker_than_water_with_little_glint():
    block, _ = sparkle_over_bottom()
    block[:3] -= 0.0005 * (block[3] - 2) ** 2  # strong glint is not linear
    block[0, 90:98, 90:98] -= 30  # a dark object
    request, tiles = parts(block)
    model = wiener.fit(request, tiles)
    unlimited = replace(model, fits=tuple(replace(f, floor=None) for f in model.fits))
    left, below = (remove.apply(block, m)[:3] for m in (model, unlimited))
    assert (below.min(axis=(1, 2)) < 0).all()
    least = np.array([f.floor for f in model.fits])
    assert (left >= np.minimum(block[:3], 0.999 * least[:, None, None])).all()
    assert (least > 0).all()
    assert all(f.floor is None for f in wiener.fit(replace(request, faint_glint=True), tiles).fits)
    assert (left <= block[:3]).all()
    assert left[0, 90:98, 90:98].mean() - np.median(left[0]) == pytest.approx(-30, abs=4)


def test_pits_beside_sparkle_are_no_level():
    together, sample = np.zeros((64, 64), np.float32), np.ones((64, 64), bool)
    together[20, 20], together[20, 22] = 100, -50
    apart = apart_from_sparkle(together, sample)
    assert not apart[20, 22]
    assert apart[40, 40]


def test_the_noise_of_a_sharpening_kernel_is_not_taken_for_the_level():
    rng = np.random.default_rng(2)
    glint = 500 * np.maximum(gaussian_filter(rng.normal(size=(256, 256)), 3) * 10 - 0.5, 0)
    prediction = (20 + glint + 5 * rng.normal(size=glint.shape)).reshape(1, -1)
    around = (20 + glint + 5 / 3 * rng.normal(size=glint.shape)).ravel()
    value = np.full_like(prediction, 1e4)
    everywhere, one = np.ones(around.shape, bool), np.ones(1)
    own, mean = (shared_level(LevelSample(prediction, value, a, a, prediction - value, everywhere), one)[0][0]
                 for a in (prediction[0], around))  # fmt: skip
    assert abs(mean - 20) < 0.5
    assert own < 18


def test_the_ringing_of_resampling_is_not_taken_for_the_level_of_dense_glint():
    rng = np.random.default_rng(6)
    glint = gaussian_filter(rng.exponential(300, (512, 512)) * (rng.random((512, 512)) < 0.2), 0.7)
    shift = np.array([[1.0, 0, 0.4], [0, 1, 0.3]])
    found = cv2.warpAffine(20 + glint, shift, glint.shape, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    mean, binomial = cv2.blur(found, (3, 3)).ravel(), cv2.GaussianBlur(found, (3, 3), 0).ravel()
    prediction, everywhere = found.reshape(1, -1), np.ones(found.size, bool)

    def level(order):
        sample = LevelSample(prediction, prediction + 1e4, mean, order, 0 * prediction - 1e4, everywhere)
        return shared_level(sample, np.ones(1), resolved=True)[0][0]

    assert abs(level(binomial) - 20) < 3
    assert level(prediction[0]) < 10


def test_errors_of_the_kernels_do_not_raise_the_level_under_dense_glint():
    rng = np.random.default_rng(4)
    prediction, error = 20 + 500 * rng.random((1, 40_000)), 30 * rng.normal(size=(1, 40_000))
    value, everywhere = np.maximum(prediction - error, 1), np.ones(40_000, bool)  # sensors store nothing negative
    local = error / 15  # of means over 15 x 15 pixels
    means, pixels = (
        shared_level(LevelSample(prediction, value, *prediction, *prediction, a, everywhere), np.ones(1))[0][0]
        for a in (local, error)
    )
    assert abs(means - 20) < 10
    assert pixels > 80


def test_noise_is_not_taken_for_a_sheet_where_sparkle_is_rare():
    rng = np.random.default_rng(5)
    prediction = 100 + 5 * rng.normal(size=(1, 40_000))
    prediction[0, ::400] += 2000
    everywhere = np.ones(40_000, bool)
    sample = LevelSample(prediction, 1e4 + prediction, *prediction, *prediction, 0 * prediction - 1e4, everywhere)
    fine, coarse = (shared_level(sample, np.ones(1), resolved=r)[0][0] for r in (True, False))
    assert abs(fine - 100) < 5
    assert coarse < 88


def test_dark_rings_around_sparkle_are_no_level_where_pixels_hold_several_waves():
    rng = np.random.default_rng(8)
    prediction = 100 + 5 * rng.normal(size=(1, 40_000))
    prediction[0, ::20] += 100
    everywhere = np.ones(40_000, bool)
    sample = LevelSample(prediction, 1e4 + prediction, *prediction, *prediction, 0 * prediction - 1e4, everywhere)
    assert abs(shared_level(sample, np.ones(1))[0][0] - 100) < 5


def test_as_much_glint_is_removed_where_an_offset_was_subtracted():
    rng = np.random.default_rng(6)
    glint = rng.gamma(4, 30, (1, 40_000))
    water, everywhere = 100 + 10 * rng.normal(size=(1, 40_000)), np.ones(40_000, bool)
    own, less = (
        shared_level(LevelSample(glint, water + glint - o, *glint, *glint, o - water, everywhere), np.ones(1))[0][0]
        for o in (0, 150)  # 8 % of the pixels are then negative
    )
    assert own < np.median(glint) / 3
    assert less == pytest.approx(own, abs=10)
