"""Outputs of a run: paths of the files, the `Result`, the content of the sidecar, log lines, and saved fits."""

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from .. import __version__
from ..checks import as_path, check_choice
from ..checksum import Checksum
from ..compensate.stages import Chain, chain_from
from ..errors import InputError
from ..raster import RasterSource
from ..raster.output import DTYPES, plain
from ..readers.products.drone import UNREGISTERED
from ..readers.text import read_text
from ..remove import GlintModel
from ..scene import Scene
from .fit import Fitted
from .messages import log
from .overview import raster_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BESIDE = {"flags": "tif", "amount": "tif", "stderr": "tif", "sample": "geojson", "model": "json", "picture": "png"}
"""Optional outputs beside the image and its sidecar, and the usual extensions of their file names."""
Counts = npt.NDArray[np.int64] | int
Saved = tuple[GlintModel | None, Chain | None]  # result of `load_fit`, or (None, None) without a saved model


@dataclass(frozen=True)
class Outputs:
    """Paths of the output files, and options for writing them."""

    image: Path  # the corrected raster; the sidecar has its name with ".json" appended
    flags: Path | None = None  # flags and classes of sun glint
    amount: Path | None = None  # amounts of sun glint removed
    stderr: Path | None = None  # standard errors
    sample: Path | None = None  # the sample as GeoJSON
    model: Path | None = None  # the fitted model
    picture: Path | None = None  # picture of the image before and after the correction
    overwrite: bool = False  # replace existing files
    dtype: str | None = None  # data type of the image; the type of the input by default
    options: Mapping[str, str] = field(default_factory=dict)  # GDAL creation options
    request: str | None = None  # checksum of a batch's options, by which finished outputs are recognised
    reads: Sequence[str | Path] = ()  # input files beside those of scene and recipe; no output may replace an input

    def __post_init__(self) -> None:
        for name in ("image", *BESIDE):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, Path(as_path(value, name)))
        if self.dtype is not None:
            check_choice(self.dtype, list(DTYPES), "dtype")

    @property
    def sidecar(self) -> Path:
        """Path of the sidecar, the JSON file beside the image that says what was done and why."""
        return self.image.parent / f"{self.image.name}.json"

    def every(self) -> list[Path]:
        """Paths of all files that will be written."""
        beside = (getattr(self, name) for name in BESIDE)
        return [self.image, self.sidecar, *(path for path in beside if path is not None)]


@dataclass
class PixelCounts:
    """Numbers of pixels of a tile or a run. Numbers for each band are arrays (band,), or 0 if nothing was counted."""

    total: int = 0
    nodata: int = 0  # not valid
    not_water: int = 0  # not water, or outside the mask
    corrected: int = 0  # with the flag "corrected"
    protected: int = 0  # targets
    replaced: Counts = 0  # for each band: glint replaced by a chain
    changed: Counts = 0  # for each band: not copied
    negative: Counts = 0  # for each band: below 0 after the correction
    clipped: Counts = 0  # for each band: clipped to the range of the output's type
    saturated: Counts = 0  # for each band: saturated before the correction
    glint: Counts = 0  # for each class of sun glint

    def add(self, other: Self) -> None:
        """Add the counts of another tile to these counts."""
        for name, count in vars(other).items():
            setattr(self, name, getattr(self, name) + count)

    def by_band(self, name: str, names: Sequence[str]) -> dict[str, np.int64]:
        """The counts in field `name`, one for each band, as a dictionary; its keys are the band `names`."""
        return dict(zip(names, np.broadcast_to(getattr(self, name), len(names)), strict=True))


@dataclass(frozen=True)
class Result:
    """Result of a run of `remove_glint`.

    Attributes
    ----------
    fitted, counts : Fitted, PixelCounts
        What was fitted to the scene, and the numbers of corrected and of other pixels.
    sidecar, warnings : dict, tuple of str
        Content of the sidecar, and the warnings in it.
    scene : Scene
        The input.
    """

    fitted: Fitted
    counts: PixelCounts
    sidecar: dict[str, Any]
    warnings: tuple[str, ...]
    scene: Scene

    def __repr__(self) -> str:
        pixels = f"{self.counts.corrected} of {self.counts.total} pixels"
        bands = ", ".join(self.changed) or "none"
        return f"Result({self.sidecar['output']!r}, {self.fitted.model.method}, {pixels} of bands {bands})"

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the scene before and after the correction with the same contrast; `ax` and result: see `Scene.plot`."""
        from ..plotting import drawn
        from ..readers import open_scene

        source = raster_of(self.scene)
        before, after = RasterSource(source.files, source.info), open_scene(self.sidecar["output"])
        with before, raster_of(after):
            return drawn([replace(self.scene, source=before), after], ax, "Result.plot")

    @property
    def changed(self) -> tuple[str, ...]:
        """Names of the bands with changed pixels; the other bands are copied."""
        return tuple(self.sidecar["pixels"]["changed"])


def log_result(scene: Scene, fitted: Fitted, said: dict[str, Any]) -> None:
    """Log changed and copied bands, warnings of the run, and counts of pixels; `said` is the sidecar's content."""
    pixels = said["pixels"]
    kinds = {"changed": pixels["changed"], "copied": [n for n in scene.names if n not in pixels["changed"]]}
    log.info("bands %s", "; ".join(f"{kind}: {', '.join(some)}" for kind, some in kinds.items() if some))
    for warning in said["warnings"][len(fitted.model.warnings) :]:  # the model's were logged when it was fitted
        log.warning("%s", warning)
    numbers = pixels["corrected"], pixels["total"], said["seconds"]
    log.info("%s: %d of %d pixels corrected in %.2f s", said["output"], *numbers)


