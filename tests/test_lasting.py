"""Sparkle that lasts: how much of it is told by what ends before, and nothing is protected where it is too much."""

import numpy as np
import pytest

from deglint import fit_scene, open_scene
from deglint.compensate import evidence, protect
from deglint.compensate.lasting import MOST_LASTING, lasting, steady
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate

from .test_protect import BANDS, NOISE, WATER


def flashes(lifetime, size=256, seed=3):
    """Sparkle that lights each pixel for a while, exponentially distributed [instants], as bright as it is."""
    rng = np.random.default_rng(seed)
    begin, lasts = rng.uniform(-60, 8, (size, size)), rng.exponential(lifetime, (size, size))
    instants = np.arange(8)[:, None, None]
    lit = (instants >= begin) & (instants < begin + lasts)
    level = np.broadcast_to(WATER[:, None, None], lit.shape).copy()
    return level + 0.3 * lit, level


@pytest.mark.parametrize("lifetime", [3.0, 4.0])
def test_share_of_sparkle_that_lasts_is_that_of_its_lifetimes(lifetime):
    raw, level = flashes(lifetime, 1024)
    told = evidence.Protection(
        bands=tuple(range(8)), irradiance=(1.0,) * 8, noise=tuple((a, b) for a, b in NOISE.tolist())
    )
    runs = steady(told, (raw, level), np.ones(raw.shape[1:], bool))
    lit = raw - level > 0.2
    first, last = lit[0], lit[-1]
    assert runs.sum() == first.sum() + last.sum()
    assert runs[8] == 2 * lit.all(axis=0).sum()
    assert runs[3] == (lit[:3].all(axis=0) & ~lit[3]).sum() + (lit[5:].all(axis=0) & ~lit[4]).sum()
    found = lasting([runs])
    assert found == pytest.approx(np.exp(-7 / lifetime), rel=0.25)  # memoryless; 3 standard deviations of the counts
    things = np.zeros(9, np.int64)
    things[8] = 2 * 400
    assert lasting([runs, things]) < found  # what is there at every instant is no sign that sparkle lasts


def test_things_that_are_steady_for_a_while_do_not_pass_for_sparkle_that_lasts():
    """Of those that move, or have flashes beside them, as many are steady for seven instants as for six."""
    short = 40_000 * 0.12 ** np.arange(-1, 8)
    short[[0, 8]] = 0, 2
    things = np.array([0, 0, 300, 250, 200, 150, 120, 140, 800])
    assert lasting([short.astype(np.int64), things]) < 0.4 * MOST_LASTING
    few = np.array([0, 8660, 906, 137, 21, 9, 2, 4, 0])  # of fine waves, straight down; no thing among them
    assert lasting([few]) < 0.1 * MOST_LASTING


def test_sparkle_that_lasts_is_found_out_and_nothing_is_protected():
    told = protect.fit([flashes(4.0)], BANDS, noise=NOISE, irradiance=np.ones(8))
    assert not told.possible
    assert "sparkle lasts: 1" in told.reason
    assert "sparkle lasts" not in protect.fit([flashes(0.5)], BANDS, noise=NOISE, irradiance=np.ones(8)).reason


@pytest.mark.parametrize(("delay", "patch", "lasts"), [(0.02, 0.005, True), (0.06, 0.005, False), (0.02, 0.06, False)])
def test_short_delays_over_fine_waves_are_no_test(tmp_path, delay, patch, lasts):
    """At 9 m/s, straight down: clumps of sparkle had passed for things."""
    setup = Setup(sensor=preset("thesis").delayed(delay), size=(320, 320), wind=9.0, sky="cardioidal", patch=patch)
    write_scene(simulate(setup), tmp_path / "sea")
    told = fit_scene(open_scene(tmp_path / "sea.tif")).chain.protection
    assert told.reason.startswith("sparkle lasts") is lasts
    assert told.possible is not lasts
