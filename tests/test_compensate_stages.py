"""Chains of stages: how they are written, what is refused, and the properties that every stage must have."""

import json

import numpy as np
import pytest

from deglint.compensate.psf import system_psf
from deglint.compensate.stages import (
    THESIS_CHAIN,
    Chain,
    Step,
    apply_stages,
    chain_from,
    fit_stages,
    parse,
)  # fmt: skip
from deglint.compensate.state import Sample, Setting, State
from deglint.errors import FitError, InputError
from deglint.scene import Band

from .common import says

WAVES = (480.0, 560.0, 660.0, 830.0)
BANDS = tuple(Band(f"L{w:g}", w, time_offset=0.06 * i, saturation=400.0) for i, w in enumerate(WAVES))
PSFS = tuple(system_psf(w, f_number=10, pitch=8e-6) for w in WAVES)
SETTING = Setting(BANDS, (3,), PSFS)
WATER = np.array([50.0, 40.0, 30.0, 10.0])
CHAINS = (
    THESIS_CHAIN,
    "identify-level:5, replace-level",
    "psf:2, identify-level:13, replace-level",
    "psf:1, identify-level:7, replace-level, identify-level:5, replace-level",
    "psf-image:1, identify-median, median:9",
    "normalise:30, psf:1, identify-level:5, replace-level",
    "normalise, identify-level:5, replace-bands, median:5",
)


def sparkling_block(shape=(120, 130), seed=0, cover=0.15, noise=1.0):
    rng = np.random.default_rng(seed)
    block = WATER[:, None, None] + rng.normal(0, noise, (4, *shape))
    block += np.where(rng.random(block.shape) < cover, rng.gamma(1.0, 60.0, block.shape), 0)
    return np.minimum(block, 400).astype(np.float32)


def fitted(text, block, setting=SETTING):
    state = State.of(block)
    sample = Sample((state,), (state.water,))
    return fit_stages(parse(text)[:-1], sample, setting)[0]


def run(text, block, setting=SETTING):
    return apply_stages(State.of(block), fitted(text, block, setting)).image


def test_reading_a_chain():
    assert parse("psf:2,identify-level , replace-level,remove, identify-level:11,replace-level") == (
        Step("psf", 2.0), Step("identify-level"), Step("replace-level"), Step("remove"), Step("identify-level", 11.0),
        Step("replace-level"),
    )  # fmt: skip
    assert parse("remove") == (Step("remove"),)
    assert [s.name for s in parse("identify-median:0, median")] == ["identify-median", "median", "remove"]
    assert parse(THESIS_CHAIN)[1] == Step("identify-median", 5.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "stage '' is not one of normalise, psf"),
        ("identify-level:13,, replace-level", "stage '' is not one of"),
        ("Normalise", "stage 'Normalise' is not one of"),
        ("psf:two", "'two' is not a number"),
        ("psf:, identify-level", "'' is not a number"),
        ("psf:0, identify-level", "psf ... integer from 1 to 20 ... 0"),
        ("psf:2.5, identify-level", "integer"),
        ("psf-image:nan", "1 to 20, got nan"),
        ("normalise:101", "normalise ... number from 1 to 100 ... 101"),
        ("identify-median:inf", "0 to 1000"),
        ("identify-level:1", "3 to 255"),
        ("identify-level:12", "must be odd"),
        ("identify-median, median:4", "must be odd"),
        ("identify-level, replace-level:3", "replace-level takes no number ... '3'"),
        ("remove:1", "remove takes no number"),
        ("remove, remove", "one remove"),
        ("identify-level, replace-bands", "put normalise first"),
        ("normalise, replace-bands", "replace-bands needs identified glint"),
        ("median", "median needs identified glint"),
        ("identify-median, replace-level", "replace-level needs ... put identify-level before"),
        ("identify-level, remove, replace-level", "replace-level needs ... put identify-level before"),
        ("normalise, identify-median, median, replace-bands", "replace-bands needs identified glint"),
        ("psf:2", "psf needs identify-level"),
        ("normalise, targets, remove", "leave out normalise"),
        ("targets, normalise, identify-median, median", "leave out normalise"),
        ("remove, normalise", "put normalise first"),
        ("remove, normalise, posterior", "put normalise first"),
        ("posterior, remove", "put posterior after remove"),
        ("normalise, remove, identify-median, replace-bands", "put replace-bands before remove"),
        ("identify-level:9, targets, remove", "add replace-level"),
        ("identify-level:9, targets, remove, identify-level, replace-level", "add replace-level"),
        ("identify-median:5, median:25, targets, remove", "put targets before median"),
        ("psf, remove, identify-level, replace-level", "psf needs identify-level"),
        ("psf:2, normalise, identify-level:9, replace-level", "psf needs identify-level"),
        ("psf, identify-median, median, identify-level, replace-level", "psf needs identify-level"),
        ("identify-level:9, psf, replace-level, identify-level, replace-level", "psf needs identify-level"),
        ("psf:3, psf:2, identify-level, replace-level", "psf needs identify-level"),
    ],
)
def test_refusals_are_one_clear_line(text, words):
    with pytest.raises(InputError) as error:
        parse(text)
    assert says(str(error.value), *words.split(" ... "))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "targets, remove, identify-median, median",
        "identify-median, targets, median, remove",
        "identify-level:9, targets, median",
        "identify-level:9, replace-level, targets, remove",
    ],
)
def test_targets_stand_before_removal_and_median(text):
    assert "targets" in [s.name for s in parse(text)]


