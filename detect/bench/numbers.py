"""Measured numbers with their intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean, median, stdev
from typing import Literal

Better = Literal["lower", "higher"]


@dataclass(frozen=True)
class Number:
    """A measured number.

    Attributes
    ----------
    value : float
    low, high : float
        95 % interval of the mean over seeds, or the range of repeated timings; NaN for a single value.
    unit : str
        "%", "s", "ns", or "" for a ratio.
    better : {"lower", "higher"}
    exact : bool
        The same on every machine for the same seeds and versions; False for times.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    unit: str = ""
    better: Better = "lower"
    exact: bool = True

    def __str__(self) -> str:
        spread = "" if math.isnan(self.low) else f" ({short(self.low)}-{short(self.high)})"
        return short(self.value) + spread


def short(value: float) -> str:
    """A value with three digits, and no power of ten where it is large."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def over_seeds(values: Sequence[float], unit: str = "", better: Better = "lower", most: float = math.inf) -> Number:
    """Mean over seeds and its 95 % interval (Student's t), cut at 0 and at `most`, where the values cannot be."""
    from scipy.stats import t

    centre = mean(values)
    if len(values) < 2 or math.isnan(centre):
        return Number(centre, unit=unit, better=better)
    half = float(t.ppf(0.975, len(values) - 1)) * stdev(values) / math.sqrt(len(values))
    return Number(centre, max(centre - half, 0.0), min(centre + half, most), unit, better)


def timed(values: Sequence[float], unit: str = "s") -> Number:
    """Median of repeated timings and their range."""
    return Number(median(values), min(values), max(values), unit, exact=False)
