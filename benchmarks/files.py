"""Files of the benchmarks: recorded scenes and images as arrays."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rasterio

from deglint import Recipe, open_scene, remove_glint

from .timing import ROOT

DATA = ROOT.parent / "shared" / "data"
"""Where recorded scenes lie, beside the project and no part of it."""


def values(path: Path) -> npt.NDArray[np.float64]:
    """Physical values of a file, (band, row, column)."""
    return open_scene(path).read().astype(np.float64)


def plane(path: Path, band: int = 1) -> npt.NDArray[Any]:
    """The numbers of one band of a file, (row, column)."""
    with rasterio.open(path) as data:
        return np.asarray(data.read(band))


def removed(source: Path, recipe: Recipe) -> npt.NDArray[np.float64]:
    """What a recipe makes of a file, written in its own type of number and read again, (band, row, column)."""
    with tempfile.TemporaryDirectory() as place:
        remove_glint(source, out := Path(place) / "clean.tif", recipe)
        return values(out)
