"""Where glint is: cells against brute force, tiles against the whole, parts of scenes that must pass as they are."""

import json
from dataclasses import replace

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint import correct, fit_scene, open_scene, remove_glint
from deglint import tiles as tiling
from deglint.compensate.chain import Chain, chain_from
from deglint.compensate.glance import block
from deglint.compensate.presence import BEYOND, CALM, CELL, CLEAR, FAR, MOST, Presence, blend, fit
from deglint.errors import InputError
from deglint.physics.presets import preset
from deglint.pipeline.sidecar import load_chain, load_model
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate, thesis_array

SIDE = 320
BESIDE = 56
"""From where glint ends: the cell that holds some of it, those about it, and what is interpolated beside them."""
ACROSS, INTO = 225.0, 315.0
"""Azimuth of the sensor, across the sun's and into the glint [deg]."""


def sea(rows=100, columns=140, seed=0):
    return np.random.default_rng(seed).normal(5, 2, (1, rows, columns)).astype(np.float32)


def share_of(told, block, row=0, column=0):
    rows, columns = block.shape[1:]
    found = told.cells(block, row, column).share((row, row + rows), (column, column + columns))
    return np.ones((rows, columns), np.float32) if found is None else found


def by_hand(told, block):
    """Shares as the equations have them, in float64, pixel by pixel."""
    away = (block[told.band].astype(np.float64) - told.level) / told.within
    rows, columns = away.shape
    cells = {}
    for m in range(-(-rows // CELL)):
        for n in range(-(-columns // CELL)):
            part = away[CELL * m : CELL * (m + 1), CELL * n : CELL * (n + 1)]
            known = part[np.isfinite(part)]
            excess = CLEAR
            if known.size:
                varies = known.var(ddof=1) if known.size > 1 else 0
                excess = varies - 1 + max(known.mean() - BEYOND * told.spread / told.within, 0) ** 2
                excess *= np.sqrt(known.size) / CELL
            cells[m, n] = np.clip((excess - CALM) / (CLEAR - CALM), 0, 1)
    top = {(m, n): max(cells.get((m + i, n + j), 0) for i in (-1, 0, 1) for j in (-1, 0, 1)) for m, n in cells}
    last_m, last_n = max(m for m, _ in cells), max(n for _, n in cells)
    out = np.empty((rows, columns))
    for i in range(rows):
        for j in range(columns):
            y, x = (i + 0.5) / CELL - 0.5, (j + 0.5) / CELL - 0.5
            m, n = int(np.floor(y)), int(np.floor(x))
            ms, ns = ([min(max(k, 0), last) for k in (a, a + 1)] for a, last in ((m, last_m), (n, last_n)))
            here, below = ((1 - x + n) * top[k, ns[0]] + (x - n) * top[k, ns[1]] for k in ms)
            out[i, j] = (1 - y + m) * here + (y - m) * below
    return out


@pytest.mark.parametrize("shape", [(100, 140), (16, 16), (1, 1), (5, 70), (33, 17)])
def test_shares_are_what_the_equations_say(shape):
    block = sea(*shape)
    block[:, : shape[0] // 2, : shape[1] // 3] += 3
    block[:, -3:, -40:] = np.nan
    told = Presence(0, 5.2, 1.7, 0.2)
    np.testing.assert_allclose(share_of(told, block), by_hand(told, block), atol=2e-3)


def test_noise_alone_has_none_and_one_flash_opens_its_cell_and_all_about_it():
    told, block = Presence(0, 5.0, 2.0), sea()
    assert not share_of(told, block).any()
    block[0, 40, 70] += 80
    share = share_of(told, block)
    assert (share[32:48, 64:80] == 1).all()
    assert not share[: 32 - 3 * CELL // 2].any()
    assert not share[48 + 3 * CELL // 2 :].any()


def test_even_glint_shows_by_its_mean():
    told = Presence(0, 5.0, 2.0)
    assert not share_of(told, sea() + np.float32(0.9 * 2 * np.sqrt(CALM))).any()
    assert (share_of(told, sea() + np.float32(1.2 * 2 * np.sqrt(CLEAR))) == 1).all()
    varying = replace(told, spread=1.0)
    assert not share_of(varying, sea() + np.float32(0.9 * 2 * np.sqrt(CALM) + BEYOND)).any()
    assert (share_of(varying, sea() + np.float32(1.2 * 2 * np.sqrt(CLEAR) + BEYOND)) == 1).all()
    assert not share_of(told, sea() - np.float32(9)).any()  # glint only adds


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e38])
def test_numbers_that_are_none_or_endless(bad):
    told, block = Presence(0, 5.0, 2.0), sea()
    block[0, 50, 50] = bad
    share = share_of(told, block)
    assert np.isfinite(share).all()
    assert share[50, 50] == (0 if np.isnan(bad) else 1)
    block[:] = np.nan
    assert (share_of(told, block) == 1).all()  # nothing is known: as without this


@settings(max_examples=60)
@given(st.data())
def test_tiles_are_the_whole_to_the_bit(data):
    block = sea()
    block[0, 30:50, 60:100] += 2
    block[0, 80, 20] = 60
    told = Presence(0, 5.1, 1.9)
    top, left = data.draw(st.integers(0, 98)), data.draw(st.integers(0, 138))
    bottom, right = data.draw(st.integers(top + 1, 100)), data.draw(st.integers(left + 1, 140))
    around = data.draw(st.sampled_from([1, FAR]))
    whole = told.cells(block, 0, 0).share((0, 100), (0, 140), around)
    halo = replace(told, quiet=around).halo + data.draw(st.integers(0, 9))
    row, column = max(top - halo, 0), max(left - halo, 0)
    part = block[:, row : bottom + halo, column : right + halo]
    found = told.cells(part, row, column).share((top, bottom), (left, right), around)
    expected = whole[top:bottom, left:right]
    np.testing.assert_array_equal(np.ones_like(expected) if found is None else found, expected)


@given(st.integers(-20, 20), st.floats(-3, 3))
def test_shares_do_not_depend_on_the_unit(power, level):
    block, unit = sea(40, 40), 2.0**power
    told = Presence(0, 5.0 + level, 2.0, 0.1)
    scaled = Presence(0, (5.0 + level) * unit, 2.0 * unit, 0.1 * unit)
    np.testing.assert_array_equal(share_of(scaled, block * np.float32(unit)), share_of(told, block))


def test_a_block_is_left_as_it_is_and_any_float_will_do():
    block = sea()
    block[0, :50] += 4
    before = block.copy()
    told = Presence(0, 5.0, 2.0)
    np.testing.assert_array_equal(share_of(told, block), share_of(told, block.astype(np.float64)))
    np.testing.assert_array_equal(block, before)


def test_the_level_is_that_of_the_darkest_squares_of_water():
    nir = sea(256, 256)[0]
    nir[:, 64:] += 30 * (np.random.default_rng(1).random((256, 192)) < 0.1)
    inside = np.ones(nir.shape, np.bool_)
    assert fit([(nir, inside)], 3, 2.0).level == pytest.approx(5.0, abs=0.1)
    dark = nir.copy()
    dark[:64, 64:128] = -100  # not water
    inside[:64, 64:128] = False
    found = fit([(dark, inside), (np.full((64, 64), np.nan), np.ones((64, 64), bool))], 3, 2.0)
    assert found.level == pytest.approx(5.0, abs=0.1)
    assert found.band == 3
    assert found.within == pytest.approx(2.0, rel=0.02)
    assert found.spread == pytest.approx(2.0 / CELL, rel=0.2)


def test_sky_that_varies_widens_what_passes_for_none_but_not_without_end():
    nir = sea(256, 256)[0]
    inside = np.ones(nir.shape, np.bool_)
    cells = np.random.default_rng(3).normal(0, 1.0, (16, 16)).repeat(CELL, 0).repeat(CELL, 1).astype(np.float32)
    found = fit([(nir + cells, inside)], 0, 1.8)
    assert found.within == pytest.approx(2.0, rel=0.03)
    assert found.spread == pytest.approx(1.0, rel=0.25)
    assert not share_of(found, (nir + cells)[None]).any()
    found = fit([(9 * (nir + cells), inside)], 0, 1.8)
    assert (found.within, found.spread) == (MOST * 1.8, MOST * 1.8)


@pytest.mark.parametrize("sigma", [0.0, float("nan")])
def test_nothing_is_told_without_noise_or_water(sigma):
    assert fit([(sea()[0], np.ones((100, 140), bool))], 0, sigma) is None
    assert fit([(sea()[0], np.zeros((100, 140), bool))], 0, 1.0) is None
    assert fit([(sea(20, 20)[0], np.ones((20, 20), bool))], 0, 1.0) is None


def test_what_is_taken_back_is_so_to_the_bit():
    rng = np.random.default_rng(0)
    after, before = rng.normal(size=(2, 1, 1, 900)).astype(np.float32)
    share = np.repeat(np.float32([0, 0.25, 1]), 300)[None]
    made = after.copy()
    blend(made, before, share)
    np.testing.assert_array_equal(made[..., :300], before[..., :300])
    np.testing.assert_array_equal(made[..., 600:], after[..., 600:])
    np.testing.assert_allclose(made[..., 300:600], 0.75 * before[..., 300:600] + 0.25 * after[..., 300:600], atol=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_part_of_an_array_is_taken_back_as_a_whole_one_is(dtype):
    rng = np.random.default_rng(1)
    after, before = rng.normal(size=(2, 3, 30, 40)).astype(dtype)
    before[1, 9] = np.nan
    share = rng.choice(np.float32([0, 0.3, 1]), (30, 40))
    whole, given, part = after.copy(), after.copy(), np.s_[5:20, 7:30]
    blend(whole, before, share)
    mixed = np.where(share == 0, before, np.where(share < 1, before + share * (after - before), after))
    np.testing.assert_array_equal(whole, mixed.astype(dtype))
    inner = after[:, *part]
    blend(inner, before[:, *part], share[part])
    np.testing.assert_array_equal(inner, whole[:, *part])
    after[:, *part] = given[:, *part]
    np.testing.assert_array_equal(after, given)  # nothing around it is touched


def test_what_is_to_be_written_to_is_never_a_copy():
    image = np.zeros((2, 4, 6), np.float32)
    with pytest.raises(ValueError, match="one piece"):
        block(image[:, :, ::2], written=True)


def test_it_is_saved_and_read_back():
    chain = Chain(presence=Presence(6, 0.001, 4e-5, 1e-5, FAR))
    text = json.dumps(chain.saved())
    assert chain_from(json.loads(text)).presence == chain.presence
    older = {name: value for name, value in chain.saved().items() if name != "presence"}
    for without in (Chain().saved(), older):
        assert chain_from(json.loads(json.dumps(without))).presence is None
    for name, value in (("within", 0), ("within", "x"), ("spread", -1), ("level", float("nan")), ("quiet", 3)):
        bad = json.loads(text)
        bad["presence"][name] = value
        with pytest.raises(InputError, match="not a saved compensation"):
            chain_from(bad)


# --------------------------------------------------------------------------------------------------- in whole scenes


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    """Scenes of which the right half is without glint, made once."""
    place, known = tmp_path_factory.mktemp("half"), {}

    def make(delay, sensor="thesis", objects=True, side=SIDE, **setup):
        key = "_".join([sensor, f"{1000 * delay:g}", str(objects), str(side), *map(str, setup.values())])
        if key not in known:
            things = thesis_array((side, side), 0.25, sides=(16,)) if objects else ()
            setup = {"wind": 9.0, "seed": 4} | setup
            scene = simulate(Setup(sensor=preset(sensor).delayed(delay), size=(side, side), sky="cardioidal",
                                   patch=0.06, objects=things, **setup))  # fmt: skip
            image = scene.image.copy()
            image[..., side // 2 :] = scene.truth_image[..., side // 2 :]
            write_scene(replace(scene, image=image), place / key)
            known[key] = place / f"{key}.tif", scene.truth.astype(np.float64)
        return known[key]

    return make


def rms(away):
    return np.sqrt((away**2).mean(axis=(1, 2)))


@pytest.mark.parametrize("sensor", ["thesis", "thesis-f30"])
def test_simultaneous_bands_pass_to_the_bit_where_no_glint_is(half, tmp_path, sensor):
    path, truth = half(0.0, sensor)
    result = remove_glint(path, tmp_path / "out.tif", flags=tmp_path / "flags.tif")
    raw, clean = (open_scene(p).read() for p in (path, tmp_path / "out.tif"))
    flags = flags_of(tmp_path / "flags.tif")
    calm = np.s_[..., SIDE // 2 + BESIDE :]
    np.testing.assert_array_equal(clean[calm], raw[calm])
    assert not flags[calm].any()
    assert result.tally.calm >= flags[calm].size
    assert result.tally.corrected + result.tally.calm == result.tally.usable == flags.size
    assert result.sidecar["pixels"]["without_glint"] == result.tally.calm == (flags == 0).sum()
    assert "no glint" in result.sidecar["skipped"]["removal"]
    assert any("no glint in" in note for note in result.sidecar["notes"])
    assert 0.2 < result.fitted.needs.calm < 0.5
    glinted = np.s_[:5, ..., : SIDE // 2]
    assert (rms((clean - truth)[glinted]) < 0.2 * rms((raw - truth)[glinted])).all()


def flags_of(path):
    with rasterio.open(path) as given:
        return given.read(1)


def test_bands_of_different_instants_bring_nothing_from_other_bands_where_no_glint_is(half):
    path, truth = half(0.06, "thesis-f30", objects=False)
    scene = open_scene(path)
    fitted = fit_scene(scene)
    fitted = replace(fitted, chain=replace(fitted.chain, presence=replace(fitted.chain.presence, quiet=0)))
    clean, raw = correct(scene, fitted).astype(np.float64), scene.read().astype(np.float64)
    calm = np.s_[..., SIDE // 2 + BESIDE :]
    removed = [f.band for f in fitted.model.fits]
    ratios = (rms((clean - truth)[calm]) / rms((raw - truth)[calm]))[removed]
    assert (ratios <= 1.01).all()
    everywhere = correct(scene, replace(fitted, chain=replace(fitted.chain, presence=None))).astype(np.float64)
    assert (rms((everywhere - truth)[calm]) / rms((raw - truth)[calm]))[removed].max() > 1.05


@pytest.mark.parametrize("sensor", ["thesis", "thesis-f30"])
def test_where_flashes_are_dense_nothing_is_done_far_from_them(half, tmp_path, sensor):
    path, truth = half(0.06, sensor)
    scene = open_scene(path)
    fitted = fit_scene(scene)
    assert fitted.chain.presence.quiet == FAR
    clean, raw = correct(scene, fitted), scene.read()
    far = np.s_[..., SIDE // 2 + BESIDE + (FAR - 1) * CELL :]
    np.testing.assert_array_equal(clean[far], raw[far])
    calm = np.s_[..., SIDE // 2 + BESIDE :]
    assert (rms((clean - truth)[calm]) <= 1.01 * rms((raw - truth)[calm])).all()
    result = remove_glint(path, tmp_path / "out.tif", flags=tmp_path / "flags.tif")
    flags = flags_of(tmp_path / "flags.tif")
    assert not flags[far].any()
    assert result.tally.calm >= flags[far].size
    assert result.tally.corrected == np.count_nonzero(flags & 4)


def test_the_sky_in_the_waves_is_no_flash(half):
    """It is brighter on some crests than on others, and stands out a thousandth as much as glint."""
    side = 384
    path, truth = half(0.06, side=side, wind=12.0, seed=0, view_zenith=40.0, view_azimuth=ACROSS)
    scene = open_scene(path)
    fitted = fit_scene(scene)
    assert fitted.chain.presence.quiet == FAR
    calm = np.s_[..., side // 2 + BESIDE + (FAR - 1) * CELL :]
    clean, raw = correct(scene, fitted), scene.read()
    assert (rms((clean - truth)[calm]) <= 1.01 * rms((raw - truth)[calm])).all()


@pytest.mark.parametrize(("sensor", "wind"), [("thesis", 12.0), ("thesis-f30", 9.0)])
def test_glint_without_a_dark_pixel_is_water_beside_a_calm_sea(half, sensor, wind):
    path, truth = half(0.06, sensor, wind=wind, seed=0, view_zenith=20.0, view_azimuth=INTO)
    scene = open_scene(path)
    fitted, raw = fit_scene(scene), scene.read()
    assert fitted.water.water_fraction > 0.99
    glinted = np.s_[:5, :, : SIDE // 2 - BESIDE // 2]
    assert (rms((correct(scene, fitted) - truth)[glinted]) < 0.2 * rms((raw - truth)[glinted])).all()


def test_where_flashes_are_rare_other_bands_may_have_some_anywhere(tmp_path):
    scene = simulate(Setup(sensor=preset("thesis").delayed(0.06), size=(384, 384), wind=5.0, sky="cardioidal",
                           patch=0.06, view_zenith=20.0, view_azimuth=135.0))  # fmt: skip
    write_scene(scene, tmp_path / "rare")
    presence = fit_scene(open_scene(tmp_path / "rare.tif")).chain.presence
    assert presence.quiet == 0


@pytest.mark.parametrize(("delay", "sensor"), [(0.0, "thesis"), (0.0, "thesis-f30"), (0.06, "thesis")])
def test_tiles_threads_and_a_saved_fit_do_not_show(half, tmp_path, monkeypatch, delay, sensor):
    path, _ = half(delay, sensor)
    remove_glint(path, tmp_path / "a.tif", flags=tmp_path / "a_flags.tif", model_file=tmp_path / "fit.json", threads=1)
    fit = load_model(tmp_path / "fit.json"), load_chain(tmp_path / "fit.json")
    monkeypatch.setattr(tiling, "compact", lambda *_, **_options: (96, 64))
    remove_glint(path, tmp_path / "b.tif", flags=tmp_path / "b_flags.tif", threads=2)
    remove_glint(path, tmp_path / "c.tif", flags=tmp_path / "c_flags.tif", model=fit[0], chain=fit[1])
    for name in ("b", "c"):
        np.testing.assert_array_equal(*(open_scene(tmp_path / f"{n}.tif").read() for n in ("a", name)))
        np.testing.assert_array_equal(*(flags_of(tmp_path / f"{n}_flags.tif") for n in ("a", name)))


def test_a_fit_of_glint_leaves_a_scene_without_as_it_is(half, tmp_path):
    path, _ = half(0.0)
    fitted = fit_scene(open_scene(path))
    with_none = tmp_path / "none.tif"
    with rasterio.open(path) as given:
        profile, values, tags = given.profile, given.read(), given.tags()
        names, bands = given.descriptions, [given.tags(b) for b in given.indexes]
        scales, offsets = given.scales, given.offsets
    values = np.concatenate([values[..., SIDE // 2 + 40 :]] * 2, axis=2)
    profile.update(width=values.shape[2])
    with rasterio.open(with_none, "w", **profile) as out:
        out.write(values)
        out.update_tags(**{k: v for k, v in tags.items() if k != "AREA_OR_POINT"})
        out.descriptions, out.scales, out.offsets = names, scales, offsets
        for b, told in zip(out.indexes, bands, strict=True):
            out.update_tags(b, **told)
    result = remove_glint(with_none, tmp_path / "out.tif", model=fitted.model, chain=fitted.chain)
    assert result.tally.corrected == 0
    assert result.tally.calm == result.tally.usable
    np.testing.assert_array_equal(open_scene(tmp_path / "out.tif").read(), open_scene(with_none).read())
