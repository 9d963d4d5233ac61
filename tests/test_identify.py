"""Normalising and identifying glint against closed forms and brute force; noise in whole steps; tiles and holes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scipy.stats import norm

from deglint.compensate.chain import Sharpen, apply_stages
from deglint.compensate.codes import decoded, encoded
from deglint.compensate.identify import (
    FEWEST,
    MOST_COVER_FOR_NOISE,
    IdentifyLevel,
    IdentifyMedian,
    fit_identify_level,
    fit_identify_median,
    standing_out_of_outlines,
)
from deglint.compensate.normalise import Normalise, fit_normalise, water_level
from deglint.compensate.opening import rank_opening
from deglint.compensate.psf import kernel_psf
from deglint.compensate.replace import ReplaceLevel
from deglint.compensate.spread import CERTAIN_K, COVER_K, lower_spread
from deglint.compensate.state import State
from deglint.errors import FitError

OPEN = (np.inf, np.inf, np.inf)


def sea(shape=(90, 100), seed=0, cover=0.1, noise=2.0, step=0.0):
    """Three bands: level 50, 30 and 10, noise, and sparkle of single pixels drawn anew in each."""
    rng = np.random.default_rng(seed)
    block = np.array([50.0, 30.0, 10.0])[:, None, None] + rng.normal(0, noise, (3, *shape))
    block += np.where(rng.random(block.shape) < cover, rng.gamma(2.0, 40.0, block.shape), 0)
    return (np.rint(block / step) * step if step else block).astype(np.float32)


def all_of(block):
    return np.ones(block.shape[1:], bool)


def fitted(block, size=5, inside=None, **options):
    order = tuple(range(len(block)))
    options = {"order": order, "saturation": OPEN[: len(block)], "size": size} | options
    return fit_identify_level([State.of(block)], [all_of(block) if inside is None else inside], **options)


def hits(stage, block, where=None):
    state = State.of(block, where)
    stage.apply(state)
    return state.hit


# --------------------------------------------------------------------------------------------------- normalising


def test_normalising_divides_by_the_median_and_back_again():
    block = sea()
    stage = fit_normalise([b.ravel() for b in block])
    assert stage.levels == tuple(float(np.median(b)) for b in block)
    assert stage.robust == (False,) * 3
    state = State.of(block)
    stage.apply(state)
    np.testing.assert_allclose(state.image, block / np.array(stage.levels)[:, None, None], rtol=2e-7)
    np.testing.assert_array_equal(state.units, stage.levels)


def test_under_much_glint_the_mode_is_taken_where_that_is_asked_for():
    rng = np.random.default_rng(0)
    values = rng.normal(50, 1, 20_000) + np.where(rng.random(20_000) < 0.6, rng.gamma(3, 10.0, 20_000), 0)
    assert water_level(values) == (pytest.approx(50, abs=0.5), True)
    assert water_level(values, 1.0) == (float(np.median(values)), False)
    assert water_level(values)[0] < 55 < water_level(values, 1.0)[0] + 5
    calm = rng.normal(50, 1, 20_000)
    assert water_level(calm) == (float(np.median(calm)), False)


def test_a_level_that_is_not_positive_cannot_be_divided_by():
    with pytest.raises(FitError, match="band 2 has a level of -1 in deep water; normalising needs a positive one"):
        fit_normalise([np.ones(9), -np.ones(9)])


def test_a_level_goes_along_when_the_image_is_normalised():
    block = sea()
    stage, level = Normalise((50.0, 30.0, 10.0), (False,) * 3), fitted(block)
    state = State.of(block)
    level.apply(state)
    stage.apply(state)
    np.testing.assert_allclose(np.median(state.level, axis=(1, 2)), 1.0, rtol=0.02)
    ReplaceLevel().apply(state)
    assert (state.image < 2).all()


# ---------------------------------------------------------------------------------------------- the thesis' threshold


def test_threshold_is_the_median_and_k_lower_deviations():
    block = sea()
    stage = fit_identify_median([b.ravel() for b in block], OPEN, k=4.0)
    for band, threshold in zip(block.astype(np.float64), stage.thresholds, strict=True):
        m = np.median(band)
        assert threshold == pytest.approx(m + 4 * 1.4826 * np.median(m - band[band <= m]), rel=1e-6)
    np.testing.assert_array_equal(hits(stage, block), block > np.float32(stage.thresholds)[:, None, None])


def test_spread_of_whole_numbers_is_that_of_the_noise():
    """The distribution of rounded normal numbers is known exactly at the edges of the steps, and even between."""
    rng = np.random.default_rng(1)
    for sigma in (0.6, 0.8, 1.0, 1.3, 1.9, 2.6, 7.0):
        for middle in (50.0, 50.2, 50.5, 50.9):
            counts = np.rint(rng.normal(middle, sigma, 200_000))
            edges = np.arange(0, 101) + 0.5
            below = norm.cdf(edges, middle, sigma)
            median = np.interp(np.interp(middle, edges, below) / 2, below, edges)
            assert lower_spread(counts, middle, 1.0) == pytest.approx(1.4826 * (middle - median), rel=0.02)
            if sigma >= 1:
                assert 0.95 * sigma < lower_spread(counts, middle, 1.0) < 1.05 * np.hypot(sigma, 6**-0.5)
    smooth = rng.normal(50, 3, 200_000)
    assert lower_spread(smooth, 50.0) == pytest.approx(3, rel=0.01)
    assert lower_spread(np.full(99, 7.0), 7.0) == 0
    assert lower_spread(np.full(99, 7.0), 6.0) == 0


def test_spread_in_steps_is_the_quantile_of_boxes():
    values = np.array([1.0, 2, 2, 3, 3, 3, 4])
    edges, total = np.array([0.5, 1.5, 2.5, 3.5, 4.5]), np.array([0, 1, 3, 6, 7])
    half = np.interp(3.2, edges, total) / 2
    assert lower_spread(values, 3.2, 1.0) == pytest.approx(1.4826 * (3.2 - np.interp(half, total, edges)))


# ------------------------------------------------------------------------------------------- above the level beside


def told(band, grid):
    """A band as its level is told."""
    return decoded(encoded(band, *grid), *grid)


def test_offset_spread_and_cover_are_those_of_the_pixels_about_their_level():
    block = sea(shape=(300, 300), cover=0.08)
    stage = fitted(block)
    for b, band in enumerate(block):
        band = told(band, stage.grids[b])
        away = (band - rank_opening(band, 5, corners=True)).astype(np.float64)
        quiet = sea(shape=(300, 300), cover=0.0)[b]
        apart = (quiet - rank_opening(quiet, 5, corners=True)).astype(np.float64)
        assert stage.offsets[b] == pytest.approx(np.median(apart), abs=0.5)
        assert stage.sigmas[b] == pytest.approx(apart.std(), rel=0.25)
        assert stage.cover[b] == pytest.approx((away > stage.offsets[b] + COVER_K * stage.sigmas[b]).mean(), abs=1e-9)
        assert stage.cover[b] == pytest.approx(0.08, abs=0.015)
        assert stage.spectrum[b] == pytest.approx(away.mean(), rel=1e-9)
    level = rank_opening(told(block[0], stage.grids[0]), 5, corners=True) + np.float32(stage.offsets[0])
    np.testing.assert_array_equal(hits(stage, block)[0], block[0] > level + np.float32(1.5 * stage.sigmas[0]))


@pytest.mark.parametrize("noise", [0.7, 1.0, 1.4, 2.5])
@pytest.mark.parametrize("scale", [1.0, 3.7e-5])
def test_without_glint_hardly_anything_is_too_bright_for_noise(noise, scale):
    block = sea(shape=(250, 250), cover=0.0, noise=noise, step=1.0) * np.float32(scale)
    stage = fitted(block, size=13, floor=[0.75 * scale] * 3, steps=[scale] * 3)
    assert hits(replace(stage, k=CERTAIN_K), block).mean(axis=(1, 2)).max() < 1e-4
    assert max(stage.cover) < 0.02
    assert all(0.8 * noise < s / scale < 1.1 * np.hypot(noise, 6**-0.5) for s in stage.sigmas)
    share = hits(stage, block).mean()
    assert share == pytest.approx(norm.sf(1.5), abs=0.05)  # the noise that is flagged, and no more


def test_the_floor_holds_where_nothing_varies():
    flat = np.full((3, 40, 40), 7.0, np.float32)
    stage = fitted(flat, floor=[0.5, 1.0, 2.0])
    assert stage.sigmas == (0.5, 1.0, 2.0)
    assert stage.cover == stage.offsets == (0.0, 0.0, 0.0)
    assert not hits(stage, flat).any()
    assert not hits(fitted(flat), flat).any()


def test_too_few_pixels_are_refused_in_one_line():
    block = sea(shape=(7, 9))
    with pytest.raises(FitError, match=f"63 pixels of deep water near each other, need {FEWEST}") as error:
        fitted(block)
    assert "\n" not in str(error.value)
    with pytest.raises(FitError):
        fitted(np.full((3, 40, 40), np.nan, np.float32))
    with pytest.raises(FitError):
        fitted(sea(shape=(1, 1)))


def test_detail_is_left_out_under_heavy_glint():
    assert fitted(sea(), detail=3).detail == 3
    rng = np.random.default_rng(0)
    heavy = (50 + rng.gamma(1.0, 40.0, (3, 90, 90))).astype(np.float32)
    assert fitted(heavy, size=13, detail=11).detail == 0


def test_saturated_pixels_are_glint_even_after_dividing():
    rng = np.random.default_rng(0)
    for full in (4095.0, 4095 * 2.44e-5, 0.1, 1 / 3):
        for level in rng.uniform(0.01, 3, 20) * full:
            block = np.full((1, 1, 9), full, np.float32)
            block[0, 0, 1::2] *= np.float32(0.999)
            state = State.of(block)
            Normalise((float(level),), (False,)).apply(state)
            IdentifyMedian((1e9,), (float(full),)).apply(state)
            np.testing.assert_array_equal(state.hit[0, 0], block[0, 0] >= np.float32(full))


def test_bands_that_are_not_looked_at_stay_and_order_does_not_matter():
    block = sea()
    stage = fitted(block, bands=(2, 0))
    assert stage.bands == (0, 2)
    assert fitted(block, bands=(0, 2, 2)) == stage
    state = State.of(block)
    stage.apply(state)
    assert not state.hit[1].any()
    assert np.isnan(state.level[1]).all()
    full = fitted(block)
    assert (stage.offsets, stage.sigmas) == ((full.offsets[0], full.offsets[2]), (full.sigmas[0], full.sigmas[2]))


@pytest.mark.parametrize("kind", ["median", "level"])
def test_only_what_may_be_changed_and_is_valid_is_hit(kind):
    block = sea()
    block[:, 20:30, 40:60] = np.nan
    block[1, 5, 5] = np.nan
    where = np.random.default_rng(1).random(block.shape[1:]) < 0.5
    values = [b[np.isfinite(b)] for b in block]
    stage = fit_identify_median(values, OPEN) if kind == "median" else fitted(block)
    found = hits(stage, block, where)
    assert not found[:, ~where].any()
    assert not found[np.isnan(block)].any()
    np.testing.assert_array_equal(found, hits(stage, block) & where)


@settings(max_examples=15)
@given(factor=st.floats(1e-6, 1e6), power=st.integers(-20, 20))
def test_scaling(factor, power):
    block = sea(shape=(50, 60))
    plain = fitted(block)
    exact = fitted(block * np.float32(2.0**power))
    assert exact.sigmas == tuple(s * 2.0**power for s in plain.sigmas)
    np.testing.assert_array_equal(hits(exact, block * np.float32(2.0**power)), hits(plain, block))
    scaled = fitted(block * np.float32(factor))
    np.testing.assert_allclose(np.array(scaled.sigmas) / factor, plain.sigmas, rtol=0.02)
    assert (hits(scaled, block * np.float32(factor)) != hits(plain, block)).mean() < 0.01


def test_band_permutation():
    block = sea()
    turn = [2, 0, 1]
    plain = fitted(block, detail=3)
    turned = fitted(block[turn], detail=3, order=tuple(turn.index(b) for b in range(3)))
    np.testing.assert_array_equal(hits(turned, block[turn]), hits(plain, block)[turn])


def test_a_thing_larger_than_the_element_is_no_glint_and_a_flash_is():
    rng = np.random.default_rng(0)
    block = (50 + rng.normal(0, 1, (3, 80, 80))).astype(np.float32)
    block[:, 30:48, 30:48] += 40
    block[1, 10, 10] += 40
    stage = fitted(block, size=13)
    found = hits(stage, block)
    assert found[1, 10, 10]
    assert found[:, 30:48, 30:48].mean() < 0.2  # its noise, as everywhere, and more of it at its edge
    thesis = fit_identify_median([b.ravel() for b in block], OPEN)
    assert hits(thesis, block)[:, 30:48, 30:48].all()


@settings(max_examples=15)
@given(data=st.data())
@pytest.mark.parametrize("detail", [0, 3])
def test_tiles_are_the_whole_to_the_bit(detail, data):
    shape = data.draw(st.sampled_from([(60, 71), (8, 130)]))
    block = sea(shape, seed=data.draw(st.integers(0, 3)))
    block[:, np.random.default_rng(2).random(shape) < data.draw(st.sampled_from([0.0, 0.05]))] = np.nan
    stage = fitted(block, size=5, detail=detail)
    (r0, r1), (c0, c1) = (sorted(data.draw(st.lists(st.integers(0, n), min_size=2, max_size=2))) for n in shape)
    top, left, halo = max(r0 - stage.halo, 0), max(c0 - stage.halo, 0), stage.halo
    if r1 == r0 or c1 == c0:
        return
    part = hits(stage, block[:, top : r1 + halo, left : c1 + halo])[:, r0 - top :, c0 - left :]
    np.testing.assert_array_equal(part[:, : r1 - r0, : c1 - c0], hits(stage, block)[:, r0:r1, c0:c1])


def test_a_sample_in_parts_says_what_the_whole_says():
    block = sea(shape=(80, 120))
    halo = IdentifyLevel(5, 0, (0,), (0,), ((0.0, 1.0),), (1.0,), (0.0,), (1.0,), (0.0,), OPEN).halo
    states, inside = [], []
    for c in range(0, 120, 40):
        left = max(c - halo, 0)
        states.append(State.of(block[:, :, left : c + 40 + halo]))
        mask = np.zeros(states[-1].image.shape[1:], bool)
        mask[:, c - left : c - left + 40] = True
        inside.append(mask)
    parts = fit_identify_level(states, inside, size=5, order=(0, 1, 2), saturation=OPEN)
    whole = fitted(block)
    assert (parts.offsets, parts.sigmas, parts.cover) == (whole.offsets, whole.sigmas, whole.cover)


def test_the_image_is_not_touched_by_looking():
    block = sea()
    before = block.copy()
    state = State.of(block)
    fitted(block).apply(state)
    np.testing.assert_array_equal(state.image, before)
    np.testing.assert_array_equal(block, before)
    assert ndimage.label(state.hit[0])[1] > 100


def plateau(height=400.0, side=40, shape=(160, 160), seed=0):
    """Even water at 100 with a bright thing of one height, and shot noise; three bands, each its own."""
    rng = np.random.default_rng(seed)
    level = np.full(shape, 100.0)
    level[60 : 60 + side, 60 : 60 + side] = height
    return (level + np.sqrt(level) * rng.standard_normal((3, *shape))).astype(np.float32), level


def test_a_bright_thing_does_not_sink_by_its_own_noise():
    """Noise is twice as large on it. With that of the water for it, an opening lies 2 deviations too low there."""
    block, _ = plateau()
    stage = fitted(block, size=13)
    sunk = []
    for told in (stage, replace(stage, growths=(), share=0.0)):
        state = State.of(block)
        told.apply(state)
        ReplaceLevel().apply(state)
        sunk.append(400 - state.image[:, 67:93, 67:93].mean())
    assert sunk[0] < 4 < 15 < sunk[1]  # of 20, a deviation there; clipping noise alone takes 0.03 deviations
    flash = block.copy()
    flash[1, 80, 80] += 200
    assert hits(stage, flash)[1, 80, 80]


def test_growth_counts_less_the_more_glint_there_is():
    """Sparkle passes for noise, and grows with the level itself; what was glint before is no rarer afterwards."""
    block, _ = plateau()
    plain, some = fitted(block, size=13), fitted(block, size=13, cover_before=0.15)
    told = 1 - float(np.median(plain.cover)) / MOST_COVER_FOR_NOISE
    assert told > 0.9
    np.testing.assert_allclose(np.array(some.growths) * told, 0.5 * np.array(plain.growths), rtol=1e-6)
    assert plain.share > some.share == 0.0
    assert fitted(block, size=13, cover_before=MOST_COVER_FOR_NOISE).growths == ()


def test_what_grows_grows_from_the_water_s_level_on_and_ends_with_what_was_seen():
    """Against the definition, pixel by pixel, however the level is put to use."""
    block, _ = plateau(seed=2)
    stage = replace(fitted(block, size=5), growths=((0.002, 0.5), (0.01, 9.0), (0.0, 0.0)), share=0.05)
    bare = replace(stage, offsets=(0.0,) * 3, growths=(), share=0.0)
    state, plain = State.of(block), State.of(block)
    stage.apply(state)
    bare.apply(plain)
    for b, (slope, most) in enumerate(stage.growths):
        above = np.maximum(plain.level[b] - stage.grids[b][0], 0)
        noise = 1 + np.minimum(slope * above, most)
        level = plain.level[b] + stage.offsets[b] * noise
        hit = block[b] > level + stage.k * stage.sigmas[b] * noise + 0.05 * above
        assert (state.hit[b] != hit).mean() < 1e-4  # but for rounding
        np.testing.assert_allclose(state.level[b], level, rtol=1e-5)
    fused = State.of(block)
    stage.apply(fused)
    ReplaceLevel().apply(fused)
    apart = State.of(block, np.ones(block.shape[1:], bool))
    stage.apply(apart)
    ReplaceLevel().apply(apart)
    np.testing.assert_array_equal(fused.image, apart.image)
    np.testing.assert_array_equal(fused.replaced, state.hit)


def test_where_glint_is_rare_the_top_of_a_blurred_thing_is_no_glint():
    """16 pixels wide, and blurred: its top is hardly wider than the element, and sinks by a part of its height."""
    rng = np.random.default_rng(5)
    level = np.full((200, 200), 100.0)
    for row in (60, 140):
        level[row : row + 16, 90:106] = 500.0
    block = (ndimage.gaussian_filter(level, 1.0) + rng.normal(0, 2, (3, 200, 200))).astype(np.float32)
    block[0, 150:156, 30:36] += 50
    block[0, 68, 98] += 200
    stage = fitted(block, size=13)
    assert 0 < stage.share < 0.2
    found, without = hits(stage, block), hits(replace(stage, share=0.0), block)
    tops = np.zeros(level.shape, bool)
    tops[ndimage.binary_erosion(level > 400, np.ones((9, 9)))] = True
    assert found[1:, tops].mean() < 0.1 < 0.5 < without[1:, tops].mean()
    assert found[0, 150:156, 30:36].all()  # in open water nothing has changed
    assert found[0, 68, 98]  # and what is brighter than a fifth of the thing is a flash on it
    assert fitted(sea(cover=0.3), size=5).share == 0.0


def test_bands_that_are_left_lend_their_outlines():
    """A disc that only just holds the element: alone, a band loses its edge; beside others it keeps it."""
    rng = np.random.default_rng(6)
    rows, columns = np.mgrid[:120, :120]
    disc = (rows - 60) ** 2 + (columns - 60) ** 2 < 8.2**2
    block = (100 + 400 * disc + rng.normal(0, 2, (5, 120, 120))).astype(np.float32)
    order, saturation = tuple(range(5)), (np.inf,) * 5
    stage = fitted(block, size=13, detail=13, bands=(2,), left=(0, 1, 3, 4), order=order, saturation=saturation)
    assert (stage.bands, stage.left) == ((0, 1, 2, 3, 4), (0, 1, 3, 4))
    alone = fitted(block, size=13, detail=13, bands=(2,), order=order, saturation=saturation)
    assert (alone.bands, alone.left) == ((2,), ())
    found, lost = hits(stage, block), hits(alone, block)
    assert not found[[0, 1, 3, 4]].any()
    assert found[2][disc].mean() < 0.5 * lost[2][disc].mean()


def test_a_thing_whose_outline_is_kept_adds_nothing_that_an_opening_takes():
    """A disc that holds no square, and flashes that a single band sees; the last band is the NIR."""
    rng = np.random.default_rng(9)
    rows, columns = np.mgrid[:200, :200]
    disc = (rows - 60) ** 2 + (columns - 60) ** 2 < 7.7**2
    block = (100 + 400 * disc * np.array([1, 1, 1, 0])[:, None, None] + rng.normal(0, 2, (4, 200, 200))).astype(
        np.float32
    )
    block[1, 100:200:20, 100:200:20] += 300
    options = {"size": 13, "saturation": (np.inf,) * 4, "nir": 3}
    stage = fitted(block, detail=13, **options)
    assert max(stage.things[:3]) > 100
    glint, things = standing_out_of_outlines(stage, [State.of(block)], [all_of(block)], 3)
    assert max(things) < 0.01
    far = ~ndimage.binary_dilation(disc, np.ones((3, 3)), iterations=11)
    assert glint[1] == pytest.approx(25 * 300**2 / stage.sigmas[1] ** 2 / far.sum(), rel=0.04)
    assert max(glint[0], *glint[2:]) < 0.01
    without = fitted(block, **options)  # without outlines it is what the fit tells
    told = standing_out_of_outlines(without, [State.of(block)], [all_of(block)], 3)
    np.testing.assert_allclose(told, (without.glint, without.things), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("sharp", [False, True])
def test_outlines_are_looked_for_again_only_where_they_were_found(sharp):
    """Discs that hold no square; a second opening keeps them as it would alone, and takes one that comes later."""
    rng = np.random.default_rng(8)
    rows, columns = np.mgrid[:200, :200]
    disc = (rows - 60) ** 2 + (columns - 60) ** 2 < 7.7**2
    block = (100 + 400 * disc + rng.normal(0, 2, (5, 200, 200))).astype(np.float32)
    psfs = (kernel_psf([[0, 1, 0], [1, 20, 1], [0, 1, 0]]),) * 5
    first, second = (fitted(block, size=n, detail=n, saturation=(np.inf,) * 5) for n in (13, 11))
    state = apply_stages(State.of(block), [*([Sharpen(psfs, 1)] if sharp else []), first, ReplaceLevel()])
    assert state.outlined[disc].mean() > 0.9
    assert not state.outlined[~ndimage.binary_dilation(disc, iterations=2)].any()
    late = np.roll(disc, (90, 80), (0, 1))
    image = state.image + 400 * late.astype(np.float32)

    def opened(outlined):
        left = State.of(image)
        left.outlined = outlined
        return apply_stages(left, [second, ReplaceLevel()])

    near = ndimage.binary_dilation(disc, iterations=6)
    some, every, none = (opened(o) for o in (state.outlined, None, np.zeros_like(disc)))
    assert not some.replaced[:, disc].any()
    np.testing.assert_array_equal(some.image[:, disc], every.image[:, disc])
    np.testing.assert_array_equal(some.image[:, ~near], none.image[:, ~near])
    assert some.replaced[:, late].mean() > 0.9 > 0.1 > every.replaced[:, late].mean()
    np.testing.assert_array_equal(opened(np.ones_like(disc)).image, every.image)
