"""Read the properties of a raster file, which are copied to an output.

Only the header and the tags of a file are read, never a pixel. Every error message is one line, and distinguishes a
missing file from one that GDAL cannot read.
"""

import re
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine

from ..errors import InputError, ReadError
from .convert import FlatField, same_nodata
from .environment import check_size

Tags = Mapping[str, Mapping[str, str]]  # values of tags, by namespace and name; the default namespace is ""

_DERIVED_NAMESPACES = frozenset({"IMAGE_STRUCTURE", "DERIVED_SUBDATASETS", "SUBDATASETS", "COLOR_PROFILE"})
REMOTE_NAME = re.compile(
    r"(https?|ftp|s3|gs|az|oss|swift|hdfs)://|/vsi(curl|s3|gs|az|adls|oss|swift|webhdfs)", re.IGNORECASE
)
_HEAD = 512  # bytes of a file that are read to recognise its format
_OTHERWISE = "Name the raster itself, or convert it to GeoTIFF where it can be read"
_FILE_KINDS = (
    (rb"\Z", "is empty: copying or downloading it has failed. Do that again"),
    (rb"\x00+\Z", "holds zeros where its header should be: copying or downloading it has failed. Do that again"),
    (rb"\s*(?:<!doctype html|<html)", "is a web page. Log in where the image lies, and download the file again"),
    (rb"version https://git-lfs", "is a pointer of Git LFS, not the image itself. Fetch it: git lfs pull"),
    (rb"ENVI\s", "is the header of an ENVI file. Name the image beside it"),
    (rb"PK\x03\x04", "is a zip archive. Unpack it, or name the raster in it: /vsizip/{path}/NAME"),
    (rb"\x1f\x8b", "is packed with gzip. Unpack it, or name it /vsigzip/{path}"),
    (rb"II[*+]\x00|MM\x00[*+]", "begins as a TIFF and is damaged. Copy or download it again"),
    (rb"[\t\n\r\x20-\x7e\x80-\xff]+\Z", f"is a text file. {_OTHERWISE}"),
    (rb"", f"is of no format that is known. {_OTHERWISE}"),
)
"""Patterns of the first bytes of a file; and for each, what such a file is, and a remedy. The first match counts."""
_opening = threading.Lock()


