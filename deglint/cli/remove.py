"""The command `deglint remove`: remove sun glint from a raster."""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from . import options
from .options import FILE, ChoiceFromTable, heading, opening
from .running import Console

if TYPE_CHECKING:
    from ..pipeline import Outputs, Recipe
    from ..pipeline.outputs import Saved
    from ..scene import Scene

METHOD = ChoiceFromTable("METHODS", "deglint.remove", "auto")
REGRESSION = ChoiceFromTable("REGRESSIONS", "deglint.remove", "auto")
NIR_USE = ChoiceFromTable("NIR_USES", "deglint.remove", "auto")
DTYPE = ChoiceFromTable("DTYPES", "deglint.raster.output")
PERCENT = click.FloatRange(0, 100)
PERCENT.name = "number from 0 to 100, such as 5"  # in the message: "5%" is not a valid ...
KEPT_WIDTH = "4m, or 16px where the size of a pixel is not known"
HELP = {
    "--method": "How to remove glint (see Methods); auto: the candidate with the least expected error on sample tiles.",
    "--sample": "Water to fit to; auto: all open water for wiener, else deep, glinted water. WINDOW is "
    "column,row,width,height in pixels.",
    "--compensate": "Stages around the removal, for glint that the NIR does not predict; auto: those of the best "
    "candidate, none with a named --method. thesis: the chain of Fink's thesis. Or stages such as 'psf:2, "
    "identify-level:13, replace-level, remove'.",
    "--smallest-object": "Width of the smallest target that compensation must keep, such as 4m or 16px.",
    "--mask": "What to correct: water found in the scene, everything, or a raster (not 0) or GeoJSON.",
    "--band": "Bands to correct, by name or number (from 1). The others are copied.",
    "--regression": "How slopes are fitted; auto: detrended for an automatic sample, else ols.",
    "--floor-percentile": "NIR percentile of the glint-free level; 0: the method's own (minimum; multiband: 5 %).",
    "--nir-use": "With several NIR bands: their mean, the best for each band, or that of its set (same time).",
    "--rrs-factor": "Ratio of the values to remote-sensing reflectance; pi for reflectance.",
    "--grid": "Input file whose grid is used.",
    "--flags": "Write a raster of flags: 1 nodata, 2 not water, 4 corrected, 8 negative after, 16 saturated before, 32 "
    "clipped, 64 replaced, 128 protected. Second band: class of sun glint (CEOS-ARD), 1 negligible, 2 correctable, 3 "
    "uncorrectable.",
    "--amount": "Write the amount of sun glint that was removed (float32, physical units), with the modelled sky glint "
    "in its tags and in the sidecar.",
    "--stderr": "Write the standard error of every pixel of the bands that may change (float32, physical units).",
    "--dtype": "Type of the output. Values of integer types are rounded, and clipped to the range of the type.",
}
"""Help texts that do not fit in the line of their option."""


@click.command(cls=options.Grouped, context_settings=options.SETTINGS)
@click.argument("inputs", nargs=-1, type=FILE, metavar="IN [IN ...]")
@click.argument("output", type=FILE, metavar="OUT")
@heading("What to do")
@click.option("--method", type=METHOD, default="auto", help=HELP["--method"])
@options.place("--sample", "auto|all|FILE.geojson|WINDOW", HELP["--sample"])
@options.place("--compensate", "auto|thesis|off|STAGES", HELP["--compensate"])
@click.option("--smallest-object", default="", metavar="WIDTH", show_default=KEPT_WIDTH, help=HELP["--smallest-object"])
@options.place("--mask", "auto|none|FILE|WINDOW", HELP["--mask"])
@options.bands_to("-b", "--band", "bands", shown="all of shorter wavelength than the NIR", said=HELP["--band"])
@click.option("--model", "model_in", type=FILE, help="Apply this saved model instead of fitting one.")
@heading("Details of the fit")
@click.option("--regression", type=REGRESSION, default="auto", help=HELP["--regression"])
@click.option("--floor-percentile", type=PERCENT, default=0.0, metavar="PERCENT", help=HELP["--floor-percentile"])
@click.option("--nir-use", type=NIR_USE, default="auto", help=HELP["--nir-use"])
@click.option("--rrs-factor", default=math.pi, metavar="FACTOR", show_default="pi", help=HELP["--rrs-factor"])
@heading("Input")
@click.option("--grid", type=FILE, metavar="FILE|N", show_default="the finest", help=HELP["--grid"])
@options.reading
@heading("Output")
@click.option("--save-model", type=FILE, help="Write the fitted model, to apply to another scene.")
@click.option("--save-sample", type=FILE, metavar="FILE.geojson", help="Write the outline of the sample.")
@click.option("--flags", type=FILE, help=HELP["--flags"])
@click.option("--amount", type=FILE, help=HELP["--amount"])
@click.option("--stderr", type=FILE, help=HELP["--stderr"])
@click.option("--picture", type=FILE, metavar="FILE.png", help="Write a before/after picture.")
@click.option("--dtype", type=DTYPE, show_default="that of the input", help=HELP["--dtype"])
@options.creation
@click.option("--overwrite", is_flag=True, help="Replace outputs that exist.")
@click.option("--dry-run", is_flag=True, help="Fit, print what would be done and written, and write nothing.")
@options.processing
@options.print_sidecar
@options.messages
def remove(inputs: tuple[str, ...], output: str, **given: Any) -> None:
    """Remove sun glint from IN and write OUT, a GeoTIFF with the input's data type, tags and georeference.

    IN is any raster that GDAL reads, or a product: its folder, archive or metadata file. Several files are stacked.
    OUT.json, beside OUT, records what was done.

    \b
    deglint remove scene.tif clean.tif
    deglint remove scene.tif clean.tif --method hedley --sample deep.geojson
    deglint remove B02.tif B03.tif B04.tif B08.tif clean.tif --picture look.png
    deglint remove scene.tif clean.tif --flags flags.tif --dry-run
    """
    options.needs_output(inputs, output, "deglint remove")
    from ..pipeline import Outputs, Recipe, remove_glint
    from ..pipeline.outputs import load_fit
    from ..raster.output import as_json

    saved = given["model_in"]
    if saved and (unused := unused_by_model(given)):
        raise click.UsageError(f"--model applies a saved fit: leave out {unused}.")
    same = {name: given[name] for name in ("flags", "amount", "stderr", "picture", "dtype", "options", "overwrite")}
    made = {"sample": given["save_sample"], "model": given["save_model"], "reads": [saved] if saved else []}
    with Console(given) as console, options.cluster_of(given) as cluster:
        targets = Outputs(Path(output), **made, **same)
        recipe = Recipe(**{f.name: given[f.name] for f in fields(Recipe) if given[f.name] is not None})
        model, chain = load_fit(saved) if saved else (None, None)
        if given["dry_run"]:
            dry_run(inputs, targets, recipe, (model, chain), given, console)
            return
        work: dict[str, Any] = {"model": model, "chain": chain, "cluster": cluster, "progress": console.progress}
        reading = opening(given) | {"grid": given["grid"]}
        result = remove_glint(list(inputs), targets, recipe, threads=given["threads"], **reading, **work)
    if given["as_json"]:
        click.echo(as_json(result.sidecar))


