"""Steps that numbers come in, where nobody says so: counts that were made physical values and stored as fractions.

The spread of a band's noise decides what is glint. Where noise is a count or two, a median of distances jumps by whole
steps, and may be nothing at all; `deglint.compensate.spread.lower_spread` makes up for that where the step is
known."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

MOST = 1 << 16
"""Most values that are looked at."""
REPEATED = 4
"""Times that each number must be there on average: where it is not, steps are too fine to matter."""
NEAR = 50
"""Gaps of up to so many steps tell."""
APART = 0.05
"""Of a step, by which a gap may differ from a whole number of them."""


def step_of(values: npt.NDArray[np.floating[Any]]) -> float:
    """The step that numbers come in.

    Parameters
    ----------
    values : ndarray
        Some of a band's values; those that are not finite are left out.

    Returns
    -------
    float
        In their unit; 0 where they come in none, or in steps so fine that hardly any number is there twice.

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(100.0, 3.0, 10_000)
    >>> round(step_of((0.02 * np.rint(noise) + 0.5).astype(np.float32)), 6), step_of(noise)
    (0.02, 0.0)
    """
    known = values[np.isfinite(values)]
    known = known[:: max(known.size // MOST, 1)]
    distinct = np.unique(known).astype(np.float64)
    if distinct.size < 2 or known.size < REPEATED * distinct.size:
        return 0.0
    rounding = 4 * np.finfo(known.dtype).eps * float(np.abs(distinct).max())
    gaps = np.diff(distinct)
    gaps = gaps[gaps > rounding]
    if not gaps.size:
        return 0.0
    gaps = gaps[gaps < NEAR * gaps.min()]
    count = np.rint(gaps / gaps.min())
    step = float(gaps.sum() / count.sum())
    return step if (np.abs(gaps - count * step) <= APART * step + rounding).all() else 0.0
