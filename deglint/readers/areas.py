"""Areas of a scene that a user gives as polygons (GeoJSON), as a mask raster or as a window of pixels.

An `Area` gives the mask of its pixels in any window of the scene. A polygon covers the pixels whose centres lie in it.
"""

import logging
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine

from ..errors import InputError, NoWaterError
from ..moments import Float64, Mask
from ..raster import RasterSource
from ..raster.info import describe_file, gdal_errors, one_line, open_dataset, quiet
from ..scene import Scene, Window
from ..tiles import Tile
from .grid import at, nearest_on, overlap, same_grid
from .text import read_json

log = logging.getLogger(__name__)
LONGITUDE_LATITUDE = "OGC:CRS84"
_POLYGON_CELL = 512  # side of the squares in which polygons are rasterised [pixel]
_FAR = 1e9  # polygon corners further from the scene than this are an error [pixel]


@dataclass(frozen=True)
class Area:
    """A part of a scene: its bounding tile, and a function that returns its mask in any window."""

    bounds: Tile  # tile that contains the area; `open_area` clips it to the scene
    read: Callable[[Window], Mask]  # mask (row, column) of any window, True inside the area
    note: str = ""  # what was assumed about the CRS of polygons, for the log


def tile_area(tile: Tile) -> Area:
    """The area that consists of all pixels of a tile."""
    return Area(tile, partial(_in_tile, tile))


def _in_tile(tile: Tile, window: Window) -> Mask:
    (top, bottom), (left, right) = window
    rows, columns = np.ogrid[top:bottom, left:right]
    inside = (tile.row0 <= rows) & (rows < tile.row1) & (tile.col0 <= columns) & (columns < tile.col1)
    return np.asarray(inside)


