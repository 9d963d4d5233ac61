"""Put several files on one grid of pixels, and compute the size of pixels on the ground.

The common grid is that of the file with the smallest pixels, or of a selected file. When a window of another file is
read, GDAL resamples it to this grid: bilinearly, or by averaging if its pixels are smaller. Data types do not change.
"""

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import chain, groupby
from typing import Any, TypeVar

import numpy as np
from affine import Affine

from ..errors import InputError
from ..moments import Float64
from ..raster import FileBands, RasterInfo, RasterSource
from ..raster.info import describe_file, gdal_errors, one_line
from ..scene import Scene
from .bands import nominal_pixel
from .text import positive

Coordinate = TypeVar("Coordinate", float, Float64)
_SAME_CORNER = 0.01  # grids whose corners differ by less than this are taken as the same [pixel]
_GEOCENTRIC = "EPSG:4978"  # x, y, z from the centre of the WGS 84 ellipsoid [m]
_NEGLIGIBLE_DISTORTION = 0.01  # relative error up to which lengths of a projection are used (UTM has up to 0.001)


def put_on_grid(infos: Sequence[RasterInfo], grid: str | int | None) -> tuple[list[FileBands], RasterInfo, list[str]]:
    """Put files on one grid: return their bands in order, the description of the file with that grid, and notes.

    `grid` selects this file: "finest" or None (smallest pixels), its 1-based number, or the end of its name. Raises
    InputError if the files do not fit on one grid, or if `grid` selects no file or several.
    """
    for attribute, what in (("crs", "coordinate reference system"), ("transform", "geotransform")):
        without = [i.paths[0] for i in infos if getattr(i, attribute) is None]
        if len({(i.height, i.width) for i in infos}) > 1 and 0 < len(without) < len(infos):
            raise InputError(
                f"{without[0]} has no {what}, but another size than the other files. Georeference it, or leave it out."
            )
    areas = [_pixel_area(info, infos[0]) for info in infos]
    chosen = _choose(infos, areas, grid)
    reference = infos[chosen]
    files: list[FileBands] = []
    moved: dict[tuple[str, str], list[str]] = {}
    lost: list[str] = []
    for info, area in zip(infos, areas, strict=True):
        if same_grid(info, reference):
            files.append(FileBands.of(info))
            continue
        if not overlap(info, reference):
            raise InputError(f"{info.paths[0]} and {reference.paths[0]} do not overlap. Give files of the same area.")
        if info.flat is not None:
            lost.append(f"{_called(info)} is resampled, so that its vignette is not corrected")
        finer = area < 0.98 * areas[chosen]
        files += _warped(info, reference, how="average" if finer else "bilinear")
        how = "averaged" if finer else "resampled (bilinear)"
        moved.setdefault((how, info.tags.get("", {}).get("product") or info.paths[0]), []).append(_called(info))
    notes = [
        f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} {how} to the grid of {_called(reference)}"
        for (how, _), names in moved.items()
    ]
    return files, reference, notes + lost


def _called(info: RasterInfo) -> str:
    """Name of a file for use in notes; for a one-band file of a product, it is the name of the band."""
    return str(info.descriptions[0] if info.count == 1 and "product" in info.tags.get("", {}) else info.paths[0])


def _choose(infos: Sequence[RasterInfo], areas: Sequence[float], grid: str | int | None) -> int:
    if grid is None or grid == "finest":
        return next(i for i, area in enumerate(areas) if area <= min(areas) * (1 + 1e-9))
    text = str(grid)
    if text.isdecimal() and 1 <= int(text) <= len(infos):
        return int(text) - 1
    fits = [i for i, info in enumerate(infos) if info.paths[0].endswith(text)]
    if len(fits) != 1:
        raise InputError(
            f"grid: allowed are 'finest', a file number 1-{len(infos)} or a file name, got {grid!r}; "
            f"the files are {', '.join(i.paths[0] for i in infos)}"
        )
    return fits[0]


def _transform(info: RasterInfo | Scene) -> Affine:
    """The affine transform of a file; if it has none, the transform that maps the whole raster to the unit square."""
    if info.transform is not None:
        return info.transform
    return Affine(1 / info.width, 0.0, 0.0, 0.0, -1 / info.height, 1.0)


