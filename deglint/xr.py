"""Glint removal on xarray: DataArray in, DataArray out, lazy where the array is lazy.

    clean = deglint.xr.remove(scene)  # fits now, corrects when computed

    fitted = deglint.xr.fit(scene, "hedley")  # or step by step
    clean = deglint.xr.apply(scene, fitted)

The same functions of a tile run as for files, on the array's own chunks with the halo that they ask for, so the numbers
are those of `deglint remove` to the bit. Takes what rioxarray, odc-stac and stackstac give. Never here: files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from . import tiles as tiling
from .compensate import Chain
from .errors import DeglintError, InputError
from .pipeline import Fitted, Recipe, default_threads, fit_scene
from .pipeline.apply import DTYPES, given_model, marking
from .pipeline.correct import Correction
from .pipeline.surroundings import Around
from .raster.arrays import ArraySource
from .raster.environment import enter_thread
from .raster.output import Layout
from .readers.areas import open_area
from .readers.arrays import ArrayScene, open_array
from .readers.roles import find_band
from .remove import GlintModel
from .scene import Scene
from .tiles import Tile

Work = Callable[[Scene, Tile], npt.NDArray[Any]]
"""What makes a (band, row, column) array of a tile of a scene."""


def fit(
    array: Any,
    recipe: Recipe | str = "auto",
    *,
    sensor: str | None = None,
    nodata: float | None = None,
    threads: int | None = None,
) -> Fitted:
    """Fit a recipe to a DataArray; of a lazy one, what the sample needs is computed now.

    Parameters
    ----------
    array : DataArray
        Dimensions y, x and band in any order, others of size 1; see `deglint.readers.arrays.open_array`.
    recipe : Recipe or str
        What to do, or a method's name.
    sensor, nodata
        As `deglint.open_scene`.
    threads : int, optional
        All processors by default; the result does not depend on it.

    Returns
    -------
    Fitted
        `fitted.model` prints well, and can be saved.

    Raises
    ------
    InputError, BandError, FitError, NoWaterError
        As `deglint.fit_scene`; the optional dependency is missing.
    """
    need_xarray()
    opened = open_array(array, sensor=sensor, nodata=nodata)
    return fit_scene(opened.scene, _recipe(recipe), threads=threads)


def apply(
    array: Any,
    fitted: Fitted | GlintModel,
    *,
    mask: str = "auto",
    chain: Chain | None = None,
    dtype: str | None = None,
    sensor: str | None = None,
    nodata: float | None = None,
    threads: int | None = None,
) -> Any:
    """Correct a DataArray with what was fitted; of a lazy one nothing is computed.

    Parameters
    ----------
    array : DataArray
    fitted : Fitted or GlintModel
        Of `fit`; or a model alone, from this scene or another, for which water is looked for first.
    mask : str
        With a model alone: as in `Recipe`.
    chain : Chain, optional
        With a model alone: the compensation that was fitted with it.
    dtype : str, optional
        "float32" or "float64"; the array's own by default. Integers are rounded, and saturate.
    sensor, nodata, threads
        As `fit`.

    Returns
    -------
    DataArray
        Same dimensions, coordinates and attributes.

    Raises
    ------
    InputError, BandError, NoWaterError
        The array does not fit what was fitted.
    """
    need_xarray()
    opened = open_array(array, sensor=sensor, nodata=nodata)
    if isinstance(fitted, GlintModel):
        fitted = given_model(opened.scene, Recipe(mask=mask), fitted, threads or default_threads(), chain)
    elif opened.scene.names != fitted.model.band_names[: len(opened.scene.bands)]:
        raise InputError(
            f"fitted to bands {', '.join(fitted.model.band_names)}; the array has {', '.join(opened.scene.names)}. "
            "Pass fitted.model (and chain=fitted.chain) to use it on another scene."
        )
    work = _correction(opened.scene, fitted, dtype)
    every = (len(opened.scene.bands), np.dtype(work.layout.dtype))
    return opened.like(over_tiles(opened, partial(_corrected, work), work.reach, every, threads=threads))


def remove(
    array: Any,
    recipe: Recipe | str = "auto",
    *,
    dtype: str | None = None,
    sensor: str | None = None,
    nodata: float | None = None,
    threads: int | None = None,
) -> Any:
    """Fit a recipe to a DataArray and correct it: `fit`, then `apply`.

    Parameters
    ----------
    array : DataArray or Dataset
        A Dataset, as odc-stac gives it, has one variable a band.
    recipe, dtype, sensor, nodata, threads
        As `fit` and `apply`.

    Returns
    -------
    DataArray or Dataset

    Raises
    ------
    InputError, BandError, FitError, NoWaterError
        As `fit` and `apply`.

    Examples
    --------
    >>> import rioxarray  # doctest: +SKIP
    >>> scene = rioxarray.open_rasterio("scene.tif", chunks=1024)  # doctest: +SKIP
    >>> deglint.xr.remove(scene).rio.to_raster("clean.tif")  # doctest: +SKIP
    """
    xarray = need_xarray()
    if isinstance(array, xarray.Dataset):
        stacked = stack(array)
        clean = remove(stacked, recipe, dtype=dtype, sensor=sensor, nodata=nodata, threads=threads)
        return array.assign({n: array[n].copy(data=clean.sel(band=n).data) for n in stacked.band.values.tolist()})
    given: Mapping[str, Any] = {"sensor": sensor, "nodata": nodata, "threads": threads}
    return apply(array, fit(array, recipe, **given), dtype=dtype, **given)


def stack(dataset: Any) -> Any:
    """A Dataset of one variable a band as one DataArray with dimension band; attributes that all share are kept.

    Raises
    ------
    InputError
        The variables differ in their dimensions.
    """
    names = [str(n) for n in dataset.data_vars]
    if len({dataset[n].dims for n in names}) != 1:
        said = ", ".join(f"{n} {dataset[n].dims}" for n in names)
        raise InputError(f"want variables that share their dimensions, one a band, got {said}. Pick them first.")
    out = dataset[names].to_dataarray("band")
    first = dataset[names[0]].attrs
    out.attrs = {k: v for k, v in first.items() if all(_same(dataset[n].attrs.get(k), v) for n in names)}
    out.encoding = dict(dataset[names[0]].encoding)
    return out


def over_tiles(
    opened: ArrayScene, work: Work, reach: int, like: tuple[int, np.dtype[Any]], *, step: int = 1,
    threads: int | None = None,
) -> Any:  # fmt: skip
    """Run work on a scene's tiles: a lazy array's chunks, later; else tiles on threads, now.

    Parameters
    ----------
    opened : ArrayScene
    work : callable
        Is given a scene that serves the tile and `reach` pixels around it. It must be picklable.
    reach : int
    like : (int, dtype)
        Bands and type of the result.
    step : int
        Tiles start at multiples of it.

    Returns
    -------
    (band, row, column) numpy or dask array
    """
    scene, values = opened.scene, opened.values
    if hasattr(values, "dask"):
        return _lazily(replace(scene, source=_Nothing()), opened, work, reach, like, step)
    block = max(step, tiling.COMPACT) // step * step
    out = np.empty((like[0], scene.height, scene.width), like[1])
    every = tiling.tiles(scene.height, scene.width, (block, block))
    threads = tiling.affordable(threads or default_threads(), (block, block), 3 * len(scene.bands))
    for tile, done in tiling.run(every, partial(work, scene), threads=threads, start=enter_thread):
        (row0, row1), (col0, col1) = tile.window
        out[:, row0:row1, col0:col1] = done
    return out


def need_xarray() -> Any:
    """The xarray module, or one line that names the extra."""
    try:
        return import_module("xarray")
    except ModuleNotFoundError as error:
        raise DeglintError("xarray is not installed. Install it with: pip install 'deglint[xarray]'") from error


class _Nothing:
    """Stands where a source was, so that a task does not carry the whole array with it."""

    def read(self, *_: Any) -> Any:
        raise AssertionError("unreachable: every chunk has a source of its own")


def _lazily(bare: Scene, opened: ArrayScene, work: Work, reach: int, like: tuple[int, np.dtype[Any]], step: int) -> Any:
    from dask.array import map_blocks
    from dask.array.overlap import overlap

    values = opened.values.rechunk({0: -1})
    chunks = [_aligned(c, step, reach) for c in values.chunks[1:]]
    values = values.rechunk({1: chunks[0], 2: chunks[1]})
    starts = [np.concatenate([[0], np.cumsum(c)]).tolist() for c in values.chunks[1:]]
    padded = overlap(values, {1: reach, 2: reach}, "none", allow_rechunk=False) if reach else values
    info = opened.scene.source.info  # type: ignore[attr-defined]
    task = _Chunk(bare, info, work, reach, (tuple(starts[0]), tuple(starts[1])))
    return map_blocks(
        task, padded, dtype=like[1], chunks=((like[0],), *values.chunks[1:]), meta=np.empty((0, 0, 0), like[1])
    )  # fmt: skip


class _Chunk:
    """A chunk's task: cut out where it lies in the scene, and run the work on it."""

    def __init__(self, scene: Scene, info: Any, work: Work, reach: int, starts: tuple[tuple[int, ...], ...]) -> None:
        self.scene, self.info, self.work, self.reach, self.starts = scene, info, work, reach, starts

    def __call__(self, block: npt.NDArray[Any], block_id: tuple[int, ...] | None = None) -> npt.NDArray[Any]:
        if block_id is None:
            raise AssertionError("unreachable: dask says which block it is")
        (row0, row1), (col0, col1) = (s[i : i + 2] for s, i in zip(self.starts, block_id[1:], strict=True))
        tile = Tile(row0, row1, col0, col1)
        outer = tile.grown(self.reach, self.scene.height, self.scene.width)
        source = ArraySource(block, self.info, (outer.row0, outer.col0))
        return self.work(replace(self.scene, source=source), tile)


