"""Half of what an opening took from faint pixels is given back where the NIR shows no glint: by hand, and in scenes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter

from deglint import open_scene, remove_glint
from deglint import tiles as tiling
from deglint.compensate.faint import FAINT, SKIRT, give_back
from deglint.compensate.noise import Spread
from deglint.physics.presets import preset
from deglint.pipeline.sidecar import load_chain, load_model
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate
from deglint.simulate.objects import thesis_array

SIDE, BESIDE = 384, 104


def block(shape=(2, 40, 50), seed=0):
    """A block after an opening and before, where that changed it, and where there is glint."""
    rng = np.random.default_rng(seed)
    own = rng.normal(5, 2, shape).astype(np.float32)
    replaced = rng.random(shape) < 0.2
    own[replaced & (rng.random(shape) < 0.1)] += 30
    image = np.where(replaced, np.float32(4), own)
    return image, own, replaced, rng.integers(0, 3, shape[1:]).astype(np.float32) / 2


def by_hand(image, own, replaced, share, spreads):
    """The same of a whole block, with SciPy's filter."""
    limits = []
    for band, sigma, middle, slope, most, more in spreads:
        above = np.maximum(image[band] - middle, 0)
        limits.append(FAINT * sigma * (1 + np.minimum(above * slope, most)) + more * above)
    strong = replaced & (own - image > limits)
    near = np.array([maximum_filter(s, 2 * SKIRT + 1, mode="constant") for s in strong])
    return np.where(replaced & ~near & (share == 0), image + np.float32(0.5) * (own - image), image)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 39), st.integers(1, 40), st.integers(0, 49), st.integers(1, 50), st.integers(0, 99))
def test_any_part_is_the_same_part_of_the_whole(row, rows, column, columns, seed):
    image, own, replaced, share = block(seed=seed)
    spreads = Spread(0, 1.5), Spread(1, 0.3, 3.5, 0.3, 0.1, 0.4)
    whole = by_hand(image, own, replaced, share, spreads)
    row1, column1 = min(row + rows, 40), min(column + columns, 50)
    top, left = max(row - SKIRT, 0), max(column - SKIRT, 0)
    grown = np.s_[:, top : row1 + SKIRT, left : column1 + SKIRT]
    inner = slice(row - top, row1 - top), slice(column - left, column1 - left)
    part = np.s_[row:row1, column:column1]
    out = np.full_like(image[:, *part], np.nan)
    before = [a.copy() for a in (image, own, replaced, share)]
    args = image[grown], own[grown], replaced[grown], share[part], spreads, inner
    give_back(*args, out)
    np.testing.assert_array_equal(out, whole[:, *part])
    for now, was in zip((image, own, replaced, share), before, strict=True):
        np.testing.assert_array_equal(now, was)
    give_back(*args, image[:, *part])  # in place
    np.testing.assert_array_equal(image[:, *part], whole[:, *part])


def test_bands_that_are_not_opened_and_missing_pixels_stay():
    image, own, replaced, share = block()
    own[1, 5], image[1, 5] = np.nan, np.nan
    out = np.zeros_like(image)
    give_back(image, own, replaced, share, [Spread(1, 1.5)], (slice(0, 40), slice(0, 50)), out)
    np.testing.assert_array_equal(out[0], image[0])
    np.testing.assert_array_equal(np.isnan(out), np.isnan(image))


@pytest.mark.parametrize("texture", [0.0, 0.4, 0.8, 1.2])
def test_half_is_nearer_to_the_truth_than_all_or_nothing(texture):
    """Noise of 1, and water that varies by itself: what lies above a level with nothing of either."""
    rng = np.random.default_rng(1)
    truth = texture * rng.standard_normal((1, 400, 400)).astype(np.float32)
    own = truth + rng.standard_normal(truth.shape, np.float32)
    replaced = own > 1.5
    image = np.where(replaced, np.float32(0), own)
    whole = slice(0, 400), slice(0, 400)
    out = image.copy()
    give_back(image, own, replaced, np.zeros((400, 400), np.float32), [Spread(0, 1.0)], whole, out)
    kept, taken, half = (np.sqrt(((x - truth) ** 2).mean()) for x in (own, image, out))
    assert half < kept
    assert (half < taken) == (texture**2 / (1 + texture**2) > 0.25)  # the share of x that is the water's own


