"""Find the threshold of a written score raster, and write the objects above it with their false-alarm rates."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from deglint.raster.output import Scratch
from deglint.tiles import LONGEST_SIDE, tiles

from ..arrays import Array, Int64
from ..objects import Object, find_among, to_geojson
from ..sea.region import ALONGSIDE, likeness, rectangle
from ..sea.search import LOW, Clutter, Rated, clutter_of, rated_objects
from ..threshold import Tail, Threshold, from_chi2, from_f, from_quantile, from_tail
from .features import described, motions, to_wgs84, write_chips, write_features
from .plan import Plan
from .recipe import Outputs

Places = tuple[Int64, Int64, Array]  # rows, columns and scores of pixels, in row-major order
CANDIDATES = 0.04  # fraction of the scores, the highest, that is kept for "sea"; the pixels of candidates are fewer
_UNKNOWN_PIERS = 3
"""Number that is added to the rank of an object alongside a quay, to estimate its false-alarm rate: all objects up to
its rank may be false, and even if none is known to be false, there may be up to this many (95 % confidence)."""


def joined(parts: Sequence[Places]) -> Places:
    """Join the pixels of several tiles, (rows, columns, scores) each, and sort them in row-major order."""
    rows, columns, scores = map(np.concatenate, zip(*parts, strict=True))
    order = np.lexsort((columns, rows))
    return rows[order], columns[order], scores[order]


@dataclass(frozen=True, eq=False)
class Marker:
    """Finds the threshold of a written score raster, and the objects that exceed it."""

    plan: Plan
    scores: Any  # the written score raster, open for reading
    tail: Tail  # the highest scores; for "sea" without those of ALONGSIDE
    beside: dict[int, Places]  # pixels attached to land, by class: ALONGSIDE or ATTACHED of `detect.sea.region`

    @property
    def _strata(self) -> int:
        """Number of kinds of objects that divide the false-alarm rate: 1 (afloat), or 2 (also alongside a quay)."""
        return 2 if len(self.beside[ALONGSIDE][0]) else 1

    def threshold(self) -> Threshold:
        """Threshold for the requested false-alarm rate; for "sea", without scores of confirmed objects (`_clutter`)."""
        recipe, law, tail = self.plan.recipe, self.plan.law, self.tail
        pfa = float(recipe.pfa or 0)
        if recipe.threshold in ("chi2", "f") and law:
            found = from_chi2(pfa, law[0]) if recipe.threshold == "chi2" else from_f(pfa, *law)
            found = replace(found, value=found.value * self.plan.unbiased)
            return found.measured(tail.above(found.value), tail.n)
        if self.plan.model is None:
            return (from_quantile if recipe.threshold == "empirical" else from_tail)(tail, pfa)
        clutter = self._clutter
        if recipe.false_per_km2 is not None:
            value = clutter.score_at(recipe.false_per_km2 / self._strata)
            above = clutter.tail.above(value)
            rate = (above or 0) / max(clutter.tail.n, 1)
            ranks = f"the threshold is from ranks, which show no rate below {self._strata / clutter.area:.3g} per km2"
            notes = [] if clutter.fitted else [f"too few candidates to fit a distribution: {ranks}"]
            if self._strata * (len(clutter.clouds) - 1) / clutter.area > recipe.false_per_km2:
                notes.append(f"{len(clutter.clouds)} round objects, so probably clouds, are left out; --pfa lists them")
            got, asked = None if above is None else rate, {"false_per_km2": recipe.false_per_km2}
            return Threshold(value, "peaks", rate, got, clutter.tail.n, numbers=asked, notes=tuple(notes))
        return from_quantile(clutter.tail, pfa) if recipe.threshold == "empirical" else clutter.threshold(pfa)

    @cached_property
    def _clutter(self) -> Clutter:
        """Clutter of the sea: scores without confirmed (large, bright) objects, and the distribution of other peaks."""
        model, area = self.plan.model, self.tail.n * (self.plan.pixel_area or math.nan) / 1e6
        assert model is not None
        found = find_among(*self._above(LOW * model.q90, self.beside[ALONGSIDE]))
        return clutter_of(self.tail, found, model.q90, area=area, fine=model.fine)

    def _above(self, value: float, *without: Places) -> Places:
        """Pixels with scores greater than `value`, except the pixels in `without`; the raster is read in strips."""
        found = []
        width = self.scores.width
        for tile in tiles(self.scores.height, width, (LONGEST_SIDE, width)):
            scores = self.scores.read(1, window=tile.window)
            with np.errstate(over="ignore"):
                rows, columns = np.nonzero(scores > value)
            found.append((rows + tile.row0, columns, scores[rows, columns]))
        rows, columns, scores = joined(found)
        apart = np.ones(len(rows), np.bool_)
        for row, column, _scores in without:
            apart &= ~np.isin(rows * width + columns, row * width + column)
        return rows[apart], columns[apart], scores[apart]

    def _found(self, pixels: Places, above: float = -math.inf) -> list[Object]:
        """Make objects from pixels by options of the recipe; pixels with scores up to `above` only connect parts."""
        recipe, area = self.plan.recipe, self.plan.pixel_area
        return find_among(
            *pixels, above=above, min_size=recipe.min_size, merge_distance=recipe.merge_distance, pixel_area=area
        )

    def objects(self, threshold: Threshold) -> list[Rated]:
        """Objects above the threshold; for "sea" sorted by ascending number of false objects per km2, if known."""
        if self.plan.model is None:
            return [Rated(o, "anomaly", math.nan, math.nan) for o in self._found(self._above(threshold.value))]
        low = min(self._clutter.low, threshold.value)
        found = self._found(self._above(low, *self.beside.values()), threshold.value)
        if threshold.method == "peaks":
            found = [o for o in found if o.score_top > threshold.value]
        rated, most = rated_objects(found, self._clutter, self._strata), self.plan.recipe.false_per_km2 or math.inf
        rated = [r for r in rated if not (r.kind == "round" and r.rate > most)]
        rated += self._alongside(threshold, len(rated))
        if self._clutter.area > 0:
            rated.sort(key=lambda r: (r.rate, -r.found.score_top))
        return [r._replace(found=replace(r.found, label=i)) for i, r in enumerate(rated, start=1)]

    def _alongside(self, threshold: Threshold, afloat: int) -> list[Rated]:
        """Objects alongside quays that exceed the threshold and the minimum score of large objects (`Clutter.large`).
        `afloat` is the number of objects not at quays. An object is left out if its number of false objects per km2 is
        above the number at the threshold (method "peaks"), or above `afloat` divided by the area (other methods).
        """
        clutter = self._clutter
        dimmest = max(threshold.value, clutter.large[1])  # quays and clutter are dimmer than this
        found = [o for o in self._found(self.beside[ALONGSIDE]) if o.score_max > dimmest]
        found.sort(key=lambda o: likeness(*rectangle(o.footprint)[:2], o.size), reverse=True)
        most = clutter.false_per_km2(threshold.value) if threshold.method == "peaks" else afloat / clutter.area
        rated = [((rank + _UNKNOWN_PIERS) / clutter.area, o) for rank, o in enumerate(found, 1)]  # each may be a pier
        return [Rated(o, "alongside", self._strata * rate, math.nan) for rate, o in rated if not rate > most]

    def write(self, threshold: Threshold, targets: Outputs, scratch: Scratch) -> int | None:
        """Write the objects above a threshold to `targets.objects` and return their number; None if no file is set."""
        if targets.objects is None:
            return None
        rated = self.objects(threshold)
        found, plan, scene = [r.found for r in rated], self.plan, self.plan.scene
        chips = write_chips(scene, targets.chips, self.scores, found, scratch) if targets.chips else [""] * len(found)
        moved = motions(scene, plan.bands, plan.pixel_area, found) if plan.recipe.moving else [{}] * len(found)
        move = to_wgs84(scene)
        document = to_geojson(found, move)
        for feature, r, motion, chip in zip(document["features"], rated, moved, chips, strict=True):
            feature["properties"] |= described(*r, move) | motion
            feature["properties"] |= {"threshold": threshold.value, "pfa": threshold.pfa_requested}
            feature["properties"] |= {"chip": chip} if chip else {}
        write_features(scratch, targets.objects, document, geographic=move is not None)
        return len(rated)
