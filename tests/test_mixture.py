"""Removal after an opening: kernels that an object does not draw, and the noise that replacing cuts off."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from deglint import Recipe, correct, fit_scene, open_scene, remove
from deglint.compensate.stages import apply_stages, fit_stages, parse
from deglint.compensate.state import Sample, Setting, State
from deglint.pipeline.sample import offshore
from deglint.remove import SampleTile, mixture, nir_request
from deglint.scene import Band

from .common import whole_tile

BANDS = (Band("GREEN", 560.0), Band("RED", 660.0), Band("NIR", 840.0))


def faint_glint(seed=0, shape=(192, 256)):
    """Glint that an opening has left, and water whose green and red have noise of their own."""
    rng = np.random.default_rng(seed)
    glint = 30 * np.maximum(gaussian_filter(rng.normal(size=shape), 5) * 15, 0)
    water = np.array([100, 50, 5.0])[:, None, None] + rng.normal(size=(3, *shape))
    return (water + glint * np.array([1.2, 1.1, 1.0])[:, None, None]).astype(np.float32), glint


def fitted(block):
    return mixture.fit(nir_request(BANDS, [2], regression="detrended"), [whole_tile(block)], 0.02)


def test_an_object_under_a_clump_of_glint_does_not_draw_the_kernels():
    block, glint = faint_glint()
    row, column = np.unravel_index(glint[20:-20, 20:-20].argmax(), (152, 216))
    covered = block.copy()
    covered[0, row + 12 : row + 28, column + 12 : column + 28] += 1000
    alone, among = ([sum(i.weights) for i in fitted(b).indexes] for b in (block, covered))
    assert alone[0] == pytest.approx(1.2, rel=0.1)
    assert among == pytest.approx(alone, rel=0.1)


def test_the_level_is_that_of_the_pixels_without_glint():
    block, glint = faint_glint()
    calm = glint == 0
    model = mixture.fit(nir_request(BANDS, [2], regression="detrended"), [whole_tile(block)], float(calm.mean()))
    water = np.median(remove.apply(block, model)[:, calm], axis=1)
    assert water[:2] == pytest.approx([100, 50], abs=0.5)


def test_the_level_is_raised_by_what_is_cut():
    block, _ = faint_glint()
    tiles, request = [whole_tile(block)], nir_request(BANDS, [2], regression="detrended")
    plain, raised = (remove.apply(block, mixture.fit(request, tiles, 0.02, cut)) for cut in (None, (2.0, 1.0, 0.0)))
    assert np.median(raised - plain, axis=(1, 2)) == pytest.approx([2, 1, 0], abs=1e-3)


def test_no_pixel_becomes_darker_than_the_water():
    """Where the NIR alone is bright, the prediction is too large; what was dark before keeps its value."""
    block, _ = faint_glint()
    request = nir_request(BANDS, [2], regression="detrended")
    model = mixture.fit(request, [whole_tile(block)], 0.02)
    seen = block.copy()
    seen[2, 20:30, 20:30] += 50
    seen[:2, 25, 25] -= 30
    out = remove.apply(seen, model)
    assert len(model.fits) == 2
    for fit in model.fits:
        assert (out[fit.band] >= np.minimum(seen[fit.band], fit.floor) - 1e-4).all()
        assert out[fit.band, 25, 25] == seen[fit.band, 25, 25] < fit.floor
        assert out[fit.band, 22:24, 22:24] == pytest.approx(fit.floor, abs=1e-4)


def test_what_replacing_cuts_is_known():
    block = (100 + 3 * np.random.default_rng(1).normal(size=(3, 256, 256))).astype(np.float32)
    state = State.of(block)
    steps = parse("identify-level:7, replace-level")[:-1]
    stages, _ = fit_stages(steps, Sample((state,), (state.water,)), Setting(BANDS, (2,)))
    fallen = (block - apply_stages(state, stages).image).mean()
    assert fallen == pytest.approx(np.mean(stages[0].cut), rel=0.15)
    assert fallen > 1


def test_the_sample_keeps_a_window_from_land_where_that_leaves_enough():
    water = np.ones((64, 64), bool)
    water[:, 50:] = False
    tile = SampleTile(np.zeros((3, 64, 64), np.float32), water, water)
    (wide,), (narrow,) = offshore([tile], 7), offshore([tile], 31)
    np.testing.assert_array_equal(wide.sample, np.arange(64) < np.full((64, 1), 44))
    np.testing.assert_array_equal(narrow.sample, water)


@pytest.mark.parametrize(
    "chain",
    [
        "identify-level:13, replace-level",
        "psf:2, identify-level:13, targets, replace-level, remove",
        "targets, remove, posterior",
    ],
)
def test_the_unit_does_not_matter_along_a_shore(chain, tmp_path, write):
    """Land and mixed pixels in the NIR are replaced by the mean of the water: in digital numbers and in reflectance."""
    rng = np.random.default_rng(0)
    glint = gaussian_filter(rng.normal(size=(256, 320)), 3)
    glint = np.maximum(glint / glint.std(), 0) ** 2
    water = np.array([300, 400, 250, 60.0])[:, None, None]
    scene = water + 60 * glint * np.array([1.1, 1.05, 1, 1])[:, None, None] + rng.normal(0, 3, (4, 256, 320))
    scene[:, :, :90] = np.array([300, 500, 450, 3000.0])[:, None, None] + rng.normal(0, 60, (4, 256, 90))
    clean = []
    for factor in (1, 1e-4):
        opened = open_scene(write(tmp_path / f"{factor}.tif", (scene * factor).astype(np.float32)))
        clean.append(correct(opened, fit_scene(opened, Recipe(method="wiener", compensate=chain))) / factor)
    numbers, reflectance = clean
    np.testing.assert_allclose(reflectance, numbers, rtol=0, atol=0.1)
    shore = np.median(numbers[:3, :, 90:92], axis=1) - water[:3, 0]
    assert np.abs(shore).max() < 5
