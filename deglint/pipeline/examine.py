"""Properties of a scene, and the expected error of the candidates: the numbers behind `deglint info`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from .. import tiles as tiling
from ..checks import check_kind, checked_keywords
from ..errors import DeglintError
from ..raster.environment import LOOK_READS, enter_thread, environment, look_seconds
from ..raster.source import Budget
from ..readers.place import ground_size
from ..readers.undeclared import settled
from ..scene import Scene
from ..tiles import Tile, default_threads
from .fit import Fitted, fit_scene
from .overview import overview_of, raster_of
from .recipe import Recipe, make_request


@checked_keywords()
def examine(scene: Scene, recipe: Recipe | None = None, *, threads: int | None = None) -> dict[str, Any]:
    """Examine a scene; of a large one a part is read, for a limited time.

    Parameters
    ----------
    scene : Scene
    recipe : Recipe, optional
        Its NIR and sample are used.
    threads : int, optional

    Returns
    -------
    dict
        Plain values: size, location, bands, NIR, valid and water fraction of the pixels that were read, glint level, R2
        of each band with the NIR, suggested method with the reason, and notes. Values that are not known are None, with
        the reason in the notes.
    """
    check_kind(scene, Scene, "scene", "Open it with deglint.open_scene.")
    recipe = recipe or Recipe()
    check_kind(recipe, Recipe, "recipe", "Make one: deglint.Recipe(nir=8).")
    scene = settled(scene)
    notes: list[str] = list(scene.notes)
    unknown = ("nir", "valid_fraction", "water_fraction", "looked_at_pixels", "glint_level", "r2", "slopes",
               "suggested_method", "reason", "choice")  # fmt: skip
    out: dict[str, Any] = _header(scene) | dict.fromkeys(unknown) | {"tried": [], "notes": notes}
    budget = raster_of(scene).budget = Budget(look_seconds(), LOOK_READS)
    try:
        with environment():
            fitted = _fit_noted(scene, recipe, threads or default_threads(), out)
    except DeglintError as error:
        out["reason"] = str(error) if not budget.over else _not_seen(scene, budget)
        return out
    finally:
        raster_of(scene).budget = None
    if sample := fitted.numbers["sample"]:
        out |= {k: sample[k] for k in ("r2", "slopes", "glint_level")}
    if (choice := fitted.choice) is not None:
        copied = choice.best.method == "copy"
        out["choice"], out["tried"] = choice.numbers(), choice.lines()
        out["suggested_method"] = None if copied else choice.best.name
        out["reason"] = choice.why_copied if copied else choice.why
    else:
        out["suggested_method"], out["reason"] = fitted.model.method, "as it was asked for"
    notes += [n for n in fitted.notes if n not in notes and n not in out["tried"]]
    return out


def _fit_noted(scene: Scene, recipe: Recipe, threads: int, out: dict[str, Any]) -> Fitted:
    """Fit the recipe; intermediate results are stored in `out` even if the fit fails."""
    notes = out["notes"]
    request, said = make_request(scene, recipe)
    notes += [n for n in said if n not in notes]
    out["nir"] = [scene.bands[b].name for i in request.indexes for b in i.bands]
    nir = request.indexes[0].bands[0]
    overview = overview_of(scene, nir, threads, wanted=True)
    out |= _validity(scene, overview.tiles, nir, threads)
    water = overview.water
    try:
        fitted = fit_scene(scene, recipe, threads=threads)
        water = fitted.water or water
    finally:
        if water is not None:
            out["water_fraction"] = water.water_fraction
            notes.append(water.reason)
    return fitted


def _not_seen(scene: Scene, budget: Budget) -> str:
    """Note on the part of the scene that was not read for lack of time."""
    total = scene.height * scene.width
    return (
        f"the look at it was stopped after {budget.seconds:g} s or {budget.reads} windows: {budget.done} windows of "
        f"{budget.pixels} pixels were read, of {total} pixels; what lies in the others is not known. To look for "
        "longer, set the environment variable DEGLINT_INFO_SECONDS, or name a --sample"
    )


def _header(scene: Scene) -> dict[str, Any]:
    info = raster_of(scene).info
    return {
        "path": scene.path,
        "driver": info.driver,
        "height": scene.height,
        "width": scene.width,
        "dtype": info.dtype.name,
        "nodata": info.nodata,
        "crs": scene.crs.to_string() if scene.crs else None,
        "pixel_size": ground_size(scene.transform, scene.crs, scene.height, scene.width),
        "sensor": scene.sensor,
        "product": scene.product,
        "opened": list(scene.notes),
        "bands": [asdict(b) for b in scene.bands],
    }


def _validity(scene: Scene, looked: tuple[Tile, ...], nir: int, threads: int) -> dict[str, Any]:
    reads = tiling.run(looked, lambda t: scene.source.read(t.window, [nir]), threads=threads, start=enter_thread)
    valid = np.array([(int(np.isfinite(block).sum()), block.size) for _tile, block in reads]).sum(axis=0)
    return {"valid_fraction": float(valid[0] / valid[1]), "looked_at_pixels": int(valid[1])}
