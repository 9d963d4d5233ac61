"""What a raster may ask for: a header is believed about its size only within limits.

A few bytes can declare more pixels than there is memory in the world. The limits let every real mosaic pass, and stop
what would take the machine down; they are settable, for who has more.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..errors import InputError

MOST_PIXELS = 1 << 40
"""Rows times columns of a raster: 1 048 576 x 1 048 576."""
MOST_BLOCK_MB = 1024
"""Memory of one block, all bands of it where they are interleaved by pixel [MB of 2^20 byte]."""
MOST_BANDS = 8192
LOOK_SECONDS = 60
"""How long `deglint info` looks at a scene [s]."""
LOOK_READS = 10_000
"""Windows of a scene that it reads: of tiles of 1024 x 1024 pixels a scene of 100,000 x 100,000."""


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
