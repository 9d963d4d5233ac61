"""Read only as much of a sample as the requested standard error of the slopes needs.

With a tolerance a fit reads squares of 192 pixels, spread evenly, a batch after the other, until in every band that
will be corrected the relative standard error of the glint taken from it (`deglint.remove.glint_error`) is small enough,
or there is no more to read. The squares and the end depend only on the scene's pixels, not on the file's blocks or on
threads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from .. import tiles as tiling
from ..errors import FitError
from ..moments import in_share
from ..remove import METHODS, FitRequest, SamplePlan, SampleStatistics, glint_error, levels_for, merge
from ..remove.request import MIN_PIXELS
from ..remove.statistics import SamplePart
from ..scene import Scene
from ..tiles import Tile
from .overview import OVERVIEW_PIXELS
from .sample import Sampler

KEPT_PIXELS = 1 << 20
"""Most single pixels that are kept for a percentile or a mode."""
LEAST_CELLS = 40
"""Fewest effective cells for a reliable standard error. In simulated seas with fewer than 25, where a few clumps of
sparkle contain most of the glint, real errors were up to 24 times the estimated ones; with more than 40, 1.3 times."""
GROWTH = 1.25, 4.0
"""Least and largest increase of the sample by the next batch, as a factor."""
READ_MARGIN = 1.1
"""Safety factor on the size of the next batch, which is extrapolated with the square root of the pixels."""


@dataclass(eq=False)
class Sampling:
    """The batches of a sample: `for tiles, plan in sampling`; the statistics of each are appended to `parts`."""

    scene: Scene
    sampler: Sampler
    request: FitRequest
    method: str
    plan: SamplePlan
    tolerance: float = 0.0  # relative standard error wanted; 0: everything is one batch
    errors: dict[str, float] = field(default_factory=dict)
    parts: list[SamplePart] = field(default_factory=list)
    taken: int = 0
    cells: float = 0.0

    def __post_init__(self) -> None:
        self.pool = list(self.sampler.squares(self.scene) if self.tolerance else self.sampler.tiles)
        self.total = sum(tile.pixels for tile in self.pool)

    @property
    def largest(self) -> tuple[int, int]:
        """Rows and columns of the largest tile."""
        return max(self.pool, key=lambda tile: tile.pixels).shape

    def __iter__(self) -> Iterator[tuple[Sequence[Tile], SamplePlan]]:
        if not self.tolerance:
            pixels, self.taken = self.sampler.pixels, self.total
            self.plan = replace(self.plan, share=max(1, -(-pixels // KEPT_PIXELS)), levels=levels_for(pixels))
            yield self.pool, self.plan
            return
        wanted, done = OVERVIEW_PIXELS, set[Tile]()
        while len(done) < len(self.pool):
            batch = [tile for tile in tiling.spread(self.pool, wanted) if tile not in done]
            if not batch:
                wanted = int(wanted * GROWTH[0])
                continue
            done.update(batch)
            self.taken += sum(tile.pixels for tile in batch)
            share = 1 << max(0, math.ceil(math.log2(self.taken / KEPT_PIXELS)))  # one single pixel in so many is kept
            self.plan = replace(self.plan, share=share, levels=levels_for(self.taken))
            yield batch, self.plan
            worst = self._worst()
            if worst <= self.tolerance:
                return
            grows = READ_MARGIN * (worst / self.tolerance) ** 2 if math.isfinite(worst) else GROWTH[1]
            wanted = int(self.taken * min(max(grows, GROWTH[0]), GROWTH[1]))

    def statistics(self) -> SampleStatistics:
        """Statistics of all that was read."""
        return merge([_thinned(p, self.plan.share) for p in self.parts] if self.tolerance else self.parts, self.plan)

    def _worst(self) -> float:
        """Largest relative error of the bands to correct; infinite if not known."""
        parts = [replace(p, places=p.places[:, :0], values=p.values[:, :0]) for p in self.parts if len(p.cells.n)]
        self.errors = {}
        if not parts:
            return math.inf
        stats = merge(parts, self.plan)
        weights = METHODS[self.method].weights
        if weights is None or stats.regressed.n < MIN_PIXELS:
            return math.inf
        try:
            every = list(weights(self.request, stats))
        except FitError:  # nothing varies so far
            return math.inf
        self.cells = math.inf
        for found in every:
            name = self.request.bands[self.request.correct[found.band]].name
            self.errors[name], cells = glint_error(stats, found.band, found.references, found.weights)
            self.cells = min(self.cells, cells)
        if self.cells < LEAST_CELLS:
            return math.inf
        return max(self.errors.values(), default=0.0)

    def said(self) -> tuple[dict[str, Any] | None, list[str], list[str]]:
        """Entries of the sidecar, lines of the log, and warnings."""
        if not self.tolerance:
            return None, [], []
        worst = max(self.errors, key=lambda name: self.errors[name], default=None)
        met = self.cells >= LEAST_CELLS and (worst is None or self.errors[worst] <= self.tolerance)
        whole = self.scene.height * self.scene.width if self.sampler.bounds is None else self.total
        numbers = {
            "wanted": self.tolerance,
            "met": met,
            "relative_standard_error": dict(self.errors),
            "effective_cells": self.cells,
            "least_effective_cells": LEAST_CELLS,
            "pixels_read": self.taken,
            "pixels_skipped": whole - self.taken,
        }
        reached = f"reached {self.errors[worst]:.2g} (worst, {worst})" if worst else "no band is waited for"
        part = f"with {self.taken} of {whole} pixels read ({1 - self.taken / whole:.0%} skipped)"
        notes = [f"tolerance {self.tolerance:g} of the slopes: {reached} {part}"]
        if met:
            return numbers, notes, []
        if self.cells < LEAST_CELLS:
            few = f"{self.cells:.0f} squares of 64 pixels, too few to know the error by"
            known = f"most of the sample's glint is in {few}"
        else:
            known = f"the slopes' error is {self.errors[worst or '']:.2g} in {worst}"
        return numbers, notes, [f"the tolerance {self.tolerance:g} was not reached: {known}."]


def _thinned(part: SamplePart, share: int) -> SamplePart:
    """A part of an early batch, with as few single pixels as the last batch kept."""
    if share == 1 or not part.places.size:
        return part
    kept = in_share(part.places[0], part.places[1], share)
    return replace(part, places=part.places[:, kept], values=part.values[:, kept])
