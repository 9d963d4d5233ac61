"""What the sidecar says: with what, on what, how, and what came of it. Made by the program, read by people and
programs."""

from __future__ import annotations

import platform
import threading
import zlib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import __version__
from ..scene import Scene
from .fit import Fitted

if TYPE_CHECKING:
    from .apply import Outputs
    from .correct import Tally

_CHUNK = 1 << 20


class Checksum:
    """CRC-32 of the input files' bytes, computed on a thread of its own while the work goes on.

    Names that are not local files (/vsis3/, zip://) have none.
    """

    def __init__(self, paths: Sequence[str]) -> None:
        self._paths = tuple(paths)
        self._found: list[dict[str, Any]] = []
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def result(self) -> list[dict[str, Any]]:
        """For each file its name, size [byte] and checksum (8 hexadecimal digits), or None."""
        self._thread.join()
        return self._found

    def _work(self) -> None:
        for path in self._paths:
            size: int | None = 0
            crc: int | None = 0
            try:
                with Path(path).open("rb", buffering=0) as file:
                    while chunk := file.read(_CHUNK):
                        size, crc = (size or 0) + len(chunk), zlib.crc32(chunk, crc or 0)
            except OSError:
                size = crc = None
            self._found.append({"path": path, "bytes": size, "crc32": None if crc is None else f"{crc:08x}"})


def sidecar(
    scene: Scene, fitted: Fitted, targets: Outputs, tally: Tally, checksum: Checksum, seconds: float
) -> dict[str, Any]:
    """Everything about a run, as plain numbers and words."""
    names = scene.names
    warnings = [*fitted.model.warnings, *_losses(names, tally)]
    return {
        "deglint": __version__,
        "versions": versions(),
        "input": checksum.result(),
        "output": str(targets.image),
        "sensor": scene.sensor,
        "bands": [asdict(b) for b in scene.bands],
        "recipe": resolved(fitted),
        "model": asdict(fitted.model),
        **fitted.numbers,
        "skipped": skipped(fitted, names),
        "pixels": {
            "total": tally.total,
            "nodata": tally.nodata,
            "not_water": tally.not_water,
            "corrected": tally.corrected,
            "protected": tally.protected,
            "replaced": dict(zip(names, tally.replaced, strict=True)),
            "negative_after": dict(zip(names, tally.negative, strict=True)),
            "saturated_before": dict(zip(names, tally.saturated, strict=True)),
            "clipped": dict(zip(names, tally.clipped, strict=True)),
        },
        "notes": [*scene.notes, *fitted.notes],
        "warnings": warnings,
        "seconds": round(seconds, 3),
    }


def resolved(fitted: Fitted) -> dict[str, Any]:
    """The recipe with the bands that were taken where it left them to be found."""
    recipe, model = asdict(fitted.recipe), fitted.model
    if recipe["nir_use"] == "auto":
        recipe["nir_use"] = "set" if len(model.indexes) > 1 else "mean"
    recipe["nir"] = [model.band_names[b] for b in model.index_bands]
    recipe["bands"] = [fit.name for fit in model.fits]
    return recipe


def skipped(fitted: Fitted, names: Sequence[str]) -> dict[str, str]:
    """What was not done, and why."""
    out = {}
    if fitted.recipe.mask == "none":
        out["water mask"] = "not asked for: every valid pixel is corrected"
    elif fitted.recipe.mask != "auto":
        out["water mask"] = f"given: {fitted.recipe.mask}"
    elif fitted.water is None:
        out["water mask"] = "no visible band to tell water by: every valid pixel is corrected"
    corrected = {f.band for f in fitted.model.fits}
    alone = (fitted.numbers.get("sample") or {}).get("left_alone", {})
    for i, name in enumerate(names):
        if i not in corrected:
            why = "glint reference" if i in fitted.model.index_bands else "not among the bands to correct"
            why = alone.get(name, why)
            out[name] = f"{why}: passed unchanged"
    return out


def versions() -> dict[str, str]:
    """Versions of what the numbers depend on."""
    import numpy as np
    import rasterio

    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "rasterio": rasterio.__version__,
        "gdal": rasterio.__gdal_version__,
    }


def _losses(names: Sequence[str], tally: Tally) -> list[str]:
    said = []
    for what, counts in (
        ("below zero after correction", tally.negative),
        ("clipped to the integer range", tally.clipped),
    ):
        worst = [(n, name) for name, n in zip(names, counts, strict=True) if n]
        if worst:
            listed = ", ".join(f"{name} {n}" for n, name in worst)
            said.append(f"pixels {what} (of {tally.corrected} corrected): {listed}")
    return said
