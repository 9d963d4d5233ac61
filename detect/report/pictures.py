"""Pictures of scores as SVG with the pixels inside: the whole scene, and a close look at single places."""

from __future__ import annotations

import struct
import zlib
from base64 import b64encode
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..objects import Object
from ..roc import ObjectScore

_LONGEST = 640
_SMALL, _LARGE = 32, 160
"""Sides of a close look [pixel]."""
_MOST_MARKS = 400
_MOST_PARTS = 40


def shrink(scores: npt.NDArray[Any], valid: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[Any], int]:
    """The scene at a size to be looked at, and how many pixels a side each of its cells holds.

    A cell has the highest of its scores, so that small objects stay visible; NaN where none is valid.
    """
    height, width = scores.shape
    step = max(1, -(-max(height, width) // _LONGEST))
    tall, wide = -(-height // step), -(-width // step)
    padded = np.full((tall * step, wide * step), -np.inf, scores.dtype)
    np.copyto(padded[:height, :width], scores, where=valid)
    seen = padded.reshape(tall, step, wide, step).max(axis=(1, 3))
    seen[np.isneginf(seen)] = np.nan
    return seen, step


def stretch(seen: npt.NDArray[Any]) -> tuple[float, float]:
    """Scores that are drawn darkest and lightest: the median and the highest thousandth of what is seen."""
    known = seen[np.isfinite(seen)]
    low, high = (float(v) for v in np.percentile(known, [50, 99.9]))
    return (low, high) if high > low else (float(known.min()), float(known.max()))


def overview(
    seen: npt.NDArray[Any], step: int, shape: tuple[int, int], limits: tuple[float, float],
    targets: Sequence[tuple[ObjectScore, bool]], alarms: Sequence[Object],
) -> str:  # fmt: skip
    """The scene, its objects (found or not) in boxes and false alarms with their numbers, as an SVG element."""
    height, width = shape
    unit = max(height, width) / 100
    marks = [_box(target, found, unit) for target, found in targets[:_MOST_MARKS]]
    marks += [_ring(number, alarm, unit, width) for number, alarm in enumerate(alarms, start=1)]
    return (
        f'<svg class="scene" viewBox="0 0 {width} {height}" role="img" aria-label="scores of the scene" '
        f'style="aspect-ratio:{width}/{height};max-width:{max(640 * width / height, 120):.0f}px">'
        f'<image href="{_png(seen, limits)}" width="{seen.shape[1] * step}" height="{seen.shape[0] * step}" '
        f'preserveAspectRatio="none"/>{"".join(marks)}</svg>'
    )


def _box(target: ObjectScore, found: bool, unit: float) -> str:
    (top, bottom), (left, right) = target.bounds
    pad = unit * 0.6
    dash = "" if found else ' stroke-dasharray="4 3"'
    box = (f'x="{left - pad:.1f}" y="{top - pad:.1f}" width="{right - left + 2 * pad:.1f}" '
           f'height="{bottom - top + 2 * pad:.1f}" rx="{unit * 0.4:.2f}" fill="none" '
           'vector-effect="non-scaling-stroke"')  # fmt: skip
    said = f"object {target.number}, {'found' if found else 'not found'}"
    return (f'<rect {box} stroke="#000" stroke-opacity=".55" stroke-width="3.4"/>'
            f'<rect {box} stroke="#fff" stroke-width="1.6"{dash}><title>{said}</title></rect>')  # fmt: skip


def _ring(number: int, alarm: Object, unit: float, width: int) -> str:
    row, column = alarm.centroid
    x, y, r = column + 0.5, row + 0.5, unit * 1.3
    side = -1 if x > 0.9 * width else 1
    place = f'cx="{x:.1f}" cy="{y:.1f}" r="{r:.2f}"'
    return (f'<circle {place} class="halo"/><circle {place} class="ring"/>'
            f'<text x="{x + side * r * 1.35:.1f}" y="{max(y - r * 0.5, unit * 3):.2f}" '
            f'style="font-size:{unit * 3.2:.2f}px;stroke-width:{unit * 0.7:.2f}px" '
            f'text-anchor="{"start" if side > 0 else "end"}">{number}</text>')  # fmt: skip


def chip(
    scores: npt.NDArray[Any], valid: npt.NDArray[np.bool_], limits: tuple[float, float], alarm: Object,
    objects: npt.NDArray[Any],
) -> str:  # fmt: skip
    """A false alarm and what lies around it, outlined, as an SVG element; pixels of true objects are hatched white."""
    (row0, row1), (col0, col1) = alarm.bounds
    height, width = scores.shape
    side = int(min(max(_SMALL, 2 * max(row1 - row0, col1 - col0) + 12), _LARGE, max(height, width)))
    top = min(max((row0 + row1 - side) // 2, 0), max(height - side, 0))
    left = min(max((col0 + col1 - side) // 2, 0), max(width - side, 0))
    rows, columns = slice(top, min(top + side, height)), slice(left, min(left + side, width))
    seen = np.where(valid[rows, columns], scores[rows, columns], np.nan)
    tall, wide = seen.shape
    lines = [ring for polygon in alarm.outline[:_MOST_PARTS] for ring in polygon]
    path = "".join("M" + "L".join(f"{x - left:g} {y - top:g}" for x, y in ring) + "Z" for ring in lines)
    truth = "".join(
        f'<rect x="{c}" y="{r}" width="1" height="1" fill="#fff" fill-opacity=".45" shape-rendering="crispEdges"/>'
        for r, c in np.argwhere(objects[rows, columns] != 0)[:2000]
    )
    return (
        f'<svg class="chip" viewBox="0 0 {wide} {tall}" role="img" aria-label="false alarm {alarm.label}">'
        f'<image href="{_png(seen, limits)}" width="{wide}" height="{tall}"/>{truth}'
        f'<path d="{path}" fill="none" stroke="#000" stroke-opacity=".5" stroke-width="3.4" '
        f'vector-effect="non-scaling-stroke"/><path d="{path}" fill="none" stroke="#fff" stroke-width="1.7" '
        f'vector-effect="non-scaling-stroke"/></svg>'
    )


def colour_bar(limits: tuple[float, float], sign: float) -> str:
    """The colours of the scores, with their ends."""
    ramp = _png(np.linspace(0, 1, 256)[None], (0.0, 1.0))
    low, high = (f"{sign * v:.4g}" for v in limits)
    return (f'<span class="bar"><span>{low}</span><img src="{ramp}" alt="dark to light" width="160" height="10">'
            f"<span>{high}</span></span>")  # fmt: skip


def _png(values: npt.NDArray[Any], limits: tuple[float, float]) -> str:
    """Scores in the colours of cividis, grey where not valid, as the data URI of a PNG with a palette."""
    import cv2

    low, high = limits
    known = np.isfinite(values)
    unit = np.clip((np.where(known, values, low) - low) / ((high - low) or 1), 0, 1)
    index = np.where(known, 1 + np.rint(unit * 254), 0).astype(np.uint8)
    ramp = cv2.applyColorMap(np.linspace(0, 255, 255).round().astype(np.uint8)[None], cv2.COLORMAP_CIVIDIS)
    palette = np.concatenate([np.full((1, 3), 225, np.uint8), ramp[0, :, ::-1]])
    tall, wide = index.shape
    rows = np.zeros((tall, wide + 1), np.uint8)  # a 0 before each row: no filter
    rows[:, 1:] = index
    data = b"\x89PNG\r\n\x1a\n" + b"".join((
        _chunk(b"IHDR", struct.pack(">IIBBBBB", wide, tall, 8, 3, 0, 0, 0)),
        _chunk(b"PLTE", palette.tobytes()),
        _chunk(b"IDAT", zlib.compress(rows.tobytes(), 9)),
        _chunk(b"IEND", b""),
    ))  # fmt: skip
    return "data:image/png;base64," + b64encode(data).decode()


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
