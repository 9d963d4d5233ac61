"""The opened level against scipy's morphology and brute force; tiles against the whole; holes and edges."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from deglint.compensate.codes import NOTHING, decoded, encoded
from deglint.compensate.level import SLACK, Opened, Witness, blurred, opened_level
from deglint.compensate.opening import diamond_of, elements, opening_halo, openings, openings_of_pieces, rank_opening
from deglint.compensate.psf import kernel_psf, system_psf
from deglint.compensate.sharpen import richardson_lucy, sharpen_halo
from deglint.errors import InputError

GREEN = system_psf(545.0, f_number=10, pitch=8e-6)
GRID = (50.0, 2.0)
LOPSIDED = kernel_psf([[0, 1, 0], [2, 8, 4], [0, 3, 1]])


def sparkle(shape=(60, 71), seed=0, holes=0.0, bands=1):
    rng = np.random.default_rng(seed)
    band = rng.normal(50, 2, (bands, *shape)) + np.where(rng.random((bands, *shape)) < 0.2, rng.gamma(0.5, 80.0), 0)
    band[rng.random(band.shape) < holes] = np.nan
    if holes:
        band[:, :9, :14] = np.nan  # larger than some elements, in a corner
    return band.astype(np.float32) if bands > 1 else band[0].astype(np.float32)


def told(band, grid=GRID):
    """A band, or some, as levels are told of it."""
    flat = np.asarray(band, np.float32).reshape(-1, np.shape(band)[-1])
    return decoded(encoded(flat, *grid), *grid).reshape(np.shape(band))


def footprint(size, shape):
    """All pixels of an element, composed by brute force."""
    if shape == "square":
        return np.ones((size, size), bool)
    radius = size // 2
    down, across = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    if shape == "diamond":
        return abs(down) + abs(across) <= radius
    return abs(down) + abs(across) <= round(1.45 * radius)


def opening(band, size, shape="square", corners=False):
    """The definition in float64, by scipy: what lies beyond the edge or is not valid has no say."""
    foot = footprint(size, shape)
    some = np.where(np.isnan(band), np.inf, band).astype(np.float64)
    low = ndimage.minimum_filter(some, footprint=foot, mode="constant", cval=np.inf)
    middle = ndimage.median_filter(low, 3, mode="nearest")
    if corners:  # squares of 2 x 2 that lie in the image at least in part
        rows, columns = low.shape
        wide = np.pad(low, 1, constant_values=np.inf)
        least = np.min([wide[i : i + rows + 1, j : j + columns + 1] for i in (0, 1) for j in (0, 1)], axis=0)
        squares = [least[i : i + rows, j : j + columns] for i in (0, 1) for j in (0, 1)]
        middle = np.maximum(middle, np.max(squares, axis=0))
    low = middle
    low = np.where(np.isinf(low), -np.inf, low)
    found = ndimage.maximum_filter(low, footprint=foot, mode="constant", cval=-np.inf)
    return np.where(np.isinf(found), np.nan, found)


@pytest.mark.parametrize("holes", [0.0, 0.1, 0.9])
@pytest.mark.parametrize("size", [1, 3, 5, 11, 13])
@pytest.mark.parametrize("corners", [False, True])
@pytest.mark.parametrize("shape", ["square", "octagon", "diamond"])
def test_is_the_definition(shape, corners, size, holes):
    band = sparkle(holes=holes)
    before = band.copy()
    found = rank_opening(band, size, shape=shape, corners=corners)
    np.testing.assert_array_equal(found, opening(band, size, shape, corners))
    np.testing.assert_array_equal(band, before)


@pytest.mark.parametrize("shape", ["square", "octagon", "diamond"])
@pytest.mark.parametrize("size", [1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 43, 255])
def test_small_elements_make_the_large_one(size, shape):
    found = {(0, 0)}
    for element in elements(size, shape):
        assert len(element) in (3, 5)
        found = {(row + down, column + right) for row, column in found for down, right in element}
    wanted = {tuple(place) for place in (np.argwhere(footprint(size, shape)) - size // 2).tolist()}
    assert found == wanted


def test_the_diamond_is_as_large_as_the_square():
    for size in range(5, 40, 2):
        smaller, own, larger = (
            abs(int(footprint(diamond_of(size) + more, "diamond").sum()) - size**2) for more in (-2, 0, 2)
        )
        assert own <= min(smaller, larger)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 1), (3, 4), (12, 200)])
def test_elements_larger_than_the_image(shape):
    band = sparkle(shape)
    np.testing.assert_array_equal(rank_opening(band, 13), opening(band, 13))
    assert np.isnan(rank_opening(np.full(shape, np.nan, np.float32), 5)).all()
    assert np.isnan(rank_opening(np.full(shape, np.nan, np.float32), 5, shape="octagon")).all()


@pytest.mark.parametrize("size", [0, -3, 4])
def test_sizes_that_have_no_middle_are_refused(size):
    with pytest.raises(InputError, match="odd size of 1 pixel or more"):
        rank_opening(np.ones((4, 4), np.float32), size)


@settings(max_examples=25)
@given(power=st.integers(-20, 20), seed=st.integers(0, 5))
def test_scaling_by_powers_of_two_is_exact_and_order_is_all_that_counts(power, seed):
    band = sparkle(seed=seed, holes=0.02)
    factor = np.float32(2.0**power)
    np.testing.assert_array_equal(rank_opening(band * factor, 11), rank_opening(band, 11) * factor)
    # any monotonic function may be applied before or after
    ranks = np.searchsorted(np.unique(band[np.isfinite(band)]), band).astype(np.float32)
    ranks[np.isnan(band)] = np.nan
    distinct = np.append(np.unique(band[np.isfinite(band)]), np.nan)
    found = rank_opening(ranks, 11)
    np.testing.assert_array_equal(distinct[np.where(np.isnan(found), -1, found).astype(int)], rank_opening(band, 11))


def test_squares_survive_to_the_size_of_the_element_and_smaller_things_go():
    for side in range(9, 17):
        band = np.zeros((60, 60), np.float32)
        band[20 : 20 + side, 22 : 22 + side] = 7
        found = rank_opening(band, 13)
        assert found.max() == (7 if side >= 15 else 0)  # a median of 3 takes the corners of what erosion leaves
        np.testing.assert_array_equal(rank_opening(band, 13, corners=True), band if side >= 14 else 0)
    flat = np.full((40, 40), 3.0, np.float32)
    np.testing.assert_array_equal(rank_opening(flat, 13), flat)


@pytest.mark.parametrize("holes", [0.0, 0.02, 0.4])
def test_outlines_are_an_octagon_grown_by_a_pixel_under_a_small_square_and_a_diamond(holes):
    band = told(sparkle(holes=holes))
    octagon = opening(band, 11, "octagon", corners=True)
    cross = ndimage.generate_binary_structure(2, 1)
    around = ndimage.maximum_filter(np.nan_to_num(octagon, nan=-np.inf), footprint=cross)
    grown = np.minimum(around, opening(band, 3))
    diamond = opening(band, 19, "diamond", corners=True)
    rows, columns = (3, 40), (11, 71)
    found = np.empty((2, 37, 60), np.int16)
    openings(encoded(band, *GRID), 13, 11, within=(rows, columns), out=(found[0], found[1]))
    base, outline = decoded(found[0], *GRID), decoded(found[1], *GRID)
    np.testing.assert_array_equal(base, opening(band, 13, corners=True)[slice(*rows), slice(*columns)])
    wanted = np.fmax(np.fmax(octagon, grown), diamond)[slice(*rows), slice(*columns)]
    np.testing.assert_array_equal(outline, wanted)


def kept(level, outlines, spectrum):
    codes = [np.stack([encoded(b, 0.0, 1.0) for b in block]) for block in (level, outlines)]
    return Opened(*codes, [(0.0, 1.0)] * len(level), list(spectrum), range(len(level))).level()[0]


@settings(max_examples=60)
@given(
    centre=st.floats(-1e4, 1e4, width=32), power=st.integers(-30, 12), seed=st.integers(0, 9),
    reach=st.sampled_from([1e-3, 1.0, 100.0, 1e6, 1e12]),
)  # fmt: skip
def test_codes_keep_the_order_and_are_as_fine_as_they_say(centre, power, seed, reach):
    unit = float(np.float32(max(2.0**power, 1e-4 * abs(centre))))
    values = np.random.default_rng(seed).standard_cauchy((1, 400)) * reach * unit + centre
    values = np.sort(values.astype(np.float32), axis=1)
    codes = encoded(values, centre, unit)
    assert (np.diff(codes.astype(int)) >= 0).all()
    back = decoded(codes, centre, unit).astype(np.float64)
    np.testing.assert_array_equal(encoded(back.astype(np.float32), centre, unit), codes)
    away = np.abs(values.astype(np.float64) - centre) / unit
    inside = away < 4e9
    step = (1 + away) / 1024 * unit + 1e-6 * (np.abs(values) + abs(centre))
    assert (np.abs(back - values) <= 0.51 * step)[inside].all()


def test_codes_of_what_is_no_number_and_of_what_is_too_large():
    odd = np.array([[np.nan, np.inf, -np.inf, 3e38, -3e38, 0.0]], np.float32)
    codes = encoded(odd, 0.0, 1.0)
    assert codes[0].tolist() == [NOTHING, 32766, -32766, 32766, -32766, 0]
    assert np.isnan(decoded(np.array([[NOTHING, -NOTHING]], np.int16), 1.0, 2.0)).all()
    assert decoded(codes[:, 1:5], 0.0, 1.0).tolist() == [[v, -v, v, -v] for v in [decoded(codes, 0.0, 1.0)[0, 1]]]


def most_of_two_neighbours(scaled, i):
    """Brute force: the best pair among two bands before, one on either side, two after; the fainter of the pair."""
    pairs = [(i - 2, i - 1), (i - 1, i + 1), (i + 1, i + 2)]
    inside = [p for p in pairs if min(p) >= 0 and max(p) < len(scaled)]
    return np.max([np.minimum(scaled[a], scaled[b]) for a, b in inside], axis=0)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 8])
def test_details_are_kept_where_two_neighbours_agree(count):
    rng = np.random.default_rng(count)
    details = told(rng.gamma(1.0, 3.0, (count, 20, 30)) - 0.5, (0.0, 1.0))
    spectrum = rng.uniform(0.5, 2.0, count)
    found = kept(np.zeros_like(details), details, spectrum)
    codes = [np.stack([encoded(b, 0.0, 1.0) for b in block]) for block in (np.zeros_like(details), details)]
    least = rng.uniform(0.5, 3.0, count)
    of_all = Opened(*codes, [(0.0, 1.0)] * count, list(spectrum), range(count), least=least)
    again, outlined = of_all.level()
    np.testing.assert_array_equal(again, found)
    if count < 3:
        assert outlined is None
        assert not found.any()
        return
    details = np.maximum(details, 0)
    scaled = details / spectrum[:, None, None]
    for i in range(count):
        wanted = np.minimum(details[i], SLACK * spectrum[i] * most_of_two_neighbours(scaled, i))
        np.testing.assert_allclose(found[i], wanted, rtol=2e-6)
    exceeds = found > least.astype(np.float32)[:, None, None]
    np.testing.assert_array_equal(outlined, exceeds.sum(axis=0) >= count / 2)
    assert 0.01 < outlined.mean() < 0.9
    assert not replace(of_all, least=[1e9] * count).level()[1].any()
    narrow = replace(of_all, levels=codes[0][..., :5], outlines=codes[1][..., :5])
    for part, whole in zip(narrow.level(), (found, outlined), strict=True):
        np.testing.assert_array_equal(part, whole[..., :5])
    where = rng.random(found.shape[1:]) < 0.3
    where[3:9] = False  # whole rows without
    some = replace(of_all, where=where)
    for part, whole in zip(some.level(), (found, outlined), strict=True):
        np.testing.assert_array_equal(part, np.where(where, whole, 0))
    for part, whole in zip(replace(narrow, where=where[:, :5]).level(), some.level(), strict=True):
        np.testing.assert_array_equal(part, whole[..., :5])


@pytest.mark.parametrize("witness", [0, 3, 7])
def test_of_a_detail_that_is_left_out_which_a_witness_shows(witness):
    rng = np.random.default_rng(witness)
    spectrum = rng.uniform(0.5, 2.0, 8)
    glint = rng.gamma(0.3, 3.0, (20, 30))
    details = told(rng.gamma(1.0, 3.0, (8, 20, 30)) + spectrum[:, None, None] * glint, (0.0, 1.0))
    details[witness] = told(spectrum[witness] * glint, (0.0, 1.0))
    codes = [np.stack([encoded(b, 0.0, 1.0) for b in block]) for block in (np.zeros_like(details), details)]
    found, outlined = Opened(
        *codes, [(0.0, 1.0)] * 8, list(spectrum), range(8), least=[1.0] * 8, witness=witness
    ).level()
    scaled = details / spectrum[:, None, None]
    scaled = np.maximum(scaled - scaled[witness], 0)
    for i in range(8):
        wanted = spectrum[i] * np.minimum(scaled[i], SLACK * most_of_two_neighbours(scaled, i))
        np.testing.assert_allclose(found[i], wanted, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(outlined, (found > 1).sum(axis=0) >= 4)
    assert not found[witness].any()


def test_with_a_witness_round_things_are_kept_and_sparkle_is_not():
    """A disc that the last band does not show, beside a round clump of sparkle that all of them show."""
    rows, columns = np.mgrid[:48, :96]
    disc, clump = ((rows - 24) ** 2 + (columns - c) ** 2 <= 8**2 for c in (24, 72))
    noise = np.random.default_rng(0).normal(50, 0.1, (4, 48, 96))
    block = (noise + 20 * clump + 30 * disc * np.array([1, 1, 1, 0])[:, None, None]).astype(np.float32)
    witness = Witness(3, [1.0] * 4, 6)
    given = {"detail": 13, "order": range(4), "spectrum": [1.0] * 4, "least": [1.0] * 4}
    level, outlined = opened_level(list(block), block.shape, 13, [(50.0, 0.1)] * 4, witness=witness, **given)
    core = np.hypot(rows - 24, columns - 24) <= 6
    assert (level[:3, core] > 79).all()
    assert outlined[core].all()
    assert (level[:, clump] < 51).all()
    assert not outlined[clump].any()
    alone, _ = opened_level(list(block), block.shape, 13, [(50.0, 0.1)] * 4, **given)
    assert (alone[:3, clump & (np.hypot(rows - 24, columns - 72) <= 6)] > 69).all()


def test_a_flash_of_one_band_is_no_detail_and_a_thing_of_all_is():
    alone, everywhere = np.zeros((2, 5, 9, 9), np.float32)
    alone[2, 4, 4] = 5
    everywhere[:, 4, 4] = 5
    level = np.full((5, 9, 9), 7, np.float32)
    np.testing.assert_array_equal(kept(level, level + alone, [1.0] * 5), 7)
    np.testing.assert_array_equal(kept(level, level + everywhere, [1.0] * 5), 7 + everywhere)


@pytest.mark.parametrize("psf", [GREEN, LOPSIDED], ids=["green", "lopsided"])
def test_blurring_is_convolution_with_what_the_band_was_sharpened_with(psf):
    band = sparkle()
    kernel = sum(np.outer(d, a) for d, a in psf.factors(2))
    wanted = ndimage.convolve(band.astype(np.float64), kernel, mode="mirror")
    np.testing.assert_allclose(blurred(band, psf), wanted, rtol=1e-5)
    hollow = sparkle(holes=0.05)
    valid = np.isfinite(hollow)
    share = ndimage.convolve(valid.astype(np.float64), kernel, mode="mirror")
    total = ndimage.convolve(np.where(valid, hollow, 0).astype(np.float64), kernel, mode="mirror")
    wanted = total / np.where(valid, share, 1.0)
    found = blurred(hollow, psf)
    np.testing.assert_array_equal(np.isnan(found), ~valid)
    np.testing.assert_allclose(found[valid], wanted[valid], rtol=1e-5)


CASES = {
    "plain": {}, "detail": {"detail": 9}, "blurred": {"psfs": True}, "all": {"detail": 11, "psfs": True, "sharp": True},
    "witness": {"detail": 9, "witness": Witness(1, [12.0] * 4, 4)},
    "witness, blurred": {"detail": 11, "psfs": True, "witness": Witness(3, [150.0] * 4, 6)},
}  # fmt: skip


def level_of(block, size, case):
    case = dict(case)
    psfs = [GREEN, LOPSIDED, GREEN, LOPSIDED] if case.pop("psfs", False) else None
    if case.pop("sharp", False):
        block = [richardson_lucy(b, p, iterations=1) for b, p in zip(block, psfs, strict=True)]
    shape = (len(block), *block[0].shape)
    level, outlined = opened_level(
        list(block), shape, size, [GRID] * 4, order=(2, 0, 1, 3), spectrum=(1.0, 0.7, 1.4, 1.1), psfs=psfs,
        least=[1.0] * 4, **case,
    )  # fmt: skip
    assert (outlined is None) == (not case.get("detail"))
    return level, level[0] if outlined is None else outlined


def halo_of(size, case):
    out = opening_halo(size, case.get("detail", 0))
    if case.get("psfs"):
        out += GREEN.radius
    if case.get("witness"):
        out += case["witness"].reach
    return out + (sharpen_halo(GREEN, 1) if case.get("sharp") else 0)


@pytest.mark.parametrize("name", CASES)
@settings(max_examples=12)
@given(data=st.data())
def test_tiles_are_the_whole_to_the_bit(name, data):
    case = CASES[name]
    shape = data.draw(st.sampled_from([(60, 71), (9, 130), (140, 5)]))
    size = data.draw(st.sampled_from([5, 11, 13]))
    block = sparkle(
        shape, seed=data.draw(st.integers(0, 3)), holes=data.draw(st.sampled_from([0.0, 0.05, 0.6])), bands=4
    )
    whole = level_of(block, size, case)
    (r0, r1), (c0, c1) = (sorted(data.draw(st.lists(st.integers(0, n), min_size=2, max_size=2))) for n in shape)
    r1, c1 = max(r1, r0 + 1), max(c1, c0 + 1)
    halo = halo_of(size, case)
    top, left = max(r0 - halo, 0), max(c0 - halo, 0)
    tile = level_of(block[:, top : r1 + halo, left : c1 + halo], size, case)
    for part, all_of_it in zip(tile, whole, strict=True):
        inner = part[..., r0 - top :, c0 - left :][..., : r1 - r0, : c1 - c0]
        np.testing.assert_array_equal(inner, all_of_it[..., r0:r1, c0:c1])


def test_a_level_of_one_band_and_of_nothing():
    band = sparkle()
    wanted = rank_opening(told(band), 13, corners=True)
    np.testing.assert_array_equal(opened_level([band], (1, *band.shape), 13, [GRID])[0][0], wanted)
    one, _ = opened_level([band], (1, *band.shape), 13, [GRID], detail=11, order=(0,), spectrum=(1.0,))  # no neighbours
    np.testing.assert_array_equal(one[0], wanted)
    nothing = [np.full((8, 8), np.nan, np.float32)] * 3
    found, _ = opened_level(
        nothing, (3, 8, 8), 5, [GRID] * 3, detail=3, order=(0, 1, 2), spectrum=(1.0, 1.0, 1.0), psfs=[GREEN] * 3
    )
    assert np.isnan(found).all()


@pytest.mark.parametrize("count", [1, 7, 60])
def test_outlines_in_pieces_are_those_of_the_whole(count):
    """Squares anywhere, at edges and over each other, laid side by side in one row or in several."""
    codes, rng = encoded(sparkle((230, 310), holes=0.01), *GRID), np.random.default_rng(count)
    within, side = ((17, 230), (0, 290)), 32
    level, every = np.empty((2, 213, 290), np.int16)
    openings(codes, 13, 11, within=within, out=(level, every))
    alone, found = np.full_like(every, -7), np.full_like(every, -7)
    openings(codes, 13, 11, within=within, out=(None, alone))
    np.testing.assert_array_equal(alone, every)
    corners = np.column_stack([rng.integers(0, n - side, count, endpoint=True) for n in every.shape])
    corners[0] = np.array(every.shape) - side
    openings_of_pieces(codes, 13, 11, corners, side, within=within, out=found)
    wanted = np.full_like(every, -7)
    for row, column in corners:
        place = slice(row, row + side), slice(column, column + side)
        wanted[place] = every[place]
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("share", [0.0, 1e-4, 1e-3, 0.3, 1.0])
@pytest.mark.parametrize("psfs", [None, [GREEN] * 4])
def test_outlines_count_only_where_they_are_asked_for(share, psfs):
    rng = np.random.default_rng(5)
    block = sparkle((150, 333), holes=0.01, bands=4)
    where = rng.random(block.shape[1:]) < share
    if share == 1e-4:
        where[:] = False
        where[70, 60:70] = where[149, 332] = where[0, 0] = True  # in three pieces

    def found(detail=11, **options):
        order, spectrum, least = (2, 0, 1, 3), (1.0, 0.7, 1.4, 1.1), [1.0] * 4
        return opened_level(list(block), block.shape, 13, [GRID] * 4, detail=detail, order=order, spectrum=spectrum,
                            least=least, **options)  # fmt: skip

    (every, outlines), (none, _) = found(), found(0)
    level, outlined = found(where=where)
    np.testing.assert_array_equal(level, np.where(where, every, none))
    assert (outlined is None) == (not where.any())
    if outlined is not None:
        np.testing.assert_array_equal(outlined, outlines & where)
    window = (20, 140), (30, 300)
    again, _ = found(where=where, within=window)
    np.testing.assert_array_equal(again, level[:, 20:140, 30:300])
    if psfs is not None:
        whole, part = found(where=where, psfs=psfs)[0], found(where=where, psfs=psfs, within=window)[0]
        np.testing.assert_array_equal(part, whole[:, 20:140, 30:300])
