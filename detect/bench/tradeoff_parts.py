"""Where the time of a fit goes, one thing at a time: size of the sample, type of the numbers, and medians."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint import remove
from deglint.moments import thinned

from .measure import VISIBLE, rms_error
from .section import Number, Section, Table, over_seeds, timed
from .simulated import Seen
from .tradeoff_measure import spent

METHODS = ("hedley", "lyzenga", "joyce", "multiband")
SIZES = (256, 1024, 4096, 16384)
NIR = 6
ROUNDS = 3


@dataclass
class Parts:
    """What was measured so far, scene by scene.

    Attributes
    ----------
    errors, seconds : dict of list of float
        RMS error [%] and processor time [ns per pixel and band], by (method, type, pixels of the sample).
    off : dict of list of float
        How far an approximate median is from the exact one [% of the water level], by name.
    median_seconds : dict of list of float
        [ns per value]
    rounding : dict of list of float
        RMS difference of the results of the two types [% of the water level], by method.
    """

    errors: dict[tuple[str, str, int], list[float]] = field(default_factory=dict)
    seconds: dict[tuple[str, str, int], list[float]] = field(default_factory=dict)
    off: dict[str, list[float]] = field(default_factory=dict)
    median_seconds: dict[str, list[float]] = field(default_factory=dict)
    rounding: dict[str, list[float]] = field(default_factory=dict)

    def add(self, seen: Seen) -> None:
        """Measure one scene, of bands at one instant."""
        self._samples(seen)
        self._medians(seen)

    def _samples(self, seen: Seen) -> None:
        deep = seen.sample
        whole = int(deep.sum())
        bands = seen.scene.bands
        for method in METHODS:
            clean = {}
            for kind in ("float32", "float64"):
                image = seen.raw.astype(kind)
                for size in (*(n for n in SIZES if n < whole), whole):
                    sample = thinned(deep, (0, 0), max(1, round(whole / size)))
                    fit, model = spent(partial(remove.fit, method, image, nir=NIR, sample=sample, bands=bands))
                    self.errors.setdefault((method, kind, size), []).append(
                        rms_error(remove.apply(image, model), seen.truth)
                    )
                    self.seconds.setdefault((method, kind, size), []).append(1e9 * fit / image.size)
                clean[kind] = remove.apply(image, model)
            both = [clean[k].astype(np.float64) for k in ("float32", "float64")]
            self.rounding.setdefault(method, []).append(difference(both[0], both[1], seen.truth))

    def _medians(self, seen: Seen) -> None:
        for band in range(VISIBLE):
            values = np.ascontiguousarray(seen.raw[band].astype(np.float32)).ravel()
            level = float(np.median(seen.truth[band]))
            exact = float(np.median(values))
            for name, work in MEDIANS.items():
                seconds, found = [], exact
                for _ in range(ROUNDS):
                    took, found = spent(partial(work, values))
                    seconds.append(took)
                self.off.setdefault(name, []).append(100 * abs(found - exact) / level)
                self.median_seconds.setdefault(name, []).append(1e9 * min(seconds) / values.size)


def difference(a: npt.NDArray[Any], b: npt.NDArray[Any], truth: npt.NDArray[Any]) -> float:
    """RMS difference of two images in the visible bands, in percent of the water level."""
    return rms_error(truth + (a - b), truth)


def by_histogram(values: npt.NDArray[np.floating[Any]], bins: int = 4096) -> float:
    """Median from counts between the extremes, interpolated within its bin."""
    low, high = float(values.min()), float(values.max())
    counts = np.histogram(values, bins, (low, high))[0] if high > low else np.array([values.size])
    total = np.cumsum(counts)
    at = int(np.searchsorted(total, total[-1] / 2))
    inside = (total[-1] / 2 - (total[at] - counts[at])) / max(counts[at], 1)
    return low + (high - low) * (at + float(inside)) / len(counts)


def one_in(share: int) -> Callable[[npt.NDArray[np.floating[Any]]], float]:
    """Median of one value in so many."""
    return lambda values: float(np.median(values[::share]))


MEDIANS: dict[str, Callable[[npt.NDArray[np.floating[Any]]], float]] = {
    "exact (partition)": lambda values: float(np.median(values)),
    "exact (sort)": lambda values: float(np.sort(values)[[(values.size - 1) // 2, values.size // 2]].mean()),
    "histogram of 4096 bins": by_histogram,
    "one value in 16": one_in(16),
    "one value in 256": one_in(256),
}
"""Ways to a median; the first is what deglint takes, of at most so many values as a look holds."""


def samples(parts: Parts) -> Section:
    """The chapter on samples and types."""
    sizes = sorted({size for _m, _k, size in parts.errors})
    whole = sizes[-1]
    out: dict[str, Number] = {}
    rows = []
    for method in METHODS:
        for kind in ("float32", "float64"):
            cells: list[Any] = [method, kind]
            for size in sizes:
                name = f"tradeoff/{method}/{kind}/sample{size}"
                out[f"{name}/rms"] = over_seeds(parts.errors[method, kind, size], "%")
                out[f"{name}/fit"] = timed(parts.seconds[method, kind, size], "ns")
                cells.append(out[f"{name}/rms"].value)
            rows.append((*cells, out[f"tradeoff/{method}/{kind}/sample{sizes[0]}/fit"].value, out[f"{name}/fit"].value))
        out[f"tradeoff/{method}/rounding"] = Number(max(parts.rounding[method]), "%", better="lower")
    head = ("method", "type", *(f"{n} px" for n in sizes), f"fit, {sizes[0]} px [ns]", f"fit, {whole} px [ns]")
    note = ("RMS error of the whole scene [% of the water level], mean over scenes whose bands look at one instant; "
            "time of the fit in ns per pixel and band of the scene.")  # fmt: skip
    table = Table.of("Error against the size of the sample", head, rows, note)
    return Section("tradeoff/samples", "Fit on a sample, and on all of it", _said(parts, sizes), (table,), numbers=out)


def _said(parts: Parts, sizes: Sequence[int]) -> tuple[str, ...]:
    whole = sizes[-1]

    def mean(method: str, kind: str, size: int) -> float:
        return float(np.mean(parts.errors[method, kind, size]))

    enough = {
        m: next(n for n in sizes if mean(m, "float32", n) <= 1.05 * mean(m, "float32", whole)) for m in METHODS
    }  # fmt: skip
    listed = ", ".join(f"{m} {n}" for m, n in enough.items())
    time = np.median([
        a / b for m in METHODS
        for a, b in zip(parts.seconds[m, "float64", whole], parts.seconds[m, "float32", whole], strict=True)
    ])  # fmt: skip
    fewest, all_ = (mean("hedley", "float32", n) for n in (sizes[0], whole))
    falling = (
        f" The error of hedley rises with the sample, from {fewest:.3g} to {all_:.3g} %: its level is the minimum, and "
        "more pixels hold a darker one."
    ) * (all_ > 1.05 * fewest)
    rounding = max(max(v) for v in parts.rounding.values())
    pixels = (
        f"Fitted to fewer pixels, spread evenly over the same {whole} of deep water. Pixels from which on the error is "
        f"within 5 % of that of all: {listed}. What more pixels buy beyond that is time alone; a sample is therefore "
        f"cut off where its slopes are known well enough (--tolerance).{falling}"
    )
    types = (
        f"Numbers of eight bytes in place of four: fits take {time:.2g} times as long, and results differ by at most "
        f"{rounding:.1g} % of the water level. Sums are taken in eight bytes either way."
    )
    return pixels, types


def medians(parts: Parts) -> Section:
    """The chapter on medians."""
    out: dict[str, Number] = {}
    rows = []
    for name in MEDIANS:
        key = "tradeoff/median/" + name.replace(" ", "-").replace("(", "").replace(")", "")
        out[f"{key}/time"] = timed(parts.median_seconds[name], "ns")
        out[f"{key}/off"] = Number(max(parts.off[name]), "%", better="lower")
        rows.append((name, out[f"{key}/time"], float(np.mean(parts.off[name])), out[f"{key}/off"].value))
    table = Table.of(
        "Medians", ("", "time [ns a value]", "off, mean [%]", "off, most [%]"), rows,
        "Of the visible bands of whole scenes with glint; how far off, in percent of the water level.",
    )  # fmt: skip
    sixteen, bins = (float(np.mean(parts.off[n])) for n in ("one value in 16", "histogram of 4096 bins"))
    exact, ordered = (np.median(parts.median_seconds[f"exact ({n})"]) for n in ("partition", "sort"))
    faster = np.median(parts.median_seconds["exact (partition)"]) / np.median(parts.median_seconds["one value in 16"])
    said = (
        f"A median of one value in sixteen is {sixteen:.2g} % of the water level off, {faster:.3g} times as quick; a "
        f"histogram between the extremes, which sparkle sets, is {bins:.2g} % off. deglint takes exact medians of a "
        "sample, at most of the pixels that a look at the scene holds: their time does not grow with the scene. "
        f"Sorting all values takes {ordered / exact:.2g} times what a partition takes."
    )
    return Section("tradeoff/medians", "Exact and approximate medians", (said,), (table,), numbers=out)
