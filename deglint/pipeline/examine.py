"""What a scene is, and what it needs: the numbers behind `deglint info`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from .. import tiles as tiling
from ..checks import check_kind, checked_keywords
from ..errors import DeglintError
from ..raster.environment import enter_thread, environment
from ..scene import Scene
from ..tiles import Tile, default_threads
from .fit import fit_scene
from .look import look_at, raster_of
from .recipe import Recipe, make_request
from .undeclared import settled

USEFUL_R2 = 0.3
"""Below this R2 in every visible band a removal that follows the NIR does nothing useful."""


@checked_keywords()
def examine(scene: Scene, recipe: Recipe | None = None, *, threads: int | None = None) -> dict[str, Any]:
    """Look at a scene and say what is known of it; reads part of a large one.

    Parameters
    ----------
    scene : Scene
    recipe : Recipe, optional
        Its NIR and sample are used.
    threads : int, optional

    Returns
    -------
    dict
        Plain numbers and words: size, place, bands, NIR, valid and water fraction of what was looked at, glint level
        and cover, R2 of each band with the NIR, suggested method with the reason, and notes. What cannot be told is
        None, with the reason among the notes.
    """
    check_kind(scene, Scene, "scene", "Open it with deglint.open_scene.")
    recipe = recipe or Recipe()
    check_kind(recipe, Recipe, "recipe", "Make one: deglint.Recipe(nir=8).")
    threads = threads or default_threads()
    scene = settled(scene)
    out: dict[str, Any] = _header(scene)
    notes: list[str] = list(scene.notes)
    out |= {"nir": None, "valid_fraction": None, "water_fraction": None, "looked_at_pixels": None,
            "glint_cover": None, "glint_level": None, "r2": None, "slopes": None,
            "suggested_method": None, "reason": None, "needs": None, "needs_said": [], "notes": notes}  # fmt: skip
    try:
        with environment():
            request, said = make_request(scene, recipe)
            notes += [n for n in said if n not in notes]
            out["nir"] = [scene.bands[b].name for i in request.indexes for b in i.bands]
            nir = request.indexes[0].bands[0]
            look = look_at(scene, nir, threads, wanted=True)
            out |= _validity(scene, look.tiles, nir, threads)
            water = look.water
            try:
                fitted = fit_scene(scene, recipe, threads=threads)
                water = fitted.water or water
            finally:
                if water is not None:
                    out["water_fraction"] = water.water_fraction
                    notes.append(water.reason)
    except DeglintError as error:
        out["reason"] = str(error)
        return out
    model = fitted.model
    sample = fitted.numbers["sample"]
    if sample:
        out |= {k: sample[k] for k in ("r2", "slopes", "glint_cover", "glint_level")}
    if fitted.chain.runs:
        out["slopes"] = None  # each band follows a mixture of its own
    out["needs"], out["needs_said"] = fitted.needs.numbers(), fitted.needs.lines()
    best = max((r2 for r2 in (out["r2"] or {}).values() if r2 is not None), default=None)
    out["suggested_method"], out["reason"] = _suggestion(best, out["glint_cover"], model.method)
    if fitted.chain.runs:
        out["suggested_method"], out["reason"] = model.method, f"after compensation: {fitted.chain.text}"
    notes += [n for n in fitted.notes if n not in notes and n not in out["needs_said"]]
    return out


def _suggestion(best: float | None, cover: float | None, method: str) -> tuple[str | None, str]:
    if best is not None and best < USEFUL_R2:
        return None, (
            f"the NIR explains at most {best:.0%} of any band: there is little glint, or the bands are not taken at "
            "the same time; following the NIR will remove next to nothing"
        )
    covered = "" if cover is None else f"; glint covers {cover:.0%} of the sample"
    explained = "" if best is None else f"the NIR explains up to {best:.0%} of a band"
    return method, explained + covered


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
        "pixel_size": [abs(scene.transform.a), abs(scene.transform.e)] if scene.transform else None,
        "sensor": scene.sensor,
        "product": scene.product,
        "opened": list(scene.notes),
        "bands": [asdict(b) for b in scene.bands],
    }


def _validity(scene: Scene, looked: tuple[Tile, ...], nir: int, threads: int) -> dict[str, Any]:
    total = valid = 0
    reads = tiling.run(looked, lambda t: scene.source.read(t.window, [nir]), threads=threads, start=enter_thread)
    for _tile, block in reads:
        total += block.size
        valid += int(np.count_nonzero(np.isfinite(block)))
    return {"valid_fraction": valid / total, "looked_at_pixels": total}
