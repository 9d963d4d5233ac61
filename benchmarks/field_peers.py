"""Run other programs that remove or mask sun glint, each from a copy of its own code.

One folder holds the copies: Python packages as `pip install --no-deps --target FOLDER` installs them, and repositories
that are no packages. They are no part of the project, and this module repeats none of their code.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib import import_module
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock, patch

import numpy as np
import numpy.typing as npt
import rasterio

Array = npt.NDArray[np.floating[Any]]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Told:
    """Input of a program for one scene. Bands are numbered from 0."""

    image: Array  # (band, row, column)
    full: Array  # physical value of full scale, (band, 1, 1)
    nir: int
    visible: tuple[int, ...]
    wavelengths: tuple[float, ...]  # [nm], 0 if unknown
    deep: Mask  # pixels of deep water

    def with_visible(self, corrected: Array) -> Array:
        """A copy of the image in which `corrected` replaces the visible bands."""
        out = self.image.copy()
        out[list(self.visible)] = corrected
        return out


Remove = Callable[[Told], Array]


def on_path(*folders: Path) -> AbstractContextManager[Any]:
    """A context in which modules of these folders can be imported. Installed modules have precedence."""
    return patch.object(sys, "path", [*sys.path, *map(str, folders)])


def bare(name: str, folder: Path) -> None:
    """Let modules of a package be imported without running its `__init__`, which imports maps, plots and more."""
    if not folder.is_dir():
        raise ModuleNotFoundError(f"no folder {folder.name}/ of {name}")
    package = ModuleType(name)
    package.__path__ = [str(folder)]
    sys.modules[name] = package


def sungc(folder: Path, name: str) -> Remove:
    """The function `name` of sungc, which corrects arrays; sungc's own class for image products calls it."""
    with on_path(folder, folder / "sun-glint-correction"):
        algorithms = import_module("sungc.algorithms")

    def remove(told: Told) -> Array:
        nir, sea = told.image[told.nir], np.ones(told.deep.shape, np.bool_)
        bands = [told.image[b] for b in told.visible]
        if name == "subtract_backend":
            return told.with_visible(np.stack([algorithms.subtract_backend(b, nir, sea, np.nan) for b in bands]))
        found = [algorithms.hedley_backend(b, nir, sea, told.deep, np.nan, None)[0] for b in bands]
        return told.with_visible(np.stack(found))

    return remove


def sensingpy(folder: Path, name: str) -> Remove:
    """The function `name` of `sensingpy.preprocessing.deglinting`. It changes its input, so it gets a copy."""
    with on_path(folder):
        bare("sensingpy", folder / "sensingpy")
        bare("sensingpy.preprocessing", folder / "sensingpy" / "preprocessing")
        method = getattr(import_module("sensingpy.preprocessing.deglinting"), name)

    def remove(told: Told) -> Array:
        return told.with_visible(method(told.deep, told.image[list(told.visible)].copy(), told.image[told.nir]))

    return remove


def stereo_pipeline(folder: Path, _name: str) -> Remove:
    """The tool `glint_correct` of the Ames Stereo Pipeline, with arrays in place of files and without its plots."""
    path = folder / "StereoPipeline" / "src" / "asp" / "Tools" / "glint_correct"
    if not path.exists():
        raise ModuleNotFoundError("no file StereoPipeline/src/asp/Tools/glint_correct")
    sys.modules.setdefault("osgeo", MagicMock())
    tool: Any = ModuleType("glint_correct")
    SourceFileLoader("glint_correct", str(path)).exec_module(tool)
    files: dict[str, Array] = {}
    tool._read_band = lambda name: (files[name].astype(np.float64), None, 1.0)
    tool.save_regression_plot = tool.print = lambda *_, **__: None

    def remove(told: Told) -> Array:
        files.update(nir=told.image[told.nir], mask=~told.deep)
        found = []
        for b in told.visible:
            files["band"] = told.image[b]
            names = "band", "nir", "mask", "out.tif"
            found.append(tool.apply_hedley_correction(*names, deep_water_buffer=0, correct_land=True)[0])
        return told.with_visible(np.stack(found))

    return remove


def dronewq(folder: Path, _name: str) -> Remove:
    """Hedley's method of DroneWQ, fitted to all pixels of an image. Each call takes four bands and the NIR."""
    with on_path(folder):
        for part in ("", ".lw_methods", ".utils"):
            bare(f"dronewq{part}", folder.joinpath("dronewq", *part.split(".")))
        hedley = import_module("dronewq.lw_methods.hedley")
        image_of = import_module("dronewq.utils.data_types").Image

    def remove(told: Told) -> Array:
        method, out = hedley.Hedley(), told.image.copy()
        with tempfile.TemporaryDirectory() as place:
            for start in range(0, len(told.visible), 4):
                part = list(told.visible[start : start + 4])
                bands = [*(part * 4)[:4], told.nir]
                data = told.image[bands].astype(np.float32)
                shape = dict(zip(("count", "height", "width"), data.shape, strict=True))
                with rasterio.open(f"{place}/lt.tif", "w", driver="GTiff", dtype="float32", **shape) as file:
                    file.write(data)
                hedley.settings.lt_dir = place
                method.preprocess()
                out[part] = method(image_of("lt.tif", place, "", None, data, 0)).data[: len(part)]
        return out

    return remove


def sugar(folder: Path, _name: str) -> Remove:
    """SUGAR, three iterations as in its papers. It replaces flashes (found by Laplacian) by an erosion of 5 pixels."""
    sys.modules.setdefault("preprocessing", MagicMock())  # of its window; only names of bands come from there
    with on_path(folder, folder / "CoastalWQL"):
        tool = import_module("sunglint_correction.SUGAR")

    def remove(told: Told) -> Array:
        cube = np.ascontiguousarray(np.moveaxis(told.image[list(told.visible)], 0, 2))
        return told.with_visible(np.moveaxis(tool.correction_iterative(cube, iter=3)[-1], 2, 0))

    return remove


def glint_mask(folder: Path, _name: str) -> Remove:
    """GlintMaskGenerator with its default thresholds for a MicaSense camera; masked pixels become NaN."""
    with on_path(folder):
        masks, sensors = import_module("glint_mask_tools.glint_algorithms"), import_module("glint_mask_tools.sensors")
    thresholds = sensors.msre_sensor.get_default_thresholds()

    def remove(told: Told) -> Array:
        wanted = [int(np.argmin(np.abs(np.array(told.wavelengths) - w))) for w in (475, 560, 668, 717)] + [told.nir]
        cube = np.moveaxis((told.image / told.full)[wanted], 0, 2)
        return np.where(masks.ThresholdAlgorithm(thresholds)(cube), np.nan, told.image)

    return remove


@dataclass(frozen=True)
class Peer:
    """A way to run a program: its name in tables, the function above that loads it, and that function's `name`."""

    name: str
    load: Callable[[Path, str], Remove]
    function: str = ""


PEERS = (
    Peer("sungc, Hedley", sungc, "hedley_backend"),
    Peer("sungc, NIR subtraction", sungc, "subtract_backend"),
    Peer("sensingpy, Hedley", sensingpy, "hedley"),
    Peer("sensingpy, Joyce", sensingpy, "joyce"),
    Peer("sensingpy, Lyzenga", sensingpy, "lyzenga"),
    Peer("ASP glint_correct", stereo_pipeline),
    Peer("DroneWQ, Hedley", dronewq),
    Peer("SUGAR", sugar),
    Peer("GlintMaskGenerator (mask)", glint_mask),
)
