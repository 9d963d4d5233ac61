"""What the sidecar says: with what, on what, how, and what came of it. Made by the program, read by people and
programs."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from .. import __version__
from ..compensate.stages import Chain, chain_from
from ..errors import InputError
from ..readers.text import read_text
from ..remove import GlintModel
from ..scene import Scene

if TYPE_CHECKING:
    from ..checksum import Checksum
    from .fit import Fitted
    from .outputs import Outputs, PixelCounts

COPIED = "no band needs a correction: copied as they are, and not counted by kind"


def sidecar(
    scene: Scene, fitted: Fitted, targets: Outputs, tally: PixelCounts, checksum: Checksum, seconds: float
) -> dict[str, Any]:
    """Everything about a run, as plain numbers and words."""
    names = scene.names
    warnings = [*fitted.model.warnings, *_losses(names, tally)]
    return {
        "deglint": __version__,
        "versions": versions(),
        "input": checksum.result(),
        "output": str(targets.image),
        "product": scene.product,
        "sensor": scene.sensor,
        "bands": [asdict(b) for b in scene.bands],
        "recipe": resolved(fitted),
        "model": asdict(fitted.model),
        **fitted.numbers,
        "skipped": skipped(fitted, names, tally),
        "pixels": {
            "total": tally.total,
            "nodata": None if tally.copied else tally.nodata,
            "not_water": None if tally.copied else tally.not_water,
            "corrected": tally.corrected,
            "protected": tally.protected,
            "changed": changed(fitted, names, tally),
            "replaced": dict(zip(names, tally.replaced, strict=True)),
            "negative_after": dict(zip(names, tally.negative, strict=True)),
            "saturated_before": None if tally.copied else dict(zip(names, tally.saturated, strict=True)),
            "clipped": dict(zip(names, tally.clipped, strict=True)),
        },
        "notes": [*scene.notes, *fitted.notes],
        "warnings": warnings,
        "seconds": round(seconds, 3),
    }


def resolved(fitted: Fitted) -> dict[str, Any]:
    """The recipe with the bands that were taken where it left them to be found."""
    recipe, model = asdict(fitted.recipe), fitted.model
    recipe["regression"] = model.regression
    if recipe["nir_use"] == "auto":
        recipe["nir_use"] = "set" if len(model.indexes) > 1 else "mean"
    recipe["nir"] = [model.band_names[b] for b in model.index_bands]
    recipe["bands"] = [fit.name for fit in model.fits]
    return recipe


def changed(fitted: Fitted, names: Sequence[str], tally: PixelCounts) -> dict[str, int]:
    """Pixels of each band that differ from the input, at most; bands that are copied are not named."""
    removed = {f.band for f in fitted.model.fits}
    counts = [tally.corrected if i in removed else int(tally.rewritten[i]) for i in range(len(names))]
    return {name: n for name, n in zip(names, counts, strict=True) if n}


def skipped(fitted: Fitted, names: Sequence[str], tally: PixelCounts) -> dict[str, str]:
    """What was not done, and why."""
    out = {"pixels": COPIED} if tally.copied else {}
    if fitted.recipe.mask == "none":
        out["water mask"] = "not asked for: every valid pixel is corrected"
    elif fitted.recipe.mask != "auto":
        out["water mask"] = f"given: {fitted.recipe.mask}"
    elif fitted.water is None:
        out["water mask"] = "no visible band to tell water by: every valid pixel is corrected"
    corrected = {f.band for f in fitted.model.fits}
    for i, name in enumerate(names):
        if i not in corrected:
            why = "glint reference" if i in fitted.model.index_bands else "not among the bands to correct"
            copied = not tally.rewritten[i]
            done = "copied" if copied else f"no glint removed, {tally.rewritten[i]} pixels replaced by compensation"
            out[name] = f"{why}: {done}"
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


def _losses(names: Sequence[str], tally: PixelCounts) -> list[str]:
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


def saved(fitted: Fitted) -> str:
    """A fit as JSON text (what `--save-model` writes)."""
    data = json.loads(fitted.model.to_json())
    if fitted.chain.runs:
        data["compensation"] = fitted.chain.numbers()
    return json.dumps(data, indent=2)


def load_model(path: str) -> GlintModel:
    """Read the model of a removal that `--save-model` wrote.

    Raises
    ------
    ReadError, InputError
        No such file, or not a saved model.
    """
    text = read_text(path, "--model")
    try:
        return GlintModel.from_json(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def load_chain(path: str) -> Chain:
    """Read the compensation that was saved with a model; one of no stages where there was none.

    Raises
    ------
    ReadError, InputError
        No such file, or not a saved compensation.
    """
    text = read_text(path, "--model")
    try:
        found = json.loads(text).get("compensation")
        if not found:
            return Chain()
        return chain_from(found)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: {error}") from error
