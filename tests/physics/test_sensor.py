"""Blur, electrons and noise against closed forms and worked numbers."""

from dataclasses import replace

import numpy as np
import pytest

from deglint.errors import BandError, InputError
from deglint.physics.imaging import observe, transform
from deglint.physics.presets import PRESETS, preset
from deglint.physics.sensor import (
    Sensor,
    SensorBand,
    band_means,
    cutoff,
    digitise,
    electrons,
    mtf,
    mtf_diffraction,
    noise,
    noise_equivalent_radiance,
    psf,
)

from ..common import says

THESIS = preset("thesis")
GREEN = SensorBand(name="green", low=510, high=580, full_scale=0.2)  # centre 545 nm


def optics(micrometres, f_number):
    return replace(THESIS, pitch=1e-6 * micrometres, f_number=f_number)


def test_the_quantisation_noise_is_that_of_the_digital_numbers():
    coarse = replace(THESIS, bits=3, read_noise=0.0, dark_current=0.0)
    radiance = np.linspace(0, GREEN.full_scale, 70_001)
    rounded = digitise(radiance, coarse, GREEN) * coarse.scale(GREEN) - radiance
    per_radiance = electrons(1.0, coarse, GREEN)
    assert noise(0.0, coarse, exposure=0.0) == pytest.approx(rounded.std() * per_radiance, rel=1e-3)


@pytest.mark.parametrize(
    ("pitch", "f_number", "expected"),
    [(5, 10, 0.342), (5, 30, 0), (8, 10, 0.575), (8, 30, 0), (10, 10, 0.657), (10, 30, 0.091),
     (15, 10, 0.770), (15, 30, 0.342)],
)  # fmt: skip
def test_diffraction_at_nyquist(pitch, f_number, expected):
    sensor = optics(pitch, f_number)
    assert float(mtf_diffraction(0.5 / cutoff(sensor, 545.0))) == pytest.approx(expected, abs=5e-4)


def test_detector_and_smear_at_nyquist():
    sharp = replace(THESIS, f_number=0.7, pitch=1e-3)  # optics without a share in it
    assert float(mtf(0.0, 0.5, sharp, 545.0)) == pytest.approx(0.6366, abs=2e-4)
    assert float(mtf(0.5, 0.0, sharp, 545.0)) == pytest.approx(0.5732, abs=2e-4)
    assert float(mtf(0.5, 0.0, sharp, 545.0) / mtf(0.0, 0.5, sharp, 545.0)) == pytest.approx(0.9003, abs=1e-4)
    shaken = replace(sharp, jitter=0.3)
    expected = np.exp(-2 * np.pi**2 * 0.3**2 * 0.25)
    assert float(mtf(0.0, 0.5, shaken, 545.0) / mtf(0.0, 0.5, sharp, 545.0)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("pitch", "f_number", "centre", "in_track", "cross", "nine"),
    [(8, 10, 0.722, 0.048, 0.030, 0.916), (8, 30, 0.169, 0.096, 0.095, 0.753),
     (10, 10, 0.795, 0.033, 0.019, 0.934), (10, 30, 0.248, 0.106, 0.103, 0.821)],
)  # fmt: skip
def test_shares_of_a_point_source(pitch, f_number, centre, in_track, cross, nine):
    kernel = psf(optics(pitch, f_number), 545.0, size=65)
    got = kernel[32, 32], kernel[31, 32], kernel[32, 31], kernel[31:34, 31:34].sum()
    assert got == pytest.approx((centre, in_track, cross, nine), abs=6e-4)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("size", [9, 33])
def test_psf_keeps_the_light(name, size):
    sensor = preset(name)
    for band in sensor.bands:
        kernel = psf(sensor, band.wavelength, size=size)
        assert kernel.shape == (size, size)
        assert kernel.sum() == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(kernel, kernel[::-1, ::-1], atol=1e-12)
        assert kernel.argmax() == kernel.size // 2


