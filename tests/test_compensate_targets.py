"""Small targets are distinguished from sparkle by the band delays."""

import json
from dataclasses import asdict, fields, replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from deglint.checks import from_plain
from deglint.compensate.spectra import brightness, reflectances
from deglint.compensate.state import Sample, Setting, State, full_scale
from deglint.compensate.targets import Excess, Targets, extrapolated, fit
from deglint.errors import FitError
from deglint.physics.atmosphere import irradiance
from deglint.physics.presets import preset
from deglint.scene import Band
from deglint.simulate import Setup, simulate
from deglint.simulate.underwater import Bottom

WAVELENGTHS = np.array([425.0, 480, 545, 605, 660, 725, 832, 950])
COLOURS = {
    "white": np.full(8, 0.3),
    "grey": np.full(8, 0.1),
    "blue": np.array([0.38, 0.34, 0.07, 0.03, 0.03, 0.03, 0.03, 0.03]),
    "red": np.array([0.03, 0.03, 0.03, 0.26, 0.48, 0.48, 0.48, 0.48]),
}
CENTRE = 100, 60


def light():
    direct, diffuse = irradiance(WAVELENGTHS, 40.0)
    return np.asarray(direct + diffuse)


def sparkle(rng, shape, dense=0.1):
    """Flashes over 2 x 2 pixels, drawn anew for each band."""
    out = np.zeros((8, *shape))
    for band in out:
        rows, columns = np.nonzero(rng.random(shape) < dense / 4)
        power = rng.lognormal(-1.5, 1.0, rows.size)
        for i in (0, 1):
            for j in (0, 1):
                band[(rows + i) % shape[0], (columns + j) % shape[1]] += power
    return out


def scene(colour=None, size=3, shape=(160, 160), seed=1):
    """Water, sparkle, and a square of a colour; the block, the water, and what the target adds."""
    rng = np.random.default_rng(seed)
    water = 0.02 * light() * np.exp(-(WAVELENGTHS - 425) / 100)
    clean = np.broadcast_to(water[:, None, None], (8, *shape)).copy()
    image = clean + sparkle(rng, shape) * light()[:, None, None]
    added = np.zeros_like(image)
    if colour:
        place = np.s_[:, CENTRE[0] : CENTRE[0] + size, CENTRE[1] : CENTRE[1] + size]
        image[place] = (COLOURS[colour] * light())[:, None, None]
        added[place] = image[place] - clean[place]
    image += 3e-4 * rng.standard_normal(image.shape)
    return image.astype(np.float32), clean.astype(np.float32), added


def setting(offsets):
    bands = [Band(f"b{w:g}", wavelength=w, time_offset=t) for w, t in zip(WAVELENGTHS, offsets, strict=True)]
    return Setting(tuple(bands), (6, 7))


DELAYED = setting(0.06 * np.arange(8))
GROUPS = setting([0.008, 0.3, 0.308, 0.016, 0.316, 0.024, 0.324, 0.0])


def fitted(image, clean, what=DELAYED, **options):
    state = State.of(image)
    state = state if clean is None else replace(state, background=clean)
    return state, fit(Sample((state,), (state.water,)), what, **options)


def contrast(found, added):
    return float((found * added).sum() / (added**2).sum())


@pytest.mark.parametrize("what", [DELAYED, GROUPS], ids=["delayed", "groups"])
@pytest.mark.parametrize("colour", COLOURS)
def test_a_target_of_three_pixels_survives_in_sparkle(colour, what):
    image, clean, added = scene(colour)
    state, stage = fitted(image, clean, what)
    targets = stage.apply(state).targets
    assert 0.9 < contrast(targets, added) < 1.1
    targets[:, CENTRE[0] - 3 : CENTRE[0] + 6, CENTRE[1] - 3 : CENTRE[1] + 6] = 0
    assert not targets.any()


@pytest.mark.parametrize("seed", [2, 3])
def test_sparkle_alone_has_no_targets_and_the_image_stays(seed):
    image, clean, _ = scene(seed=seed)
    state, stage = fitted(image, clean)
    out = stage.apply(state)
    assert not out.targets.any()
    assert out.image is state.image


