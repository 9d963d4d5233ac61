"""Open an xarray DataArray as a `Scene`: identify its dimensions, bands and georeferencing.

Arrays may come from rioxarray, odc-stac or stackstac; xarray is not imported. Bands are identified like those of files.
"""

import math
import re
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from affine import Affine

from ..errors import InputError
from ..raster import RasterInfo
from ..raster.source import ArraySource
from ..scene import Scene
from .bands import bands_of
from .grid import at
from .opening import with_nodata
from .spectral import nominal_wavelength

if TYPE_CHECKING:
    from xarray import DataArray

_ROWS = ("y", "latitude", "lat", "northing", "row", "rows")
_COLUMNS = ("x", "longitude", "lon", "easting", "column", "columns", "col")
BANDS = ("band", "bands", "wavelength", "wavelengths", "variable", "channel")
_NODATA_NAMES = ("nodata", "_FillValue", "missing_value")
_SCALE_NAMES, _OFFSET_NAMES = ("scale_factor", "scales"), ("add_offset", "offsets")
PER_BAND = dict.fromkeys(_NODATA_NAMES, np.nan) | dict.fromkeys(_SCALE_NAMES, 1.0) | dict.fromkeys(_OFFSET_NAMES, 0.0)
"""Attributes that may have one entry per band; for each, the value that is assumed if the attribute is missing."""
_EVENLY_SPACED = 0.1  # allowed difference between coordinates and those of a regular grid [pixel]
_CLOSE = 1e-3  # allowed difference between coordinates and a declared transform [pixel]


@dataclass(frozen=True, eq=False)
class ArrayScene:
    """A scene made from a DataArray. Its methods convert results to DataArrays; a lazy (dask) array stays lazy."""

    scene: Scene
    values: Any  # numpy or dask array (band, row, column)
    array: "DataArray"  # the DataArray that was given
    _ordered: "DataArray"  # `array` with the dimensions band (if it has one), rows and columns only, in this order

    def like(self, values: Any) -> "DataArray":
        """A DataArray with `values` (band, row, column), and the dimensions and attributes of the original array."""
        out = self._ordered.copy(data=values if self._ordered.ndim == 3 else values[0])
        further = [d for d in self.array.dims if d not in out.dims]
        found = self.array.copy(data=out.expand_dims(further).transpose(*self.array.dims).data)
        if found.dtype != self.array.dtype:
            found.encoding = {k: v for k, v in found.encoding.items() if k == "grid_mapping"}
        return found

    def plane(self, values: Any, name: str) -> "DataArray":
        """A DataArray called `name` with `values` (row, column); its only attributes are those for georeferencing."""
        out = self._ordered.isel(dict.fromkeys(self._ordered.dims[:-2], 0), drop=True).copy(data=values)
        out.name = name
        out.attrs = {k: v for k, v in out.attrs.items() if k in ("grid_mapping", "crs", "transform", "resolution")}
        out.encoding = {k: v for k, v in out.encoding.items() if k == "grid_mapping"}
        return out


def open_array(array: "DataArray", *, sensor: str | None = None, nodata: float | str | None = None) -> ArrayScene:
    """Open a DataArray as a scene; no pixel is computed.

    Raises InputError if an argument is not valid, and BandError if the bands do not match those of `sensor`.

    array : its dimensions are y and x (or latitude and longitude, ...), and band if there are several bands, in any
        order; other dimensions, such as time, have the size 1. Wavelengths (in um if at most 30, else in nm) or common
        names ("red") of the bands are read from coordinates or attributes
    sensor : name of a sensor preset or of a .toml file, as in `deglint.open_scene`
    nodata : nodata value (or NaN), which overrides that of the array; with "none", every value is valid
    """
    if not all(hasattr(array, name) for name in ("dims", "coords", "attrs", "encoding", "data")):
        raise InputError(f"want an xarray DataArray, got {type(array).__name__}. Take deglint.open_scene for files.")
    rows, columns, band = axes(array)
    for d, n in zip(array.dims, array.shape, strict=True):
        if d not in (rows, columns, band) and n != 1:
            raise InputError(f"dimension {d} has {n} entries: pass one at a time, such as array.isel({d}=0).")
    dims = [d for d in (band, rows, columns) if d is not None]
    ordered = array.squeeze([d for d in array.dims if d not in dims]).transpose(*dims)
    values = ordered.data if band is not None else ordered.data[None]
    if 0 in values.shape:
        raise InputError(f"the array holds no pixel: shape {dict(zip(array.dims, array.shape, strict=True))}.")
    notes: list[str] = []
    info = with_nodata(_info(array, values, band, rows, columns), nodata, notes)
    bands, preset, told = bands_of(info, [""] * info.count, sensor)
    source, notes = ArraySource(values, info), [*notes, *told]
    place = info.paths[0], info.crs, info.transform
    scene = Scene(tuple(bands), info.height, info.width, source, *place, sensor=preset, notes=tuple(notes))
    return ArrayScene(scene, values, array, ordered)


