"""The whole job: open, fit (or take a saved model), correct tile by tile, write the output and its sidecar."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..errors import InputError, NoWaterError
from ..masks import WaterRule, water
from ..raster.encode import encode
from ..raster.environment import enter_thread, environment
from ..raster.output import (
    Layout,
    RasterWriter,
    Scratch,
    check_target,
    plain,
    write_bytes,
    write_json,
    write_text,
    writing,
)
from ..readers.areas import Area, open_area
from ..remove import GlintModel, apply
from ..report import before_after
from ..scene import Scene
from ..tiles import Tile
from .fit import Fitted, Progress, default_threads, fit_scene
from .look import core_of, look_at, raster_of, role_bands, tile_shape_of
from .recipe import Recipe
from .sidecar import Checksum, sidecar

FLAGS = {
    1: "nodata: not valid, passed unchanged",
    2: "not water, or outside the mask: passed unchanged",
    4: "corrected",
    8: "negative after correction, in some band",
    16: "saturated before correction, in some band",
    32: "clipped to the output's integer range, in some band",
}
"""Bits of the flag raster."""
NODATA, NOT_WATER, CORRECTED, NEGATIVE, SATURATED, CLIPPED = FLAGS


@dataclass(frozen=True)
class Outputs:
    """Where results go.

    Attributes
    ----------
    image : Path
        The deglinted raster; its sidecar is `image` with ".json" appended.
    flags, amount, sample, model, picture : Path, optional
        Flag raster, removed glint, the sample as GeoJSON, the fitted model, a before/after picture.
    overwrite : bool
        Replace what exists.
    dtype : str, optional
        Type of the image; the input's by default.
    options : mapping
        GDAL creation options.
    """

    image: Path
    flags: Path | None = None
    amount: Path | None = None
    sample: Path | None = None
    model: Path | None = None
    picture: Path | None = None
    overwrite: bool = False
    dtype: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)

    @property
    def sidecar(self) -> Path:
        """Name of the sidecar."""
        return self.image.with_name(self.image.name + ".json")

    def every(self) -> list[Path]:
        """All files that will be written."""
        extra = (self.flags, self.amount, self.sample, self.model, self.picture)
        return [self.image, self.sidecar, *(p for p in extra if p is not None)]


@dataclass
class Tally:
    """Pixels of the whole run; bands in scene order."""

    bands: int
    total: int = 0
    nodata: int = 0
    not_water: int = 0
    corrected: int = 0
    negative: npt.NDArray[np.int64] = field(init=False)
    clipped: npt.NDArray[np.int64] = field(init=False)
    saturated: npt.NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.negative, self.clipped, self.saturated = (np.zeros(self.bands, np.int64) for _ in range(3))

    def add(self, other: Tally) -> None:
        """Add a tile's counts."""
        for name in ("total", "nodata", "not_water", "corrected", "negative", "clipped", "saturated"):
            setattr(self, name, getattr(self, name) + getattr(other, name))


@dataclass(frozen=True)
class Result:
    """What a run did.

    Attributes
    ----------
    fitted : Fitted
    tally : Tally
    sidecar : dict
        Everything that the sidecar says.
    warnings : tuple of str
    """

    fitted: Fitted
    tally: Tally
    sidecar: dict[str, Any]
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Done:
    """One corrected tile."""

    raw: npt.NDArray[Any]
    valid: npt.NDArray[np.bool_] | None
    tally: Tally
    flags: npt.NDArray[np.uint8] | None = None
    amount: npt.NDArray[np.float32] | None = None


