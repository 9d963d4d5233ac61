"""Other programs' Hedley from file to file, as their documentation has it.

    PYTHON -I others.py sensingpy|numpy IN OUT COLUMN,ROW,WIDTH,HEIGHT

PYTHON may belong to another environment, where the peer is installed. `numpy` is what one writes in a notebook: the
whole array in memory. Eight bands, NIR is the seventh, and the six before it are corrected.
"""

import sys
from importlib import metadata
from typing import Any

NIR = 6


def with_sensingpy(bands: Any, sample: Any) -> None:
    """Hedley by sensingpy, in place."""
    from sensingpy.preprocessing import deglinting

    bands[:NIR] = deglinting.hedley(sample, bands[:NIR], bands[NIR])


def with_numpy(bands: Any, sample: Any) -> None:
    """Hedley in a few lines of numpy, in place."""
    import numpy as np

    nir = bands[NIR][sample].astype(float)
    for band in bands[:NIR]:
        slope = np.polyfit(nir, band[sample].astype(float), 1)[0]
        band -= np.float32(slope) * (bands[NIR] - np.float32(nir.min()))


def main(peer: str, source: str, target: str, window: str) -> None:
    """Read, correct, write."""
    import numpy as np
    import rasterio

    column, row, width, height = map(int, window.split(","))
    with rasterio.open(source) as scene:
        bands, profile = scene.read(), scene.profile
    sample = np.zeros(bands.shape[1:], bool)
    sample[row : row + height, column : column + width] = True
    {"sensingpy": with_sensingpy, "numpy": with_numpy}[peer](bands, sample)
    with rasterio.open(target, "w", **profile) as out:
        out.write(bands)


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        sys.stdout.write(metadata.version(sys.argv[2]) + "\n")
    else:
        main(*sys.argv[1:])