def _in_polygons(shapes: Sequence[Mapping[str, Any]], transform: Affine, bounds: Tile, window: Window) -> Mask:
    """Mask (row, column) of `window`, True at pixels whose centres lie in one of the polygons `shapes`.

    `shapes` are GeoJSON polygons in the CRS of the scene, and `transform` is the affine transform of the scene.
    `bounds` is a tile that contains all polygons; the mask is False outside it.
    """
    from rasterio.features import geometry_mask

    whole, side = Tile(*window[0], *window[1]), _POLYGON_CELL
    out = np.zeros(whole.shape, np.bool_)
    # the squares do not depend on the window, so that a pixel centre on an edge is in the same polygon in every window
    down, across = (range(start // side * side, stop, side) for start, stop in whole.clipped(bounds).window)
    for row, column in product(down, across):
        square = Tile(row, row + side, column, column + side)
        inside = geometry_mask(shapes, square.shape, _moved(transform, column, row), invert=True)
        part = square.clipped(whole)
        out[part.within(whole)] = inside[part.within(square)]
    return out


def _in_raster(source: RasterSource, window: Window) -> Mask:
    """Mask (row, column) of `window`, True where the one band of `source` (on the scene's grid) is valid and not 0."""
    values = source.read(window, [0])[0]
    return np.asarray(np.isfinite(values) & (values != 0))


def open_area(text: str, scene: Scene, option: str) -> Area:
    """The area that a user gives as `text`: a GeoJSON file, a mask raster (0 outside the area) or a window.

    A window is "column,row,width,height" [pixel], as in -srcwin of gdal_translate. Error messages name the option
    `option`. Raises ReadError if a file cannot be read, and InputError if `text` is not valid or the area lies outside
    the scene. If the area contains no pixel, raises NoWaterError if `option` is "--mask", and InputError otherwise.
    """
    if re.fullmatch(r"[\s\d.,+-]*\d[\s\d.,+-]*", text) and "," in text and not Path(text).exists():
        parts = [part.strip() for part in text.split(",")]
        if len(parts) != 4 or not all(re.fullmatch(r"-?\d+", part) for part in parts) or min(map(int, parts[2:])) < 1:
            raise InputError(
                f"{option} {text}: a window is four integers, column,row,width,height [pixel], the last two above 0; "
                f"such as {option} 0,0,{scene.width},{scene.height}, which is this scene."
            )
        column, row, width, height = map(int, parts)
        area = tile_area(Tile(row, row + height, column, column + width))
        remedy = "A window is column,row,width,height."
    elif Path(text).suffix.lower() in (".geojson", ".json"):
        area, remedy = polygons(read_json(text, option), scene, text), "Check the CRS, or draw it anew."
    else:
        area, remedy = _raster_area(text, scene, option), ""
    bounds = area.bounds.clipped(Tile(0, scene.height, 0, scene.width))
    if min(bounds.shape) <= 0:
        (top, bottom), (left, right) = area.bounds.window
        raise InputError(
            f"{option} {text} lies off the scene: it covers rows {top} to {bottom} and columns {left} to {right}, the "
            f"scene has {scene.height} rows and {scene.width} columns. {remedy}"
        )
    if not any(area.read(tile.window).any() for tile in bounds.split(2048)):
        kind = NoWaterError if option == "--mask" else InputError
        raise kind(f"{option} {text} selects no pixel of the scene. Give an area with pixels, or leave it out.")
    return replace(area, bounds=bounds)


def polygons(document: Mapping[str, Any], scene: Scene, name: str) -> Area:
    """The area of the polygons in `document`, which is the content of the GeoJSON file `name`.

    The member `crs` of `document` names the CRS of the coordinates. Without `crs`, they are longitude and latitude (RFC
    7946), or in the scene's CRS if an |x| exceeds 360 or a |y| exceeds 90. If the scene has no CRS, they are map
    coordinates or, without a transform, column and row. Raises InputError if there is no polygon, or an invalid one.
    """
    from rasterio.warp import transform_geom

    shapes = list(_polygons(document, name))
    if not shapes:
        raise InputError(f"{name} holds no polygon. Draw the area as Polygon or MultiPolygon features.")
    note = ""
    if scene.crs and not document.get("crs") and (np.abs(_corners(shapes)) > (360, 90)).any():  # longitude to 360
        note = f"{name} names no CRS, and is not in longitude and latitude: the CRS of the scene is assumed"
        log.info("%s", note)
    elif scene.crs is not None:
        try:
            shapes = [transform_geom(crs_of(document, name), scene.crs, s) for s in shapes]
        except gdal_errors(ValueError, IndexError) as error:
            raise InputError(f"{name} has coordinates that its CRS excludes: {one_line(error)}. Check both.") from error
    transform = scene.transform or Affine.identity()
    with np.errstate(all="ignore"):
        columns, rows = at(~transform, *_corners(shapes).T)
    if not (np.abs([columns, rows]) < _FAR).all():
        raise InputError(f"{name} has coordinates that cannot be brought into the scene's CRS. Check its CRS.")
    down, across = ((int(np.floor(along.min())), int(np.ceil(along.max()))) for along in (rows, columns))
    bounds = Tile(*down, *across)
    return Area(bounds, partial(_in_polygons, shapes, transform, bounds), note)


def _corners(shapes: Sequence[Mapping[str, Any]]) -> Float64:
    """Coordinates x and y of all corners of GeoJSON polygons, as an array (corner, 2)."""
    return np.array([point for shape in shapes for ring in shape["coordinates"] for point in ring], np.float64)


def to_geojson(mask: Mask, origin: tuple[int, int], scene: Scene) -> list[dict[str, object]]:
    """GeoJSON polygons of the True pixels of a mask, in the scene's CRS; the mask starts at `origin` (row, column)."""
    from rasterio.features import shapes

    moved = _moved(scene.transform or Affine.identity(), origin[1], origin[0])
    with quiet():
        found = list(shapes(mask.astype(np.uint8), mask=mask, transform=moved))
    return [{"type": "Feature", "properties": {"use": "sample"}, "geometry": shape} for shape, _ in found]


def collection(features: Sequence[Mapping[str, object]], scene: Scene) -> dict[str, object]:
    """A GeoJSON FeatureCollection of features in the scene's CRS; if the CRS has a code, the member `crs` names it."""
    document: dict[str, object] = {"type": "FeatureCollection", "features": list(features)}
    authority = scene.crs.to_authority() if scene.crs is not None else None
    if authority:
        document["crs"] = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:{authority[0]}::{authority[1]}"}}
    return document


def _moved(transform: Affine, column: int, row: int) -> Affine:
    """The affine transform of a window whose first pixel is at `column` and `row` of a raster with `transform`."""
    x, y = at(transform, column, row)
    return Affine(transform.a, transform.b, x, transform.d, transform.e, y)


def geometries(document: object) -> Iterator[tuple[object, Any]]:
    """Yield type and coordinates of every geometry in a GeoJSON document, also inside features and collections."""
    waiting = [document]
    while waiting:
        node = waiting.pop()
        if isinstance(node, list):
            waiting += node[::-1]
        elif isinstance(node, Mapping):
            if node.get("coordinates"):
                yield node.get("type"), node["coordinates"]
            waiting += [node.get(member) for member in ("geometries", "features", "geometry")]


def _polygons(document: object, name: str) -> Iterator[dict[str, Any]]:
    """Yield the polygons (closed rings) of a GeoJSON document (file `name`). Raises InputError if one is not valid."""
    for kind, coordinates in geometries(document):
        several = kind == "MultiPolygon" and isinstance(coordinates, list)
        for polygon in coordinates if several else [coordinates] if kind == "Polygon" else []:
            try:
                rings = [[(float(x), float(y)) for x, y, *_ in ring] for ring in polygon]
            except (TypeError, ValueError, OverflowError):
                rings = []
            if not rings or not all(len(set(ring)) > 2 and np.isfinite(ring).all() for ring in rings):
                raise InputError(f"{name} is not valid GeoJSON: a polygon has at least 3 corners, each of 2 numbers.")
            yield {"type": "Polygon", "coordinates": [r if r[0] == r[-1] else [*r, r[0]] for r in rings]}


def crs_of(document: Mapping[str, Any], name: str) -> Any:
    """CRS that `document` (of file `name`) states, else longitude and latitude. Raises InputError if it is unknown."""
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    named = document.get("crs")
    try:
        return CRS.from_user_input(named["properties"]["name"] if named else LONGITUDE_LATITUDE)
    except (CRSError, KeyError, TypeError) as error:
        raise InputError(f"{name} names a CRS that is not known. Save it in EPSG:4326.") from error


def _raster_area(path: str, scene: Scene, option: str) -> Area:
    info = describe_file(path)
    if info.count > 1:
        raise InputError(f"{option} {path} has {info.count} bands, not one. Save one: gdal_translate -b 1 IN OUT.tif")
    apart = info.crs is None or scene.crs is None
    if apart and (info.height, info.width) == (scene.height, scene.width):
        info = replace(info, transform=None)  # a raster of the scene's size is assumed to be on its grid
    source, same = nearest_on(info, scene), same_grid(info, scene)
    if not same and (apart or info.transform is None or scene.transform is None):
        raise InputError(
            f"{option} {path} has {info.height} x {info.width} pixels, the scene {scene.height} x {scene.width}, and "
            "without a CRS in both it cannot be placed. Give a mask of the scene's size, or one with a CRS."
        )
    if not same and not overlap(replace(source.info, paths=(scene.path or "the scene",)), info):
        raise InputError(f"{option} {path} lies off the scene: they do not overlap. Check its CRS and geotransform.")
    return Area(Tile(0, scene.height, 0, scene.width), partial(_in_raster, source))


def middle_of(path: str) -> tuple[float, float]:
    """Latitude, longitude [degree] of the centre of a raster or of a GeoJSON's bounds. Raises InputError if unknown."""
    from rasterio.warp import transform

    if Path(path).suffix.lower() in (".geojson", ".json"):
        document = read_json(path, "--place")
        points = np.array([p for _kind, coordinates in geometries(document) for p in _points(coordinates)])
        if not len(points):
            raise InputError(f"{path} (--place) holds no point. Draw a point, a line or an area in it.")
        x, y = 0.5 * (points.min(axis=0) + points.max(axis=0))
        crs = crs_of(document, path)
    else:
        with open_dataset(path) as dataset:
            crs, (x, y) = dataset.crs, at(dataset.transform, 0.5 * dataset.width, 0.5 * dataset.height)
            if crs is None or dataset.transform.is_identity:
                raise InputError(f"{path} (--place) has no CRS or geotransform to place it. Give --lat and --lon.")
    try:
        (longitude,), (latitude,) = transform(crs, LONGITUDE_LATITUDE, [x], [y])
    except gdal_errors(ValueError) as error:
        raise InputError(f"{path} (--place) has no valid position: {one_line(error)}. Give --lat and --lon.") from error
    if not np.isfinite([latitude, longitude]).all() or abs(latitude) > 90.0:
        raise InputError(f"{path} (--place) has coordinates outside the valid area of its CRS. Give --lat and --lon.")
    return float(latitude), float(longitude)


def _points(node: object) -> Iterator[tuple[float, float]]:
    """Yield the points (x, y) in the coordinates of a geometry, which are lists nested to any depth."""
    if isinstance(node, list) and len(node) > 1 and all(isinstance(n, (int, float)) for n in node[:2]):
        yield float(node[0]), float(node[1])
    elif isinstance(node, list):
        for child in node:
            yield from _points(child)
