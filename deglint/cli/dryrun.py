"""Reports of `--dry-run`: the files that a command would write, and their size."""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import numpy as np

from ..errors import DeglintError
from ..pipeline import Recipe, fit_scene, load_model
from ..pipeline.overview import raster_of
from ..pipeline.run import check_outputs
from ..raster.environment import environment
from ..raster.output import plain
from ..readers import open_scene
from ..scene import Scene
from .options import opening
from .remove import outputs_of, recipe_of


def size(count: float) -> str:
    """Size in bytes as text, such as "12.3 MB"."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def read_bytes(scene: Scene) -> int:
    """Size of the pixels of a scene in its data type, before compression [byte]."""
    return scene.height * scene.width * len(scene.bands) * raster_of(scene).info.dtype.itemsize


def as_options(recipe: Recipe) -> str:
    """The options of the command that select a recipe explicitly."""
    usual, words = asdict(Recipe()), []
    for name, value in asdict(recipe).items():
        if value != usual[name]:
            option = "--band" if name == "bands" else f"--{name.replace('_', '-')}"
            words += [option, ",".join(map(str, value)) if isinstance(value, tuple) else str(value)]
    return shlex.join(words)


def removal(inputs: Sequence[str], output: str, given: dict[str, Any]) -> None:
    """Report of `deglint remove --dry-run`: the scene is opened and the recipe fitted, but nothing is written."""
    targets, used = outputs_of(output, given), recipe_of(given)
    with environment():
        check_outputs(inputs, used, given["sensor"], targets)
        scene = open_scene(list(inputs), **opening(given), grid=given["grid"])
        begun = time.perf_counter()
        if given["model_in"]:
            model = load_model(given["model_in"])
        else:
            fitted = fit_scene(scene, used, threads=given["threads"])
            model, used = fitted.model, fitted.recipe
    took, pixels, bands = time.perf_counter() - begun, scene.height * scene.width, len(model.fits)
    data = read_bytes(scene)
    image = data if given["dtype"] is None else pixels * len(scene.bands) * np.dtype(given["dtype"]).itemsize
    per_file: dict[Path | None, int] = {targets.image: image, targets.flags: 2 * pixels,
                targets.amount: 4 * pixels * bands, targets.stderr: 4 * pixels * bands}  # fmt: skip
    # bytes of the pixels of each file; None where it holds none
    files = {str(path): per_file.get(path) for path in targets.every()}
    nir = [scene.names[b] for b in model.index_bands]
    about = {"input": list(inputs), "nir": nir, "read_bytes": data, "fit_seconds": took, "recipe": asdict(used)}
    lines = [f"{scene.path}: {scene.height} x {scene.width} pixels, bands {', '.join(scene.names)}",
             f"reference bands: {', '.join(nir) or 'none'}", f"options: {as_options(used)}",
             f"fit in {took:.2f} s; the correction reads {size(data)} of pixels once"]  # fmt: skip
    if given["as_json"]:
        click.echo(json.dumps(plain({**about, "files": files}), indent=2))
        return
    lines += [f"would write {name}" + (f" ({size(count)})" if count else "") for name, count in files.items()]
    lines += [f"{len(files)} files, {size(sum(n or 0 for n in files.values()))} of pixels before compression"]
    click.echo("\n".join(lines))


def batch_size(paths: Iterable[Sequence[str]], options: Mapping[str, Any]) -> str:
    """Line with the total size of the scenes of a batch, from their headers."""
    total = unread = 0
    with environment():
        for names in paths:
            try:
                total += read_bytes(open_scene(list(names), **options))
            except DeglintError:
                unread += 1
    left = f"; {unread} scenes cannot be opened" if unread else ""
    return f"would read and write {size(total)} of pixels before compression{left}"
