"""By default no band is worse than as it was: away from the glint, without it, and in a part without it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deglint import Recipe, correct, fit_scene, open_scene
from deglint.compensate.spread import ALIKE, COVER_K, standing_out
from deglint.errors import FitError
from deglint.needs import CLEAR_GLINT, LITTLE_GLINT, Needs
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.remove.levels import even_share
from deglint.remove.model import GlintIndex
from deglint.remove.request import harmful
from deglint.remove.statistics import SamplePlan, gather, merge
from deglint.simulate import Setup, simulate, thesis_array

WORSE = 1.01
SIDE = 160


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Scenes by wind, look and optics, as files, made once; with glint, or without, or without it in a half."""
    place, known = tmp_path_factory.mktemp("away"), {}

    def make(wind, zenith, azimuth=0.0, sensor="thesis", delay=0.06, glint="everywhere"):
        key = f"{wind:g}_{zenith:g}_{azimuth:g}_{sensor}_{1000 * delay:g}"
        if key not in known:
            known[key] = simulate(Setup(
                sensor=preset(sensor).delayed(delay), size=(SIDE, SIDE), wind=wind, sky="cardioidal", patch=0.06,
                view_zenith=zenith, view_azimuth=135.0 + azimuth, objects=thesis_array((SIDE, SIDE), 0.25, sides=(16,)),
            ))  # fmt: skip
        scene = known[key]
        image = scene.image.copy()
        if glint != "everywhere":
            image[..., : SIDE // (1 if glint == "nowhere" else 2)] = scene.truth_image[
                ..., : SIDE // (1 if glint == "nowhere" else 2)
            ]
        write_scene(replace(scene, image=image), place / "scene", overwrite=True, truth=False)
        return open_scene(place / "scene.tif"), scene.truth.astype(np.float64)

    return make


def ratios(scene, truth, columns=slice(None)):
    """Error of each band by default over that of the raw one, and the fit."""
    fitted = fit_scene(scene, Recipe())
    before, after = (x.astype(np.float64) - truth for x in (scene.read(), correct(scene, fitted)))
    was, now = (np.sqrt((x[..., columns] ** 2).mean(axis=(1, 2))) for x in (before, after))
    return now / was, fitted


@pytest.mark.parametrize(
    ("wind", "zenith", "sensor", "delay"),
    [(5.0, 40.0, "thesis", 0.0), (5.0, 20.0, "thesis-f30", 0.06), (9.0, 40.0, "thesis", 0.06)],
)
def test_looking_away_from_the_glint(made, wind, zenith, sensor, delay):
    found, fitted = ratios(*made(wind, zenith, sensor=sensor, delay=delay))
    assert found.max() <= WORSE
    assert len(fitted.chain.before) < 2 or fitted.needs.glinted


@pytest.mark.parametrize("sensor", ["thesis", "thesis-f30"])
def test_without_glint_nothing_is_changed_whatever_lies_in_the_water(made, sensor):
    scene, truth = made(5.0, 0.0, sensor=sensor, glint="nowhere")
    found, fitted = ratios(scene, truth)
    assert (found == 1).all()
    assert not fitted.chain.runs
    assert max(fitted.needs.things) > LITTLE_GLINT  # corners of the squares stand out


