"""What every tool that reads and writes a raster must at least do: `python -m benchmarks.block_copy IN OUT`.

Reads all bands of each of the file's blocks and writes them to a file with the same profile; nothing else. One thread,
GDAL's own settings; `--all-cpus` lets GDAL compress on all processors.
"""

import sys

import rasterio


def main(arguments: list[str]) -> None:
    source, target = (a for a in arguments if not a.startswith("-"))
    with rasterio.open(source) as scene:
        profile = {**scene.profile, "BIGTIFF": "IF_SAFER"}
        if predictor := scene.tags(ns="IMAGE_STRUCTURE").get("PREDICTOR"):
            profile["predictor"] = predictor
        if "--all-cpus" in arguments:
            profile["num_threads"] = "ALL_CPUS"
        with rasterio.open(target, "w", **profile) as out:
            for _, window in scene.block_windows(1):
                out.write(scene.read(window=window), window=window)


if __name__ == "__main__":
    main(sys.argv[1:])
