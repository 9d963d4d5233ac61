"""Local RX: published figures, the spectral package, brute force over every ring, and what must not spoil it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_info, threadpool_limits

from deglint.errors import InputError
from deglint.tiles import Tile
from detect import local
from detect.local import BORDERS, CELL, DEFICIENT, TOO_FEW, WindowRule, local_rx, score_part

from ..common import SHARED, beside, image_of


def brute(image, inner, outer, border="shrink", ddof=1, ridge=0.0, good=None):
    """Every ring as it is defined, gathered pixel by pixel, by the singular values of its pixels.

    Also the share that rounding may change where the covariance itself is formed: eps times its condition.
    """
    _, rows, columns = image.shape
    good = np.isfinite(image).all(axis=0) if good is None else good
    out, sway = np.full((rows, columns), np.nan), np.zeros((rows, columns))
    for r, c in np.argwhere(good):
        ring = np.array([image[:, i, j] for i, j in ring_of(r, c, rows, columns, inner, outer, border) if good[i, j]])
        if len(ring) < 2:
            continue
        away = image[:, r, c] - ring.mean(axis=0)
        x = ring - ring.mean(axis=0)
        x = np.vstack([x, np.diag(np.sqrt(ridge * (x**2).sum(axis=0)))])
        _, values, vectors = np.linalg.svd(x, full_matrices=False)
        kept = values > 1e-9 * values[0]
        out[r, c] = (len(ring) - ddof) * ((vectors[kept] @ away / values[kept]) ** 2).sum()
        sway[r, c] = 2e-16 * (values[0] / values[kept][-1]) ** 2 if kept.any() else 0
    return out, sway


def check(found, image, *window, **options):
    """Hold scores against the definition."""
    expected, sway = brute(image, *window, **options)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    off = np.abs(found / expected - 1)
    assert np.nanmax(off - 100 * sway, initial=0) < 1e-8


def ring_of(r, c, rows, columns, inner, outer, border):
    def line(at, size, side):
        first = at - side // 2
        if border == "shift":
            first = min(max(first, 0), size - side)
        return range(first, first + side)

    def fold(at, size):
        return -1 - at if at < 0 else 2 * size - 1 - at if at >= size else at

    guard_rows, guard_columns = line(r, rows, inner), line(c, columns, inner)
    for i in line(r, rows, outer):
        for j in line(c, columns, outer):
            if i in guard_rows and j in guard_columns:
                continue
            if border == "mirror":
                yield fold(i, rows), fold(j, columns)
            elif 0 <= i < rows and 0 <= j < columns:
                yield i, j


@pytest.mark.slow
@beside("hyperspectral")
@pytest.mark.parametrize(
    ("name", "outer", "inner", "published"),
    [("abu-airport-2", 19, 15, "0.98207"), ("abu-urban-1", 11, 5, "0.99691"), ("abu-beach-1", 17, 13, "0.99936")],
)
def test_the_published_areas_are_reproduced(name, outer, inner, published):
    """Mirrored border, covariance divided by the pixels, pseudo-inverse: rings have fewer pixels than bands."""
    from scipy.io import loadmat
    from sklearn.metrics import roc_auc_score

    scene = loadmat(SHARED / "hyperspectral" / f"{name}.mat")
    image, truth = np.ascontiguousarray(scene["data"].transpose(2, 0, 1)), scene["map"].astype(bool)
    flags = np.zeros(truth.shape, np.uint8)
    scores = local_rx(
        image.astype(np.float64), inner=inner, outer=outer, border="mirror", ddof=0, flags=flags, threads=2
    )
    assert f"{roc_auc_score(truth.ravel(), scores.ravel()):.5f}" == published
    assert (flags == DEFICIENT).all()


def test_blas_has_no_threads_of_its_own_meanwhile_and_gets_them_back(monkeypatch):
    """A ring's matrices are small: threads of BLAS waited for each other, seven times as long as one takes."""

    def counts():
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    def told(*arguments):
        seen.append(counts())
        return work(*arguments)

    many = image_of(local.SUMS_BANDS + 1)
    local_rx(many, inner=1, outer=3)  # loads what has threads
    seen, work = [], local._score_cell
    monkeypatch.setattr(local, "_score_cell", told)
    with threadpool_limits(2, user_api="blas"):
        before = counts()
        assert set(before) == {2}
        local_rx(many, inner=1, outer=3, threads=2)
        assert counts() == before
    assert seen == [[1] * len(before)]