@dataclass(frozen=True)
class _Work:
    """All that correcting a tile needs; shared by the threads, never changed."""

    scene: Scene
    model: GlintModel
    outputs: Outputs
    dtype: np.dtype[Any]
    area: Area | None
    water: WaterRule | None
    water_bands: tuple[int, ...]

    def __call__(self, tile: Tile) -> _Done:
        source = raster_of(self.scene)
        info = source.info
        raw, valid = source.read_raw(tile.window)
        tally = Tally(len(self.scene.bands), total=tile.shape[0] * tile.shape[1])
        physical = source.to_physical(raw, valid)
        known = self._known(physical, valid)
        inside = self._inside(tile, physical)
        where = known if inside is None else inside if known is None else known & inside
        usable = tally.total if where is None else int(np.count_nonzero(where))
        tally.nodata = 0 if known is None else tally.total - int(np.count_nonzero(known))
        tally.not_water = tally.total - usable - tally.nodata
        tally.corrected = usable if self.model.fits else 0
        flags = self._flags(known, where, tile.shape) if self.outputs.flags else None
        tally.saturated = _saturated(self.scene, physical, flags)
        bands = [f.band for f in self.model.fits]
        before = physical[bands].copy() if self.outputs.amount else None
        if raw.dtype != self.dtype:
            raw = raw.astype(self.dtype)
        if tally.corrected:
            if not physical.flags.writeable:
                physical = physical.copy()
            apply(physical, self.model, where=where, out=physical)
            counts = encode(
                physical, raw, bands=bands, scales=info.scales, offsets=info.offsets,
                where=where, flags=flags, marks=(NEGATIVE, CLIPPED),
            )  # fmt: skip
            tally.negative, tally.clipped = counts.negative, counts.clipped
        amount = None if before is None else np.subtract(before, physical[bands], dtype=np.float32)
        return _Done(raw, valid, tally, flags, amount)

    def _known(self, physical: Any, valid: Any) -> npt.NDArray[np.bool_] | None:
        """Where every index can be computed; None where it can everywhere."""
        if valid is None and raster_of(self.scene).info.dtype.kind in "iu":
            return None
        finite = np.isfinite(physical[self.model.index_bands[0]])
        for band in self.model.index_bands[1:]:
            finite &= np.isfinite(physical[band])
        return None if finite.all() else finite

    def _inside(self, tile: Tile, physical: Any) -> npt.NDArray[np.bool_] | None:
        """Where correction is wanted; None for everywhere."""
        if self.area is not None:
            return self.area.read(tile.window)
        if self.water is None:
            return None
        if self.water.halo == 0:
            return water(np.ascontiguousarray(physical[list(self.water_bands)]), self.water)
        outer = tile.grown(self.water.halo, self.scene.height, self.scene.width)
        found = water(self.scene.source.read(outer.window, list(self.water_bands)), self.water)
        return np.ascontiguousarray(found[core_of(tile.crop_of(outer), found.shape)])

    def _flags(self, known: Any, where: Any, shape: tuple[int, int]) -> npt.NDArray[np.uint8]:
        flags = np.full(shape, NOT_WATER, np.uint8)
        flags[... if where is None else where] = CORRECTED
        if known is not None:
            flags[~known] = NODATA
        return flags


def remove_glint(
    source: str | Path | Sequence[str | Path],
    image: str | Path,
    recipe: Recipe | None = None,
    *,
    model: GlintModel | None = None,
    sensor: str | None = None,
    nodata: float | None = None,
    grid: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    **outputs: Any,
) -> Result:
    """Remove glint from a raster file.

    Parameters
    ----------
    source : path or sequence of paths
        GDAL name(s) of the input, as `deglint.open_scene` takes them.
    image : path
        Output, a local GeoTIFF. `image`.json is written beside it.
    recipe : Recipe, optional
        What to do; finds everything out by itself by default.
    model : GlintModel, optional
        Apply this model, fitted before, instead of fitting one.
    sensor, nodata, grid
        As `deglint.open_scene`.
    threads : int, optional
        All processors by default. The result is the same for any number.
    progress : callable, optional
        progress(stage, done, total).
    **outputs
        flags, amount, sample, model_file, picture, overwrite, dtype, options: see `Outputs`.

    Returns
    -------
    Result

    Raises
    ------
    ReadError, WriteError, InputError, BandError, FitError, NoWaterError
        With one line that says what to do. No output is left, and an old one is as it was.

    Examples
    --------
    >>> remove_glint("scene.tif", "clean.tif", Recipe(method="hedley"))  # doctest: +SKIP
    """
    from ..readers import open_scene

    if "model_file" in outputs:
        outputs["model"] = outputs.pop("model_file")
    paths: dict[str, Any] = {k: Path(v) if _is_path(k, v) else v for k, v in outputs.items()}
    targets = Outputs(Path(image), **paths)
    if len(set(targets.every())) < len(targets.every()):
        raise InputError("two outputs have the same name; give each its own.")
    for path in targets.every():
        check_target(path, overwrite=targets.overwrite)
    with environment():
        scene = open_scene(source, sensor=sensor, nodata=nodata, grid=grid)
        with raster_of(scene):
            return _run(scene, recipe or Recipe(), targets, model, threads or default_threads(), progress)


def _run(
    scene: Scene, recipe: Recipe, targets: Outputs, model: GlintModel | None, threads: int, progress: Progress | None
) -> Result:
    begun = time.perf_counter()
    checksum = Checksum(raster_of(scene).info.paths)
    area = None if recipe.mask in ("auto", "none") else open_area(recipe.mask, scene, "--mask")
    if model is None:
        fitted = fit_scene(scene, recipe, threads=threads, want_sample=targets.sample is not None, progress=progress)
    else:
        fitted = given_model(scene, recipe, model, threads)
    if targets.sample and fitted.sample is None:
        raise InputError(f"{fitted.model.method} was not fitted to a sample here, so there is none to write.")
    if targets.amount and not fitted.model.fits:
        raise InputError(
            "no band is corrected, so there is no amount to write: leave out --amount, or name a --method."
        )
    with Scratch() as scratch:
        tally = _write_tiles(scratch, scene, fitted, targets, area, threads, progress)
        if tally.corrected == 0 and fitted.model.fits:
            why = "every pixel is nodata" if tally.nodata == tally.total else "no pixel is water inside the mask"
            raise NoWaterError(f"nothing to correct in {scene.path}: {why}. Check --nodata and --mask.")
        if targets.sample:
            write_json(scratch, targets.sample, fitted.sample)
        if targets.model:
            write_text(scratch, targets.model, fitted.model.to_json() + "\n")
        if targets.picture:
            write_bytes(scratch, targets.picture, before_after(scene, scratch.file(targets.image), fitted.model))
        said = plain(sidecar(scene, fitted, targets, tally, checksum, time.perf_counter() - begun))
        write_json(scratch, targets.sidecar, said)
    return Result(fitted, tally, said, tuple(said["warnings"]))


