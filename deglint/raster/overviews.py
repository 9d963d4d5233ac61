"""Reduced-resolution copies inside a GeoTIFF, in the order of blocks that makes it a cloud-optimised one.

GDAL computes the overviews and appends them. A cloud-optimised file wants all headers first, then the blocks of the
smallest overview, ... and those of the image last, so the compressed blocks are copied once into that order.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np

from .tiff import Header, copy_bytes, stretches

LEAST = 1024
"""Longer side from which on an image has overviews [pixel], as the field's validators want it."""
_SMALLEST = 512
"""Longer side of the smallest overview, at most [pixel]: one request of a viewer, as in GDAL's COG driver."""


def levels(height: int, width: int) -> list[int]:
    """Factors of the overviews of an image, such as [2, 4]."""
    side, found = max(height, width), [2]
    while side > _SMALLEST * found[-1]:
        found.append(2 * found[-1])
    return found if side >= LEAST else []


def add_overviews(path: Path, *, average: bool) -> None:
    """Add overviews to a GeoTIFF that is large enough, and put all of its blocks in order.

    Parameters
    ----------
    path : Path
        A closed GeoTIFF without overviews.
    average : bool
        Mean of the valid pixels (for images); else the nearest pixel (for flags).
    """
    import rasterio
    from rasterio.enums import Resampling

    with rasterio.Env(GDAL_NUM_THREADS="ALL_CPUS"), rasterio.open(path, "r+") as dataset:
        dataset.build_overviews(levels(*dataset.shape), Resampling.average if average else Resampling.nearest)
    ordered = path.with_name(f"{path.name}.ordered")
    try:
        order_blocks(path, ordered)
        ordered.replace(path)
    finally:
        with contextlib.suppress(OSError):
            ordered.unlink(missing_ok=True)


def order_blocks(path: Path, target: Path) -> None:
    """Copy a GeoTIFF: headers first, then the blocks of each image in it, the smallest image first."""
    header = Header.read(path)
    end = header.size
    with path.open("rb", buffering=0) as source, target.open("wb", buffering=0) as file:
        for directory in sorted(header.directories, key=lambda d: d.number(256) * d.number(257)):
            offsets, counts = directory.offsets.copy(), directory.counts
            for start, length, blocks in stretches(offsets, counts):
                copy_bytes(source, file, start, end, length)
                directory.offsets[blocks] = end + (offsets[blocks] - np.uint64(start))
                end += length + length % 2
        file.seek(0)
        file.write(header.to_bytes())
        file.truncate(end)
