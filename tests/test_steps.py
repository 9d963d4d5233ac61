"""Steps of numbers that are stored as fractions: found where there are any, and scenes fare as their counts do."""

import numpy as np
import pytest
import rasterio
from hypothesis import assume, given
from hypothesis import strategies as st

from deglint import fit_scene, open_scene, remove_glint
from deglint.compensate.identify import TINY
from deglint.compensate.spread import standing_out
from deglint.compensate.steps import step_of
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate


@given(
    st.floats(1e-6, 1e3), st.floats(-3, 3), st.floats(0.3, 30), st.integers(0, 999),
    st.sampled_from([np.float32, np.float64]),
)  # fmt: skip
def test_a_step_is_found_whatever_unit_level_and_noise(step, level, noise, seed, dtype):
    counts = np.rint(np.random.default_rng(seed).normal(500, noise, 20_000))
    assume(np.unique(counts).size > 2)
    values = (counts * step + level * 100 * step).astype(dtype)
    assert step_of(values) == pytest.approx(step, rel=0.01)


@given(st.integers(0, 999), st.sampled_from([np.float32, np.float64]), st.integers(1, 20_000))
def test_fractions_have_none(seed, dtype, count):
    assert step_of(np.random.default_rng(seed).normal(0.01, 0.001, count).astype(dtype)) == 0


def test_flashes_and_holes_do_not_hide_it_and_one_number_has_none():
    rng = np.random.default_rng(0)
    counts = np.rint(rng.normal(100, 2, 50_000))
    counts[:2000] += np.rint(rng.gamma(0.3, 3000, 2000))
    values = (counts * 1e-4).astype(np.float32)
    values[7::50] = np.nan
    values[8::5000] = np.inf
    assert step_of(values) == pytest.approx(1e-4, rel=0.01)
    for flat in (np.full(99, 7.0), np.empty(0), np.full(9, np.nan)):
        assert step_of(flat) == 0


def test_two_kinds_of_steps_are_none():
    rng = np.random.default_rng(0)
    values = np.concatenate([np.rint(rng.normal(100, 3, 9000)), np.pi / 10 * np.rint(rng.normal(300, 9, 9000))])
    assert step_of(values) == 0


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize(("wind", "delay"), [(2.0, 0.06), (9.0, 0.0)])
def test_counts_that_are_stored_as_fractions_fare_as_counts(tmp_path, wind, delay, dtype):
    scene = simulate(Setup(sensor=preset("thesis").delayed(delay), size=(256, 256), wind=wind, sky="cardioidal",
                           patch=0.06, seed=0))  # fmt: skip
    write_scene(scene, tmp_path / "counts")
    with rasterio.open(tmp_path / "counts.tif") as given_:
        values = given_.read() * np.array(given_.scales)[:, None, None]
        profile = {**given_.profile, "dtype": dtype, "nodata": None}
        with rasterio.open(tmp_path / "fractions.tif", "w", **profile) as out:
            out.write(values.astype(dtype))
            out.update_tags(**{k: v for k, v in given_.tags().items() if k != "AREA_OR_POINT"})
            out.descriptions = given_.descriptions
            for b in given_.indexes:
                out.update_tags(b, **given_.tags(b))
    errors, sigmas = [], []
    for name in ("counts", "fractions"):
        fitted = fit_scene(open_scene(tmp_path / f"{name}.tif"))
        sigmas.append(next(s for s in fitted.chain.before if s.name == "identify-level").sigmas)
        remove_glint(tmp_path / f"{name}.tif", tmp_path / "out.tif", overwrite=True)
        away = open_scene(tmp_path / "out.tif").read() - scene.truth
        errors.append(np.sqrt((away**2).mean(axis=(1, 2))))
    np.testing.assert_allclose(*sigmas, rtol=0.01)
    assert (errors[1] <= 1.02 * errors[0]).all()  # less where nothing is rounded to counts again


def test_a_band_without_noise_has_what_stands_out_of_it_and_no_more():
    away = np.zeros((2, 1000), np.float32)
    away[0, :10] = 5.0
    away[1] = np.random.default_rng(0).standard_normal(1000)
    with np.errstate(all="raise"):
        glint, things = standing_out(list(away), [0.0, 0.0], [TINY, 1.0], [0, 1], 1)
    assert np.isfinite([*glint, *things]).all()
    assert glint[0] > 1e6
    assert (glint[1], things) == (0, (0, 0))


def test_a_band_of_one_number_stops_nothing(tmp_path):
    scene = simulate(Setup(sensor=preset("thesis").delayed(0.06), size=(192, 192), wind=9.0, sky="cardioidal",
                           patch=0.06, seed=0))  # fmt: skip
    scene.image[1] = scene.image[1, 0, 0]
    write_scene(scene, tmp_path / "flat")
    result = remove_glint(tmp_path / "flat.tif", tmp_path / "out.tif")
    clean = open_scene(tmp_path / "out.tif").read()
    assert len(np.unique(clean[1])) == 1
    assert result.fitted.chain.runs
