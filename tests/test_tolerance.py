"""A sample is read until the slopes are known well enough, and no further."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deglint import Recipe, fit_scene, open_scene
from deglint.errors import InputError
from deglint.pipeline import sample as module
from deglint.pipeline.overview import TILE_SIDE
from deglint.remove import METHODS, glint_error, merge, nir_request
from deglint.remove.statistics import gather
from deglint.scene import Band

SLOPES = (1.1, 1.0, 0.9)
PLAIN = {"method": "joyce", "sample": "all", "mask": "none", "compensate": "off"}


@pytest.fixture
def small(monkeypatch):
    """A first batch of six squares in place of eight, so that small scenes do."""
    monkeypatch.setattr(module, "OVERVIEW_PIXELS", 6 * TILE_SIDE**2)


@pytest.fixture
def scene(sea, write, tmp_path):
    def make(side=960, spread=0.0, **layout):
        raw = sea(side, side).astype(np.float32)
        if spread:  # the slopes differ from place to place
            rng = np.random.default_rng(5)
            patches = np.kron(rng.normal(0, spread, (side // 64, side // 64)), np.ones((64, 64)))
            raw[:3] += (patches * (raw[3] - 100)).astype(np.float32)
        return write(tmp_path / f"{len(layout)}{spread:g}.tif", raw, **layout)

    return make


def said(path, tolerance, **options):
    fitted = fit_scene(open_scene(path), Recipe(**(PLAIN | options), tolerance=tolerance))
    return fitted, fitted.sampled.get("tolerance")


def test_stops_early_where_that_is_enough_and_is_as_right_as_it_says(scene):
    fitted, numbers = said(scene(), 0.01)
    assert numbers["met"]
    assert numbers["pixels_read"] < 0.4 * 960**2
    assert numbers["pixels_read"] + numbers["pixels_skipped"] == 960**2
    for fit, true in zip(fitted.model.fits, SLOPES, strict=True):
        assert numbers["relative_standard_error"][fit.name] == pytest.approx(fit.stderr / fit.slope, rel=1e-9)
        assert abs(fit.slope / true - 1) < 0.01
    assert any("tolerance 0.01 of the slopes: reached" in note for note in fitted.notes)


@pytest.mark.usefixtures("small")
def test_reads_more_the_more_is_asked_for_and_errs_less(scene):
    path = scene(spread=0.05)
    read = []
    for tolerance in (0.05, 0.006, 0.004):
        fitted, numbers = said(path, tolerance)
        assert numbers["met"]
        read.append(numbers["pixels_read"])
        for fit, true in zip(fitted.model.fits, SLOPES, strict=True):
            assert fit.stderr / fit.slope <= tolerance
            assert abs(fit.slope / true - 1) < 3 * tolerance
    assert read == sorted(set(read))


@pytest.mark.usefixtures("small")
def test_reads_all_and_warns_where_it_cannot_be_reached(scene):
    path = scene(spread=0.05)
    fitted, numbers = said(path, 1e-5)
    assert not numbers["met"]
    assert numbers["pixels_read"] == 960**2
    assert any("the tolerance 1e-05 was not reached" in w for w in fitted.model.warnings)
    whole = fit_scene(open_scene(path), Recipe(**PLAIN)).model
    for a, b in zip(fitted.model.fits, whole.fits, strict=True):
        assert (a.slope, a.stderr, a.n) == (b.slope, b.stderr, b.n)
    assert fitted.model.indexes == whole.indexes


@pytest.mark.usefixtures("small")
def test_same_for_any_blocks_and_threads(scene):
    found = []
    for threads, layout in ((1, {}), (3, {"tiled": True, "blockxsize": 256, "blockysize": 128})):
        recipe = Recipe(**PLAIN, tolerance=0.005)
        fitted = fit_scene(open_scene(scene(spread=0.05, **layout)), recipe, threads=threads)
        found.append((fitted.model, fitted.sampled["tolerance"]))
    assert found[0] == found[1]
    assert 0 < found[0][1]["pixels_skipped"] < 0.7 * 960**2


def test_single_pixels_are_kept_of_every_batch_alike(monkeypatch, scene):
    monkeypatch.setattr(module, "OVERVIEW_PIXELS", 6 * TILE_SIDE**2)
    monkeypatch.setattr(module, "KEPT_PIXELS", 100_000)
    kept = []
    fit = METHODS["joyce"].fit
    monkeypatch.setitem(
        METHODS, "joyce", module.replace(METHODS["joyce"], fit=lambda r, s: kept.append(s.values.shape[1]) or fit(r, s))
    )
    path = scene(spread=0.05)
    _, early = said(path, 0.5)
    said(path, 1e-5)
    assert kept[0] == pytest.approx(early["pixels_read"] / 4, rel=0.02)
    assert kept[-1] == pytest.approx(960**2 / 16, rel=0.02)


@pytest.mark.slow
def test_an_automatic_sample_is_looked_for_in_more_of_the_scene(sea, write, tmp_path):
    raw = sea(900, 900).astype(np.float32)
    path = write(tmp_path / "in.tif", raw)
    usual = fit_scene(open_scene(path), Recipe("joyce", compensate="off"))
    fitted, easy = said(path, 0.05, sample="auto", mask="auto")
    assert easy["met"]
    assert easy["effective_cells"] > 40
    assert fitted.model.fits[0].n > usual.model.fits[0].n
    fitted, numbers = said(path, 1e-4, sample="auto", mask="auto")
    assert not numbers["met"]
    assert fitted.model.fits[0].n > 2 * usual.model.fits[0].n


@pytest.mark.parametrize("options", [{}, {"method": "multiband", "compensate": "normalise, remove"}])
def test_a_tolerance_is_for_one_method_without_stages(options):
    with pytest.raises(InputError, match=r"tolerance.*--method"):
        Recipe(**options, tolerance=0.02)


def test_clumps_are_not_believed(sea, write, tmp_path):
    """The glint of a scene in a few squares: how sure the slope is cannot be told, and is not said to be known."""
    raw = sea(900, 900).astype(np.float32)
    calm = np.ones((900, 900), bool)
    calm[200:330, 300:500] = False
    raw[:, calm] = np.array([900, 700, 400, 100])[:, None] + np.random.default_rng(1).normal(0, 3, (4, calm.sum()))
    fitted, numbers = said(write(tmp_path / "in.tif", raw), 0.1)
    assert not numbers["met"]
    assert numbers["effective_cells"] < 12
    assert max(numbers["relative_standard_error"].values()) < 0.2 * numbers["wanted"]
    assert any("too few to know the error by" in w for w in fitted.model.warnings)


def statistics(seed, factor=1.0):
    rng = np.random.default_rng(seed)
    glint = rng.gamma(1.0, 10.0, (256, 256))
    cell = np.kron(rng.normal(0, 3, (4, 4)), np.ones((64, 64)))
    block = np.stack([3 * glint + cell, glint * factor, 0.5 * glint + rng.normal(0, 2, glint.shape)])
    block += rng.normal(0, 1, block.shape)
    bands = (Band("g", 550), Band("r", 660), Band("n", 840))
    request = nir_request(bands, [2], correct=[0])
    return request, block


@pytest.mark.slow
@given(seed=st.integers(0, 10_000))
def test_error_of_one_reference_is_that_of_its_slope(seed):
    request, block = statistics(seed)
    plan = METHODS["hedley"].plan(request)
    stats = merge([gather(block[[0, 2]], np.ones(block.shape[1:], bool), plan)], plan)
    model = METHODS["hedley"].fit(request, stats)
    told, cells = glint_error(stats, model, model.fits[0])
    assert 14 < cells <= 16
    assert told == pytest.approx(model.fits[0].stderr / model.fits[0].slope, rel=1e-9)


@pytest.mark.parametrize("factor", [1.0, 1e-6, 1e6])
def test_error_of_several_references_against_brute_force(factor):
    """The sandwich of Bell and McCaffrey, written out over pixels; and no unit changes it."""
    request, block = statistics(7, factor)
    plan = METHODS["multiband"].plan(request)
    stats = merge([gather(block, np.ones(block.shape[1:], bool), plan)], plan)
    model = METHODS["multiband"].fit(request, stats)
    w = np.array(model.indexes[0].weights)
    x, y = block[1:] - block[1:].mean(axis=(1, 2), keepdims=True), block[0] - block[0].mean()
    power = np.einsum("irc,jrc->ij", x, x)
    rest = y - np.einsum("i,irc->rc", w, x)
    score = (x * rest).reshape(2, 4, 64, 4, 64).sum(axis=(2, 4)).reshape(2, -1)
    glint = (np.einsum("i,irc->rc", w, x) ** 2).reshape(4, 64, 4, 64).sum(axis=(1, 3)).ravel() / (w @ power @ w)
    half = np.linalg.inv(power) @ (score / (1 - glint))
    spread = half @ half.T * 15 / 16
    expected = np.sqrt(np.trace(spread @ power) / (w @ power @ w))
    assert glint_error(stats, model, model.fits[0])[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 1.5}, "a number from 0 to 1, got 1.5"),
        ({"tolerance": -0.1}, "a number from 0 to 1"),
        ({"tolerance": float("nan")}, "a number from 0 to 1, got nan"),
        ({"tolerance": "0.1"}, "a number from 0 to 1"),
        ({"tolerance": 0.1, "method": "hochberg"}, "hochberg fits no slopes"),
        ({"tolerance": 0.1, "compensate": "off"}, "name a --method"),
        ({"regression": "huber"}, "auto fits no slopes by regression"),
        ({"smallest_object": "abc"}, "'abc' is not a width such as 4m"),
        ({"tolerance": 0.1, "method": "joyce", "regression": "huber"}, "huber looks at a part of the sample"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(options, message):
    with pytest.raises(InputError, match=message) as caught:
        Recipe(**options)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_command(deglint, scene, tmp_path):
    run = ("--method", "joyce", "--sample", "all", "--mask", "none", "--compensate", "off", "-v")
    ran = deglint("remove", scene(), tmp_path / "out.tif", *run, "--tolerance", "0.01")
    assert ran.code == 0
    assert "tolerance 0.01 of the slopes: reached" in ran.err
    sidecar = json.loads((tmp_path / "out.tif.json").read_text())
    assert sidecar["recipe"]["tolerance"] == 0.01
    assert sidecar["sample"]["tolerance"]["met"]
    for wrong in ("0", "1", "-1", "nan", "much"):
        ran = deglint("remove", scene(), tmp_path / "new.tif", "--tolerance", wrong)
        assert ran.code in (1, 2)
        assert "tolerance" in ran.err
    (tmp_path / "m.json").write_text("{}")
    ran = deglint("remove", scene(), tmp_path / "new.tif", "--model", tmp_path / "m.json", "--tolerance", "0.1")
    assert ran.code == 2
