"""What a batch does with every scene: a recipe file, read and checked."""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, get_type_hints

from ..checksum import fingerprints
from ..errors import InputError
from ..pipeline.outputs import DTYPES
from ..pipeline.recipe import Recipe
from ..readers.scenes import checked_name
from ..readers.text import read_text

MOST_RECIPE_BYTES = 1 << 20
"""Largest recipe file that is read [byte]."""
EXTRAS = {"flags": ".tif", "amount": ".tif", "picture": ".png", "sample": ".geojson", "model": ".json"}
"""Outputs beside the image that a recipe may ask for, and how their names end."""


@dataclass(frozen=True)
class Order:
    """What a batch does with every scene: the tables [recipe], [input] and [output] of a recipe file.

    Attributes
    ----------
    recipe : Recipe
    directory : Path
        Where outputs go; made where it is missing.
    name : str
        What the image of a scene is called; "{name}" stands for the scene's name.
    extras : tuple of str
        Keys of `EXTRAS` that are written too, as "{name}_flags.tif" and so on.
    dtype : str, optional
    options : mapping
        GDAL creation options.
    sensor, nodata, grid, bands, wavelengths, scale, offset
        As `deglint.open_scene`.
    assets : tuple of str
        Assets of a STAC Item that are the bands.
    """

    recipe: Recipe = field(default_factory=Recipe)
    directory: Path = Path()
    name: str = "{name}_deglinted.tif"
    extras: tuple[str, ...] = ()
    dtype: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    sensor: str | None = None
    nodata: float | str | None = None
    grid: str | None = None
    bands: tuple[str, ...] = ()
    wavelengths: tuple[float, ...] = ()
    scale: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()
    assets: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if "{name}" not in self.name or Path(self.name).suffix.lower() not in (".tif", ".tiff"):
            raise InputError(f"[output] name {self.name!r} must hold {{name}} and end in .tif, as {{name}}_clean.tif.")
        checked_name(self.name.replace("{name}", "x"), "[output] name")
        unknown = [e for e in self.extras if e not in EXTRAS]
        if unknown:
            raise InputError(f"[output] extras: {', '.join(unknown)} is not one of {', '.join(EXTRAS)}.")
        if self.dtype is not None and self.dtype not in DTYPES:
            raise InputError(f"[output] dtype {self.dtype!r} is not one of {', '.join(DTYPES)}.")

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
    """Read a recipe file.

    Parameters
    ----------
    path : str
        TOML with the tables ``[recipe]`` (fields of `Recipe`), ``[input]`` (sensor, nodata, grid, bands,
        wavelengths, scale, offset, assets) and
        ``[output]`` (directory, name, extras, dtype, options); every one may be left out.
    directory : str, optional
        Where outputs go, in place of the recipe's.

    Raises
    ------
    ReadError
        No such file.
    InputError
        Not TOML, or a name or value that is not allowed, such as a directory above the one that the batch runs in.
    """
    text = read_text(path, "recipe", MOST_RECIPE_BYTES)
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers of thousands of digits are no TOMLDecodeError
        raise InputError(f"{path} is not TOML: {str(error) or 'it is nested too deep'}.") from error
    allowed = {
        "recipe": {f.name for f in fields(Recipe)},
        "input": {"sensor", "nodata", "grid", "bands", "wavelengths", "scale", "offset", "assets"},
        "output": {"directory", "name", "extras", "dtype", "options"},
    }
    given: dict[str, Any] = {}
    for table, values in document.items():
        if table not in allowed or not isinstance(values, dict):
            raise InputError(f"{path}: {table!r} is not one of the tables [recipe], [input], [output].")
        for name in values:
            if name not in allowed[table]:
                raise InputError(f"{path}: [{table}] {name} is not one of {', '.join(sorted(allowed[table]))}.")
        types = get_type_hints(Recipe if table == "recipe" else Order)
        read = {name: _value(f"{path}: [{table}] {name}", types[name], value) for name, value in values.items()}
        if table == "recipe":
            given["recipe"] = _named(path, Recipe, read)
        else:
            given |= read
    if directory is not None:
        given["directory"] = Path(directory)
    elif Path(os.path.normpath(given.get("directory", "."))).parts[:1] == (os.pardir,):
        raise InputError(
            f"{path}: [output] directory {str(given['directory'])[:200]!r} leads out of the directory that the batch "
            "runs in. If that is wanted, say it on the command line: --directory DIR."
        )
    order: Order = _named(path, Order, given)
    return order


def _named(path: str, kind: Any, given: Mapping[str, Any]) -> Any:
    try:
        return kind(**given)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _value(what: str, kind: Any, value: Any) -> Any:
    """A value of a recipe file as its field has it."""
    text = str(kind)
    if "tuple[float" in text:
        values = value if isinstance(value, list) else [value]
        if values and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values):
            return tuple(map(float, values))
        raise InputError(f"{what}: want a number or a list of numbers, got {str(value)[:80]!r}.")
    if "tuple" in text:
        values = [value] if isinstance(value, (str, int)) and not isinstance(value, bool) else value
        if isinstance(values, list) and all(isinstance(v, (str, int)) and not isinstance(v, bool) for v in values):
            return tuple(map(str, values))
        raise InputError(f"{what}: want a list of names, got {str(value)[:80]!r}.")
    if "Mapping" in text:
        if isinstance(value, dict) and all(isinstance(v, (str, int)) for v in value.values()):
            return {k: ("YES" if v else "NO") if isinstance(v, bool) else str(v) for k, v in value.items()}
        raise InputError(f"{what}: want NAME = VALUE pairs, got {str(value)[:80]!r}.")
    if "float" in text:
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return float(value)
        raise InputError(f"{what}: want a number, got {str(value)[:80]!r}.")
    if not isinstance(value, str):
        raise InputError(f"{what}: want a text, got {str(value)[:80]!r}.")
    return Path(value) if "Path" in text else value
