"""Objects are connected parts of a mask of detected pixels; each has a score, a size, a position and an outline.

No file is opened here. Row 0, column 0 is the upper left pixel of the array; outlines run along the edges of pixels.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import cv2
import numpy as np

from deglint.checks import check_number
from deglint.errors import InputError

from .arrays import Array, Float64, Int32, Int64, Mask

Ring = tuple[tuple[float, float], ...]  # (column, row) corners of a closed polygon
Move = Callable[[Sequence[tuple[float, float]]], list[tuple[float, float]]]
"""Function that converts (column, row) points to (longitude, latitude) [degree]."""
FARTHEST = 1e6  # largest distance within which parts are merged [pixel]
_FOOTPRINT = 3
"""Number of pixels in `Object.score_top`. The point spread function spreads a point over about three pixels; a single
bright pixel is noise or an artefact of the removal."""


@dataclass(frozen=True, eq=False)
class Object:
    """A detected object: detected pixels that touch, or are near each other.

    Attributes
    ----------
    label : int
        Number of the object, from 1. `find` numbers objects in order of descending `score_max`.
    score_max, score_mean : float
        Maximum and mean score of the detected pixels.
    size : int
        Number of detected pixels.
    area : float or None
        Area of the detected pixels [m2]; None where the size of a pixel is not known.
    centroid : (float, float)
        Mean row and column of the detected pixels, not weighted by score; integers are the centres of pixels.
    bounds : ((row0, row1), (col0, col1))
        Half-open ranges of rows and columns that contain the object.
    footprint : (rows, columns) ndarray of bool
        True at the detected pixels, within `bounds`.
    score_top : float
        Root mean square of the three highest scores; a missing score counts as 0, so small objects have low values.
    scores : (size,) ndarray
        Scores of the detected pixels, in row-major order.
    """

    label: int
    score_max: float
    score_mean: float
    size: int
    area: float | None
    centroid: tuple[float, float]
    bounds: tuple[tuple[int, int], tuple[int, int]]
    footprint: Mask = field(repr=False)
    score_top: float
    scores: Float64 = field(repr=False)

    @property
    def measures(self) -> dict[str, object]:
        """Size, area and position, by their names in the files of objects."""
        row, column = self.centroid
        return {"pixels": self.size, "area_m2": self.area, "row": row, "column": column}

    @cached_property
    def peak(self) -> tuple[int, int]:
        """Row and column of the highest score."""
        row, column = np.argwhere(self.footprint)[self.scores.argmax()].tolist()
        return row + self.bounds[0][0], column + self.bounds[1][0]

    @cached_property
    def outline(self) -> tuple[tuple[Ring, ...], ...]:
        """Polygons along the edges of pixels: each has an outer ring, then its holes, as (column, row) corners.

        Rings are closed and never touch themselves; parts that touch only at a corner are separate polygons. (0, 0) is
        the upper left corner of the array: the pixel (row, column) extends from `column` to `column` + 1.
        """
        from rasterio.features import shapes
        from rasterio.transform import Affine

        (top, _bottom), (left, _right) = self.bounds
        place = Affine.translation(left, top)
        found = shapes(self.footprint.astype(np.uint8), mask=self.footprint, connectivity=4, transform=place)
        return tuple(tuple(map(tuple, polygon["coordinates"])) for polygon, _ in found)


def find(
    mask: Mask, scores: Array, *, min_size: int = 1, merge_distance: float = 0.0, pixel_area: float | None = None
) -> list[Object]:
    """Find the objects of a mask of detected pixels, (row, column), in order of descending `score_max`.

    Pixels that touch, also at a corner, are one object; pixels whose score is NaN, or hidden in a numpy masked array,
    are ignored. Parts whose nearest pixels are at most `merge_distance` apart, centre to centre [pixel], are merged.
    Then objects of fewer than `min_size` pixels are dropped. `pixel_area` is in m2. Raises InputError if shapes differ
    or a value is not allowed.

    Examples
    --------
    >>> scores = np.array([[9.0, 1, 1, 1], [7, 1, 1, 8]])
    >>> [(o.size, o.score_max, o.centroid) for o in find(scores > 2, scores)]
    [(2, 9.0, (0.5, 0.0)), (1, 8.0, (1.0, 3.0))]
    """
    hidden = np.ma.getmask(scores)
    mask, scores = np.ma.filled(mask, False), np.asarray(scores)
    if mask.ndim != 2 or mask.shape != scores.shape:
        raise InputError(f"mask and scores must be of one shape (row, column), got {mask.shape} and {scores.shape}.")
    rows, columns = np.nonzero(mask.astype(np.bool_, copy=False) & ~np.isnan(scores) & ~hidden)
    return find_among(
        rows, columns, scores[rows, columns], min_size=min_size, merge_distance=merge_distance, pixel_area=pixel_area
    )


def find_among(
    rows: Int64,
    columns: Int64,
    scores: Array,
    *,
    min_size: int = 1,
    merge_distance: float = 0.0,
    pixel_area: float | None = None,
    above: float = -math.inf,
) -> list[Object]:
    """As `find`, for pixels given by their rows, columns and scores, (pixels,) each, instead of arrays of the scene.

    The pixels are in row-major order. Pixels with a score greater than `above` are the detected pixels of the objects.
    The other pixels only connect the parts of an object, and count for its `score_top`.
    """
    check_number(min_size, 1, math.inf, "min_size")
    check_number(merge_distance, 0, FARTHEST, "merge_distance")
    if not len(rows):
        return []
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    tree = cKDTree(np.stack([rows, columns], axis=1), balanced_tree=False, compact_nodes=False)
    pairs = tree.query_pairs(max(merge_distance, 1.5), output_type="ndarray")  # pixels that touch, or are near
    graph = coo_array((np.ones(len(pairs), np.bool_), pairs.T), shape=(len(rows), len(rows)))
    part = connected_components(graph, directed=False)[1]
    kept, values = scores > above, scores.astype(np.float64)
    groups = np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1])
    large = [(own, group) for group in groups if len(own := group[kept[group]]) >= min_size]
    out = []
    for number, (own, group) in enumerate(sorted(large, key=lambda o: (-values[o[0]].max(), o[0][0])), start=1):
        highest = np.sort(values[group])[: -_FOOTPRINT - 1 : -1]
        down, across = rows[own], columns[own]
        row, left = int(down.min()), int(across.min())
        footprint = np.zeros((int(down.max()) + 1 - row, int(across.max()) + 1 - left), np.bool_)
        footprint[down - row, across - left] = True
        out.append(
            Object(
                label=number,
                score_max=float(values[own].max()),
                score_mean=float(values[own].mean()),
                size=len(own),
                area=None if pixel_area is None else len(own) * pixel_area,
                centroid=(float(down.mean()), float(across.mean())),
                bounds=((row, row + footprint.shape[0]), (left, left + footprint.shape[1])),
                footprint=footprint,
                score_top=math.sqrt((highest**2).sum() / _FOOTPRINT),
                scores=values[own],
            )
        )
    return out


def label(mask: Mask) -> Int32:
    """Label the connected parts of a mask, (row, column), with 1, 2, ...; 0 elsewhere. Corners connect pixels, too."""
    if mask.size == 0:  # OpenCV crashes
        return np.zeros(mask.shape, np.int32)
    return np.asarray(cv2.connectedComponents(mask.astype(np.uint8), connectivity=8, ltype=cv2.CV_32S)[1])


def to_geojson(objects: Sequence[Object], move: Move | None = None) -> dict[str, Any]:
    """GeoJSON FeatureCollection (RFC 7946) of objects: outlines; properties label, scores, size, position, window.

    `move` converts corners (column, row) to (longitude, latitude). The window is [column, row, width, height] [pixel].
    """
    features = []
    for o in objects:
        rings = [[list(move(ring)) if move else list(ring) for ring in polygon] for polygon in o.outline]
        polygons = [[_turned(ring, hole=i > 0) for i, ring in enumerate(polygon)] for polygon in rings]
        kind, coordinates = ("Polygon", polygons[0]) if len(polygons) == 1 else ("MultiPolygon", polygons)
        (row0, row1), (col0, col1) = o.bounds
        properties = {"label": o.label, "score_max": o.score_max, "score_mean": o.score_mean} | o.measures
        properties["window"] = [col0, row0, col1 - col0, row1 - row0]
        geometry = {"type": kind, "coordinates": coordinates}
        features.append({"type": "Feature", "id": o.label, "properties": properties, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}


def _turned(ring: Sequence[tuple[float, float]], *, hole: bool) -> list[list[float]]:
    """Orient an outer ring counter-clockwise and a hole clockwise (RFC 7946), for any order of the given corners."""
    area = sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in pairwise(ring))
    return [list(p) for p in (ring[::-1] if (area < 0) != hole else ring)]
