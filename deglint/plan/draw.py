"""Draw lines, text and discs into RGB arrays; no plotting library is used, because its import is slow."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

Image = npt.NDArray[np.uint8]  # (row, column, 3), the last axis red, green, blue
Values = npt.NDArray[Any]  # one value for each viewing geometry, (zenith, azimuth)
Colour = tuple[int, int, int]  # red, green, blue, 0 to 255
Point = tuple[float, float]  # x to the right, y down, from the upper left corner [pixel]
Pattern = tuple[Values, str, Colour]
"""An array (zenith, azimuth), the hatching ("/", "\\" or ".") to draw where it is above 0, and its colour."""

INK: Colour = (25, 28, 34)
GREY: Colour = (105, 112, 122)
PALE: Colour = (216, 220, 226)
PAPER: Colour = (255, 255, 255)
GROUND: Colour = (244, 242, 238)
ORANGE: Colour = (213, 94, 0)
BLUE: Colour = (0, 114, 178)
YELLOW: Colour = (255, 200, 20)
MAGENTA: Colour = (204, 20, 120)
_OVERSAMPLING = 2  # discs are drawn this many times larger, then averaged
_SHADES = 248  # number of colours of the colour scale in a disc; 8 more are for hatchings and edges
_SUBPIXEL_BITS = 4  # cv2 takes coordinates in 1/16 pixel
_COLOURS = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]  # (256, 3), RGB
_font = lru_cache(maxsize=16)(ImageFont.load_default)  # font of a size [pixel]


class Canvas:
    """An RGB picture to draw on. All sizes are in pixels; points are (x, y) from the upper left corner, y down."""

    def __init__(self, width: int, height: int) -> None:
        self.image: Image = np.full((height, width, 3), PAPER, np.uint8)
        self._texts: list[tuple[Point, str, float, Colour, str, bool]] = []

    def line(self, points: Sequence[Point], colour: Colour = INK, width: int = 1) -> None:
        """Draw a line through `points` in their order; `width` is its thickness [pixel]."""
        cv2.polylines(self.image, [_fixed(points)], False, colour, width, cv2.LINE_AA, _SUBPIXEL_BITS)

    def area(self, points: Sequence[Point], colour: Colour) -> None:
        """Fill the polygon with the corners `points`."""
        cv2.fillPoly(self.image, [_fixed(points)], colour, cv2.LINE_AA, _SUBPIXEL_BITS)

    def circle(self, centre: Point, radius: float, colour: Colour = INK, width: int = 1) -> None:
        """Draw a circle; `width` is the thickness of its line [pixel], and -1 fills the circle."""
        (at,) = _fixed([centre])
        size = round(radius * 2**_SUBPIXEL_BITS)
        cv2.circle(self.image, (int(at[0]), int(at[1])), size, colour, width, cv2.LINE_AA, _SUBPIXEL_BITS)

    def box(self, left: float, top: float, width: float, height: float, colour: Colour) -> None:
        """Fill the rectangle whose upper left corner is (left, top)."""
        self.image[round(top) : round(top + height), round(left) : round(left + width)] = colour

    def arrow(self, start: Point, end: Point, colour: Colour = INK, width: int = 2, head: float = 11.0) -> None:
        """Draw an arrow; `width` is the thickness of its line, `head` the length of its filled head [pixel]."""
        along = np.subtract(end, start)
        along = along / max(float(np.hypot(*along)), 1e-9)
        side = np.array([-along[1], along[0]]) * head * 0.45
        neck = np.subtract(end, along * head)
        self.line([start, (float(neck[0]), float(neck[1]))], colour, width)
        self.area([end, tuple(neck + side), tuple(neck - side)], colour)

    def text(
        self, at: Point, text: str, size: float = 15.0, colour: Colour = INK, *, anchor: str = "la", halo: bool = False
    ) -> None:
        """Add a line of text, which `finished` draws with its Pillow `anchor` at `at`; `halo` adds a white outline."""
        self._texts.append((at, text, size, colour, anchor, halo))

    def lines(
        self, at: Point, texts: Sequence[str], size: int, step: int, colour: Colour = INK, width: float | None = None
    ) -> float:
        """Add lines of text `step` apart [pixel], wrapped to `width` [pixel] if given; return y below all lines."""
        lines = texts if width is None else [line for text in texts for line in wrapped(text, size, width)]
        for k, line in enumerate(lines):
            self.text((at[0], at[1] + k * step), line, size, colour)
        return at[1] + len(lines) * step

    def finished(self) -> Image:
        """Draw the texts that were added, and return the picture."""
        picture = Pictures.fromarray(self.image)
        pen = ImageDraw.Draw(picture)
        for at, text, size, colour, anchor, halo in self._texts:
            rim = PAPER if halo else None
            pen.text(at, text, colour, _font(size), anchor=anchor, stroke_width=2 * halo, stroke_fill=rim)
        return np.asarray(picture)


def wrapped(text: str, size: float, width: float) -> list[str]:
    """Split a text in a font of `size` [pixel] into lines of up to `width` [pixel]; longer words are not split."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if _font(size).getlength(longer) > width and lines[-1]:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def polar(centre: Point, radius: float, zenith: float, azimuth: float, widest: float) -> Point:
    """Point of a viewing geometry [degree] on a disc, north up; zenith angle `widest` is at `radius` [pixel]."""
    return around(centre, radius * zenith / widest, azimuth)


def around(centre: Point, distance: float, azimuth: float) -> Point:
    """Point at a distance [pixel] from the centre in the direction of an azimuth [degree]; north is up."""
    turn = np.radians(azimuth)
    return centre[0] + distance * float(np.sin(turn)), centre[1] - distance * float(np.cos(turn))


