"""GDAL's settings while deglint reads and writes: small caches, so that memory is bounded by tiles, and patience with
servers that is bounded, too.

rasterio keeps settings per thread: the calling thread and every worker enter an environment of their own.
"""

from __future__ import annotations

import os
from typing import Any

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
