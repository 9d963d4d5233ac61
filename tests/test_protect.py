"""Things are kept, sparkle is not; likelihoods against brute force; tiles against the whole."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from deglint.compensate import _explain_kernels as shape_kernels
from deglint.compensate import _glance_kernels as step_kernels
from deglint.compensate import _protect_kernels as kernels
from deglint.compensate import evidence, protect
from deglint.compensate import glance as first_look
from deglint.compensate.evidence import (
    BINS,
    HIGH,
    LEAST_SCORE,
    LOW,
    TEXTURE,
    UNIT,
    WATER_HIDDEN,
    bends,
    binned,
    clusters,
    counted,
    score,
    tables,
)
from deglint.compensate.shapes import shapes
from deglint.errors import FitError, InputError
from deglint.scene import Band

CENTRES = (425.0, 480.0, 545.0, 605.0, 660.0, 725.0, 832.5, 950.0)
BANDS = [Band(f"band {i}", wavelength=w, width=50.0, time_offset=0.06 * i) for i, w in enumerate(CENTRES)]
WATER = np.array([0.033, 0.026, 0.015, 0.007, 0.004, 0.003, 0.0014, 0.0012])
NOISE = np.column_stack([np.full(8, 1e-7), np.full(8, 1e-5)])
RED = np.array([0.03, 0.03, 0.03, 0.2, 0.45, 0.47, 0.47, 0.47])
BLUE = np.array([0.37, 0.32, 0.05, 0.03, 0.03, 0.03, 0.03, 0.03])


def sea(seed=0, size=128, lasting=False):
    """Reflectance of water under sparkle that each band draws anew (or that lasts), with noise; and the level."""
    rng = np.random.default_rng(seed)
    flashes = np.zeros((8, size, size))
    shape = (size, size)
    drawn = [rng.gamma(0.4, 0.15, shape) * (rng.random(shape) < 0.08) for _ in range(1 if lasting else 8)]
    for b in range(8):
        one = drawn[b % len(drawn)]
        flashes[b] = one + 0.1 * sum(np.roll(one, s, a) for s in (-1, 1) for a in (0, 1))
    level = np.broadcast_to(WATER[:, None, None], flashes.shape).copy()
    clean = level + flashes
    noise = np.sqrt(NOISE[:, :1, None] + NOISE[:, 1:, None] * clean) * rng.standard_normal(clean.shape)
    return clean + noise, level


def place(raw, row, column, size, reflectance):
    """A thing of size x size pixels over whatever was there."""
    raw[:, row : row + size, column : column + size] = np.asarray(reflectance)[:, None, None]


@pytest.fixture(scope="module")
def learnt():
    return protect.fit([sea(1)], BANDS, noise=NOISE, irradiance=np.ones(8))


def test_likelihood_is_the_normal_density_integrated_over_brightness():
    rng = np.random.default_rng(3)
    shape, d, u = rng.random(8) + 0.1, rng.random(8) * 1e-3 + 1e-4, rng.standard_normal((3, 8)) * 0.02
    x = 0.2 * shape + 0.02 * rng.standard_normal(8)
    data, how = np.zeros((8, 3, shape_kernels.BATCH)), np.zeros((5, shape_kernels.BATCH))
    bent = u / shape  # of a shape of brightness one, that differs from itself by as much as the bends say
    data[:, 0, 0], data[:, 1, 0], data[:, 2, 0] = x, d - shape_kernels.FLOOR**2, shape
    how[:, 0] = 1.0, 1.0, 0.0, -1.0, 1.0
    parts = shape_kernels.solved(data, bent[:2], u[2], 1, how)[:, 0]
    found, best, part = shape_kernels.likelihood(*parts[:4], 8), how[4, 0], parts[4:7]
    covariance = np.diag(d) + u.T @ u
    a = np.linspace(best - 1.0, best + 1.0, 20001)
    density = [multivariate_normal.logpdf(x - v * shape, cov=covariance) for v in a]
    assert found == pytest.approx(np.log(np.trapezoid(np.exp(density), a)), abs=1e-9)
    inverse = np.linalg.inv(covariance)
    assert best == pytest.approx(shape @ inverse @ x / (shape @ inverse @ shape), rel=1e-9)
    assert part == pytest.approx(u @ inverse @ (x - best * shape), rel=1e-8)


def test_chain_is_the_sum_of_its_steps_and_a_density():
    rng = np.random.default_rng(4)
    y = rng.gamma(0.5, 0.05, (3, 4000))
    first, following = tables([counted(binned(y))])
    step = (HIGH - LOW) / BINS
    assert np.exp(first).sum() * step == pytest.approx(1)
    assert (np.exp(following).sum(axis=2) * step) == pytest.approx(np.ones((2, BINS)))
    out, place = np.empty(50), binned(y[:, :50]).astype(np.uint16)
    rows = np.arange(2)[:, None] * BINS**2 + place[:-1] * BINS + place[1:]
    shape_kernels.chain(y[:, :50], rows.T, np.arange(50), first, following.ravel(), UNIT, out)
    for i in range(50):
        z = np.arcsinh(y[:, i] / UNIT)
        at = ((z - LOW) / step).astype(int)
        wanted = first[at[0]] + following[0, at[0], at[1]] + following[1, at[1], at[2]]
        assert out[i] == pytest.approx(wanted - np.log(UNIT * np.cosh(z)).sum(), abs=1e-9)


def test_shapes_are_scaled_and_shared_out():
    found = shapes(CENTRES, [50.0] * 8)
    assert found.values.max(axis=1) == pytest.approx(np.ones(len(found.values)))
    assert found.weight.sum() == pytest.approx(1)
    assert (found.values > 0).all()
    assert sorted(found.odd[found.odd >= 0]) == list(range(8))
    with pytest.raises(InputError, match="positive"):
        shapes([450.0], [0.0])


def test_sparkle_alone_is_never_a_thing(learnt):
    for seed in (1, 2, 3):
        raw, level = sea(seed)
        found = protect.things(raw, level, learnt)
        assert not found.mask.any()
        compensated = np.minimum(raw, level).astype(np.float32)
        assert np.array_equal(protect.put_back(compensated, level, found), compensated)


@pytest.mark.parametrize("size", [2, 3, 5])
@pytest.mark.parametrize("reflectance", [0.3, 0.1, 0.05, RED, BLUE], ids=["white", "white 10", "grey", "red", "blue"])
def test_things_keep_their_contrast(learnt, size, reflectance):
    raw, level = sea(7)
    thing = np.broadcast_to(reflectance, 8)
    corners = [(20, 20), (60, 40), (90, 90), (30, 100)]
    for row, column in corners:
        place(raw, row, column, size, thing)
    found = protect.things(raw, level, learnt)
    kept = protect.put_back(np.minimum(raw, level), level, found)
    strongest = int(np.argmax(thing - WATER))
    for row, column in corners:
        inside = kept[strongest, row : row + size, column : column + size] - WATER[strongest]
        assert 0.8 <= inside.mean() / (thing - WATER)[strongest] <= 1.25


def test_white_single_pixels_are_kept_and_dark_things_left_alone(learnt):
    raw, level = sea(8)
    place(raw, 50, 50, 1, np.full(8, 0.3))
    raw[:, 49:52:2, 50] = raw[:, 50, 49:52:2] = (WATER + 0.05)[:, None]  # its blurred edge
    place(raw, 90, 30, 3, np.full(8, 0.0005))
    found = protect.things(raw, level, learnt)
    assert found.mask[50, 50]
    assert not found.mask[85:98, 25:38].any()
    assert found.score[50, 50] > 10
    assert found.residual[50, 50] < 0.05


def test_sparkle_of_one_band_does_not_come_along(learnt):
    raw, level = sea(9)
    place(raw, 60, 60, 3, np.full(8, 0.1))
    raw[3, 60:63, 63] = 0.4
    kept = protect.put_back(np.minimum(raw, level), level, protect.things(raw, level, learnt))
    assert kept[3, 60:63, 63].max() < 0.02
    assert kept[3, 61, 61] == pytest.approx(0.1, rel=0.1)


@settings(max_examples=8)
@given(st.integers(10, 100), st.integers(10, 100))
def test_tiles_are_the_whole(row, column):
    raw, level = sea(10)
    rule = protect.fit([(raw, level)], BANDS, noise=NOISE, irradiance=np.ones(8))
    for r, c in ((row, column), (row - 3, column + 5), (40, 40)):
        place(raw, r, c, 2, np.full(8, 0.2))
    whole, h = protect.things(raw, level, rule), rule.halo
    for top in (0, row):
        for left in (0, column):
            bottom, right = (row if top == 0 else 128), (column if left == 0 else 128)
            a, b = max(top - h, 0), max(left - h, 0)
            window = (slice(None), slice(a, bottom + h), slice(b, right + h))
            part = protect.things(raw[window], level[window], rule)
            core = (slice(top - a, bottom - a), slice(left - b, right - b))
            for name in ("mask", "edge", "score", "residual"):
                wanted = getattr(whole, name)[top:bottom, left:right]
                assert np.array_equal(getattr(part, name)[core], wanted, equal_nan=wanted.dtype.kind == "f")
            assert np.array_equal(part.excess[(slice(None), *core)], whole.excess[:, top:bottom, left:right])


def test_missing_pixels_are_left_out_and_stay_missing(learnt):
    raw, level = sea(11)
    place(raw, 40, 40, 3, np.full(8, 0.2))
    raw[2, 41, 41] = raw[:, 80, 80] = np.nan
    before = raw.copy()
    found = protect.things(raw, level, learnt)
    kept = protect.put_back(raw, level, found)
    assert np.isnan(found.score[41, 41])
    assert not found.mask[41, 41]
    assert found.mask[40, 40]
    assert np.isnan(kept[:, 80, 80]).all()
    assert np.array_equal(raw, before, equal_nan=True)
    assert not protect.things(np.full((8, 1, 1), np.nan), np.ones((8, 1, 1)), learnt).mask.any()
    assert protect.things(np.ones((8, 1, 1)), np.ones((8, 1, 1)), learnt).mask.shape == (1, 1)


def test_the_light_is_measured_by_the_glint_where_it_is_not_given():
    gain = np.linspace(2000.0, 300.0, 8)
    raw, level = (x * gain[:, None, None] for x in sea(12))
    noise = NOISE * np.column_stack([gain**2, gain])
    rule = protect.fit([(raw, level)], BANDS, noise=noise)
    assert np.ptp(np.array(rule.irradiance) / gain) < 0.2 * np.mean(np.array(rule.irradiance) / gain)
    place(raw, 60, 60, 3, 0.2 * gain)
    assert protect.things(raw, level, rule).mask[61, 61]


def test_parts_of_larger_arrays_need_no_copy_and_things_can_be_put_back_in_place(learnt):
    raw, level = with_things()
    found, low = protect.things(raw, level, learnt), np.minimum(raw, level)
    around = [np.pad(a, ((0, 0), (2, 3), (5, 1)), constant_values=np.nan)[:, 2:-3, 5:-1] for a in (raw, level)]
    turned = [np.ascontiguousarray(a[:, ::-1, ::-1])[:, ::-1, ::-1] for a in (raw, level)]
    assert first_look.block(around[0]).numbers.base is not None
    for look in (around, turned):
        same = protect.things(*look, learnt)
        for name in ("mask", "edge", "score", "residual", "excess"):
            assert np.array_equal(getattr(found, name), getattr(same, name), equal_nan=name in ("score", "residual"))
    wanted = protect.put_back(low, level, found)
    assert not np.array_equal(wanted, low)
    other = np.empty_like(low)
    assert protect.put_back(low, level, found, out=other) is other
    assert protect.put_back(low, level, found, out=low) is low
    assert np.array_equal(other, wanted)
    assert np.array_equal(low, wanted)


def test_a_part_of_what_was_found_is_what_lies_in_it(learnt):
    raw, level = with_things()
    raw[3, 25, 30] = np.nan
    found, inner = protect.things(raw, level, learnt), (slice(21, 120), slice(18, 101))
    part = found.cropped(inner)
    assert part.mask.any()
    for name in ("mask", "edge", "score", "residual", "excess"):
        wanted = getattr(found, name)[(..., *inner)]
        assert np.array_equal(getattr(part, name), wanted, equal_nan=wanted.dtype.kind == "f")


def test_where_there_is_no_test_nothing_is_protected_and_the_reason_is_said():
    raw, level = sea(13)
    at_once = [Band(b.name, wavelength=b.wavelength, time_offset=0.0) for b in BANDS]
    unknown = [Band(b.name, wavelength=b.wavelength) for b in BANDS]
    for bands, words in ((at_once, "1 different instant"), (unknown, "got 0"), (BANDS[:3], "got 3")):
        rule = protect.fit([(raw[: len(bands)], level[: len(bands)])], bands, noise=NOISE[: len(bands)])
        assert not rule.possible
        assert words in rule.reason
        assert rule.halo == 0
        found = protect.things(raw, level, rule)
        assert not found.mask.any()
        assert not found.excess.any()


def test_bands_that_see_the_same_sparkle_are_found_out():
    rule = protect.fit([sea(14, lasting=True)], BANDS, noise=NOISE, irradiance=np.ones(8))
    raw, level = sea(14, lasting=True)
    assert not rule.possible or protect.things(raw, level, rule).mask.mean() < 0.03


def test_bands_may_stand_in_any_order(learnt):
    raw, level = sea(1)
    turned = [4, 2, 7, 0, 1, 6, 3, 5]
    rule = protect.fit([(raw[turned], level[turned])], [BANDS[i] for i in turned], noise=NOISE, irradiance=np.ones(8))
    assert [turned[i] for i in rule.bands] == list(range(8))
    assert rule.threshold == learnt.threshold
    place(raw, 60, 60, 3, RED)
    ours, theirs = protect.things(raw[turned], level[turned], rule), protect.things(raw, level, learnt)
    assert np.array_equal(ours.mask, theirs.mask)
    assert np.array_equal(ours.excess, theirs.excess[turned])


def test_integers_are_rounded(learnt):
    raw, level = sea(1)
    place(raw, 60, 60, 3, np.full(8, 0.2))
    found = protect.things(raw, level, learnt)
    out = protect.put_back(np.zeros(raw.shape, np.int16), np.full(raw.shape, 100.0), found)
    assert out.dtype == np.int16
    assert (out[:, 61, 61] == 100).all()


def test_daylight_is_that_of_the_sun():
    light = protect.daylight([*BANDS, Band("SWIR", wavelength=1600.0)], 40.0)
    assert light[8] == 1
    assert 0.1 < light[:8].min() < light[:8].max() < 0.7
    assert light[1] > light[7]


def test_what_cannot_be_used_is_refused(learnt):
    raw, level = sea(1, size=16)
    with pytest.raises(InputError, match="looks must be"):
        protect.fit([(raw, level[:, :8])], BANDS, noise=NOISE)
    with pytest.raises(InputError, match="noise must be"):
        protect.fit([(raw, level)], BANDS, noise=np.zeros((8, 2)))
    with pytest.raises(InputError, match="8 positive numbers"):
        protect.fit([(raw, level)], BANDS, noise=NOISE, irradiance=np.zeros(8))
    with pytest.raises(FitError, match="no valid pixel"):
        protect.fit([(raw * np.nan, level)], BANDS, noise=NOISE)
    with pytest.raises(FitError, match="no glint"):
        protect.fit([(level, level)], BANDS, noise=NOISE)
    with pytest.raises(InputError, match="alike"):
        protect.things(raw, level[:, :8], learnt)
    with pytest.raises(InputError, match="band 8 is to be judged"):
        protect.things(raw[:5], level[:5], learnt)


def with_things(seed=7):
    raw, level = sea(seed)
    for row, column, size, reflectance in ((20, 20, 2, 0.3), (60, 40, 1, 0.3), (90, 90, 3, RED), (30, 100, 3, 0.02)):
        place(raw, row, column, size, np.broadcast_to(reflectance, 8))
    return raw, level


def bins(z):
    """Of reflectances over UNIT, as the histograms have them."""
    return np.clip(((np.arcsinh(z) - LOW) / ((HIGH - LOW) / BINS)).astype(np.int64), 0, BINS - 1)


def summed(z, steps):
    """Steps of every shape for reflectances (band,) over UNIT."""
    at = bins(z.astype(np.float64))
    rows = steps.step.reshape(-1, BINS, BINS, steps.start.size)
    parts = [rows[b, at[b], at[b + 1]].astype(int) for b in range(len(z) - 1)]
    return steps.start + int(steps.first[at[0]]) + np.sum(parts, axis=0)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_first_look_is_the_largest_sum_of_steps(learnt, dtype):
    raw, level = (np.pad(a.astype(dtype), ((0, 0), (0, 0), (0, 50)), mode="wrap") for a in with_things())
    assert step_kernels.PART < raw.shape[2] < 2 * step_kernels.PART
    raw[3, 5, 5], level[2, 6, 6], level[2, 7, 177] = np.nan, np.inf, np.inf
    steps, missing, least = learnt.steps, np.empty(raw.shape[1:], bool), -10
    look, scale = (first_look.block(raw), first_look.block(level)), np.full(8, 1 / UNIT, dtype)
    found = np.empty(missing.size, np.int64), np.empty((missing.size, 7), np.uint16)
    sensor = np.arange(8), scale, NOISE.astype(dtype), dtype(16.0)
    count = step_kernels.glance(look, sensor, steps, least, missing, found)
    totals, most = np.empty((count, step_kernels.KINDS), np.int16), np.empty(count, np.int32)
    after = step_kernels.weigh(count, steps, least, found, totals, most)
    valid = np.isfinite(raw - level).all(axis=0)
    high = ((raw - level) > 4 * np.sqrt(NOISE[:, :1, None] + NOISE[:, 1:, None] * raw)).sum(axis=0) >= 2
    assert np.array_equal(missing, ~valid)
    z, seen = ((raw - level) * dtype(1 / UNIT)).astype(np.float32), np.full(missing.size, least)
    seen[found[0][:after]] = most[:after]
    for r, c in zip(*np.nonzero(valid & high), strict=True):
        assert seen.reshape(missing.shape)[r, c] == max(summed(z[:, r, c], steps).max(), least)
    assert (seen.reshape(missing.shape)[~valid | ~high] == least).all()
    assert 50 < after < count < 0.5 * (valid & high).sum()


def test_sums_of_squares_are_added_up_and_compared():
    rng = np.random.default_rng(5)
    values = rng.normal(0, 4, (30, 40))
    values[3, 4], values[5, :3] = np.nan, -np.inf
    padded = np.pad(np.where(values > LEAST_SCORE, values, 0.0), 1)
    sums = sum(padded[i : i + 30, j : j + 40] for i in range(3) for j in range(3))
    reached = np.pad(sums >= 20.0, 1)
    near = np.any([reached[i : i + 30, j : j + 40] for i in range(3) for j in range(3)], axis=0)
    assert np.array_equal(clusters(values, 20.0), near & (values > LEAST_SCORE))
    assert 0 < clusters(values, 20.0).sum() < (values > LEAST_SCORE).sum()
    assert clusters(np.full((1, 1), 30.0), 25.0).all()


def test_squares_out_of_reach_of_the_threshold_hide_no_thing(learnt):
    raw, level = with_things()
    everywhere, _, all_places = score(raw, level, learnt)
    some, spectra, places = score(raw, level, learnt, learnt.threshold)
    assert places.size < 0.5 * all_places.size
    assert np.array_equal(everywhere.ravel()[places], some.ravel()[places])
    assert np.array_equal(clusters(some, learnt.threshold), clusters(everywhere, learnt.threshold))
    assert spectra.shape == (8, places.size)


def test_what_is_left_out_at_first_sight_is_no_thing_when_weighed(learnt, monkeypatch):
    raw, level = with_things()
    found = protect.things(raw, level, learnt)
    left_out = np.isneginf(found.score)
    monkeypatch.setattr(first_look, "ROOM", 1e4)
    monkeypatch.setattr(first_look, "ROOM_OF_SHAPE", 1e4)
    monkeypatch.setattr(evidence, "STANDS_OUT", 0.0)
    whole, _, places = score(raw, level, learnt)
    assert places.size > 10 * (~left_out).sum()
    assert np.array_equal(clusters(whole, learnt.threshold), found.mask)
    assert found.score[found.mask] == pytest.approx(whole[found.mask], rel=1e-6)


def test_s_of_what_the_shapes_draw_leaves_the_room_it_is_given(learnt, monkeypatch):
    """Things drawn from the model itself: S by the full likelihood of all shapes against the sum of steps."""
    rng, s, n = np.random.default_rng(6), learnt.shapes, 3000
    k = rng.choice(len(s.weight), n, p=s.weight)
    a = np.exp(rng.uniform(np.log(0.02), np.log(0.8), n))[:, None]
    bent = 1 + rng.standard_normal((n, 2)) * np.column_stack([s.slope, s.bend])[k] @ bends(learnt.wavelength)
    rough = s.rough[k, None] * rng.standard_normal((n, 8))
    y = a * (s.values[k] * (bent + rough) + shape_kernels.FLOOR * rng.standard_normal((n, 8)))
    y += (TEXTURE * rng.standard_normal((n, 8)) - WATER_HIDDEN[0]) * WATER
    y[np.arange(n)[s.odd[k] >= 0], s.odd[k][s.odd[k] >= 0]] = 0.2
    level = np.broadcast_to(WATER[:, None, None], (8, 1, n)).copy()
    raw = level + y.T[:, None]
    by_steps = np.array([summed((row / UNIT).astype(np.float32), learnt.steps).max() for row in y])
    monkeypatch.setattr(first_look, "ROOM", 1e4)
    monkeypatch.setattr(first_look, "ROOM_OF_SHAPE", 1e4)
    whole = score(raw, level, learnt)[0].ravel()
    counts = whole > LEAST_SCORE
    assert counts.mean() > 0.5
    more = whole - by_steps / first_look.QUARTERS
    assert (more[counts] < first_look.ROOM).mean() > 0.99
    assert np.median(np.abs(more[counts])) < 3


def test_what_one_outline_does_not_explain_is_what_singular_values_say():
    rng = np.random.default_rng(9)
    for count in (1, 2, 5, 9):
        for roughness in (0.0, 0.05, 0.3):
            own = np.outer(rng.random(count) + 0.1, RED) * (1 + roughness * rng.standard_normal((count, 8)))
            power = np.linalg.svd(own, compute_uv=False) ** 2
            rest, whole = kernels.unexplained(own, np.arange(count))
            assert (rest / whole, whole) == pytest.approx((1 - power[0] / power.sum(), power.sum()), abs=1e-6)
    assert kernels.unexplained(np.zeros((3, 8)), np.arange(3)) == (0.0, 0.0)


def test_squares_need_more_where_their_outline_changes():
    """Against loops with numpy's singular values."""
    rng = np.random.default_rng(11)
    high = np.where(rng.random((30, 31)) < 0.3, rng.uniform(1, 20, (30, 31)), -np.inf)
    own, place = rng.random((high.size, 1)) * RED, np.arange(high.size).reshape(high.shape)
    own[high.size // 2 :] *= 1 + 0.2 * rng.standard_normal((high.size - high.size // 2, 8))
    found, wanted = np.zeros(high.shape, bool), np.zeros(high.shape, bool)
    places = np.flatnonzero(high > LEAST_SCORE)
    kernels.rigid(high.ravel()[places], places, own[places], 25.0, 0.0125, found)
    for r, c in np.ndindex(high.shape):
        square = slice(max(r - 1, 0), r + 2), slice(max(c - 1, 0), c + 2)
        part = high[square] > LEAST_SCORE
        if part.any():
            power = np.linalg.svd(own[place[square][part]], compute_uv=False) ** 2
            need = 25.0 * max(1.0, (1 - power[0] / power.sum()) / 0.0125)
            wanted[square] |= part & (high[square][part].sum() >= need)
    np.testing.assert_array_equal(found, wanted)
    assert found.any()
    assert (clusters(high, 25.0) & ~found).any()


def test_squares_that_hold_more_than_one_outline_are_left_out():
    """Against loops with numpy's singular values."""
    rng = np.random.default_rng(12)
    level, white = rng.random((8, 20, 21)), rng.uniform(0.5, 2.0, 8)
    excess = rng.random((1, 20, 21)) ** 4 * RED[:, None, None] * (1 + 0.3 * rng.standard_normal((8, 20, 21)))
    raw = level + white[:, None, None] * excess
    raw[3, 5, 6] = np.nan
    least = raw[0].size
    for besides in (0.2, 0.02, 0.0):
        found, wanted = np.ones((20, 21), bool), np.zeros((20, 21), bool)
        found[3] = False
        kernels.quiet(first_look.block(raw), first_look.block(level), np.arange(8), white, 0.016, besides, found)
        for r, c in np.ndindex(found.shape):
            around = excess[:, max(r - 2, 0) : r + 3, max(c - 2, 0) : c + 3].reshape(8, -1)
            known = ~((np.arange(max(r - 2, 0), min(r + 3, 20))[:, None] == 5)
                      & (np.arange(max(c - 2, 0), min(c + 3, 21)) == 6)).ravel()  # fmt: skip
            power = np.linalg.svd(around[:, known], compute_uv=False) ** 2
            wanted[r, c] = power[1:].sum() <= 0.016 * power.sum() + besides
        wanted[3] = False
        np.testing.assert_array_equal(found, wanted)
        assert 0 < found.sum() < least
        least = found.sum()


def test_a_flash_that_lasts_and_spreads_is_no_thing(learnt):
    raw, level = sea(4)
    raw[:, 20:23, 20:23] = level[:, 20:23, 20:23]
    for b in range(8):  # red light that begins at another instant in each pixel
        for place_of, start in (((20, 20), 3), ((20, 21), 4), ((21, 20), 5)):
            raw[(b, *place_of)] += 0.4 if b > start else 0.028
    place(raw, 80, 80, 2, RED)
    found = protect.things(raw, level, learnt)
    assert found.mask[80:82, 80:82].all()
    assert not found.mask[18:25, 18:25].any()
    assert clusters(found.score, learnt.threshold)[20:22, 20:22].any()  # without the outline it would be


def test_a_flash_that_moves_is_no_thing_however_bright(learnt):
    """Each pixel as white paint would be, but for what drifts from pixel to pixel."""
    raw, level = sea(4)
    drift = np.linspace(-1, 1, 8)[:, None, None] * np.linspace(-1, 1, 3)[None, :, None]
    raw[:, 40:43, 40:43] += 0.6 * (1 + 0.4 * drift)
    place(raw, 80, 80, 3, np.full(8, 0.6))
    kept = protect.things(raw, level, learnt).mask
    assert kept[80:83, 80:83].all()
    assert not kept[36:47, 36:47].any()
    assert protect.things(raw, level, replace(learnt, around=np.inf)).mask[40:43, 40:43].any()


def test_strips_are_the_whole(learnt, monkeypatch):
    """What is glanced at together makes no difference, to the bit."""
    raw, level = sea(5, size=90)
    place(raw, 40, 40, 2, np.full(8, 0.3))
    whole = protect.things(raw, level, learnt)
    assert whole.mask.any()
    for rows in (1, 7, 41):
        monkeypatch.setattr(evidence, "STRIP", rows)
        monkeypatch.setattr(evidence, "AT_ONCE", 13 * rows)
        part = protect.things(raw, level, learnt)
        for name in ("mask", "edge", "missing", "places", "kept"):
            np.testing.assert_array_equal(getattr(part, name), getattr(whole, name))
        for one, other in zip(part.weighed, whole.weighed, strict=True):
            np.testing.assert_array_equal(one, other)
