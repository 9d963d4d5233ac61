"""The background: mean and covariance of what belongs in a scene, fitted once, saved, used on this scene or another.

`fit` takes a whole array; `Gathering` takes tiles in any number and gives the same background to the bit. A
`Background` is plain numbers; what is scored against it is in `detect.rx`. No file is opened here.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint.errors import FitError, InputError
from deglint.moments import CELL, CellMoments, Moments, cell_moments, thinned

from . import covariance as estimates

Float64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Scores = npt.NDArray[np.floating[Any]]
COVARIANCES = {
    "empirical": "as it is; a pseudo-inverse where bands are constant or follow from others",
    "ridge": "with a share of each band's own variance added to it (--ridge)",
    "ledoit-wolf": "correlation drawn towards the identity (Ledoit and Wolf 2004)",
    "oas": "correlation drawn towards the identity (Chen et al. 2010)",
    "mcd": "of the core alone: minimum covariance determinant, on a sample of the scene",
}
"""How the covariance is estimated."""
RIDGE = 1e-3
"""Share of each band's variance that `ridge` adds, unless it is said."""
SAMPLE = 1 << 17
"""Pixels that the robust estimate looks at, at most about."""
COMPILED_PIXELS = 10_000_000
"""Pixels above which the compiled statistics kernel pays for its loading."""

THREADED_VALUES = 1 << 23
"""Values from which an array in memory is worked on by several threads unless it is said."""


@dataclass(frozen=True, eq=False)
class Background:
    """Mean and covariance of a background.

    Attributes
    ----------
    n : int
        Pixels it was fitted to.
    mean, rest : (bands,) ndarray
        The mean is mean + rest, held in two doubles.
    covariance : (bands, bands) ndarray
        Divided by n - 1; shrunk or robust where that was asked for.
    rule : str
        A key of `COVARIANCES`.
    shrinkage : float
        Share by which the correlation was drawn to the identity, or the ridge that was added.
    names : tuple of str
        Band names, where known.
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
        """Bands that vary and do not follow from the others."""
        return len(estimates.whitener(self.covariance))

    def numbers(self) -> dict[str, Any]:
        """Everything as plain numbers, for JSON."""
        return {
            "background": 1,
            "names": list(self.names),
            "rule": self.rule,
            "shrinkage": self.shrinkage,
            "n": self.n,
            "rank": self.rank,
            "mean": self.mean.tolist(),
            "rest": self.rest.tolist(),
            "covariance": self.covariance.tolist(),
        }

    def to_json(self) -> str:
        """As text that `from_json` reads back to the same bits."""
        return json.dumps(self.numbers(), indent=2)

    @classmethod
    def from_json(cls, text: str) -> Background:
        """Read what `to_json` wrote.

        Raises
        ------
        InputError
            It is something else, or damaged.
        """
        try:
            found = json.loads(text)
            if not isinstance(found, Mapping) or found.get("background") != 1:
                raise ValueError
            mean, rest, matrix = (np.array(found[k], np.float64) for k in ("mean", "rest", "covariance"))
            names = tuple(str(name) for name in found["names"])
            n, rule, shrinkage = int(found["n"]), str(found["rule"]), float(found["shrinkage"])
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise InputError("not a saved background; make one with --save-background.") from error
        whole = mean.ndim == 1 and len(mean) and rest.shape == mean.shape and matrix.shape == mean.shape * 2
        if not whole or not (np.isfinite(matrix).all() and np.isfinite(mean).all()) or len(names) not in (0, len(mean)):
            raise InputError("a saved background whose numbers do not fit together; make it anew.")
        return cls(n, mean, rest, matrix, rule, shrinkage, names)


class Gathering:
    """Collects the moments of a scene from its tiles; the background comes out the same to the bit for any tiling.

    Cells of one row are merged first, then the rows, so that only the rows that are not yet whole are held one by one.
    Tiles come in row-major order and start at multiples of `deglint.moments.CELL`.

    Parameters
    ----------
    bands : int
    share : int
        Keep one pixel in so many for the robust estimate; 0: none.
    """

    def __init__(self, bands: int, share: int = 0) -> None:
        self._bands, self.share = bands, share
        self._open: dict[int, list[CellMoments]] = {}
        self._whole: list[tuple[int, Moments]] = []
        self._places: list[npt.NDArray[np.int64]] = []
        self._values: list[npt.NDArray[Any]] = []

    def add(self, part: Part) -> None:
        """Take the next tile's part."""
        keys = part.cells.keys[:, 0]
        if len(keys):
            self._close(below=int(keys.min()))
        for row in sorted(set(keys.tolist())):
            self._open.setdefault(row, []).append(part.cells.where(keys == row))
        if part.values is not None:
            self._places.append(part.places)
            self._values.append(part.values)

    def moments(self) -> Moments:
        """Of everything so far."""
        self._close(below=None)
        whole = [m for _row, m in sorted(self._whole, key=lambda pair: pair[0])]
        if not whole:
            return moments_of_nothing(self._bands)
        return Moments.merge(whole)

    def sample(self) -> npt.NDArray[Any]:
        """(pixels, bands) that were kept, in the order of the scene."""
        if not self._values:
            return np.zeros((0, self._bands))
        places = np.concatenate(self._places, axis=1)
        return np.asarray(np.concatenate(self._values, axis=1)[:, np.lexsort(places[::-1])].T)

    def _close(self, below: int | None) -> None:
        for row in [r for r in self._open if below is None or r < below]:
            self._whole.append((row, CellMoments.concatenate(self._open.pop(row)).by_place().total()))


