"""Measured numbers with their intervals, and the machine, the versions and the command that they come from."""

import math
import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from statistics import mean, median, stdev
from typing import Any, Literal

import numpy as np

from ..arrays import Array

PACKAGES = ("deglint", "numpy", "scipy", "numba", "rasterio", "opencv-contrib-python-headless", "scikit-learn",
            "spectral")  # fmt: skip
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
    """Error [% of the water level]: RMSE / median(truth) of each visible band, then root mean square over the bands.

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
    """Mean over seeds, and its 95 % interval (Student's t) within 0 to `most`; `better`: "lower" or "higher" values."""
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
    """Numbers, `provenance` (`made`) and failures (`refused`) of a run as plain values for JSON, with None for NaN."""
    from deglint.raster.output import plain

    values = {name: asdict(number) for name, number in numbers.items()}
    out: dict[str, Any] = plain({"made": made, "numbers": values, "refused": refused})
    return out


def provenance(command: str, *, quick: bool, seeds: int, seconds: float, load: float | None) -> dict[str, Any]:
    """Versions, machine and options of a run; `seconds` is its duration [s], `load` the load average at its start."""
    now = machine()
    busy = f"load {load:g} on {now['cores']} cores" if load is not None and load > 0.5 * now["cores"] else ""
    return {
        "command": command, "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), "quick": quick, "seeds": seeds,
        "seconds": round(seconds, 1), "machine": now, "busy": busy, "versions": versions(),
    }  # fmt: skip


def machine() -> dict[str, Any]:
    """Name of the processor, number of cores that this process may use, and operating system."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    system = f"{platform.system()} {platform.release()}"
    return {"processor": names[0] if names else platform.processor(), "cores": cores, "system": system}


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that are installed."""
    out = {"deglint": "", "python": platform.python_version()}
    for name in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            out[name] = metadata.version(name)
    return out


def load_now() -> float | None:
    """Load average of the last minute; None if the system does not have one."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
