"""Chains: how they are written, what is refused, tiles against the whole, saving to the bit, and doing no harm."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint import compensate
from deglint.compensate import THESIS, Chain, Sample, Setting, State, Step, apply_stages, finish, fit_stages, parse
from deglint.compensate.chain import chain_from, stage_from
from deglint.compensate.codes import decoded, encoded
from deglint.compensate.opening import rank_opening
from deglint.compensate.psf import kernel_psf, system_psf
from deglint.errors import FitError, InputError
from deglint.scene import Band

WAVELENGTHS = (480.0, 560.0, 660.0, 830.0)
BANDS = tuple(Band(f"L{w:g}", w, saturation=400.0) for w in WAVELENGTHS)
PSFS = tuple(system_psf(w, f_number=10, pitch=8e-6) for w in WAVELENGTHS)
SETTING = Setting(BANDS, PSFS, detail=True)
CHAINS = (
    THESIS,
    "identify-level:5, replace-level",
    "psf:2, identify-level:13, replace-level",
    "psf:1, identify-level:7, replace-level, identify-level:5, replace-level",
    "psf-image:1, identify-median, median:9",
    "normalise:30, psf:1, identify-level:5, replace-level",
    "normalise, identify-level:5, replace-bands, median:5",
)


def sea(shape=(70, 80), seed=0, cover=0.15, holes=0.0):
    rng = np.random.default_rng(seed)
    block = np.array([50.0, 40.0, 30.0, 10.0])[:, None, None] + rng.normal(0, 1, (4, *shape))
    block += np.where(rng.random(block.shape) < cover, rng.gamma(1.0, 60.0, block.shape), 0)
    block = np.minimum(block, 400).astype(np.float32)
    block[:, rng.random(shape) < holes] = np.nan
    if holes:
        block[1, 3:9, 5:11] = np.nan
    return block


def fitted(text, block=None, setting=SETTING):
    return compensate.fit(text, sea((150, 150), 9) if block is None else block, setting)


# ------------------------------------------------------------------------------------------------------- writing


def test_reading_a_chain():
    assert parse("psf:2,identify-level , replace-level,remove, identify-level:11,replace-level") == (
        Step("psf", 2.0), Step("identify-level"), Step("replace-level"), Step("remove"), Step("identify-level", 11.0),
        Step("replace-level"),
    )  # fmt: skip
    assert parse("remove") == (Step("remove"),)
    assert [s.name for s in parse("identify-median:0, median")] == ["identify-median", "median", "remove"]
    assert parse(THESIS)[1] == Step("identify-median", 5.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "stage '' is not one of normalise, psf"),
        ("identify-level:13,, replace-level", "stage '' is not one of"),
        ("sharpen", "stage 'sharpen' is not one of"),
        ("Normalise", "stage 'Normalise' is not one of"),
        ("psf:two", "'two' is not a number"),
        ("psf:, identify-level", "'' is not a number"),
        ("psf:0, identify-level", "psf takes a whole number from 1 to 20, got 0"),
        ("psf:-1, identify-level", "1 to 20, got -1"),
        ("psf:2.5, identify-level", "whole number"),
        ("psf-image:nan", "1 to 20, got nan"),
        ("normalise:0", "normalise takes a number from 1 to 100, got 0"),
        ("normalise:101", "1 to 100"),
        ("identify-median:-1", "0 to 1000"),
        ("identify-median:inf", "0 to 1000"),
        ("identify-level:1", "3 to 255"),
        ("identify-level:12", "must be odd"),
        ("identify-level:5.5", "whole number"),
        ("identify-level:257", "3 to 255"),
        ("identify-median, median:4", "must be odd"),
        ("identify-median, median:1e9", "3 to 255"),
        ("identify-level, replace-level:3", "replace-level takes no number, got '3'"),
        ("remove:1", "remove takes no number"),
        ("remove, remove", "a chain removes once"),
        ("replace-bands", "replace-bands needs bands of one scale"),
        ("identify-level, replace-bands", "name normalise at the beginning"),
        ("normalise, replace-bands", "replace-bands needs glint to be identified"),
        ("median", "median needs glint to be identified"),
        ("replace-level", "replace-level needs a level"),
        ("identify-median, replace-level", "replace-level needs a level"),
        ("identify-level, replace-level, replace-level", "replace-level needs a level"),
        ("identify-level, remove, replace-level", "replace-level needs a level"),
        ("identify-median, remove, median", "median needs glint"),
        ("normalise, identify-median, median, replace-bands", "replace-bands needs glint"),
        ("psf:2", "psf serves identify-level"),
        ("psf, remove, identify-level, replace-level", "psf serves identify-level"),
        ("identify-level, psf, replace-level", "psf serves identify-level"),
        ("match, identify-level, replace-level", "stage 'match' is not one of"),
    ],
)
def test_refusals_are_one_clear_line(text, words):
    with pytest.raises(InputError) as error:
        parse(text)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: fitted("psf:2, identify-level", setting=Setting(BANDS)), InputError, "psf needs the sensor's optics"),
        (lambda: fitted("psf-image", setting=Setting(BANDS)), InputError, "Name a --sensor, or leave it out"),
        (lambda: fitted("normalise", sea()[:3]), InputError, r"expected an array of \(4, row, column\)"),
        (lambda: fitted("normalise", sea()[0]), InputError, "expected an array"),
        (lambda: compensate.fit("normalise", sea(), SETTING, sample=np.ones((3, 3), bool)), InputError, "shape"),
        (lambda: fitted("normalise", sea((1, 1))), FitError, "1 valid pixels of a band, need at least 64"),
        (lambda: fitted(THESIS, np.full((4, 20, 20), np.nan, np.float32)), FitError, "0 valid pixels"),
        (lambda: fitted("identify-level:5", np.full((4, 20, 20), np.nan, np.float32)), FitError, "0 pixels of deep"),
        (lambda: fitted("identify-median", sea((7, 9))), FitError, "63 valid pixels"),
    ],
)  # fmt: skip
def test_refused_fits_are_one_clear_line(call, error, words):
    with pytest.raises(error, match=words) as found:
        call()
    assert "\n" not in str(found.value)


# ------------------------------------------------------------------------------------------------------ numbers


@pytest.mark.parametrize("text", CHAINS)
def test_saved_and_read_back_to_the_bit(text):
    chain = fitted(text)
    text_of = json.dumps(chain.saved(), allow_nan=False)
    again = chain_from(json.loads(text_of))
    assert json.dumps(again.saved(), allow_nan=False) == text_of
    assert (again.text, again.halo, len(again.before)) == (chain.text, chain.halo, len(chain.before))
    block = sea(holes=0.02)
    np.testing.assert_array_equal(compensate.apply(block, again), compensate.apply(block, chain))


@pytest.mark.parametrize("radius", [0, 1, 2, 4])
def test_a_saved_kernel_is_the_fitted_one(radius):
    rng = np.random.default_rng(radius)
    for _ in range(50):
        kernel = rng.random((2 * radius + 1,) * 2) + 0.01
        psf = kernel_psf(kernel)
        chain = fit_stages(parse("psf-image:1")[:-1], Sample([State.of(sea())], [np.ones((70, 80), bool)]),
                           Setting(BANDS, (psf,) * 4))  # fmt: skip
        data = json.loads(json.dumps(Chain(chain).numbers()))
        np.testing.assert_array_equal(stage_from(data["before"][0]).psfs[0].kernel, psf.kernel)


@pytest.mark.parametrize(
    "data",
    [
        {}, {"stage": "match", "reference": 3}, {"stage": "median", "size": 3}, {"stage": "median", "largest": 4},
        {"stage": "psf", "iterations": 2}, {"stage": "psf", "iterations": 2, "kernels": [[[1, 2], [3]]]},
        {"stage": "psf", "iterations": 2, "kernels": [[[-1.0]]]}, {"stage": "normalise", "levels": [1]},
    ],
)  # fmt: skip
def test_what_is_no_saved_stage_is_refused(data):
    with pytest.raises(InputError) as error:
        stage_from(data)
    assert "\n" not in str(error.value)


def test_unknown_saturation_is_no_number_in_the_file():
    chain = fitted("identify-level:5, replace-level", setting=Setting(tuple(Band(b.name, b.wavelength) for b in BANDS)))
    data = chain.numbers()["before"][0]
    assert data["saturation"] == (None,) * 4
    assert stage_from(json.loads(json.dumps(data))).saturation == (np.inf,) * 4


# ----------------------------------------------------------------------------------------------------- invariants


@pytest.mark.parametrize("witness", [None, 3])
@pytest.mark.parametrize("text", CHAINS)
@settings(max_examples=8)
@given(data=st.data())
def test_tiles_are_the_whole_to_the_bit(text, witness, data):
    chain = FITTED[text, witness]
    shape = data.draw(st.sampled_from([(90, 101), (11, 200), (200, 6)]))
    block = sea(shape, data.draw(st.integers(0, 3)), 0.2, data.draw(st.sampled_from([0.0, 0.05])))
    whole = compensate.apply(block, chain)
    (r0, r1), (c0, c1) = (sorted(data.draw(st.lists(st.integers(0, n), min_size=2, max_size=2))) for n in shape)
    if r0 == r1 or c0 == c1:
        return
    top, left, halo = max(r0 - chain.halo, 0), max(c0 - chain.halo, 0), chain.halo
    tile = compensate.apply(block[:, top : r1 + halo, left : c1 + halo], chain)[:, r0 - top :, c0 - left :]
    np.testing.assert_array_equal(tile[:, : r1 - r0, : c1 - c0], whole[:, r0:r1, c0:c1])


FITTED = {(t, w): fitted(t, setting=replace(SETTING, witness=w)) for t in CHAINS for w in (None, 3)}


@pytest.mark.parametrize("text", CHAINS)
def test_what_is_not_replaced_is_the_input_and_holes_stay(text):
    block = sea(holes=0.03)
    before = block.copy()
    where = np.random.default_rng(0).random(block.shape[1:]) < 0.7
    out = compensate.apply(block, FITTED[text, None], where=where)
    np.testing.assert_array_equal(block, before)
    np.testing.assert_array_equal(out[:, ~where], block[:, ~where])
    np.testing.assert_array_equal(np.isnan(out), np.isnan(block))
    state = apply_stages(State.of(block, where), FITTED[text, None].before)
    out = finish(state, block)
    np.testing.assert_array_equal(out[~state.replaced], block[~state.replaced])
    wide = compensate.apply(block.astype(np.float64), FITTED[text, None])
    assert wide.dtype == np.float64
    np.testing.assert_allclose(wide, compensate.apply(block, FITTED[text, None]), rtol=1e-6)


@pytest.mark.parametrize("text", [t for t in CHAINS if "psf-image" not in t])
def test_without_glint_only_flagged_noise_changes_and_by_noise_alone(text):
    block = sea((150, 150), cover=0.0)
    chain = fitted(text, block)
    out = compensate.apply(block, chain)
    assert (out != block).mean() < 0.2
    deviations = 4.5 if "replace-bands" not in text else 4.5 * 2**0.5  # another band has noise of its own
    assert np.abs(out - block).max() < deviations * 2


@pytest.mark.parametrize("text", CHAINS)
def test_glint_goes(text):
    truth, block = sea(cover=0.0), sea(cover=0.15)
    out = compensate.apply(block, fitted(text, block))
    assert np.sqrt(((out - 50) ** 2).mean()) < np.sqrt(((block - 50) ** 2).mean())
    if "psf" not in text:
        level = np.median(truth, axis=(1, 2), keepdims=True)
        assert np.sqrt(((out - level) ** 2).mean()) < 0.25 * np.sqrt(((block - level) ** 2).mean())


@pytest.mark.parametrize("text", [CHAINS[1], CHAINS[2], CHAINS[3]])
@settings(max_examples=6)
@given(power=st.integers(-12, 12))
def test_scaling_by_powers_of_two_is_exact(text, power):
    factor = 2.0**power
    bands = tuple(Band(b.name, b.wavelength, saturation=400 * factor) for b in BANDS)
    block = sea()
    plain = compensate.apply(block, fitted(text, block))
    scaled = block * np.float32(factor)
    found = compensate.apply(scaled, fitted(text, scaled, Setting(bands, PSFS, detail=True)))
    np.testing.assert_array_equal(found, plain * np.float32(factor))


@pytest.mark.parametrize("text", CHAINS)
def test_band_permutation(text):
    turn = [2, 0, 3, 1]
    block = sea()
    setting = Setting(tuple(BANDS[b] for b in turn), tuple(PSFS[b] for b in turn), detail=True)
    found = compensate.apply(block[turn], fitted(text, block[turn], setting))
    np.testing.assert_array_equal(found, compensate.apply(block, fitted(text, block))[turn])


@pytest.mark.parametrize("text", CHAINS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (3, 2), (4, 1), (1, 4), (30, 1)])
def test_small_blocks_and_blocks_of_nothing(text, shape):
    chain = FITTED[text, None]
    block = sea(shape)
    assert np.isfinite(compensate.apply(block, chain)).all()
    nothing = np.full((4, *shape), np.nan, np.float32)
    np.testing.assert_array_equal(compensate.apply(nothing, chain), nothing)
    full = np.full((4, *shape), 400, np.float32)
    assert np.isfinite(compensate.apply(full, chain)).all()


def test_one_band():
    setting = Setting(BANDS[:1], PSFS[:1], detail=True)
    for text in ("psf:2, identify-level:13, replace-level", THESIS):
        block = sea()[:1]
        out = compensate.apply(block, fitted(text, block, setting))
        assert out.std() < 0.3 * block.std()


def test_the_default_chain_step_by_step():
    block = sea((120, 130))
    chain = fitted("identify-level:13, replace-level", block, Setting(BANDS))
    stage = chain.before[0]
    for b, band in enumerate(block):
        told = decoded(encoded(band, *stage.grids[b]), *stage.grids[b])
        level = rank_opening(told, 13, corners=True) + np.float32(stage.offsets[b])
        glint = (band > level + np.float32(1.5 * stage.sigmas[b])) | (band >= 400)
        np.testing.assert_array_equal(compensate.apply(block, chain)[b], np.where(glint, level, band))


def test_halos_add_up():
    chain = fitted("psf:2, identify-level:13, replace-level, identify-level:5, replace-level")
    radius = max(p.radius for p in PSFS)
    assert [s.halo for s in chain.before] == [5 * radius, 19, 0, 7, 0]
    assert chain.halo == 5 * radius + 26
    assert chain.runs
    assert not Chain().runs
