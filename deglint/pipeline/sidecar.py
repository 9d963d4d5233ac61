"""What the sidecar says: with what, on what, how, and what came of it. Made by the program, read by people and
programs."""

from __future__ import annotations

import platform
import stat
import threading
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import __version__
from ..errors import ReadError
from ..scene import Scene

if TYPE_CHECKING:
    from .apply import Outputs
    from .fit import Fitted
    from .tally import Tally

_CHUNK = 1 << 20
COPIED = "no band needs a correction: copied as they are, and not counted by kind"


class Checksum:
    """CRC-32 of the input files' bytes, computed on a thread of its own while the work goes on.

    Names that are not local files (/vsis3/, zip://) have none.
    """

    def __init__(self, paths: Sequence[str]) -> None:
        self._paths = tuple(paths)
        self._found: list[dict[str, Any]] = []
        self._before = [_stamp(path) for path in self._paths]
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def result(self) -> list[dict[str, Any]]:
        """For each file its name, size [byte] and checksum (8 hexadecimal digits), or None.

        Raises
        ------
        ReadError
            A file was changed while it was read: what was made of it is of no one state of it.
        """
        self._thread.join()
        for path, before in zip(self._paths, self._before, strict=True):
            if _stamp(path) != before:
                raise ReadError(f"{path} was changed while it was read. Run again when it is whole.")
        return [{k: v for k, v in file.items() if k != "modified_ns"} for file in self._found]

    def fingerprints(self) -> list[dict[str, Any]]:
        """The same, with the times of the last change."""
        self._thread.join()
        return self._found

    def _work(self) -> None:
        self._found = [{"path": path, **fingerprint(path)} for path in self._paths]


def fingerprint(path: str | Path) -> dict[str, Any]:
    """Size [byte], time of the last change [ns] and CRC-32 (8 hexadecimal digits) of a file; None where it has none."""
    stamp = _stamp(path)
    try:
        with Path(path).open("rb", buffering=0) as file:
            crc = 0
            while chunk := file.read(_CHUNK):
                crc = zlib.crc32(chunk, crc)
    except (OSError, ValueError):
        stamp = None
    if stamp is None:
        return {"bytes": None, "crc32": None, "modified_ns": None}
    return {"bytes": stamp[0], "crc32": f"{crc:08x}", "modified_ns": stamp[1]}


def is_as(path: str | Path, said: Mapping[str, Any]) -> bool:
    """Whether a file is the one that `fingerprint` said this of: read only where size or time do not tell."""
    stamp = _stamp(path)
    if stamp is None:
        return said.get("bytes") is None
    if stamp[0] != said.get("bytes"):
        return False
    return stamp[1] == said.get("modified_ns") or fingerprint(path)["crc32"] == said.get("crc32")


def _stamp(path: str | Path) -> tuple[int, int] | None:
    """Size and time of the last change of a local file."""
    try:
        found = Path(path).stat()
    except (OSError, ValueError):
        return None
    return (found.st_size, found.st_mtime_ns) if stat.S_ISREG(found.st_mode) else None


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
        "skipped": skipped(fitted, names) | _not_looked_at(tally),
        "pixels": {
            "total": tally.total,
            "nodata": None if tally.copied else tally.nodata,
            "not_water": None if tally.copied else tally.not_water,
            "corrected": tally.corrected,
            "protected": tally.protected,
            "replaced": dict(zip(names, tally.replaced, strict=True)),
            "negative_after": dict(zip(names, tally.negative, strict=True)),
            "saturated_before": None if tally.copied else dict(zip(names, tally.saturated, strict=True)),
            "clipped": dict(zip(names, tally.clipped, strict=True)),
        },
        "notes": [*scene.notes, *fitted.notes],
        "warnings": warnings,
        "seconds": round(seconds, 3),
    }


def _not_looked_at(tally: Tally) -> dict[str, str]:
    """Pixels that were not computed, and why."""
    if tally.copied:
        return {"pixels": COPIED}
    if not tally.passed:
        return {}
    part = tally.passed / tally.total
    return {
        "compensation": f"{part:.1%} of the pixels lie in tiles where nothing is to be corrected: passed as they are"
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