def azimuth_name(azimuth: int) -> str:
    """Label of an azimuth [degree] on the rim of a disc: N, 030, 060, E, ..."""
    return {0: "N", 90: "E", 180: "S", 270: "W"}.get(azimuth, f"{azimuth:03d}")


def palette(share: Values) -> Image:
    """Convert numbers 0 to 1 to colours (..., 3) of the colour map viridis, which suits colour-blind readers."""
    return _COLOURS[(np.clip(np.nan_to_num(share), 0.0, 1.0) * 255).astype(np.uint8)]


def png(image: Image) -> bytes:
    """Encode a picture as the bytes of a PNG file."""
    _ok, data = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 4])
    return bytes(data)


def disc(canvas: Canvas, centre: Point, radius: int, share: Values, patterns: Sequence[Pattern] = ()) -> None:
    """Draw a polar map of viewing geometries, north up: zenith angle 0 is at `centre`, the largest at `radius` [pixel].

    `share` (zenith, azimuth) gives the colour, 0 to 1, in equal steps of zenith angle from 0 and of azimuth from 0 to
    360 degrees. Where the array of a `Pattern` is above 0, its hatching is drawn on a pale background.
    """
    inside, coverage = _cover(radius)
    level = cv2.convertScaleAbs(np.clip(_warped(share, radius), 0.0, 1.0), alpha=_SHADES - 1)
    table = np.empty((256, 3), np.uint8)
    table[:_SHADES] = _COLOURS[np.linspace(0, 255, _SHADES).astype(int)]
    table[_SHADES], table[-1] = GROUND, INK
    hatched = [(_warped(excess, radius) > 0, pattern, colour) for excess, pattern, colour in patterns]
    ground = np.any([here for here, _, _ in hatched], axis=0)
    level[ground] = _SHADES
    for n, (here, pattern, colour) in enumerate(hatched, start=_SHADES + 1):
        table[n] = colour
        level[here & _pattern(pattern, len(level))] = n
    edge = cv2.morphologyEx((ground & inside).view(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    level[edge.view(bool)] = 255
    fine = cv2.LUT(cv2.merge([level] * 3), table[None])
    small = cv2.resize(fine, None, fx=1 / _OVERSAMPLING, fy=1 / _OVERSAMPLING, interpolation=cv2.INTER_AREA)
    left, top = round(centre[0] - radius), round(centre[1] - radius)
    place = canvas.image[top : top + len(small), left : left + len(small)]
    np.copyto(place, small, where=coverage)


def swatch(canvas: Canvas, left: float, top: float, pattern: str, colour: Colour) -> None:
    """Draw the hatching `pattern` ("/", "\\" or ".") as a sample in a legend: 28 x 18 pixels, corner (left, top)."""
    fine = np.full((36, 56, 3), GROUND, np.uint8)
    fine[_pattern(pattern, 56)[:36]] = colour
    x, y = round(left), round(top)
    canvas.image[y : y + 18, x : x + 28] = cv2.resize(fine, (28, 18), interpolation=cv2.INTER_AREA)


def _warped(values: Values, radius: int) -> npt.NDArray[np.float32]:
    """Square image (row, column) of `values` (zenith, azimuth) on a disc with radius `_OVERSAMPLING` * `radius`."""
    places = _places(radius, *values.shape)
    return np.asarray(cv2.remap(np.asarray(values, np.float32), *places, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE))


@lru_cache(maxsize=16)
def _pattern(pattern: str, side: int) -> npt.NDArray[np.bool_]:
    x, y = np.arange(side)[None, :], np.arange(side)[:, None]
    if pattern == "/":
        return np.asarray((x + y) % 18 < 5)
    if pattern == "\\":
        return np.asarray((x - y) % 18 < 5)
    return np.asarray(((x % 14) < 4) & (((y + 7 * (x // 14 % 2)) % 14) < 4))


@lru_cache(maxsize=8)
def _cover(radius: int) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Masks, True on a disc: (row, column) for the radius `_OVERSAMPLING` * `radius`, (row, column, 1) for `radius`."""
    fine, coarse = (
        np.hypot(a[None, :], a[:, None]) <= radius for a in (_axis(radius, _OVERSAMPLING), _axis(radius, 1))
    )
    return fine, coarse[..., None]


@lru_cache(maxsize=8)
def _places(radius: int, down: int, around: int) -> tuple[Values, Values]:
    """Fixed-point maps for cv2.remap: the column (azimuth) and row (zenith) from which each pixel of a disc is taken.

    There are `down` zenith angles and `around` azimuths; the radius of the disc is `_OVERSAMPLING` * `radius` [pixel].
    """
    axis = _axis(radius, _OVERSAMPLING)
    x, y = axis[None, :], -axis[:, None]
    column = np.mod(np.arctan2(x, y) / np.float32(2 * np.pi), 1.0) * (around - 1)
    row = np.minimum(np.hypot(x, y) * np.float32((down - 1) / radius), down - 1)
    return cv2.convertMaps(column.astype(np.float32), row.astype(np.float32), cv2.CV_16SC2)


def _axis(radius: int, fine: int) -> npt.NDArray[np.float32]:
    return ((np.arange(2 * radius * fine) + 0.5) / fine - radius).astype(np.float32)


def _fixed(points: Sequence[Point]) -> npt.NDArray[np.int32]:
    return np.rint(np.asarray(points, np.float64) * 2**_SUBPIXEL_BITS).astype(np.int32)
