"""Background of a scene: mean and covariance of its pixels, used to score this scene or another.

`fit` computes a `Background` from a whole array. `Part` computes it from tiles, with the same result to the bit. A
`Background` can be saved as JSON; `detect.global_rx` computes scores with it. No file is opened here.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from deglint.checks import check_choice
from deglint.errors import FitError, InputError
from deglint.moments import CELL, CellMoments, cell_moments, thinned
from deglint.tiles import Tile, default_threads, run, tiles

from . import covariance as estimates
from .arrays import Array, Float64, Int64, Mask

COVARIANCES = ("empirical", "ridge", "ledoit-wolf", "oas", "mcd")  # estimators of `detect.covariance`
RIDGE = 1e-3  # default share of each band's variance that `ridge` adds
HIGHEST_VALUE = 1e150  # largest absolute value: the sums of squares stay within double precision
ROBUST_SAMPLE = 1 << 17  # approximate maximum number of pixels in the sample for "mcd" and "ledoit-wolf"


@dataclass(frozen=True, eq=False)
class Background:
    """Mean and covariance of a background.

    Attributes
    ----------
    n : int
        Number of pixels used for mean and covariance; for "mcd", number of pixels in the sample without outliers.
    mean, rest : (bands,) ndarray
        The precise mean is mean + rest; `rest` is the rounding error of `mean`.
    covariance : (bands, bands) ndarray
        Covariance (divisor n - 1), estimated with the method `rule`.
    rule : str
        Estimator of the covariance, one of `COVARIANCES`.
    shrinkage : float
        For "ledoit-wolf" and "oas", weight of the identity matrix in the correlation; for "ridge", the ridge; else 0.
    names : tuple of str
        Names of the bands; empty where they are not known.
    """

    n: int
    mean: Float64
    rest: Float64
    covariance: Float64
    rule: str = "empirical"
    shrinkage: float = 0.0
    names: tuple[str, ...] = ()

    @property
    def bands(self) -> int:
        """Number of bands."""
        return len(self.mean)

    @property
    def rank(self) -> int:
        """Rank of the covariance: number of linearly independent bands that vary."""
        return len(estimates.whitener(self.covariance))

    def numbers(self) -> dict[str, object]:
        """All fields, the rank, and the version of the format (key "background"), as values for JSON."""
        shown = ("names", "rule", "shrinkage", "n", "rank", "mean", "rest", "covariance")
        return {"background": 1} | {name: np.asarray(getattr(self, name)).tolist() for name in shown}

    def to_json(self) -> str:
        """JSON text from which `from_json` restores the background to the bit."""
        return json.dumps(self.numbers(), indent=2)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Restore a background from the text of `to_json`. Raises InputError if it is another text, or damaged."""
        try:
            found = json.loads(text)
            mean, rest, matrix = (np.array(found[k], np.float64) for k in ("mean", "rest", "covariance"))
            names = tuple(str(name) for name in found["names"])
            shapes = mean.ndim == 1 and rest.shape == mean.shape and matrix.shape == mean.shape * 2
            finite = shapes and all(np.isfinite(a).all() for a in (matrix, mean, rest))
            if found["background"] != 1 or not finite or len(names) not in (0, len(mean)):
                raise ValueError
            return cls(int(found["n"]), mean, rest, matrix, str(found["rule"]), float(found["shrinkage"]), names)
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise InputError("not a saved background, or damaged; make one with --save-background.") from error


@dataclass(frozen=True, eq=False)
class Part:
    """Contribution of tiles to a background: moments of square cells (`deglint.moments`), and a sample of pixels."""

    cells: CellMoments
    places: Int64  # (2, samples): rows and columns of the sampled pixels in the scene
    values: Array  # (bands, samples): values of the sampled pixels

    @classmethod
    def of(cls, block: Array, mask: Mask | None, origin: tuple[int, int], share: int = 0) -> Self:
        """Contribution of a block, (band, row, column); `origin` is the row and column of its first pixel in the scene.

        `mask`, (row, column), is True in the background. One in `share` of these pixels is sampled; 0 means no sample.
        """
        rows = columns = np.zeros(0, np.int64)
        if share:
            good = np.asarray(np.isfinite(block).all(axis=0))
            rows, columns = np.nonzero(thinned(good if mask is None else good & mask, origin, share))
        places = np.stack([rows + origin[0], columns + origin[1]])
        return cls(cell_moments(block, mask, origin=origin), places, block[:, rows, columns])

    @classmethod
    def merge(cls, parts: Sequence[Self]) -> Self:
        """Merge parts of a scene. Each row of cells becomes one cell, so merge whole rows of tiles at a time.

        If tiles start at multiples of `deglint.moments.CELL`, any tiling gives the same result to the bit.
        """
        cells = CellMoments.concatenate([p.cells for p in parts])
        rows = np.unique(cells.keys[:, 0])
        if len(rows) < len(cells.n):
            merged = [cells.where(cells.keys[:, 0] == row).by_place().total() for row in rows]
            cells = CellMoments.of(np.stack([rows, np.zeros_like(rows)], axis=1), merged)
        places, values = (np.concatenate([getattr(p, k) for p in parts], axis=1) for k in ("places", "values"))
        return cls(cells, places, values)

    def background(self, covariance: str, ridge: float, names: Sequence[str] = ()) -> Background:
        """Estimate the background (for "mcd", from the sample only); parameters and errors are as in `fit`."""
        moments = self.cells.by_place().total()
        if (n := moments.n) < 2:
            raise FitError(
                f"the background holds {n} valid pixel{'s' * (n != 1)}, need at least 2, and more than there are bands "
                "in use. Check --nodata, --mask and --background."
            )
        matrix, mean, rest, shrinkage = moments.covariance(), moments.mean, moments.rest, 0.0
        beyond = ~np.isfinite(np.diag(matrix)) | ((np.diag(matrix) == 0) & (moments.minimum < moments.maximum))
        if beyond.any():
            b = int(np.argmax(beyond))
            raise FitError(
                f"{names[b] if names else f'band {b + 1}'}: squares of {moments.minimum[b]:g} to {moments.maximum[b]:g}"
                " leave the range of double precision. Rescale the band (--scale), or declare invalid values as "
                "nodata (--nodata)."
            )
        sample = self.values[:, np.lexsort(self.places[::-1])].T.astype(np.float64)
        if covariance == "ridge":
            matrix, shrinkage = estimates.ridged(matrix, ridge), ridge
        elif covariance == "oas":
            shrinkage = estimates.oas_shrinkage(moments.covariance(ddof=0), n)
            matrix = estimates.shrunk(matrix, shrinkage)
        elif covariance == "ledoit-wolf":
            shrinkage = estimates.ledoit_wolf_shrinkage(moments.covariance(ddof=0), n, sample - mean - rest)
            matrix = estimates.shrunk(matrix, shrinkage)
        elif covariance == "mcd":
            if len(sample) < 2:
                raise FitError("the robust background has fewer than 2 valid pixels. Select a larger area.")
            mean, matrix, n = estimates.robust(sample)
            rest = np.zeros_like(mean)
        return Background(n, mean, rest, matrix, covariance, float(shrinkage), tuple(names))