def axes(array: "DataArray") -> tuple[Hashable, Hashable, Hashable]:
    """Names of the row, column and band dimensions (None: no bands). InputError if rows or columns are not found."""
    known = {str(d).lower(): d for d in array.dims}
    rows, columns, band = (next((known[n] for n in names if n in known), None) for names in (_ROWS, _COLUMNS, BANDS))
    said = ", ".join(f"{d} {n}" for d, n in zip(array.dims, array.shape, strict=True))
    if rows is None or columns is None:
        raise InputError(f"want dimensions y and x (or latitude and longitude), got {said}. Rename yours.")
    return rows, columns, band


def _info(array: "DataArray", values: Any, band: Hashable, rows: Hashable, columns: Hashable) -> RasterInfo:
    count, height, width = values.shape
    if values.dtype.kind not in "fiu":
        raise InputError(f"want integers or real numbers, got {values.dtype}. Convert the array first.")
    dtype = values.dtype.newbyteorder("=").name
    chunks = getattr(values, "chunks", None)
    block = (chunks[1][0], chunks[2][0]) if chunks else (height, width)
    lists = _lists(array, band, count)
    names, tags = _bands(array, band, count, lists)
    named = array.encoding.get("grid_mapping", array.attrs.get("grid_mapping", "spatial_ref"))
    grid: Mapping[str, Any] = array.coords[named].attrs if named in array.coords else {}
    stated = {**array.attrs, **lists}
    encoded = array.encoding if array.dtype.kind in "iu" else {}  # in floating-point arrays nodata has become NaN
    return RasterInfo(
        paths=(str(array.name) if array.name else "the array",),
        driver="MEM",
        height=height,
        width=width,
        dtypes=(dtype,) * count,
        nodatas=_per_band([stated, encoded], _NODATA_NAMES, None, count),
        scales=_per_band([stated], _SCALE_NAMES, 1.0, count),
        offsets=_per_band([stated], _OFFSET_NAMES, 0.0, count),
        descriptions=names,
        units=(None,) * count,
        colorinterp=("undefined",) * count,
        tags={"": {str(k): _text(v) for k, v in array.attrs.items() if k not in lists}},
        band_tags=tuple({"": t} for t in tags),
        mask_flags=(("all_valid",),) * count,
        block_shapes=(block,) * count,
        crs=_crs(array, grid),
        transform=_transform(array, grid, rows, columns),
    )


def _lists(array: "DataArray", band: Hashable, count: int) -> dict[Any, list[Any]]:
    """Attributes that are lists with one entry per band, reduced to the entries of the `count` bands in the array.

    `band` is the name of the band dimension, or None. If a user selects bands in xarray, such lists still have the
    entries of all bands. If the band coordinate has numbers from 1, as in rioxarray, these numbers select the entries.
    """
    name = "band" if band is None else band
    known = name in array.coords and array.coords[name].dtype.kind in "iu"
    numbers = np.asarray(array.coords[name].values).reshape(-1) if known else np.arange(1, count + 1)
    if len(numbers) != count or numbers.min() < 1:
        return {}
    lists = {k: v for k, v in array.attrs.items() if isinstance(v, (list, tuple, np.ndarray))}
    fits = {k: v for k, v in lists.items() if numbers.max() <= len(v) and (known or len(v) == count)}
    return {k: [_plain(v[n - 1]) for n in numbers] for k, v in fits.items()}


