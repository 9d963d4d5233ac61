"""The Wiener filter on the NIR: kernels, colour, level, references, strips, tiles, and scenes with truth."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import correlate, gaussian_filter

from deglint import Recipe, correct, fit_scene, open_scene, remove, remove_glint
from deglint.errors import FitError, InputError
from deglint.physics.presets import preset
from deglint.pipeline import correct as correcting
from deglint.raster.simulated import write_scene
from deglint.remove import BandFit, GlintIndex, GlintModel, SampleTile, nir_request, wiener
from deglint.remove.kernels import _within_chance, offsets
from deglint.remove.levels import LevelSample, shared_level, shared_level_error
from deglint.remove.predict import glint
from deglint.remove.reference import ReferenceRule, clean, fit_reference
from deglint.remove.spectrum import slopes_of_glint, spectra
from deglint.remove.strips import Strips, filled
from deglint.scene import Band
from deglint.simulate import Setup, simulate

from .common import SHARED, WATER, says, whole_tile

BANDS = (Band("BLUE", 480.0), Band("GREEN", 545.0), Band("RED", 660.0), Band("NIR", 840.0))
SLOPES = np.array([1.05, 1.0, 0.95, 1.0])[:, None, None]


def waves(shape=(192, 256), seed=0, strength=60.0):
    """Glint of a swell, never negative, and the water's own slow changes."""
    rng = np.random.default_rng(seed)
    return np.exp(gaussian_filter(rng.normal(size=shape), 1.5) * 3) * strength


def swell_block(shape=(192, 256), seed=0, noise=1.0, strength=60.0):
    rng = np.random.default_rng(seed + 100)
    block = WATER + SLOPES * waves(shape, seed, strength) + noise * rng.normal(size=(4, *shape))
    return block.astype(np.float32)


def fitted(block, bands=BANDS, **options):
    return remove.fit("wiener", block, nir=3, bands=bands, **options)


def kernel_of(model, band):
    index = model.indexes[band]
    out = np.zeros((5, 5))
    for (row, column), weight in zip(index.offsets, index.weights, strict=True):
        out[row + 2, column + 2] = weight * model.fits[band].slope
    return out


def test_a_known_kernel_is_recovered_within_its_noise():
    block, true = swell_block(), np.array([[0.0, 0.1, 0.0], [0.3, 0.4, -0.1], [0.0, 0.2, 0.1]])
    block[0] = 900 + correlate(block[3] - 100.0, true) + np.random.default_rng(1).normal(size=block[0].shape)
    found = kernel_of(fitted(block), 0)
    np.testing.assert_allclose(found[1:4, 1:4], true, atol=0.02)


def test_a_shift_by_whole_pixels_is_undone():
    block = swell_block(noise=0.0)
    block[1] = 700 + np.roll(block[3] - 100, (1, -1), (0, 1))
    out = remove.apply(block, fitted(block))
    assert out[1, 3:-3, 3:-3].std() < 0.02 * block[1].std()


def test_one_pixel_and_raw_statistics_are_hedley(monkeypatch):
    monkeypatch.setattr(wiener.kernels, "SUPPORTS", ((1,),))
    block = swell_block(noise=5.0)
    request = nir_request(BANDS, [3], regression="ols")
    every = np.ones(block.shape[1:], bool)
    model = wiener.fit(request, [SampleTile(block[:, r : r + 64, c : c + 64], every[:64, :64], every[:64, :64], (r, c))
                                 for r in range(0, 192, 64) for c in range(0, 256, 64)])  # fmt: skip
    y, x = block[:3, 2:-2, 2:-2].astype(float), block[3, 2:-2, 2:-2].astype(float)
    mean = block.astype(float).mean(axis=(1, 2))
    expected = [((b - m) * (x - mean[3])).sum() / ((x - mean[3]) ** 2).sum() for b, m in zip(y, mean, strict=False)]
    assert [i.offsets for i in model.indexes] == [((0, 0),)] * 3
    assert [f.slope for f in model.fits] == pytest.approx(expected, rel=0.01)


def test_without_glint_nothing_is_changed():
    rng = np.random.default_rng(2)
    block = (WATER + rng.normal(0, 5, (4, 192, 192))).astype(np.float32)
    model = fitted(block)
    assert model.fits == ()
    np.testing.assert_array_equal(remove.apply(block, model), block)


