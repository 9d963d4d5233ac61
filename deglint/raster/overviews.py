"""Reduced-resolution copies inside a GeoTIFF, in the order of blocks that makes it a cloud-optimised one.

GDAL computes the overviews and appends them. A cloud-optimised file wants all headers first, then the blocks of the
smallest overview, ... and those of the image last: GDAL's GTiff driver writes that order when it copies the file.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

OVERVIEWS_FROM = 1024
"""Longer side from which on an image has overviews [pixel], as the field's validators want it."""
_SMALLEST_OVERVIEW = 512
"""Longer side of the smallest overview, at most [pixel]: one request of a viewer, as in GDAL's COG driver."""


def levels(height: int, width: int) -> list[int]:
    """Factors of the overviews of an image, such as [2, 4]."""
    side, found = max(height, width), [2]
    while side > _SMALLEST_OVERVIEW * found[-1]:
        found.append(2 * found[-1])
    return found if side >= OVERVIEWS_FROM else []


def add_overviews(path: Path, options: Mapping[str, Any], *, average: bool) -> None:
    """Add overviews to a closed GeoTIFF, and put all of its blocks in order.

    `options` are its creation options. An overview holds the mean of the valid pixels, or where `average` is False (for
    flags) the nearest pixel.
    """
    import rasterio
    from rasterio.enums import Resampling
    from rasterio.shutil import copy

    ordered = path.with_name(f"{path.name}.ordered")
    try:
        with rasterio.Env(GDAL_NUM_THREADS="ALL_CPUS"):
            with rasterio.open(path, "r+") as dataset:
                dataset.build_overviews(levels(*dataset.shape), Resampling.average if average else Resampling.nearest)
            copy(path, ordered, driver="GTiff", copy_src_overviews=True, **options)
        ordered.replace(path)
    finally:
        with contextlib.suppress(OSError):
            ordered.unlink(missing_ok=True)
