"""The moments kernel against certified values, exact arithmetic and its own tilings."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint.errors import InputError
from deglint.moments import CELL, CellMoments, cell_moments


def accuracy_series(middle, low, high):
    """NIST StRD NumAcc2-4: one value in the middle, then a thousand that alternate."""
    return np.array([middle] + [low, high] * 500)


# NIST Statistical Reference Datasets, univariate summary statistics: data, certified mean and standard deviation
NIST_UNIVARIATE = {
    "NumAcc1": (np.array([10000001.0, 10000003.0, 10000002.0]), 10000002, 1),
    "NumAcc2": (accuracy_series(1.2, 1.1, 1.3), 1.2, 0.1),
    "NumAcc3": (accuracy_series(1000000.2, 1000000.1, 1000000.3), 1000000.2, 0.1),
    "NumAcc4": (accuracy_series(10000000.2, 10000000.1, 10000000.3), 10000000.2, 0.1),
}

# NIST StRD Norris (linear regression, lower difficulty): y, x
NORRIS = np.fromstring(
    """0.1 0.2 338.8 337.4 118.1 118.2 888.0 884.6 9.2 10.1 228.1 226.5 668.5 666.3 998.5 996.3 449.1 448.6
    778.9 777.0 559.2 558.2 0.3 0.4 0.1 0.6 778.1 775.5 668.8 666.9 339.3 338.0 448.9 447.5 10.8 11.6 557.7 556.0
    228.3 228.1 998.0 995.8 888.8 887.6 119.6 120.2 0.3 0.3 0.6 0.3 557.6 556.8 339.3 339.1 888.0 887.2 998.5 999.0
    778.9 779.0 10.2 11.1 117.6 118.3 228.9 229.2 668.4 669.1 449.2 448.9 0.2 0.5""",
    sep=" ",
).reshape(-1, 2)

# NIST StRD Longley (multilinear regression, higher difficulty): y, x1 ... x6
LONGLEY = np.fromstring(
    """60323 83.0 234289 2356 1590 107608 1947 61122 88.5 259426 2325 1456 108632 1948 60171 88.2 258054 3682 1616
    109773 1949 61187 89.5 284599 3351 1650 110929 1950 63221 96.2 328975 2099 3099 112075 1951 63639 98.1 346999 1932
    3594 113270 1952 64989 99.0 365385 1870 3547 115094 1953 63761 100.0 363112 3578 3350 116219 1954 66019 101.2 397469
    2904 3048 117388 1955 67857 104.6 419180 2822 2857 118734 1956 68169 108.4 442769 2936 2798 120445 1957 66513 110.8
    444546 4681 2637 121950 1958 68655 112.6 482704 3813 2552 123366 1959 69564 114.2 502601 3931 2514 125368 1960 69331
    115.7 518173 4806 2572 127852 1961 70551 116.9 554894 4007 2827 130081 1962""",
    sep=" ",
).reshape(-1, 7)
LONGLEY_SLOPES = [
    15.0618722713733, -0.0358191792925910, -2.02022980381683, -1.03322686717359, -0.0511041056535807, 1829.15146461355
]  # fmt: skip


def moments(values, mask=None):
    """Moments of all valid pixels of (variables, rows, columns) or (variables, pixels)."""
    block = values[:, None, :] if values.ndim == 2 else values
    return cell_moments(block, mask).total()


def as_block(columns):
    return np.ascontiguousarray(np.asarray(columns, float).T[:, None, :])


@pytest.mark.parametrize("name", NIST_UNIVARIATE)
def test_nist_univariate(name):
    data, mean, deviation = NIST_UNIVARIATE[name]
    m = moments(data[None, :])
    exact = [Fraction(float(x)) for x in data]
    exact_mean = sum(exact) / len(exact)
    exact_power = sum((x - exact_mean) ** 2 for x in exact)
    # to the last digits of what the stored numbers say ...
    assert m.mean[0] == pytest.approx(float(exact_mean), rel=4e-16)
    assert m.comoment[0, 0] == pytest.approx(float(exact_power), rel=2e-13)
    # ... and to the certified values as far as float64 can store the data (half an ulp of each value)
    stored = np.spacing(data.max()) / 2
    assert m.mean[0] == pytest.approx(mean, abs=stored + np.spacing(float(mean)))
    assert np.sqrt(m.covariance()[0, 0]) == pytest.approx(deviation, abs=2 * stored + 1e-15)


def test_nist_norris():
    m = moments(as_block(NORRIS))
    slope = m.comoment[0, 1] / m.comoment[1, 1]
    r2 = m.comoment[0, 1] ** 2 / (m.comoment[0, 0] * m.comoment[1, 1])
    assert slope == pytest.approx(1.00211681802045, rel=1e-14)
    assert m.mean[0] - slope * m.mean[1] == pytest.approx(-0.262323073774029, rel=1e-12)
    assert r2 == pytest.approx(0.999993745883712, rel=1e-14)


def test_nist_longley():
    m = moments(as_block(LONGLEY))
    scale = np.sqrt(np.diag(m.comoment))
    correlation = m.comoment / np.outer(scale, scale)
    slopes = np.linalg.solve(correlation[1:, 1:], correlation[1:, 0]) * scale[0] / scale[1:]
    # condition number 1.2e4 of the correlation matrix: 16 - 4 digits
    np.testing.assert_allclose(slopes, LONGLEY_SLOPES, rtol=1e-11)
    assert m.mean[0] - slopes @ m.mean[1:] == pytest.approx(-3482258.63459582, rel=1e-11)


@pytest.mark.parametrize("offset", [0.0, 1e4, 1e8])
def test_against_long_double(offset):
    rng = np.random.default_rng(1)
    block = rng.normal(0, 3, (3, 150, 170)) + offset
    block[1] += 0.7 * (block[0] - offset)
    x = block.reshape(3, -1).astype(np.longdouble)
    centred = x - x.mean(axis=1, keepdims=True)
    expected = (centred @ centred.T).astype(float)
    m = moments(block)
    np.testing.assert_allclose(m.mean, x.mean(axis=1).astype(float), rtol=4e-16, atol=1e-15)
    # relative to the scale of the deviations, not of the offset
    np.testing.assert_allclose(m.comoment, expected, atol=1e-14 * expected.max(), rtol=0)


def test_a_cell_whose_typical_pixel_is_far_from_its_mean():
    """The middle one of three pixels that happen to be extreme."""
    rng = np.random.default_rng(7)
    block = rng.normal(0, 1, (2, CELL, 2 * CELL))
    block[0, 0, :CELL], block[0, CELL // 2, :CELL], block[1, :, CELL + 1 :] = 1e9, 1e9, 1e-9
    cells = cell_moments(block)
    for i, part in enumerate((block[:, :, :CELL], block[:, :, CELL:])):
        x = part.reshape(2, -1).astype(np.longdouble)
        centred = x - x.mean(axis=1, keepdims=True)
        spread = np.sqrt(np.diag(centred @ centred.T).astype(float))
        np.testing.assert_allclose(
            cells.comoment[i] / np.outer(spread, spread),
            (centred @ centred.T).astype(float) / np.outer(spread, spread),
            atol=1e-14, rtol=0,
        )  # fmt: skip


@pytest.mark.parametrize("bands", [1, 8, 70])
def test_cells_are_worked_on_together_as_alone(bands):
    rng = np.random.default_rng(9)
    block = rng.normal(50, 3, (bands, CELL + 5, 7 * CELL + 9)).astype(np.float32)
    block[0, 3, 2 * CELL + 7] = np.nan
    found = cell_moments(block)
    assert len(found.keys) == 2 * 8
    for i, (row, column) in enumerate(found.keys.tolist()):
        at = slice(row * CELL, row * CELL + CELL), slice(column * CELL, column * CELL + CELL)
        alone = cell_moments(block[:, *at].copy())
        for name in ("n", "mean", "comoment", "minimum", "maximum", "rest"):
            np.testing.assert_array_equal(getattr(found, name)[i], getattr(alone, name)[0], err_msg=name)


def test_one_extreme_pixel_costs_no_digits_elsewhere():
    rng = np.random.default_rng(2)
    block = rng.normal(100, 1, (2, 64, 192))
    block[:, 3, 3] = 1e15
    cells = cell_moments(block)
    clean = cell_moments(np.ascontiguousarray(block[:, :, 64:]), origin=(0, 64))
    np.testing.assert_array_equal(cells.comoment[1:], clean.comoment)


def test_float32_and_integer_input_is_summed_in_double():
    rng = np.random.default_rng(3)
    block = rng.integers(0, 65535, (2, 65, 70)).astype(np.uint16)
    expected = moments(block.astype(float))
    for dtype in (np.uint16, np.int32, np.float32):
        m = moments(block.astype(dtype))
        np.testing.assert_array_equal(m.comoment, expected.comoment)
        np.testing.assert_array_equal(m.mean, expected.mean)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_invalid_pixels_are_left_out_of_every_variable(bad):
    rng = np.random.default_rng(4)
    block = rng.normal(size=(3, 70, 70))
    holes = rng.random((70, 70)) < 0.3
    dirty = block.copy()
    dirty[1, holes] = bad
    before = dirty.copy()
    m, expected = (moments(*a) for a in ((dirty,), (block, ~holes)))
    assert m.n == (~holes).sum()
    np.testing.assert_array_equal(m.comoment, expected.comoment)
    np.testing.assert_array_equal(m.minimum, expected.minimum)
    np.testing.assert_array_equal(dirty, before)


def split(length, edges):
    return list(zip([0, *edges], [*edges, length], strict=True))


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    rows=st.lists(st.integers(1, 5), max_size=3, unique=True),
    columns=st.lists(st.integers(1, 4), max_size=3, unique=True),
    order=st.randoms(),
    share=st.sampled_from([0.8, 0.9999, 1.0]),
)
def test_any_tiling_on_cells_gives_the_same_bits(rows, columns, order, share):
    height, width = 6 * CELL - 11, 5 * CELL - 7
    rng = np.random.default_rng(5)
    block = rng.normal(1e3, 1, (2, height, width)).astype(np.float32)
    mask = rng.random((height, width)) < share
    whole = cell_moments(block, mask if share < 1 else None).total()
    parts = [
        cell_moments(block[:, r0:r1, c0:c1], mask[r0:r1, c0:c1], origin=(r0, c0))
        for r0, r1 in split(height, [CELL * r for r in sorted(rows)])
        for c0, c1 in split(width, [CELL * c for c in sorted(columns)])
    ]
    order.shuffle(parts)
    merged = CellMoments.concatenate(parts).by_place().total()
    assert merged.n == whole.n
    for name in ("mean", "comoment", "minimum", "maximum"):
        np.testing.assert_array_equal(getattr(merged, name), getattr(whole, name))


@settings(max_examples=20, deadline=None)
@given(
    rows=st.lists(st.integers(1, 3), max_size=2, unique=True),
    columns=st.lists(st.integers(1, 8), max_size=3, unique=True),
    levels=st.integers(0, 4),
)
def test_groups_of_cells_do_not_depend_on_the_tiling(rows, columns, levels):
    """Rows of tiles are joined by themselves, as in a reduction; then the whole."""
    rng = np.random.default_rng(8)
    block = rng.normal(1e5, 1, (2, 4 * 16 - 5, 9 * 16 - 3))
    mask = rng.random(block.shape[1:]) < 0.9
    mask[:, 50:90] = False
    whole = cell_moments(block, mask, cell=16).joined(levels)
    tiles_of_a_row = []
    for r0, r1 in split(block.shape[1], [16 * r for r in sorted(rows)]):
        parts = [
            cell_moments(block[:, r0:r1, c0:c1], mask[r0:r1, c0:c1], origin=(r0, c0), cell=16)
            for c0, c1 in split(block.shape[2], [16 * c for c in sorted(columns)])
        ]
        tiles_of_a_row.append(CellMoments.concatenate(parts).joined(levels))
    found = CellMoments.concatenate(tiles_of_a_row).joined(levels)
    for name in ("keys", "n", "mean", "comoment", "minimum", "maximum", "rest"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
    total, plain = found.total(), cell_moments(block, mask, cell=16).total()
    assert total.n == plain.n == np.count_nonzero(mask)
    np.testing.assert_allclose(total.comoment, plain.comoment, rtol=1e-12)
    np.testing.assert_allclose(total.mean, plain.mean, rtol=1e-15)


def test_groups_hold_neighbours_of_one_row_alone():
    joined = cell_moments(np.ones((1, 48, 160)), cell=16).joined(2)
    assert joined.keys.tolist() == [[r, c] for r in range(3) for c in (0, 4, 8)]
    assert joined.n.tolist() == [1024, 1024, 512] * 3


@settings(max_examples=25, deadline=None)
@given(scale=st.floats(1e-12, 1e12), shift=st.floats(-1e6, 1e6))
def test_scaling_and_shift(scale, shift):
    rng = np.random.default_rng(7)
    block = rng.normal(5, 2, (2, 20, 20))
    m, moved = moments(block), moments((block + shift) * scale)
    rounding = 1e-15 * (1 + abs(shift)) * 400
    np.testing.assert_allclose(moved.comoment / scale**2, m.comoment, rtol=1e-12, atol=rounding)


def test_empty_and_tiny_input():
    assert moments(np.full((2, 4, 4), np.nan)).n == 0
    assert np.isnan(moments(np.full((2, 4, 4), np.nan)).covariance()).all()
    one = moments(np.array([[[3.0]], [[4.0]]]))
    assert one.n == 1
    assert one.comoment.tolist() == [[0, 0], [0, 0]]
    assert moments(np.empty((2, 0, 5))).n == 0


def test_wrong_shapes_are_refused():
    with pytest.raises(InputError, match="mask has shape"):
        moments(np.zeros((2, 4, 4)), np.ones((4, 5), bool))
    with pytest.raises(InputError, match="variable, row, column"):
        cell_moments(np.zeros(4))