def test_a_constant_band_has_no_noise_that_could_be_removed():
    block = swell_block()
    block[:3] = WATER[:3]
    model = fitted(block)
    assert model.fits == ()
    assert "explains 0.0%" in model.warnings[0]


def test_a_band_that_is_darker_under_glint_has_the_slope_0_and_is_not_changed():
    block, rng = swell_block(), np.random.default_rng(5)
    block[1] = 700 - 0.5 * (block[3] - 100) + rng.normal(size=block[1].shape)
    model = fitted(block)
    clean = remove.apply(block, model)
    assert [f.slope > 0.9 for f in model.fits] == [True, False, True]
    assert model.fits[1].slope == 0.0
    np.testing.assert_array_equal(clean[1], block[1])
    assert clean[0].std() < 0.1 * block[0].std()
    alone = fitted(block, correct=[0, 2])
    assert model.level_interval == pytest.approx(alone.level_interval, rel=1e-3)
    assert [model.fits[k].slope for k in (0, 2)] == pytest.approx([f.slope for f in alone.fits], rel=1e-4)


@pytest.mark.parametrize("factor", [1e-4, 1.0, 1e3])
def test_the_unit_does_not_matter(factor):
    block = swell_block()
    one, other = fitted(block), fitted((block * np.float32(factor)).astype(np.float32))
    assert [f.slope for f in one.fits] == pytest.approx([f.slope for f in other.fits], rel=1e-4)
    assert one.indexes[0].level * factor == pytest.approx(other.indexes[0].level, rel=1e-3)


def test_the_order_of_bands_does_not_matter():
    block, order = swell_block(), [2, 0, 1, 3]
    moved = fitted(block[order], tuple(BANDS[b] for b in order))
    np.testing.assert_allclose(remove.apply(block[order], moved), remove.apply(block, fitted(block))[order], rtol=1e-4)
    by_name = fitted(block).for_bands(tuple(BANDS[b].name for b in order))
    np.testing.assert_allclose(
        remove.apply(block[order], by_name), remove.apply(block, fitted(block))[order], rtol=1e-6
    )


def test_missing_pixels_stay_missing_and_teach_nothing():
    block = swell_block()
    holes = np.zeros(block.shape[1:], bool)
    holes[50:60, 50:60] = True
    dirty = block.copy()
    dirty[1, holes] = np.nan
    model = fitted(dirty)
    assert [f.slope for f in model.fits] == pytest.approx([f.slope for f in fitted(block).fits], rel=0.01)
    out = remove.apply(dirty, model)
    np.testing.assert_array_equal(np.isnan(out[1]), holes)
    assert np.isfinite(out[[0, 2, 3]]).all()


def test_the_colour_of_glint_steadies_a_noisy_band():
    """A band without a visible swell of its own is drawn to the colour that the others show."""
    block = swell_block((128, 128), noise=2.0, strength=20.0)
    block[2] += np.random.default_rng(4).normal(0, 400, block[2].shape).astype(np.float32)
    (blue, green, red) = (f.slope for f in fitted(block).fits)
    assert blue == pytest.approx(1.05, abs=0.1)
    assert green == pytest.approx(1.0, abs=0.1)
    assert red == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("faint", [False, True])
def test_a_reef_that_the_nir_sees_does_not_teach(faint):
    block = swell_block(strength=10.0)
    reef = gaussian_filter(np.random.default_rng(9).normal(size=(192, 156)), 1.5) * 3
    block[:, :, 100:] += (np.array([400.0, 600.0, 300.0, 20.0])[:, None, None] * np.exp(reef)).astype(np.float32)
    request = replace(nir_request(BANDS, [3]), faint_glint=faint)
    slopes = [f.slope for f in wiener.fit(request, [whole_tile(block)]).fits]
    np.testing.assert_allclose(slopes, SLOPES[:3].ravel(), rtol=0.1)
    order = [4, 0, 1, 2, 3]  # a file whose SWIR comes first
    swir = 100 + 0.5 * (block[3] - 100) + np.random.default_rng(2).normal(0, 1, block[3].shape)
    both = np.stack([*block, swir.astype(np.float32)])
    bands = (*BANDS, Band("SWIR", 1610.0))
    usual, moved = (
        wiener.fit(replace(nir_request([bands[b] for b in o], [o.index(3)]), faint_glint=faint), [whole_tile(both[o])])
        for o in ([0, 1, 2, 3, 4], order)
    )
    np.testing.assert_allclose([f.slope for f in moved.fits], [f.slope for f in usual.fits], rtol=1e-9)
    resolved = wiener.fit(replace(request, resolved=True), [whole_tile(block)]).fits
    assert max(f.slope for f in resolved) > 3  # where pixels resolve waves, glint differs as much from place to place


