"""What the pipeline logs while it decides: one short line for each decision (INFO), and why (DEBUG).

The same decisions stand in full in `Fitted.notes` and in the sidecar.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..masks import WaterRule
from ..scene import Scene

if TYPE_CHECKING:
    from ..choose import Choice
    from ..remove import GlintModel
    from .outputs import PixelCounts

log = logging.getLogger("deglint.pipeline")


def why(lines: Sequence[str]) -> None:
    """Reasons, shown by -v."""
    for line in lines:
        log.debug("  %s", line)


def log_scene(scene: Scene) -> None:
    """What was opened: size, sensor, band delays."""
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
    """Which bands show the glint."""
    log.info("NIR: %s", ", ".join(_band(scene, b) for b in bands))
    for doubt in (n.partition("; warning: ")[2] for n in notes):
        if doubt:
            log.warning("%s", doubt)
    why(notes)


def log_water(rule: WaterRule | None, mask: str) -> None:
    """What is corrected."""
    if rule is not None and rule.has_water:
        log.info("water: %s", rule.reason)
    elif mask == "none":
        log.info("mask: none, every valid pixel is corrected")
    elif mask != "auto":
        log.info("mask: %s", mask)


def log_choice(choice: Choice) -> None:
    """Which candidates were tried, and what they did to implanted signals."""
    first, *others = choice.lines() or ["no candidate could be tried: wiener"]
    log.info("%s", first)
    why(others)


def log_compensation(chain: str) -> None:
    """The stages around the removal."""
    log.info("compensation: %s", "none" if chain == "off" else chain)


def log_sample(pixels: int, place: str) -> None:
    """What the method was fitted to."""
    log.info("sample: %d pixels, %s", pixels, place)


def log_model(model: GlintModel, notes: Sequence[str]) -> None:
    """Method, bands, and what to be careful of."""
    bands = ", ".join(f.name for f in model.fits) or "none"
    log.info("method: %s; bands to correct: %s", model.method, bands)
    why([*notes, *str(replace(model, warnings=())).splitlines()[1:]])
    for warning in model.warnings:
        log.warning("%s", warning)


def log_result(scene: Scene, model: GlintModel, image: Path, tally: PixelCounts, said: Mapping[str, Any]) -> None:
    """What became of each band and of the pixels; `said` is the sidecar."""
    changed = said["pixels"]["changed"]
    copied = [n for n in scene.names if n not in changed]
    parts = [f"corrected: {', '.join(changed)}"] if changed else []
    parts += [f"copied: {', '.join(copied)}"] if copied else []
    log.info("bands %s", "; ".join(parts))
    for warning in said["warnings"][len(model.warnings) :]:  # the model's were logged when it was fitted
        log.warning("%s", warning)
    seconds = said["seconds"]
    log.info("%s: %d of %d pixels corrected in %.2f s", image, tally.corrected, tally.total, seconds)


def _band(scene: Scene, index: int) -> str:
    band = scene.bands[index]
    wavelength = f" ({band.wavelength:g} nm)" if band.wavelength else ""
    number = f"band {index + 1}"
    return f"{number}{wavelength}" if band.name.casefold() == number else f"{number} {band.name}{wavelength}"