@pytest.mark.parametrize(
    ("text", "block", "error", "words"),
    [
        ("psf:2, identify-level", sparkling_block(), InputError, "psf needs the wavelengths.*give --wavelengths"),
        ("normalise", sparkling_block((7, 9)), FitError, "63 pixels, need at least 64"),
        (
            "normalise",
            -sparkling_block(),
            FitError,
            "band 1 .*needs a positive",
        ),
        ("identify-level:5", np.full((4, 20, 20), np.nan, np.float32), FitError, "holds 0 pixels"),
    ],
)
def test_refused_fits_are_one_clear_line(text, block, error, words):
    with pytest.raises(error, match=words) as found:
        fitted(text, block, Setting(BANDS, (3,)))
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("text", CHAINS)
def test_saved_and_read_back_to_the_bit(text):
    block = sparkling_block()
    chain = Chain(fitted(text, block), (), text)
    saved = json.dumps(chain.numbers(), allow_nan=False)
    again = chain_from(json.loads(saved))
    for read in (again, chain_from(chain.numbers())):
        assert json.dumps(read.numbers(), allow_nan=False) == saved
    assert (again.text, again.halo) == (text, chain.halo)
    images = [apply_stages(State.of(block), c.before).image for c in (chain, again)]
    np.testing.assert_array_equal(*images)


@pytest.mark.parametrize(
    "data",
    [
        {}, {"stage": "match"}, {"stage": "remove"}, {"stage": "median", "size": 3},
        {"stage": "normalise", "levels": [1]},
        {"stage": "psf", "iterations": 2, "floors": [1], "psfs": [[[-1.0]]]},
        {"stage": "psf", "iterations": 2, "floors": [1], "psfs": [[[1, 2], [3]]]},
    ],
)  # fmt: skip
def test_what_is_no_saved_stage_is_refused(data):
    with pytest.raises(InputError) as error:
        chain_from({"chain": data.get("stage"), "before": [data], "after": []})
    assert str(error.value).startswith("not a saved compensation")
    assert "stage" in data or "no entry or stage 'stage'" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("replace-level", "put identify-level before"),
        ("normalise, identify-median, replace-bands, median", "its stages are normalise, identify-level"),
        ("", "is not one of normalise"),
    ],
)
def test_a_saved_chain_that_was_edited_is_refused(text, words):
    saved = Chain(fitted(CHAINS[-1], sparkling_block()), (), CHAINS[-1]).numbers() | {"chain": text}
    with pytest.raises(InputError, match=words) as error:
        chain_from(json.loads(json.dumps(saved)))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", CHAINS)
