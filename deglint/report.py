"""Pictures of the result: before and after, side by side, with the same contrast stretch."""

from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from .notebook import level, stretch
from .raster import FileBands, RasterSource
from .raster.info import describe_file
from .remove import GlintModel
from .scene import Scene
from .tiles import tile_shape, tiles

LONGEST_PICTURE = 900  # longest side of each picture [pixel]


def before_after(scene: Scene, result: Path, model: GlintModel) -> bytes:
    """A PNG of the scene beside its correction, the file `result`; captions name the bands, and the method of `model`.

    Both halves have the same stretch: black is the 1st percentile of each corrected band; white is the 99.5th
    percentile of the corrected band, or the 90th percentile of the raw band, whichever is higher.
    """
    import cv2

    known = [f.band for f in model.fits] or range(len(scene.bands))
    bands = scene.rgb(known[::-1])
    info = describe_file(str(result), alpha_is_band=True)
    with RasterSource([FileBands.of(info)], info) as corrected:
        before, after = (_thinned(source, scene, bands) for source in (cast(RasterSource, scene.source), corrected))
    low = level(after, 1)
    high = np.maximum(level(after, 99.5), level(before, 90))
    names = ", ".join(scene.bands[b].name for b in bands)
    left = _titled(stretch(before, low, high), f"before ({names})")
    right = _titled(stretch(after, low, high), f"after {model.method}")
    gap = np.full((len(left), 6, 3), 255, np.uint8)
    _ok, png = cv2.imencode(".png", np.hstack([left, gap, right])[..., ::-1])
    return bytes(png)


def _thinned(source: RasterSource, scene: Scene, bands: list[int]) -> npt.NDArray[np.float32]:
    """Physical values, (band, row, column), of every n-th row and column, read by tiles; at most `LONGEST_PICTURE`."""
    step = max(1, -(-max(scene.height, scene.width) // LONGEST_PICTURE))
    out = np.empty((len(bands), -(-scene.height // step), -(-scene.width // step)), np.float32)
    side = tile_shape(scene.height, scene.width, len(bands), source.info.block_shapes[0])
    for tile in tiles(scene.height, scene.width, side):
        block = source.read(tile.window, bands)[:, -tile.row0 % step :: step, -tile.col0 % step :: step]
        top, left = -(-tile.row0 // step), -(-tile.col0 // step)
        out[:, top : top + block.shape[1], left : left + block.shape[2]] = block
    return out


def _titled(image: npt.NDArray[np.uint8], title: str) -> npt.NDArray[np.uint8]:
    import cv2

    scale = max(1, 384 // max(image.shape[:2]))
    image = np.repeat(np.repeat(image, scale, axis=0), scale, axis=1)
    bar = np.full((26, max(image.shape[1], 240), 3), 255, np.uint8)
    cv2.putText(bar, title, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    padded = np.pad(image, ((0, 0), (0, bar.shape[1] - image.shape[1]), (0, 0)), constant_values=255)
    return np.vstack([bar, padded])