def test_a_half_without_glint(made):
    scene, truth = made(5.0, 0.0, glint="half")
    assert ratios(scene, truth, slice(SIDE // 2))[0].max() <= WORSE
    assert ratios(scene, truth)[0].max() < 0.1


# ---------------------------------------------------------------------------------------- what glint, what things add


def noise(bands, pixels=50_000, seed=0):
    return np.random.default_rng(seed).standard_normal((bands, pixels))


def told(away):
    bands = range(len(away))
    return standing_out(list(away), [0.0] * len(away), [1.0] * len(away), list(bands), bands[-1])


def test_noise_is_neither_glint_nor_a_thing():
    assert np.max(told(noise(4))) < 0.1 * LITTLE_GLINT


def test_what_shows_in_the_nir_or_in_one_band_is_glint_and_what_shows_in_neighbours_alone_is_a_thing():
    away = noise(4)
    away[:, :100] = 20  # a flash that every band sees
    away[0, 100:200] = 20  # one that a single band sees
    away[1:3, 200:300] = 20  # something under water
    glint, things = told(away)
    once = 100 * 20**2 / away.shape[1]
    np.testing.assert_allclose(glint, [2 * once, once, once, once], rtol=0.01)
    np.testing.assert_allclose(things, [0, once, once, 0], atol=0.01)


def test_chance_in_the_nir_makes_no_glint_of_a_thing():
    away = noise(4)
    away[:3, :2000] = 150
    away[3, :2000] += 1.5  # waves that mirror the sky: many of them exceed 3 there
    assert (away[3, :2000] > COVER_K).mean() > 0.03
    glint, things = told(away)
    np.testing.assert_allclose(glint, 0, atol=1e-9)
    assert min(things[:3]) > 800


def test_a_thing_is_as_bright_as_its_neighbour_shows():
    away = noise(3)
    away[0, :50], away[1, :50] = 100, 10
    glint, things = told(away)
    count = away.shape[1] / 50
    assert things[0] == pytest.approx((ALIKE * 10) ** 2 / count, rel=0.02)
    assert glint[0] + things[0] == pytest.approx(100**2 / count, rel=0.02)


@given(st.floats(0, 1), st.integers(0, 9))
def test_independent_flashes_pass_for_glint_rather_than_things(share, seed):
    rng = np.random.default_rng(seed)
    away = np.where(rng.random((5, 20_000)) < share, 50.0, 0.0)
    glint, things = told(away)
    assert all(t <= 0.45 * (g + t) for g, t in zip(glint, things, strict=True))


def test_which_bands_are_opened():
    assert Needs(glint=(0.03, 0.03, 0.01), things=(0.0, 0.1, 0.0)).glinted == (0,)
    assert Needs(glint=(1.1 * CLEAR_GLINT, 0.9 * CLEAR_GLINT), things=(9.0, 9.0)).glinted == (0,)
    assert Needs(glint=(0.0, 1.1 * CLEAR_GLINT), things=(9.0, 0.0), nir=1).glinted == (0, 1)
    assert Needs(glint=(0.0, 0.9 * CLEAR_GLINT), things=(9.0, 0.0), nir=1).glinted == (1,)
    assert Needs().glinted == ()


# ------------------------------------------------------------------------------------------- what lies evenly, removed


def test_even_share_of_distributions():
    z = noise(1)[0]
    assert even_share(z) == pytest.approx(1, abs=0.03)
    assert even_share(np.rint(3 * z)) == pytest.approx(1, abs=0.05)
    assert even_share(-(z**2)) > 1.5
    # exponential, of median m = ln 2: the integral of (m - x)^2 e^-x from 0 to m is (1 - m)^2
    lower = (1 - np.log(2)) ** 2
    exact = 2 * lower / (1 + lower)
    assert even_share(np.random.default_rng(1).exponential(size=400_000)) == pytest.approx(exact, rel=0.03)
    assert even_share(np.full(9, 3.0)) == 0
    with pytest.raises(FitError, match="empty"):
        even_share(np.empty(0))


@given(st.integers(0, 99), st.floats(0.01, 100), st.floats(-1e3, 1e3))
def test_even_share_does_not_depend_on_unit_or_level(seed, scale, shift):
    values = np.random.default_rng(seed).gamma(2.0, size=1000)
    assert even_share(scale * values + shift) == pytest.approx(even_share(values), rel=1e-6)


@pytest.mark.parametrize(("sky", "harms"), [(3.0, True), (0.5, False)])
def test_a_band_follows_glint_and_no_sky(sky, harms):
    """Where removal by least squares would add to the error of the truth, it is told so, and where not, not."""
    rng = np.random.default_rng(0)
    shape = 200, 200
    glint, even = rng.gamma(0.3, 2.0, shape), sky * rng.standard_normal(shape)
    block = np.stack([glint + even, 2 * (glint + even)]) + 0.3 * rng.standard_normal((2, *shape))
    index = GlintIndex((1,), (1.0,))
    plan = SamplePlan((0,), (index,), keep="index")
    stats = merge([gather(block, np.ones(shape, np.bool_), plan)], plan)
    slope = np.cov(block[0].ravel(), block[1].ravel())[0, 1] / block[1].var()
    taken = slope * (block[1] - block[1].mean())
    assert ((glint - glint.mean() - taken).var() > glint.var()) == harms
    assert (harmful(index, stats) is not None) == harms
    mixture = stats.mixture(GlintIndex((1,), (0.5,)))
    np.testing.assert_allclose(mixture, 0.5 * block[1].ravel(), rtol=1e-6)
