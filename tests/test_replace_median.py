"""Replacing glint from other bands, from the level, and by the adaptive median: brute force twins and invariants."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint.compensate.median import CLEAN, Median, adaptive_median
from deglint.compensate.replace import ReplaceBands, ReplaceLevel, nearest_clean, neighbours
from deglint.compensate.state import State
from deglint.errors import InputError


def scene(shape=(40, 50), seed=0, cover=0.3, holes=0.05, bands=4):
    rng = np.random.default_rng(seed)
    image = rng.normal(1, 0.1, (bands, *shape)).astype(np.float32)
    image[rng.random(image.shape) < holes] = np.nan
    hit = (rng.random(image.shape) < cover) & np.isfinite(image)
    return image, hit


# -------------------------------------------------------------------------------------------------- other bands


@pytest.mark.parametrize(
    ("wavelengths", "wanted"),
    [
        ([425, 480, 545, 832], ((1, 2, 3), (0, 2, 3), (1, 0, 3), (2, 1, 0))),
        ([832, 425, 545, 480], ((2, 3, 1), (3, 2, 0), (3, 1, 0), (1, 2, 0))),
        ([500, 600, 700], ((1, 2), (0, 2), (1, 0))),
        ([None, 480, 545], ((1, 2), (0, 2), (1, 0))),
        ([480], ((),)),
    ],
)
def test_neighbours_by_wavelength_then_by_place(wavelengths, wanted):
    assert neighbours(wavelengths) == wanted


def by_hand(image, hit, order):
    values, filled = image.astype(np.float64), np.zeros_like(hit)
    for b, r, c in np.argwhere(hit):
        clean = [o for o in order[b] if not hit[o, r, c] and np.isfinite(image[o, r, c])]
        if clean:
            values[b, r, c], filled[b, r, c] = image[clean[0], r, c], True
    return values, filled


@settings(max_examples=20)
@given(seed=st.integers(0, 99), cover=st.sampled_from([0.0, 0.1, 0.6, 0.95, 1.0]), bands=st.integers(1, 6))
def test_nearest_clean_band_is_taken(seed, cover, bands):
    image, hit = scene((7, 9), seed, cover, 0.1, bands)
    order = neighbours(list(np.random.default_rng(seed).permutation(bands) * 50.0 + 400))
    before = image.copy()
    values, filled = nearest_clean(image, hit, order)
    wanted, where = by_hand(image, hit, order)
    np.testing.assert_array_equal(filled, where)
    np.testing.assert_array_equal(values, wanted.astype(np.float32))
    np.testing.assert_array_equal(image, before)


def test_what_no_band_can_fill_stays_identified_for_the_median():
    image, hit = scene(holes=0)
    hit[:, 3, 4] = True
    state = State.of(image)
    state.hit = hit.copy()
    ReplaceBands(neighbours([400, 500, 600, 700])).apply(state)
    np.testing.assert_array_equal(state.hit, np.broadcast_to(hit.all(axis=0), hit.shape))
    np.testing.assert_array_equal(state.replaced, hit & ~hit.all(axis=0))
    np.testing.assert_array_equal(state.image[~hit], image[~hit])
    Median(5).apply(state)
    assert (state.replaced == hit).all()
    assert state.hit is None


def test_bands_of_one_colour_are_restored_exactly():
    """Where the spectrum is that of water times one brightness, the other band says what this one was."""
    texture = np.random.default_rng(0).uniform(0.8, 1.2, (30, 30)).astype(np.float32)
    truth = np.stack([texture] * 3)
    _, hit = scene((30, 30), bands=3)
    hit &= ~hit.all(axis=0)
    state = State.of(np.where(hit, 9, truth))
    state.hit = hit
    ReplaceBands(neighbours([400, 500, 600])).apply(state)
    np.testing.assert_array_equal(state.image, truth)


# ------------------------------------------------------------------------------------------------------ the level


def test_level_takes_the_place_of_glint_and_of_nothing_else():
    image, hit = scene()
    state = State.of(image)
    state.hit, state.level = hit, np.full_like(image, 7)
    ReplaceLevel().apply(state)
    assert (state.image[hit] == 7).all()
    np.testing.assert_array_equal(state.image[~hit], image[~hit])
    np.testing.assert_array_equal(state.replaced, hit)
    assert state.hit is state.level is state.sharp is state.psfs is None


@pytest.mark.parametrize(
    ("stage", "words"),
    [(ReplaceLevel(), "needs a level"), (ReplaceBands(((),)), "to be identified"), (Median(), "to be identified")],
)
def test_stages_without_what_they_need_say_so(stage, words):
    with pytest.raises(InputError, match=words) as error:
        stage.apply(State.of(np.ones((1, 3, 3), np.float32)))
    assert "\n" not in str(error.value)


# ------------------------------------------------------------------------------------------------ adaptive median


def median_by_hand(band, hit, largest):
    out, filled = band.copy(), np.zeros_like(hit)
    clean = np.where(hit, np.nan, band)
    for r, c in np.argwhere(hit):
        for half in range(1, largest // 2 + 1):
            window = clean[max(r - half, 0) : r + half + 1, max(c - half, 0) : c + half + 1]
            values = np.sort(window[np.isfinite(window)])
            if values.size >= CLEAN:
                out[r, c], filled[r, c] = values[(values.size - 1) // 2], True
                break
    return out, filled


@settings(max_examples=25)
@given(
    seed=st.integers(0, 99), cover=st.sampled_from([0.0, 0.1, 0.7, 0.97, 1.0]), largest=st.sampled_from([3, 5, 9, 25]),
    shape=st.sampled_from([(14, 17), (1, 1), (1, 20), (20, 1), (3, 3)]), holes=st.sampled_from([0.0, 0.3, 1.0]),
)  # fmt: skip
def test_is_the_median_of_the_first_window_with_enough_clean_pixels(seed, cover, largest, shape, holes):
    image, hit = scene(shape, seed, cover, holes, 1)
    before = image.copy()
    found, filled = adaptive_median(image[0], hit[0], largest)
    wanted, where = median_by_hand(image[0], hit[0], largest)
    np.testing.assert_array_equal(filled, where)
    np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(image, before)


def test_many_pixels_at_a_time_are_worked_on_in_parts(monkeypatch):
    image, hit = scene(cover=0.8, bands=1)
    whole = adaptive_median(image[0], hit[0])
    monkeypatch.setattr("deglint.compensate.median._AT_ONCE", 1)
    for a, b in zip(whole, adaptive_median(image[0], hit[0]), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("size", [4, 1, 0, -5])
def test_windows_that_have_no_middle_are_refused(size):
    with pytest.raises(InputError) as error:
        Median(size)
    assert "\n" not in str(error.value)


@settings(max_examples=15)
@given(data=st.data())
def test_tiles_are_the_whole_to_the_bit(data):
    shape = data.draw(st.sampled_from([(50, 61), (6, 90)]))
    image, hit = scene(shape, data.draw(st.integers(0, 3)), data.draw(st.sampled_from([0.2, 0.9])), bands=2)
    stage = Median(data.draw(st.sampled_from([3, 9, 25])))

    def run(rows, columns):
        state = State.of(image[:, rows, columns])
        state.hit = hit[:, rows, columns]
        stage.apply(state)
        return state

    whole = run(slice(None), slice(None))
    (r0, r1), (c0, c1) = (sorted(data.draw(st.lists(st.integers(0, n), min_size=2, max_size=2))) for n in shape)
    top, left = max(r0 - stage.halo, 0), max(c0 - stage.halo, 0)
    tile = run(slice(top, r1 + stage.halo), slice(left, c1 + stage.halo))
    for name in ("image", "replaced"):
        part = getattr(tile, name)[:, r0 - top :, c0 - left :][:, : r1 - r0, : c1 - c0]
        np.testing.assert_array_equal(part, getattr(whole, name)[:, r0:r1, c0:c1])


@settings(max_examples=10)
@given(power=st.integers(-20, 20))
def test_scaling_and_turning(power):
    image, hit = scene(cover=0.6, bands=1)
    band, hit = image[0], hit[0]
    factor = np.float32(2.0**power)
    found, _ = adaptive_median(band, hit, 9)
    np.testing.assert_array_equal(adaptive_median(band * factor, hit, 9)[0], found * factor)
    np.testing.assert_array_equal(adaptive_median(band[::-1, ::-1], hit[::-1, ::-1], 9)[0], found[::-1, ::-1])
