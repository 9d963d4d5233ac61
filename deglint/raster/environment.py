"""What is bounded while deglint reads and writes: GDAL's caches and patience with servers, and the size of a raster.

A few bytes of a header can declare more pixels than there is memory in the world. The limits let every real mosaic
pass, and stop what would take the machine down; they are settable, for who has more.

rasterio keeps settings per thread: the calling thread and every worker enter an environment of their own.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..errors import InputError

CACHE = 48 << 20
"""GDAL's block cache [byte]; tiles are read once, so more of it would serve nothing."""


HTTP_PATIENCE = {
    "GDAL_HTTP_CONNECTTIMEOUT": "10",
    "GDAL_HTTP_LOW_SPEED_LIMIT": "1000",
    "GDAL_HTTP_LOW_SPEED_TIME": "30",
    "GDAL_HTTP_TIMEOUT": "300",
    "GDAL_HTTP_MAX_RETRY": "3",
    "GDAL_HTTP_RETRY_DELAY": "1",
}
"""How long a server is waited for [s, byte/s], unless the process's environment says otherwise: to connect, while next
to nothing comes, and for one answer; how often an answer that says "later" is asked for again."""

MOST_PIXELS = 1 << 40
"""Rows times columns of a raster: 1 048 576 x 1 048 576."""
MOST_BLOCK_MB = 1024
"""Memory of one block, all bands of it where they are interleaved by pixel [MB of 2^20 byte]."""
MOST_BANDS = 8192
LOOK_SECONDS = 60
"""How long `deglint info` looks at a scene [s]."""
LOOK_READS = 10_000
"""Windows of a scene that it reads: of tiles of 1024 x 1024 pixels a scene of 100,000 x 100,000."""


def environment() -> Any:
    """A rasterio environment with deglint's settings, for one thread."""
    import rasterio

    waiting = {name: value for name, value in HTTP_PATIENCE.items() if name not in os.environ}
    return rasterio.Env(
        GDAL_CACHEMAX=CACHE,
        GDAL_PAM_ENABLED="YES",
        GDAL_TIFF_INTERNAL_MASK="YES",
        GDAL_VRT_ENABLE_PYTHON="NO",
        **waiting,
    )


def enter_thread() -> None:
    """Enter the environment for the rest of the calling worker thread's life."""
    environment().__enter__()


def check_size(dataset: Any, path: str) -> None:
    """Refuse an open dataset that declares more than a machine can be expected to take."""
    pixels, most = dataset.width * dataset.height, _limit("DEGLINT_MAX_PIXELS", MOST_PIXELS)
    if pixels > most:
        raise InputError(
            f"{path} declares {dataset.width} x {dataset.height} pixels; allowed are {most:,} in all. If that is "
            "right, set the environment variable DEGLINT_MAX_PIXELS higher."
        )
    if dataset.count > MOST_BANDS:
        raise InputError(f"{path} declares {dataset.count} bands; allowed are {MOST_BANDS}. Take some of them.")
    most_mb = _limit("DEGLINT_MAX_BLOCK_MB", MOST_BLOCK_MB)
    shared = dataset.count if dataset.count and dataset.profile.get("interleave") == "pixel" else 1
    for (rows, columns), dtype in zip(dataset.block_shapes, dataset.dtypes, strict=True):
        size = rows * columns * shared * (np.dtype(dtype).itemsize if "complex_int" not in dtype else 4)
        if size > most_mb << 20:
            raise InputError(
                f"{path} is stored in blocks of {rows} x {columns} pixels, {size >> 20} MB each; allowed are {most_mb} "
                "MB. Store it in tiles (gdal_translate -co TILED=YES), or set DEGLINT_MAX_BLOCK_MB higher."
            )


def look_seconds() -> int:
    """How long a scene is looked at [s]: DEGLINT_INFO_SECONDS, or `LOOK_SECONDS`."""
    return _limit("DEGLINT_INFO_SECONDS", LOOK_SECONDS)


def _limit(name: str, usual: int) -> int:
    text = os.environ.get(name, "")
    if not text:
        return usual
    try:
        value = int(float(text))
    except (ValueError, OverflowError):
        value = 0
    if value < 1:
        raise InputError(f"the environment variable {name} is {text[:40]!r}; it must be an integer above 0.")
    return value
