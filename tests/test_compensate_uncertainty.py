"""Standard errors of compensated images against errors of known water."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from scipy.ndimage import gaussian_filter, grey_opening

from deglint import Recipe, remove_glint
from deglint.compensate.posterior import LeftOver, Posterior
from deglint.compensate.state import Sample, Setting, State
from deglint.compensate.uncertainty import ReplacedError, fit_removed, fit_replaced, halo, stderr
from deglint.pipeline.flags import PROTECTED
from deglint.remove import BandFit, GlintIndex, GlintModel
from deglint.scene import Band

SAMPLES = Path(__file__).parents[1] / "sample_data"
BANDS = (Band("B", 490), Band("NIR", 840))
NOTHING = GlintModel("wiener", (GlintIndex((1,), (1.0,)),), (), ("B", "NIR"))
BOTH = replace(NOTHING, fits=tuple(BandFit(b, name, 0, 0.0) for b, name in enumerate(NOTHING.band_names)))


def opened(state):
    """A chain of one stage: what exceeds an opening is replaced by it."""
    level = np.stack([grey_opening(b, (9, 9)) for b in state.raw]) + 2.0
    glint = state.raw > level + 1.5
    return State(state.raw, np.where(glint, level, state.raw).astype(np.float32), state.water, replaced=glint)


def state_and_water(seed, contrast=15):
    rng = np.random.default_rng(seed)
    water = np.full((2, 160, 160), 50.0)
    water[:, 40:70, 40:70] += contrast
    glint = np.maximum(gaussian_filter(rng.normal(size=water.shape), (0, 1, 1)) * 300 - 120, 0)
    raw = (water + glint + rng.normal(size=water.shape)).astype(np.float32)
    return State(raw, raw, np.ones(raw.shape[1:], bool)), water


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_trial_tells_the_error_of_what_was_replaced(seed):
    state, water = state_and_water(seed)
    done = opened(state)
    nothing = np.zeros_like(state.raw)
    errors = fit_replaced(Sample((state,), (state.water,)), Sample((done,), (state.water,)), [nothing], opened)
    claimed = stderr(done, BOTH, errors)
    for mask in (done.replaced, ~done.replaced):
        ratio = np.sqrt(np.mean(claimed[mask] ** 2) / np.mean((done.image - water)[mask] ** 2))
        assert 0.6 < ratio < 1.5


@pytest.mark.parametrize("strength", [0.0, 1.0, 20.0])
def test_faint_glint_in_a_band_that_the_removal_does_not_correct_is_in_its_error(strength):
    state, water = state_and_water(4, contrast=0)
    rng = np.random.default_rng(5)
    faint = np.stack([0 * water[0], strength * np.maximum(5 * gaussian_filter(rng.normal(size=water[0].shape), 2), 0)])
    done = opened(state)
    done = replace(done, image=(done.image + faint).astype(np.float32))
    errors = fit_replaced(Sample((state,), (state.water,)), Sample((done,), (done.water,)), [0 * state.raw], opened)
    blue = replace(NOTHING, fits=BOTH.fits[:1])
    claimed, alone = stderr(done, blue, errors), stderr(done, BOTH, errors)
    np.testing.assert_array_equal(claimed[0], alone[0])
    assert 0.8 < np.sqrt(np.mean(claimed[1] ** 2) / np.mean((done.image - water)[1] ** 2)) < 1.35


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_objects_in_a_trial_tell_the_error_at_round_edges_that_the_sample_lacks(seed):
    plain = state_and_water(seed, contrast=0)[0]
    sample = Sample((plain,), (plain.water,)), Sample((opened(plain),), (plain.water,))
    rows, columns = np.mgrid[:160, :160]
    disc = gaussian_filter(10.0 * (np.hypot(rows % 40 - 20, columns % 40 - 20) < 7), 1).astype(np.float32)
    objects = np.stack([disc, disc])
    state, water = state_and_water(seed + 10, contrast=0)
    done, water = opened(replace(state, raw=state.raw + 2 * objects)), water + 2 * objects
    seen = done.replaced & (objects > 0.5)
    real = np.sqrt(np.mean((done.image - water)[seen] ** 2))
    for added, low, high in ((0 * objects, 0.0, 0.3), (objects, 0.6, 1.5)):
        claimed = stderr(done, BOTH, fit_replaced(*sample, [added], opened))[seen]
        assert low < np.sqrt(np.mean(claimed**2)) / real < high


def test_errors_of_slope_and_level_add_to_those_of_the_water():
    fit = BandFit(0, "B", 0, 2.0, stderr=0.2)
    model = GlintModel("wiener", NOTHING.indexes, (fit,), ("B", "NIR"), level_stderr=0.5)
    ones = np.ones((2, 8, 8), np.float32)
    state = State(ones, ones, np.ones((8, 8), bool), removed=30 * ones, variance=4 * ones)
    out = stderr(state, model)
    np.testing.assert_allclose(out[0], np.sqrt(4 + 9 + 1), rtol=1e-6)
    np.testing.assert_allclose(out[1], 2, rtol=1e-6)


def test_noise_counts_once_after_a_posterior_mean_and_a_replacement():
    x = (10 + np.random.default_rng(0).standard_normal((2, 40, 40))).astype(np.float32)
    left_half = np.zeros(x.shape, bool)
    left_half[:, :20] = True
    state = State(x, x, np.ones((40, 40), bool), removed=np.zeros_like(x), replaced=left_half, errors=True)
    stage = Posterior(4, (LeftOver(0, 1.0, (0.0,), (0.0,)),), (np.inf,) * 2)  # of the first band alone
    out = stderr(stage.apply(state), BOTH, [ReplacedError(b, 1.0, 0.25, 0.0, 10.0) for b in (0, 1)])
    np.testing.assert_allclose(out[:, :20], 0.5)
    np.testing.assert_allclose(out[:, 20:], 1.0)


def test_the_error_of_the_slope_where_glint_moved_between_the_bands():
    rng = np.random.default_rng(5)
    moved, seen = (np.float32(5) * rng.standard_normal((2, 192, 192)).astype(np.float32) + 20 for _ in range(2))
    nir, rho = moved[1], 0.8
    band = rho * nir + np.sqrt(1 - rho**2) * seen[0]
    raw = np.stack([50 + band, nir]).astype(np.float32)
    removed = np.stack([rho * nir, 0 * nir]).astype(np.float32)  # the slope of least squares, where 1 was right
    state = State(raw, raw - removed, np.ones(nir.shape, bool), removed=removed, errors=True)
    said = []
    for r2 in (1.0, rho**2):
        model = GlintModel("wiener", NOTHING.indexes, (BandFit(0, "B", 0, rho, r2=r2),), ("B", "NIR"))
        left = fit_removed(Sample((state,), (state.water,)), Setting(BANDS, (1,)), model)
        assert not left.resolved
        said.append(stderr(left.apply(state), model)[0])
    more = np.mean(said[1] ** 2 - said[0] ** 2) / np.mean(((1 / rho - 1) / np.sqrt(3) * removed[0]) ** 2)
    assert more == pytest.approx(1, abs=0.03)


def test_without_a_trial_there_is_no_halo():
    assert halo(()) == 0
    assert halo((ReplacedError(0, 1.0, 1.0, 0.0, 0.0),)) > 0


@pytest.mark.slow
def test_what_removal_leaves_is_in_the_error_of_every_chain_that_ends_with_it(tmp_path):
    said = {}
    for chain in ("off", "targets, remove"):
        recipe = Recipe(method="wiener", compensate=chain)
        outputs = {what: tmp_path / f"{what}.tif" for what in ("stderr", "flags")}
        remove_glint(SAMPLES / "sea_1m.tif", tmp_path / "out.tif", recipe, overwrite=True, **outputs)
        with rasterio.open(outputs["stderr"]) as errors, rasterio.open(outputs["flags"]) as flags:
            said[chain] = errors.read()[:, flags.read(1) & PROTECTED == 0]
    alone, among = (np.sqrt(np.nanmean(v**2, axis=1)) for v in said.values())
    assert (among > 0.4 * alone).all(), among / alone