def test_the_level_is_that_of_the_least_glint_and_leaves_nothing_negative():
    block = swell_block(noise=0.5)
    model = fitted(block)
    out = remove.apply(block, model)
    assert np.median(out[:3], axis=(1, 2)) == pytest.approx(WATER[:3, 0, 0], rel=0.05)
    dark = block.copy()
    dark[2] -= 380  # red water of 20: the full prediction would go below zero
    lowest, chosen, middle = fitted(dark).level_interval
    assert lowest <= chosen <= middle
    assert (remove.apply(dark, fitted(dark))[2] <= 0).mean() < 0.005


def test_nothing_is_brightened():
    block = swell_block(noise=3.0)
    assert (remove.apply(block, fitted(block)) <= block).all()


def test_an_even_sheet_of_glint_is_warned_of_with_its_interval():
    block = swell_block(noise=0.5) + np.float32(2000)
    model = fitted(block)
    assert any("glint level is uncertain" in w for w in model.warnings)
    assert model.level_interval[1] > 1900
    assert not fitted(swell_block(noise=0.5)).warnings


@pytest.mark.parametrize("sparkle", [False, True])
def test_glint_on_a_quarter_of_the_sea_is_removed_there_and_adds_no_noise_elsewhere(sparkle):
    part = np.arange(256) >= 192
    block = WATER + SLOPES * np.where(part, waves(), 0) + np.random.default_rng(3).normal(0, 2, (4, 192, 256))
    request = nir_request(BANDS, [3], regression="detrended")
    tile = whole_tile(block.astype(np.float32))
    out = remove.apply(tile.block, wiener.fit(replace(request, sparkle=sparkle, resolved=sparkle), [tile]))
    left = (out - WATER)[:3]
    assert left[:, 8:-8, 200:-8].std(axis=(1, 2)) == pytest.approx(2, abs=1.5)  # of 20
    calm = left[:, 8:-8, 8:184].std(axis=(1, 2))
    assert (calm < (2.2 if sparkle else 3)).all()  # with all of the noise of the NIR: 2.8


def test_the_strongest_glint_teaches_though_it_is_in_one_corner():
    """Noise hides weak glint, so that its slopes are uncertain; a few squares of bright pixels need not be ships."""
    rng, (rows, columns) = np.random.default_rng(0), np.indices((576, 576))
    facets = np.clip(gaussian_filter(rng.normal(size=(576, 576)), 2.0) * 7 + 1, 0, None)
    glint = (400 * np.exp(-(rows**2 + columns**2) / (2 * 25.0**2)) + 2) * facets
    block = (WATER + SLOPES * glint + rng.normal(0, 2, (4, 576, 576))).astype(np.float32)
    corners = [(row, column) for row in range(0, 576, 192) for column in range(0, 576, 192)]
    every = np.ones((192, 192), bool)
    tiles = [SampleTile(block[:, r : r + 192, c : c + 192].copy(), every, every, (r, c)) for r, c in corners]
    request = replace(nir_request(BANDS, [3], regression="detrended"), sparkle=True, resolved=True)
    slopes = [f.slope for f in wiener.fit(request, tiles).fits]
    np.testing.assert_allclose(slopes, SLOPES[:3].ravel(), rtol=0.03)


def test_ships_and_land_are_left_and_the_water_beside_them_too():
    block = swell_block((256, 256))
    block[:, 100:104, 100:112] += 4000
    block[:, :, 200:] = 3000
    water = np.ones((256, 256), bool)
    water[:, 200:] = False
    model = fitted(block, sample=water & (np.arange(256) < 190))
    out = remove.apply(block, model, where=water)
    np.testing.assert_array_equal(out[:, :, 200:], block[:, :, 200:])
    assert (out[:3, 101:103, 102:110] > 4200).all()
    beside = out[:3, :, 196:200] - WATER[:3]
    assert abs(beside.mean()) < 15