@pytest.mark.parametrize(("share", "refused"), [(0.01, False), (0.25, True)])
def test_what_covers_much_of_the_water_is_texture(share, refused):
    image, clean, _ = scene()
    bright = np.kron(np.random.default_rng(7).random((32, 32)) < share, np.ones((5, 5))) > 0
    image[:, bright] += (COLOURS["blue"] / 8 * light() * (WAVELENGTHS < 700))[:, None]  # sand under some metres
    _state, stage = fitted(image, clean)
    assert ("texture" in stage.reason) == refused


def test_texture_of_the_bottom_counts_as_noise_and_faint_glint_does_not():
    image, clean, _ = scene()
    rng, own, rest = np.random.default_rng(8), 3e-4, 0.25  # sparkle is on a tenth of the pixels of each band
    texture = np.array([3, 4, 5, 2, 1, 0, 0, 0]) * own
    bottom = texture[:, None, None] * rng.standard_normal(clean.shape[1:])
    waves = gaussian_filter(rng.standard_normal(clean.shape[1:]), 2) * 7
    direct = irradiance(WAVELENGTHS, 40.0).direct
    glint = 3 * own * waves * direct[:, None, None] / direct.max()

    def found(added):
        stage = fitted((image + added).astype(np.float32), clean)[1]
        return np.array(stage.noise) * stage.light

    np.testing.assert_allclose(found(0), own, rtol=rest)
    np.testing.assert_allclose(found(glint), own, rtol=rest)
    np.testing.assert_allclose(found(bottom), np.hypot(own, texture), rtol=rest)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_sparkle_over_a_bottom_is_no_target(seed):
    """A sea without boats. Without texture in the noise, targets were found in 1.2 % of the pixels."""
    sensor = replace(preset("thesis"), gsd=0.33).delayed(0.02)
    bottom = Bottom(depth=(8.0, 3.0), share=0.3, patch=5.0)
    sea = simulate(Setup(sensor=sensor, size=(256, 256), wind=9.0, seed=seed, patch=0.0, bottom=bottom))
    bands = tuple(Band(b.name, (b.low + b.high) / 2, time_offset=b.time_offset) for b in sensor.bands)
    state = State.of(sea.image.astype(np.float32))
    stage = fit(Sample((state,), (state.water,)), Setting(bands, (6, 7)))
    assert not stage.reason
    assert (stage.apply(state).targets > 0).any(axis=0).mean() < 0.006


def test_dense_boats_are_targets():
    image, clean, _ = scene()
    boats = np.kron(np.random.default_rng(7).random((32, 32)) < 0.02, np.ones((5, 5))) > 0
    image[:, boats] += (COLOURS["white"] * light())[:, None]
    state, stage = fitted(image, clean)
    assert (np.asarray(stage.apply(state).targets) > 0).any(axis=0)[boats].mean() > 0.75


def test_without_a_background_only_what_floats_is_restored():
    class Sure(Targets):  # that every lit pixel is a target
        def score(self, e):
            return np.full(e.shape[1], 50, np.float32), np.zeros(e.shape[1], np.intp)

    image, clean, _ = scene()
    sand = 0.3 * (WAVELENGTHS < 700) * light()  # under some metres of water, which is dark beyond
    image[:, 100:103, 60:63] = clean[:, 100:103, 60:63] + sand[:, None, None]
    stage = fitted(image, clean)[1]
    excess = Excess.of(Sure(**{f.name: getattr(stage, f.name) for f in fields(stage)}), image, None)
    every, afloat = (replace(excess, afloat=a).scores()[0][101, 61] for a in (False, True))
    assert excess.afloat
    assert every == 50
    assert afloat == 0


@pytest.mark.parametrize("step", [0.01, 0.06])
def test_a_clipped_peak_is_a_target_only_if_it_lasts_longer_than_sparkle(step):
    image, clean, added = scene("white")
    full = 0.9 * image[:, CENTRE[0] + 1, CENTRE[1] + 1]
    bands = setting(step * np.arange(8)).bands
    bands = tuple(replace(b, saturation=float(v)) for b, v in zip(bands, full, strict=True))
    state, stage = fitted(np.minimum(image, full[:, None, None]), clean, replace(DELAYED, bands=bands))
    kept = contrast(stage.apply(state).targets, added)
    assert kept > 0.8 if step > 0.05 else kept == 0