def overlap(info: RasterInfo, reference: RasterInfo) -> bool:
    """Whether bounds of two files overlap in the CRS of `reference`. Raises InputError if they cannot be transformed.

    If only `reference` is in degrees, longitudes that differ by 360 degrees count as equal. If both files are in
    degrees, such longitudes do not count as equal, because GDAL does not shift them when it resamples.
    """
    (left, bottom, right, top), (west, south, east, north) = (_bounds(i, reference) for i in (info, reference))
    degrees = [i.crs is not None and i.crs.is_geographic for i in (info, reference)]
    turn = 360.0 if degrees == [False, True] else 0.0
    beside = any(max(left + way, west) < min(right + way, east) for way in (-turn, 0.0, turn))
    return beside and max(bottom, south) < min(top, north)


def _pixel_area(info: RasterInfo, first: RasterInfo) -> float:
    """Area of a file's pixel, converted to the CRS of file `first` by the ratio of the bounds' areas in both CRS."""
    own, there = (abs((b[2] - b[0]) * (b[3] - b[1])) for b in (_bounds(info, info), _bounds(info, first)))
    return abs(float(_transform(info).determinant)) * (there / own if own else 1.0)


def _bounds(info: RasterInfo, first: RasterInfo) -> tuple[float, float, float, float]:
    """Bounds (left, bottom, right, top) of a file, in the CRS of file `first`."""
    xs, ys = zip(*(at(_transform(info), *corner) for corner in corners_of(info)), strict=True)
    left, bottom, right, top = min(xs), min(ys), max(xs), max(ys)
    if info.crs is not None and first.crs is not None and info.crs != first.crs:
        from rasterio.warp import transform_bounds

        try:
            if left == right or bottom == top:
                raise ArithmeticError("its pixels are too small for its coordinates")
            left, bottom, right, top = transform_bounds(info.crs, first.crs, left, bottom, right, top)
            right += 360.0 * (right < left)  # across 180 degrees
        except gdal_errors(ArithmeticError) as error:
            raise InputError(
                f"{info.paths[0]} cannot be placed in the CRS of {first.paths[0]}: {one_line(error)}. Check its CRS."
            ) from error
    return left, bottom, right, top


def same_grid(info: RasterInfo, reference: RasterInfo | Scene) -> bool:
    """Whether a file has the size, CRS and corners of `reference`; a missing CRS or transform counts as equal."""
    if (info.height, info.width) != (reference.height, reference.width):
        return False
    if info.crs != reference.crs and None not in (info.crs, reference.crs):
        return False
    if info.transform is None or reference.transform is None:
        return True
    back = ~reference.transform
    return all(math.dist(at(back, *at(info.transform, *corner)), corner) < _SAME_CORNER for corner in corners_of(info))


def corners_of(info: RasterInfo | Scene) -> list[tuple[int, int]]:
    """Column and row [pixel] of the four corners of a raster."""
    return [(column, row) for column in (0, info.width) for row in (0, info.height)]


def at(transform: Affine, x: Coordinate, y: Coordinate) -> tuple[Coordinate, Coordinate]:
    """Apply an affine transform to x and y (numbers or arrays); return the transformed x and y."""
    t = transform  # its operator * is not used, as it differs between versions of affine
    return t.a * x + t.b * y + t.c, t.d * x + t.e * y + t.f


def nearest_on(info: RasterInfo, grid: RasterInfo | Scene) -> RasterSource:
    """Source that reads a file, resampled to `grid` by nearest neighbour."""
    files = [FileBands.of(info)] if same_grid(info, grid) else _warped(info, grid, how="nearest")
    place = {name: getattr(grid, name) for name in ("height", "width", "crs", "transform")}
    return RasterSource(files, replace(info, **place, nodatas=tuple(n for file in files for n in file.nodatas)))


def footprints_on(grid: RasterInfo, paths: Sequence[str]) -> RasterSource:
    """Source of detector numbers: which detector took each pixel of `grid` in each band; NaN where no detector did.

    `paths` are the GDAL names of the MSK_DETFOO files of Sentinel-2, one per band. Since processing baseline 04.00,
    these files are rasters; the GML files of older products are not read.
    """
    each = [nearest_on(replace(info, nodatas=(0.0,) * info.count), grid) for info in map(describe_file, paths)]
    return RasterSource([one.files[0] for one in each], joined([one.info for one in each], each[0].info))


def joined(infos: Sequence[RasterInfo], reference: RasterInfo) -> RasterInfo:
    """Join descriptions of files into one with all bands in order, and with the grid and format of `reference`."""
    every = [f.name for f in fields(RasterInfo) if isinstance(getattr(reference, f.name), tuple) and f.name != "gcps"]
    of_bands: dict[str, Any] = {name: tuple(chain(*(getattr(info, name) for info in infos))) for name in every}
    return replace(reference, **of_bands, alpha=None)


