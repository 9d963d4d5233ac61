"""Point spread functions and sharpening, against closed forms, brute force and other programs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint.compensate.psf import kernel_psf, system_psf
from deglint.compensate.sharpen import FORMS, SLAB, richardson_lucy, sharpen_halo
from deglint.errors import InputError
from deglint.physics.presets import preset
from deglint.physics.sensor import mtf

GREEN = system_psf(545.0, f_number=10, pitch=8e-6)
WIDE = system_psf(832.5, f_number=30, pitch=8e-6)
LOPSIDED = kernel_psf([[0, 1, 0], [2, 8, 4], [0, 3, 1]])
DELTA = kernel_psf([[1.0]])
LOCAL = ("separable", "fir")


@pytest.fixture
def sea():
    """Sparkle and holes: (150, 97) float32."""
    rng = np.random.default_rng(3)
    band = rng.gamma(0.3, 200.0, (150, 97)).astype(np.float32) + 40
    band[30:37, 50:61] = np.nan
    band[0, 0], band[149, 40], band[80, 3] = np.nan, np.inf, -np.inf
    band[100, 20:23] = 0, -5, 1e-6
    return band


# ------------------------------------------------------------------------------------------------- the system's PSF


@pytest.mark.parametrize(
    ("f_number", "centre", "in_track", "cross", "nine"),
    [(10, 0.722, 0.048, 0.030, 0.916), (30, 0.169, 0.096, 0.095, 0.753)],
)
def test_shares_of_a_point_are_those_of_independent_optics(f_number, centre, in_track, cross, nine):
    psf = system_psf(545.0, f_number=f_number, pitch=8e-6)
    half = len(psf.wide) // 2
    got = psf.wide[half, half], psf.wide[half - 1, half], psf.wide[half, half - 1]
    assert got == pytest.approx((centre, in_track, cross), abs=6e-4)
    three = system_psf(545.0, f_number=f_number, pitch=8e-6, size=3)
    assert 1 - three.truncated == pytest.approx(nine, abs=6e-4)
    assert three.kernel.shape == (3, 3)


@pytest.mark.parametrize("wavelength", [425.0, 545.0, 950.0])
@pytest.mark.parametrize("name", ["thesis", "thesis-f30", "worldview3", "micasense"])
def test_transform_is_the_mtf(name, wavelength):
    """Sampling folds the MTF: the transform of the samples is the sum of its copies, one sampling frequency apart."""
    sensor = preset(name)
    psf = system_psf(wavelength, f_number=sensor.f_number, pitch=sensor.pitch, smear=sensor.smear)
    side = len(psf.wide)
    frequency = np.fft.fftfreq(side)
    copies = np.arange(-12, 13)
    wanted = sum(
        mtf(frequency[:, None] + r, frequency[None, :] + c, sensor, wavelength) for r in copies for c in copies
    )
    got = np.fft.fft2(np.fft.ifftshift(psf.wide))
    assert np.abs(got - wanted).max() < 1e-9
    if name == "thesis-f30" and wavelength == 950.0:  # nothing passes half the sampling frequency: no copies
        assert np.abs(got - mtf(frequency[:, None], frequency[None, :], sensor, wavelength)).max() < 2e-3


def test_truncated_light_falls_as_one_over_the_radius():
    """Outside radius R of an Airy pattern lies 2 Q / (pi**2 R); outside a square of that half side .9003 of it."""
    blur = 545e-9 * 10 / 8e-6
    for radius in (8, 12, 16):
        psf = system_psf(545.0, f_number=10, pitch=8e-6, size=2 * radius + 1)
        assert psf.truncated == pytest.approx(0.9003 * 2 * blur / (np.pi**2 * (radius + 0.5)), rel=0.05)


@pytest.mark.parametrize("psf", [GREEN, WIDE], ids=["green", "wide"])
def test_kernels_sum_to_one(psf):
    assert psf.kernel.sum() == pytest.approx(1.0, abs=1e-12)
    assert psf.wide.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(psf.kernel, psf.kernel[::-1, ::-1], atol=1e-12)


def test_kernels_are_no_larger_than_need_be():
    assert GREEN.truncated <= 0.03
    assert system_psf(545.0, f_number=10, pitch=8e-6, size=2 * GREEN.radius - 1).truncated > 0.03
    assert WIDE.kernel.shape == (21, 21)
    assert WIDE.truncated > 0.03
    assert WIDE.numbers()["truncated"] == WIDE.truncated


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_factors_are_the_nearest_products(rank):
    """Nearest but for the scale: what is missing is the next singular value (Eckart and Young)."""
    got = sum(np.outer(*pair) for pair in GREEN.factors(rank))
    assert got.sum() == pytest.approx(1.0, abs=1e-12)
    values = np.linalg.svd(GREEN.kernel, compute_uv=False)
    nearest = got * (np.linalg.svd(GREEN.kernel)[1][0] / np.linalg.norm(got, 2))
    assert np.linalg.norm(GREEN.kernel - nearest, 2) == pytest.approx(values[rank], rel=1e-6)
    assert 0.02 < GREEN.inseparable < 0.03


def test_a_product_is_its_own_factors():
    exact = kernel_psf(np.outer([1, 2, 1], [1, 5, 2]))
    ((down, across),) = exact.factors()
    np.testing.assert_allclose(np.outer(down, across), exact.kernel, atol=1e-15)
    assert down.min() > 0
    assert exact.inseparable < 1e-12


def test_iterations_by_blur():
    assert [system_psf(545.0, f_number=f, pitch=8e-6).iterations for f in (2.8, 10, 21, 30)] == [2, 2, 3, 4]
    assert {system_psf(b.wavelength, f_number=10, pitch=8e-6).iterations for b in preset("thesis").bands} == {2}
    assert {system_psf(b.wavelength, f_number=30, pitch=8e-6).iterations for b in preset("thesis").bands} == {4}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: system_psf(545.0, f_number=0, pitch=8e-6), "f_number must be 0.7 to 200"),
        (lambda: system_psf(545.0, f_number=10, pitch=8.0), "8e-6 is 8 micrometres"),
        (lambda: system_psf(0.545, f_number=10, pitch=8e-6), "wavelength must be 100 to 20000 nm"),
        (lambda: system_psf(545.0, f_number=10, pitch=8e-6, size=8), "odd"),
        (lambda: system_psf(545.0, f_number=None, pitch=8e-6), "f_number must be a number, not below 0, got None"),
        (lambda: system_psf(545.0, f_number=np.nan, pitch=8e-6), "got nan"),
        (lambda: system_psf(545.0, f_number=10, pitch=8e-6, smear=-1), "smear must be a number, not below 0, got -1"),
        (lambda: richardson_lucy(np.ones((2, 2)), GREEN, iterations=2.5), "whole number"),
        (lambda: richardson_lucy(np.ones((2, 2)), GREEN, pedestal=np.nan), "pedestal must be a finite number"),
        (lambda: kernel_psf([[1, 1]]), "odd side"),
        (lambda: kernel_psf([[0, -1, 0], [0, 3, 0], [0, 0, 0]]), "nowhere negative"),
        (lambda: kernel_psf([[np.nan]]), "finite"),
        (lambda: kernel_psf([]), "finite"),
        (lambda: richardson_lucy(np.ones((2, 2, 2)), GREEN), "(row, column)"),
        (lambda: richardson_lucy(np.ones((2, 2)), GREEN, form="cubic"), "separable, fir, fft"),
        (lambda: richardson_lucy(np.ones((2, 2)), GREEN, iterations=-1), "0 to 20"),
        (lambda: richardson_lucy(np.ones((2, 2)), GREEN, rank=4), "1, 2 or 3"),
    ],
)  # fmt: skip
def test_refusals_are_one_clear_line(call, words):
    with pytest.raises(InputError) as error:
        call()
    assert words in str(error.value)
    assert "\n" not in str(error.value)


# ---------------------------------------------------------------------------------------------------- sharpening


def brute_force(y, kernel, iterations):
    """The definition in float64: the image mirrored, sums over valid pixels, pixel by pixel."""
    half = len(kernel) // 2
    halo = 2 * iterations * half
    y = np.pad(np.asarray(y, np.float64), halo, mode="reflect")
    valid = np.isfinite(y)

    def mean(values, k):
        out = np.zeros_like(values)
        share = np.zeros_like(values)
        for i in range(-half, half + 1):
            for j in range(-half, half + 1):
                moved = np.roll(values * valid, (-i, -j), axis=(0, 1))
                out += k[half + i, half + j] * moved
                share += k[half + i, half + j] * np.roll(valid, (-i, -j), axis=(0, 1))
        return out / np.where(share < 1e-3, 1.0, share)

    y = np.where(valid, np.maximum(np.nan_to_num(y), 1e-30), 0.0)
    a = y.copy()
    for _ in range(iterations):
        ratio = np.where(valid, np.clip(y / np.maximum(mean(a, kernel[::-1, ::-1]), 1e-30), 1e-3, 1e3), 0.0)
        a *= np.maximum(mean(ratio, kernel), 1e-3)
    return np.where(valid, a, np.nan)[halo:-halo, halo:-halo] if halo else a


@pytest.mark.parametrize("psf", [GREEN, LOPSIDED, WIDE], ids=["green", "lopsided", "wide"])
def test_is_the_definition(sea, psf):
    part = sea[20:70, 30:97]
    wanted = brute_force(part, psf.kernel, 2)
    got = richardson_lucy(part, psf, iterations=2, form="fir")
    np.testing.assert_allclose(got, wanted, rtol=2e-4)
    for rank in (1, 2, 3):
        product = sum(np.outer(*pair) for pair in psf.factors(rank))
        wanted = brute_force(part, product, 2)
        np.testing.assert_allclose(richardson_lucy(part, psf, iterations=2, rank=rank), wanted, rtol=5e-4)
    whole = kernel_psf(psf.kernel)
    wanted = brute_force(part, whole.kernel, 2)
    np.testing.assert_allclose(richardson_lucy(part, whole, iterations=2, form="fft"), wanted, rtol=2e-3)


def test_is_that_of_scikit_image_away_from_the_edges():
    """scikit-image starts from a constant; so does the definition here, and the steps are the same."""
    from skimage.restoration import richardson_lucy as theirs

    rng = np.random.default_rng(1)
    image = rng.gamma(0.5, 100.0, (60, 60)) + 20
    # its first step from a constant c gives P^T(y / c) c = P^T y, so that n + 1 of its steps are n of ours from P^T y
    start = np.full_like(image, 0.5)
    for _ in range(3):
        start = start * _blurred(image / _blurred(start, GREEN.kernel), GREEN.kernel)
    several = theirs(image, GREEN.kernel, num_iter=3, clip=False)
    inner = slice(20, -20), slice(20, -20)
    np.testing.assert_allclose(several[inner], start[inner], rtol=1e-6)
    # and with the image as start its step is ours
    step = image * _blurred(image / _blurred(image, GREEN.kernel), GREEN.kernel)
    ours = richardson_lucy(image, GREEN, iterations=1, form="fir")
    np.testing.assert_allclose(ours[inner], step[inner], rtol=1e-5)


def _blurred(image, kernel):
    from scipy.ndimage import convolve

    return convolve(image, kernel, mode="mirror")


@pytest.mark.parametrize("form", FORMS)
def test_a_point_and_a_plain_stay_what_they_are(form):
    plain = np.full((40, 30), 7.0, np.float32)
    np.testing.assert_allclose(richardson_lucy(plain, GREEN, form=form), plain, rtol=3e-6)
    rng = np.random.default_rng(0)
    image = rng.random((40, 30)).astype(np.float32) + 0.1
    np.testing.assert_allclose(richardson_lucy(image, DELTA, form=form), image, rtol=3e-6)
    np.testing.assert_array_equal(richardson_lucy(image, GREEN, form=form, iterations=0), image)


@pytest.mark.parametrize("form", FORMS)
def test_light_is_kept_and_gathered(form):
    """Sparkles in the dark: the sum stays, the middle pixel comes near to holding all of it."""
    image = np.full((64, 64), 1e-4)
    image[16::32, 16::32] = 1.0
    seen = _blurred(image, GREEN.kernel)
    sharp = richardson_lucy(seen, GREEN, form=form)
    assert sharp.sum(dtype=float) == pytest.approx(seen.sum(), rel=0.01)
    assert seen[16, 16] < 0.76
    assert sharp[16, 16] > 0.82
    assert sharp.min() > 0


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("psf", [GREEN, WIDE], ids=["green", "wide"])
def test_missing_pixels_stay_and_do_not_spread(sea, form, psf):
    before = sea.copy()
    out = richardson_lucy(sea, psf, form=form)
    np.testing.assert_array_equal(sea, before)
    np.testing.assert_array_equal(out[~np.isfinite(sea)], sea[~np.isfinite(sea)])
    assert np.isfinite(out[np.isfinite(sea)]).all()
    assert out.dtype == np.float32


@pytest.mark.parametrize("form", FORMS)
def test_a_plain_with_holes_stays_plain(form):
    plain = np.full((50, 50), 3.0, np.float32)
    plain[10:20, 10:40] = np.nan
    plain[30, 30] = np.nan
    np.testing.assert_allclose(richardson_lucy(plain, WIDE, form=form), plain, rtol=1e-5)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 1), (3, 4), (0, 5)])
def test_images_smaller_than_the_kernel(form, shape):
    out = richardson_lucy(np.full(shape, 12, np.uint16), WIDE, form=form)
    np.testing.assert_allclose(out, np.full(shape, 12.0), rtol=1e-5)
    nothing = np.full(shape, np.nan, np.float32)
    np.testing.assert_array_equal(richardson_lucy(nothing, WIDE, form=form), nothing)


@pytest.mark.parametrize("form", FORMS)
def test_pedestal_is_added_and_taken_off(sea, form):
    band = np.nan_to_num(sea, posinf=0, neginf=0) - 45
    lifted = richardson_lucy(band + np.float32(64), GREEN, form=form)
    np.testing.assert_allclose(richardson_lucy(band, GREEN, form=form, pedestal=64.0), lifted - 64, atol=1e-2)


def test_large_numbers_keep_their_digits():
    image = np.full((30, 30), 1e8, np.float32)
    image[10, 10] = 2e8
    small = richardson_lucy(image / np.float32(2**20), GREEN) * np.float32(2**20)
    np.testing.assert_array_equal(richardson_lucy(image, GREEN), small)


@settings(max_examples=25)
@given(data=st.data())
@pytest.mark.parametrize("form", LOCAL)
@pytest.mark.parametrize("psf", [GREEN, LOPSIDED, WIDE], ids=["green", "lopsided", "wide"])
def test_tiles_are_the_whole_to_the_bit(form, psf, data):
    rng = np.random.default_rng(data.draw(st.integers(0, 3)))
    shape = data.draw(st.sampled_from([(90, 131), (33, 300), (200, 7)]))
    band = rng.gamma(0.3, 200.0, shape).astype(np.float32) - 3
    band[rng.random(shape) < data.draw(st.sampled_from([0.0, 0.01, 0.5]))] = np.nan
    whole = richardson_lucy(band, psf, form=form, iterations=2, pedestal=1.0)
    halo = sharpen_halo(psf, 2)
    (r0, r1), (c0, c1) = (sorted(data.draw(st.lists(st.integers(0, n), min_size=2, max_size=2))) for n in shape)
    top, left = max(r0 - halo, 0), max(c0 - halo, 0)
    tile = richardson_lucy(band[top : r1 + halo, left : c1 + halo], psf, form=form, iterations=2, pedestal=1.0)
    np.testing.assert_array_equal(tile[r0 - top :, c0 - left :][: r1 - r0, : c1 - c0], whole[r0:r1, c0:c1])


@pytest.mark.parametrize("form", LOCAL)
def test_slabs_do_not_show(form, monkeypatch):
    rng = np.random.default_rng(5)
    band = rng.gamma(0.3, 200.0, (2 * SLAB + 5, 40)).astype(np.float32)
    band[SLAB - 3 : SLAB + 2, 4:9] = np.nan
    in_slabs = richardson_lucy(band, GREEN, form=form)
    monkeypatch.setattr("deglint.compensate.sharpen.SLAB", 10_000)
    np.testing.assert_array_equal(in_slabs, richardson_lucy(band, GREEN, form=form))
