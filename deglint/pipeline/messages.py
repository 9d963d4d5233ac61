"""Log lines for the scene and the decisions of a fit; the reasons are logged at level DEBUG."""

import logging
from collections.abc import Sequence
from dataclasses import replace

from ..errors import NoWaterError
from ..masks import WaterRule
from ..readers.grid import pixel_size
from ..readers.spectral import time_offset
from ..remove import GlintModel
from ..scene import Scene

log = logging.getLogger("deglint.pipeline")


def why(lines: Sequence[str]) -> None:
    """Log the reasons for a decision, one per line, at level DEBUG, which the option -v shows."""
    for line in lines:
        log.debug("  %s", line)


def log_scene(scene: Scene, *, pixel: bool = True) -> None:
    """Log size, sensor, delays and notes of a scene; if `pixel`, also the assumed pixel size where it is not known."""
    sensor = f", sensor {scene.sensor}" if scene.sensor else ""
    first, *others = scene.path.split(", ")
    name = f"{first} and {len(others)} more" if others else first
    bands = f"{len(scene.bands)} band{'s' * (len(scene.bands) != 1)}"
    log.info("%s: %s, %d x %d pixels%s", name, bands, scene.width, scene.height, sensor)
    times = [b.time_offset for b in scene.bands if b.time_offset is not None]
    if len(times) > 1:
        tags = getattr(getattr(scene.source, "info", None), "band_tags", ())
        read = not scene.sensor or any(time_offset(band) is not None for band in tags)
        source = "read from file" if read else f"known for {scene.sensor}"
        log.info("band delays %s: up to %.0f ms", source, 1e3 * (max(times) - min(times)))
    if pixel and (scene.crs is None or scene.transform is None or scene.transform.is_identity):
        size = pixel_size(scene)
        log.info("no georeference with a CRS: pixel size is assumed to be %s", f"{size:g} m" if size else "below 1 m")
    for line in scene.notes:  # notes of products, on assumptions and on other grids are shown without -v, too
        shown = scene.product or "assumed" in line or "to the grid of" in line
        log.log(logging.INFO if shown else logging.DEBUG, "  %s", line)


def log_water(rule: WaterRule | None, mask: str) -> list[str]:
    """Log which pixels are corrected (`mask`: see `Recipe`); return notes on water. NoWaterError if none is found."""
    if rule is None:
        if mask != "auto":
            log.info("mask: %s%s", mask, ", every valid pixel is corrected" if mask == "none" else "")
        else:
            log.warning("no band below 750 nm is known, so every valid pixel is corrected. Pass --bands or --mask")
        return []
    if not rule.has_water:
        raise NoWaterError(rule.reason)
    bright = rule.water_fraction < 1 and max(rule.window, rule.core) > 1  # what is no water may be glint
    hint = "; all is corrected (--mask none)" if mask == "none" else ". If it is glint: --mask none" if bright else ""
    log.info("water: %s%s", rule.reason, hint)
    return [rule.reason]


def log_model(model: GlintModel, notes: Sequence[str]) -> None:
    """Log the method, its bands, and its warnings. The `notes` and the model are logged at level DEBUG."""
    bands = ", ".join(f.name for f in model.fits)
    log.info("method: %s", f"{model.method}; bands to correct: {bands}" if bands else "none, the scene is copied")
    why([*notes, *str(replace(model, warnings=())).splitlines()[1:]])
    for warning in model.warnings:
        log.warning("%s", warning)
