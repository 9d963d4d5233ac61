"""Small bright targets, at rest and moving, keep their contrast through `deglint remove`, from file to file."""

import numpy as np
import pytest

from benchmarks.implants import COLOURS, SIZES, contrast, implant, simulated, survive
from benchmarks.targets import deglinted


@pytest.fixture(scope="module", params=[pytest.param(5.0, marks=pytest.mark.slow), 9.0])
def simulated_sea(request, tmp_path_factory):
    return simulated(tmp_path_factory.mktemp("sea"), request.param, 0.06, 103)


@pytest.mark.slow
def test_small_targets_at_rest_keep_their_contrast(simulated_sea, tmp_path):
    kinds, left = [(colour, size) for colour in COLOURS for size in SIZES], []
    for seed in (0, 1):
        there, targets = implant(simulated_sea, kinds, seed)
        shares = contrast(deglinted(there, tmp_path), simulated_sea.truth, there.truth, targets)
        left += [(t.colour, t.size > 1, share) for t, share in zip(targets, shares, strict=True)]

    def share(*colours, single=False):
        return survive(np.array([x for colour, larger, x in left if colour in colours and larger != single]))

    white = "white 70 %", "white 30 %", "white 10 %"
    assert share(*white) >= 0.95
    assert share("grey 5 %") >= 0.85
    assert share(*white, single=True) >= 2 / 3
    assert min(share("red"), share("blue")) >= 0.5


@pytest.mark.slow
def test_many_white_targets_are_no_flashes(simulated_sea, tmp_path):
    """They have the spectrum of a flash that does not change."""
    there, targets = implant(simulated_sea, [("white 30 %", size) for size in (2, 3, 5)], 0)
    shares = contrast(deglinted(there, tmp_path), simulated_sea.truth, there.truth, targets)
    assert survive(shares) >= 0.95


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.25, 0.5, 1.0])
def test_boats_that_move_keep_their_contrast(simulated_sea, tmp_path, speed):
    """They had passed for sparkle that lasts, and all were lost."""
    there, targets = implant(simulated_sea, [("white 30 %", 5)], 1, speed, 48)
    shares = contrast(deglinted(there, tmp_path), simulated_sea.truth, there.truth, targets)
    assert len(targets) > 24
    assert np.median(shares) > 0.8