def test_a_reference_of_clean_water_is_itself():
    values = swell_block()[3]
    rule = fit_reference([(values, np.ones(values.shape, bool))], 3)
    out, exceeds = clean(values, np.ones(values.shape, bool), rule)
    assert out is values
    assert exceeds is None


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(st.integers(60, 130), st.integers(60, 200), st.booleans())
def test_tiles_are_the_whole_to_the_bit(row, column, two_kinds):
    block = swell_block((192, 256), seed=3)
    block[:, 70:74, 90:99] += 5000
    block[3, 120:140, 20:60] = np.nan
    water = np.ones((192, 256), bool)
    water[150:, 200:] = False
    model = fitted(block)
    if two_kinds:
        model = replace(model, strips=Strips(("0110", "0010", "0111")), second=model.indexes[::-1])
    whole, _ = glint(block, model, water)
    halo = model.halo
    for rows in ((0, row), (row, 192)):
        for columns in ((0, column), (column, 256)):
            top, left = max(rows[0] - halo, 0), max(columns[0] - halo, 0)
            outer = slice(top, min(rows[1] + halo, 192)), slice(left, min(columns[1] + halo, 256))
            part, _ = glint(block[:, *outer], model, water[outer], (top, left))
            inside = water[rows[0] : rows[1], columns[0] : columns[1]]
            for band, values in part.items():
                mine = values[rows[0] - top : rows[1] - top, columns[0] - left : columns[1] - left]
                want = whole[band][rows[0] : rows[1], columns[0] : columns[1]]
                np.testing.assert_array_equal(mine[inside], want[inside])


def without_sheet(error, interval):
    """Of swell, which is so even that a sheet of glint may hide in it."""
    return np.sqrt(error**2 - (interval[1] - interval[0]) ** 2 / 6)


@pytest.mark.slow
def test_standard_errors_against_draws():
    blocks = [swell_block((192, 192), seed=s, noise=20.0) for s in range(12)]
    request = replace(nir_request(BANDS, [3], regression="detrended"), resolved=True)  # slopes are not raised
    plain = [wiener.fit(request, [whole_tile(block)]) for block in blocks]
    slopes, claimed = (np.array([[getattr(f, k) for f in m.fits] for m in plain]) for k in ("slope", "stderr"))
    ratio = claimed.mean(axis=0) / slopes.std(axis=0, ddof=1)
    assert (ratio > 0.5).all()
    assert (ratio < 2.0).all()
    found = [fitted(block) for block in blocks]
    for model, own in zip(found, slopes, strict=True):
        assert all(f.stderr >= f.slope - s for f, s in zip(model.fits, own, strict=True)), "what is raised is uncertain"
    levels = [m.level_interval[1] for m in found]
    errors = [without_sheet(m.level_stderr, m.level_interval) for m in found]
    assert 0.4 < np.mean(errors) / np.std(levels, ddof=1) < 2.5


def level_sample(prediction, value, slopes=1.0):
    """Pixels like all around them, any of which may determine the level."""
    together, everywhere = prediction.mean(axis=0), np.ones(prediction.shape[1], bool)
    return LevelSample(prediction, value, together, together, prediction - value / slopes, everywhere)


def test_the_error_of_the_level_against_a_bootstrap_over_tiles():
    rng, side = np.random.default_rng(11), 64
    block, slopes = swell_block((256, 256), seed=12, noise=5.0), np.ones(3)
    cells = block.reshape(4, 4, side, 4, side).transpose(1, 3, 0, 2, 4).reshape(16, 4, -1)

    def level(chosen):
        some = np.concatenate([cells[c] for c in chosen], axis=1)
        return shared_level(level_sample(np.repeat(some[3:], 3, axis=0), some[:3]), slopes)[1][1]

    spread = np.std([level(rng.integers(0, 16, 16)) for _ in range(60)])
    some = np.concatenate(list(cells), axis=1)
    sample = level_sample(np.repeat(some[3:], 3, axis=0), some[:3])
    claimed = without_sheet(shared_level_error(sample, slopes), shared_level(sample, slopes)[1])
    assert 0.4 < claimed / spread < 2.5


@pytest.mark.parametrize("sheet", [0.0, 30.0])
def test_the_error_of_the_level_holds_a_sheet_where_every_pixel_has_glint(sheet):
    rng = np.random.default_rng(14)
    water, glint = 20.0, sheet + (rng.gamma(20.0, 4.0, 200_000) if sheet else rng.gamma(0.1, 50.0, 200_000))
    sample = level_sample((water + glint)[None], (100.0 + glint)[None])
    claimed = shared_level_error(sample, np.ones(1))
    lowest, chosen, _ = shared_level(sample, np.ones(1))[1]
    if sheet:  # the level is too high by the sheet and what every pixel has besides
        assert chosen - water > 40
        assert (chosen - water) / 3 < claimed < 3 * (chosen - water)
    else:
        assert claimed < 0.1 * (chosen - lowest)


