"""Record what is done: a log line for each decision during the run, and the sidecar beside the output.

Level INFO has one short line for each decision, DEBUG the reasons. The sidecar has everything, as JSON.
"""

from __future__ import annotations

import json
import logging
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from .. import __version__
from ..compensate.stages import Chain, chain_from
from ..errors import InputError
from ..masks import WaterRule
from ..readers.text import read_text
from ..remove import GlintModel
from ..scene import Scene

if TYPE_CHECKING:
    from ..checksum import Checksum
    from .fit import Fitted
    from .outputs import Outputs, PixelCounts

log = logging.getLogger("deglint.pipeline")

Read = TypeVar("Read")
COPIED = "no band needs a correction: copied as they are, and not counted by kind"


def why(lines: Sequence[str]) -> None:
    """Log reasons at level DEBUG, which -v shows."""
    for line in lines:
        log.debug("  %s", line)


def log_scene(scene: Scene) -> None:
    """Log properties of the scene: size, sensor, band delays."""
    sensor = f", sensor {scene.sensor}" if scene.sensor else ""
    first, *others = scene.path.split(", ")
    name = f"{first} and {len(others)} more" if others else first
    log.info("%s: %d bands, %d x %d pixels%s", name, len(scene.bands), scene.width, scene.height, sensor)
    times = [b.time_offset for b in scene.bands if b.time_offset is not None]
    if len(times) > 1:
        source = f"known for {scene.sensor}" if scene.sensor else "read from file"
        log.info("band delays %s: up to %.0f ms", source, 1e3 * (max(times) - min(times)))
    for line in scene.notes:  # what a product gives and lacks, and what was assumed, is not for -v alone
        log.log(logging.INFO if scene.product or "assumed" in line else logging.DEBUG, "  %s", line)


def log_nir(scene: Scene, bands: Sequence[int], notes: Sequence[str]) -> None:
    """Log which bands show the glint."""
    said = []
    for index in bands:
        band, number = scene.bands[index], f"band {index + 1}"
        name = number if band.name.casefold() == number else f"{number} {band.name}"
        said.append(name + (f" ({band.wavelength:g} nm)" if band.wavelength else ""))
    log.info("NIR: %s", ", ".join(said))
    for note in notes:
        if doubt := note.partition("; warning: ")[2]:
            log.warning("%s", doubt)
    why(notes)


def log_water(rule: WaterRule | None, mask: str) -> None:
    """Log which pixels are corrected."""
    if rule is not None and rule.has_water:
        log.info("water: %s", rule.reason)
    elif mask != "auto":
        log.info("mask: %s%s", mask, ", every valid pixel is corrected" if mask == "none" else "")


def log_model(model: GlintModel, notes: Sequence[str]) -> None:
    """Log the method, its bands, and its warnings."""
    bands = ", ".join(f.name for f in model.fits) or "none"
    log.info("method: %s; bands to correct: %s", model.method, bands)
    why([*notes, *str(replace(model, warnings=())).splitlines()[1:]])
    for warning in model.warnings:
        log.warning("%s", warning)


def log_result(scene: Scene, fitted: Fitted, said: dict[str, Any]) -> None:
    """Log which bands and pixels were changed."""
    pixels = said["pixels"]
    copied = [n for n in scene.names if n not in pixels["changed"]]
    parts = [f"corrected: {', '.join(pixels['changed'])}"] if pixels["changed"] else []
    parts += [f"copied: {', '.join(copied)}"] if copied else []
    log.info("bands %s", "; ".join(parts))
    for warning in said["warnings"][len(fitted.model.warnings) :]:  # the model's were logged when it was fitted
        log.warning("%s", warning)
    corrected, total, seconds = pixels["corrected"], pixels["total"], said["seconds"]
    log.info("%s: %d of %d pixels corrected in %.2f s", said["output"], corrected, total, seconds)