def _aligned(chunks: tuple[int, ...], step: int, least: int) -> tuple[int, ...]:
    """Chunks that start at multiples of `step`, their edges moved up to the next, and hold `least` pixels or more."""
    total, edges = sum(chunks), [0]
    for edge in np.cumsum(chunks[:-1]):
        moved = -(-int(edge) // step) * step
        if moved - edges[-1] >= max(least, 1) and total - moved >= max(least, 1):
            edges.append(moved)
    return tuple(int(n) for n in np.diff([*edges, total]))


def _corrected(work: Correction, scene: Scene, tile: Tile) -> npt.NDArray[Any]:
    return work.on(scene)(tile).raw


def _correction(scene: Scene, fitted: Fitted, dtype: str | None) -> Correction:
    """The function of a tile that `deglint remove` uses, for output in the array's own type or a floating one."""
    info = scene.source.info  # type: ignore[attr-defined]
    if dtype is not None and (dtype not in DTYPES or (dtype != info.dtype and not dtype.startswith("float"))):
        raise InputError(f"dtype: allowed is float32, float64 or the array's own {info.dtype}, got {dtype!r}.")
    out = np.dtype(dtype or info.dtype)
    nodata, _masked = marking(scene, out)
    recipe = fitted.recipe
    area = None if recipe.mask in ("auto", "none") else open_area(recipe.mask, scene, "mask")
    rule, bands = None if area else fitted.water, fitted.water_bands
    bare = replace(scene, source=_Nothing())
    beside = Around(bare, rule, bands[rule.roles.nir]) if rule and rule.halo and not fitted.chain.runs else None
    layout = Layout(info, tuple(range(info.count)), out.name, nodata)
    only = tuple(find_band(scene, b) for b in recipe.bands)
    return Correction(bare, fitted.model, False, False, layout, area, rule, bands, beside, fitted.chain, only)


def _recipe(recipe: Recipe | str) -> Recipe:
    return recipe if isinstance(recipe, Recipe) else Recipe(method=recipe)


def _same(a: Any, b: Any) -> bool:
    try:
        return bool(np.array_equal(a, b, equal_nan=True))
    except TypeError:
        return bool(np.array_equal(a, b))
