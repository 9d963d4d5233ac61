"""Glint removal for xarray: DataArray in, DataArray out; the result for a lazy (Dask) array is lazy.

    clean = deglint.xr.remove(scene)  # fits now, corrects when computed

    fitted = deglint.xr.fit(scene, "hedley")  # or step by step
    clean = deglint.xr.apply(scene, fitted)

    clean = scene.deglint.remove()  # or as an accessor; of a Dataset, too

The functions that process the tiles of a file also process the chunks of an array, with a halo. The result is therefore
the result of `deglint remove`, to the bit. Arrays may come from rioxarray, odc-stac or stackstac.
"""

import contextlib
import logging
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import partial
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from . import tiles as tiling
from .checks import check_kind, checked_keywords
from .compensate import Chain
from .errors import DeglintError, FitError, InputError
from .pipeline import Fitted, Recipe, fit_scene
from .pipeline.correct import CHAIN_CELL, Correction, correction
from .pipeline.fit import given_model
from .pipeline.overview import raster_of
from .raster.convert import Raw
from .raster.info import RasterInfo
from .raster.output import DTYPES
from .raster.source import ArraySource
from .readers.arrays import BANDS, PER_BAND, ArrayScene, axes, open_array
from .readers.undeclared import settled
from .remove import GlintModel
from .scene import Scene
from .tiles import Tile, default_threads

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

__all__ = ["Deglint", "apply", "fit", "remove", "stack"]

log = logging.getLogger(__name__)
Like = tuple[int, np.dtype[Any]]  # number of bands and data type of a result
TileWork = Callable[[Scene, Tile], Raw]  # function that makes a (band, row, column) array of a scene's tile


@checked_keywords()
def fit(
    array: "DataArray",
    recipe: Recipe | str = "auto",
    *,
    threads: int | None = None,
    sensor: str | None = None,
    nodata: float | str | None = None,
) -> Fitted:
    """Fit a recipe to a DataArray; the pixels of a lazy array that the fit needs are computed now.

    Parameters
    ----------
    array : DataArray
        Scene with the dimensions y, x and band in any order, and others of size 1; see `readers.arrays.open_array`.
    recipe : Recipe or str
        Options of the removal, or the name of a method.
    threads : int, optional
        Number of threads, by default one for each processor; the result does not depend on it.
    sensor, nodata : str, and float or str, optional
        As in `deglint.open_scene`.

    Returns
    -------
    Fitted
        The fitted recipe; its `model` can be printed and saved.

    Raises
    ------
    InputError, BandError, FitError, NoWaterError
        As in `deglint.fit_scene`; a DeglintError if xarray is not installed.
    """
    need_xarray()
    recipe = recipe if isinstance(recipe, Recipe) else Recipe(method=recipe)
    return fit_scene(open_array(array, sensor=sensor, nodata=nodata).scene, recipe, threads=threads)


@checked_keywords("sensor", "nodata")
def apply(
    array: "DataArray",
    fitted: Fitted | GlintModel,
    *,
    mask: str | None = None,
    chain: Chain | None = None,
    dtype: str | None = None,
    threads: int | None = None,
    **reading: Any,
) -> "DataArray":
    """Correct a DataArray with a fitted recipe or model; the result for a lazy array is lazy.

    Parameters
    ----------
    array : DataArray
        The scene to correct, as in `fit`.
    fitted : Fitted or GlintModel
        The result of `fit`; or a model alone, from this scene or another. With a model alone and `mask` "auto", pixels
        of a lazy array are computed now, to find water.
    mask : str, optional
        The pixels to correct, as in `Recipe`; by default those of the fit, or "auto" with a model alone.
    chain : Chain, optional
        With a model alone: the compensation that was fitted with it.
    dtype : str, optional
        "float32" or "float64"; by default the type of the array. Values of integer types are rounded and clipped.
    threads, **reading
        Arguments threads, sensor and nodata, as in `fit`.

    Returns
    -------
    DataArray
        The corrected scene, with the same dimensions, coordinates and attributes.

    Raises
    ------
    InputError, BandError, NoWaterError
        The bands do not match the fit, an argument is not allowed, or there is no water; DeglintError without xarray.
    """
    need_xarray()
    opened, threads = open_array(array, **reading), default_threads(threads)
    if chain is not None:
        check_kind(chain, Chain, "chain", "Take that of a fit: chain=fitted.chain.")
        check_kind(fitted, GlintModel, "fitted", "A Fitted has its own chain: leave chain out, or pass fitted.model.")
    if isinstance(fitted, GlintModel):
        recipe = Recipe() if mask is None else Recipe(mask=mask)
        if recipe.mask == "auto":  # else nothing is computed yet
            opened = replace(opened, scene=settled(opened.scene))
        fitted = given_model(opened.scene, recipe, fitted, threads, chain)
    else:
        check_kind(fitted, Fitted, "fitted", "Make it with deglint.xr.fit, or give a GlintModel.")
        if opened.scene.names != fitted.model.band_names:
            raise InputError(
                f"fitted to bands {', '.join(fitted.model.band_names)}; the array has {', '.join(opened.scene.names)}. "
                "Pass fitted.model (and chain=fitted.chain) to use it on another scene."
            )
        opened = replace(opened, scene=fitted.undeclared.on(opened.scene))
    work = _correction(opened.scene, fitted, mask, dtype)
    every = (len(opened.scene.bands), np.dtype(work.layout.dtype))
    step = CHAIN_CELL if work.by_cells else 1
    return opened.like(over_tiles(opened, partial(_correct_tile, work), work.halo, every, step=step, threads=threads))


