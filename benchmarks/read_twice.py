"""What every tool that fits a background and then scores must at least do: `python -m benchmarks.read_twice IN OUT`.

Reads all bands of each of the file's blocks, then again, and writes the first band to a file of its own.
"""

import sys

import rasterio


def main(source: str, target: str) -> None:
    with rasterio.open(source) as scene:
        for _, window in scene.block_windows(1):
            scene.read(window=window)
        profile = {**scene.profile, "count": 1, "BIGTIFF": "IF_SAFER"}
        with rasterio.open(target, "w", **profile) as out:
            for _, window in scene.block_windows(1):
                out.write(scene.read(window=window)[:1], window=window)


if __name__ == "__main__":
    main(*sys.argv[1:])