@pytest.mark.parametrize("bands", [1, 2, 4, 7, 30])
@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize(("inner", "outer"), [(1, 3), (3, 7), (5, 13)])
def test_is_its_definition(bands, border, inner, outer):
    image = image_of(bands, 20, 23)
    check(local_rx(image, inner=inner, outer=outer, border=border), image, inner, outer, border)


@pytest.mark.parametrize(("ddof", "ridge"), [(0, 0.0), (1, 0.1), (0, 1.0)])
@pytest.mark.parametrize("bands", [3, 30])
def test_divisor_and_ridge(bands, ddof, ridge):
    image = image_of(bands, 15, 16)
    found = local_rx(image, inner=3, outer=9, ddof=ddof, ridge=ridge)
    check(found, image, 3, 9, ddof=ddof, ridge=ridge)


def test_as_the_spectral_package():
    """Its windows move inside at the border."""
    import spectral

    image = image_of(6, 40, 45)
    theirs = spectral.rx(image.transpose(1, 2, 0), window=(5, 15))
    np.testing.assert_allclose(local_rx(image, inner=5, outer=15, border="shift"), theirs, rtol=1e-6)
    inside = slice(7, -7)
    np.testing.assert_allclose(local_rx(image, inner=5, outer=15)[inside, inside], theirs[inside, inside], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("bands", [3, 30])
@given(data=st.data())
@settings(max_examples=8)
def test_tiles_are_the_whole_to_the_bit(bands, data):
    border = data.draw(st.sampled_from(BORDERS))
    inner = data.draw(st.sampled_from([1, 3, 5]))
    outer = inner + 2 * data.draw(st.integers(1, 4))
    size = (CELL + 13, CELL + 40) if bands == 3 else (CELL + 9, 20)
    image = image_of(bands, *size).astype(np.float32)
    image[:, ::7, ::5] = np.nan
    mask = np.random.default_rng(1).random(size) < (0.9 if bands == 3 else 0.05)
    whole_flags = np.zeros(size, np.uint8)
    whole = local_rx(image, inner=inner, outer=outer, border=border, mask=mask, flags=whole_flags)
    rule = WindowRule(inner, outer, size, border)
    scene = Tile(0, size[0], 0, size[1])
    for part in scene.split(CELL):
        held = part.grown(rule.halo, *size)
        outside, own = held.within(scene), part.within(scene)
        tile, flags = score_part(image[outside], rule, held, part, mask[outside])
        np.testing.assert_array_equal(tile, whole[own])
        np.testing.assert_array_equal(flags, whole_flags[own])
    np.testing.assert_array_equal(local_rx(image, inner=inner, outer=outer, border=border, mask=mask, threads=3), whole)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("bands", [3, 30])
def test_nodata_and_mask_are_as_if_removed(bands, border):
    image = image_of(bands, 24, 22)
    mask = np.random.default_rng(0).random((24, 22)) < 0.8
    mask[:9, :9] = False
    spoilt = np.where(mask, image, -9999.0)
    spoilt[1, 20] = np.nan
    flags = np.zeros((24, 22), np.uint8)
    scores = local_rx(spoilt, inner=3, outer=9, border=border, mask=mask, flags=flags)
    check(scores, spoilt, 3, 9, border, good=mask & np.isfinite(spoilt[1]))
    assert not flags[np.isnan(scores) & ~mask].any()


def test_one_extreme_pixel_touches_only_the_rings_that_hold_it():
    image = image_of(3, 60, 60)
    clean = local_rx(image, inner=5, outer=11)
    image[:, 30, 30] = 1e30
    scores = local_rx(image, inner=5, outer=11)
    rows, columns = np.mgrid[:60, :60]
    away = np.maximum(abs(rows - 30), abs(columns - 30))
    outside = (away > 5) | ((away <= 2) & (away > 0))  # beyond the window, or with the pixel inside the guard
    np.testing.assert_array_equal(scores[outside], clean[outside])
    assert scores[30, 30] > 1e30


@pytest.mark.parametrize("offset", [1e6, 1e8])
def test_a_large_offset_costs_what_rounding_the_pixels_costs(offset):
    image = image_of(4, 30, 30) + offset
    check(local_rx(image, inner=3, outer=11), image - offset, 3, 11)


def test_a_step_inside_the_window_keeps_its_digits():
    image = image_of(4, 30, 30)
    image[:, :, 15:] += np.array([1e6, 3e5, 1e4, 1e5])[:, None, None]
    check(local_rx(image, inner=3, outer=11), image, 3, 11)


def test_a_target_where_most_of_the_cell_is_far_away():
    image = np.random.default_rng(0).normal(0.05, 0.0005, (1, 24, 30)).astype(np.float32)
    image[0, 12, 6] += 0.006
    image[0, :, 12:] = -9999
    found = local_rx(image, inner=3, outer=7)
    np.testing.assert_array_equal(found[:, :9], local_rx(image[:, :, :12], inner=3, outer=7)[:, :9])
    assert found[12, 6] > 50


def test_constant_band_is_as_if_dropped():
    image = image_of(4)
    more = np.insert(image, 1, 1e8 + 0.1, axis=0)
    flags = np.zeros(image.shape[1:], np.uint8)
    found = local_rx(more, inner=3, outer=9, flags=flags)
    np.testing.assert_allclose(found, local_rx(image, inner=3, outer=9), rtol=1e-9)
    assert (flags == DEFICIENT).all()


def test_collinear_bands_are_as_if_dropped():
    image = image_of(4)
    more = np.concatenate([image, image[:1] - 2 * image[3:]])
    flags = np.zeros(image.shape[1:], np.uint8)
    found = local_rx(more, inner=3, outer=9, flags=flags)
    np.testing.assert_allclose(found, local_rx(image, inner=3, outer=9), rtol=1e-7)
    assert (flags == DEFICIENT).all()


def test_a_pixel_off_its_rings_subspace_takes_the_pseudo_inverse():
    """The ring says nothing of a direction in which it does not vary."""
    image = image_of(3, 20, 20)
    image[2] = 5.0
    image[2, 10, 10] = 9.0
    check(local_rx(image, inner=3, outer=9), image, 3, 9)


@pytest.mark.parametrize("bands", [8, 40])
def test_fewer_pixels_than_bands(bands):
    image = image_of(bands, 12, 12)
    flags = np.zeros((12, 12), np.uint8)
    check(local_rx(image, inner=1, outer=3, flags=flags), image, 1, 3)
    assert (flags[1:-1, 1:-1] == DEFICIENT).all()


def test_too_few_pixels_have_no_score():
    image = np.full((2, 9, 9), np.nan)
    image[:, 4, 4] = 1
    image[:, 4, 6] = 2
    flags = np.zeros((9, 9), np.uint8)
    assert np.isnan(local_rx(image, inner=1, outer=5, flags=flags)).all()
    assert flags[4, 4] == flags[4, 6] == TOO_FEW
    assert np.count_nonzero(flags) == 2


@pytest.mark.parametrize("ddof", [8, 20])
def test_a_ring_of_no_more_pixels_than_ddof_has_no_score(ddof):
    assert np.isnan(local_rx(image_of(3, 9, 9), inner=1, outer=3, ddof=ddof)).all()


@pytest.mark.parametrize("factor", [1e-9, 1e9])
def test_units_do_not_matter(factor):
    image = image_of(4) * np.array([1, 1e-6, 1e3, 1])[:, None, None]
    np.testing.assert_allclose(local_rx(image * factor, inner=3, outer=9), local_rx(image, inner=3, outer=9), rtol=1e-7)
    scaled = image / np.array([1, 1e-6, 1e3, 1])[:, None, None]
    np.testing.assert_allclose(local_rx(scaled, inner=3, outer=9), local_rx(image, inner=3, outer=9), rtol=1e-7)


def test_scores_of_other_types_are_those_of_float64():
    image = (image_of(3) * 100).astype(np.int16)
    as_float = local_rx(image.astype(np.float64), inner=3, outer=9)
    assert as_float.dtype == np.float64
    for dtype in (np.int16, np.float32):
        found = local_rx(image.astype(dtype), inner=3, outer=9)
        np.testing.assert_array_equal(found, as_float.astype(np.float32))
        assert found.dtype == np.float32


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 1)])
def test_an_image_of_one_row_column_or_pixel_is_scored(shape):
    image = np.random.default_rng(0).normal(size=(2, *shape))
    check(local_rx(image, inner=1, outer=9), image, 1, 9)