def _correction(scene: Scene, fitted: Fitted, mask: str | None, dtype: str | None) -> Correction:
    """Make a picklable `Correction` with the array's nodata value, no mask and no scene (`_correct_tile` adds it)."""
    info = raster_of(scene).info
    if dtype is not None and (dtype not in DTYPES or (dtype != info.dtype and not dtype.startswith("float"))):
        raise InputError(f"dtype: allowed is float32, float64 or the array's own {info.dtype}, got {dtype!r}.")
    work = correction(scene, fitted, mask=mask, dtype=dtype)
    nodata = work.layout.nodata if info.nodata is not None else None
    return replace(work, scene=None, layout=replace(work.layout, masked=False, nodata=nodata))  # type: ignore[arg-type]


def _correct_tile(work: Correction, scene: Scene, tile: Tile) -> Raw:
    return replace(work, scene=scene)(tile).raw


@checked_keywords()
def remove(
    array: Any,
    recipe: Recipe | str = "auto",
    *,
    dtype: str | None = None,
    threads: int | None = None,
    sensor: str | None = None,
    nodata: float | str | None = None,
) -> Any:
    """Fit a recipe to a DataArray and correct it: `fit`, then `apply`.

    Parameters
    ----------
    array : DataArray or Dataset
        A Dataset has one variable for each band, as odc-stac gives it, or variables with a dimension band. Each entry
        of a further dimension, such as time, is a separate scene, and is copied if it has no water or the fit fails.
    recipe, dtype, threads, sensor, nodata
        As in `fit` and `apply`.

    Returns
    -------
    DataArray or Dataset
        The corrected scene or scenes, of the same type as `array`.

    Raises
    ------
    InputError, BandError, FitError, NoWaterError
        As in `fit` and `apply`.

    Examples
    --------
    >>> import numpy as np, xarray
    >>> glint = np.random.default_rng(0).gamma(0.5, 100.0, (60, 80))
    >>> water = xarray.DataArray([900.0, 700.0, 400.0, 100.0], {"band": ["blue", "green", "red", "nir"]}, "band")
    >>> scene = water + xarray.DataArray(glint, dims=("y", "x"))
    >>> clean = remove(scene, Recipe(method="hedley", sample="all", mask="none", compensate="off"))
    >>> round(float(scene.sel(band="red").std())), round(float(clean.sel(band="red").std()))
    (70, 0)
    """
    given: dict[str, Any] = {"threads": threads, "sensor": sensor, "nodata": nodata}
    work = partial(remove, recipe=recipe, dtype=dtype, **given)
    if isinstance(array, need_xarray().Dataset):
        return _by_variables(array, work)
    further = [d for d in array.dims if d not in axes(array)] if hasattr(array, "dims") else []
    if d := next((d for d in further if array.sizes[d] > 1), None):
        parts = [_entry(array.isel({d: [i]}), d, work) for i in range(array.sizes[d])]
        out = array.copy(data=np.concatenate([part.data for part in parts], array.get_axis_num(d)))
        out.encoding = parts[0].encoding
        return out
    return apply(array, fit(array, recipe, **given), dtype=dtype, **given)