@pytest.mark.parametrize("growth", [(0.0, 0.0, 0.15), (0.03, 3.0, 0.0)])
def test_on_bright_things_more_counts_as_faint(growth):
    """The pixels of a square that is evenly lowered: by more than `FAINT` spreads, but not at that level."""
    own = np.random.default_rng(2).normal(10, 1, (1, 40, 40)).astype(np.float32)
    own[:, 12:28, 12:28] += 150
    image, replaced = own.copy(), np.zeros(own.shape, np.bool_)
    replaced[:, 12:28, 12:28] = True
    image[:, 12:28, 12:28] = 145
    none, whole = np.zeros((40, 40), np.float32), (slice(0, 40), slice(0, 40))
    out, even = image.copy(), image.copy()
    give_back(image, own, replaced, none, [Spread(0, 1.0, 10.0, *growth)], whole, out)
    give_back(image, own, replaced, none, [Spread(0, 1.0)], whole, even)
    assert (own - image)[replaced].min() > FAINT
    np.testing.assert_allclose(out[replaced], (image + own)[replaced] / 2)
    np.testing.assert_array_equal(even, image)


def half_of(place, setup):
    """A scene with its glint in the left half alone, and its truth."""
    scene = simulate(setup)
    image = scene.image.copy()
    image[..., SIDE // 2 :] = scene.truth_image[..., SIDE // 2 :]
    write_scene(replace(scene, image=image), place / "half")
    return place / "half.tif", scene.truth.astype(np.float64)


def errors_beside(path, truth, place):
    """Errors of the bands where there is no glint, relative to the raw ones."""
    calm = np.s_[..., SIDE // 2 + BESIDE :]
    remove_glint(path, place / "out.tif", overwrite=True)
    away = (open_scene(p).read()[calm] - truth[calm] for p in (path, place / "out.tif"))
    raw, clean = (np.sqrt((a**2).mean(axis=(1, 2))) for a in away)
    return clean / raw


@pytest.fixture(scope="module")
def rare(tmp_path_factory):
    """Few flashes across the sun in the left half, and the sky in the waves everywhere."""
    setup = Setup(sensor=preset("thesis").delayed(0.01), size=(SIDE, SIDE), wind=5.0, sky="cardioidal", patch=0.06,
                  view_zenith=40.0, view_azimuth=(Setup.sun_azimuth + 90) % 360)  # fmt: skip
    return half_of(tmp_path_factory.mktemp("rare"), setup)


def test_no_band_is_worse_where_there_is_no_glint(rare, tmp_path, monkeypatch):
    assert (errors_beside(*rare, tmp_path) <= 1.01).all()

    def nothing(image, _own, _replaced, _share, _spreads, within, out):
        out[...] = image[:, *within]

    monkeypatch.setattr("deglint.pipeline.compensated.give_back", nothing)
    assert errors_beside(*rare, tmp_path).max() > 1.01


def test_bright_things_beside_glint_keep_their_brightness(tmp_path, monkeypatch):
    """Squares of 4 m at 5 m depth, through optics that blur them, beside a look into the glint."""
    setup = Setup(sensor=preset("thesis-f30").delayed(0.01), size=(SIDE, SIDE), wind=9.0, sky="cardioidal", patch=0.005,
                  view_zenith=20.0, view_azimuth=(Setup.sun_azimuth + 180) % 360, seed=1,
                  objects=thesis_array((SIDE, SIDE), 0.25, sides=(16,)))  # fmt: skip
    half = half_of(tmp_path, setup)
    assert (errors_beside(*half, tmp_path) <= 1.0).all()
    monkeypatch.setattr("deglint.pipeline.compensation.RARE_COVER", 0.0)  # an element into which they only just fit
    assert (errors_beside(*half, tmp_path) <= 1.0).all()


def test_tiles_do_not_show(rare, tmp_path, monkeypatch):
    path, _ = rare
    remove_glint(path, tmp_path / "a.tif", model_file=tmp_path / "fit.json", threads=1)
    fit = load_model(tmp_path / "fit.json"), load_chain(tmp_path / "fit.json")
    monkeypatch.setattr(tiling, "compact", lambda *_, **_options: (96, 64))
    remove_glint(path, tmp_path / "b.tif", threads=2)
    remove_glint(path, tmp_path / "c.tif", model=fit[0], chain=fit[1])
    for name in ("b", "c"):
        np.testing.assert_array_equal(*(open_scene(tmp_path / f"{n}.tif").read() for n in ("a", name)))
