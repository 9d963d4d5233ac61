"""The rule that distinguishes water from other surfaces, and its application to a block of a scene."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ..moments import Mask
from ..morphology import eroded, grown
from ..scene import FloatArray

ENOUGH_TO_RANK = 100_000  # most values from which percentiles are determined; if there are more, every k-th is used


@dataclass(frozen=True, slots=True)
class Roles:
    """0-based index of the band of each colour in a block; besides the NIR, at least one visible band is needed."""

    nir: int
    blue: int | None = None
    green: int | None = None
    red: int | None = None

    @property
    def visible(self) -> tuple[int, ...]:
        """0-based indexes of the visible bands: green, blue, red. The first one is compared with the NIR."""
        return tuple(b for b in (self.green, self.blue, self.red) if b is not None)


@dataclass(frozen=True, slots=True)
class WaterRule:
    """How water is distinguished from other surfaces, as plain numbers.

    A square of side `window` is not water if all its pixels have NIR above `threshold`. The side is 1 for coarse pixels
    and larger where glint is resolved into bright patches. Boats and narrow land fill squares of other sides: all
    NIR is above `bright` (side `core`; squares of glint are darker), or above both `red` and the first visible band
    (side `red_core`). Nearby pixels above the same limits, connected with such a square, are not water either.
    """

    roles: Roles
    threshold: float = -np.inf  # [unit of the NIR]
    window: int = 1  # [pixel]
    core: int = 1  # [pixel]; 1: not used
    bright: float = np.inf  # [unit of the NIR]
    red_core: int = 1  # [pixel]; 1: not used
    red: float = np.inf  # [unit of the NIR]
    nir_level: float = np.nan  # median NIR of the water; NaN: no water
    contrast: float = np.nan  # visible minus NIR of the darkest water [unit of the NIR]; NaN: no water
    water_fraction: float = 0.0  # share of water among the valid pixels of the fitted blocks, 0..1
    pixels: int = 0  # valid pixels of the fitted blocks
    whole: bool = True  # whether the fitted blocks covered the whole scene

    @property
    def halo(self) -> int:
        """Width of the margin that `water` needs around a tile [pixel]."""
        return max(self.window, *(side + side // 2 for side in (self.core, self.red_core))) - 1

    @property
    def has_water(self) -> bool:
        """Whether water was found."""
        return self.water_fraction > 0

    @property
    def all_water(self) -> bool:
        """Whether every valid pixel of the scene is water, so that blocks need not be tested.

        This is not known if squares are searched for: the edges of the fitted blocks may cut a boat.
        """
        return self.whole and self.water_fraction == 1.0 and not self.halo

    @property
    def reason(self) -> str:
        """Whether and how much water was found, as one line for a log or for the message of a NoWaterError."""
        if not self.pixels:
            return "no valid pixel, so no water is found. Check the image and --nodata."
        if not self.has_water:
            return (
                "no water: nowhere is the visible brighter than the NIR over a dark, even area. Check the "
                "names (--bands) and the NIR (--nir), or give --mask none (all is water) or --mask FILE (the water)."
            )
        if self.water_fraction == 1.0:
            return f"all of the {self.pixels} pixels examined are water"
        squares = (self.threshold, self.window), (self.bright, self.core)
        limits = [f"{nir:.6g}" + f" over {n} x {n} pixels" * (n > 1) for nir, n in squares if np.isfinite(nir)]
        return (
            f"{100 * self.water_fraction:.2f} % of {self.pixels} pixels examined are water; the rest is land, ships, "
            f"clouds or surf (NIR above {', or '.join(limits)})"
        )

    def numbers(self) -> dict[str, object]:
        """All fields, and the properties `halo`, `all_water` and `reason`, for the JSON sidecar of an output."""
        return {**asdict(self), "halo": self.halo, "all_water": self.all_water, "reason": self.reason}


def water(block: FloatArray | Sequence[FloatArray], rule: WaterRule) -> Mask:
    """Mask (row, column), True over water; False where a band that the rule uses is NaN. Cost: 2 to 5 ns per pixel.

    block : (band, row, column), same unit as for `fit_water`; NaN is not valid. A tile needs a margin of `rule.halo`.

    >>> scene = np.stack([np.full((8, 8), 0.05), np.full((8, 8), 0.01)])
    >>> scene[:, :, 5:] = [[[0.1]], [[0.3]]]
    >>> from deglint.masks import fit_water
    >>> int(water(scene, fit_water([scene], Roles(nir=1, green=0))).sum())
    40
    """
    valid = valid_for(block, rule.roles)
    if not rule.has_water:
        return np.zeros_like(valid)
    return valid if rule.all_water else valid & ~land(block, rule)


def land(block: FloatArray | Sequence[FloatArray], rule: WaterRule) -> Mask:
    """Mask (row, column), True where NIR or colour is not that of water by `rule`; False where the NIR is NaN."""
    nir, visible = block[rule.roles.nir], block[rule.roles.visible[0]]
    missing = ~np.isfinite(nir)
    found = filled_squares(nir > rule.threshold, missing, rule.window)
    for side, red in ((rule.core, False), (rule.red_core, True)):
        if side > 1:
            bright = (nir > rule.red) & (nir > visible) if red else nir > rule.bright
            solid = filled_squares(bright, missing, side)
            for _ in range(side // 2 if solid.any() else 0):  # bow and stern are narrower
                solid = bright & grown(solid, 3)
            found |= solid
    return found


def filled_squares(bright: Mask, missing: Mask, window: int) -> Mask:
    """Mask (row, column), True in squares of side `window` [pixel] in which all pixels are `bright`.

    Missing pixels are ignored. Squares that reach beyond the edge of the image do not count: a few sparkles would fill
    them. The result equals a threshold of the morphologically opened NIR; opening a mask is faster.
    """
    if window == 1 or not bright.any():
        return bright & ~missing
    return grown(eroded(bright | missing, window) & ~missing, window) & ~missing


def valid_for(block: FloatArray | Sequence[FloatArray], roles: Roles) -> Mask:
    """Mask (row, column) of the pixels where the NIR and the visible bands are finite."""
    valid = np.isfinite(block[roles.nir])
    for band in roles.visible:
        valid &= np.isfinite(block[band])
    return valid


def thinned(values: FloatArray) -> FloatArray:
    """Every k-th of `values` (value,), with k so large that at most `ENOUGH_TO_RANK` values remain."""
    return values[:: 1 + values.size // ENOUGH_TO_RANK]