@pytest.mark.parametrize(("red", "shape", "highest"), [(30.0, 4.0, 31.0), (200.0, 4.0, 120.0), (30.0, 1.5, 31.0)])
def test_the_level_under_dense_glint_is_bounded_by_the_darkest_water(red, shape, highest):
    glint = 40 + np.random.default_rng(15).gamma(shape, 60.0, 200_000)
    sample = level_sample(np.repeat((20 + glint)[None], 2, axis=0), np.stack([red + glint, 25 + glint]))
    infrared_too = shared_level(sample, np.ones(2))[1][1]
    chosen = shared_level(sample, np.ones(2), np.array([1, np.nan]))[1][1]
    assert infrared_too > 60, "the least glint is far above the water"
    if red < 100:  # its NIR is at most three times what red exceeds it by
        assert chosen == pytest.approx(3 * (red - 20), rel=0.02)
    else:
        assert chosen == infrared_too
    assert chosen < highest


@pytest.mark.parametrize(("fitted", "taken"), [(0.9, 1.0), (1.1, 1.1), (1.4, 1.0), (0.4, 0.4)])
def test_slopes_that_noise_or_foam_determines_are_not_those_of_glint(fitted, taken):
    request = nir_request(BANDS, [3], regression="detrended")
    for spectrum in spectra(request):
        found = slopes_of_glint(fitted * spectrum, np.full(3, 0.5), request)
        if fitted < 1.2 or spectrum.std() > 0:  # foam in reflectance is like glint in radiance
            np.testing.assert_allclose(found, taken * spectrum)
    mixed = np.array([0.9, 0.9, 0.7])  # no single cause
    np.testing.assert_allclose(slopes_of_glint(mixed, np.full(3, 0.5), request), mixed)
    sure = np.array([1.0, 0.9, 1.0])
    np.testing.assert_allclose(slopes_of_glint(sure, np.full(3, 0.95), request), [1, 0.9 / 0.95, 1])
    red_edge = replace(request, bands=(*BANDS[:2], replace(BANDS[2], wavelength=705.0), BANDS[3]))
    assert np.isnan(slopes_of_glint(np.ones(3), np.ones(3), red_edge)).tolist() == [False, False, True]


def test_waves_that_bands_do_not_share_do_not_raise_the_level_of_a_sheet():
    rng = np.random.default_rng(18)
    swell, *own = 60 * gaussian_filter(rng.normal(size=(4, 256, 256)), (0, 1.5, 1.5)) / 0.19
    glint = 300 + np.stack([*(0.9 * swell + 0.44 * o for o in own), swell])
    block = np.array([900.0, 700.0, 60.0, 40.0])[:, None, None] + glint
    model = fitted(block.astype(np.float32))
    lowest, chosen, middle = model.level_interval
    assert lowest < 40 < chosen < 85 < middle / 3
    for band, water in enumerate((900, 700, 60)):
        left = np.median(remove.apply(block.astype(np.float32), model)[band]) - water
        assert left == pytest.approx(chosen - 40, abs=8), "nothing of the glint but what the level holds"


def test_noise_of_pixels_does_not_raise_the_level_of_a_sheet():
    rng = np.random.default_rng(17)
    swell = gaussian_filter(rng.normal(size=(256, 256)), 1.5)
    block = np.array([900.0, 700.0, 25.0, 20.0])[:, None, None] + 400 + 100 * swell / swell.std()
    block[2] += rng.normal(0, 25, swell.shape)  # as large as the water
    model = fitted(block.astype(np.float32))
    assert model.level_interval[1] == pytest.approx(20, abs=10)
    assert (remove.apply(block.astype(np.float32), model)[2] > 0).all()


def test_waves_that_move_between_bands_do_not_raise_the_level_of_dense_glint(tmp_path):
    sensor = replace(preset("worldview3"), gsd=0.4)
    made = simulate(Setup(sensor=sensor, size=(128, 128), wind=8.0, sun_zenith=23.0, seed=1))
    water = [float(np.median(made.truth_image[b])) * sensor.scale(sensor.bands[b]) for b in (-2, -1)]
    path, *_ = write_scene(made, tmp_path / "scene")
    lowest, chosen, middle = fit_scene(open_scene(path), Recipe(method="wiener", compensate="off")).model.level_interval
    assert lowest <= min(water)
    assert chosen < 1.2 * max(water) < 0.2 * middle


