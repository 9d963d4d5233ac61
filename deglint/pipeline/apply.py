"""The whole job: open, fit (or take a saved model), correct tile by tile, write the output and its sidecar."""

from __future__ import annotations

import os
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
from ..masks import WaterRule, opened, valid_for, water
from ..raster.convert import is_valid
from ..raster.encode import encode, retype
from ..raster.environment import enter_thread, environment
from ..raster.info import same_nodata
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
from .surroundings import Surroundings

FLAGS = {
    1: "nodata: not valid, passed unchanged",
    2: "not water, or outside the mask: passed unchanged",
    4: "corrected",
    8: "negative after correction, in some band",
    16: "saturated before correction, in some band",
    32: "clipped to the output's integer range (less the number for nodata), in some band",
}
"""Bits of the flag raster."""
DTYPES = ("float32", "float64", "uint8", "uint16", "int16", "uint32", "int32")
"""Types that an output may be given."""
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

    def __post_init__(self) -> None:
        if self.dtype is not None and self.dtype not in DTYPES:
            raise InputError(f"dtype {self.dtype!r} is not one of {', '.join(DTYPES)}.")

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
    tally: Tally
    valid: npt.NDArray[np.bool_] | None = None
    flags: npt.NDArray[np.uint8] | None = None
    amount: npt.NDArray[np.float32] | None = None


