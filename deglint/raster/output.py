"""Write a raster completely, or not at all.

An output is written to a scratch file in the same directory, which is renamed at the end. After an error (such as a
full disk) or Ctrl-C, an existing file is unchanged and no scratch file is left. The output is a tiled GeoTIFF with its
header before its data: a valid cloud-optimised GeoTIFF (COG). Images of 1,024 pixels or more on the longer side get
overviews, which are reduced copies of the image, unless the creation option OVERVIEWS is NONE.
"""

import contextlib
import json
import logging
import math
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..errors import InputError, WriteError
from ..moments import Mask
from ..scene import Window
from .convert import Raw
from .info import RasterInfo, open_dataset, quiet
from .targets import DISK_FULL, Scratch, write_errors

DTYPES = ("float32", "float64", "uint8", "uint16", "int16", "uint32", "int32")  # data types that an output can have
BLOCK = 512  # side of the output's blocks [pixel] if the input's blocks are not suitable
OVERVIEWS_FROM = 1024  # images whose longer side has this size or more get overviews [pixel], as COG validators require
_SMALLEST_OVERVIEW = 512  # the longer side of the smallest overview is at most this [pixel], as in GDAL's COG driver
_SIDES = (64, 128, 256, BLOCK)  # possible sides of blocks [pixel]
_FLAG_COLOURS = ("000000", "bebebe", "56b4e9", "cc79a7", "f0e442", "e69f00", "009e73", "d55e00")
"""Colour (RRGGBB) of each bit of a raster of flags, the lowest bit first; of several bits, the highest is shown. The
colours suit colour-blind readers (Okabe and Ito 2008, https://jfly.uni-koeln.de/color/)."""
_OF_CONTENT = ("driver", "height", "width", "count", "dtype", "nodata", "crs", "transform")
"""Entries of a rasterio profile that are not creation options: a copied file has them from its source."""
_REFUSED = (*_OF_CONTENT, "mode", "sharing", "profile", "tfw", "rpb", "rpctxt")
"""Options that would change what the pixels mean, leave metadata out of the file, or write other files beside it."""
_UNPACKED = (*_OF_CONTENT, "tiled", "blockxsize", "blockysize", "bigtiff")
"""Profile entries with which a file with overviews is first written; `add_overviews` copies it with all options. Each
band has its own blocks at first: GDAL makes overviews band by band, and would read interleaved blocks for each band."""