def _write_tiles(
    scratch: Scratch, scene: Scene, fitted: Fitted, targets: Outputs, area: Area | None, threads: int,
    progress: Progress | None,
) -> Tally:  # fmt: skip
    info = raster_of(scene).info
    every = tuple(range(len(scene.bands)))
    dtype = np.dtype(targets.dtype) if targets.dtype else info.dtype
    nodata = _nodata(info.nodatas, dtype)
    work = _Work(scene, fitted.model, targets, dtype, area, None if area else fitted.water, fitted.water_bands)
    image = Layout(info, every, dtype.name, nodata, targets.options)
    tally = Tally(len(scene.bands))
    note = (lambda done, total: progress("correct", done, total)) if progress else None
    with ExitStack() as stack:
        writers: list[tuple[RasterWriter, str]] = [(stack.enter_context(writing(scratch, targets.image, image)), "raw")]
        if targets.flags:
            layout = Layout(info, (0,), "uint8", None, targets.options, scaled=False, names=("flags",))
            writers.append((stack.enter_context(writing(scratch, targets.flags, layout)), "flags"))
        if targets.amount:
            bands = tuple(f.band for f in fitted.model.fits)
            layout = Layout(info, bands, "float32", float("nan"), targets.options, scaled=False, names=tuple(
                f"glint in {scene.bands[b].name}" for b in bands))  # fmt: skip
            writers.append((stack.enter_context(writing(scratch, targets.amount, layout)), "amount"))
        everything = tiling.tiles(scene.height, scene.width, tile_shape_of(scene))
        for tile, done in tiling.run(everything, work, threads=threads, progress=note, start=enter_thread):
            for writer, what in writers:
                writer.write(getattr(done, what), tile.window)
            if image.masked:
                everything_valid = np.ones((1, *tile.shape), np.bool_)
                valid = everything_valid if done.valid is None else done.valid
                writers[0][0].write_mask(np.asarray(valid.all(axis=0)), tile.window)
            tally.add(done.tally)
    return tally


def given_model(scene: Scene, recipe: Recipe, model: GlintModel, threads: int) -> Fitted:
    """A model that was fitted before, made ready for this scene.

    Raises
    ------
    InputError
        The scene lacks a band that the model needs.
    NoWaterError
        The scene holds no water.
    """
    model = model.for_bands(scene.names)
    notes = [f"model {model.method}, fitted before"]
    rule: WaterRule | None = None
    bands: tuple[int, ...] = ()
    if recipe.mask == "auto":
        look = look_at(scene, model.index_bands[0], threads, wanted=True)
        rule, bands = look.water, role_bands(look.roles)
        if rule is not None:
            if not rule.has_water:
                raise NoWaterError(rule.reason)
            notes.append(rule.reason)
    resolved = replace(recipe, method=model.method, regression=model.regression or "none", sample="none")
    numbers = {"water": rule.numbers() if rule else None, "sample": None}
    return Fitted(model, resolved, tuple(notes), numbers, None, rule, bands)


def _nodata(declared: Sequence[float | None], dtype: np.dtype[Any]) -> float | None:
    """The nodata value of the output: the input's, where the output's type can hold it."""
    value = next((n for n in declared if n is not None), None)
    if value is None or dtype.kind == "f":
        return value
    limits = np.iinfo(dtype)
    return value if np.isfinite(value) and limits.min <= value <= limits.max else None


def _saturated(scene: Scene, physical: Any, flags: npt.NDArray[np.uint8] | None) -> npt.NDArray[np.int64]:
    """Pixels of each band at or above its saturation, flagged where asked."""
    counts = np.zeros(len(scene.bands), np.int64)
    for i, band in enumerate(scene.bands):
        if band.saturation is not None:
            full = physical[i] >= physical.dtype.type(band.saturation)
            counts[i] = np.count_nonzero(full)
            if flags is not None and counts[i]:
                flags[full] |= SATURATED
    return counts


def _is_path(name: str, value: Any) -> bool:
    return name in ("flags", "amount", "sample", "model", "picture") and value is not None
