"""What openings become: vectors of whole numbers, every width of a band, level and replacement in one pass."""

import numpy as np
import pytest

from deglint.compensate import State, apply_stages
from deglint.compensate.chain import Sharpen
from deglint.compensate.codes import encoded
from deglint.compensate.identify import IdentifyLevel
from deglint.compensate.level import Opened
from deglint.compensate.median import Median
from deglint.compensate.opening import opening_halo, openings, rank_opening
from deglint.compensate.psf import kernel_psf
from deglint.compensate.replace import ReplaceLevel
from deglint.raster.convert import FORGOTTEN, all_clear, ends
from deglint.raster.encode import encode

from .test_level import opening, sparkle

GRID = (50.0, 2.0)


@pytest.mark.parametrize("dtype", [np.int16, np.int32])
def test_vectors_of_whole_numbers_are_numpy_s(dtype):
    import numba as nb

    from deglint.compensate._whole_lanes import before, behind, count, least, load, most, negative, store, turn

    @nb.njit
    def every(x, out):
        lanes = count(x)
        a, b = load(x, 0), load(x, lanes)
        store(out, 0, least(a, b))
        store(out, lanes, most(a, b))
        store(out, 2 * lanes, negative(a))
        store(out, 3 * lanes, before(a, b))
        store(out, 4 * lanes, behind(a, x[7], 3))
        return lanes

    @nb.njit
    def turned(x, at, step, to, stride):
        turn(x, at, step, to, stride)

    rng, largest = np.random.default_rng(0), np.iinfo(dtype).max
    x, out = rng.integers(-largest, largest, 5000).astype(dtype), np.zeros(5000, dtype)
    x[3] = largest
    lanes = every(x, out)
    a, b = x[:lanes], x[lanes : 2 * lanes]
    after = np.append(a[1:], a[0])
    after[3] = x[7]
    wanted = np.minimum(a, b), np.maximum(a, b), np.where(a == largest, a, -a), np.append(b[0], a[:-1]), after
    np.testing.assert_array_equal(out[: 5 * lanes].reshape(5, lanes), wanted)
    square = np.lib.stride_tricks.as_strided(x[11:], (lanes, lanes), (40 * x.itemsize, x.itemsize)).copy()
    turned(x, 11, 40, 3000, lanes + 3)
    found = np.lib.stride_tricks.as_strided(x[3000:], (lanes, lanes), ((lanes + 3) * x.itemsize, x.itemsize))
    np.testing.assert_array_equal(found, square.T)


@pytest.mark.parametrize("width", [2, 31, 33, 64, 65, 127, 129, 160, 161, 193, 1025])
@pytest.mark.parametrize(("size", "shape"), [(13, "square"), (11, "octagon"), (19, "diamond"), (27, "square")])
def test_every_width_is_the_definition(width, size, shape):
    band = sparkle((29, width), seed=width, holes=0.05)
    np.testing.assert_array_equal(rank_opening(band, size, shape=shape, corners=True), opening(band, size, shape, True))


@pytest.mark.parametrize("columns", [(19, 20), (40, 700), (19, 1081)])
@pytest.mark.parametrize("rows", [(19, 20), (23, 61)])
def test_a_window_is_a_part_of_the_whole(rows, columns):
    codes = encoded(sparkle((80, 1100), holes=0.02), *GRID)
    whole = np.empty((2, *codes.shape), np.int16)
    openings(codes, 13, 13, within=((0, 80), (0, 1100)), out=(whole[0], whole[1]))
    (top, bottom), (left, right), halo = rows, columns, opening_halo(13, 13)
    part = np.empty((2, bottom - top, right - left), np.int16)
    around = codes[top - halo : bottom + halo, left - halo : right + halo]
    within = (halo, halo + bottom - top), (halo, halo + right - left)
    openings(around, 13, 13, within=within, out=(part[0], part[1]))
    np.testing.assert_array_equal(part, whole[:, top:bottom, left:right])


def laid(image, level, limits):
    """The level with its offset, and what exceeds it as glint does: as `State.limits` says it, in float32."""
    offset, rise, full, middle, slope, most, share = (column[:, None, None] for column in limits.T)
    above = np.maximum(level - middle, np.float32(0))
    noise = np.float32(1) + np.minimum(above * slope, most)
    told = level + offset * noise
    return told, ((image > told + (rise * noise + share * above)) | (image >= full)) & np.isfinite(told)


