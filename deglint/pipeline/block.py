"""A tile of a scene in three states: as read, as corrected, and as written to the outputs."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..compensate.state import Float32
from ..moments import Mask
from ..raster.convert import Raw
from ..scene import FloatArray
from ..tiles import Tile
from .outputs import PixelCounts


@dataclass(frozen=True, eq=False)
class Block:
    """A tile as read, with the halo that the correction needs."""

    tile: Tile
    outer: Tile  # the tile with its halo
    raw: Raw  # (band, row, column), file values of the tile
    valid: Mask | None  # (band, row, column), mask of valid file values; None if all are valid
    wide: FloatArray  # (band, row, column), physical values in `outer`
    water: Mask  # (row, column), pixels of `outer` that may be corrected
    known: Mask  # (row, column), tile pixels that are valid in the bands of the glint index (with a chain, in all)
    where: Mask  # (row, column), pixels of the tile to correct: those that are both `water` and `known`

    @property
    def own(self) -> FloatArray:
        """Physical values of the tile without its halo, (band, row, column), as a view of `wide`."""
        return self.wide[self.tile.within(self.outer)]


@dataclass(frozen=True, eq=False)
class Corrected:
    """Values of a tile after the correction, and what changed."""

    physical: FloatArray  # (band, row, column), physical values
    changes: dict[int, Mask] = field(default_factory=dict)  # mask (row, column) of changed pixels, by 0-based band
    replaced: Mask | None = None  # (band, row, column), pixels that a chain has replaced
    targets: Mask | None = None  # (row, column), protected pixels
    errors: Float32 | None = None  # (band, row, column), standard errors, if they were requested


@dataclass(frozen=True, eq=False)
class CorrectedTile:
    """A corrected tile as it is written to the outputs; values that were not requested are None."""

    raw: Raw  # (band, row, column), all bands in the type of the output
    counts: PixelCounts
    valid: Mask | None = None  # (row, column), valid pixels; None if the output has no mask
    flags: npt.NDArray[np.uint8] | None = None  # (2, row, column), flags and class of sun glint
    amount: Float32 | None = None  # (band, row, column), removed glint of the bands `Correction.amount_bands`
    stderr: Float32 | None = None  # (band, row, column), standard errors of the bands `Correction.changed`
