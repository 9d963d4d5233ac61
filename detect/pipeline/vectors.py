"""Write objects as GeoJSON, or as GeoPackage with a style for QGIS; coordinates are longitude and latitude (WGS 84)."""

import sqlite3
import struct
from importlib.resources import files
from pathlib import Path
from typing import Any

from deglint.raster.output import Scratch, write_json, write_text


def write_features(scratch: Scratch, path: Path, document: dict[str, Any], *, geographic: bool) -> None:
    """Write features as GeoJSON, or for the extension .gpkg as GeoPackage with a QGIS style file (.qml) beside it.

    A GeoPackage (OGC 12-128r19) has one layer, `objects`. Its coordinates are longitude and latitude where
    `geographic`, else pixels.
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
    columns = {k: types.get(type(v), "TEXT") for row in rows for k, v in row.items() if v is not None}
    srs = 4326 if geographic else -1
    drawn = [feature["geometry"] for feature in document["features"]]
    shapes = [[g["coordinates"]] if g["type"] == "Polygon" else list(g["coordinates"]) for g in drawn]
    boxes = [_box(polygons) for polygons in shapes]
    whole = [f(b[i] for b in boxes) if boxes else None for i, f in enumerate((min, min, max, max))]
    with sqlite3.connect(place) as db:
        db.executescript(sql)
        declared = "".join(f', "{name}" {kind}' for name, kind in columns.items())
        db.execute(f"CREATE TABLE objects (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom MULTIPOLYGON{declared})")
        db.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, max_y, srs_id) "
            "VALUES ('objects', 'features', 'objects', ?, ?, ?, ?, ?)", (*whole, srs),
        )  # fmt: skip
        db.execute("INSERT INTO gpkg_geometry_columns VALUES ('objects', 'geom', 'MULTIPOLYGON', ?, 0, 0)", (srs,))
        names = "".join(f', "{name}"' for name in columns)
        marks = ",?" * len(columns)
        db.executemany(
            f"INSERT INTO objects (geom{names}) VALUES (?{marks})",
            [(_binary(polygons, srs, box), *(str(v) if isinstance(v := row.get(c), list) else v for c in columns))
             for row, polygons, box in zip(rows, shapes, boxes, strict=True)],
        )  # fmt: skip
    db.close()


def _box(polygons: list[Any]) -> tuple[float, float, float, float]:
    xs, ys = zip(*(point[:2] for polygon in polygons for point in polygon[0]), strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def _binary(polygons: list[Any], srs: int, box: tuple[float, float, float, float]) -> bytes:
    """GeoPackage header with an envelope, and the geometry as well-known binary of a multi-polygon."""
    head = struct.pack("<2sBBi4d", b"GP", 0, 0b011, srs, box[0], box[2], box[1], box[3])
    out = [head, struct.pack("<BII", 1, 6, len(polygons))]
    for rings in polygons:
        out.append(struct.pack("<BII", 1, 3, len(rings)))
        out += [struct.pack(f"<I{2 * len(ring)}d", len(ring), *(x for p in ring for x in p[:2])) for ring in rings]
    return b"".join(out)
