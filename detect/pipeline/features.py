"""Output of detected objects: position, size and motion on the ground; pictures; files in GeoJSON or GeoPackage."""

import math
import sqlite3
import struct
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rasterio.features import bounds
from rasterio.warp import transform as warp

from deglint.errors import DeglintError, InputError
from deglint.physics import EARTH_RADIUS
from deglint.plotting import natural_colour
from deglint.raster.info import gdal_errors
from deglint.raster.output import Scratch, write_bytes, write_json, write_text
from deglint.readers import open_scene
from deglint.readers.grid import at
from deglint.readers.text import read_json
from deglint.scene import Scene
from deglint.tiles import Tile

from ..moving import FASTEST, Mover, motions_in
from ..objects import Move, Object
from ..sea.region import rectangle
from .recipe import PICTURE

_SEARCH_MARGIN = 40  # margin of water around an object in the search for its motion [pixel]: contrast is relative to it
_UNKNOWN: dict[str, float | None] = {"speed_m_s": None, "heading": None}  # motion of an object that shows none
_ROUND = 1.3  # ratio of length to width below which an object has no bearing
CHIP_SIDE = 64  # minimum side of the part of the scene in the picture of an object, the chip [pixel of the scene]
_CHIP_MARGIN = 12  # margin around an object in its picture [pixel of the scene]
_SIZE = 192  # minimum side of a panel [pixel of the picture]
_GAP = ((0, 0), (0, 4), (0, 0))  # white margin at the right of a panel [pixel of the picture]