@pytest.mark.parametrize(
    ("f_number", "pitch", "count", "ratio"),
    [(10, 8e-6, 1236, 33.8), (30, 8e-6, 137, 8.9), (2.8, 3.75e-6, 3463, 58.0)],
)
def test_electrons_and_signal_to_noise_of_the_worked_example(f_number, pitch, count, ratio):
    # the worked example leaves quantisation out: 16 bits
    sensor = replace(THESIS, f_number=f_number, pitch=pitch, read_noise=10.0, bits=16)
    got = electrons(0.02, sensor, GREEN, exposure=1e-3)
    assert float(got) == pytest.approx(count, abs=0.6)
    assert float(got / noise(got, sensor, exposure=1e-3)) == pytest.approx(ratio, rel=5e-3)
    if f_number == 10:
        found = noise_equivalent_radiance(0.02, sensor, GREEN, exposure=1e-3)
        assert float(found) == pytest.approx(5.9e-4, abs=5e-6)


@pytest.mark.parametrize("name", PRESETS)
def test_full_scale_fills_the_well(name):
    sensor = preset(name)
    for band in sensor.bands:
        assert float(electrons(band.full_scale, sensor, band)) == pytest.approx(sensor.well, rel=1e-12)
        assert 1e-5 < sensor.exposure(band) < 1.0
        assert digitise(np.array([band.full_scale]), sensor, band)[0] == sensor.levels


def test_numbers_round_and_saturate():
    band = THESIS.bands[2]
    step = THESIS.scale(band)
    got = digitise(step * np.array([-3.0, 0.4, 0.6, 100.0, 4094.4, 4095.0, 1e6]), THESIS, band)
    assert got.dtype == np.uint16
    assert got.tolist() == [0, 0, 1, 100, 4094, 4095, 4095]


def test_a_single_radiance_is_digitised_as_in_an_array():
    for seed in (None, 1):
        made = [None if seed is None else np.random.default_rng(seed) for _ in range(2)]
        one = digitise(0.05, THESIS, THESIS.bands[0], generator=made[0])
        many = digitise(np.array([0.05]), THESIS, THESIS.bands[0], generator=made[1])
        assert (one.shape, one.dtype, one.item()) == ((), np.uint16, many[0])


def test_noise_is_as_large_as_it_says():
    band = THESIS.bands[2]
    sensor = replace(THESIS, bits=10, dark_current=2e4, read_noise=40.0)
    scene = np.full((400, 400), 0.05)
    got = digitise(scene, sensor, band, generator=np.random.default_rng(1)) * sensor.scale(band)
    expected = float(noise_equivalent_radiance(0.05, sensor, band))
    assert got.std() == pytest.approx(expected, rel=0.01)
    assert got.mean() == pytest.approx(0.05, abs=4 * expected / 400)


def test_noise_repeats_with_its_seed():
    scene = np.full((20, 20), 0.05)
    one, two, other = (digitise(scene, THESIS, THESIS.bands[0], generator=np.random.default_rng(s)) for s in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert not np.array_equal(one, other)


def test_a_band_is_averaged_up_to_the_end_of_the_tables():
    bands = [SensorBand(name=str(low), low=low, high=1040, full_scale=1.0) for low in (860.3, 990.0)]
    wavelength, mean = band_means(bands)
    assert wavelength.max() == 1000
    np.testing.assert_allclose(mean(wavelength), [(860.3 + 999.3) / 2, 995])


def test_delays_are_from_band_to_band():
    assert [b.time_offset for b in THESIS.bands[:3]] == [0.0, 0.06, 0.12]
    assert {b.time_offset for b in THESIS.delayed(0.0).bands} == {0.0}


@pytest.mark.parametrize(("size", "oversample"), [(33, 8), (65, 3), (3, 64), (129, 2)])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_a_quarter_of_the_mtf_gives_the_whole_psf(size, oversample, jitter):
    sensor = replace(THESIS, jitter=jitter)
    frequency = np.fft.fftfreq(size * oversample, 1 / oversample)
    fine = np.fft.ifft2(mtf(frequency[:, None], frequency[None, :], sensor, 660.0)).real * oversample**2
    whole = np.fft.fftshift(fine[::oversample, ::oversample])
    np.testing.assert_allclose(psf(sensor, 660.0, size=size, oversample=oversample), whole, rtol=0, atol=1e-14)


@pytest.mark.parametrize("factor", [2, 4, 5])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.3, -0.2)])
def test_observing_agrees_with_a_plain_transform(factor, shift):
    rows, columns = 24, 20
    sensor = replace(THESIS, jitter=0.1)
    scene = np.random.default_rng(0).random((rows * factor, columns * factor))
    got = observe(transform(scene), sensor, 545.0, factor=factor, shift=shift)
    r, c = np.meshgrid(
        np.fft.fftfreq(rows * factor, 1 / factor), np.fft.fftfreq(columns * factor, 1 / factor), indexing="ij"
    )
    middle = (factor - 1) / (2 * factor)  # of a pixel, from its first fine point
    phase = np.exp(2j * np.pi * (r * (middle + shift[0]) + c * (middle + shift[1])))
    seen = np.fft.ifft2(np.fft.fft2(scene) * mtf(r, c, sensor, 545.0) * phase).real[::factor, ::factor]
    np.testing.assert_allclose(got, seen, atol=1e-12)


