"""GDAL's settings while deglint reads and writes: small caches, so that memory is bounded by tiles.

rasterio keeps settings per thread: the calling thread and every worker enter an environment of their own.
"""

from __future__ import annotations

from typing import Any

CACHE = 48 << 20
"""GDAL's block cache [byte]; tiles are read once, so more of it would serve nothing."""


def environment() -> Any:
    """A rasterio environment with deglint's settings, for one thread."""
    import rasterio

    return rasterio.Env(
        GDAL_CACHEMAX=CACHE, GDAL_PAM_ENABLED="YES", GDAL_TIFF_INTERNAL_MASK="YES", GDAL_VRT_ENABLE_PYTHON="NO"
    )


def enter_thread() -> None:
    """Enter the environment for the rest of the calling worker thread's life."""
    environment().__enter__()