@dataclass(frozen=True, eq=False)
class Part:
    """What one tile gives to a `Gathering`."""

    cells: CellMoments
    places: npt.NDArray[np.int64]
    values: npt.NDArray[Any] | None


def moments_of_nothing(bands: int) -> Moments:
    """Moments of no pixel."""
    return cell_moments(np.zeros((bands, 0, 0))).total()


def part_of(
    block: npt.NDArray[Any], mask: Mask | None, origin: tuple[int, int], share: int = 0, *, compiled: bool = False,
    part: tuple[int, int] | None = None,
) -> Part:  # fmt: skip
    """What a block, whose first pixel lies at `origin` in the scene, gives to a `Gathering`; or a part of its rows."""
    cells = cell_moments(block, mask, origin=origin, compiled=compiled, part=part)
    if not share:
        return Part(cells, np.zeros((2, 0), np.int64), None)
    if part is not None:
        origin, block = (origin[0] + part[0], origin[1]), block[:, slice(*part)]
        mask = None if mask is None else mask[slice(*part)]
    good = np.isfinite(block).all(axis=0)
    rows, columns = np.nonzero(thinned(good if mask is None else good & mask, origin, share))
    return Part(cells, np.stack([rows + origin[0], columns + origin[1]]), block[:, rows, columns])


def combine(parts: Sequence[Part]) -> Part:
    """One part in place of those of a row of tiles: the cells of each row are merged to one."""
    cells = CellMoments.concatenate([p.cells for p in parts]).by_place()
    rows = cells.keys[:, 0]
    starts = np.flatnonzero(np.diff(rows, prepend=-1))
    if len(rows):
        each = [cells.where(np.arange(*ends)).total() for ends in pairwise([*starts.tolist(), len(cells.n)])]
        cells = CellMoments.concatenate([CellMoments.from_moments(m) for m in each])
        rows = rows[starts]
        cells = replace(cells, keys=np.stack([rows, np.zeros_like(rows)], axis=1))
    kept = [p for p in parts if p.values is not None]
    places = np.concatenate([p.places for p in parts], axis=1)
    return Part(cells, places, np.concatenate([p.values for p in kept], axis=1) if kept else None)


def fit(
    image: npt.NDArray[Any],
    *,
    mask: Mask | None = None,
    covariance: str = "empirical",
    ridge: float = RIDGE,
    names: Sequence[str] = (),
    threads: int | None = None,
) -> Background:
    """Fit a background to an array.

    Parameters
    ----------
    image : (band, row, column) ndarray
        Any real type; pixels with a NaN or infinity in any band are left out.
    mask : (row, column) bool ndarray, optional
        True where a pixel belongs to the background.
    covariance : str
        A key of `COVARIANCES`.
    ridge : float
        For "ridge": this share of each band's variance is added to it.
    names : sequence of str
        Band names to keep with it.
    threads : int, optional
        All processors for large images, or as few as OMP_NUM_THREADS says; the result does not depend on it.

    Returns
    -------
    Background

    Raises
    ------
    FitError
        Fewer than two valid pixels.
    InputError
        A covariance that is not known, or shapes that do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> image = np.random.default_rng(0).normal(size=(3, 50, 60))
    >>> fit(image).rank
    3
    """
    image = as_image(image)
    mask = as_mask(mask, image)
    pixels = image.shape[1] * image.shape[2]
    gathering = Gathering(len(image), sample_share(covariance, pixels))
    compiled = pixels > COMPILED_PIXELS
    strips = [(row, min(row + CELL, image.shape[1])) for row in range(0, image.shape[1], CELL)]

    def part(rows: tuple[int, int]) -> Part:
        return part_of(image, mask, (0, 0), gathering.share, compiled=compiled, part=rows)

    def fourth(rows: tuple[int, int]) -> Float64:
        inside = None if mask is None else mask[slice(*rows)]
        return fourth_moments(image[:, slice(*rows)], inside, found, (rows[0], 0))

    with ThreadPoolExecutor(threads or default_threads(image)) as pool:
        for one in pool.map(part, strips):
            gathering.add(one)
        found = gathering.moments()
        fourths = list(pool.map(fourth, strips)) if covariance == "ledoit-wolf" and found.n > 1 else []
    return estimate(found, covariance, ridge=ridge, names=names, sample=gathering.sample(), fourths=fourths)


