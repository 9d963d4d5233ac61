"""Before and after, side by side: pieces of scenes in natural colours, as one SVG with the pixels inside."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import numpy.typing as npt

Rgb = npt.NDArray[np.uint8]

WIDTH, GAP, LINE = 960, 12, 22
COLOURS = (4, 2, 1)
"""RED, GREEN and BLUE of the thesis' sensor."""
BLACK, WHITE = 0.5, 3.5
DRAWN = f"black is {BLACK:g} and white {WHITE:g} times the water level of the band"


def natural(image: npt.NDArray[Any], truth: npt.NDArray[Any], rows: slice, columns: slice) -> Rgb:
    """A piece of a scene in natural colours.

    Each band runs from `BLACK` to `WHITE` water levels; all pieces of a scene are drawn by its truth, and so alike.

    Parameters
    ----------
    image, truth : (band, row, column) ndarray
    rows, columns : slice
    """
    bands = list(COLOURS)
    level = np.median(np.asarray(truth, np.float64)[bands], axis=(1, 2))[:, None, None]
    unit = (np.asarray(image, np.float64)[bands][:, rows, columns] / level - BLACK) / (WHITE - BLACK)
    return np.rint(255 * np.clip(np.nan_to_num(unit), 0, 1)).astype(np.uint8).transpose(1, 2, 0)


def strip(title: str, chips: Sequence[tuple[str, Rgb]], across: int = 0) -> str:
    """Pieces of one size in rows, each with its name below, as an SVG element.

    Parameters
    ----------
    title : str
        Said to readers who do not see it.
    chips : sequence of (str, (row, column, 3) uint8 ndarray)
    across : int
        Pieces in a row; all of them if 0.
    """
    across = across or len(chips)
    wide = (WIDTH - (across - 1) * GAP) / across
    tall = wide * chips[0][1].shape[0] / chips[0][1].shape[1]
    parts = []
    for number, (name, pixels) in enumerate(chips):
        x, y = (number % across) * (wide + GAP), (number // across) * (tall + LINE + GAP)
        parts.append(
            f'<image href="{_png(pixels)}" x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" height="{tall:.1f}" '
            f'style="image-rendering:pixelated"/>'
            f'<text x="{x:.1f}" y="{y + tall + LINE - 6:.1f}">{escape(name)}</text>'
        )
    high = -(-len(chips) // across) * (tall + LINE + GAP) - GAP
    said = escape(title, quote=True)
    return f'<svg viewBox="0 0 {WIDTH} {high:.0f}" role="img" aria-label="{said}">{"".join(parts)}</svg>'


def _png(pixels: Rgb) -> str:
    """Colours as the data URI of a PNG."""
    import cv2

    _, data = cv2.imencode(".png", np.ascontiguousarray(pixels[:, :, ::-1]), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return "data:image/png;base64," + b64encode(data.tobytes()).decode()
