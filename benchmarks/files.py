"""Read recorded scenes and images as arrays."""

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
"""Folder of the recorded scenes. It lies beside the project and is no part of it."""


def values(path: Path) -> npt.NDArray[np.float64]:
    """Physical values of an image file, (band, row, column)."""
    return open_scene(path).read().astype(np.float64)


def plane(path: Path, band: int = 1) -> npt.NDArray[Any]:
    """One band of a file as it is stored, without its scale, (row, column). `band` counts from 1."""
    with rasterio.open(path) as data:
        return np.asarray(data.read(band))


def removed(source: Path, recipe: Recipe) -> npt.NDArray[np.float64]:
    """Remove the glint of a file by a recipe; return the result, rounded to the file's data type, as `values` does."""
    with tempfile.TemporaryDirectory() as place:
        remove_glint(source, out := Path(place) / "clean.tif", recipe)
        return values(out)
