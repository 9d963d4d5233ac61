"""The shift between a band and the NIR: against known shifts, a real scene, and the cases that must not be moved."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from deglint.compensate import register
from deglint.compensate.register import (
    CELL,
    ShiftStatistics,
    apply_shift,
    estimate_shift,
    shift_from,
    shift_halo,
    shift_statistics,
)
from deglint.compensate.sharpen import SLAB
from deglint.errors import InputError
from deglint.physics.imaging import observe, transform
from deglint.physics.presets import preset

REAL = Path(__file__).parents[2] / "shared" / "data" / "sentinel2"


def pair(seed, shift, optics="thesis", noise=0.3, side=192, swell=0.0):
    """A band that lies off the NIR by `shift`, and the NIR: sparkle on a grid of quarter pixels through the optics."""
    rng = np.random.default_rng(seed)
    sparkle = rng.gamma(0.02, 1.0, (4 * side, 4 * side))
    if swell:
        waves = ndimage.gaussian_filter(rng.normal(size=sparkle.shape), 4 * swell, mode="wrap")
        sparkle *= np.exp(1.5 * waves / waves.std())
    spectrum = transform(sparkle)
    nir = observe(spectrum, preset(optics), 832.5, factor=4)
    band = observe(spectrum, preset(optics), 660.0, factor=4, shift=(-shift[0], -shift[1]))
    draw = noise * nir.std() * rng.normal(size=(2, side, side))
    return band + draw[0], nir + draw[1]


@pytest.mark.parametrize(("optics", "bias"), [("thesis", 0.02), ("thesis-f30", 0.02), ("micasense", 0.05)])
@pytest.mark.parametrize("shift", [(0.37, -0.21), (-1.5, 2.25)])
def test_known_shifts(optics, bias, shift):
    """Sharp optics alias, which leaves a bias; the docs say how much."""
    found = estimate_shift(*pair(1, shift, optics))
    assert found.useful
    assert abs(found.row - shift[0]) < bias + 3 * found.row_error
    assert abs(found.column - shift[1]) < bias + 3 * found.column_error
    assert found.r2_shifted > found.r2 + 3 * found.gain_error


def test_standard_errors_are_the_spread_between_seeds():
    found = [estimate_shift(*pair(seed, (0.37, -0.21), noise=0.5)) for seed in range(24)]
    for name in ("row", "column"):
        real = np.std([getattr(f, name) for f in found], ddof=1)
        claimed = np.sqrt(np.mean([getattr(f, f"{name}_error") ** 2 for f in found]))
        assert 0.7 < claimed / real < 1.4  # the spread of 24 is known to 15 % itself


def test_what_lies_on_it_and_what_has_nothing_to_do_with_it_are_not_moved():
    moved = [estimate_shift(*pair(seed, (0.0, 0.0))).useful for seed in range(12)]
    assert sum(moved) == 0
    rng = np.random.default_rng(0)
    for _ in range(12):
        found = estimate_shift(*rng.normal(size=(2, 192, 192)))
        assert not found.useful
        assert found.reason.startswith("not moved")


def test_r2_is_that_of_a_regression_on_what_apply_shift_gives():
    band, nir = pair(2, (0.4, 0.3))
    found = estimate_shift(band, nir)
    moved = apply_shift(nir, found.row, found.column)
    cells = []
    everywhere = np.ones(band.shape, bool)
    b, n, m = (register._detrended(x, everywhere) for x in (band, nir, moved))
    for r in range(0, 192, CELL):
        for c in range(0, 192, CELL):
            cell = slice(max(r, 6), min(r + CELL, 186)), slice(max(c, 6), min(c + CELL, 186))
            cells.append([np.mean(x[cell] * y[cell]) for x, y in ((b, b), (n, n), (m, m), (b, n), (b, m))])
    bb, nn, mm, bn, bm = np.array(cells).T
    scale = np.sqrt(bb * nn)
    before = (bn / scale).sum() ** 2 / len(cells) ** 2
    after = (bm / scale).sum() ** 2 / len(cells) / (mm / nn).sum()
    assert found.r2 == pytest.approx(before, rel=1e-9)
    assert found.r2_shifted == pytest.approx(after, rel=0.02)


def test_few_cells_cannot_tell():
    found = estimate_shift(*pair(0, (0.5, 0.0), side=64))
    assert not found.useful
    assert "too few" in found.reason
    assert np.isnan(found.row_error)
    assert found.halo == 0
    assert estimate_shift(np.full((50, 50), np.nan), np.ones((50, 50))).pixels == 0
    assert estimate_shift(np.ones((1, 1)), np.ones((1, 1))).pixels == 0
    assert estimate_shift(np.ones((200, 200)), np.ones((200, 200))).reason.endswith("are needed")


def test_statistics_of_tiles_merge():
    band, nir = pair(3, (0.4, -0.6), side=256)
    parts = [shift_statistics(band[r : r + 128, c : c + 128], nir[r : r + 128, c : c + 128])
             for r in (0, 128) for c in (0, 128)]  # fmt: skip
    merged = ShiftStatistics.merge(parts)
    assert len(merged.variance) == 64
    found, whole = shift_from(merged), estimate_shift(band, nir)
    assert found.row == pytest.approx(whole.row, abs=0.01)
    assert found.column == pytest.approx(whole.column, abs=0.01)
    with pytest.raises(InputError, match="at least one"):
        ShiftStatistics.merge([])


def test_ships_and_holes_do_not_mislead():
    band, nir = pair(4, (0.4, -0.3), side=256)
    clean = estimate_shift(band, nir)
    rng = np.random.default_rng(0)
    for _ in range(10):
        r, c = rng.integers(10, 240, 2)
        for image, k in ((band, 0), (nir, 1)):
            image[r : r + 3, c + k : c + k + 6] += 100 * band.std()
    band[100:120, 30:70] = np.nan
    nir[rng.random(nir.shape) < 0.0005] = np.nan
    before = band.copy(), nir.copy()
    found = estimate_shift(band, nir)
    np.testing.assert_array_equal(band, before[0])
    np.testing.assert_array_equal(nir, before[1])
    assert abs(found.row - clean.row) < 3 * found.row_error + 0.03
    assert abs(found.column - clean.column) < 3 * found.column_error + 0.15


def test_a_large_offset_costs_nothing():
    band, nir = pair(5, (0.4, -0.3))
    found, lifted = estimate_shift(band, nir), estimate_shift(band + 1e8, nir + 1e8)
    assert lifted.row == pytest.approx(found.row, abs=1e-4)


# ---------------------------------------------------------------------------------------------------- moving


def test_moves_a_smooth_band_exactly():
    r, c = np.mgrid[0:60, 0:80]

    def waves(dr, dc):
        return np.sin(0.5 * (r - dr) + 0.3 * (c - dc)) + np.cos(0.2 * (r - dr) - 0.6 * (c - dc))

    for shift in ((0.5, 0.25), (-1.3, 2.0), (2.99, -2.99)):
        moved = apply_shift(waves(0, 0), *shift)
        np.testing.assert_allclose(moved[8:-8, 8:-8], waves(*shift)[8:-8, 8:-8], atol=0.02)


def test_is_the_sum_of_lanczos():
    rng = np.random.default_rng(0)
    image = rng.normal(size=(20, 25))
    row, column = 0.37, -1.21

    def lanczos(x):
        return np.where(np.abs(x) < 3, np.sinc(x) * np.sinc(x / 3), 0)

    r, c = 10, 12
    weights = np.outer(lanczos(r - row - np.arange(20)), lanczos(c - column - np.arange(25)))
    assert apply_shift(image, row, column)[r, c] == pytest.approx((weights * image).sum() / weights.sum(), rel=1e-5)


def test_whole_pixels_and_plains():
    rng = np.random.default_rng(0)
    image = rng.normal(size=(30, 40)).astype(np.float32)
    np.testing.assert_allclose(apply_shift(image, 0, 0), image, atol=1e-6)
    np.testing.assert_allclose(apply_shift(image, 2, -1)[2:, :-1], image[:-2, 1:], atol=1e-6)
    for shape in ((1, 1), (1, 5), (3, 2), (0, 4)):
        plain = np.full(shape, 9, np.uint16)
        np.testing.assert_allclose(apply_shift(plain, 0.5, -0.5), plain, rtol=1e-6)


def test_holes_move_and_do_not_spread():
    image = np.full((40, 40), 5.0)
    image[10:15, 20:22] = np.nan
    image[30, 30] = np.inf
    moved = apply_shift(image, 1.2, -0.4)
    wanted = np.zeros((40, 40), bool)
    wanted[11:16, 20:22] = True
    wanted[31, 30] = True
    np.testing.assert_array_equal(np.isnan(moved), wanted)
    np.testing.assert_allclose(moved[~wanted], 5.0, rtol=1e-5)


@settings(max_examples=25)
@given(data=st.data())
def test_moved_tiles_are_the_whole_to_the_bit(data):
    rng = np.random.default_rng(data.draw(st.integers(0, 3)))
    shape = data.draw(st.sampled_from([(60, 91), (SLAB + 30, 40)]))
    image = rng.gamma(0.3, 200.0, shape).astype(np.float32)
    image[rng.random(shape) < data.draw(st.sampled_from([0.0, 0.02, 0.9]))] = np.nan
    shift = data.draw(st.sampled_from([(0.5, 0.25), (-2.7, 0.1), (1.0, 0.0)]))
    whole, halo = apply_shift(image, *shift), shift_halo(*shift)
    (r0, r1), (c0, c1) = (sorted(data.draw(st.lists(st.integers(0, n), min_size=2, max_size=2))) for n in shape)
    top, left = max(r0 - halo, 0), max(c0 - halo, 0)
    tile = apply_shift(image[top : r1 + halo, left : c1 + halo], *shift)
    np.testing.assert_array_equal(tile[r0 - top :, c0 - left :][: r1 - r0, : c1 - c0], whole[r0:r1, c0:c1])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: apply_shift(np.ones(3), 0, 0), "(row, column)"),
        (lambda: apply_shift(np.ones((3, 3)), 4, 0), "-3 to 3 pixels, got (4, 0)"),
        (lambda: apply_shift(np.ones((3, 3)), np.nan, 0), "-3 to 3 pixels"),
        (lambda: estimate_shift(np.ones((3, 3)), np.ones((3, 4))), "one shape; got (3, 3), (3, 4)"),
    ],
)
def test_refusals_are_one_clear_line(call, words):
    with pytest.raises(InputError) as error:
        call()
    assert words in str(error.value)


@pytest.mark.shared
@pytest.mark.skipif(not REAL.exists(), reason="the real scenes do not lie beside the project")
def test_real_scene():
    """R2 of B04 on B08 in the hand-drawn deep water: .581, and .705 with the best shift to a quarter of a pixel."""
    from deglint import open_scene
    from deglint.readers.areas import open_area

    scene = open_scene(REAL / "palau.tif")
    area = open_area(str(REAL / "palau_deep_water.geojson"), scene, "--sample")
    inside = area.read(((0, scene.height), (0, scene.width)))
    block = scene.read()
    band, nir = (block[scene.names.index(b)] for b in ("B04", "B08"))
    found = estimate_shift(band, nir, inside)
    assert found.useful
    moved = apply_shift(nir, found.row, found.column)
    r2 = [np.corrcoef(band[inside], x[inside])[0, 1] ** 2 for x in (nir, moved)]
    assert r2 == pytest.approx([0.581, 0.705], abs=2e-3)