@pytest.mark.parametrize("columns", [16, 31, 255, 257, 600])
@pytest.mark.parametrize("wanted", [True, False])
@pytest.mark.parametrize("bands", [(0, 1, 2, 3, 4), (4, 1, 2), (2,)])
def test_settled_is_the_level_where_the_image_exceeds_it(columns, wanted, bands):
    rng = np.random.default_rng(columns)
    shape = (len(bands), 7, columns)
    codes = rng.integers(-3000, 3000, (2, *shape)).astype(np.int16)
    codes[0, 0, 0, :3] = -32767
    image = rng.normal(50, 4, (5, 11, columns + 9)).astype(np.float32)
    image[:, 5, 5] = np.nan
    before, view = image.copy(), image[:, 2:9, 3 : 3 + columns]
    limits = rng.uniform(0, 2, (5, 7)).astype(np.float32)
    limits[:, 2] = 58, np.inf, 60, 57, np.inf
    limits[:, 3] = 48, 49, 50, 51, 90
    grids, spectrum = [(50.0 + b, 1.0 + b) for b in bands], [1.0 + b for b in bands]
    opened = Opened(codes[0], codes[1], grids, spectrum, range(len(bands)), bands=bands, least=[2.0] * len(bands))
    level, clean, replaced, outlined = opened.settled(view, limits, wanted)
    whole, outlines = opened.of_image(5)
    told, hit = laid(view, whole, limits)
    assert (outlined is None) == (outlines is None) == (len(bands) < 3)
    if outlined is not None:
        np.testing.assert_array_equal(outlined, outlines)
    np.testing.assert_array_equal(replaced, hit)
    np.testing.assert_array_equal(clean, np.where(hit, told, view))
    np.testing.assert_array_equal(image, before)
    if wanted:
        np.testing.assert_array_equal(level, told)
    else:
        assert level is None


@pytest.mark.parametrize("cut", [(0, 0, 0, 0), (9, 8, 7, 9)])
@pytest.mark.parametrize("width", [9, 70])
def test_a_block_that_is_lent_is_left_as_it_is(cut, width):
    block = sparkle((60, width + 30), bands=4)
    ones, every = (1.0,) * 4, tuple(range(4))
    found = IdentifyLevel(5, 5, every, every, (GRID,) * 4, ones, ones, ones, ones, (np.inf,) * 4)
    psf = kernel_psf([[0, 1, 0], [1, 4, 1], [0, 1, 0]])
    chains = (
        [found, ReplaceLevel()], [found], [found, Median(5)], [Sharpen((psf,) * 4, 1), found, ReplaceLevel()],
        [Sharpen((psf,) * 4, 1, image=True), found, ReplaceLevel()],
    )  # fmt: skip
    for stages in chains:
        before = block.copy()
        lent, copied = apply_stages(State.on(block), stages, cut), apply_stages(State.of(block), stages, cut)
        np.testing.assert_array_equal(block, before)
        np.testing.assert_array_equal(lent.image, copied.image)
        np.testing.assert_array_equal(lent.replaced, copied.replaced)


def test_one_look_tells_that_all_is_clear():
    block = np.ones((2, 30, 40), np.float32)
    assert all_clear(ends(block))
    for odd in (np.nan, np.inf, -np.inf, FORGOTTEN[0], -FORGOTTEN[0]):
        block[1, 3, 7] = odd
        assert not all_clear(ends(block))


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint8, np.int16])
@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (0.5, -3.0)])
def test_speckle_is_written_where_it_is_wanted(dtype, scale, offset):
    rng = np.random.default_rng(0)
    values = rng.normal(60, 40, (2, 37, 53)).astype(np.float32)
    values[0, 1, :9] = np.nan
    raw, where = np.full(values.shape, 7, dtype), rng.random((37, 53)) < 0.4
    counts = encode(values, raw, bands=[0, 1], scales=[scale] * 2, offsets=[offset] * 2, where=where)
    put, good = (values.astype(np.float64) - offset) / scale, np.isfinite(values) & where
    if np.dtype(dtype).kind in "iu":
        info = np.iinfo(dtype)
        put = np.rint(put)
        np.testing.assert_array_equal(counts.clipped, ((put < info.min) | (put > info.max))[..., where].sum(axis=1))
        put = np.clip(np.nan_to_num(put), info.min, info.max)
    np.testing.assert_array_equal(raw, np.where(good, put.astype(dtype), 7))
    np.testing.assert_array_equal(counts.negative, (values < 0)[:, where].sum(axis=1))
