"""Measured numbers with their intervals, and the machine, versions of packages and command that produced them."""

import math
import os
import platform
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from statistics import mean, median, stdev
from typing import Any, Literal

import numpy as np

from deglint import __version__
from deglint.tiles import default_threads

from ..arrays import Array

PACKAGES = ("numpy", "scipy", "numba", "rasterio", "opencv-contrib-python-headless", "scikit-learn", "spectral")
VISIBLE_BANDS = 5  # COASTAL to RED: the bands whose error counts

Better = Literal["lower", "higher"]


@dataclass(frozen=True)
class Number:
    """A measured number: mean over simulated scenes with its 95 % interval, or median of timings with their range."""

    value: float
    low: float = math.nan  # lower end of the interval or range; NaN for a single value
    high: float = math.nan
    unit: str = ""  # "%", "s", "ns", or "" for a ratio
    better: Better = "lower"  # whether lower or higher values are better
    exact: bool = True  # the same on every machine for the same seeds and versions; False for times

    def __str__(self) -> str:
        return short(self.value) + ("" if math.isnan(self.low) else f" ({short(self.low)}-{short(self.high)})")


def rms_error(image: Array, truth: Array, columns: slice = slice(None)) -> float:
    """Error of an image [%]: RMSE of each visible band relative to its water level, then root mean square over bands.

    `image` and `truth`, (band, row, column), have the same unit; the first `VISIBLE_BANDS` bands are used. The RMSE is
    computed in the range `columns`. The water level of a band is the median of its truth in all columns.

    Examples
    --------
    >>> level = np.full((5, 4, 4), 2.0)
    >>> rms_error(1.1 * level, level).__round__(6)
    10.0
    """
    truth = np.asarray(truth, np.float64)[:VISIBLE_BANDS]
    away = (np.asarray(image, np.float64)[:VISIBLE_BANDS] - truth)[:, :, columns]
    each = np.sqrt((away**2).mean(axis=(1, 2))) / np.median(truth, axis=(1, 2))
    return float(100 * np.sqrt((each**2).mean()))


def short(value: float) -> str:
    """Text of a value with three significant digits; a value of 100 or more is rounded to an integer."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def over_seeds(values: Sequence[float], unit: str = "", better: Better = "lower", most: float = math.inf) -> Number:
    """Mean of `values`, one per seed, with 95 % interval (Student's t) in 0..`most`; `better` is as in `Number`."""
    from scipy.stats import t

    centre = mean(values)
    if len(values) < 2 or math.isnan(centre):
        return Number(centre, unit=unit, better=better)
    half = float(t.ppf(0.975, len(values) - 1)) * stdev(values) / math.sqrt(len(values))
    return Number(centre, max(centre - half, 0.0), min(centre + half, most), unit, better)


def timed(values: Sequence[float]) -> Number:
    """Median and range of repeated timings [s]."""
    return Number(median(values), min(values), max(values), "s", exact=False)


def provenance(command: str, *, quick: bool, seeds: int, seconds: float, load: float | None) -> dict[str, object]:
    """Versions, machine and options of a run, which took `seconds` [s]; `load` is the load average at its start."""
    now = machine()
    busy = f"load {load:g} on {now['cores']} cores" if load is not None and load > 0.5 * now["cores"] else ""
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    made = {"command": command, "date": date, "quick": quick, "seeds": seeds, "seconds": round(seconds, 1)}
    return made | {"machine": now, "busy": busy, "versions": versions()}


def machine() -> dict[str, Any]:
    """The machine: name of the processor, number of cores that this process may use, and operating system."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    system = f"{platform.system()} {platform.release()}"
    return {"processor": names[0] if names else platform.processor(), "cores": default_threads(), "system": system}


def versions() -> dict[str, str]:
    """Versions of Python and of those `PACKAGES` that are installed, by name."""
    out = {"deglint": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            out[name] = metadata.version(name)
    return out


def load_now() -> float | None:
    """Load average of the system in the last minute; None if the system does not provide it."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