def _warped(info: RasterInfo, reference: RasterInfo | Scene, *, how: str) -> list[FileBands]:
    """The bands of a file, which GDAL resamples to the grid of `reference` at each read, by rasterio's method `how`.

    GDAL can ignore only one nodata value per file. Therefore each run of bands with the same value is one `FileBands`.
    """
    from rasterio.crs import CRS
    from rasterio.enums import Resampling

    if info.alpha is None and any("alpha" in flags for flags in info.mask_flags):
        raise InputError(
            f"{info.paths[0]}: a band that GDAL takes for alpha cannot be resampled as data. Declare it as data: "
            f"gdal_edit.py -colorinterp_{info.count} undefined {info.paths[0]}"
        )
    anywhere = CRS.from_epsg(3857)  # any CRS will do for files without one: they lie in the same plane
    warp: dict[str, object] = {
        "src_crs": info.crs or reference.crs or anywhere,
        "src_transform": _transform(info) if info.transform is None else None,
        "crs": reference.crs or info.crs or anywhere,
        "transform": _transform(reference),
        "height": reference.height,
        "width": reference.width,
        "resampling": Resampling[how],
        "tolerance": 1e-4,  # [pixel]; largest difference between the places of a pixel that is read in two windows
        "src_nodata": None,
        "nodata": None,
        "UNIFIED_SRC_NODATA": "NO",  # a pixel may be nodata in one band alone, or masked
        "add_alpha": info.alpha is None,
    }
    # no flat field: it holds only for pixels that are not resampled
    whole = replace(FileBands.of(info), warp=warp, alpha=info.alpha or info.count + 1, masked=False, flat=None)
    nodatas = [math.nan if n is None and "float" in d else n for n, d in zip(info.nodatas, info.dtypes, strict=True)]
    groups = groupby(zip(whole.indexes, nodatas, strict=True), key=lambda band: str(band[1]))
    each = [zip(*group, strict=True) for _, group in groups]
    return [replace(whole, indexes=indexes).declared(alike) for indexes, alike in each]


def ground_size(transform: Affine | None, crs: Any, height: int, width: int) -> tuple[float, float] | None:
    """Sides on the ground [m], along a row and a column, of the central pixel of a raster of `height` x `width` pixels.

    They are distances on the ellipsoid: coordinates may be in degrees, and web Mercator multiplies lengths by
    1 / cos(latitude). Lengths in the CRS within 1 % of them are returned instead. None without CRS or transform.
    """
    from rasterio.warp import transform as to_crs

    if transform is None or crs is None or transform.is_identity:
        return None
    x, y = at(transform, 0.5 * width, 0.5 * height)
    steps = (transform.a, transform.d), (transform.b, transform.e)
    xs, ys = zip(*((x + end * dx, y + end * dy) for dx, dy in steps for end in (-0.5, 0.5)), strict=True)
    try:
        places = np.array(to_crs(crs, _GEOCENTRIC, xs, ys, zs=[0.0] * 4))
    except gdal_errors(ValueError):
        return None
    across, down = np.linalg.norm(places[:, 1::2] - places[:, ::2], axis=0).tolist()
    if not all(0.0 < side < math.inf for side in (across, down)):
        return None
    if crs.is_projected:
        unit = float(crs.linear_units_factor[1])
        stated = unit * math.hypot(*steps[0]), unit * math.hypot(*steps[1])
        if all(abs(found - s) <= _NEGLIGIBLE_DISTORTION * s for found, s in zip((across, down), stated, strict=True)):
            return stated
    return across, down


def pixel_size(scene: Scene) -> float | None:
    """Geometric mean of a pixel's sides on the ground [m]; None if it is not known.

    Without a transform or a CRS, the value is that of the tag GSD_M or, if this is missing, the nominal value of the
    sensor.
    """
    info = getattr(scene.source, "info", None)
    if scene.transform is None or scene.transform.is_identity or scene.crs is None:
        tags = info.tags.get("", {}) if info is not None else {}
        return positive(tags.get("GSD_M")) or nominal_pixel(scene)
    sides = ground_size(scene.transform, scene.crs, scene.height, scene.width)
    return None if sides is None else math.sqrt(sides[0] * sides[1])


def ground_area(transform: Affine | None, crs: Any, height: int, width: int) -> float | None:
    """Area on the ground [m2] of a raster's central pixel, which may be a parallelogram; None if it is not known."""
    sides = ground_size(transform, crs, height, width)
    if sides is None or transform is None:
        return None
    lengths = math.hypot(transform.a, transform.d) * math.hypot(transform.b, transform.e)
    return sides[0] * sides[1] * abs(transform.determinant) / lengths
