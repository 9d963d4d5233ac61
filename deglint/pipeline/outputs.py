"""Names of the outputs of a run, and its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..checks import as_path, check_choice
from ..errors import DeglintError
from ..raster.environment import environment
from ..scene import Band, FloatArray
from .fit import Fitted
from .overview import raster_of

BESIDE = ("flags", "amount", "stderr", "sample", "model", "picture")
"""Optional outputs besides the image and its sidecar."""
DTYPES = ("float32", "float64", "uint8", "uint16", "int16", "uint32", "int32")
"""Data types that an output can have."""


@dataclass(frozen=True)
class Outputs:
    """Names and options of the outputs.

    `request`, the checksum of a batch's options, is stored in the sidecar with the properties of the outputs, so that
    finished outputs are recognised. No output may replace `reads`, input files besides the scene and the files in the
    recipe.
    """

    image: Path  # the deglinted raster; its sidecar is this with ".json" appended
    flags: Path | None = None  # flags and classes of sun glint
    amount: Path | None = None  # amounts of sun glint removed
    stderr: Path | None = None  # standard errors
    sample: Path | None = None  # the sample as GeoJSON
    model: Path | None = None  # the fitted model
    picture: Path | None = None  # before and after
    overwrite: bool = False  # replace what exists
    dtype: str | None = None  # of the image; the input's by default
    options: Mapping[str, str] = field(default_factory=dict)  # GDAL creation options
    request: str | None = None
    reads: Sequence[str | Path] = ()

    def __post_init__(self) -> None:
        for name in ("image", *BESIDE):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, Path(as_path(value, name)))
        if self.dtype is not None:
            check_choice(self.dtype, list(DTYPES), "dtype")

    @property
    def sidecar(self) -> Path:
        """Name of the sidecar."""
        return self.image.parent / f"{self.image.name}.json"

    def every(self) -> list[Path]:
        """All files that will be written."""
        beside = (getattr(self, name) for name in BESIDE)
        return [self.image, self.sidecar, *(path for path in beside if path is not None)]


@dataclass
class PixelCounts:
    """Number of pixels of a tile or of the whole run by result; counts per band are arrays in scene order, or 0.

    Of copied tiles only the total is known. `rewritten` counts pixels that compensation changed in bands without a
    removal, `glint` the pixels of each class of sun glint.
    """

    total: int = 0
    copied: int = 0  # tiles
    nodata: int = 0
    not_water: int = 0
    corrected: int = 0
    protected: int = 0
    replaced: Any = 0
    rewritten: Any = 0
    negative: Any = 0
    clipped: Any = 0
    saturated: Any = 0
    glint: Any = 0

    def add(self, other: PixelCounts) -> None:
        """Add a tile's counts."""
        for name, count in vars(other).items():
            setattr(self, name, getattr(self, name) + count)


@dataclass(frozen=True)
class Result:
    """Result of a run.

    Attributes
    ----------
    fitted : Fitted
    tally : PixelCounts
    sidecar : dict
        Content of the sidecar.
    warnings : tuple of str
    """

    fitted: Fitted
    tally: PixelCounts
    sidecar: dict[str, Any]
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        pixels = f"{self.tally.corrected} of {self.tally.total} pixels"
        bands = ", ".join(self.changed) or "none"
        return f"Result({self.sidecar['output']!r}, {self.fitted.model.method}, {pixels} of bands {bands})"

    def _repr_html_(self) -> str:
        from ..notebook import shown, stretched

        pixels = self.sidecar["pixels"]["changed"]
        rows = [(b["name"], f"{pixels.get(b['name'], 0)} pixels changed") for b in self.sidecar["bands"]]
        rows += [("warning", w) for w in self.warnings]
        images = [self._middle([i["path"] for i in self.sidecar["input"]]), self._middle([self.sidecar["output"]])]
        found = [image for image in images if image is not None]
        return shown(repr(self), rows, stretched(found) if len(found) == 2 else None)

    def _middle(self, paths: list[str]) -> FloatArray | None:
        """The central part of the image in some files, if it can be read."""
        from ..readers import open_scene

        try:
            with environment():
                scene = open_scene(paths)
                with raster_of(scene):
                    return replace(scene, bands=tuple(Band(**b) for b in self.sidecar["bands"])).middle()
        except (DeglintError, IndexError):
            return None

    @property
    def changed(self) -> tuple[str, ...]:
        """Names of the bands that differ from the input; the others are copied."""
        return tuple(self.sidecar["pixels"]["changed"])
