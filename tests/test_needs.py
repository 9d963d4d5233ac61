"""What a scene needs: each number against its definition, each threshold from both sides."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from deglint.errors import InputError
from deglint.needs import HIGH_PASS, SIMULTANEOUS, Needs, StageNeed, coherence, element_for
from deglint.pipeline.compensation import smallest_object
from deglint.scene import Band

BANDS = tuple(Band(f"L{w:g}", w) for w in (480.0, 660.0, 725.0, 830.0))
NIR = 3


def sea(shared=0.9, shape=(90, 110), seed=0):
    """Bands from 660 nm on share so much of the variance of their waves; blue is alone."""
    rng = np.random.default_rng(seed)
    common, own = rng.standard_normal(shape), rng.standard_normal((4, *shape))
    block = 50 + np.sqrt(shared) * common + np.sqrt(1 - shared) * own
    block[0] = 50 + own[0]
    return block.astype(np.float32)


def all_of(block):
    return np.ones(block.shape[1:], bool)


def test_coherence_is_the_correlation_of_what_a_window_leaves():
    block = sea()
    mask = all_of(block)
    mask[:, :20] = False
    block[2, 50, 60] = np.nan
    near = ndimage.binary_erosion(mask & np.isfinite(block).all(axis=0), np.ones((HIGH_PASS,) * 2), border_value=1)
    high = [b - ndimage.uniform_filter(np.nan_to_num(b).astype(np.float64), HIGH_PASS, mode="mirror") for b in block]
    wanted = max(np.corrcoef(high[b][near], high[NIR][near])[0, 1] for b in (1, 2))
    assert coherence([block], [mask], BANDS, NIR) == pytest.approx(wanted, abs=1e-5)
    wanted = min(np.corrcoef(high[b][near], high[NIR][near])[0, 1] for b in (1, 2))
    assert coherence([block], [mask], BANDS, NIR, delayed=True) == pytest.approx(wanted, abs=1e-5)


def test_boats_do_not_make_delayed_bands_one():
    block = sea(0.0, (300, 300))
    block[2] = 0.98 * (block[3] - 50) + 0.2 * (block[2] - 50) + 50  # the next band still sees most of the sparkle
    rng = np.random.default_rng(2)
    for row, column in rng.integers(10, 285, (20, 2)):
        block[:, row : row + 3, column : column + 3] = 55
    assert coherence([block], [all_of(block)], BANDS, NIR) > SIMULTANEOUS
    assert coherence([block], [all_of(block)], BANDS, NIR, delayed=True) < SIMULTANEOUS


@settings(max_examples=10)
@given(shared=st.floats(0, 1), seed=st.integers(0, 9), scale=st.floats(1e-4, 1e4))
def test_coherence_is_what_the_bands_share(shared, seed, scale):
    block = sea(shared, (150, 150), seed)
    found = coherence([block], [all_of(block)], BANDS, NIR)
    assert found == pytest.approx(shared, abs=0.03)
    assert coherence([block * np.float32(scale)], [all_of(block)], BANDS, NIR) == pytest.approx(found, abs=1e-3)
    assert Needs(coherence=found).simultaneous == (found >= SIMULTANEOUS)


def test_a_slow_change_of_colour_is_no_coherence():
    block = sea(0.0) + np.linspace(0, 50, 110, dtype=np.float32)
    assert abs(coherence([block], [all_of(block)], BANDS, NIR)) < 0.05


def test_blocks_add_up_and_bands_without_wavelengths_all_count():
    block = sea(0.5)
    parts = coherence([block[:, :, :60], block[:, :, 60:]], [all_of(block)[:, :60], all_of(block)[:, 60:]], BANDS, NIR)
    assert parts == pytest.approx(coherence([block], [all_of(block)], BANDS, NIR), abs=0.03)
    unknown = tuple(Band(str(i)) for i in range(4))
    assert coherence([block[[1, 0, 2, 3]]], [all_of(block)], unknown, NIR) == pytest.approx(
        coherence([block], [all_of(block)], BANDS, NIR), abs=1e-9
    )
    blue = (BANDS[0], BANDS[3])
    alone = coherence([block[[0, 3]]], [all_of(block)], blue, 1)
    assert abs(alone) < 0.05  # there is none from 640 nm on: then any band


def test_what_cannot_be_told_is_none():
    block = sea()
    assert coherence([block[NIR:]], [all_of(block)], BANDS[NIR:], 0) is None
    assert coherence([block], [np.zeros(block.shape[1:], bool)], BANDS, NIR) is None
    assert coherence([block[:, :9, :9]], [all_of(block)[:9, :9]], BANDS, NIR) is None
    flat = np.full((4, 40, 40), 7.0, np.float32)
    assert coherence([flat], [all_of(flat)], BANDS, NIR) == 0.0


@settings(max_examples=50)
@given(smallest=st.floats(0.01, 1e5))
def test_elements_are_odd_and_smaller_than_what_must_survive(smallest):
    size = element_for(smallest)
    assert size == 0 or (size % 2 == 1 and 5 <= size <= 13 and size < smallest)
    assert element_for(smallest * 1.5) >= size


@pytest.mark.parametrize(
    ("smallest", "size"), [(5.8, 0), (5.9, 5), (8.2, 5), (8.3, 7), (15.2, 11), (15.3, 13), (99, 13)]
)
def test_elements_by_size(smallest, size):
    assert element_for(smallest) == size


@pytest.mark.parametrize(
    ("text", "pixel", "pixels"),
    [
        (None, 0.25, 16), ("", 0.25, 16), (None, None, 16), ("4m", 0.25, 16), ("4", 0.5, 8), ("2.5 m", 0.25, 10),
        ("3 metres", 1, 3), ("1 meter", 2, 0.5), ("16px", 0.25, 16), ("16px", None, 16), ("7 pixels", 10, 7),
        (" 1 pixel ", None, 1), (".5m", 0.25, 2),
    ],
)  # fmt: skip
def test_smallest_object_in_metres_or_pixels(text, pixel, pixels):
    assert smallest_object(text, pixel) == pytest.approx(pixels)


@pytest.mark.parametrize(
    "text", ["0", "0px", "-4m", "four", "4 feet", "4mm", "px", ".", "1.2.3m", "nan", "inf", "1e3m", "9" * 9]
)
def test_what_is_no_width_is_refused_in_one_line(text):
    with pytest.raises(InputError, match="is not a width such as 4m or 16px") as error:
        smallest_object(text, 0.25)
    assert "\n" not in str(error.value)


def test_metres_need_the_size_of_a_pixel():
    with pytest.raises(InputError, match="the size of a pixel is not known; give pixels"):
        smallest_object("4m", None)


def test_what_is_said_and_written_is_what_was_found():
    needs = Needs(
        pixel=0.25, smallest=16, element=13, coherence=0.5, cover=(0.1, 0.2), offsets=0.36,
        glint=(0.2, 0.4), things=(0.3, 1.0),
        stages=(StageNeed("psf", False, "little glint", "a third"), StageNeed("second opening", True, "left over")),
    )  # fmt: skip
    said = needs.lines()
    assert "pixels of 0.25 m: the smallest object to keep is 16 pixels wide, an opening of 13 pixels" in said
    assert replace(needs, element=11).lines()[0] == said[0].replace("13", "11") + (
        ": less than fits, as glint covers less than 35%"
    )
    assert (
        "bands see the sea at different instants: coherence 0.50 (threshold 0.93); told: up to 360 ms from the NIR"
        in said
    )
    assert "psf: skipped, little glint (saves a third)" in said
    assert "second opening: runs, left over" in said
    assert needs.without("second opening", "none").lines()[-1] == "second opening: skipped, none"
    assert needs.without("psf", "none").stages[1] == needs.stages[1]
    numbers = needs.numbers()
    assert (numbers["cover"], numbers["glint"], numbers["things"]) == ([0.1, 0.2], [0.2, 0.4], [0.3, 1.0])
    assert not numbers["simultaneous"]
    assert needs.glinted == (0,)
    assert [s["runs"] for s in numbers["stages"]] == [False, True]
