"""HTML of objects for a notebook: a table of text beside a small picture (an embedded PNG)."""

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import numpy.typing as npt

PICTURE_SIDE = 192  # longest side of a picture [pixel]
MOST_ROWS = 40  # most rows of a table; hyperspectral scenes have hundreds of bands
GAMMA = 1.8  # gamma correction: a picture shows x ** (1 / GAMMA) for values x from 0 to 1


def shown(title: str, rows: Sequence[tuple[str, str]], picture: npt.NDArray[np.uint8] | None = None) -> str:
    """A title, rows of (name, value) and a picture, (row, column, 3), as HTML."""
    kept = [*rows[:MOST_ROWS], *([("...", f"{len(rows) - MOST_ROWS} more")] if len(rows) > MOST_ROWS else [])]
    cells = "".join(f"<tr><th style='text-align:left'>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in kept)
    image = "" if picture is None else f"<td style='vertical-align:top'><img src='{data_uri(picture)}' alt=''></td>"
    table = f"<td style='vertical-align:top'><table>{cells}</table></td>"
    return f"<div><b>{escape(title)}</b><table><tr>{image}{table}</tr></table></div>"


def data_uri(picture: npt.NDArray[np.uint8]) -> str:
    """A picture (row, column, 3) as a PNG in a data URI."""
    import cv2

    _ok, png = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    return "data:image/png;base64," + b64encode(png.tobytes()).decode()


def stretched(images: Sequence[npt.NDArray[Any]]) -> npt.NDArray[np.uint8]:
    """Images (3, row, column) side by side, stretched from the 1st to the 99th percentile of the last image."""
    low, high = level(images[-1], 1), level(images[-1], 99)
    parts = []
    for image in images:
        step = -(-max(image.shape[1:]) // PICTURE_SIDE)
        part = stretch(image[:, ::step, ::step], low, high)
        parts += [part, np.full((len(part), 4, 3), 255, np.uint8)]
    return np.hstack(parts[:-1])


def level(image: npt.NDArray[Any], percent: float) -> npt.NDArray[np.float64]:
    """A percentile of each band of an image (band, row, column), over its valid pixels; 0 if a band has none."""
    found = [band[np.isfinite(band)] for band in image]
    return np.array([np.percentile(values, percent) if values.size else 0.0 for values in found])


def stretch(image: npt.NDArray[Any], low: npt.NDArray[Any], high: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Three bands as a picture (row, column, 3): black at `low` and at NaN, white at `high` of each band."""
    span = np.where(high > low, high - low, 1)[:, None, None]
    unit = np.clip(np.nan_to_num((image - low[:, None, None]) / span, nan=0.0), 0, 1) ** (1 / GAMMA)
    return np.ascontiguousarray((unit * 255).astype(np.uint8).transpose(1, 2, 0))
