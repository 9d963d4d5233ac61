"""Sums of steps for any number of bands, their bounds by groups of shapes, and bins, against brute force."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deglint.compensate import _glance_kernels as kernels
from deglint.compensate import glance, protect
from deglint.compensate.evidence import BINS, HIGH, LOW
from deglint.scene import Band


def rule(count):
    """What a sea of sparkle that each of some bands draws anew teaches."""
    rng = np.random.default_rng(count)
    centres = np.linspace(420, 950, count)
    bands = [Band(str(i), wavelength=w, width=30.0, time_offset=0.06 * i) for i, w in enumerate(centres)]
    y = rng.gamma(0.4, 0.1, (count, 40, 40)) * (rng.random((count, 40, 40)) < 0.3)
    return protect.fit([(0.01 + y, np.full(y.shape, 0.01))], bands, noise=np.full((count, 2), 1e-7))


@cache
def bare():
    """Steps of which only the edges are looked at."""
    return rule(4).steps


@given(st.lists(st.floats(allow_nan=False, width=32), min_size=1, max_size=200))
def test_one_comparison_after_a_guess_finds_the_bin(numbers):
    """Of two bands, where the next holds the same numbers in the other order."""
    edges, steps = np.sinh(LOW + np.arange(1, BINS) * (HIGH - LOW) / BINS).astype(np.float32), bare()
    below = np.nextafter(edges, np.float32(-np.inf))
    everywhere = np.sinh(np.linspace(-5, 11, 20_000))
    for part in np.array_split(np.concatenate([numbers, edges, below, everywhere]).astype(np.float32), 180):
        z, pairs = np.zeros((2, kernels.PART), np.float32), np.empty((1, kernels.PART), np.uint16)
        z[0, : part.size], z[1, : part.size] = part, part[::-1]
        kernels.pair_up(z, steps, pairs)
        before, now = np.searchsorted(edges, z, side="right")
        assert np.array_equal(pairs[0], before * BINS + now)


@pytest.mark.parametrize("count", [4, 8, 9, 16])
def test_sums_of_steps_are_added_up_for_any_number_of_bands(count):
    steps, place = rule(count).steps, np.random.default_rng(count).integers(0, BINS, (count, 50))
    table = steps.step.reshape(count - 1, BINS, BINS, -1).astype(int)
    wanted = steps.start + steps.first[place[0]][:, None].astype(int)
    wanted += sum(table[b, place[b], place[b + 1]] for b in range(count - 1))
    pairs = np.empty((count - 1, kernels.PART), np.uint16)
    pairs[:, :50] = np.arange(count - 1)[:, None] * BINS**2 + place[:-1] * BINS + place[1:]
    most, listed = wanted.max(axis=1), np.arange(50)[::2]
    for least in (int(np.median(most)), int(most.max()), int(most.max()) - 1, -20000):
        found = np.empty(60, np.int64), np.empty((60, count - 1), np.uint16)
        some = kernels.may_be(pairs, listed, steps, least, 1000, found, 0)
        assert set(listed[most[::2] > least]) <= set(found[0][:some] - 1000)
        totals, best, above = np.empty((some, wanted.shape[1]), np.int16), np.empty(some, np.int32), most[::2] > least
        some = kernels.weigh(some, steps, least, found, totals, best)
        assert np.array_equal(found[0][:some] - 1000, listed[above])
        assert np.array_equal(found[1][:some].T, pairs[:, listed[above]])
        assert np.array_equal(totals[:some], wanted[listed[above]])
        assert np.array_equal(best[:some], most[listed[above]])
    assert some == listed.size


def test_groups_hold_every_shape_once():
    learnt = rule(8)
    step, start = learnt.steps.step, learnt.steps.start
    kinds = len(learnt.shapes.weight)
    step = step.reshape(-1, len(start))[:, :kinds]
    chance = np.full(len(step), 1 / len(step))
    groups = glance.grouped(step, start[:kinds], chance, 8)
    assert sorted(k for g in groups for k in g) == list(range(kinds))
    assert len(groups) == 8
    few = glance.grouped(step[:, :3], start[:3], chance, 8)
    assert len(few) == 8
    assert {k for g in few for k in g} == {0, 1, 2}