def test_a_level_raised_for_positivity_is_the_same_for_a_reference_of_any_unit():
    rng = np.random.default_rng(16)
    glint = np.concatenate([np.zeros(40_000), rng.gamma(1.0, 50.0, 160_000)])
    value = np.stack([100 + glint, 3 + glint]) + rng.normal(0, 2, (2, glint.size))  # dark red: some are negative
    prediction = np.repeat((20 + glint)[None], 2, axis=0) + rng.normal(0, 2, glint.size)
    levels = []
    for unit in (1.0, 0.25):  # of the second reference
        scaled = np.array([[1.0], [unit]])
        own, (lowest, chosen, _) = shared_level(level_sample(prediction * scaled, value, 1 / scaled), 1 / scaled[:, 0])
        assert chosen == lowest, "raised"
        levels.append(own / scaled[:, 0])
    assert levels[0] == pytest.approx(levels[1], rel=0.02)


def test_strips_are_found_and_each_follows_its_own_waves():
    glints = waves((256, 384), seed=6)
    block = (WATER + np.broadcast_to(glints, (4, *glints.shape))).astype(np.float32)
    block += np.random.default_rng(7).normal(size=block.shape).astype(np.float32)
    second = np.arange(384) >= 192
    block[0] = 900 + np.where(second, np.roll(glints, 1, 1), np.roll(glints, -1, 1))
    tiles = [SampleTile(block[:, :, c : c + 192], np.ones((256, 192), bool), np.ones((256, 192), bool), (0, c))
             for c in (0, 192)]  # fmt: skip
    request = nir_request(BANDS, [3], regression="detrended")

    def find(finder):
        known = np.full((4, 6), -1, np.int8)
        for tile in tiles:
            places, kinds = finder(tile)
            known[places[:, 0] // 64, places[:, 1] // 64] = kinds
        return Strips.of(filled(known))

    one, two = wiener.fit(request, tiles), wiener.fit(replace(request, strips=find), tiles)
    assert set(two.strips.rows) <= {"000111", "111000"}
    left = [block[0] - glint(block, m, np.ones((256, 384), bool))[0][0] for m in (one, two)]
    assert left[1][:, :150].std() < 0.3 * left[0][:, :150].std()
    assert GlintModel.from_json(two.to_json()) == two


def test_a_model_needs_the_pixels_and_bands_of_both_kinds_of_strip():
    near, far = (GlintIndex((3,), (1.0,), 0.0, ((at, at),)) for at in (0, 2))
    wide = replace(far, bands=(2,))
    fit = BandFit(0, "BLUE", 0, 1.0)
    model = GlintModel("wiener", (near,), (fit,), tuple(b.name for b in BANDS), second=(wide,))
    assert (model.halo, model.index_bands) == (2, (2, 3))
    with pytest.raises(InputError, match="RED"):
        model.for_bands(("BLUE", "GREEN", "NIR"))


def test_an_nir_that_does_not_vary_is_refused_though_a_second_does():
    block = np.concatenate([swell_block(), swell_block(seed=1)[3:]])
    block[3] = 100
    with pytest.raises(FitError, match="the NIR does not vary"):
        fitted(block, (*BANDS, Band("NIR2", 950.0)))


@pytest.mark.parametrize("value", [7.0, np.nan])
def test_a_swir_that_does_not_vary_is_left_out_with_a_word(value):
    block = swell_block()
    swir = np.full((1, *block.shape[1:]), value, np.float32)
    bands = (*BANDS, Band("SWIR", 1610.0))
    model = fitted(np.concatenate([block, swir]), bands, correct=(0, 1, 2))
    (warning,) = model.warnings
    assert says(warning, "SWIR does not vary", "not used")
    assert (model.indexes, model.index_bands) == (fitted(block).indexes, (3,))
    swir[:], swir[0, 0, 0] = 0, 1  # nor does it where kernels learn
    assert fitted(np.concatenate([block, swir]), bands, correct=(0, 1, 2)).index_bands == (3,)


def test_a_swir_of_few_values_gives_sparkle_no_limit_beyond_single_precision(recwarn):
    swir = np.zeros((64, 64), np.float32)
    swir[:4, :5] = 5
    every = np.ones(swir.shape, bool)
    rule = fit_reference([(swir, every)], 4, sparkle=True)
    clean(swir, every, rule)
    assert not [w.message for w in recwarn]


def test_models_survive_json_and_say_what_they_follow():
    model = fitted(swell_block())
    assert GlintModel.from_json(model.to_json()) == model
    assert "NIR (" in str(model)
    broken = json.loads(model.to_json())
    broken["indexes"][0]["offsets"] = [[0, 0]] * (len(broken["indexes"][0]["bands"]) + 1)
    with pytest.raises(InputError, match="offsets"):
        GlintModel.from_json(json.dumps(broken))


def test_too_little_water_says_what_to_do():
    with pytest.raises(FitError, match="--sample"):
        fitted(swell_block(), sample=np.zeros((192, 256), bool))


def test_swir_serves_as_second_reference_and_water_vapour_does_not():
    bands = (*BANDS, Band("VAPOUR", 945.0, 20.0), Band("SWIR", 1610.0, 90.0))
    (found,) = wiener.band_sets(nir_request(bands, [3], correct=(0, 1, 2)))
    assert found.references == (3, 5)
    assert offsets(3)[4] == (0, 0)
    assert ReferenceRule(5, 1.0, 1.0, 0.0, 1.0, edge=2).halo == 27


@pytest.mark.slow
def test_threads_and_windows_give_the_same_bits(write, read, tmp_path):
    block = np.rint(swell_block((300, 420), seed=9)).clip(1).astype(np.uint16)
    names = ("blue", "green", "red", "nir")
    source = write(tmp_path / "sea.tif", block, names=names)
    for threads in (1, 2):
        remove_glint(source, tmp_path / f"{threads}.tif", Recipe(method="wiener"), threads=threads)
    np.testing.assert_array_equal(read(tmp_path / "1.tif"), read(tmp_path / "2.tif"))
    scene = open_scene(source)
    fit = fit_scene(scene, Recipe(method="wiener"))
    window = ((100, 211), (37, 401))
    np.testing.assert_array_equal(correct(scene, fit, window=window), correct(scene, fit)[:, 100:211, 37:401])


def test_strips_lie_at_the_same_place_in_every_cell_of_a_chain(write, tmp_path, monkeypatch):
    block = np.rint(swell_block((300, 420), seed=9)).clip(1).astype(np.uint16)
    scene = open_scene(write(tmp_path / "sea.tif", block, names=("blue", "green", "red", "nir")))
    fit = fit_scene(scene, Recipe(compensate="remove, posterior"))
    strips = Strips(("0110100", "0010110", "0111001", "1100101", "1010011"))
    second = tuple(replace(i, weights=tuple(0.8 * w for w in i.weights)) for i in fit.model.indexes)
    fit = replace(fit, model=replace(fit.model, strips=strips, second=second))
    whole = correct(scene, fit)
    monkeypatch.setattr(correcting, "CHAIN_CELL", 96)
    np.testing.assert_array_equal(correct(scene, fit), whole)


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "most"), [("p124_w9_wv3", 18.0), ("p300_w9_0ms", 12.0), ("sentinel2_w5", 20.8), ("planetscope4_w9", 45.0)]
)
def test_coarse_scenes_with_truth(name, most):
    """Error of the visible bands in percent of the water, of scenes made by another simulator than ours."""
    path = SHARED / "wide" / f"{name}.tif"
    if not path.exists():
        pytest.skip("the simulated scenes do not lie beside the project")
    scene, true = open_scene(path), open_scene(path.with_name(f"{name}_truth.tif")).read()
    visible = [i for i, b in enumerate(scene.bands) if b.wavelength < 690]
    clean_scene = correct(scene, fit_scene(scene))
    level = np.median(true, axis=(1, 2), keepdims=True)
    error = 100 * np.sqrt(np.mean(((clean_scene - true) / level)[visible] ** 2))
    assert error < most


@pytest.mark.parametrize(("excess", "chosen"), [(0.003, (1,)), (0.006, (3,))])
def test_a_wider_kernel_is_taken_if_it_reduces_noise_by_a_fifth_of_a_percent(excess, chosen):
    """The excess is that of power, twice that of noise, and the same in every group: no chance."""
    losses = {(1,): np.full(16, 1 + excess), (3,): np.ones(16)}
    assert _within_chance(losses)[0] == chosen
