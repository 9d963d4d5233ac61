"""Open files as a `Scene`; only headers and tags are read. GDAL names are allowed (`/vsizip/`, `zip://`, `/vsis3/`)."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypedDict, Unpack

import numpy as np

from ..checks import as_path, check_number, checked_keywords, described
from ..errors import InputError
from ..raster import RasterInfo, RasterSource
from ..raster.convert import holds
from ..raster.info import describe_file
from ..scene import Scene
from . import products
from .bands import bands_of, labelled, sensor_of
from .grid import joined, put_on_grid
from .roles import Wanted, explain_nir, split_wanted
from .scenes import assets_of
from .spectral import SPECTRAL_RANGE, example_names, nanometres, own_facts, with_spectral
from .text import number

Path = str | os.PathLike[str]
Names = str | Sequence[str]
GivenNumbers = str | float | Sequence[float]
GivenProperties = Mapping[str, tuple[Any, ...]]
"""For each option of `open_scene` with properties of bands, the values that the user gives: one per band, or none. A
single scale or offset is for all bands."""


class BandProperties(TypedDict, total=False):
    """Keyword arguments of `open_scene` that give properties of all bands; they are described there."""

    bands: Names | None
    wavelengths: GivenNumbers | None
    scale: GivenNumbers | None
    offset: GivenNumbers | None


@checked_keywords(*BandProperties.__annotations__)
def open_scene(
    path: Path | Sequence[Path],
    *,
    sensor: Path | None = None,
    nir: Wanted | None = None,
    nodata: float | str | None = None,
    grid: str | int | None = None,
    **properties: Unpack[BandProperties],
) -> Scene:
    """Open one or several rasters or products of the same place as a scene; no pixel is read.

    Parameters
    ----------
    path : str, path or sequence of them
        GDAL names, products (a folder, an archive or a metadata file), or STAC Items (a file or URL), from which the
        bands are taken. Bands of several files are stacked in the order given, on one grid; larger pixels are resampled
        bilinearly, smaller ones are averaged, in the data type of their file.
    sensor : str, optional
        Name of a sensor preset (`deglint.sensors.names`) or of a .toml file. It supplies band properties that the
        image does not state. By default, the preset that a tag of the image names is used, if it fits the bands.
    nir : str, int or sequence, optional
        Near-infrared band(s), as `wanted` in `find_nir`; they are checked, and recorded in `Scene.notes`.
    nodata : float or "none", optional
        File value (or NaN) of pixels that are not valid, in all bands; with "none", every value is data.
    grid : str or int, optional
        The file whose grid is used: "finest" (the smallest pixels, the default), its 1-based number, or its name.
    bands, wavelengths : str or sequence, optional
        Name ("blue,green,red,nir") and centre wavelength [nm] of every band, in order; numbers up to 30 are in um.
    scale, offset : float or sequence of float, optional
        One number, or one for each band: physical value = file value * scale + offset. `nodata`, `bands`,
        `wavelengths`, `scale` and `offset` override the properties in the files.

    Returns
    -------
    Scene
        Its `source` is a `RasterSource`: `source.info` describes the file, and `source.close()` closes it.

    Raises
    ------
    ReadError, InputError, BandError
        ReadError if a file cannot be read. InputError if it is not supported (such as complex numbers), if files do
        not fit on one grid, or if an option is not valid. BandError if a preset or NIR band does not fit the bands.

    Examples
    --------
    >>> scene = open_scene("scene.tif", sensor="worldview3")  # doctest: +SKIP
    >>> find_nir(scene)  # doctest: +SKIP
    (6,)
    """
    paths = [as_path(p, "path") for p in (path if isinstance(path, (list, tuple)) else [path])]
    if not paths:
        raise InputError("want at least one file to open, got none")
    preset = None if sensor is None else as_path(sensor, "sensor")
    scene = _stacked(paths, preset, nir, nodata, grid, _given(properties))
    return scene if nir is None else replace(scene, notes=(*scene.notes, explain_nir(scene, nir)))


def _stacked(
    paths: Sequence[str],
    preset: str | None,
    nir: Wanted | None,
    nodata: float | str | None,
    grid: str | int | None,
    given: GivenProperties,
) -> Scene:
    notes: list[str] = []
    assets = [asset for path in paths for asset in assets_of(path)]
    count = max(len(given["bands"]), len(given["wavelengths"]))
    # with several files, the number of names and the number of the NIR band refer to their stack, not to one file
    alone, own = (count, nir) if len(assets) == 1 else (0, None)
    opened = []
    for asset in assets:
        held = products.opened(asset.path, lambda name: _describe(name, preset, own, notes, alone))
        opened.append(replace(held, infos=[asset.put_on(info) for info in held.infos]))
    notes += products.notes_of(opened)
    infos = [with_nodata(info, nodata, notes) for o in opened for info in o.infos]
    unscaled = [np.dtype(d).kind for i in infos for d, s in zip(i.dtypes, i.scales, strict=True) if s == 1]
    if "f" in unscaled and set(unscaled) != {"f"}:
        notes.append("integers and floating-point numbers are assumed to have the same unit (--scale, --offset)")
    files, reference, moved = put_on_grid(infos, grid)
    info = infos[0] if len(infos) == 1 else joined([own_facts(i) for i in infos], reference)
    info = _with_given(info, given)
    names = [re.split(r"[/\\!:]", i.paths[0])[-1].rsplit(".", 1)[0] for i in infos]
    stems = [s if i.count == 1 < len(infos) else "" for s, i in zip(names, infos, strict=True) for _ in i.dtypes]
    found, known, told = bands_of(info, stems, preset)
    if len(infos) > 1 or preset is not None or count:
        info = labelled(info, found)
    return Scene(
        bands=tuple(found),
        height=info.height,
        width=info.width,
        source=RasterSource(files, info),
        path=", ".join(paths),
        crs=info.crs,
        transform=info.transform,
        sensor=known,
        notes=(*notes, *moved, *told),
        product=products.named(opened),
        footprints=products.footprints(opened, reference),
    )


def _describe(path: str, sensor: str | None, nir: Wanted | None, notes: list[str], count: int) -> RasterInfo:
    """Describe a file. Its alpha band becomes a band of the scene, or it is left out and a line is added to `notes`.

    It becomes a band if the user selects it as `nir`, or if only then the number of bands is right, namely `count`
    (number of names or wavelengths that the user gives, 0 if none) or that of a product of the sensor `sensor`.
    """
    info = describe_file(path)
    if info.alpha is None:
        return info
    more = info.count + 1  # number of bands with the alpha band
    known = None if sensor is None else sensor_of(sensor)
    fits = known is not None and info.count not in known.counts and more in (len(known.bands), *known.counts)
    if fits or count == more or str(info.alpha) in map(str, [] if nir is None else split_wanted(nir)):
        return describe_file(path, alpha_is_band=True)
    what = "is used as alpha (0: not valid); if it is an image band, name all bands with --bands"
    notes.append(f"{path}: band {info.alpha} {what}")
    return info


def with_nodata(info: RasterInfo, nodata: float | str | None, notes: list[str]) -> RasterInfo:
    """A copy of `info` with the nodata to use for each band.

    A given `nodata` is used for all bands ("none": no nodata). Raises InputError if the type of a band cannot hold it.
    If `nodata` is None, bands keep their own values; one that the type cannot hold is removed, with a line in `notes`.
    """
    if nodata not in (None, "none") and nodata == nodata:  # NaN is allowed
        check_number(nodata, -math.inf, math.inf, 'nodata ("none": every number is data)')
    if nodata is not None:
        given = None if isinstance(nodata, str) else float(nodata)
        for dtype in info.dtypes:
            if given is not None and not holds(dtype, given):
                low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
                raise InputError(f"nodata: allowed is an integer {low} to {high} for {dtype}, got {given:g}")
        info = replace(info, nodatas=(given,) * info.count, nodata_given=True)
    kept = list(info.nodatas)
    for i, (declared, dtype) in enumerate(zip(info.nodatas, info.dtypes, strict=True)):
        if declared is not None and dtype == "float32" and abs(declared) <= float(np.finfo(dtype).max):
            kept[i] = float(np.float32(declared))  # the number in the file, also beside bands of float64
        if declared is not None and not holds(dtype, declared):
            notes.append(f"{info.paths[0]}: nodata {declared:g} of band {i + 1} is ignored: {dtype} cannot hold it")
            kept[i] = None
    return replace(info, nodatas=tuple(kept))


def _given(given: BandProperties) -> GivenProperties:
    """Parse and check the options of `open_scene` that override properties in the files (see `GivenProperties`)."""
    return {
        "bands": _names(given.get("bands")),
        "wavelengths": tuple(map(_nanometres, _numbers("wavelengths", given.get("wavelengths"), "475,560,668,842"))),
        "scale": _numbers("scale", given.get("scale"), "0.0001", zero=False),
        "offset": _numbers("offset", given.get("offset"), "-0.1"),
    }


def _with_given(info: RasterInfo, given: GivenProperties) -> RasterInfo:
    """A copy of `info` with the properties `given`. Raises InputError if there are too many or too few values."""
    total, path = info.count, ", ".join(info.paths)
    every = {k: v * total if k in ("scale", "offset") and len(v) == 1 else v for k, v in given.items()}
    for option, values in every.items():
        if len(values) not in (0, total):
            raise InputError(
                f"--{option} gives {len(values)} and {path} has {total} bands. Give one for each band, in the "
                "file's order; -b chooses bands."
            )
    if waves := every["wavelengths"]:
        info = with_spectral(info, [(w, None) for w in waves])
    scales, offsets = every["scale"] or info.scales, every["offset"] or info.offsets
    if 0 in scales or not np.isfinite([*scales, *offsets]).all():
        raise InputError(f"{path} declares a scale of 0, or one that is no number: give --scale 1 --offset 0.")
    names, stated = every["bands"] or info.descriptions, bool(every["offset"]) or info.offset_given
    return replace(info, descriptions=names, scales=scales, offsets=offsets, offset_given=stated)


def _names(given: Names | None) -> tuple[str, ...]:
    if given is None:
        return ()
    parts = given.split(",") if isinstance(given, str) else given
    if not isinstance(parts, (list, tuple)) or not all(isinstance(p, str) for p in parts):
        raise InputError(f'bands: want names such as "blue,green,red,nir" or a list of them, got {described(given)}.')
    names = tuple(p.strip() for p in parts)
    if not all(names):
        raise InputError(f"--bands: name {names.index('') + 1} of {len(names)} is empty. Name every band.")
    if all(re.fullmatch(r"\d{1,2}", n) for n in names):
        raise InputError(
            f"--bands {','.join(names)}: --bands gives bands their names, such as --bands "
            f'"{example_names(len(names))}". To choose bands by number, use -b {",".join(names)}.'
        )
    if twice := [n for i, n in enumerate(names) if n.casefold() in [m.casefold() for m in names[:i]]]:
        raise InputError(f"--bands gives two bands the name {twice[0]!r}. Give each its own.")
    return names


def _numbers(option: str, given: GivenNumbers | None, example: str, *, zero: bool = True) -> tuple[float, ...]:
    if given is None:
        return ()
    values = np.array(given.split(",") if isinstance(given, str) else given, dtype=object).ravel()
    parsed = [None if isinstance(value, bool) else number(value) for value in values]
    found = tuple(n for n in parsed if n is not None)
    if len(found) < len(parsed) or (0 in found and not zero):
        what = "numbers" if zero else "numbers other than 0"
        raise InputError(f"--{option}: want {what} such as {example}, got {described(given)}.")
    return found


def _nanometres(value: float) -> float:
    found = nanometres(value)
    if found is None or not SPECTRAL_RANGE[0] <= found <= SPECTRAL_RANGE[1]:
        low, high = SPECTRAL_RANGE
        raise InputError(f"--wavelengths: allowed is {low:g} to {high:g} nm (0.1-{high / 1000:g} um), got {value:g}.")
    return found