def _bands(
    array: "DataArray", band: Hashable, count: int, lists: Mapping[Any, list[Any]]
) -> tuple[tuple[str | None, ...], list[dict[str, str]]]:
    """Name (or None) and tags of each band, from coordinates along the dimension `band` and `lists` (see `_lists`)."""
    along = {
        str(name): [_plain(v) for v in np.asarray(coord.values).reshape(-1)]
        for name, coord in array.coords.items()
        if coord.dims == (() if band is None else (band,)) and coord.size == count and str(name) != "spatial_ref"
    }
    described = lists.get("long_name", [array.attrs.get("long_name") if count == 1 else None])
    candidates = [described, *(along.get(k, [None]) for k in (str(band), "band", "common_name", "title"))]
    worded = [c for c in candidates if all(isinstance(v, str) and v for v in c)]
    said = {str(k): v for k, v in lists.items()} | along
    tags = []
    for i in range(count):
        own = {k.replace("full_width_half_max", "fwhm"): _text(v[i]) for k, v in said.items() if k != "band"}
        common = nominal_wavelength(str(own.get("common_name", "")))
        if common and not any("wave" in k and re.search(r"\d", v) for k, v in own.items()):
            own["wavelength_nm"] = f"{common:g}"
        tags.append({k: v for k, v in own.items() if v not in ("", "None", "nan")})
    return tuple(worded[0] if worded else [None] * count), tags


def _per_band(places: list[dict[Any, Any]], names: Sequence[str], default: float | None, count: int) -> tuple[Any, ...]:
    stated = (_floats(place.get(name)) for place in places for name in names)
    found = next((numbers for numbers in stated if len(numbers) in (1, count)), [default])
    return tuple(found) * (count // len(found))


def _floats(value: object) -> list[float]:
    try:
        return [float(v) for v in np.asarray(value, np.float64).reshape(-1)] if value is not None else []
    except (TypeError, ValueError, OverflowError):
        return []


def _plain(value: object) -> Any:
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def _text(value: object) -> str:
    """Convert the value of an attribute to text for a tag; a list of 1 and 2 becomes "{1, 2}"."""
    value = _plain(value)
    return "{" + ", ".join(str(_plain(v)) for v in value) + "}" if isinstance(value, (list, tuple)) else str(value)


def _crs(array: "DataArray", grid: Mapping[str, Any]) -> Any:
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    epsg = array.coords["epsg"].item() if "epsg" in array.coords and array.coords["epsg"].size == 1 else None
    said = (grid.get("crs_wkt"), grid.get("spatial_ref"), array.attrs.get("crs"), epsg)
    try:
        return next((CRS.from_user_input(text) for text in said if text is not None), None)
    except (CRSError, TypeError, ValueError):
        return None


def _transform(array: "DataArray", grid: Mapping[str, Any], rows: Hashable, columns: Hashable) -> Affine | None:
    """Affine transform of an array, from its coordinates along the dimensions called `rows` and `columns`.

    A transform that `grid` (the attributes of the grid mapping) or the array declares has exact numbers. It is returned
    if it agrees with the coordinates, or if there are no coordinates. The result is None if the array has neither a
    transform nor coordinates. Raises InputError if the coordinates are not evenly spaced.
    """
    numbers, given = _floats(str(grid.get("GeoTransform", "")).split()), _floats(array.attrs.get("transform"))
    stated = Affine.from_gdal(*numbers) if len(numbers) == 6 else Affine(*given[:6]) if len(given) in (6, 9) else None
    if stated is not None and not 0 < abs(stated.determinant) < math.inf:
        stated = None
    x, y = (array.coords[d].values if d in array.coords else np.empty(0) for d in (columns, rows))
    steps = []
    for name, along, declared in ((columns, x, stated.a if stated else 0.0), (rows, y, stated.e if stated else 0.0)):
        if along.ndim != 1 or not along.size or along.dtype.kind not in "fiu":
            return stated
        step = (float(along[-1]) - float(along[0])) / (len(along) - 1) if len(along) > 1 else declared
        rounding = float(np.finfo(along.dtype).eps * abs(along).max()) if along.dtype.kind == "f" else 0.0
        if (abs(along - float(along[0]) - step * np.arange(len(along))) > _EVENLY_SPACED * abs(step) + rounding).any():
            raise InputError(
                f"coordinates {name} are not evenly spaced. Resample the array to a regular grid, or leave them out: "
                f"array.drop_vars({name!r})."
            )
        steps.append(step)
    across, down = steps
    if not across or not down:
        return stated
    own = Affine(across, 0.0, float(x[0]) - across / 2, 0.0, down, float(y[0]) - down / 2)
    if stated is None:
        return own
    first, last = (at(~stated, *at(own, *corner)) for corner in ((0, 0), (len(x), len(y))))
    same_size = all(abs(b - a - n) < _CLOSE for a, b, n in zip(first, last, (len(x), len(y)), strict=True))
    # coordinates are of the centres of pixels, or of their corners (stackstac)
    return stated if same_size and any(all(abs(a - shift) < _CLOSE for a in first) for shift in (0.0, -0.5)) else own
