"""Chips: a small picture of every object with the raw scene, the scored scene and the scores side by side."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from deglint.errors import DeglintError
from deglint.notebook import level, stretch
from deglint.raster.output import Scratch, write_bytes
from deglint.readers import open_scene
from deglint.readers.roles import band_roles
from deglint.readers.text import read_json
from deglint.scene import Scene

from ..objects import Object
from .plan import Plan
from .recipe import Outputs

CHIP_SIDE = 64
"""Minimum side of a chip [pixel of the scene]."""
_CHIP_MARGIN = 12
"""Margin around an object [pixel of the scene]."""
_SIZE = 192
"""Minimum side of a panel [pixel of the picture]."""
_GAP = ((0, 0), (0, 4), (0, 0))
"""White margin at the right of a panel [pixel of the picture]."""
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
        rows, columns = (_around(*ends, size) for ends, size in zip(o.bounds, plan.scene.shape[1:], strict=True))
        images = [scene.read((rows, columns), bands=_rgb(scene)) for scene in scenes]
        window = Window(columns[0], rows[0], columns[1] - columns[0], rows[1] - rows[0])
        images.append(np.stack([scores.read(1, window=window)] * 3))
        panels = [stretch(image, *(level(image, percent) for percent in _STRETCH)) for image in images]
        times = max(-(-_SIZE // max(panels[0].shape[:2])), 1)
        large = [np.pad(p.repeat(times, axis=0).repeat(times, axis=1), _GAP, constant_values=255) for p in panels]
        name = f"object_{o.label:04d}.png"
        _done, png = cv2.imencode(".png", np.hstack(large)[:, :, ::-1])
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
    try:
        files = [file["path"] for file in read_json(f"{scene.path}.json", "sidecar")["input"]]
        raw = open_scene(files)
    except (DeglintError, KeyError, TypeError):
        return []
    return [raw] if raw.shape[1:] == scene.shape[1:] else []