def unused_by_model(given: Mapping[str, object]) -> str:
    """Text of those options of a recipe in `given` that a saved model does not use, and that differ from their default.

    A model uses `mask`, `nir` and `bands`, and `compensate` if it is "off". The value None means: not given.
    """
    from ..pipeline import Recipe

    other = [f for f in fields(Recipe) if f.name not in ("mask", "nir", "bands") and given[f.name] is not None]
    names = [f.name for f in other if given[f.name] not in (f.default, *["off"] * (f.name == "compensate"))]
    return ", ".join(f"--{name.replace('_', '-')}" for name in names)


def dry_run(
    inputs: Sequence[str], targets: Outputs, recipe: Recipe, saved: Saved, given: dict[str, Any], console: Console
) -> None:
    """Open the scene; fit the recipe, or use `saved` (model, compensation chain); print what a run would do and write.

    File sizes are those before compression. An option that the run would refuse raises the same error as in the run.
    """
    import numpy as np

    from ..pipeline.run import Run, check_outputs, prepare
    from ..raster.environment import environment
    from ..raster.output import as_json
    from ..readers import open_scene
    from ..readers.undeclared import settled
    from ..tiles import default_threads

    with environment():
        check_outputs(inputs, recipe, given["sensor"], targets)
        scene = settled(open_scene(list(inputs), **opening(given), grid=given["grid"]))
        run = Run(default_threads(given["threads"]), console.progress)
        fitted, work = prepare(scene, recipe, targets, run, *saved)
    used = recipe if given["model_in"] else fitted.recipe
    took, pixels = time.perf_counter() - run.begun, scene.height * scene.width
    data, image = read_bytes(scene), pixels * len(scene.bands) * np.dtype(work.layout.dtype).itemsize
    per_file: dict[Path | None, int] = {targets.image: image, targets.flags: 2 * pixels}
    per_file |= dict.fromkeys((targets.amount, targets.stderr), 4 * pixels * len(work.amount_bands))  # float32
    # size of the pixels in each file [byte]; None for a file without pixels
    files = {str(path): per_file.get(path) for path in targets.every()}
    nir = [scene.names[b] for b in fitted.model.index_bands]
    about = {"input": list(inputs), "nir": nir, "read_bytes": data, "fit_seconds": took, "recipe": asdict(used)}
    if given["as_json"]:
        click.echo(as_json({**about, "files": files}))
        return
    lines = [
        f"{scene.path}: {scene.height} x {scene.width} pixels, bands {', '.join(scene.names)}",
        f"reference bands: {', '.join(nir) or 'none'}",
        f"options: {as_options(used)}",
        f"fit in {took:.2f} s; the correction reads {size(data)} of pixels once",
    ]
    lines += [f"would write {name}" + (f" ({size(count)})" if count else "") for name, count in files.items()]
    lines += [f"{len(files)} files, {size(sum(n or 0 for n in files.values()))} of pixels before compression"]
    click.echo("\n".join(lines))


def as_options(recipe: Recipe) -> str:
    """Text of the options of `deglint remove` that describe a recipe; options with default values are left out."""
    usual, words = asdict(type(recipe)()), []
    for name, value in asdict(recipe).items():
        if value != usual[name]:
            option = "--band" if name == "bands" else f"--{name.replace('_', '-')}"
            words += [option, ",".join(map(str, value)) if isinstance(value, tuple) else str(value)]
    return shlex.join(words)


def read_bytes(scene: Scene) -> int:
    """Size of the pixels of a scene in its data type, before compression [byte]."""
    from ..pipeline.overview import raster_of

    return math.prod(scene.shape) * raster_of(scene).info.dtype.itemsize


def size(count: float) -> str:
    """Convert a number of bytes to text, such as "12.3 MB"."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"