def test_wrong_windows_borders_and_numbers_are_refused():
    image = image_of()
    for inner, outer in ((2, 5), (3, 6), (5, 5), (7, 5), (-1, 3)):
        with pytest.raises(InputError, match="want odd sides"):
            local_rx(image, inner=inner, outer=outer)
    with pytest.raises(InputError, match="not one of shrink, mirror, shift"):
        local_rx(image, inner=3, outer=5, border="nonsense")
    for border in ("mirror", "shift"):
        with pytest.raises(InputError, match=r"not fit.*40 x 50"):
            local_rx(image, inner=3, outer=41, border=border)
    for value in (1e200, -np.finfo(np.float64).max):
        extreme = image.astype(np.float64)
        extreme[0, 20, 20] = value
        with pytest.raises(InputError, match="beyond double precision"):
            local_rx(extreme, inner=3, outer=5)
        assert np.isfinite(local_rx(extreme, inner=3, outer=5, mask=np.abs(extreme[0]) < 1e9)).sum() > 1000
    with pytest.raises(InputError, match="flags: want a uint8"):
        local_rx(image, inner=3, outer=5, flags=np.zeros((2, 2), np.uint8))
    with pytest.raises(InputError, match="ridge"):
        local_rx(image, inner=3, outer=5, ridge=np.nan)
    with pytest.raises(InputError, match="ddof: want a number from 0"):
        local_rx(image, inner=3, outer=5, ddof=-1)


