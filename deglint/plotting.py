"""Pictures of scenes in natural colours, for `Scene.plot`, `Result.plot` and the option --picture."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import InputError

LONGEST_PICTURE = 900  # longest side of a picture of a whole scene [pixel]
AT_ONCE = 1024  # side of the squares that are read one by one, about [pixel]
GAMMA = 1.8  # gamma correction: a picture shows x ** (1 / GAMMA) for values x from 0 to 1


def axes(ax: Any, wanted_by: str) -> Any:
    """Return `ax`, or new matplotlib axes if None; without matplotlib, raise InputError for the caller `wanted_by`."""
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise InputError(f"{wanted_by} needs matplotlib: pip install 'deglint[reports]'.") from None
    return plt.figure(layout="constrained").add_subplot() if ax is None else ax


def drawn(scenes: Sequence[Any], ax: Any, wanted_by: str) -> Any:
    """Draw versions of a `Scene` side by side with the same stretch; `ax`, `wanted_by` and result are as in `axes`."""
    ax, first = axes(ax, wanted_by), scenes[0]
    bands = first.rgb(range(len(first.bands)))
    ax.imshow(np.hstack(natural_colour([thinned(s.source, first.shape, bands) for s in scenes])))
    ax.set(title=first.path, xticks=[], yticks=[])
    return ax


def thinned(source: Any, shape: tuple[int, int, int], bands: Sequence[int]) -> npt.NDArray[Any]:
    """Read every n-th row and column of 0-based `bands`, such that no side exceeds `LONGEST_PICTURE` [pixel].

    `shape` is the shape (band, row, column) of the scene. The result has the axes (band, row, column), too.
    """
    _, height, width = shape
    step = max(1, -(-max(height, width) // LONGEST_PICTURE))
    side = step * max(1, AT_ONCE // step)
    out = np.empty((len(bands), -(-height // step), -(-width // step)), np.float32)
    for row, column in product(range(0, height, side), range(0, width, side)):
        window = (row, min(row + side, height)), (column, min(column + side, width))
        part = source.read(window, list(bands))[:, ::step, ::step]
        out[:, row // step :, column // step :][:, : part.shape[1], : part.shape[2]] = part
    return out


def natural_colour(images: Sequence[npt.NDArray[Any]]) -> list[npt.NDArray[np.uint8]]:
    """Convert images (band, row, column) of red, green and blue to pictures (row, column, 3) with the same stretch.

    The last image is the one without glint. If the mean of the first image exceeds that of the last in every band, each
    band is divided by the difference of its means, so that glint is white. Black is percentile 1 of the darkest band of
    the last image. White is percentile 99.5 of its brightest band or, if that is larger, percentile 90 of the brightest
    band of the first image. NaN is black.
    """
    first, last = images[0], images[-1]
    glint = np.array([np.nanmean(a - b) if np.isfinite(a - b).any() else 0.0 for a, b in zip(first, last, strict=True)])
    unit = glint if (glint > 0).all() else np.ones(len(glint))
    low = np.min(level(last, 1) / unit)
    high = max(np.max(level(last, 99.5) / unit), np.max(level(first, 90) / unit), low + 1e-6)
    shares = (np.clip((image / unit[:, None, None] - low) / (high - low), 0, 1) for image in images)
    shown = ((np.nan_to_num(share) ** (1 / GAMMA) * 255).astype(np.uint8) for share in shares)
    return [np.ascontiguousarray(bands.transpose(1, 2, 0)) for bands in shown]


def level(image: npt.NDArray[Any], percent: float) -> npt.NDArray[np.float64]:
    """Percentile `percent` of each band's valid pixels, (band,), in an image (band, row, column); 0 if it has none."""
    found = [band[np.isfinite(band)] for band in image]
    return np.array([np.percentile(values, percent) if values.size else 0.0 for values in found])
