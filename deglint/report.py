"""A picture of a scene before and after the removal, side by side, with the same contrast stretch."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from .plotting import natural_colour, thinned
from .raster import FileBands, RasterSource
from .raster.info import describe_file
from .remove import GlintModel
from .scene import Scene


def before_after(scene: Scene, result: Path, model: GlintModel) -> bytes:
    """Draw a scene beside its correction, the file `result`; return a PNG as bytes. Captions name bands and method."""
    bands = scene.rgb(([f.band for f in model.fits] or range(len(scene.bands)))[::-1])
    info = describe_file(str(result), alpha_is_band=True)
    with RasterSource([FileBands.of(info)], info) as corrected:
        before, after = (thinned(source, scene.shape, bands) for source in (scene.source, corrected))
    after_what = f"after {model.method}" if model.fits else "copied"
    titles = f"before ({', '.join(scene.bands[b].name for b in bands)})", after_what
    left, right = (_titled(*part) for part in zip(natural_colour([before, after]), titles, strict=True))
    _ok, png = cv2.imencode(".png", np.hstack([left, np.full((len(left), 6, 3), 255, np.uint8), right])[..., ::-1])
    return bytes(png)


def _titled(image: npt.NDArray[np.uint8], title: str) -> npt.NDArray[np.uint8]:
    scale = max(1, 384 // max(image.shape[:2]))
    image = np.repeat(np.repeat(image, scale, axis=0), scale, axis=1)
    bar = np.full((26, max(image.shape[1], 240), 3), 255, np.uint8)
    cv2.putText(bar, title, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    padded = np.pad(image, ((0, 0), (0, bar.shape[1] - image.shape[1]), (0, 0)), constant_values=255)
    return np.vstack([bar, padded])
