"""Chips: a small picture of every object with the raw scene, the scored scene and the scores side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deglint.raster.output import Scratch, write_bytes
from deglint.readers.roles import band_roles
from deglint.readers.text import read_json
from deglint.scene import Scene

from ..arrays import Array, Uint8
from ..objects import Object
from .plan import Plan
from .recipe import Outputs

CHIP_SIDE = 64
"""Minimum side of a chip [pixel of the scene]."""
_CHIP_MARGIN = 12
"""Margin around an object [pixel of the scene]."""
_SIZE = 192
"""Minimum side of a panel [pixel of the picture]."""
_STRETCH = (2.0, 99.8)
"""Percentiles that are shown as black and white: the object has few pixels of a chip."""


def write_chips(
    plan: Plan, targets: Outputs, scores: Any, found: Sequence[Object], scratch: Scratch
) -> list[str | None]:
    """Write a PNG of every object into the folder of `targets`; return their names.

    Panels: the scene before glint removal, where the sidecar names the file; the scene; the scores.
    """
    if targets.chips is None:
        return [None] * len(found)
    import cv2
    from rasterio.windows import Window

    targets.chips.mkdir(parents=True, exist_ok=True)
    scenes = [*_raw_of(plan.scene), plan.scene]
    names: list[str | None] = []
    for o in found:
        (rows, columns) = (_around(*ends, size) for ends, size in zip(
            o.bounds, (plan.scene.height, plan.scene.width), strict=True))  # fmt: skip
        panels = [_coloured(scene.read((rows, columns), bands=_rgb(scene))) for scene in scenes]
        window = Window(columns[0], rows[0], columns[1] - columns[0], rows[1] - rows[0])
        panels.append(_coloured(np.stack([scores.read(1, window=window)] * 3)))
        times = max(-(-_SIZE // max(panels[0].shape[:2])), 1)
        gap = np.full((panels[0].shape[0] * times, 4, 3), 255, np.uint8)
        large = [p.repeat(times, axis=0).repeat(times, axis=1) for p in panels]
        picture = np.concatenate([x for p in large for x in (p, gap)][:-1], axis=1)
        name = f"object_{o.label:04d}.png"
        _done, png = cv2.imencode(".png", np.ascontiguousarray(picture[:, :, ::-1]))
        write_bytes(scratch, targets.chips / name, bytes(png))
        names.append(f"{targets.chips.name}/{name}")
    return names


def _around(start: int, stop: int, size: int) -> tuple[int, int]:
    """Range of rows or columns of a chip: the object with its margin, within the scene."""
    side = min(max(stop - start + 2 * _CHIP_MARGIN, CHIP_SIDE), size)
    low = min(max((start + stop - side) // 2, 0), size - side)
    return low, low + side


def _rgb(scene: Scene) -> list[int]:
    """0-based bands for red, green and blue; one band three times (grey) where not all are known."""
    roles = band_roles(scene)
    known = [i for role in ("red", "green", "blue") if (i := roles[role]) is not None]
    return known if len(known) == 3 else [(known or [0])[0]] * 3


def _raw_of(scene: Scene) -> list[Scene]:
    """The scene before removal, if the sidecar names its files and they have the same grid."""
    from deglint.errors import DeglintError
    from deglint.readers import open_scene

    try:
        files = read_json(f"{scene.path}.json", "sidecar")["input"]["files"]
        raw = open_scene([str(Path(f["path"] if isinstance(f, dict) else f)) for f in files])
    except (DeglintError, KeyError, TypeError, OSError):
        return []
    return [raw] if (raw.height, raw.width) == (scene.height, scene.width) else []


def _coloured(image: Array) -> Uint8:
    """(band, row, column) to (row, column, band) of uint8; every band is stretched between its own percentiles."""
    out = []
    for band in image:
        good = band[np.isfinite(band)]
        low, high = np.percentile(good, _STRETCH) if good.size else (0.0, 1.0)
        out.append(np.clip((band - low) / max(high - low, 1e-12), 0, 1))
    return np.asarray(np.nan_to_num(np.stack(out, axis=-1)) * 255, np.uint8)