def test_a_block_with_its_halo_is_the_whole_inside(text):
    block = sparkling_block((170, 180), 3)
    stages = fitted(text, block)
    halo = Chain(stages).halo
    whole = apply_stages(State.of(block), stages).image
    top, left = max(60 - halo, 0), max(70 - halo, 0)
    part = apply_stages(State.of(block[:, top : 100 + halo, left : 110 + halo].copy()), stages).image
    part = part[:, 60 - top : 100 - top, 70 - left : 110 - left]
    np.testing.assert_allclose(part, whole[:, 60:100, 70:110], rtol=2e-6)  # sums in another order


@pytest.mark.parametrize("text", CHAINS)
def test_a_constant_image_stays(text):
    block = np.broadcast_to(np.float32(WATER)[:, None, None], (4, 60, 70)).copy()
    np.testing.assert_allclose(run(text, block), block, rtol=1e-5)


@pytest.mark.parametrize("text", CHAINS)
def test_water_without_glint_stays_within_its_noise(text):
    block = sparkling_block(cover=0)
    away = run(text, block) - WATER[:, None, None]
    # noise is sharpened, or exchanged between bands: the means of the bands as background would give up to 1.69
    most = 1.8 if "psf-image" in text or "level:5, replace-bands" in text else 1.2
    assert np.sqrt((away**2).mean(axis=(1, 2))).max() < most


@pytest.mark.parametrize("text", CHAINS)
def test_units_do_not_matter(text):
    block = sparkling_block(seed=5)
    bands = tuple(Band(b.name, b.wavelength, time_offset=b.time_offset, saturation=1024 * 400.0) for b in BANDS)
    scaled = run(text, block * np.float32(1024), Setting(bands, (3,), PSFS))
    np.testing.assert_allclose(scaled, 1024 * run(text, block), rtol=1e-4)


@pytest.mark.parametrize("text", CHAINS)
def test_the_order_of_bands_does_not_matter(text):
    block, order = sparkling_block(seed=6), [2, 0, 3, 1]
    setting = Setting(tuple(BANDS[i] for i in order), (2,), tuple(PSFS[i] for i in order))
    np.testing.assert_allclose(run(text, block[order], setting), run(text, block)[order], rtol=1e-5)


@pytest.mark.parametrize("text", CHAINS)
def test_what_is_no_water_changes_nothing_far_from_it(text):
    block = sparkling_block(seed=7)
    stages = fitted(text, block)
    whole = apply_stages(State.of(block), stages).image
    holed = block.copy()
    holed[1, 5:9, 5:9] = np.nan
    holed[:, :3] = np.nan
    given = holed.copy()
    out = apply_stages(State.of(holed), stages).image
    np.testing.assert_array_equal(holed, given)
    assert np.isfinite(out).all()
    far = 9 + Chain(stages).halo
    np.testing.assert_allclose(out[:, far:, far:], whole[:, far:, far:], rtol=2e-6)


@pytest.mark.parametrize("text", CHAINS[1:])
def test_every_chain_reduces_glint(text):
    block = sparkling_block(seed=8)
    before, after = (np.abs(a - WATER[:, None, None]).mean() for a in (block, run(text, block)))
    assert after < 0.6 * before


@pytest.mark.parametrize("wrong", ["2", [2.0], None, True])
def test_a_saved_field_of_another_type_is_refused(wrong):
    text = "identify-median, median:5, remove"
    saved = Chain(fitted(text, sparkling_block()), (), text).numbers()
    saved["before"][1]["largest"] = wrong
    with pytest.raises(InputError, match=r"not a saved compensation.*not of the type.*'int'"):
        chain_from(json.loads(json.dumps(saved)))