@dataclass(frozen=True)
class _Work:
    """All that correcting a tile needs; shared by the threads, never changed."""

    scene: Scene
    model: GlintModel
    outputs: Outputs
    layout: Layout
    area: Area | None
    water: WaterRule | None
    water_bands: tuple[int, ...]
    surroundings: Surroundings | None

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
        where = None if usable == tally.total else where
        tally.nodata = 0 if known is None else tally.total - int(np.count_nonzero(known))
        tally.not_water = tally.total - usable - tally.nodata
        tally.corrected = usable if self.model.fits else 0
        flags = self._flags(known, where, tile.shape) if self.outputs.flags else None
        tally.saturated = _saturated(self.scene, physical, flags)
        bands = [f.band for f in self.model.fits]
        before = physical[bands].copy() if self.outputs.amount else None
        file_valid = self._file_valid(raw, valid)
        raw, lost = self._retyped(raw, valid)
        if tally.corrected:
            if not physical.flags.writeable:
                physical = physical.copy()
            apply(physical, self.model, where=where, out=physical)
            counts = encode(
                physical, raw, bands=bands, scales=info.scales, offsets=info.offsets,
                where=where, nodata=self.layout.nodata, flags=flags, marks=(NEGATIVE, CLIPPED),
            )  # fmt: skip
            tally.negative, tally.clipped = counts.negative, counts.clipped
            if lost is not None:
                lost[bands] &= False if where is None else ~where
        if lost is not None:
            tally.clipped = tally.clipped + np.count_nonzero(lost, axis=(1, 2))
            if flags is not None:
                flags[lost.any(axis=0)] |= CLIPPED
        amount = None if before is None else np.subtract(before, physical[bands], dtype=np.float32)
        return _Done(raw, tally, file_valid, flags, amount)

    def _file_valid(self, raw: Any, valid: Any) -> npt.NDArray[np.bool_] | None:
        """What the output's mask says of the tile, where it has one: valid in every band."""
        if not self.layout.masked:
            return None
        found = np.ones(raw.shape[1:], np.bool_) if valid is None else np.asarray(valid.all(axis=0))
        if raw.dtype.kind == "f" and np.dtype(self.layout.dtype).kind != "f":
            found = found & np.isfinite(raw).all(axis=0)
        return found

    def _retyped(self, raw: Any, valid: Any) -> tuple[Any, Any]:
        """The tile in the output's type and with the output's nodata; also where a valid number was clipped."""
        dtype, nodata = np.dtype(self.layout.dtype), self.layout.nodata
        lost = None
        own = [self.layout.info.nodatas[b] for b in range(len(raw))]
        hidden = None if nodata is None or all(n is None or same_nodata(n, nodata) for n in own) else is_valid(raw, own)
        if raw.dtype != dtype:
            raw, lost = retype(raw, dtype)
            if lost is not None and valid is not None:
                lost &= valid
        if hidden is not None:
            np.copyto(raw, dtype.type(nodata), where=~hidden)
        return raw, lost

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
        bands = [physical[b] for b in self.water_bands]
        if self.surroundings is None:
            return water(bands, self.water)
        inside = valid_for(bands, self.water.roles)
        found = opened(*self.surroundings.around(tile, bands[self.water.roles.nir]), self.water.window)
        outer = tile.grown(self.water.halo, self.scene.height, self.scene.width)
        return inside & ~found[core_of(tile.crop_of(outer), found.shape)]

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
    if threads is not None and threads < 1:
        raise InputError(f"threads: want at least 1, got {threads}.")
    if len(set(map(os.path.realpath, targets.every()))) < len(targets.every()):
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
    inputs = {os.path.realpath(p) for p in raster_of(scene).info.paths}
    for path in targets.every()[1:]:  # the image itself may replace its input, once it is whole
        if os.path.realpath(path) in inputs:
            raise InputError(f"{path} is the input, and would be lost. Give that output another name.")
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
    nodata, masked = _marking(scene, dtype)
    shape = tile_shape_of(scene)
    image = Layout(info, every, dtype.name, nodata, targets.options, masked=masked, tile=shape)
    everything = tiling.tiles(scene.height, scene.width, shape)
    rule, bands = None if area else fitted.water, fitted.water_bands
    beyond = Surroundings(scene, rule, bands[rule.roles.nir], everything) if rule and rule.halo else None
    work = _Work(scene, fitted.model, targets, image, area, rule, bands, beyond)
    tally = Tally(len(scene.bands))
    note = (lambda done, total: progress("correct", done, total)) if progress else None
    with ExitStack() as stack:
        writers: list[tuple[RasterWriter, str]] = [(stack.enter_context(writing(scratch, targets.image, image)), "raw")]
        if targets.flags:
            layout = Layout(info, (0,), "uint8", None, targets.options, scaled=False, names=("flags",), tile=shape)
            writers.append((stack.enter_context(writing(scratch, targets.flags, layout)), "flags"))
        if targets.amount:
            bands = tuple(f.band for f in fitted.model.fits)
            names = tuple(f"glint in {scene.bands[b].name}" for b in bands)
            layout = Layout(
                info, bands, "float32", float("nan"), targets.options, scaled=False, names=names, tile=shape
            )
            writers.append((stack.enter_context(writing(scratch, targets.amount, layout)), "amount"))
        for tile, done in tiling.run(everything, work, threads=threads, progress=note, start=enter_thread):
            for writer, what in writers:
                writer.write(getattr(done, what), tile.window)
            if done.valid is not None:
                writers[0][0].write_mask(done.valid, tile.window)
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
    resolved = replace(recipe, method=model.method, regression=model.regression or "auto", sample="none")
    numbers = {"water": rule.numbers() if rule else None, "sample": None}
    return Fitted(model, resolved, tuple(notes), numbers, None, rule, bands)


def _marking(scene: Scene, dtype: np.dtype[Any]) -> tuple[float | None, bool]:
    """How the output says which pixels are not valid: the input's nodata where the type can hold it, and a mask where
    the input has one, or where its nodata cannot be said otherwise."""
    source = raster_of(scene)
    value = next((n for n in source.info.nodatas if n is not None), None)
    masked = any(f.dataset_mask or f.band_masks or f.alpha is not None for f in source.files)
    if dtype.kind == "f":
        held = value is None or not np.isfinite(value) or abs(value) <= np.finfo(dtype).max
        return (value if held else float("nan")), masked
    limits = np.iinfo(dtype)
    if value is not None and limits.min <= value <= limits.max and float(value).is_integer():
        return value, masked
    return None, masked or value is not None or source.info.dtype.kind == "f"


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