def _entry(array: "DataArray", dimension: Hashable, work: "Callable[[DataArray], DataArray]") -> "DataArray":
    """Call `work` on an array of one entry of `dimension`; on NoWaterError or FitError, log it and return the array."""
    try:
        return work(array)
    except FitError as error:
        name = str(array[dimension].values[0]) if dimension in array.coords else "one entry"
        log.warning("%s %s: copied, not corrected: %s", dimension, name, error)
        return array


def _by_variables(dataset: "Dataset", work: "Callable[[DataArray], DataArray]") -> "Dataset":
    """Call `work` on each variable with a dimension band or, if there is none, on the variables stacked as bands."""
    if deep := _with_bands(dataset):
        return dataset.assign({n: work(dataset[n]) for n in deep})
    clean, names = work(stack(dataset)), {str(n): n for n in dataset.data_vars}  # of bands, and of variables
    bands = [(names[band], clean.sel(band=band).data) for band in clean.band.values.tolist()]
    return dataset.assign({n: dataset[n].copy(data=data) for n, data in bands})


def _with_bands(dataset: "Dataset") -> list[Hashable]:
    """Names of the variables that are images with a band dimension."""
    every = dataset.data_vars.items()
    return [n for n, v in every if v.ndim >= 3 and {str(d).lower() for d in v.dims} & set(BANDS)]


def stack(dataset: "Dataset") -> "DataArray":
    """Stack a Dataset with one variable for each band into a DataArray with dimension band; keep common attributes.

    Nodata, scales and offsets that differ become lists with one entry per band. If at least two wavelengths are known,
    variables without one, such as masks, are left out. If one variable has a dimension band, it is returned alone.
    Raises InputError if several have it, if no variable has two or more dimensions, or if their dimensions differ.
    """
    if deep := _with_bands(dataset):
        if len(deep) > 1:
            raise InputError(f"{', '.join(map(str, deep))} have bands of their own. Pick one of them first.")
        return dataset[deep[0]]
    dataset = dataset.rename({n: str(n) for n in dataset.data_vars})  # names may be numbers
    names = [n for n in dataset.data_vars if dataset[n].ndim >= 2]
    if len({dataset[n].dims for n in names}) != 1:
        said = ", ".join(f"{n} {dataset[n].dims}" for n in names)
        raise InputError(f"want variables that share their dimensions, one a band, got {said}. Pick them first.")
    first = dataset[names].to_dataarray("band")
    first = first.isel({d: 0 for d in first.dims if d not in axes(first)})
    known = [b.name for b in open_array(first).scene.bands if b.wavelength]
    chosen = known if len(known) > 1 and set(known) <= set(names) else names
    out = dataset[chosen].to_dataarray("band")
    attrs, encoding = ([getattr(dataset[n], kind) for n in chosen] for kind in ("attrs", "encoding"))
    out.attrs = {k: v for k, v in attrs[0].items() if all(_same(each.get(k), v) for each in attrs)}
    out.encoding = dict(encoding[0])
    for of_all, own in ((out.attrs, attrs), (out.encoding, encoding)):
        for key, default in PER_BAND.items():
            values = [each.get(key, default) for each in own]
            of_all |= {} if all(_same(v, values[0]) for v in values) else {key: values}
    return out


def need_xarray() -> ModuleType:
    """Return the xarray module; if it is missing, raise DeglintError with the command that installs it."""
    try:
        return import_module("xarray")
    except ModuleNotFoundError as error:
        raise DeglintError("xarray is not installed. Install it with: pip install 'deglint[xarray]'") from error


def _same(a: Any, b: Any) -> bool:
    try:
        return bool(np.array_equal(a, b, equal_nan=True))
    except TypeError:
        return bool(np.array_equal(a, b))


@tiling.one_thread_each()
def over_tiles(opened: ArrayScene, work: TileWork, reach: int, like: Like, *, step: int, threads: int | None) -> Any:
    """Call `work` on all tiles of the scene `opened`: lazily on the chunks of a Dask array, else at once on threads.

    `work` must be picklable; it can read the tile and `reach` pixels around it. `like` is the number of bands and the
    data type of the result, a (band, row, column) numpy or dask array. Tiles start at multiples of `step` [pixel].
    """
    scene = opened.scene
    if hasattr(opened.values, "dask"):
        return _lazily(opened, work, reach, like, step)
    block = max(step, tiling.COMPACT) // step * step
    out = np.empty((like[0], scene.height, scene.width), like[1])
    every = tiling.tiles(scene.height, scene.width, (block, block))
    threads = tiling.affordable(default_threads(threads), (block, block), 3 * len(scene.bands))
    for tile, done in tiling.run(every, partial(work, scene), threads=threads):
        out[tile.within(Tile(0, scene.height, 0, scene.width))] = done
    return out