def estimate(
    moments: Moments, covariance: str = "empirical", *, ridge: float = RIDGE, names: Sequence[str] = (),
    sample: npt.NDArray[Any] | None = None, fourths: Sequence[Float64] = (),
) -> Background:  # fmt: skip
    """A background from moments, and from what else its rule needs: a sample (mcd), fourth moments (ledoit-wolf)."""
    check_rule(covariance, ridge)
    n = moments.n
    if n < 2:
        raise FitError(
            f"the background holds {n} valid pixel{'s' * (n != 1)}, need at least 2, and more than there are bands "
            "to tell them apart. Check nodata and the background's area."
        )
    matrix, mean, rest, shrinkage = moments.covariance(), moments.mean, moments.rest, 0.0
    beyond = ~np.isfinite(np.diag(matrix)) | ((np.diag(matrix) == 0) & (moments.minimum < moments.maximum))
    if beyond.any():
        b = int(np.argmax(beyond))
        raise FitError(
            f"{names[b] if names else f'band {b + 1}'} goes from {moments.minimum[b]:g} to {moments.maximum[b]:g}, "
            "squares of which are beyond double precision. Bring it to other units, or mark what is not valid as "
            "nodata."
        )
    if covariance == "ridge":
        matrix, shrinkage = estimates.ridged(matrix, ridge), ridge
    elif covariance == "oas":
        shrinkage = estimates.oas_shrinkage(moments.covariance(ddof=0), n)
        matrix = estimates.shrunk(matrix, shrinkage)
    elif covariance == "ledoit-wolf":
        fourth = math.fsum(v for part in fourths for v in part)
        shrinkage = estimates.ledoit_wolf_shrinkage(moments.covariance(ddof=0), n, fourth)
        matrix = estimates.shrunk(matrix, shrinkage)
    elif covariance == "mcd":
        if sample is None or len(sample) < 2:
            raise FitError("the robust background has fewer than 2 pixels to look at. Widen its area.")
        mean, matrix, n = estimates.robust(sample.astype(np.float64))
        rest = np.zeros_like(mean)
    return Background(n, mean, rest, matrix, covariance, float(shrinkage), tuple(names))


def fourth_moments(block: npt.NDArray[Any], mask: Mask | None, moments: Moments, origin: tuple[int, int]) -> Float64:
    """Sums over the pixels of each cell of |z|^4, z a pixel in standard deviations from the mean."""
    scale = estimates.standardised(moments.covariance(ddof=0))[1]
    with np.errstate(invalid="ignore", over="ignore"):
        z = ((block - moments.mean[:, None, None]) - moments.rest[:, None, None]) * scale[:, None, None]
        fourth = (z**2).sum(axis=0) ** 2
    good = np.isfinite(block).all(axis=0)
    fourth[~good if mask is None else ~(good & mask)] = 0
    row0, column0 = origin[0] % CELL, origin[1] % CELL
    padded = np.zeros([-(-(n + first) // CELL) * CELL for n, first in zip(fourth.shape, (row0, column0), strict=True)])
    padded[row0 : row0 + fourth.shape[0], column0 : column0 + fourth.shape[1]] = fourth
    cells = padded.reshape(padded.shape[0] // CELL, CELL, -1, CELL).transpose(0, 2, 1, 3)
    return np.ascontiguousarray(cells).reshape(-1, CELL * CELL).sum(axis=1)


def sample_share(covariance: str, pixels: int) -> int:
    """One pixel in how many a `Gathering` is to keep for this rule; 0: none."""
    return max(1, -(-pixels // SAMPLE)) if covariance == "mcd" else 0


def check_rule(covariance: str, ridge: float) -> None:
    """Refuse a rule that is not known, or a ridge that is none."""
    if covariance not in COVARIANCES:
        raise InputError(f"covariance {covariance!r} is not one of {', '.join(COVARIANCES)}.")
    if not (np.isfinite(ridge) and ridge >= 0):
        raise InputError(f"ridge: want a share of the variance, 0 or more, got {ridge}.")


def default_threads(image: npt.NDArray[Any]) -> int:
    """Threads for work on an array in memory: one where it is small, else all processors that we may use.

    As few as OMP_NUM_THREADS says, which limits the matrix products, too.
    """
    if image.size < THREADED_VALUES:
        return 1
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return max(min(processors, int(limit) if limit.isdecimal() else processors), 1)


def as_image(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A (band, row, column) array of real numbers, or an InputError."""
    image = np.asarray(image)
    if image.ndim != 3 or not len(image):
        raise InputError(f"expected a (band, row, column) array with at least one band, got shape {image.shape}.")
    if image.dtype.kind not in "fiu":
        raise InputError(f"expected real numbers, got {image.dtype}.")
    return image


def as_mask(mask: npt.NDArray[Any] | None, image: npt.NDArray[Any]) -> Mask | None:
    """A bool mask of the image's rows and columns, or an InputError."""
    if mask is None:
        return None
    mask = np.asarray(mask)
    if mask.shape != image.shape[1:]:
        raise InputError(f"the mask has shape {mask.shape}, but the image has {image.shape[1]} rows and "
                         f"{image.shape[2]} columns.")  # fmt: skip
    return mask.astype(np.bool_, copy=False)