def fit(
    image: Array,
    *,
    mask: Mask | None = None,
    covariance: str = "empirical",
    ridge: float = RIDGE,
    names: Sequence[str] = (),
    threads: int | None = None,
) -> Background:
    """Fit a `Background`, the mean and covariance of the pixels, to an image.

    Parameters
    ----------
    image : (band, row, column) ndarray
        Any real type; pixels with NaN or infinity in any band are excluded, and so are those hidden in any band of a
        numpy masked array.
    mask : (row, column) bool ndarray, optional
        True where a pixel belongs to the background; by default all valid pixels belong to it.
    covariance : str
        Estimator of the covariance: "empirical", "ridge", "ledoit-wolf", "oas", or "mcd" (robust).
    ridge : float
        Only for "ridge": fraction of each band's variance that is added to it.
    names : sequence of str
        Names of the bands, to store in the background.
    threads : int, optional
        Number of threads, by default one for each processor. The result does not depend on it.

    Raises
    ------
    FitError
        Fewer than two pixels are valid (for "mcd": in the sample), or the squares of values exceed double precision.
    InputError
        `covariance`, `ridge` or `threads` is not allowed, the image is empty, or image or mask is not as above.
    """
    image, mask = as_image(image, mask)
    check_rule(covariance, ridge)
    share = sample_share(covariance, image[0].size if mask is None else int(np.count_nonzero(mask)))

    def part(tile: Tile) -> Part:
        rows = slice(tile.row0, tile.row1)
        return Part.of(image[:, rows], None if mask is None else mask[rows], (tile.row0, 0), share)

    strips = tiles(image.shape[1], image.shape[2], (CELL, image.shape[2]))
    whole = Part.merge([found for _, found in run(strips, part, threads=default_threads(threads))])
    return whole.background(covariance, ridge, names)


def sample_share(covariance: str, pixels: int) -> int:
    """Return N if the estimator `covariance` needs a sample of one in N of `pixels` pixels; 0 if it needs no sample."""
    return max(1, -(-pixels // ROBUST_SAMPLE)) if covariance in ("mcd", "ledoit-wolf") else 0


def check_rule(covariance: str, ridge: float) -> None:
    """Check the name of the estimator and the value of the ridge. Raises InputError if one of them is not allowed."""
    check_choice(covariance, list(COVARIANCES), "covariance")
    if not (np.isfinite(ridge) and ridge >= 0):
        raise InputError(f"ridge: want a share of the variance, 0 or more, got {ridge}.")


def check_range(values: Array) -> None:
    """Raise InputError if a value is beyond +-`HIGHEST_VALUE`."""
    if np.abs(values).max(initial=0) > HIGHEST_VALUE:
        raise InputError(
            f"values: allowed is up to {HIGHEST_VALUE:g} in absolute value, squares of larger values are beyond double "
            "precision. Bring them to other units, or mark what is not valid as nodata (NaN)."
        )


def as_image(image: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> tuple[Array, Mask | None]:
    """Convert an image and the mask of the pixels to use (None: all) to plain arrays in the byte order of the machine.

    Pixels that a numpy masked array hides in any band are removed from the mask. Raises InputError if the image is
    empty or not (band, row, column) of real numbers, or if image and mask differ in rows or columns.
    """
    hidden = np.ma.getmask(image)
    image = np.asarray(image)
    if image.ndim != 3 or not image.size:
        raise InputError(f"expected a (band, row, column) array with at least one value, got shape {image.shape}.")
    if image.dtype.kind not in "fiu":
        raise InputError(f"expected real numbers, got {image.dtype}.")
    if mask is not None:
        mask = np.asarray(mask)
        if mask.shape != image.shape[1:]:
            raise InputError(f"the mask has shape {mask.shape}, but the image has {image.shape[1:]} rows and columns.")
        mask = mask.astype(np.bool_, copy=False)
    image = image.astype(image.dtype.newbyteorder("="), copy=False)
    return image, both(mask, ~np.any(hidden, axis=0) if np.any(hidden) else None)


def both(a: Mask | None, b: Mask | None) -> Mask | None:
    """Intersection of two masks; None means everywhere."""
    return b if a is None else a if b is None else a & b
