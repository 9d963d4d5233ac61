"""Examine a scene: its properties, its water and glint, and the expected error of each candidate recipe."""

import math
import time
from dataclasses import asdict
from typing import Any

import numpy as np

from . import tiles as tiling
from .checks import check_kind, checked_keywords
from .errors import DeglintError
from .pipeline.fit import fit_scene
from .pipeline.overview import overview_of, raster_of, read_tiles
from .pipeline.recipe import Recipe, make_request
from .raster.environment import environment, limit
from .readers.areas import open_area
from .readers.grid import ground_size
from .readers.undeclared import settled
from .scene import Scene

OF_FIT = "nir valid_fraction water_fraction looked_at_pixels glint_level r2 slopes suggested_method reason choice"
"""Entries of the result of `examine` that need pixels, a choice of bands or a fit; None until they are known."""


@checked_keywords()
def examine(scene: Scene, recipe: Recipe | None = None, *, threads: int | None = None) -> dict[str, Any]:
    """Examine a scene without correcting it; of a large scene only a part is read, for a limited time.

    Parameters
    ----------
    scene, threads : Scene, and int, optional
        The scene, and the number of threads, by default one for each processor.
    recipe : Recipe, optional
        Options of the removal that are examined, such as the NIR bands and the sample.

    Returns
    -------
    dict
        File properties, nir (names), valid_fraction, water_fraction, r2, slopes, glint_level (median glint in the NIR),
        suggested_method, choice and tried (candidates), reason, notes. Unknown values are None; reason, notes say why.
    """
    check_kind(scene, Scene, "scene", "Open it with deglint.open_scene.")
    recipe, threads = recipe or Recipe(), tiling.default_threads(threads)
    check_kind(recipe, Recipe, "recipe", "Make one: deglint.Recipe(nir=8).")
    out = _header(scene := settled(scene))
    if recipe.sample not in ("auto", "all"):  # a wrong option is an error, not a reason
        with environment():
            open_area(recipe.sample, scene, "--sample")
    notes: list[str] = out["notes"]
    seconds, source = limit("DEGLINT_INFO_SECONDS"), raster_of(scene)
    source.deadline = deadline = time.monotonic() + seconds
    try:
        with environment():
            request, of_nir = make_request(scene, recipe)
            notes.append(of_nir)
            out["nir"] = [scene.bands[b].name for i in request.indexes for b in i.bands]
            nir = request.indexes[0].bands[0]
            overview = overview_of(scene, nir, threads)
            valid = np.concatenate([np.isfinite(b).ravel() for b in read_tiles(scene, overview.tiles, [nir], threads)])
            out |= {"looked_at_pixels": valid.size, "valid_fraction": float(valid.mean())}
            if overview.water is not None:
                out["water_fraction"] = overview.water.water_fraction
                notes.append(overview.water.reason)
            fitted = fit_scene(scene, recipe, threads=threads)
    except DeglintError as error:
        out["reason"] = str(error)
        if time.monotonic() > deadline:
            out["reason"] = (
                f"stopped after {seconds} s: {source.pixels_read} of {scene.height * scene.width} pixels were read."
                " To read more, set the environment variable DEGLINT_INFO_SECONDS to more, or give a --sample"
            )
        return out
    finally:
        source.deadline = math.inf
    if fitted.water is not None:
        out["water_fraction"] = fitted.water.water_fraction
    if fitted.sampled:
        out |= {k: fitted.sampled[k] for k in ("r2", "slopes", "glint_level")}
    out["suggested_method"], out["reason"] = fitted.model.method, "selected explicitly"
    if (choice := fitted.choice) is not None:
        out["choice"], out["tried"] = choice.numbers(), choice.lines()
        best = (None, choice.why_copied) if choice.best.method == "copy" else (choice.best.name, choice.why)
        out["suggested_method"], out["reason"] = best
    notes += [n for n in fitted.notes if n not in notes and n not in out["tried"]]
    return out


def _header(scene: Scene) -> dict[str, Any]:
    """The result of `examine` with only those properties that are known without a fit; all others are None or empty."""
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
        **dict.fromkeys(OF_FIT.split()),
        "tried": [],
        "notes": list(scene.notes),
    }