def levels(height: int, width: int) -> list[int]:
    """Reduction factors of an image's overviews, such as [2, 4], for its size [pixel]; empty for a small image."""
    side = max(height, width)
    count = ((side - 1) // _SMALLEST_OVERVIEW).bit_length() if side >= OVERVIEWS_FROM else 0
    return [2 << k for k in range(count)]


@dataclass(frozen=True)
class Layout:
    """How an output raster is written: its bands, type, nodata, tile size and GDAL creation options."""

    info: RasterInfo  # of the input; the output keeps all properties that also hold for it
    bands: tuple[int, ...]  # 0-based bands of `info` that the output has
    dtype: str  # name of a numpy type
    nodata: float | None = None
    options: Mapping[str, str] = field(default_factory=dict)  # GDAL creation options; they override the defaults
    scaled: bool = True  # the values are file values of the input: keep scale, offset, unit and colour
    names: tuple[str, ...] | None = None  # names of the bands; by default as in the input
    masked: bool = False  # the file gets a mask: 0 where a pixel is not valid, else 255
    tile: tuple[int, int] = (BLOCK, BLOCK)  # rows and columns written at a time, such that each block is written once
    flags: Mapping[int, str] = field(default_factory=dict)  # meaning of each bit of flags, by its value (1, 2, 4, ...)

    @property
    def overviews(self) -> bool:
        """Whether the file has overviews: the image is large enough (`levels`) and the option OVERVIEWS is not NONE."""
        given = {str(k).lower(): str(v).lower() for k, v in self.options.items()}
        return given.get("overviews", "auto") != "none" and bool(levels(self.info.height, self.info.width))

    @property
    def block(self) -> tuple[int, int]:
        """Rows and columns of a block of the output file [pixel].

        Each side is chosen separately. If the input is tiled, the side of its blocks is used, provided that it is a
        multiple of 16 from 64 to 1024, and that it divides the side of `tile` or `tile` spans the image. Otherwise, if
        `tile` spans the image, the smallest of `_SIDES` that spans the image is used (512 if none does); if not, the
        largest of `_SIDES` that divides the side of `tile` (16 if none does).
        """
        own = self.info.block_shapes[0] if self.info.tiled else (0, 0)
        sizes = self.info.height, self.info.width
        rows, columns = (_block_side(*sides) for sides in zip(self.tile, sizes, own, strict=True))
        return rows, columns


def _block_side(tile: int, size: int, own: int) -> int:
    """Output block side, see `Layout.block`; `tile`, `size`, `own`: sides of tile, image and input block [pixel]."""
    whole = tile >= size  # the tile spans the image, so that a block of any size is written once
    if own % 16 == 0 and 64 <= own <= 1024 and (whole or tile % own == 0):
        return own
    if whole:
        return next((side for side in _SIDES if side >= size), BLOCK)
    return next((side for side in _SIDES[::-1] if tile % side == 0), 16)


class RasterWriter(contextlib.AbstractContextManager["RasterWriter"]):
    """Write a GeoTIFF window by window, in one thread.

    `path` is the scratch file that is written; `target` is the final file, whose name is in error messages. Use the
    writer as a context manager: at the end the file is closed, gets its overviews, and is checked; after an error it is
    only closed.
    """

    def __init__(self, path: Path, target: Path, layout: Layout) -> None:
        import rasterio

        self.path, self.target, self.layout = path, target, layout
        profile = _profile(layout)
        self._options = {k: v for k, v in profile.items() if k.lower() not in _OF_CONTENT}
        _check_space(path.parent, target, layout, profile)
        with _refusals(target, layout.options), write_errors(target):
            with quiet():
                self._dataset = rasterio.open(path, "w", **profile)
                if layout.overviews:  # GDAL has accepted the options; `add_overviews` uses them for the copy
                    self._dataset.close()
                    plain = {k: v for k, v in profile.items() if k.lower() in _UNPACKED} | {"interleave": "band"}
                    self._dataset = rasterio.open(path, "w", **plain)
            _describe(self._dataset, layout)
            if layout.masked:
                # the header of the mask must precede the data, too
                self._dataset.write_mask(np.full((1, 1), 255, np.uint8), window=((0, 1), (0, 1)))

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            with contextlib.suppress(Exception):
                self._dataset.close()
            return
        with write_errors(self.target):
            self._dataset.close()
            if self.layout.overviews:
                add_overviews(self.path, self._options, average=not self.layout.flags)
        sparse = str(self._options.get("sparse_ok", "no")).lower() not in ("no", "false", "off", "0")
        _check_whole(self.path, self.target, sparse=sparse)

    def write(self, block: Raw, window: Window) -> None:
        """Write all bands of a window; `block` is (band, row, column), or (row, column) for a single band."""
        block = block[None] if block.ndim == 2 else block
        with write_errors(self.target):
            self._dataset.write(block, window=window)

    def write_mask(self, valid: Mask, window: Window) -> None:
        """Write the mask of a window, (row, column), True where a pixel is valid; only if the layout is `masked`."""
        with write_errors(self.target):
            self._dataset.write_mask(valid.astype(np.uint8) * 255, window=window)


@contextlib.contextmanager
def _refusals(target: Path, options: Mapping[str, str]) -> Iterator[None]:
    """Raise InputError for an option in `_REFUSED` and, after the `with` block, for an option that GDAL warned of."""
    if wrong := [name for name in options if name.lower() in _REFUSED]:
        raise InputError(f"cannot write {target} with these options: {wrong[0]} is not for --co. Leave it out.")
    said: list[str] = []

    def listen(record: logging.LogRecord) -> bool:
        said.append(record.getMessage())
        return True

    log = logging.getLogger("rasterio._env")
    log.addFilter(listen)
    try:
        yield
    finally:
        log.removeFilter(listen)
    for line in said:
        if any(re.search(rf"\b{re.escape(name)}\b", line, re.IGNORECASE) for name in options):
            said_of_it = line.rpartition(" in ")[2].rstrip(".")
            raise InputError(f"cannot write {target} with these options: {said_of_it}. Check --co or [output] options.")


def _check_whole(path: Path, target: Path, *, sparse: bool) -> None:
    """Raise WriteError if any of 4 blocks per band of `path` is cut off or missing; `sparse` permits missing blocks."""
    with write_errors(target), open_dataset(str(path)) as dataset:
        size = path.stat().st_size
        planes: Sequence[int] = dataset.indexes if dataset.profile.get("interleave") != "pixel" else [1]
        for band in planes:
            rows, columns = dataset.block_shapes[band - 1]
            across, down = -(-dataset.width // columns), -(-dataset.height // rows)
            for x, y in ((0, 0), (across - 1, 0), (across - 1, down - 1), (across // 2, down // 2)):
                start = dataset.get_tag_item(f"BLOCK_OFFSET_{x}_{y}", "TIFF", bidx=band)
                length = dataset.get_tag_item(f"BLOCK_SIZE_{x}_{y}", "TIFF", bidx=band)
                if not sparse if start is None else int(start) + int(length or 0) > size:
                    raise OSError(DISK_FULL)


@dataclass(frozen=True, eq=False)
class Layer:
    """Content of a GeoTIFF that is written as a whole: an array (band, row, column) and its metadata."""

    array: Raw
    meaning: str  # meaning of the values, for the tag MEANING
    names: tuple[str, ...]  # one entry per band; the tuples below have one per band too, or are empty
    units: tuple[str, ...] = ()
    scales: tuple[float, ...] = ()
    band_tags: tuple[Mapping[str, str], ...] = ()
    tags: Mapping[str, str] = field(default_factory=dict)

    def write(self, path: Path, **options: Any) -> None:
        """Write the layer to the GeoTIFF `path`; `options` are passed to `rasterio.open`."""
        import rasterio

        count, height, width = self.array.shape
        profile = {"driver": "GTiff", "dtype": self.array.dtype.name, "count": count, "height": height, "width": width}
        profile |= {"compress": "deflate", "predictor": 3 if self.array.dtype.kind == "f" else 2}
        with quiet(), rasterio.open(path, "w", **profile, **options) as out:
            out.write(self.array)
            out.update_tags(MEANING=self.meaning, SOFTWARE=f"deglint {__version__}", **self.tags)
            out.descriptions = self.names
            if self.units:
                out.units = self.units
            if self.scales:
                out.scales = self.scales
            for i, tags in enumerate(self.band_tags, start=1):
                out.update_tags(i, **tags)


def add_overviews(path: Path, options: Mapping[str, object], *, average: bool) -> None:
    """Add overviews to a closed GeoTIFF, and store its blocks in the order of a COG.

    GDAL appends overviews to the file. A COG needs all headers first, then the blocks of the smallest overview, and the
    blocks of the image last. GDAL's GTiff driver writes this order when it copies a file, so the file is replaced by a
    copy; `options` are its creation options. A pixel of an overview is the mean of the valid image pixels that it
    covers, or, if `average` is False (for flags), the nearest image pixel.
    """
    import rasterio
    from rasterio.enums import Resampling
    from rasterio.shutil import copy

    ordered = path.with_name(f"{path.name}.ordered")
    try:
        with rasterio.Env(GDAL_NUM_THREADS="ALL_CPUS"):
            with rasterio.open(path) as dataset:
                factors, whole = levels(*dataset.shape), "int64" in dataset.dtypes[0]
            for some in [[k] for k in factors] if whole else [factors]:  # GDAL may hang at several levels of int64
                with rasterio.open(path, "r+") as dataset:
                    dataset.build_overviews(some, Resampling.average if average else Resampling.nearest)
            copy(path, ordered, driver="GTiff", copy_src_overviews=True, **options)
        ordered.replace(path)
    finally:
        ordered.unlink(missing_ok=True)


@contextlib.contextmanager
def writing_all(scratch: Scratch, images: Mapping[str, tuple[Path, Layout]]) -> Iterator[dict[str, RasterWriter]]:
    """Open a writer for each (target, layout) of `images`; yield writers by key. Rasters of flags get an .aux.xml."""
    for target, layout in images.values():
        if layout.flags:
            write_text(scratch, Path(f"{target}.aux.xml"), _categories(layout))
    with contextlib.ExitStack() as stack:
        yield {
            name: stack.enter_context(RasterWriter(scratch.add(target), target, layout))
            for name, (target, layout) in images.items()
        }


def _categories(layout: Layout) -> str:
    """Text of the file .aux.xml, from which GDAL reads the names of all values of a raster of flags."""
    kinds = {bit: text.partition(",")[0].partition(" (")[0] for bit, text in layout.flags.items()}
    first = ["; ".join(kind for bit, kind in kinds.items() if value & bit) or "no flag" for value in range(256)]
    others = (tags.get("", {}) for tags in layout.info.band_tags[1 : len(layout.bands)])
    second = [v for tags in others for k, v in tags.items() if k.startswith("CLASS_")]
    out = "<PAMDataset>"
    for number, names in enumerate((first, second), 1):
        rows = "".join(f"<Category>{name}</Category>" for name in names)
        out += f'<PAMRasterBand band="{number}"><CategoryNames>{rows}</CategoryNames></PAMRasterBand>' if rows else ""
    return f"{out}</PAMDataset>\n"


def write_text(scratch: Scratch, target: Path, text: str) -> None:
    """Write a text, as UTF-8, to a scratch file that is renamed to `target` at the end of the `scratch` block."""
    write_bytes(scratch, target, text.encode())


def write_bytes(scratch: Scratch, target: Path, data: bytes) -> None:
    """Write bytes to a scratch file, which is renamed to `target` at the end of the `scratch` block."""
    with write_errors(target):
        scratch.add(target).write_bytes(data)


def write_json(scratch: Scratch, target: Path, data: object) -> None:
    """Write data as JSON, in the same way as `write_text`, see `plain`."""
    write_text(scratch, target, as_json(data) + "\n")


def as_json(data: object) -> str:
    """Convert data to indented JSON, see `plain`."""
    return json.dumps(plain(data), indent=2, allow_nan=False)


def plain(value: object) -> Any:
    """Convert a value, dict, list or array to JSON types: NaN and infinity become None, other objects become text."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, (int, str, type(None))) else str(value)


def _profile(layout: Layout) -> dict[str, object]:
    info = layout.info
    rows, columns = layout.block
    profile: dict[str, object] = {"driver": "GTiff", "height": info.height, "width": info.width, "crs": info.crs}
    profile |= {"count": len(layout.bands), "dtype": layout.dtype, "nodata": layout.nodata}
    profile |= {"tiled": True, "blockxsize": columns, "blockysize": rows, "BIGTIFF": "IF_SAFER"}
    profile["interleave"] = info.interleave if info.interleave in ("pixel", "band") else "band"
    if info.transform is not None:
        profile["transform"] = info.transform
    if info.compression in ("deflate", "lzw", "zstd", "lzma", "packbits", "lerc"):
        profile |= {"compress": info.compression, "num_threads": "ALL_CPUS"}
        if info.predictor in ("2", "3") and np.dtype(layout.dtype).kind == np.dtype(info.dtype).kind:
            profile["predictor"] = info.predictor
    given = {str(k).lower(): v for k, v in layout.options.items() if str(k).lower() != "overviews"}
    return {k: v for k, v in profile.items() if k.lower() not in given and v is not None} | given


def _describe(dataset: Any, layout: Layout) -> None:
    """Write names, units, scales, colours, tags, GCPs and RPCs, before any pixel, so that the header comes first."""
    from rasterio.crs import CRS
    from rasterio.enums import ColorInterp

    info, bands = layout.info, layout.bands
    names: Sequence[str | None] = layout.names or [info.descriptions[b] for b in bands]
    for i, (band, name) in enumerate(zip(bands, names, strict=True), start=1):
        if name:
            dataset.set_band_description(i, name)
        if layout.scaled and info.units[band]:
            dataset.set_band_unit(i, info.units[band])
        for namespace, tags in info.band_tags[band].items():
            _tag(dataset, tags, namespace, i)
    if layout.scaled:
        scales, offsets = [info.scales[b] for b in bands], [info.offsets[b] for b in bands]
        if any(s != 1 for s in scales) or any(o != 0 for o in offsets):
            dataset.scales, dataset.offsets = scales, offsets
        colours = [info.colorinterp[b] for b in bands]
        if len(bands) == info.count and "palette" not in colours:
            dataset.colorinterp = [ColorInterp[c] for c in colours]
    if layout.flags:
        colours_of = {v: tuple(bytes.fromhex(_FLAG_COLOURS[v.bit_length() - 1])) for v in range(1, 256)}
        dataset.write_colormap(1, {0: (255, 255, 255)} | colours_of)
        _tag(dataset, {f"FLAG_{bit}": meaning for bit, meaning in layout.flags.items()}, "", 1)
    for namespace, tags in info.tags.items():
        _tag(dataset, tags, namespace)
    if info.gcps and info.transform is None:
        dataset.gcps = (list(info.gcps), info.gcps_crs or CRS())
    if info.rpcs is not None:
        dataset.rpcs = info.rpcs


def _tag(dataset: Any, tags: Mapping[str, str], namespace: str, band: int = 0) -> None:
    kept = {k: v for k, v in tags.items() if not k.startswith(("STATISTICS_", "MEANING"))}  # these are of the input
    if kept and not namespace.startswith("xml:") and namespace not in ("RPC", "TIFF"):
        dataset.update_tags(band, **({"ns": namespace} if namespace else {}), **kept)


def _check_space(directory: Path, target: Path, layout: Layout, profile: Mapping[str, object]) -> None:
    """Raise WriteError if the disk lacks space for the pixels. Compressed files without overviews are not checked."""
    packed = str(profile.get("compress", "none")).lower() != "none"
    if packed and not layout.overviews:
        return
    need = layout.info.height * layout.info.width * len(layout.bands) * np.dtype(layout.dtype).itemsize
    if layout.overviews:  # overviews add a third; an uncompressed copy takes the same space again
        need = need * (4 if packed else 8) // 3
    if need > (free := shutil.disk_usage(directory).free):
        raise WriteError(
            f"{target} needs {need / 1e6:.0f} MB and the disk has {free / 1e6:.0f} MB left. Free some space, compress "
            "it (--co COMPRESS=ZSTD), or leave out its overviews (--co OVERVIEWS=NONE)."
        )
