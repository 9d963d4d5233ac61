"""Background, sharpening, replacement and median against their definitions, and on simulated seas."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.signal import convolve2d

from deglint.compensate.background import fit as fit_background
from deglint.compensate.background import opening, ringing, shared
from deglint.compensate.median import adaptive_median
from deglint.compensate.normalise import water_level
from deglint.compensate.psf import PSF, system_psf, typical_psf
from deglint.compensate.replace_glint import fit_bands, nearest_clean
from deglint.compensate.sharpen import blurred, richardson_lucy
from deglint.compensate.stages import apply_stages, fit_stages, parse
from deglint.compensate.state import Sample, Setting, State
from deglint.errors import InputError
from deglint.physics.presets import preset
from deglint.physics.sensor import Sensor, SensorBand
from deglint.physics.sensor import psf as sample_psf
from deglint.scene import Band
from deglint.simulate import Setup, SubmergedObject, simulate, square

RNG = np.random.default_rng(4)
CHAIN = "psf:2, identify-level:13, replace-level"


@pytest.mark.parametrize("size", [3, 7, 13])
def test_opening_by_a_square_is_its_definition(size):
    band = RNG.random((40, 50)).astype(np.float32)
    low = ndimage.median_filter(ndimage.minimum_filter(band, size, mode="nearest"), 3, mode="nearest")
    wanted = ndimage.maximum_filter(low, size, mode="nearest")
    inner = (slice(size, -size),) * 2
    np.testing.assert_array_equal(opening(band, size)[inner], wanted[inner])


@pytest.mark.parametrize(("size", "cut"), [(11, 2), (17, 8), (13, 6), (5, 1)])
def test_corners_are_cut_off_step_by_step(size, cut):
    band = RNG.random((60, 70)).astype(np.float32)
    down, across = np.abs(np.mgrid[-(size // 2) : size // 2 + 1, -(size // 2) : size // 2 + 1])
    window = down + across <= 2 * (size // 2) - cut  # a square with corners of `cut` pixels less
    low = ndimage.median_filter(ndimage.minimum_filter(band, footprint=window), 3)
    wanted = ndimage.maximum_filter(low, footprint=window)
    inner = (slice(size, -size),) * 2
    np.testing.assert_array_equal(opening(band, size, cut)[inner], wanted[inner])


def test_an_octagon_follows_discs_and_a_diamond_squares_on_their_corners():
    down, across = np.mgrid[:60, :60] - 30
    disc = np.float32(np.hypot(down, across) <= 8)
    diamond = np.float32(np.abs(down) + np.abs(across) <= 10)
    assert opening(disc, 13).max() == opening(diamond, 13).max() == 0
    assert opening(disc, 11, 2)[30, 30] == opening(diamond, 17, 8)[30, 30] == 1


def test_squares_wider_than_the_window_stay_and_narrower_ones_go():
    for side, left in ((16, 1.0), (10, 0.0)):
        band = np.zeros((60, 60), np.float32)
        band[20 : 20 + side, 20 : 20 + side] = 1
        assert opening(band, 13)[20 + side // 2, 20 + side // 2] == left


def test_details_count_as_far_as_a_neighbour_in_time_has_them():
    details = np.array([4.0, 1.0, 3.0, 0.0], np.float32)[:, None, None]
    np.testing.assert_array_equal(shared(details, (0, 1, 2, 3)).ravel(), [2, 1, 2, 0])
    np.testing.assert_array_equal(shared(details, (0, 2, 1, 3)).ravel(), [4, 1, 3, 0])
    np.testing.assert_array_equal(shared(details[:1], (0,)).ravel(), [0])


@pytest.mark.parametrize("f_number", [5, 10, 30])
def test_blurring_is_convolution_with_the_kernel(f_number):
    psf = system_psf(660.0, f_number=f_number, pitch=8e-6)
    band = RNG.random((60, 60)).astype(np.float32)
    wanted = convolve2d(band, psf.kernel, "same")
    inner = (slice(12, -12),) * 2
    np.testing.assert_allclose(blurred(band, psf, 21)[inner], wanted[inner], rtol=1e-4)
    np.testing.assert_allclose(blurred(band, psf)[inner], wanted[inner], atol=0.02)


def test_sharpening_gathers_light_and_keeps_it():
    psf = system_psf(660.0, f_number=10, pitch=8e-6)
    band = np.full((50, 50), 1.0, np.float32)
    band[25, 25] = 20
    seen = blurred(band, psf, 21)
    sharp = richardson_lucy(seen, psf, 4, 1e-3)
    assert sharp[25, 25] > 1.3 * seen[25, 25]
    np.testing.assert_allclose(sharp.sum(), seen.sum(), rtol=1e-3)


@pytest.mark.parametrize(
    ("kernel", "said"),
    [(np.ones((2, 2)), "odd side"), ([[0, -1, 0], [0, 3, 0], [0, 0, 0]], "nowhere negative"), ([[np.nan]], "finite"),
     ([], "odd side"), (np.eye(3)[:2], "odd side"), (np.ones((3, 3)), "sum to 1")],
)  # fmt: skip
def test_what_is_no_psf_is_refused(kernel, said):
    with pytest.raises(InputError, match=said) as error:
        PSF(np.array(kernel, float))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"f_number": -1}, r"f_number .*0.7 to 200"),
        ({"wavelength": 5.0}, "100 to 20000 nm"),
        ({"wavelength": [500.0]}, "wavelength must be"),
    ],
)
def test_optics_that_cannot_be_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        system_psf(**({"wavelength": 545.0, "f_number": 10, "pitch": 8e-6} | change))


def test_kernels_sum_to_one_and_leave_out_little():
    for wavelength in (425.0, 950.0):
        psf = system_psf(wavelength, f_number=10, pitch=8e-6)
        assert abs(psf.kernel.sum() - 1) < 1e-12
        band = SensorBand(name="", low=wavelength, high=wavelength, full_scale=1.0)
        optics = Sensor(name="", bands=(band,), gsd=1.0, f_number=10, pitch=8e-6, smear=0.5)
        inside = slice(128 - psf.radius, 128 + psf.radius + 1)
        assert sample_psf(optics, wavelength, size=257, oversample=4)[inside, inside].sum() > 0.97
    with pytest.raises(InputError, match="odd side"):
        PSF(np.ones((2, 2)))


def test_median_is_that_of_the_first_window_with_enough_clean_pixels():
    band = RNG.random((20, 24)).astype(np.float32)
    glint = RNG.random(band.shape) < 0.8
    clean = ~glint & (RNG.random(band.shape) < 0.9)
    out, filled = adaptive_median(band, glint, clean, 9)
    for r, c in np.argwhere(glint):
        for reach in range(1, 5):
            at = slice(max(r - reach, 0), r + reach + 1), slice(max(c - reach, 0), c + reach + 1)
            values = np.sort(band[at][clean[at]])
            if values.size >= 5:
                assert filled[r, c]
                assert out[r, c] == values[(values.size - 1) // 2]
                break
        else:
            assert not filled[r, c]
    np.testing.assert_array_equal(out[~glint], band[~glint])


def test_the_nearest_clean_band_replaces():
    bands = tuple(Band(n, w) for n, w in (("a", 450.0), ("b", 800.0), ("c", 500.0)))
    order = fit_bands(Sample((), ()), Setting(bands, (1,))).order
    assert order == ((2, 1), (2, 0), (0, 1))
    image = np.array([1.0, 2.0, 3.0], np.float32)[:, None, None]
    values, found = nearest_clean(image, np.array([True, False, True])[:, None, None], order)
    np.testing.assert_array_equal(values.ravel(), [2, 2, 2])
    assert found.ravel().tolist() == [True, False, True]
    assert not nearest_clean(image, np.ones((3, 1, 1), bool), order)[1].any()


def test_under_much_glint_the_mode_is_taken_where_that_is_asked_for():
    values = np.concatenate([RNG.normal(10, 0.1, 5000), 10 + RNG.gamma(1, 20, 5000)]).astype(np.float32)
    assert water_level(values, 1.0) == (float(np.median(values)), False)
    level, robust = water_level(values, 0.3)
    assert robust
    assert abs(level - 10) < 0.1


# ---------------------------------------------------------------------------------------------------- simulated seas


@cache
def simulated(kind, wind=9.0, seed=21, side=160):
    """Radiance, truth, setting and objects of a sea with objects 16 pixels wide on the right."""
    sensor = preset("thesis")
    objects = []
    for i in range(side // 40):
        for j in range(side // 80):
            x, y = (side / 2 + 20 + 40 * j) * sensor.gsd, (20 + 40 * i) * sensor.gsd
            if kind == "disc":
                turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
                corners = tuple((x + 2 * float(np.cos(t)), y + 2 * float(np.sin(t))) for t in turn)
                objects.append(SubmergedObject(corners=corners, reflectance=0.1, depth=5.0))
            else:
                objects.append(square(x, y, 4.0, reflectance=0.1, depth=5.0))
    setup = Setup(sensor=sensor, size=(side, side), wind=wind, sky="cardioidal", objects=tuple(objects), seed=seed)
    made = simulate(setup)
    scale = np.array([sensor.scale(b) for b in sensor.bands])[:, None, None]
    bands = tuple(Band(b.name, b.wavelength, time_offset=b.time_offset) for b in sensor.bands)
    psfs = tuple(system_psf(b.wavelength, f_number=10, pitch=8e-6) for b in sensor.bands)
    return np.float32(made.image * scale), made.truth, Setting(bands, (6, 7), psfs), made.objects > 0


def errors(image, truth, count=4):
    """Root mean square error of the first bands over their water [%]."""
    level = np.median(truth, axis=(1, 2))[:, None, None]
    return 100 * float(np.sqrt((((image - truth) / level)[:count] ** 2).mean()))


def sampled(block):
    state = State.of(block)
    return state, Sample((state,), (state.water,))


@pytest.mark.parametrize(("kind", "most"), [("square", 11.0), ("disc", 11.0)])
def test_glint_goes_and_objects_stay(kind, most):
    block, truth, setting, objects = simulated(kind)
    state, sample = sampled(block)
    stages, _ = fit_stages(parse(CHAIN)[:-1], sample, setting)
    out = apply_stages(state, stages).image
    assert errors(out, truth) < most < 0.2 * errors(block, truth)
    core = cv2.erode(objects.view(np.uint8), np.ones((5, 5), np.uint8)) > 0
    for band in (1, 2):
        contrast = [a[band][core].mean() - np.median(a[band][~objects]) for a in (out, truth)]
        assert 0.7 < contrast[0] / contrast[1] < 1.3
    without = fit_stages(parse("identify-level:13, replace-level")[:-1], sample, setting)[0]
    assert errors(apply_stages(state, without).image, truth) > errors(out, truth)


def test_outlines_count_where_the_nir_shows_none():
    block, truth, setting, objects = simulated("disc")
    state, sample = sampled(block)
    round_, square_ = (
        apply_stages(state, fit_stages(parse(CHAIN)[:-1], sample, s)[0]).image
        for s in (setting, replace(setting, nir=()))
    )
    lost = [np.sqrt(((a - truth)[2][objects] ** 2).mean()) for a in (round_, square_)]
    assert lost[0] < 0.6 * lost[1]


def test_typical_optics_are_better_than_none():
    block, truth, setting, _ = simulated("square")
    state, sample = sampled(block)
    typical = replace(setting, psfs=tuple(typical_psf(b.wavelength) for b in setting.bands))
    chains = (CHAIN, typical), ("identify-level:13, replace-level", setting)
    out = [apply_stages(state, fit_stages(parse(t)[:-1], sample, s)[0]).image for t, s in chains]
    assert errors(out[0], truth) < 0.95 * errors(out[1], truth)


def test_pits_beside_sparkle_are_found_in_resampled_images_only():
    block, truth, setting, _ = simulated("square")
    _, sample = sampled(block)
    sigma = np.array(fit_background(sample, setting).sigmas)
    assert ringing(sample, sigma) == ()
    grid = np.float32(np.meshgrid(np.arange(0.5, 158), np.arange(0.5, 158)))
    rung, sharp = (np.stack([cv2.remap(b, *grid, cv2.INTER_LANCZOS4) for b in np.float32(a)]) for a in (block, truth))
    state, sample = sampled(rung)
    stages, _ = fit_stages(parse(CHAIN)[:-1], sample, setting)
    assert len(stages[1].caps) == 8
    out = apply_stages(state, stages).image
    spread = apply_stages(state, (stages[0], replace(stages[1], caps=()), stages[2])).image
    assert errors(out, sharp) < 0.7 * errors(spread, sharp)


def test_pits_that_end_at_zero_count_however_small_they_are():
    block, *_ = simulated("square")
    grid = np.float32(np.meshgrid(np.arange(0.5, 158), np.arange(0.5, 158)))
    rung = np.stack(
        [cv2.remap(b, *grid, cv2.INTER_LANCZOS4) for b in block - np.percentile(block, 1, (1, 2))[:, None, None]]
    )
    rough = np.full(8, np.median(rung))  # of the noise: five times this is more than the water
    assert ringing(sampled(rung + 1000)[1], rough) == ()
    assert len(ringing(sampled(np.maximum(rung, 0))[1], rough)) == 8


def background_above_water(glint, texture):
    """Median of the background over the water, (band,), in an image of noise, glint, and texture that the NIR lacks."""
    water = np.array([50.0, 40.0, 30.0, 10.0])[:, None, None]
    bands = tuple(Band(f"b{w}", wavelength=float(w), time_offset=1e-4 * (w - 450)) for w in (450, 560, 660, 850))
    water = water + texture * np.array([1, 1, 1, 0])[:, None, None]
    state = State.of((water + glint + RNG.normal(0, 1, (4, 300, 320))).astype(np.float32))
    stage = fit_background(Sample((state,), (state.water,)), Setting(bands, (3,)), 5)
    return np.median(stage.apply(state).background - water, axis=(1, 2))


def test_the_background_is_that_of_the_pixels_with_the_least_glint():
    waves = cv2.GaussianBlur(RNG.normal(0, 1, (300, 320)), (0, 0), 0.7)  # every pixel has glint
    glint = 4 * np.exp(waves / waves.std())
    errors = background_above_water(glint, np.zeros_like(glint)) - np.percentile(glint, 10)
    assert np.abs(errors).max() < 0.5  # half the noise of a pixel


def test_texture_of_the_water_does_not_shift_its_background():
    texture = cv2.GaussianBlur(RNG.normal(0, 1, (300, 320)), (0, 0), 0.7)
    errors = background_above_water(np.zeros_like(texture), 5 * texture / texture.std())
    assert np.abs(errors).max() < 0.5
