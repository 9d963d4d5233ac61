"""Correlation with sums of columns times rows, against brute force, and its vectors; sharpening is in test_psf.py."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint.compensate.level import blurred
from deglint.compensate.products import Products, by_products, products
from deglint.compensate.psf import kernel_psf, system_psf

GREEN = system_psf(545.0, f_number=10, pitch=8e-6)
LOPSIDED = kernel_psf([[0, 1, 0], [2, 8, 4], [0, 3, 1]])


def sums(radius, *, even, count=2, seed=0):
    """Some products that no PSF has, and their sum."""
    rng = np.random.default_rng(seed)
    taps = rng.random((count, 2, 2 * radius + 1)) + 0.1
    taps = taps + taps[..., ::-1] if even else taps
    kernel = sum(np.outer(down, across) for down, across in taps)
    taps[:, 0] /= kernel.sum()
    factors = np.zeros((2, count + count % 2, 2 * radius + 1))
    factors[:, :count] = np.swapaxes(taps, 0, 1)
    both = np.stack([factors[..., ::-1], factors]).astype(np.float32)
    return Products(both, not even), kernel / kernel.sum()


def convolved(band, kernel):
    """The definition in float64: the mean over valid pixels under the kernel, the image mirrored."""
    radius = len(kernel) // 2
    wide = np.pad(np.asarray(band, np.float64), radius, mode="reflect")
    valid = np.isfinite(wide)
    windows = [np.lib.stride_tricks.sliding_window_view(a, kernel.shape) for a in (np.where(valid, wide, 0), valid)]
    total, share = (np.einsum("ijkl,kl->ij", w, kernel[::-1, ::-1]) for w in windows)
    return np.where(np.isfinite(band) & (share >= 1e-3), total / np.where(share < 1e-3, 1, share), np.nan)


def everything(band):
    return (0, band.shape[0]), (0, band.shape[1])


@pytest.fixture
def sea():
    """Sparkle and holes: (60, 97) float32."""
    rng = np.random.default_rng(3)
    band = rng.gamma(0.3, 200.0, (60, 97)).astype(np.float32) + 40
    band[20:27, 50:61] = np.nan
    band[0, 0], band[59, 40], band[50, 3] = np.nan, np.inf, -np.inf
    return band


@pytest.mark.parametrize("even", [True, False], ids=["even", "lopsided"])
@pytest.mark.parametrize("radius", [0, 1, 2, 3, 7, 10, 11, 14])
def test_correlation_is_the_definition(sea, radius, even):
    """Radii above 10 are summed in a loop."""
    for count in (1, 2, 3):
        kernels, kernel = sums(radius, even=even, count=count, seed=count)
        found = by_products(sea, kernels, 0, everything(sea))
        np.testing.assert_allclose(found, convolved(sea, kernel), rtol=3e-6)
        np.testing.assert_allclose(
            by_products(sea[:20], kernels, 0, everything(sea[:20])), convolved(sea[:20], kernel), rtol=3e-6
        )


@pytest.mark.parametrize("iterations", [0, 1, 2])
@pytest.mark.parametrize("even", [True, False], ids=["even", "lopsided"])
def test_in_a_loop_it_is_the_same_to_the_bit(sea, even, iterations):
    kernels, _ = sums(4, even=even)
    padded = Products(np.pad(kernels.taps, [(0, 0)] * 3 + [(8, 8)]), kernels.lopsided)  # radius 12, taps of 0
    filled = np.pad(sea, 64, mode="reflect")
    window = (70, 100), (70, 131)
    np.testing.assert_array_equal(*(by_products(filled, k, iterations, window) for k in (kernels, padded)))


@pytest.mark.parametrize("psf", [GREEN, LOPSIDED], ids=["green", "lopsided"])
@pytest.mark.parametrize("iterations", [0, 2])
@pytest.mark.parametrize("holes", [0.0, 0.02], ids=["whole", "holes"])
def test_every_width_is_the_whole_to_the_bit(psf, iterations, holes):
    rng = np.random.default_rng(1)
    band = rng.gamma(0.3, 200.0, (70, 170)).astype(np.float32)
    band[rng.random(band.shape) < holes] = np.nan
    kernels = products(psf)
    whole = by_products(band, kernels, iterations, everything(band))
    reach = max(2 * iterations, 1) * psf.radius
    for width in range(1, 71):
        height, top, left = width % 23 + 1, 5 + width % 13, 3 + 7 * width % 31
        ends = [(max(a - reach, 0), min(a + n + reach, size))
                for a, n, size in zip((top, left), (height, width), band.shape, strict=True)]  # fmt: skip
        tile = band[slice(*ends[0]), slice(*ends[1])]
        at = (top - ends[0][0], top + height - ends[0][0]), (left - ends[1][0], left + width - ends[1][0])
        found = by_products(tile, kernels, iterations, at)
        np.testing.assert_array_equal(found, whole[top : top + height, left : left + width])
        within = by_products(band, kernels, iterations, ((top, top + height), (left, left + width)))
        np.testing.assert_array_equal(found, within)


@settings(max_examples=30)
@given(widest=st.integers(1, 90), shape=st.tuples(st.integers(1, 40), st.integers(1, 90)), iterations=st.integers(0, 3))
def test_columns_at_a_time_do_not_show(widest, shape, iterations):
    rng = np.random.default_rng(shape)
    band = rng.gamma(0.3, 200.0, shape).astype(np.float32)
    band[rng.random(shape) < 0.01] = np.nan
    at_once = by_products(band, products(GREEN), iterations, everything(band))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("deglint.compensate.products.WIDEST", widest)
        np.testing.assert_array_equal(by_products(band, products(GREEN), iterations, everything(band)), at_once)


@pytest.mark.parametrize("iterations", [0, 2])
@pytest.mark.parametrize("psf", [GREEN, LOPSIDED], ids=["green", "lopsided"])
def test_a_hole_changes_nothing_out_of_reach(psf, iterations):
    """Not by a bit: a tile without the hole would not know of it."""
    band = np.random.default_rng(2).gamma(0.3, 200.0, (50, 120)).astype(np.float32)
    plain = by_products(band, products(psf), iterations, everything(band), sound=True)
    np.testing.assert_array_equal(by_products(band, products(psf), iterations, everything(band)), plain)
    band[:, 100] = np.nan
    reach = max(2 * iterations, 1) * psf.radius
    found = by_products(band, products(psf), iterations, everything(band))
    np.testing.assert_array_equal(found[:, : 100 - reach], plain[:, : 100 - reach])
    assert (found[:, 100 - reach : 100] != plain[:, 100 - reach : 100]).any()


def test_what_is_not_finite_stays_or_is_missing(sea):
    hollow = ~np.isfinite(sea)
    np.testing.assert_array_equal(by_products(sea, products(GREEN), 2, everything(sea))[hollow], sea[hollow])
    level = blurred(sea, GREEN)
    np.testing.assert_array_equal(np.isnan(level), hollow)
    negative = np.where(hollow, np.nan, -sea)  # a level may be below 0, and sharpened pixels are not
    np.testing.assert_allclose(blurred(negative, GREEN), -level, rtol=1e-6)


@pytest.mark.parametrize("iterations", [0, 1])
def test_any_array_will_do_and_none_is_modified(iterations):
    rng = np.random.default_rng(4)
    band = rng.integers(1, 4000, (40, 50)).astype(np.float32)
    wanted = by_products(band, products(GREEN), iterations, everything(band))
    fixed = band.copy()
    fixed.flags.writeable = False
    for other in (band.astype(np.uint16), band.astype(np.float64), np.asfortranarray(band), fixed,
                  np.repeat(band, 2, axis=1)[:, ::2], band[::-1, ::-1].copy()[::-1, ::-1]):  # fmt: skip
        before = other.copy()
        np.testing.assert_array_equal(by_products(other, products(GREEN), iterations, everything(band)), wanted)
        np.testing.assert_array_equal(other, before)
    room = np.full((2, 40, 50), -1, np.float32)
    assert by_products(band, products(GREEN), iterations, everything(band), out=room[1]) is not None
    np.testing.assert_array_equal(room[1], wanted)
    assert (room[0] == -1).all()
    assert by_products(band, products(GREEN), iterations, ((3, 3), (0, 50))).shape == (0, 50)
    assert by_products(band, products(GREEN), iterations, ((0, 9), (5, 5))).shape == (9, 0)


def test_blurred_goes_where_it_is_told():
    band = np.random.default_rng(5).random((30, 41)).astype(np.float32)
    out = np.empty((20, 11), np.float32)
    found = blurred(band, GREEN, ((4, 24), (9, 20)), out=out)
    assert np.shares_memory(found, out)
    np.testing.assert_array_equal(out, blurred(band, GREEN)[4:24, 9:20])


# ------------------------------------------------------------------------------------------------------- vectors


def test_vectors_are_float32_arithmetic():
    import numba as nb

    from deglint.compensate._lanes import (
        LANES,
        fused,
        if_more,
        if_same,
        larger,
        load,
        over,
        plus,
        smaller,
        store,
        times,
        turn,
    )

    @nb.njit
    def run(a, b, c, out):
        x, y, z = load(a, 0), load(b, 0), load(c, 0)
        store(out, 0, plus(x, y))
        store(out, LANES, times(x, y))
        store(out, 2 * LANES, over(x, y))
        store(out, 3 * LANES, fused(x, y, z))
        store(out, 4 * LANES, larger(x, y))
        store(out, 5 * LANES, smaller(x, y))
        store(out, 6 * LANES, if_same(x, y, z, x))
        store(out, 7 * LANES, if_more(x, y, z, x))

    @nb.njit
    def transpose(a, out):
        turn(a, 1, LANES + 3, out, 2, LANES + 5)

    rng = np.random.default_rng(6)
    a, b, c = rng.standard_normal((3, LANES)).astype(np.float32)
    a[:4], b[:4] = (1 + 2**-12, np.nan, 2, 3), (1 + 2**-12, 5, 2, np.nan)
    c[0] = -1
    out = np.zeros((8, LANES), np.float32)
    run(a, b, c, out)
    exact = a.astype(np.float64) * b + c  # products of float32 are float64, to the last bit
    wanted = [a + b, a * b, a / b, exact.astype(np.float32), np.where(a > b, a, b), np.where(a < b, a, b),
              np.where(a == b, c, a), np.where(a > b, c, a)]  # fmt: skip
    np.testing.assert_array_equal(out, wanted)
    assert out[3, 0] == np.float32(2**-11 + 2**-24)
    square = rng.random((LANES, LANES + 3)).astype(np.float32)
    turned = np.zeros((LANES + 1, LANES + 5), np.float32)
    transpose(square, turned)
    np.testing.assert_array_equal(turned[:LANES, 2 : 2 + LANES], square[:, 1 : 1 + LANES].T)
    assert np.count_nonzero(turned) == LANES**2


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_all_taps_find_room_beside_the_smallest_image(rank):
    wide = system_psf(832.5, f_number=30, pitch=8e-6)
    band = np.array([[3.0, np.nan], [5.0, 7.0]], np.float32)
    found = by_products(band, products(wide, rank), 1, everything(band))
    large = by_products(np.pad(band, ((42, 300),), mode="reflect"), products(wide, rank), 1, ((42, 44), (42, 44)))
    np.testing.assert_array_equal(found, large)
