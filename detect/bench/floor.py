"""What every tool that reads and writes a raster must at least do: `python -m detect.bench.floor copy|twice IN OUT`.

`copy` reads all bands of each of the file's blocks and writes them to a file with the same profile; `twice` is for what
fits before it scores: it reads all blocks, then again, and writes the first band to a file of its own. Nothing else is
done; one thread, GDAL's own settings. `--all-cpus` lets GDAL compress on all processors.
"""

from __future__ import annotations

import sys


def copy(source: str, target: str, *, all_cpus: bool = False) -> None:
    """Copy a raster by its blocks."""
    import rasterio

    with rasterio.open(source) as scene:
        profile = {**scene.profile, "BIGTIFF": "IF_SAFER"}
        if predictor := scene.tags(ns="IMAGE_STRUCTURE").get("PREDICTOR"):
            profile["predictor"] = predictor
        if all_cpus:
            profile["num_threads"] = "ALL_CPUS"
        with rasterio.open(target, "w", **profile) as out:
            for _, window in scene.block_windows(1):
                out.write(scene.read(window=window), window=window)


def twice(source: str, target: str) -> None:
    """Read a raster twice by its blocks, and write its first band."""
    import rasterio

    with rasterio.open(source) as scene:
        for _, window in scene.block_windows(1):
            scene.read(window=window)
        with rasterio.open(target, "w", **{**scene.profile, "count": 1, "BIGTIFF": "IF_SAFER"}) as out:
            for _, window in scene.block_windows(1):
                out.write(scene.read(window=window)[:1], window=window)


def main(arguments: list[str]) -> None:
    """Do what the command line says."""
    what, source, target = (a for a in arguments if not a.startswith("-"))
    if what == "copy":
        copy(source, target, all_cpus="--all-cpus" in arguments)
    else:
        twice(source, target)


if __name__ == "__main__":
    main(sys.argv[1:])
