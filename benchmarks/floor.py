"""The least work of a tool that reads and writes a raster: `python -m benchmarks.floor IN OUT` copies its blocks."""

from __future__ import annotations

import sys

import rasterio


def copy(source: str, target: str) -> None:
    """Read every block with all bands and write it to a file with the same profile; one thread."""
    with rasterio.open(source) as scene:
        profile = {**scene.profile, "BIGTIFF": "IF_SAFER"}
        if predictor := scene.tags(ns="IMAGE_STRUCTURE").get("PREDICTOR"):
            profile["predictor"] = predictor
        with rasterio.open(target, "w", **profile) as out:
            for _, window in scene.block_windows(1):
                out.write(scene.read(window=window), window=window)


if __name__ == "__main__":
    copy(*sys.argv[1:])