def test_saturation_is_declared_or_where_values_pile_up():
    rng = np.random.default_rng(1)
    sparkling = 0.01 + rng.lognormal(-4, 1.2, (2, 200, 200))
    fine = np.round(sparkling * 4000) / 4000
    coarse = np.round(sparkling * 255) / 255

    def found(image, declared=None):
        state = State.of(image)
        bands = (Band("a", saturation=declared), Band("b"))
        return full_scale(Sample((state,), (state.water,)), Setting(bands, (1,)))

    assert np.isinf(found(fine)).all()
    assert found(fine, 0.5) == pytest.approx([0.999 * 0.5, np.inf])
    assert found(np.minimum(fine, 0.4), 16.0) == pytest.approx([0.999 * 0.4] * 2)
    assert np.isinf(found(np.minimum(coarse, 51 / 255))).all()


def test_flashes_that_last_for_half_of_the_bands_are_sparkle():
    image, clean, _ = scene()
    rng = np.random.default_rng(5)
    for row, column in rng.integers(10, 150, (60, 2)):
        first = rng.integers(0, 5)
        image[first : first + 4, row : row + 2, column : column + 2] += light()[first : first + 4, None, None] * 0.3
    state, stage = fitted(image, clean)
    assert not stage.apply(state).targets.any()


def test_without_a_background_the_image_is_left_without_targets():
    image, _, added = scene("white", 2)
    state, stage = fitted(image, None, GROUPS)
    out = stage.apply(state)
    assert np.array_equal(out.image, state.image - out.targets)
    assert contrast(out.targets, added) > 0.75  # the local mean holds some of the target


@pytest.mark.parametrize(
    ("offsets", "word"),
    [([None] * 8, "not known"), ([0.0] * 8, "less than 10 ms"), ([0.0] * 7 + [0.1], "less than 10 ms")],
)
def test_without_instants_there_is_no_test_and_a_reason(offsets, word):
    image, clean, _ = scene("white")
    bands = setting(offsets).bands
    infrared = replace(bands[-1], wavelength=1600.0)  # its instant does not matter, as it is not tested
    state, stage = fitted(image, clean, Setting((*bands[:-1], infrared), (6, 7)))
    assert word in stage.reason
    assert stage.halo == 0
    assert stage.apply(state) is state


@pytest.mark.parametrize("background", [True, False])
def test_a_block_with_its_halo_is_the_same_as_the_whole_inside(background):
    image, clean, _ = scene("white")
    state, stage = fitted(image, clean if background else None)
    whole, h = stage.apply(state).targets, stage.halo
    inner = np.s_[:, CENTRE[0] - 5 : CENTRE[0] + 2, CENTRE[1] - 6 : CENTRE[1] + 20]
    outer = np.s_[:, inner[1].start - h : inner[1].stop + h, inner[2].start - h : inner[2].stop + h]
    block = State.of(image[outer])
    block = replace(block, background=clean[outer]) if background else block
    found = stage.apply(block).targets[:, h:-h, h:-h]
    assert found.any()
    np.testing.assert_allclose(found, whole[inner], rtol=1e-4, atol=1e-6)


def test_serialised_it_finds_the_same():
    image, clean, _ = scene("red")
    state, stage = fitted(image, clean)
    again = from_plain(Targets, json.loads(json.dumps(asdict(stage))))
    assert np.array_equal(again.apply(state).targets, stage.apply(state).targets)


def test_saved_before_flashes_were_known_it_finds_the_same():
    image, clean, _ = scene("red")
    state, stage = fitted(image, clean)
    saved = {k: v for k, v in asdict(stage).items() if k not in ("glint", "time", "flash_share")}
    assert np.array_equal(Targets(**saved).apply(state).targets, stage.apply(state).targets)


def test_bands_in_another_order_give_the_same():
    image, clean, _ = scene("blue")
    state, stage = fitted(image, clean, GROUPS)
    order = np.random.default_rng(0).permutation(8)
    other = Setting(tuple(GROUPS.bands[i] for i in order), (6, 7))
    moved, permuted = fitted(image[order], clean[order], other)
    assert permuted.threshold == pytest.approx(stage.threshold)
    expected = stage.apply(state).targets[order]
    np.testing.assert_allclose(permuted.apply(moved).targets, expected, rtol=1e-3, atol=1e-5)


def test_a_lower_false_alarm_rate_asks_for_more():
    image, clean, _ = scene()
    assert fitted(image, clean, number=1e-8)[1].threshold > fitted(image, clean)[1].threshold


