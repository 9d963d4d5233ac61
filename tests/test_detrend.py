"""The local mean, or plane, that is subtracted before slopes are fitted."""

import numpy as np
import pytest

from deglint.morphology import box_sum
from deglint.remove.detrend import detrend, detrend_plane


def oracle(block, mask, size):
    """The definition, pixel by pixel, in float64."""
    half = size // 2
    sample = mask & np.isfinite(block).all(axis=0)
    out = np.full(block.shape, np.nan)
    for r, c in zip(*np.nonzero(sample), strict=True):
        square = (slice(max(r - half, 0), r + half + 1), slice(max(c - half, 0), c + half + 1))
        for b in range(len(block)):
            x = block[b].astype(np.float64)
            out[b, r, c] = x[r, c] - x[square][sample[square]].mean()
    return out


@pytest.fixture
def block(rng):
    block = rng.normal(5, 2, (3, 30, 41))
    block[1, 3:6, 7:20] = np.nan
    block[0, 25, 40] = np.inf
    return block


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.mark.parametrize("size", [3, 5, 9, 15, 31, 61])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_is_the_definition(block, rng, size, dtype):
    block = block.astype(dtype)
    mask = rng.random(block.shape[1:]) < 0.6
    before = block.copy(), mask.copy()
    result = detrend(block, mask, size)
    np.testing.assert_allclose(result, oracle(block, mask, size), rtol=0, atol=1e-12)
    assert result.dtype == np.float64
    np.testing.assert_array_equal(block, before[0])
    np.testing.assert_array_equal(mask, before[1])


def test_nan_in_one_band_leaves_the_pixel_out_of_all(block):
    result = detrend(block)
    np.testing.assert_array_equal(np.isnan(result), ~np.isfinite(block).all(axis=0) & np.ones((3, 1, 1), bool))


def test_tiles_are_the_whole_to_the_bit(block, rng):
    mask = rng.random(block.shape[1:]) < 0.7
    whole = detrend(block, mask, 9)
    halo = 9 // 2
    for r0 in range(0, 30, 8):
        for c0 in range(0, 41, 11):
            top, left = max(r0 - halo, 0), max(c0 - halo, 0)
            part = np.s_[top : r0 + 8 + halo, left : c0 + 11 + halo]
            tile = detrend(block[(slice(None), *part)], mask[part], 9)
            crop = tile[:, r0 - top :, c0 - left :][:, :8, :11]
            np.testing.assert_array_equal(crop, whole[:, r0 : r0 + 8, c0 : c0 + 11])


def test_a_huge_offset_does_not_drown_the_waves(rng):
    waves = rng.normal(size=(1, 400, 50))
    np.testing.assert_allclose(detrend(waves + 1e8), detrend(waves), rtol=0, atol=1e-6)


def test_one_extreme_pixel_leaves_no_trace_beyond_its_square(rng):
    block = rng.normal(size=(1, 60, 60))
    hot = block.copy()
    hot[0, 10, 10] = 1e15
    a, b = detrend(block, size=9), detrend(hot, size=9)
    np.testing.assert_array_equal(a[:, 20:], b[:, 20:])
    np.testing.assert_array_equal(a[:, :, 20:], b[:, :, 20:])


def test_slow_colour_does_not_leak_into_the_slope(rng):
    """A visible band that is 0.8 glint plus a ramp that follows the glint's own ramp."""
    row, column = np.mgrid[:200, :200] / 200
    nir = 5 + column + rng.normal(0, 0.3, (200, 200))
    green = 3 + 0.8 * nir + 4 * column - 2 * row
    y, x = detrend(np.stack([green, nir]), size=15).reshape(2, -1)
    assert np.polyfit(nir.ravel(), green.ravel(), 1)[0] > 2
    assert (x @ y) / (x @ x) == pytest.approx(0.8, abs=0.01)


def test_empty_and_single():
    assert np.isnan(detrend(np.ones((2, 4, 4)), np.zeros((4, 4), bool))).all()
    np.testing.assert_array_equal(detrend(np.full((2, 1, 1), 3.0)), 0.0)
    assert detrend(np.zeros((2, 0, 5))).shape == (2, 0, 5)
    np.testing.assert_array_equal(detrend(np.arange(9).reshape(1, 3, 3), size=3)[0, 1], [-0.5, 0, 0.5])


def test_plane_leaves_no_gradient_where_the_sample_is_cut_off(rng):
    down, right = np.indices((40, 50), np.float64)
    sample = (right < 20 + down / 4) & (rng.random((40, 50)) < 0.8)
    gradient = (1e6 + 3 * down - 5 * right)[None]
    assert np.nanmax(np.abs(detrend(gradient, sample))) > 10  # a mean leaves it
    assert np.nanmax(np.abs(detrend_plane(gradient, sample))) < 0.05  # the ridge leaves a little


def test_plane_is_least_squares_and_the_mean_in_full_squares(rng):
    block, sample = rng.normal(1e6, 2, (2, 30, 41)), np.ones((30, 41), bool)
    found = detrend_plane(block, sample, 9)
    np.testing.assert_allclose(found[:, 4:-4, 4:-4], detrend(block, sample, 9)[:, 4:-4, 4:-4], rtol=0, atol=1e-7)
    down, right = (place.ravel() for place in np.mgrid[-4:5, :5])  # around the pixel at the left edge
    variables = np.stack([np.ones(45), down, right], axis=1)
    values = block[:, 8:17, :5].reshape(2, -1)
    plane = np.linalg.lstsq(variables, values.T, rcond=None)[0]
    np.testing.assert_allclose(found[:, 12, 0], block[:, 12, 0] - plane[0], rtol=0, atol=1e-3)  # of the ridge


def test_plane_of_float32_is_that_of_float64(rng):
    block = (1e4 + rng.normal(0, 2, (1, 30, 41))).astype(np.float32)
    sample = rng.random((30, 41)) < 0.7
    np.testing.assert_array_equal(detrend_plane(block, sample), detrend_plane(block.astype(np.float64), sample))


def test_of_a_pixel_alone_its_plane_leaves_nothing():
    sample = np.zeros((20, 20), bool)
    sample[4, 5] = True
    found = detrend_plane(np.full((1, 20, 20), 7.5), sample, 5)
    assert found[0, 4, 5] == 0
    assert np.isnan(found).sum() == 399


@pytest.mark.parametrize("kind", ["uint8", "uint16", "int16", "int32", "float32", "float64"])
def test_sums_of_squares_of_pixels_hold_what_their_type_does_not(kind):
    found = box_sum(np.full((5, 7), 200, kind), 15)
    assert np.unique(found).tolist() == [5 * 7 * 200]