def test_both_ways_agree():
    """Sums over windows, and the ring's pixels one by one."""
    image = image_of(local.SUMS_BANDS, 30, 30).astype(np.float32)
    direct = local_rx(np.concatenate([image, image_of(1, 30, 30, 9).astype(np.float32) * 0 + 1]), inner=3, outer=13)
    np.testing.assert_allclose(local_rx(image, inner=3, outer=13), direct, rtol=1e-5)


@pytest.mark.parametrize("border", ["shrink", "mirror"])
@pytest.mark.parametrize(("window", "ridge"), [((5, 13), 0.0), ((1, 3), 0.0), ((3, 9), 0.1)])
def test_a_flat_region(border, window, ridge):
    """A region that is flat in all bands or all but one, and one bright pixel: equal to the pseudo-inverse."""
    rng = np.random.default_rng(0)
    image = rng.normal(size=(4, 30, 28)) + 10
    image[:, 6:26, 4:22] = 5
    image[3, 14:20, 10:16] += rng.normal(size=(6, 6))
    image[:, 11, 8] += np.arange(4)
    flags = np.zeros((30, 28), np.uint8)
    found = local_rx(image, inner=window[0], outer=window[1], border=border, ridge=ridge, flags=flags)
    expected, _ = brute(image, *window, border, ridge=ridge)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
    assert np.count_nonzero(flags == DEFICIENT) > 20


def test_rings_one_by_one_keep_their_digits():
    """A band that follows from others but for its rounding to five digits, against the ring's singular values."""
    image = image_of(4, 24, 24).astype(np.float32).astype(np.float64)
    image[3] = np.round(image[0] + image[1], 5)
    flags = np.zeros((24, 24), np.uint8)
    scores = local_rx(image, inner=3, outer=9, flags=flags)
    np.testing.assert_allclose(scores, brute(image, 3, 9)[0], rtol=1e-6)
    assert not flags.any()
