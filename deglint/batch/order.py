"""What a batch does with every scene: a recipe file, read and checked."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from ..checks import check_choice, check_kind, described
from ..checksum import fingerprints
from ..errors import InputError
from ..pipeline.outputs import DTYPES
from ..pipeline.recipe import Recipe, band_names
from ..readers.scenes import checked_name
from ..readers.text import read_toml

EXTRAS = {"flags": ".tif", "amount": ".tif", "picture": ".png", "sample": ".geojson", "model": ".json"}
"""Outputs beside the image that a recipe may ask for, and how their names end."""
OF_OUTPUT = ("directory", "name", "extras", "dtype", "options")
OF_INPUT = ("sensor", "nodata", "grid", "bands", "wavelengths", "scale", "offset", "assets")


@dataclass(frozen=True)
class Order:
    """What a batch does with every scene: the tables [recipe], [output] and [input] of a recipe file."""

    recipe: Recipe = field(default_factory=Recipe)
    directory: Path = Path()  # of the outputs; made where it is missing
    name: str = "{name}_deglinted.tif"  # of the image of a scene; "{name}" stands for the scene's name
    extras: tuple[str, ...] = ()  # keys of `EXTRAS` that are written too, as "{name}_flags.tif" and so on
    dtype: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)  # GDAL creation options
    sensor: str | None = None  # this and what follows: as `deglint.open_scene`
    nodata: float | str | None = None
    grid: str | None = None
    bands: tuple[str, ...] = ()
    wavelengths: tuple[float, ...] = ()
    scale: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()
    assets: tuple[str, ...] = ()  # of a STAC Item that are the bands

    def __post_init__(self) -> None:
        for name in ("name", "dtype", "sensor", "grid"):
            if (text := getattr(self, name)) is not None:
                check_kind(text, str, name, "Write it in quotes.")
        for name in ("extras", "bands", "assets"):
            object.__setattr__(self, name, band_names(getattr(self, name), name))
        for name in ("wavelengths", "scale", "offset"):
            object.__setattr__(self, name, _numbers(name, getattr(self, name)))
        if self.nodata is not None:
            object.__setattr__(self, "nodata", *_numbers("nodata", self.nodata))
        object.__setattr__(self, "options", _options(self.options))
        if not isinstance(self.directory, (str, os.PathLike)):
            raise InputError(f"directory: want a text, got {described(self.directory)}.")
        object.__setattr__(self, "directory", Path(self.directory))
        if "{name}" not in self.name or Path(self.name).suffix.lower() not in (".tif", ".tiff"):
            raise InputError(f"[output] name {self.name!r} must hold {{name}} and end in .tif, as {{name}}_clean.tif.")
        checked_name(self.name.replace("{name}", "x"), "[output] name")
        for extra in self.extras:
            check_choice(extra, list(EXTRAS), "[output] extras:")
        if self.dtype is not None:
            check_choice(self.dtype, list(DTYPES), "[output] dtype")

    def opening(self) -> dict[str, Any]:
        """What the order says of the input, as `deglint.open_scene` takes it."""
        stated = {"wavelengths": self.wavelengths, "scale": self.scale, "offset": self.offset}
        given = {name: value or None for name, value in (stated | {"bands": ",".join(self.bands)}).items()}
        return given | {"sensor": self.sensor, "nodata": self.nodata, "grid": self.grid}

    def request(self) -> str:
        """A checksum of all that the result depends on but the scene: the same order, the same text."""
        named = {k: getattr(self.recipe, k) for k in ("sample", "mask")}
        if self.sensor and self.sensor.lower().endswith(".toml"):
            named["sensor"] = self.sensor
        read = {k: fingerprints([v]) for k, v in named.items() if v not in ("auto", "all", "none")}
        files = {k: {path: found["crc32"] for path, found in files.items()} for k, files in read.items()}
        said = asdict(self) | {"directory": "", "files": files, "nodata": repr(self.nodata)}
        return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def read_order(path: str, directory: str | None = None) -> Order:
    """Read a recipe file, whose outputs go into `directory` where that is given.

    It is TOML with the tables [recipe] (fields of `Recipe`), [input] (`OF_INPUT`) and [output] (`OF_OUTPUT`); every one
    may be left out.

    Raises ReadError: no such file; InputError: not TOML, or a name or value that is not allowed, such as a directory
    above the one that the batch runs in.
    """
    document = read_toml(path, "recipe")
    allowed = {"recipe": [f.name for f in fields(Recipe)], "input": OF_INPUT, "output": OF_OUTPUT}
    for table, values in document.items():
        if table not in allowed or not isinstance(values, dict):
            raise InputError(f"{path}: {table!r} is not one of the tables [recipe], [input], [output].")
        for name in values:
            if name not in allowed[table]:
                raise InputError(f"{path}: [{table}] {name} is not one of {', '.join(sorted(allowed[table]))}.")
    output = document.get("output", {})
    try:
        order = Order(Recipe(**document.get("recipe", {})), **output, **document.get("input", {}))
        if directory is not None:
            return Order(**(vars(order) | {"directory": directory}))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if Path(os.path.normpath(order.directory)).parts[:1] == (os.pardir,):
        raise InputError(
            f"{path}: [output] directory {str(order.directory)[:200]!r} leads out of the directory that the batch "
            "runs in. If that is wanted, say it on the command line: --directory DIR."
        )
    return order


def _numbers(name: str, value: Any) -> tuple[float, ...]:
    values = value if isinstance(value, (list, tuple)) else [value]
    if not all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values):
        raise InputError(f"{name}: want a number or a list of numbers, got {described(value)}.")
    return tuple(map(float, values))


def _options(value: Any) -> dict[str, str]:
    if not isinstance(value, Mapping) or not all(isinstance(v, (str, int)) for v in value.values()):
        raise InputError(f"options: want NAME = VALUE pairs, got {described(value)}.")
    return {k: ("YES" if v else "NO") if isinstance(v, bool) else str(v) for k, v in value.items()}
