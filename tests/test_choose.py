"""Candidates are ranked by what they leave of glint and of implanted signals."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import rasterio

from deglint import Recipe, fit_scene, open_scene
from deglint.choose import candidates
from deglint.choose.candidates import Candidate, windows
from deglint.choose.implants import gains, implants
from deglint.choose.score import (
    EDGES,
    SCALES,
    erased,
    expected_errors,
    least_glint,
    least_signal,
    level_excess,
    partners,
    powers,
)
from deglint.choose.trial import NOT_JUDGED, Choice, Trial, _best, _check, _own_signal, without_ships, without_shore
from deglint.compensate import Chain, Sample, Setting, State
from deglint.compensate.chain import FittedChain
from deglint.errors import FitError, InputError
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.remove import BandFit, GlintIndex, GlintModel
from deglint.scene import Band
from deglint.simulate import Setup, simulate
from deglint.simulate.underwater import Bottom

from .common import WATER

BANDS = tuple(Band(n, w) for n, w in (("blue", 480.0), ("green", 560.0), ("red", 660.0), ("nir", 840.0)))
LEVEL = np.array([0.05, 0.04, 0.02, 0.01], np.float32)
INSIDE = np.ones((128, 128), np.bool_)


def signals(seed=0):
    return implants(INSIDE, BANDS, LEVEL, 8.0, seed)


def test_what_is_scaled_has_that_gain():
    added = [signals(n) for n in range(3)]
    factors = np.linspace(0.2, 1.1, len(added[0].names), dtype=np.float32)
    responses = [np.einsum("s,sb,sij->bij", factors, a.colours, a.patterns) for a in added]
    found = gains(responses, added, [INSIDE] * 3, LEVEL)
    assert list(found.values()) == pytest.approx(factors, abs=0.02)


def test_signals_differ_from_tile_to_tile_and_are_the_same_every_time():
    assert np.array_equal(signals(1).total, signals(1).total)
    assert not np.array_equal(signals(1).total, signals(2).total)


def test_bright_and_dark_discs_lie_in_the_evaluated_part_of_a_tile():
    for seed in range(4):
        for place in (np.s_[:128, :128], np.s_[32:, :128], np.s_[32:, 32:]):  # the halo of tiles at the border
            inside = np.zeros((160, 160), np.bool_)
            inside[place] = True
            one = implants(inside, BANDS, LEVEL, 16.0, seed)
            discs = one.patterns[one.names.index("discs")][inside]
            assert (discs > 0).any(), (place, seed)
            assert (discs < 0).any(), (place, seed)


def test_a_class_band_changes_no_signal_of_the_others():
    beside = implants(INSIDE, (*BANDS, Band("classes")), np.append(LEVEL, np.float32(6)), 8.0, 0)
    np.testing.assert_array_equal(beside.colours[:, :4], signals().colours)


def test_textures_have_the_power_they_were_given_at_their_scale():
    one = signals()
    for k, name in enumerate(n for n in one.names if n.startswith("texture")):
        image = one.patterns[k][None] / one.patterns[k].std()
        found = powers([image], [INSIDE], np.ones(1, np.float32))
        assert found.argmax() == k, name
        assert found.sum() == pytest.approx(1.0, rel=0.5)


def test_bands_that_do_not_count_have_no_power():
    image = np.random.default_rng(0).standard_normal((2, 64, 64)).astype(np.float32)
    both, one = (powers([image], [INSIDE[:64, :64]], np.array(u, np.float32)) for u in ((1, np.inf), (1, 1)))
    assert both == pytest.approx(powers([image[:1]], [INSIDE[:64, :64]], np.ones(1, np.float32)))
    assert not np.allclose(both, one)


@pytest.mark.parametrize(
    ("power", "gain", "best"),
    [
        ([[9.0, 0, 0, 0], [1.0, 0, 0, 0]], [[1.0] * 4, [1.0] * 4], 1),  # what leaves less is better
        ([[1.0, 1, 0, 0], [0.5, 0.01, 0, 0]], [[1.0] * 4, [1.0, 0.1, 1, 1]], 0),  # not by erasing signals
        ([[0.1] * 4, [0.1, 0.1, 0.1, 0.02]], [[1.0] * 4, [1.0, 1, 1, 0.2]], 0),  # nor plumes
        ([[4.0, 4, 0, 0], [0.2, 0.2, 0, 0]], [[1.0] * 4, [0.6, 0.6, 1, 1]], 1),  # a little loss for much glint
    ],
)
def test_the_least_expected_error(power, gain, best):
    found = expected_errors(np.array(power), (np.array(power),) * 2, np.array(gain, float), np.ones(2))
    assert found.argmin() == best


def test_edges_of_the_scene_do_not_speak_against_an_opening():
    """Signal that the opening keeps as well as the posterior mean, which leaves glint; it would erase fine texture."""
    power = np.array([[2, 2, 2, 0.1], [0.071, 0.071, 0.071, 0.02], [0.042, 0.042, 0.042, 0.02]])
    gain, discs = np.array([[1.0] * 4, [0.9, 0.9, 0.9, 1], [0.4, 0.4, 0.5, 1]]), np.array([1.0, 0.97, 0.9])
    texture, edges = (expected_errors(power, (power, power), gain, discs, edges=e)[2] for e in (0.0, EDGES))
    assert edges < 0.6 * texture
    same = expected_errors(power, (power, power), np.ones((3, 4)), np.ones(3))
    np.testing.assert_array_equal(
        expected_errors(power, (power, power), np.ones((3, 4)), np.ones(3), edges=EDGES), same
    )


def test_a_bright_reef_that_a_removal_keeps_is_not_lost_as_plumes_are():
    """The coarsest signal is large; the removal takes plumes, and in the second case this signal, too."""
    fine, gain = np.array([[0.02] * 3, [0.001] * 3]), np.array([[1.0] * 4, [1.0, 1.0, 1.0, 0.6]])
    kept, taken = (np.column_stack([fine, [0.8, 0.8 * share]]) for share in (1.0, 0.36))
    errors = [expected_errors(p, (p, p), gain, np.ones(2)) for p in (kept, taken)]
    assert errors[0][1] < errors[0][0]
    assert errors[1][1] > 3 * errors[0][1]


def test_lost_objects_cost():
    same = np.full((2, 4), 0.01)
    found = expected_errors(same, (same, same), np.ones((2, 4)), np.array([1.0, 0.0]))
    assert found[0] < found[1]


def test_bands_with_other_sparkle_share_the_water_alone():
    rng = np.random.default_rng(3)
    water, sparkle = rng.standard_normal((1, 128, 128)), rng.exponential(2.0, (2, 128, 128))
    image, unit = (water + sparkle).astype(np.float32), np.ones(2, np.float32)
    power, shared = (powers([image], [INSIDE], unit, partner_of=p)[None] for p in (None, {0: 1, 1: 0}))
    own = powers([water.astype(np.float32)], [INSIDE], np.ones(1, np.float32))
    np.testing.assert_allclose(shared[0, :-1], own[:-1], rtol=0.2)
    kept = np.ones((1, len(SCALES)))
    assert expected_errors(power, (shared, shared), kept, np.ones(1)) == pytest.approx(2, rel=0.05)
    assert expected_errors(power, (power, power), kept, np.ones(1)) == pytest.approx(0, abs=1e-6)


def test_the_partner_of_a_band_is_the_nearest_in_wavelength_at_another_time():
    waves, times = (450, 480, 560, 660, 850), (0.0, 0.3, 0.31, 0.01, 0.3)
    bands = tuple(Band(f"b{w}", wavelength=w, time_offset=t) for w, t in zip(waves, times, strict=True))
    unit = np.array([1, 1, 1, 1, np.inf], np.float32)
    assert partners(Setting(bands, (4,)), unit) == {0: 1, 1: 0, 2: 3, 3: 2}
    assert partners(Setting((*bands[:2], replace(bands[2], time_offset=0.05)), ()), unit[:3]) == {0: 1, 1: 0, 2: 1}
    unknown = replace(bands[0], wavelength=None), *bands[1:]  # nothing says that it is near in wavelength
    assert partners(Setting(unknown, (4,)), unit)[1] == 3
    assert partners(Setting(tuple(replace(b, time_offset=None) for b in bands), (4,)), unit) == {}


@pytest.mark.parametrize(("scene", "left"), [(0.0, 0.3), (0.2, 0.0), (0.2, 0.3)])
def test_expected_errors_distinguish_the_scene_from_what_is_left_of_glint(scene, left):
    """Noise of the scene everywhere, and what is left of glint in proportion to it: known to a quarter."""
    rng = np.random.default_rng(1)
    glint = cv2.GaussianBlur(rng.standard_normal((128, 128)), (0, 0), 8).clip(0)
    glint /= glint.std()
    image = (scene * rng.standard_normal(glint.shape) + left * glint * rng.standard_normal(glint.shape))[None]
    clear = least_glint([glint[None].astype(np.float32)], [INSIDE])
    found = [powers([image.astype(np.float32)], [INSIDE], np.ones(1, np.float32), c) for c in ((), clear)]
    error = expected_errors(found[0][None], (found[0][None], found[1][None]), np.ones((1, len(SCALES))), np.ones(1))
    assert error == pytest.approx(left * np.sqrt((glint**2).mean()), rel=0.25, abs=0.04)


def test_what_the_nir_does_not_show_is_signal_of_the_scene():
    rng = np.random.default_rng(2)
    glint, bottom = (cv2.GaussianBlur(rng.standard_normal((128, 128)), (0, 0), 3) for _ in range(2))
    spectrum, noise = np.array([1.5, 1.3, 1.1, 1.0], np.float32), np.full(4, 0.001, np.float32)
    unit = np.array([1, 1, 1, np.inf], np.float32)
    sea = (glint * spectrum[:, None, None] + noise[0] * rng.standard_normal((4, 128, 128))).astype(np.float32)
    shallow = sea + np.multiply.outer([10, 5, 0, 0], bottom).astype(np.float32)

    def least(image):
        return least_signal([image], [INSIDE], unit, noise, 3, spectrum)

    own = powers([np.multiply.outer([10, 5, 0, 0], bottom).astype(np.float32)], [INSIDE], unit)
    assert (least(sea) < 1e-5).all()
    assert least(shallow) == pytest.approx(own, rel=0.3)
    penalised = expected_errors(own[None], (own[None], own[None]), np.full((1, 4), 0.5), np.ones(1), least(shallow))
    assert penalised > expected_errors(own[None], (own[None], own[None]), np.ones((1, 4)), np.ones(1), least(shallow))


def test_white_noise_is_no_signal_of_the_scene_at_any_scale():
    image = np.random.default_rng(3).standard_normal((2, 256, 256)).astype(np.float32)
    image[1] = 0
    unit, noise = np.array([1, np.inf], np.float32), np.array([1, 0], np.float32)
    found = least_signal([image], [np.ones((256, 256), bool)], unit, noise, 1, np.ones(2, np.float32))
    assert (found[:3] < 0.01).all()


@pytest.mark.parametrize(("flashing", "own"), [(0.0005, 0.0), (0.25, 1.0)])
def test_a_few_flashes_that_the_nir_misses_are_no_signal_of_the_scene(flashing, own):
    rng = np.random.default_rng(6)
    image = np.ones((4, 128, 128)) + rng.normal(0, 0.01, (4, 128, 128))
    image[2] += 4 * (rng.random((128, 128)) < flashing)
    sample = Sample((State.of(image.astype(np.float32)),), (INSIDE,))
    unit = np.array([1, 1, 1, np.inf], np.float32)
    found = _own_signal(sample, [INSIDE], unit, Setting(BANDS, (3,)), np.ones(4, np.float32))
    expected = powers([image[2:3].astype(np.float32)], [INSIDE], np.ones(1, np.float32)) / 3  # in one band of three
    assert expected[0] > 0.001
    np.testing.assert_allclose(found[0], own * expected[0], rtol=0.05, atol=5e-5)


def test_what_an_opening_takes_beyond_the_glint_of_the_nir_is_erased_signal():
    rng = np.random.default_rng(4)
    glint = np.stack([rng.permuted(rng.exponential(1.0, (128, 128))) for _ in range(4)])  # moves from band to band
    spectrum, unit = np.array([1.5, 1.3, 1.1, 1.0], np.float32), np.array([2, 2, 2, np.inf], np.float32)
    sparkle = (glint * spectrum[:, None, None]).astype(np.float32)
    bottom = np.multiply.outer([10, 0, 0, 0], np.ones((128, 128))).astype(np.float32)

    assert erased([sparkle], [INSIDE], unit, 3, spectrum) == 0
    expected = (10 + 1.5 - 2 * 1.5) / 2 / np.sqrt(3)  # in one of three bands, after twice the mean glint of 1
    assert erased([sparkle + bottom], [INSIDE], unit, 3, spectrum) == pytest.approx(expected, rel=0.02)
    assert erased([sparkle], [~INSIDE], unit, 3, spectrum) == 0


def test_light_above_the_level_of_the_other_kind_of_recipe_is_left_glint():
    sea, unit = np.ones((4, 128, 128), np.float32), np.array([1, 1, 1, np.inf], np.float32)
    results = [[level * sea] for level in (5.0, 3.0, 1.04, 1.0, 2.5, 0.9)]
    found = level_excess(results, [INSIDE], unit, [None, False, False, False, True, True], delayed=False)
    assert found == pytest.approx([0.0, 2.05, 0.09, 0.05, 1.45, 0.0])
    assert not level_excess(results[:2], [INSIDE], unit, [None, True], delayed=False).any(), "nothing to compare with"


def test_sparkle_on_few_pixels_is_left_glint_where_bands_are_delayed():
    sea, unit = np.ones((4, 128, 128), np.float32), np.ones(4, np.float32)
    sparkling = sea.copy()
    sparkling[:, ::8] = 3.0
    found = [level_excess([[sparkling], [sea]], [INSIDE], unit, [False, True], delayed) for delayed in (False, True)]
    np.testing.assert_allclose(found, [[0, 0], [0.2, 0]], atol=1e-6)


def test_windows_fit_the_smallest_object_and_the_clumps():
    assert windows(16.0, 20) == [13]
    assert windows(16.0, 4) == [13, 7]
    assert windows(3.0, 4) == [5]


def test_targets_are_looked_for_where_bands_are_not_simultaneous():
    late = tuple(Band(b.name, b.wavelength, time_offset=0.05 * i) for i, b in enumerate(BANDS))
    chains = ["".join(c.chain for c in candidates(Setting(bands, (3,)), width=16, clump=4)) for bands in (BANDS, late)]
    assert "targets" not in chains[0]
    assert "targets" in chains[1]


def test_ships_do_not_judge_and_the_sea_does():
    image = np.random.default_rng(1).normal(1, 0.1, (2, 80, 80)).astype(np.float32)
    image[1, 40:43, 40:43] += 5
    state = State.of(image)
    (inside,) = without_ships(Sample((state,), (state.water,))).inside
    assert not inside[38:45, 38:45].any()
    assert inside.sum() == 80 * 80 - (3 + 2 * NOT_JUDGED) ** 2


def test_glint_on_a_part_of_the_sea_is_no_ship():
    image = np.random.default_rng(1).normal(1, 0.1, (2, 80, 80)).astype(np.float32)
    image[:, :, 64:] += np.random.default_rng(2).exponential(2, (80, 16)).astype(np.float32)
    state = State.of(image)
    (inside,) = without_ships(Sample((state,), (state.water,))).inside
    assert inside.all()


def test_the_rim_of_land_does_not_judge():
    water = np.ones((80, 80), bool)
    water[:, 60:] = False
    state = State.of(np.ones((2, 80, 80), np.float32), water)
    (inside,) = without_shore(Sample((state,), (water,))).inside
    np.testing.assert_array_equal(inside, np.arange(80) < np.full((80, 1), 60 - NOT_JUDGED))


def test_a_sea_without_glint_is_copied(write, tmp_path):
    noise = np.random.default_rng(0).normal(0, 3, (4, 96, 96))
    scene = open_scene(write(tmp_path / "calm.tif", np.rint(WATER + noise).astype("uint16")))
    fitted = fit_scene(scene)
    assert fitted.choice.best.method == "copy"
    assert not fitted.model.fits
    assert "Nothing was corrected" in fitted.model.warnings[0]


def test_a_dead_band_is_not_judged(write, tmp_path):
    rng = np.random.default_rng(5)
    water = np.array([500, 400, 300, 50])[:, None, None]
    glint, noise = rng.gamma(0.5, 60, (96, 96)), rng.normal(0, 10, (4, 96, 96))
    image = np.rint(water + glint + noise).clip(1).astype("uint16")
    whole = fit_scene(open_scene(write(tmp_path / "whole.tif", image))).choice
    image[0] = 0
    dead = fit_scene(open_scene(write(tmp_path / "dead.tif", image, nodata=65535))).choice
    assert dead.best == whole.best
    assert dead.trials[0].gains["discs"] == pytest.approx(1, abs=0.01), "of the copy"


def test_an_image_without_any_variation_is_copied_without_trials(write, tmp_path):
    image = np.ones((4, 96, 96), np.uint16) * np.array([500, 400, 300, 50], np.uint16)[:, None, None]
    fitted = fit_scene(open_scene(write(tmp_path / "in.tif", image)), Recipe(mask="none"))
    assert (fitted.choice.best.method, fitted.choice.trials) == ("copy", ())
    assert "varies" in fitted.model.warnings[0]


def test_rare_sparkle_at_fine_pixels_is_removed(write, tmp_path):
    """As bright as boats, and in two of a hundred pixels: at pixels that resolve it these are no ships."""
    rng = np.random.default_rng(3)
    clumps = cv2.dilate((rng.random((256, 256)) < 1e-3).astype(np.float32), np.ones((5, 5)))
    glint = 800 * clumps * rng.uniform(0.3, 1, clumps.shape)
    image = np.rint(WATER + rng.normal(0, 3, (4, 256, 256)) + cv2.GaussianBlur(glint, (5, 5), 0.7)).astype("uint16")
    fine = {"transform": rasterio.transform.from_origin(5e5, 4e6, 0.1, 0.1)}
    fitted = fit_scene(open_scene(write(tmp_path / "in.tif", image, **fine)))
    assert fitted.choice.best.method != "copy", fitted.choice.lines()


def test_an_opening_does_not_erase_a_shallow_bottom_in_patches(tmp_path):
    sensor = replace(preset("thesis"), gsd=0.3).delayed(0.02)
    bottom = Bottom(depth=(20, 6), roughness=0.9, share=0.6, patch=3)
    setup = Setup(sensor=sensor, size=(192, 192), wind=10, wind_from=102, sun_zenith=60, seed=2, bottom=bottom)
    write_scene(simulate(setup), tmp_path / "scene")
    choice = fit_scene(open_scene(tmp_path / "scene.tif")).choice
    assert any(t.candidate.opens for t in choice.trials)
    assert choice.best.name == "wiener"


@pytest.mark.parametrize("sample", ["130,130,60,60", "0,130,60,60", "130,0,60,60"])
def test_candidates_are_tried_on_a_sample_at_the_end_of_a_tile(sea, write, tmp_path, sample):
    path = write(tmp_path / "sea.tif", sea(192, 192))
    choice = fit_scene(open_scene(path), Recipe(sample=sample, mask="none")).choice
    assert choice.failed is not None  # tried, and refused: a single square does not show significant glint
    assert "chance" in choice.failed["wiener"]


def test_nothing_is_tried_where_the_user_has_chosen(sea, write, tmp_path):
    scene = open_scene(write(tmp_path / "sea.tif", sea()))
    assert fit_scene(scene, Recipe(method="hedley")).choice is None
    assert fit_scene(scene, Recipe(compensate="off")).choice is None
    found = fit_scene(scene).choice
    assert found.best.method != "copy", found.lines()


@pytest.mark.parametrize(("error", "best"), [(0.109, "posterior"), (0.111, "opening")])
def test_the_simplest_candidate_within_10_percent_of_the_least_error_is_taken(error, best):
    errors = {"copy": 1.0, "wiener": 0.4, "posterior": error, "opening": 0.1}
    trials = tuple(Trial(Candidate(n, n), (), {}, e) for n, e in errors.items())
    assert (chosen := _best(trials).candidate).name == best
    assert "within 10% of the least" in Choice(chosen, trials).why


@pytest.mark.parametrize("given", [{"method": "hedley"}, {"compensate": "off"}])
def test_the_smallest_object_is_for_the_automatic_choice(given):
    with pytest.raises(InputError, match="smallest-object"):
        Recipe(smallest_object="2m", **given)


@pytest.mark.parametrize(("error", "best"), [(0.86, "copy"), (0.84, "wiener")])
def test_a_removal_must_promise_an_improvement_of_15_percent(error, best):
    trials = [Trial(Candidate(n, n), (), {}, e) for n, e in (("copy", 1.0), ("wiener", error))]
    assert _best(trials).candidate.name == best


def test_a_removal_whose_slopes_may_be_chance_is_refused():
    fits = BandFit(0, "blue", 0, 3.0, 1.0), BandFit(1, "green", 0, 4.9, 1.0)
    model = GlintModel("wiener", (GlintIndex((2,), (1.0,)),), fits, ("blue", "green", "nir"))
    fitted = FittedChain(Chain(), model, Sample((), ()))
    with pytest.raises(FitError, match="standard errors above zero"):
        _check(fitted, None)
    _check(replace(fitted, model=replace(model, fits=(fits[0], replace(fits[1], slope=5.1)))), None)
    _check(replace(fitted, model=replace(model, fits=(replace(fits[0], stderr=None),))), None)  # after an opening


def test_a_copy_without_another_candidate_states_no_error(write, tmp_path):
    noise = np.random.default_rng(5).normal(1000, 20, (4, 192, 192)).astype("uint16")
    fitted = fit_scene(open_scene(write(tmp_path / "noise.tif", noise)), Recipe(mask="none"))
    assert (fitted.choice.best.method, fitted.choice.trials) == ("copy", ())
    first, *others = fitted.choice.lines()
    assert first == "no removal can be used: the scene is copied"
    assert [line.split(":")[0].strip() for line in others][:2] == ["wiener", "wiener, posterior mean"]
