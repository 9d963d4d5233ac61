"""Anomaly scores for xarray: `score` and `rx` return a DataArray, which is lazy if the input is lazy.

    scores = detect.xr.rx(scene)  # fits the background now; a lazy array is scored when it is computed

Tiles are scored by the functions of `rxdetect score`, so the scores are the same to the bit. No file is opened here.
"""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from deglint.checks import checked_keywords
from deglint.errors import InputError
from deglint.readers.arrays import open_array
from deglint.readers.undeclared import settled
from deglint.scene import Scene
from deglint.tiles import Tile, default_threads
from deglint.xr import need_xarray, over_tiles

from .arrays import Array
from .background import Background
from .local import CELL
from .pipeline import Recipe
from .pipeline.plan import fit_background, fitted, make_plan
from .pipeline.scoring import Scoring

if TYPE_CHECKING:
    from xarray import DataArray


@checked_keywords()
def fit(
    array: "DataArray",
    recipe: Recipe | str = "rx",
    *,
    sensor: str | None = None,
    nodata: float | str | None = None,
    threads: int | None = None,
) -> Background:
    """Fit the background of a DataArray now; lazy chunks may be computed repeatedly. Parameters are as in `score`.

    Raises InputError for a method that has a background of its own for every pixel, such as "local".
    """
    recipe = _recipe(recipe)
    if recipe.kind.matrices is None:
        raise InputError(f"{recipe.method} has a background for every pixel: there is none to fit.")
    recipe = replace(recipe, method="rx") if recipe.method == "auto" else recipe
    opened = open_array(array, sensor=sensor, nodata=nodata)
    plan = make_plan(settled(opened.scene), recipe, default_threads(threads))
    return replace(plan.given or fit_background(plan), names=plan.names)


@checked_keywords()
def score(
    array: "DataArray",
    recipe: Recipe | str = "rx",
    *,
    background: Background | None = None,
    sensor: str | None = None,
    nodata: float | str | None = None,
    threads: int | None = None,
) -> "DataArray":
    """Score how anomalous every pixel of a DataArray is; the scores of a lazy array are lazy.

    Parameters
    ----------
    array, sensor, nodata, threads
        DataArray with the dimensions y, x and band; `sensor`, `nodata` and `threads` are as in `deglint.xr.fit`.
    recipe : Recipe or str
        Options of the detection, or a method's name (not "lines"); options of thresholds and objects are ignored.
    background : Background, optional
        A background fitted earlier, to this scene or another; by default, one is fitted to this array now. If one is
        given, the method "auto" selects "rx". Unless `recipe.mask` is "water", a lazy array is then neither read now
        nor searched for nodata: declare its nodata value, or pass `nodata`. A method that has a background of
        its own for every pixel, such as "local", accepts none.

    Returns
    -------
    (y, x) DataArray of float32
        NaN where a pixel is not valid, or outside the mask.

    Raises
    ------
    InputError, BandError, FitError, NoWaterError
        The message states a remedy, as for `detect.score_file`.
    DeglintError
        xarray is not installed.
    """
    recipe = _recipe(recipe)
    if recipe.method == "lines":
        raise InputError("method lines takes no array, but one line after the other: iterate over detect.score_lines.")
    opened = open_array(array, sensor=sensor, nodata=nodata)
    if background is None or recipe.mask == "water" or not hasattr(opened.values, "dask"):  # else nothing is computed
        opened = replace(opened, scene=settled(opened.scene))
    plan = fitted(make_plan(opened.scene, recipe, default_threads(threads), background))
    work = Scoring(replace(plan, scene=replace(opened.scene, source=None), tiles=[]))  # type: ignore[arg-type]
    reach = plan.halo + (plan.water[0].halo if plan.water else 0)
    step = CELL if plan.window else 1
    scores = over_tiles(opened, partial(_scored, work), reach, (1, np.dtype(np.float32)), step=step, threads=threads)
    return opened.plane(scores[0], plan.recipe.method)


def rx(array: "DataArray", background: Background | None = None, **options: Any) -> "DataArray":
    """Global RX of a DataArray: squared Mahalanobis distance of every pixel from the background (Reed and Yu 1990).

    `options` are fields of `detect.pipeline.Recipe`, such as covariance. Other arguments and result are as in `score`.

    Examples
    --------
    >>> detect.xr.rx(deglint.xr.remove(scene), covariance="oas")  # doctest: +SKIP
    """
    return score(array, Recipe(method="rx", **options), background=background)


def _recipe(recipe: Recipe | str) -> Recipe:
    """Make a recipe if the name of a method is given. Raises DeglintError if xarray is not installed."""
    need_xarray()
    return recipe if isinstance(recipe, Recipe) else Recipe(method=recipe)


def _scored(work: Scoring, scene: Scene, tile: Tile) -> Array:
    """Score a tile, (1, row, column); its pixels are read from `scene`, in place of the scene in the plan of `work`."""
    return replace(work, plan=replace(work.plan, scene=scene))(tile).scores[None]