def test_observing_a_spot_is_the_psf():
    factor = 9  # odd: a fine point lies in the middle of a pixel
    scene = np.zeros((34 * factor, 34 * factor))
    scene[16 * factor + 4, 16 * factor + 4] = factor**2
    got = observe(transform(scene), THESIS, 545.0, factor=factor)
    assert got.sum() == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(got[:33, :33], psf(THESIS, 545.0, size=33), atol=5e-6)


@pytest.mark.parametrize("name", PRESETS)
def test_observing_keeps_the_mean_and_ignores_the_threads(name):
    sensor = preset(name)
    scene = np.random.default_rng(0).random((64, 96), dtype=np.float32)
    one, two = (
        observe(transform(scene, workers=w), sensor, sensor.bands[0].wavelength, factor=4, workers=w) for w in (1, 2)
    )
    assert one.shape == (16, 24)
    assert one.mean() == pytest.approx(scene.mean(), rel=1e-6)
    np.testing.assert_array_equal(one, two)


def test_a_shift_looks_further_down_and_right():
    down, right = np.meshgrid(np.arange(64), np.arange(64), indexing="ij")
    scene = np.sin(2 * np.pi * down / 64) + np.cos(2 * np.pi * right / 32)
    still = observe(transform(scene), THESIS, 545.0, factor=4)
    moved = observe(transform(scene), THESIS, 545.0, factor=4, shift=(1.0, -2.0))
    np.testing.assert_allclose(moved, np.roll(still, (-1, 2), (0, 1)), atol=1e-12)


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: preset("landsat"), InputError, "is not one of thesis"),
        (lambda: THESIS.band("cirrus"), BandError, "it has COASTAL"),
        (lambda: replace(THESIS, pitch=8.0), InputError, "pitch ... 1e-07 to 0.001 m ... 8"),
        (lambda: replace(THESIS, bits=20), InputError, "bits must be 1 to 16"),
        (lambda: replace(THESIS, bits=11.5), InputError, "bits ... integer ... 11.5. Round it."),
        (lambda: replace(THESIS, dark_current=-1e9), InputError, "dark_current ... 0 to 1e+09 electrons/s"),
        (lambda: replace(THESIS, read_noise=-5.0), InputError, "read_noise ... 0 to 1e+09 electrons"),
        (lambda: replace(THESIS, smear=-0.5), InputError, "smear ... 0 to 1000 pixels ... -0.5"),
        (lambda: replace(THESIS, jitter=np.nan), InputError, "jitter must be a finite number"),
        (lambda: replace(GREEN, full_scale=0.0), InputError, "full_scale ... 1e-09 to"),
        (lambda: replace(GREEN, low=np.inf), InputError, "low ... 1 to 1e+06 nm ... inf"),
        (lambda: replace(GREEN, high=500), InputError, "band green must have low <= high ... 510, 500 nm"),
        (lambda: THESIS.exposure(replace(GREEN, high=GREEN.low)), InputError, "band green ... 0 nm wide"),
        (lambda: Sensor(name="x", bands=(), gsd=1.0, f_number=4.0, pitch=8e-6), BandError, "no bands"),
        (
            lambda: band_means([SensorBand(name="B11", low=1565, high=1655, full_scale=1.0)]),
            BandError,
            "leave them out",
        ),
        (
            lambda: observe(np.zeros((30, 16), complex), THESIS, 545.0, factor=4),
            InputError,
            "multiple of factor 4",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(make, error, words):
    with pytest.raises(error) as caught:
        make()
    assert says(str(caught.value), *words.split(" ... "))
    assert "\n" not in str(caught.value)