@dataclass(frozen=True)
class RasterInfo:
    """Properties of a raster, without its pixels.

    All tuples except `paths` and `gcps` have one entry per band of the scene: each band of the file except alpha.
    """

    paths: tuple[str, ...]  # GDAL names of what was opened
    driver: str  # GDAL's short name of the format ("GTiff")
    height: int  # rows
    width: int  # columns
    dtypes: tuple[str, ...]  # names of numpy types
    nodatas: tuple[float | None, ...]  # as the file declares them, or as the caller gave them
    scales: tuple[float, ...]  # physical value = file value * scale + offset
    offsets: tuple[float, ...]
    descriptions: tuple[str | None, ...]
    units: tuple[str | None, ...]
    colorinterp: tuple[str, ...]  # GDAL's colour interpretation ("gray", "undefined")
    tags: Tags = field(repr=False)  # of the dataset; STATISTICS_* describe the input's pixels, and are not copied
    band_tags: tuple[Tags, ...] = field(repr=False)
    mask_flags: tuple[tuple[str, ...], ...]  # "all_valid", "per_dataset", "alpha", "nodata"; empty: a mask per band
    block_shapes: tuple[tuple[int, int], ...]  # rows and columns of a block
    tiled: bool = False
    alpha: int | None = None  # 1-based number of the alpha band in the file; it is no band of the scene
    compression: str | None = None  # this and the next two: as GDAL names them, in lower case
    predictor: str | None = None
    interleave: str | None = None
    crs: Any = None  # as rasterio gives it
    transform: Affine | None = None  # from column and row to map coordinates; None where the file has none
    gcps: tuple[Any, ...] = ()  # ground control points
    gcps_crs: Any = None
    rpcs: Any = None  # rational polynomial coefficients
    flat: FlatField | None = None  # correction that is applied while the file is read; `dtypes` are the types after it
    nodata_given: bool = False  # the caller gave the nodata: undeclared nodata is not searched for in the pixels
    offset_given: bool = False  # the caller gave the offsets

    @property
    def count(self) -> int:
        """Number of bands of the scene."""
        return len(self.dtypes)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Smallest numpy type that can hold the values of all bands."""
        return np.result_type(*(np.dtype(d) for d in self.dtypes))

    @property
    def nodata(self) -> float | None:
        """The nodata value if it is the same in all bands, else None."""
        first = self.nodatas[0]
        return first if all(same_nodata(first, n) for n in self.nodatas) else None


@contextmanager
def quiet() -> Iterator[None]:
    """Ignore warnings of libraries about a file, such as rasterio's warning of a raster without georeferencing.

    Only one thread at a time executes the `with` block, because Python's warning filters are global.
    """
    with _opening, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


def open_dataset(path: str) -> Any:
    """Open a raster with rasterio. Raises ReadError if GDAL cannot open it, InputError if it exceeds the limits."""
    import rasterio

    try:
        with quiet():
            dataset = rasterio.open(path, sharing=False)
    except gdal_errors(OSError, ValueError) as error:
        raise ReadError(_why_not_opened(path, error)) from error
    try:
        check_size(dataset, path)
    except BaseException:
        dataset.close()
        raise
    return dataset


def _why_not_opened(path: str, error: Exception) -> str:
    said = one_line(error)
    if "No such file" in said or "does not exist" in said:
        return f"no such file: {path}. Check the name (GDAL names such as /vsizip/ and zip:// will do)."
    if "not recognized as being in a supported file format" in said or "Permission denied" in said:
        return f"{path} is not a raster GDAL can read: it {_what_instead(path)}."
    if "AWS_NO_SIGN_REQUEST" in said:
        return f"cannot open {path}: {said}. Give credentials; or set AWS_NO_SIGN_REQUEST=YES, if it is public."
    if re.search(r"codec|not supported|unsupported|plugin|not available|no driver", said, re.IGNORECASE):
        return f"cannot open {path}: {said}. Convert it to GeoTIFF where it can be read: gdal_translate IN OUT.tif"
    return f"cannot open {path}: {said}. {remedy(path)}"


def _what_instead(path: str) -> str:
    """Text that continues the message "... is not a raster GDAL can read: it": what the file is, and a remedy."""
    place = Path(path)
    try:
        if place.is_dir():
            return "is a folder, and no product that is known. Name the raster files in it"
        with place.open("rb") as file:
            head = file.read(_HEAD)
    except PermissionError:
        return f"is not readable for you. Get read permission (chmod u+r {path})"
    except OSError:
        return f"is of no format that is known. {_OTHERWISE}"
    return next(said.format(path=path) for pattern, said in _FILE_KINDS if re.match(pattern, head, re.IGNORECASE))


def remedy(path: str, said: str = "") -> str:
    """Sentences for an error message: why the file `path` cannot be read (GDAL's message is `said`), and a remedy."""
    if "No such file" in said:
        return "This file, or a file that it refers to, is missing: add the missing file."
    if REMOTE_NAME.match(path):
        return (
            "The server cannot be reached or is too slow, or the file is damaged: try again, or wait longer for it "
            "(GDAL_HTTP_LOW_SPEED_TIME, GDAL_HTTP_MAX_RETRY in the environment)."
        )
    if "instead of the .hdr" in said:
        return "The pixels are in the file of this name without .hdr, or with another ending."
    return "The file is truncated or damaged: copy or download it again."


def gdal_errors(*more: type[Exception]) -> tuple[type[Exception], ...]:
    """Exception classes to catch: those of rasterio, those of GDAL that rasterio does not convert, and `more`."""
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import RasterioError

    return RasterioError, CPLE_BaseError, *more


def one_line(error: BaseException) -> str:
    """First line, without its full stop, of the message of an error, or of the cause of the error if it has one."""
    text = str(error.__cause__ or error).strip() or type(error).__name__
    return text.splitlines()[0].rstrip(".")


def describe_file(path: str, *, alpha_is_band: bool = False) -> RasterInfo:
    """Open a raster file and return its properties; no pixel is read.

    GDAL reports the last of 2 or 4 bands of type byte as "alpha" unless the file states otherwise. Such a band belongs
    to the scene if `alpha_is_band` is True or it has a name without "alpha"; else it is a mask. Raises ReadError if the
    header cannot be read, InputError for no band, complex numbers, exceeded limits, or a transform without an inverse.
    """
    try:
        with open_dataset(path) as dataset:
            info = _described(dataset, path, alpha_is_band)
    except (InputError, ReadError):
        raise
    except gdal_errors(ValueError, ArithmeticError, LookupError) as error:
        raise ReadError(f"cannot read the header of {path}: {one_line(error)}. {remedy(path)}") from error
    place = info.transform
    if place is not None and not (np.isfinite(place[:6]).all() and abs(place.determinant) > 0):
        raise InputError(
            f"{path} has a geotransform that cannot be inverted: {tuple(place[:6])}. Correct it, or remove it: "
            f"gdal_edit.py -unsetgt {path}"
        )
    return info


def _described(dataset: Any, path: str, alpha_is_band: bool) -> RasterInfo:
    interp = [c.name for c in dataset.colorinterp]
    alpha = next((i for i, name in enumerate(interp, start=1) if name == "alpha"), None)
    name = str(dataset.descriptions[alpha - 1] or "alpha").lower() if alpha else ""
    if alpha and (alpha_is_band or "alpha" not in name):
        interp[alpha - 1], alpha = "undefined", None
    bands = [i for i in dataset.indexes if i != alpha]
    _check_bands(dataset, path, bands)
    _check_length(dataset, path)
    structure = dataset.tags(ns="IMAGE_STRUCTURE")
    gcps, gcps_crs = dataset.gcps
    flags = [tuple(flag.name for flag in flags) for flags in dataset.mask_flag_enums]
    every: dict[str, Any] = {"nodatas": dataset.nodatavals, "colorinterp": interp, "mask_flags": flags}
    every |= {n: getattr(dataset, n) for n in ("dtypes", "scales", "offsets", "descriptions", "units", "block_shapes")}
    facts: dict[str, Any] = {n: getattr(dataset, n) for n in ("driver", "height", "width", "crs")}
    facts |= {name: tuple(values[i - 1] for i in bands) for name, values in every.items()}
    return RasterInfo(
        paths=(path,),
        **facts,
        tags=_tags(dataset),
        band_tags=tuple(_tags(dataset, i) for i in bands),
        tiled=bool(dataset.profile.get("tiled", False)),
        alpha=alpha,
        compression=structure.get("COMPRESSION", "").lower() or None,
        predictor=structure.get("PREDICTOR"),
        interleave=structure.get("INTERLEAVE", "").lower() or None,
        transform=None if dataset.transform.is_identity else dataset.transform,
        gcps=tuple(gcps),
        gcps_crs=gcps_crs,
        rpcs=dataset.rpcs,  # after the tags: GDAL adds namespaces when it reads these
    )


def _check_bands(dataset: Any, path: str, bands: Sequence[int]) -> None:
    if not bands:
        inside = " ".join(dataset.subdatasets)
        advice = f"It holds other rasters; name those of the scene: {inside}" if inside else "Name another file."
        raise InputError(f"{path} holds no band of its own. {advice}")
    for i in bands:
        if "complex" in dataset.dtypes[i - 1]:
            raise InputError(
                f"{path}: band {i} is {dataset.dtypes[i - 1]}; allowed are integers and real numbers. "
                "Take the magnitude first."
            )


def _check_length(dataset: Any, path: str) -> None:
    """Raise ReadError if an ENVI or EHdr file, unless compressed, is too short: GDAL would read the rest as 0."""
    header = dataset.tags(ns="ENVI")
    if header.get("file_compression", "0") != "0" or dataset.driver not in ("ENVI", "EHdr") or not Path(path).is_file():
        return
    need = dataset.height * dataset.width * sum(np.dtype(d).itemsize for d in dataset.dtypes)
    need += int(offset) if (offset := header.get("header_offset", "")).isdecimal() else 0
    found = Path(path).stat().st_size
    if found < need:
        raise ReadError(f"cannot read {path}: it has {found} bytes and its header says at least {need}. {remedy(path)}")


def _tags(dataset: Any, band: int = 0) -> dict[str, dict[str, str]]:
    namespaces = [n for n in dataset.tag_namespaces(band) if n and n not in _DERIVED_NAMESPACES]
    return {"": dataset.tags(band)} | {n: tags for n in namespaces if (tags := dataset.tags(band, ns=n))}