def test_sparkle_that_lasts_raises_the_threshold():
    image, clean, _ = scene(seed=4)
    lasting = image.copy()
    flash = np.random.default_rng(6).random((160, 160)) < 0.03
    lasting[:7, flash] += 0.2 * light()[:7, None]
    assert fitted(lasting, clean)[1].threshold > fitted(image, clean)[1].threshold + 5


@pytest.mark.parametrize(("share", "refused"), [(0.02, False), (0.6, True)])
def test_sparkle_that_outlasts_the_bands_cannot_be_distinguished(share, refused):
    """A share of the flashes has nearly the same brightness in all bands."""
    image, clean, _ = scene()
    rng = np.random.default_rng(5)
    steady = sparkle(rng, image.shape[1:])[0] * (rng.random(image.shape[1:]) < share)
    changing = sparkle(rng, image.shape[1:], 0.1 * (1 - share))
    glint = steady * (1 + 0.05 * rng.standard_normal(image.shape)) + changing
    image = (clean + glint * light()[:, None, None] + 3e-4 * rng.standard_normal(image.shape)).astype(np.float32)
    _state, stage = fitted(image, clean)
    assert ("lasts" in stage.reason) == refused


def test_flashes_that_grow_and_fade_through_all_bands_are_no_targets():
    """400 flashes of two pixels, whose brightness changes with time, which is like a spectrum; and a white boat."""
    rng, time = np.random.default_rng(5), np.arange(8) / 7
    clean = scene()[1].astype(np.float64)
    glint, boat = np.zeros_like(clean), np.zeros(clean.shape[1:], np.bool_)
    for row, column in rng.integers(0, 158, (400, 2)):
        life, middle = rng.exponential(0.5), rng.uniform(-0.5, 1.5)
        flash = rng.lognormal(-1.0, 1.0) * np.exp(-(((time - middle) / life) ** 2))
        glint[:, row : row + 2, column : column + 2] += flash[:, None, None]
    boat[80:85, 40:44] = True
    clean[:, boat] = (COLOURS["white"] * light())[:, None]
    image = clean + glint * irradiance(WAVELENGTHS, 40.0).direct[:, None, None]
    image = (image + 3e-4 * rng.standard_normal(clean.shape)).astype(np.float32)
    state, stage = fitted(image, scene()[1])
    found, without = ((s.apply(state).targets > 0).any(axis=0) for s in (stage, replace(stage, flash_share=0.0)))
    away = np.ones_like(boat)
    away[75:90, 35:49] = False
    assert 0.003 < stage.flash_share < 0.06  # 1600 pixels of flashes are 6 %
    assert found[away].mean() < 1e-4 < 1e-3 < without[away].mean()
    assert found[boat].mean() > 0.9


def test_extrapolation_does_not_count_targets():
    assert extrapolated(0.2 * 0.7 ** np.arange(7) + 0.01) == pytest.approx(0.2 * 0.7**6)
    assert extrapolated(np.full(7, 0.01)) == 0


def test_scores_are_those_of_the_normal_distributions():
    """The oracle: densities of scipy, spectrum by spectrum."""
    from scipy.stats import multivariate_normal

    image, clean, _ = scene("white")
    _, stage = fitted(image, clean)
    e = np.array([[40.0, 5.0], [42, 6], [39, 4], [41, 5], [40, 300], [38, 6], [43, 4], [40, 5]], np.float32)
    (S, kind), level = stage.score(e), brightness(e)
    values, factors, weight = reflectances(np.array(stage.wavelengths), np.array(stage.widths))
    water = np.array(stage.water)
    for pixel in (0, 1):
        A = 2.0 ** level[pixel]
        every = []
        for v, F, w in zip(values, factors, weight, strict=True):
            V = np.square(stage.noise) + (0.03 * A) ** 2 * v + (0.05 * water) ** 2
            C = A * A * F.T @ F + 0.25 * np.outer(water, water) + np.diag(V)
            every.append(np.log(w) + multivariate_normal(np.zeros(8), C).logpdf(e[:, pixel]))
        assert kind[pixel] == np.argmax(every)
        assert S[pixel] == pytest.approx(max(every) - stage.sparkle(e)[pixel], rel=1e-2, abs=0.05)
    assert S[0] > 2 > S[1]


def test_a_sample_without_pixels_is_an_error():
    with pytest.raises(FitError, match="sample"):
        fitted(np.full((8, 20, 20), np.nan, np.float32), None)
