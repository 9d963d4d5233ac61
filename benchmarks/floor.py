"""Copy a raster, the least work of a tool that reads and writes rasters: `python -m benchmarks.floor IN OUT`."""

from __future__ import annotations

import sys

import rasterio


def copy(source: str, target: str) -> None:
    """Read every block of all bands and write it into a file with the same profile, by one thread."""
    with rasterio.open(source) as scene:
        profile = {**scene.profile, "BIGTIFF": "IF_SAFER"}
        if predictor := scene.tags(ns="IMAGE_STRUCTURE").get("PREDICTOR"):
            profile["predictor"] = predictor
        with rasterio.open(target, "w", **profile) as out:
            for _, window in scene.block_windows(1):
                out.write(scene.read(window=window), window=window)


if __name__ == "__main__":
    copy(*sys.argv[1:])
