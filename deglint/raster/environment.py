"""Settings of GDAL for reading and writing (cache, timeouts for servers), and limits for the size of a raster.

The header of a small file can declare any number of pixels. The limits admit all rasters that occur in practice, and
reject those that need more memory than a machine has. Environment variables override the limits.

A rasterio environment holds for one thread only. Sources enter it for each read (90 us), so that any thread can read.
"""

import os
from typing import Any

import numpy as np

from ..errors import InputError

CACHE = 24 << 20  # GDAL's block cache [byte]; with twice as much, a removal takes 5 % less time and 40 MB more memory
HTTP_PATIENCE = {
    "GDAL_HTTP_CONNECTTIMEOUT": "10",
    "GDAL_HTTP_LOW_SPEED_LIMIT": "1000",
    "GDAL_HTTP_LOW_SPEED_TIME": "30",
    "GDAL_HTTP_TIMEOUT": "300",
    "GDAL_HTTP_MAX_RETRY": "3",
    "GDAL_HTTP_RETRY_DELAY": "1",
}
"""GDAL options for servers, unless set in the process's environment: timeout for connecting [s]; a transfer slower than
a limit [byte/s] for a time [s] fails; timeout of one response [s]; number and delay [s] of retries after an error."""

READ_LIMITS = {
    "DEGLINT_MAX_PIXELS": 1 << 40,  # pixels of a raster: 1 048 576 x 1 048 576
    "DEGLINT_MAX_BLOCK_MB": 1024,  # size of a block, with all bands if they are interleaved by pixel [2^20 byte]
    "DEGLINT_INFO_SECONDS": 60,  # time that `deglint info` may take for a scene [s]
}
"""Limits that environment variables of the same names override."""
MOST_BANDS = 8192  # allowed number of bands of a raster


def environment() -> Any:
    """Make a rasterio environment (`rasterio.Env`) with deglint's settings, for one thread."""
    import rasterio

    waiting = {name: value for name, value in HTTP_PATIENCE.items() if name not in os.environ}
    return rasterio.Env(
        GDAL_CACHEMAX=CACHE,
        GDAL_PAM_ENABLED="YES",
        GDAL_TIFF_INTERNAL_MASK="YES",
        GDAL_VRT_ENABLE_PYTHON="NO",
        **waiting,
    )


def check_size(dataset: Any, path: str) -> None:
    """Raise InputError if the open raster `path` declares too many pixels or bands, or too large blocks."""
    pixels, most = dataset.width * dataset.height, limit("DEGLINT_MAX_PIXELS")
    if pixels > most:
        raise InputError(
            f"{path} declares {dataset.width} x {dataset.height} pixels; allowed are {most:,} in all. If that is "
            "right, set the environment variable DEGLINT_MAX_PIXELS higher."
        )
    if dataset.count > MOST_BANDS:
        raise InputError(f"{path} declares {dataset.count} bands; allowed are {MOST_BANDS}. Take some of them.")
    most_mb = limit("DEGLINT_MAX_BLOCK_MB")
    shared = dataset.count if dataset.count and dataset.profile.get("interleave") == "pixel" else 1
    for (rows, columns), dtype in zip(dataset.block_shapes, dataset.dtypes, strict=True):
        size = rows * columns * shared * (np.dtype(dtype).itemsize if "complex_int" not in dtype else 4)
        if size > most_mb << 20:
            raise InputError(
                f"{path} is stored in blocks of {rows} x {columns} pixels, {size >> 20} MB each; allowed are {most_mb} "
                "MB. Store it in tiles (gdal_translate -co TILED=YES), or set DEGLINT_MAX_BLOCK_MB higher."
            )


def limit(name: str) -> int:
    """Value of the environment variable `name`; `READ_LIMITS` has the default. Raises InputError if it is below 1."""
    text = os.environ.get(name) or str(READ_LIMITS[name])
    try:
        value = int(float(text))
    except (ValueError, OverflowError):
        value = 0
    if value < 1:
        raise InputError(f"the environment variable {name} is {text[:40]!r}; it must be an integer above 0.")
    return value