def _lazily(opened: ArrayScene, work: TileWork, reach: int, like: Like, step: int) -> Any:
    from dask.array import map_blocks
    from dask.array.overlap import overlap

    values = opened.values.rechunk({0: -1})
    rows, columns = (_aligned(chunks, step, reach) for chunks in values.chunks[1:])
    values = values.rechunk({1: rows, 2: columns})
    depth = {1: min(reach, sum(rows)), 2: min(reach, sum(columns))}
    padded = overlap(values, depth, "none", allow_rechunk=False) if reach else values
    task = partial(_of_chunk, replace(opened.scene, source=None), raster_of(opened.scene).info, work, reach)  # type: ignore[arg-type]
    chunks, meta = ((like[0],), rows, columns), np.empty((0, 0, 0), like[1])
    return map_blocks(task, padded, dtype=like[1], chunks=chunks, meta=meta)


def _of_chunk(scene: Scene, info: RasterInfo, work: TileWork, reach: int, block: Raw, block_info: Any = None) -> Raw:
    """Call `work` on a chunk; `block` is the chunk and `reach` pixels around; dask's `block_info` has its position."""
    (row0, row1), (col0, col1) = block_info[None]["array-location"][1:]
    tile = Tile(row0, row1, col0, col1)
    outer = tile.grown(reach, scene.height, scene.width)
    return work(replace(scene, source=ArraySource(block, info, (outer.row0, outer.col0))), tile)


def _aligned(chunks: tuple[int, ...], step: int, least: int) -> tuple[int, ...]:
    """Chunk sizes [pixel] with edges at the next multiples of `step`; chunks shorter than `least` are merged."""
    total, edges = sum(chunks), [0]
    for edge in np.cumsum(chunks[:-1]):
        moved = -(-int(edge) // step) * step
        if moved - edges[-1] >= max(least, 1) and total - moved >= max(least, 1):
            edges.append(moved)
    return tuple(int(n) for n in np.diff([*edges, total]))


class Deglint:
    """The xarray accessor `deglint`: `array.deglint` and `dataset.deglint`, after `deglint.xr` is imported.

    Examples
    --------
    >>> import numpy as np, xarray, deglint.xr
    >>> glint = np.random.default_rng(0).gamma(0.5, 100.0, (2, 60, 80))
    >>> bands = {"blue": 900.0, "green": 700.0, "red": 400.0, "nir": 100.0}
    >>> scenes = xarray.Dataset({name: (("time", "y", "x"), level + glint) for name, level in bands.items()})
    >>> clean = scenes.deglint.remove(Recipe(method="hedley", sample="all", mask="none", compensate="off"))
    >>> clean.red.std(("y", "x")).round().values.tolist()
    [0.0, 0.0]
    """

    def __init__(self, given: Any) -> None:
        self._given, self._several = given, isinstance(given, need_xarray().Dataset)

    def fit(self, recipe: Recipe | str = "auto", **options: Any) -> Fitted:
        """Fit a recipe to the array or Dataset; see `deglint.xr.fit`."""
        return fit(stack(self._given) if self._several else self._given, recipe, **options)

    def apply(self, fitted: Fitted | GlintModel, **options: Any) -> Any:
        """Correct the array or Dataset with a fitted recipe or model; see `deglint.xr.apply`."""
        work: Callable[[DataArray], DataArray] = partial(apply, fitted=fitted, **options)
        return _by_variables(self._given, work) if self._several else work(self._given)

    def remove(self, recipe: Recipe | str = "auto", **options: Any) -> Any:
        """Fit a recipe to the array or Dataset and correct it; see `deglint.xr.remove`."""
        return remove(self._given, recipe, **options)


with contextlib.suppress(DeglintError):  # xarray has no entry point for accessors
    for _register in (need_xarray().register_dataarray_accessor, need_xarray().register_dataset_accessor):
        _register("deglint")(Deglint)