def sidecar(
    scene: Scene, fitted: Fitted, targets: Outputs, tally: PixelCounts, checksum: Checksum, seconds: float
) -> dict[str, Any]:
    """Content of the sidecar, as plain values."""
    names = scene.names

    def by_band(counts: Any) -> dict[str, Any]:
        return dict(zip(names, np.broadcast_to(counts, len(names)), strict=True))

    counted, rewritten = not tally.copied, by_band(tally.rewritten)
    removed = {names[f.band] for f in fitted.model.fits}
    # pixels of each band that differ from the input, at most
    changed = {name: tally.corrected if name in removed else rewritten[name] for name in names}
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
        **fitted.numbers,
        "skipped": _skipped(fitted, names, tally),
        "pixels": {
            "total": tally.total,
            "nodata": tally.nodata if counted else None,
            "not_water": tally.not_water if counted else None,
            "corrected": tally.corrected,
            "protected": tally.protected,
            "changed": {name: n for name, n in changed.items() if n},
            "replaced": by_band(tally.replaced),
            "negative_after": by_band(tally.negative),
            "saturated_before": by_band(tally.saturated) if counted else None,
            "clipped": by_band(tally.clipped),
        },
        "notes": [*scene.notes, *fitted.notes],
        "warnings": [*fitted.model.warnings, *_losses(names, tally)],
        "seconds": round(seconds, 3),
    }


def _resolved(fitted: Fitted) -> dict[str, Any]:
    """The recipe with the bands that were selected automatically."""
    recipe, model = asdict(fitted.recipe), fitted.model
    recipe["regression"] = model.regression
    if recipe["nir_use"] == "auto":
        recipe["nir_use"] = "set" if len(model.indexes) > 1 else "mean"
    recipe["nir"] = [model.band_names[b] for b in model.index_bands]
    recipe["bands"] = [fit.name for fit in model.fits]
    return recipe


def _skipped(fitted: Fitted, names: Sequence[str], tally: PixelCounts) -> dict[str, str]:
    """Steps that were skipped, and why."""
    out = {"pixels": COPIED} if tally.copied else {}
    if fitted.recipe.mask == "none":
        out["water mask"] = "not asked for: every valid pixel is corrected"
    elif fitted.recipe.mask != "auto":
        out["water mask"] = f"given: {fitted.recipe.mask}"
    elif fitted.water is None:
        out["water mask"] = "no visible band to tell water by: every valid pixel is corrected"
    corrected = {f.band for f in fitted.model.fits}
    for i, (name, rewritten) in enumerate(zip(names, np.broadcast_to(tally.rewritten, len(names)), strict=True)):
        if i not in corrected:
            reason = "glint reference" if i in fitted.model.index_bands else "not among the bands to correct"
            replaced = f"no glint removed, {rewritten} pixels replaced by compensation"
            out[name] = f"{reason}: {replaced if rewritten else 'copied'}"
    return out


def versions() -> dict[str, str]:
    """Versions of the libraries that affect the result."""
    import rasterio

    return {"python": platform.python_version(), "numpy": np.__version__, "rasterio": rasterio.__version__,
            "gdal": rasterio.__gdal_version__}  # fmt: skip


def _losses(names: Sequence[str], tally: PixelCounts) -> list[str]:
    """Warnings of values that the output cannot hold, or that are physically impossible."""
    kinds = {"below zero after correction": tally.negative, "clipped to the integer range": tally.clipped}
    said = []
    for kind, counts in kinds.items():
        counted = zip(names, np.broadcast_to(counts, len(names)), strict=True)
        if bands := ", ".join(f"{name} {n}" for name, n in counted if n):
            said.append(f"pixels {kind} (of {tally.corrected} corrected): {bands}")
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
    return _load(path, GlintModel.from_json)


def load_chain(path: str) -> Chain:
    """Read the compensation that was saved with a model; an empty chain if there was none.

    Raises
    ------
    ReadError, InputError
        No such file, or not a saved compensation.
    """

    def read(text: str) -> Chain:
        found = json.loads(text).get("compensation")
        return chain_from(found) if found else Chain()

    return _load(path, read)


def _load(path: str, read: Callable[[str], Read]) -> Read:
    """Read a saved fit; errors name the file."""
    text = read_text(path, "--model")
    try:
        return read(text)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: {error}") from error