def to_wgs84(scene: Scene) -> Move | None:
    """Make the function that converts (column, row) points to (longitude, latitude) [degree].
    The result is None if the scene has no transform or no CRS, or if the CRS cannot convert the centre of the scene.
    The function raises InputError for points that the CRS cannot convert. (0, 0) is the upper left corner of the scene.
    """
    transform, crs = scene.transform, scene.crs
    if transform is None or crs is None:
        return None

    def move(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        xs, ys = zip(*(at(transform, x, y) for x, y in points), strict=True)
        try:
            places = np.array(warp(crs, "OGC:CRS84", xs, ys)[:2])
        except gdal_errors(ValueError):
            places = np.array([[math.inf]])
        if not np.isfinite(places).all():
            raise InputError(f"objects of {scene.path} lie outside the valid area of its CRS. Exclude them: --mask.")
        return [(x, y) for x, y in places.T.tolist()]

    try:
        move([(scene.width / 2, scene.height / 2)])
    except InputError:
        return None
    return move


def distance_and_bearing(start: tuple[float, float], end: tuple[float, float]) -> tuple[float, float]:
    """Distance [m] and initial bearing [degree clockwise from north] from `start` to `end`, (longitude, latitude)."""
    (lon0, lat0), (lon1, lat1) = (tuple(map(math.radians, p)) for p in (start, end))
    half = math.sin((lat1 - lat0) / 2) ** 2 + math.cos(lat0) * math.cos(lat1) * math.sin((lon1 - lon0) / 2) ** 2
    east = math.sin(lon1 - lon0) * math.cos(lat1)
    north = math.cos(lat0) * math.sin(lat1) - math.sin(lat0) * math.cos(lat1) * math.cos(lon1 - lon0)
    return 2 * EARTH_RADIUS * math.asin(min(math.sqrt(half), 1.0)), math.degrees(math.atan2(east, north)) % 360


def delayed_bands(scene: Scene, bands: Sequence[int]) -> tuple[list[int], list[float]]:
    """Those of the 0-based `bands` with a known time offset, and these offsets [s].
    Raises InputError if fewer than three differ.
    """
    known = [(b, t) for b in bands if (t := scene.bands[b].time_offset) is not None]
    if (count := len({t for _, t in known})) < 3:
        raise InputError(
            f"--moving needs three bands with known, different times; of those in use in {scene.path}, {count} differ. "
            "Choose more with -b, name the sensor with --sensor, or set time_offset_s in the bands' tags."
        )
    return [b for b, _ in known], [t for _, t in known]


def motions(
    scene: Scene, bands: Sequence[int], area: float | None, found: Sequence[Object]
) -> list[dict[str, float | None]]:
    """A dictionary for each object in `found`: `speed_m_s` [m/s] and `heading` [degree clockwise from north].

    The motion is measured in those of the 0-based `bands` that have a time, before glint removal where that image is at
    hand, as removal shifts the edges of boats. It is that of the brightest boat (`detect.moving`) that is no farther
    from the object than its diagonal plus the distance that the fastest boat travels from the first to the last band.
    Both numbers are None if there is none, or if it is not bright enough beside motions by chance near all objects.
    Raises InputError if `area` (of a pixel [m2]), the CRS, or three different times are not known.
    """
    bands, times = delayed_bands(scene, bands)
    move = to_wgs84(scene)
    if area is None or move is None:
        raise InputError(f"--moving needs the size of a pixel; {scene.path} has no CRS of Earth. Leave out --moving.")
    raw = next((r for r in _raw_of(scene) if r.names == scene.names), scene)
    pixel, least, boats = math.sqrt(area), 0.0, list[Mover | None]()
    reach = math.ceil(FASTEST * (max(times) - min(times)) / pixel)
    for o in found:
        near = Tile(*o.bounds[0], *o.bounds[1]).grown(_SEARCH_MARGIN + reach, scene.height, scene.width)
        movers, dim = motions_in(raw.read(near.window, bands=bands), times, pixel=pixel)
        least = max(least, dim)
        placed = [replace(m, row=near.row0 + m.row, column=near.col0 + m.column) for m in movers]
        far = reach + math.hypot(*o.footprint.shape)
        close = [m for m in placed if math.hypot(m.row - o.centroid[0], m.column - o.centroid[1]) <= far]
        boats.append(max(close, key=lambda m: m.contrast, default=None))
    return [_on_the_ground(m, pixel, move) if m and m.contrast > least else _UNKNOWN for m in boats]


def _on_the_ground(boat: Mover, pixel: float, move: Move) -> dict[str, float | None]:
    """Speed and heading of a boat on the ground, see `motions`; `pixel` is the side of a pixel [m]."""
    x, y = boat.column + 0.5, boat.row + 0.5
    angle = np.radians(boat.heading)  # clockwise from the columns of the image, which need not point north
    start, end = move([(x, y), (x + float(np.sin(angle)), y - float(np.cos(angle)))])
    ground, heading = distance_and_bearing(start, end)  # of one pixel that way: a pixel need not be square
    return {"speed_m_s": boat.speed / pixel * ground, "heading": heading}


def described(found: Object, kind: str, rate: float, real: float, move: Move | None) -> dict[str, object]:
    """Properties of an object: score, rates, kind, bearing; with `move` (see `to_wgs84`) also position and size [m].
    `kind`, `rate` [1/km2] and `real` are as in `detect.sea.search.Rated`. The score is -log10(rate), or `score_max` if
    the rate is not known. The bearing of the longer side is None without `move`, or if the object is nearly round.
    """
    known = math.isfinite(rate)
    numbers: dict[str, object] = {
        "score": -math.log10(max(rate, 1e-300)) if known else found.score_max,
        "false_per_km2": rate if known else None,
        "probability": real if math.isfinite(real) else None,
        "kind": kind,
    }
    length, width, angle = rectangle(found.footprint)
    bearing = None
    if move is not None:
        row, column = found.centroid
        x, y = column + 0.5, row + 0.5
        across, up = math.sin(math.radians(angle)), -math.cos(math.radians(angle))
        centre, along, beside = move([(x, y), (x + across, y + up), (x - up, y + across)])
        unit, direction = distance_and_bearing(centre, along)
        length, width = length * unit, width * distance_and_bearing(centre, beside)[0]
        bearing = direction % 180 if length >= _ROUND * width else None
        numbers |= {"longitude": centre[0], "latitude": centre[1], "length_m": length, "width_m": width}
    return numbers | {"bearing": bearing}


def write_chips(scene: Scene, folder: Path, scores: Any, found: Sequence[Object], scratch: Scratch) -> list[str]:
    """Write a picture (PNG) of every object in `found` into a folder; return "FOLDER/NAME" of each picture.

    Each shows the scene before glint removal (if the sidecar names its file), the scene, and `scores`, an open raster.
    """
    folder.mkdir(parents=True, exist_ok=True)
    scenes, names = [*_raw_of(scene), scene], list[str]()
    for o in found:
        rows, columns = (_around(*ends, size) for ends, size in zip(o.bounds, scene.shape[1:], strict=True))
        images = [each.read((rows, columns), bands=each.rgb(range(len(each.bands)))) for each in scenes]
        images.append(np.stack([scores.read(1, window=(rows, columns))] * 3))
        panels = [natural_colour([image])[0] for image in images]
        times = max(-(-_SIZE // max(panels[0].shape[:2])), 1)
        large = [np.pad(p.repeat(times, axis=0).repeat(times, axis=1), _GAP, constant_values=255) for p in panels]
        name = PICTURE.format(o.label)
        _done, png = cv2.imencode(".png", np.hstack(large)[:, :, ::-1])
        write_bytes(scratch, folder / name, bytes(png))
        names.append(f"{folder.name}/{name}")
    return names


def _around(start: int, stop: int, size: int) -> tuple[int, int]:
    """Half-open range of rows (or columns) of the picture of an object at `start` to `stop`, within 0 to `size`."""
    side = min(max(stop - start + 2 * _CHIP_MARGIN, CHIP_SIDE), size)
    low = min(max((start + stop - side) // 2, 0), size - side)
    return low, low + side


def _raw_of(scene: Scene) -> list[Scene]:
    """Scene before glint removal, in a list; empty if the sidecar names no readable files of a scene of this size."""
    try:
        raw = open_scene([file["path"] for file in read_json(f"{scene.path}.json", "sidecar")["input"]])
    except (DeglintError, KeyError, TypeError):
        return []
    return [raw] if raw.shape[1:] == scene.shape[1:] else []


def write_features(scratch: Scratch, path: Path, document: dict[str, Any], *, geographic: bool) -> None:
    """Write the FeatureCollection `document` as GeoJSON, or to a .gpkg file as GeoPackage with a QGIS style (.qml).

    The GeoPackage (OGC 12-128r19) has a layer `objects`, in longitude and latitude if `geographic`, else (column, row).
    """
    if path.suffix.lower() != ".gpkg":
        write_json(scratch, path, document)
        return
    place = scratch.add(path)
    place.unlink(missing_ok=True)
    sql, style = (files(__package__ or "").joinpath(n).read_text("utf-8") for n in ("geopackage.sql", "objects.qml"))
    write_text(scratch, path.with_suffix(".qml"), style)
    rows = [row["properties"] for row in document["features"]]
    types = {int: "INTEGER", float: "REAL"}
    known = {k: v for row in rows for k, v in dict.fromkeys(row, 0.0).items()}  # numbers, if all are null
    known |= {k: v for row in rows for k, v in row.items() if v is not None}
    columns = {k: types.get(type(v), "TEXT") for k, v in known.items()}
    srs = 4326 if geographic else -1
    whole = bounds(document) if rows else (None,) * 4
    with closing(sqlite3.connect(place)) as db, db:  # sqlite3 ends the transaction, and does not close
        db.executescript(sql)
        declared = "".join(f', "{name}" {kind}' for name, kind in columns.items())
        db.execute(f"CREATE TABLE objects (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom MULTIPOLYGON{declared})")
        layer = "table_name, data_type, identifier, min_x, min_y, max_x, max_y, srs_id"
        values = "'objects', 'features', 'objects', ?, ?, ?, ?, ?"
        db.execute(f"INSERT INTO gpkg_contents ({layer}) VALUES ({values})", (*whole, srs))
        db.execute("INSERT INTO gpkg_geometry_columns VALUES ('objects', 'geom', 'MULTIPOLYGON', ?, 0, 0)", (srs,))
        insert = f"INSERT INTO objects VALUES (NULL, ?{', ?' * len(columns)})"
        for row, feature in zip(rows, document["features"], strict=True):
            cells = (str(v) if isinstance(v := row.get(c), list) else v for c in columns)
            db.execute(insert, (_binary(feature["geometry"], srs), *cells))


def _binary(geometry: dict[str, Any], srs: int) -> bytes:
    """Encode a GeoJSON (multi-)polygon for a GeoPackage: header (CRS number `srs`, extent), then WKB multi-polygon."""
    left, low, right, high = bounds(geometry)
    polygons = [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]
    head = struct.pack("<2sBBi4d", b"GP", 0, 0b011, srs, left, right, low, high)
    out = [head, struct.pack("<BII", 1, 6, len(polygons))]
    for rings in polygons:
        out.append(struct.pack("<BII", 1, 3, len(rings)))
        out += [struct.pack(f"<I{2 * len(ring)}d", len(ring), *(x for p in ring for x in p[:2])) for ring in rings]
    return b"".join(out)
