"""Open files as a `Scene`: what the command line and every script start with.

Opening reads headers and tags only. Names are GDAL's (`/vsizip/`, `zip://`, `/vsis3/`), so that the file
system is never asked about them.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from .. import sensors
from ..checks import as_path, check_number, checked_keywords
from ..errors import BandError, InputError
from ..raster import RasterInfo, RasterSource
from ..raster.info import describe, open_dataset
from ..scene import Band, Scene
from . import products
from .grid import put_on_grid
from .names import nominal_wavelength, wavelength_in_name
from .presets import apply_sensor, sensor_in_tags
from .roles import Wanted, explain_nir, split_wanted
from .spectral import saturation, spectral_of, time_offset

Path = str | os.PathLike[str]

_SENTINEL2 = re.compile(r"b0\d|b0?8a")
_NOT_NAMES = ("gray", "undefined", "palette", "alpha")


@checked_keywords()
def open_scene(
    path: Path | Sequence[Path],
    *,
    sensor: str | None = None,
    nir: Wanted | None = None,
    nodata: float | str | None = None,
    grid: str | int | None = None,
) -> Scene:
    """Open one raster or product, or several of one place, as a scene; no pixel is read.

    Parameters
    ----------
    path : str, path or sequence of them
        GDAL name(s), or products: a folder, an archive or a metadata file. Bands of several files are stacked in
        the order given. Where their grids differ they are put on one: bilinear for larger pixels, averaged for
        smaller ones, in their own type.
    sensor : str, optional
        Name of a preset (`deglint.sensors.names`) that fills in what the file does not say of its bands.
        By default the one that a tag of the file names, if it fits.
    nir : str, int or sequence, optional
        Near-infrared band(s), only checked and noted here; see `find_nir`.
    nodata : float or "none", optional
        Number (or NaN) that says "not valid", in place of what the files declare; "none": every number is data.
    grid : str or int, optional
        Whose grid to use: "finest" (the default), or a file by 1-based number or name.

    Returns
    -------
    Scene
        Its `source` is a `RasterSource`; `source.info` tells all about the file, `source.close()` closes.

    Raises
    ------
    ReadError
        No such file, or not a raster GDAL can read.
    InputError
        Complex numbers, no bands, files that do not overlap, or an option that is out of range.
    BandError
        The sensor preset or the near-infrared band does not fit the bands.

    Examples
    --------
    >>> scene = open_scene("scene.tif", sensor="worldview3")  # doctest: +SKIP
    >>> find_nir(scene)  # doctest: +SKIP
    (6,)
    """
    paths = [as_path(p, "path") for p in (path if isinstance(path, (list, tuple)) else [path])]
    if nodata not in (None, "none") and nodata == nodata:  # NaN is allowed
        check_number(nodata, -math.inf, math.inf, 'nodata ("none": every number is data)')
    if not paths:
        raise InputError("want at least one file to open, got none")
    notes: list[str] = []
    found = [products.opened(os.fspath(p), lambda name: _describe(name, sensor, nir, notes)) for p in paths]
    notes += products.notes_of(found)
    infos = [with_nodata(info, nodata, notes) for o in found for info in o.infos]
    files, reference, said = put_on_grid(infos, grid)
    info = _together(infos, reference)
    stems = [_stem(i) if len(infos) > 1 else "" for i in infos for _ in i.dtypes]
    bands, preset, told = bands_of(info, stems, sensor)
    scene = Scene(
        bands=tuple(bands),
        height=info.height,
        width=info.width,
        source=RasterSource(files, info),
        path=", ".join(os.fspath(p) for p in paths),
        crs=info.crs,
        transform=info.transform,
        sensor=preset,
        notes=(*notes, *said, *told),
        product=products.named(found),
        footprints=products.footprints(found, reference),
    )
    return scene if nir is None else replace(scene, notes=(*scene.notes, explain_nir(scene, nir)))


def _describe(path: str, sensor: str | None, nir: Wanted | None, notes: list[str]) -> RasterInfo:
    with open_dataset(path) as dataset:
        info = describe(dataset, path)
        if info.alpha is None:
            return info
        asked = [] if nir is None else split_wanted(nir)
        needed = sensor is not None and len(sensors.load(sensor).bands) == info.count + 1
        if needed or str(info.alpha) in map(str, asked):
            return describe(dataset, path, alpha_is_band=True)
    notes.append(
        f"{path}: band {info.alpha} is alpha (0: not valid), not an image band; if it is one, name it in the file, "
        f"or ask for it with --nir {info.alpha}"
    )
    return info


def with_nodata(info: RasterInfo, nodata: float | str | None, notes: list[str]) -> RasterInfo:
    """The nodata of each band: the caller's, else the file's where its type can hold it."""
    if isinstance(nodata, str):
        return replace(info, nodatas=(None,) * info.count, nodata_given=True)
    if nodata is not None:
        for dtype in info.dtypes:
            if not _holds(dtype, nodata):
                raise InputError(f"nodata: allowed is {_range(dtype)} for {dtype}, got {nodata:g}")
        return replace(info, nodatas=(float(nodata),) * info.count, nodata_given=True)
    kept = []
    for i, (declared, dtype) in enumerate(zip(info.nodatas, info.dtypes, strict=True), start=1):
        usable = declared is None or _holds(dtype, declared)
        kept.append(declared if usable else None)
        if not usable:
            notes.append(f"{info.paths[0]}: nodata {declared:g} of band {i} is ignored: {dtype} cannot hold it")
    return replace(info, nodatas=tuple(kept))


def _holds(dtype: str, nodata: float) -> bool:
    if np.dtype(dtype).kind == "f":
        return True
    limits = np.iinfo(dtype)
    return limits.min <= nodata <= limits.max and float(nodata).is_integer()


def _range(dtype: str) -> str:
    return f"a whole number {np.iinfo(dtype).min} to {np.iinfo(dtype).max}"


def _together(infos: Sequence[RasterInfo], reference: RasterInfo) -> RasterInfo:
    """One description for the stack: bands of all files, grid and format of the reference."""
    if len(infos) == 1:
        return infos[0]
    joined: dict[str, Any] = {}
    for f in fields(RasterInfo):
        per_band = isinstance(getattr(reference, f.name), tuple) and f.name != "gcps"
        if per_band:
            joined[f.name] = tuple(value for info in infos for value in getattr(info, f.name))
    return replace(reference, **joined, alpha=None)


def _stem(info: RasterInfo) -> str:
    """The last part of a GDAL name without its ending, for files of one band."""
    return re.split(r"[/\\!:]", info.paths[0])[-1].rsplit(".", 1)[0] if info.count == 1 else ""


def bands_of(info: RasterInfo, stems: Sequence[str], sensor: str | None) -> tuple[list[Band], str | None, list[str]]:
    """Bands of a scene, the sensor preset that was used, and what to say; `stems` are names for bands without one."""
    names = _names(info, stems)
    spectra = spectral_of(info)
    bands = [
        Band(
            name=name,
            wavelength=known.wavelength or wavelength_in_name(name),
            width=known.width,
            time_offset=time_offset(info.band_tags[i]),
            saturation=saturation(info, i),
        )
        for i, (name, known) in enumerate(zip(names, spectra, strict=True))
    ]
    notes = []
    if any(s.assumed for s in spectra):
        notes.append("wavelengths have no unit: up to 30 they are read as micrometres, above as nanometres")
    bands, preset, told = _with_sensor(bands, info, sensor)
    bands, guessed = _from_names(bands)
    return bands, preset, notes + told + guessed


def _with_sensor(bands: list[Band], info: RasterInfo, sensor: str | None) -> tuple[list[Band], str | None, list[str]]:
    if sensor is not None:
        asked = sensors.load(sensor)
        bands, notes = apply_sensor(bands, asked)
        return bands, asked.name, notes
    tagged = sensor_in_tags(info)
    if tagged is None:
        return bands, None, []
    try:
        bands, notes = apply_sensor(bands, tagged)
    except BandError as error:
        return bands, None, [f"a tag names a sensor, which is not used: {error}"]
    return bands, tagged.name, notes


def _from_names(bands: list[Band]) -> tuple[list[Band], list[str]]:
    """Wavelengths that only the names tell: Sentinel-2's band codes, else colour words."""
    if all(b.wavelength is not None for b in bands):
        return bands, []
    notes = []
    if any(_SENTINEL2.fullmatch(sensors.normalise(b.name)) for b in bands):
        codes = {sensors.normalise(b.name): b for b in sensors.load("sentinel2").bands}
        guess = {name: own.wavelength for name, own in codes.items()}
        told = "the names are Sentinel-2's; their wavelengths are assumed"
    else:
        guess, told = {}, "wavelengths of {} are nominal, from the names"
    filled = []
    for band in bands:
        nominal = guess.get(sensors.normalise(band.name)) if guess else nominal_wavelength(band.name)
        filled.append(band if band.wavelength is not None else replace(band, wavelength=nominal))
    changed = [b.name for b, old in zip(filled, bands, strict=True) if b is not old and b.wavelength]
    if changed:
        notes.append(told.format(", ".join(changed)))
    return filled, notes


def _names(info: RasterInfo, stems: Sequence[str]) -> list[str]:
    """One name a band: its description, else what its file or its colour is called, else "band N"."""
    names = []
    for i, (described, stem) in enumerate(zip(info.descriptions, stems, strict=True)):
        colour = info.colorinterp[i]
        spare = "" if colour in _NOT_NAMES else colour
        names.append((described or "").strip() or _short(stem) or spare or f"band {i + 1}")
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        seen[name.casefold()] += 1
        if seen[name.casefold()] > 1:
            names[i] = f"{name} ({seen[name.casefold()]})"
    return names


def _short(stem: str) -> str:
    """The part of a file name that names its band ("T32_B08_10m" is "B08"), else all of it."""
    codes = re.findall(r"(?<![A-Za-z0-9])(B\d{1,2}A?)(?![A-Za-z0-9])", stem, flags=re.IGNORECASE)
    return codes[-1] if len(codes) == 1 else stem
