"""The scenes of a batch: options that apply to all of them, names of outputs, and the state of earlier outputs.

A recipe file holds the options. An output of an earlier run is reused if its sidecar records the same recipe and the
same checksums of input and outputs.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from ..checks import check_choice, check_kind, described
from ..checksum import are_as, fingerprints, is_as
from ..errors import DeglintError, InputError
from ..pipeline import Outputs
from ..pipeline.outputs import DTYPES
from ..pipeline.recipe import Recipe, band_names
from ..pipeline.run import READING
from ..raster.environment import environment
from ..raster.targets import check_unread
from ..readers.scenes import ListedScene, checked_name
from ..readers.stac import files_of
from ..readers.text import read_json, read_toml

EXTRAS = {"flags": ".tif", "amount": ".tif", "picture": ".png", "sample": ".geojson", "model": ".json"}
"""Optional outputs beside the image, and the endings of their file names."""
OF_OUTPUT = ("directory", "name", "extras", "dtype", "options")
OF_INPUT = (*READING, "assets")
TODO, DONE, FINISHED, NO_WATER, FAILED = "to do", "done", "finished before", "no water", "failed"


@dataclass(frozen=True)
class Order:
    """Options that apply to every scene of a batch: the tables [recipe], [output] and [input] of a recipe file."""

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
    reads: tuple[str, ...] = ()  # further input files, such as the recipe, which no output may replace

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
        if not isinstance(self.options, Mapping) or not all(isinstance(v, (str, int)) for v in self.options.values()):
            raise InputError(f"options: want NAME = VALUE pairs, got {described(self.options)}.")
        words = {k: ("YES" if v else "NO") if isinstance(v, bool) else str(v) for k, v in self.options.items()}
        object.__setattr__(self, "options", words)
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
        """The options of [input] as keywords of `deglint.open_scene`."""
        given = {name: getattr(self, name) for name in READING} | {"bands": ",".join(self.bands) or None}
        return {name: None if value == () else value for name, value in given.items()}

    def request(self) -> str:
        """Checksum of everything that the result depends on except the scene; equal orders give equal checksums."""
        named = {k: getattr(self.recipe, k) for k in ("sample", "mask")}
        if self.sensor and self.sensor.lower().endswith(".toml"):
            named["sensor"] = self.sensor
        read = {k: fingerprints([v]) for k, v in named.items() if v not in ("auto", "all", "none")}
        files = {k: {path: found["crc32"] for path, found in files.items()} for k, files in read.items()}
        said = asdict(self) | {"directory": "", "files": files, "nodata": repr(self.nodata)}
        del said["reads"]
        return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def read_order(path: str, directory: str | None = None) -> Order:
    """Read a recipe file; `directory`, if given, replaces its output directory.

    It is TOML with the tables [recipe] (fields of `Recipe`), [input] (`OF_INPUT`) and [output] (`OF_OUTPUT`); every one
    may be left out.

    Raises ReadError: no such file; InputError: not TOML, or a name or value that is not allowed, such as an output
    directory above the current one.
    """
    document = read_toml(path, "recipe")
    allowed = {"recipe": [f.name for f in fields(Recipe)], "input": OF_INPUT, "output": OF_OUTPUT}
    for table, values in document.items():
        if table not in allowed or not isinstance(values, dict):
            raise InputError(f"{path}: {table!r} is not one of the tables [recipe], [input], [output].")
        if unknown := [name for name in values if name not in allowed[table]]:
            raise InputError(f"{path}: [{table}] {unknown[0]} is not one of {', '.join(sorted(allowed[table]))}.")
    recipe, output, opening = (document.get(table, {}) for table in ("recipe", "output", "input"))
    try:
        order = Order(Recipe(**recipe), **output, **opening)
        if directory is not None:
            return replace(order, directory=directory)  # type: ignore[arg-type]
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


@dataclass(frozen=True)
class Job:
    """One scene of a batch, and its outputs."""

    scene: ListedScene
    outputs: Outputs

    def ended(self, status: str, reason: str = "", *, begun: float, **more: Any) -> Outcome:
        """The row of the summary for this scene, processed since `begun`."""
        seconds = round(time.perf_counter() - begun, 3)
        inputs = ";".join(self.scene.paths)
        return Outcome(self.scene.name, inputs, str(self.outputs.image), status, reason, seconds, **more)


@dataclass(frozen=True)
class Outcome:
    """Result of one scene: a row of the summary."""

    name: str
    inputs: str
    output: str
    status: str  # "done", "finished before", "to do", "no water" or "failed"
    reason: str = ""  # why, where it failed, has no water, or is to be done again
    seconds: float = 0.0
    method: str = ""
    corrected: float | None = None  # share of the pixels
    warnings: int = 0  # how many the sidecar holds


SUMMARY_COLUMNS = [f.name for f in fields(Outcome)]


def jobs_of(order: Order, scenes: Sequence[ListedScene]) -> list[Job]:
    """One job for each scene.

    Raises InputError: two scenes would be written to one file, or an output would replace an input file.
    """
    jobs = []
    made: Any = {"dtype": order.dtype, "options": order.options, "request": order.request()}
    for scene in scenes:
        image = order.directory / order.name.replace("{name}", scene.name)
        stem = image.with_suffix("").name
        extras: Any = {name: image.with_name(f"{stem}_{name}{EXTRAS[name]}") for name in order.extras}
        jobs.append(Job(scene, Outputs(image, **made, **extras)))
    names = Counter(path.name for job in jobs for path in job.outputs.every())
    for job in jobs:
        if twice := next((path for path in job.outputs.every() if names[path.name] > 1), None):
            them = ", ".join(j.scene.paths[0] for j in jobs if twice in j.outputs.every())
            raise InputError(
                f"several scenes would be written to {twice}: {them[:300]}. Give them names of their own, in a CSV "
                "with columns path and name."
            )
    # what is not there yet can be no file that is read
    try:
        there = [path for job in jobs for path in job.outputs.every() if path.exists()]
    except OSError as error:  # of a name that no file may have
        name = str(error.filename)[:80]
        raise InputError(f"an output cannot be named {name} ...: {error.strerror}. Choose another name.") from error
    if there:
        scenes_files = [p for job in jobs for name in job.scene.source for p in (name, *files_of(name))]
        named = [order.recipe.sample, order.recipe.mask, order.sensor or "", *order.reads]
        with environment():
            check_unread(there, {"a scene": scenes_files, "an input": named})
    return jobs


def state_of(job: Job) -> tuple[str, str]:
    """Whether a scene is finished, to do, or cannot be processed because of existing files ("failed"), and why."""
    image, sidecar, every = job.outputs.image, job.outputs.sidecar, job.outputs.every()
    there = [p for p in every if p.exists()]
    if not there:
        return TODO, ""
    if sidecar not in there:
        return FAILED, f"{there[0]} exists and was not made by this batch"
    try:
        said = read_json(str(sidecar), "sidecar")
        batch = said.get("batch") or {}
        inputs = {i["path"]: i for i in batch.get("inputs") or []}
        outputs = dict(batch.get("outputs") or {})
    except (DeglintError, KeyError, TypeError, ValueError, AttributeError):
        return FAILED, f"{sidecar} exists and is no sidecar of deglint"
    if batch.get("request") != job.outputs.request:
        return FAILED, f"{image} was made by another recipe"
    with environment():
        if not are_as([p for name in job.scene.source for p in files_of(name)], inputs):
            return FAILED, f"{image} was made of another state of the scene"
    if len(there) < len(every):
        return TODO, "was stopped while it was moved into place"
    changed = [p for p in every if p != sidecar and not is_as(p, outputs.get(p.name, {"bytes": -1}))]
    if changed:
        return FAILED, f"{changed[0]} is not as it was made"
    return FINISHED, ""