def sidecar(
    scene: Scene, fitted: Fitted, targets: Outputs, counts: PixelCounts, checksum: Checksum, seconds: float
) -> dict[str, Any]:
    """Content of the sidecar, as nested dictionaries; `checksum`: of the input; `seconds`: duration of the run."""
    by_band = partial(counts.by_band, names=scene.names)
    return {
        "deglint": __version__,
        "versions": versions(),
        "input": checksum.result(),
        "output": str(targets.image),
        "product": scene.product,
        "sensor": scene.sensor,
        "bands": [asdict(b) for b in scene.bands],
        "recipe": _resolved(fitted),
        "model": asdict(fitted.model),
        "water": fitted.water.numbers() if fitted.water else None,
        "sample": fitted.sampled,
        "choice": fitted.choice.numbers() if fitted.choice else None,
        "compensation": fitted.chain.numbers(),
        "skipped": _skipped(fitted, scene.names, counts),
        "pixels": {
            **{k: getattr(counts, k) for k in ("total", "nodata", "not_water", "corrected", "protected")},
            "changed": {name: n for name, n in by_band("changed").items() if n},
            "replaced": by_band("replaced"),
            "negative_after": by_band("negative"),
            "saturated_before": by_band("saturated"),
            "clipped": by_band("clipped"),
        },
        "notes": [*scene.notes, *fitted.notes],
        "warnings": [*fitted.model.warnings, *_doubts(scene, counts)],
        "seconds": round(seconds, 3),
    }


def _resolved(fitted: Fitted) -> dict[str, object]:
    """The recipe for the sidecar, with the regression, the use of the NIR and the bands that were really used."""
    recipe, model = asdict(fitted.recipe), fitted.model
    if recipe["nir_use"] == "auto":
        recipe["nir_use"] = "set" if len(model.indexes) > 1 else "mean"
    nir, bands = [model.band_names[b] for b in model.index_bands], [fit.name for fit in model.fits]
    return recipe | {"regression": model.regression, "nir": nir, "bands": bands}


def _skipped(fitted: Fitted, names: Sequence[str], counts: PixelCounts) -> dict[str, str]:
    """Reasons why water was not searched for (key "water mask"), and why bands were not corrected (key: band name)."""
    out: dict[str, str] = {}
    if fitted.recipe.mask == "none":
        out["water mask"] = "not searched for, as the mask is none: every valid pixel is corrected"
    elif fitted.recipe.mask != "auto":
        out["water mask"] = f"given: {fitted.recipe.mask}"
    elif fitted.water is None:
        out["water mask"] = "no band below 750 nm is known: every valid pixel is corrected"
    corrected = {f.band for f in fitted.model.fits}
    for i, (name, pixels) in enumerate(counts.by_band("changed", names).items()):
        if i not in corrected:
            reason = "glint reference" if i in fitted.model.index_bands else "not among the bands to correct"
            replaced = f"no glint removed, {pixels} pixels replaced by compensation"
            out[name] = f"{reason}: {replaced if pixels else 'copied'}"
    return out


def versions() -> dict[str, str]:
    """Versions of the libraries that affect the result."""
    import rasterio

    gdal = {"rasterio": rasterio.__version__, "gdal": rasterio.__gdal_version__}
    return {"python": platform.python_version(), "numpy": np.__version__} | gdal


def _doubts(scene: Scene, counts: PixelCounts) -> list[str]:
    """Warnings about bands that are not registered, and about pixels below zero or clipped to the integer range."""
    said = [note for note in scene.notes if note == UNREGISTERED]
    for kind, what in (("negative", "below zero after correction"), ("clipped", "clipped to the integer range")):
        if bands := ", ".join(f"{name}: {n}" for name, n in counts.by_band(kind, scene.names).items() if n):
            said.append(f"pixels {what} (of {counts.corrected} corrected): {bands}")
    return said


def saved(fitted: Fitted) -> str:
    """The model and the compensation of a fit as JSON text, which `--save-model` writes."""
    compensation = {"compensation": plain(fitted.chain.numbers())} if fitted.chain.runs else {}
    return json.dumps(json.loads(fitted.model.to_json()) | compensation, indent=2)


def load_model(path: str) -> GlintModel:
    """Read a model that `--save-model` wrote. Raises ReadError if the file is unreadable, InputError if it has none."""
    return load_fit(path)[0]


def load_chain(path: str) -> Chain:
    """Read the compensation saved with a model; empty if none was saved. Raises the same errors as `load_model`."""
    return load_fit(path)[1]


def load_fit(path: str) -> tuple[GlintModel, Chain]:
    """Read a model and its compensation (empty if none was saved) from a file; raises the errors of `load_model`."""
    text = read_text(path, "--model")
    try:
        model, chain = GlintModel.from_json(text), json.loads(text).get("compensation")
        return model, chain_from(chain) if chain else Chain()
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: {error}") from error
