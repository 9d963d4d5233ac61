"""Measured numbers with their intervals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import mean, median, stdev
from typing import Any, Literal

import numpy as np

from ..arrays import Array

VISIBLE_BANDS = 5  # COASTAL to RED: the bands whose error counts

Better = Literal["lower", "higher"]


@dataclass(frozen=True)
class Number:
    """A measured number: mean over seeds with its 95 % interval, or median of repeated timings with their range."""

    value: float
    low: float = math.nan  # lower end of the interval or range; NaN for a single value
    high: float = math.nan
    unit: str = ""  # "%", "s", "ns", or "" for a ratio
    better: Better = "lower"
    exact: bool = True  # the same on every machine for the same seeds and versions; False for times

    def __str__(self) -> str:
        spread = "" if math.isnan(self.low) else f" ({short(self.low)}-{short(self.high)})"
        return short(self.value) + spread


def rms_error(image: Array, truth: Array, columns: slice = slice(None)) -> float:
    """Root mean square over the visible bands of RMSE / median(truth), in percent of the water level.

    `image` and `truth`, (band, row, column), have the same unit; the first `VISIBLE_BANDS` bands count. The error is
    computed in `columns`, the water level, median(truth), from all columns.

    Examples
    --------
    >>> level = np.full((5, 4, 4), 2.0)
    >>> rms_error(1.1 * level, level).__round__(6)
    10.0
    """
    truth = np.asarray(truth, np.float64)[:VISIBLE_BANDS]
    away = (np.asarray(image, np.float64)[:VISIBLE_BANDS] - truth)[:, :, columns]
    level = np.median(truth, axis=(1, 2))
    each = np.sqrt((away**2).mean(axis=(1, 2))) / level
    return float(100 * np.sqrt((each**2).mean()))


def short(value: float) -> str:
    """Text of a value with three digits; large values are rounded to integers, without a power of ten."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def over_seeds(values: Sequence[float], unit: str = "", better: Better = "lower", most: float = math.inf) -> Number:
    """Mean over seeds and its 95 % interval (Student's t), limited to the possible values, 0 to `most`."""
    from scipy.stats import t

    centre = mean(values)
    if len(values) < 2 or math.isnan(centre):
        return Number(centre, unit=unit, better=better)
    half = float(t.ppf(0.975, len(values) - 1)) * stdev(values) / math.sqrt(len(values))
    return Number(centre, max(centre - half, 0.0), min(centre + half, most), unit, better)


def timed(values: Sequence[float], unit: str = "s") -> Number:
    """Median and range of repeated timings."""
    return Number(median(values), min(values), max(values), unit, exact=False)


def as_json(numbers: Mapping[str, Number], made: Mapping[str, Any], refused: Mapping[str, str]) -> dict[str, Any]:
    """The numbers of a run and its `provenance` (`made`) as plain values for JSON, with None for NaN."""
    from deglint.raster.output import plain

    values = {name: asdict(number) for name, number in numbers.items()}
    out: dict[str, Any] = plain({"made": made, "numbers": values, "refused": refused})
    return out
