"""Sums of steps for any number of bands, their bounds by groups of shapes, and bins, against brute force."""

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


@given(st.lists(st.floats(allow_nan=False, width=32), min_size=1, max_size=20))
def test_a_cell_holds_at_most_one_edge_so_that_one_comparison_finds_the_bin(numbers):
    edges = np.sinh(LOW + np.arange(1, BINS) * (HIGH - LOW) / BINS).astype(np.float32)
    numbers = np.concatenate([np.float32(numbers), edges, np.nextafter(edges, np.float32(-np.inf))])
    found = glance.cells(edges)[numbers.view(np.int32) >> 20 & 4095].astype(int)
    found += numbers >= np.append(edges, np.nan)[found]
    assert np.array_equal(found, np.searchsorted(edges, numbers, side="right"))


@pytest.mark.parametrize("count", [4, 8, 9, 16])
def test_sums_of_steps_are_added_up_for_any_number_of_bands(count):
    steps, place = rule(count).steps, np.random.default_rng(count).integers(0, BINS, (count, 50)).astype(np.uint8)
    rows = steps.step[: -len(steps.start)].reshape(count - 1, BINS, BINS, -1).astype(int)
    wanted = steps.start + steps.first[place[0]][:, None].astype(int)
    wanted += sum(rows[b, place[b], place[b + 1]] for b in range(count - 1))
    totals, kept = np.empty(wanted.shape, np.int16), np.empty(50, np.int64)
    kernels.weigh(place, np.arange(50), 50, steps, 7, totals)
    assert np.array_equal(totals, wanted + 7)
    most, found = wanted.max(axis=1), np.empty(50, np.int64)
    for least in (int(np.median(most)), int(most.max()), int(most.max()) - 1, -20000):
        may_be = kept[: kernels.may_be(place, 50, steps, least, kept)]
        assert set(np.flatnonzero(most > least)) <= set(may_be)
        kernels.weigh(place, kept, may_be.size, steps, -least - 1, totals)
        kernels.highest(totals, may_be.size, found)
        assert np.array_equal(found[: may_be.size], np.maximum(most[may_be] - least - 1, -1))
    assert may_be.size == 50


def test_groups_hold_every_shape_once():
    learnt = rule(8)
    step, start = learnt.steps.step[: -len(learnt.steps.start)], learnt.steps.start
    kinds = len(learnt.shapes.weight)
    step = step.reshape(-1, len(start))[:, :kinds]
    chance = np.full(len(step), 1 / len(step))
    groups = glance.grouped(step, start[:kinds], chance, 8)
    assert sorted(k for g in groups for k in g) == list(range(kinds))
    assert len(groups) == 8
    few = glance.grouped(step[:, :3], start[:3], chance, 8)
    assert len(few) == 8
    assert {k for g in few for k in g} == {0, 1, 2}
