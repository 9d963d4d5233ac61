"""The command `deglint batch`: remove sun glint from many scenes with one recipe."""

from __future__ import annotations

import csv
import io
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .options import COUNT, FILE, SETTINGS, Grouped, heading, messages
from .remove import read_bytes, size
from .running import Console

if TYPE_CHECKING:
    from ..batch import Outcome

log = logging.getLogger(__name__)
OVERWRITE = (
    "Replace outputs that come from another recipe or input, or were changed. Finished scenes are never repeated."
)


@click.command(cls=Grouped, context_settings=SETTINGS)
@click.argument("recipe", type=FILE, metavar="RECIPE.toml")
@click.argument("scenes", nargs=-1, required=True, type=FILE, metavar="SCENES...")
@heading("Output")
@click.option("--overwrite", is_flag=True, help=OVERWRITE)
@click.option("--directory", type=FILE, metavar="DIR", help="Where outputs go, in place of the recipe's directory.")
@click.option("--dry-run", is_flag=True, help="Print what would be done, and do nothing.")
@click.option("--table", type=FILE, metavar="FILE.csv", help="Also write the summary as CSV; replaces an older file.")
@heading("Processing")
@click.option("--jobs", type=COUNT, default=1, metavar="N", help="Scenes at a time, each in a process of its own.")
@click.option("--threads", type=COUNT, metavar="N", show_default="all processors, shared out", help="Threads per job.")
@heading("Messages")
@click.option("--json", "as_json", is_flag=True, help="Print the summary on stdout as JSON.")
@messages
def batch(recipe: str, scenes: tuple[str, ...], **given: Any) -> None:
    """Remove sun glint from many SCENES as RECIPE.toml says.

    SCENES are rasters or products, patterns in quotes, a CSV with a column `path` (and `name`), or a STAC
    ItemCollection. Finished scenes are recognised by recipe and checksums, so a batch that was interrupted can be
    continued. A scene that fails does not stop the others; the exit code is then 1.

    \b
    deglint batch recipe.toml 'tiles/*.tif' --jobs 4
    deglint batch recipe.toml archive.csv --table done.csv

    \b
    # recipe.toml; every line is optional
    [recipe]                      # as the options of deglint remove
    method = "auto"
    [input]                       # sensor, bands, wavelengths, scale, offset, nodata, grid, assets
    sensor = "sentinel2"
    [output]
    directory = "clean"
    name = "{name}_deglinted.tif"
    extras = ["flags"]            # flags, amount, stderr, sample, model, picture
    dtype = "uint16"
    options = {COMPRESS = "ZSTD"}
    """
    from ..batch import FAILED, TODO, jobs_of, read_config, run_batch
    from ..raster.output import as_json, write_text
    from ..raster.targets import Scratch, check_targets
    from ..readers.scenes import list_scenes

    config = replace(read_config(recipe, given["directory"]), reads=(recipe, *scenes))
    listed = list_scenes(scenes, config.assets)
    table = Path(given["table"]) if given["table"] else None
    if table:
        reads = [*config.reads, *(p for scene in listed for p in scene.paths), config.recipe.sample, config.recipe.mask]
        older = table.is_file() and table.read_bytes().startswith(b"name,inputs,output,status,reason,seconds,")
        outputs = [path for job in jobs_of(config, listed) for path in job.outputs.every()]
        check_targets([table], {"an input": reads, "an output": outputs}, overwrite=older or given["overwrite"])
    with Console(given) as console:
        same = {name: given[name] for name in ("threads", "overwrite", "dry_run")}
        found = run_batch(config, listed, processes=given["jobs"], done=_watch(len(listed), console), **same)
    if table and not given["dry_run"]:
        text = io.StringIO()
        rows = csv.DictWriter(text, list(asdict(found[0])), lineterminator="\n")
        rows.writeheader()
        rows.writerows(asdict(outcome) for outcome in found)
        with Scratch(overwrite=True) as scratch:
            write_text(scratch, table, text.getvalue())
    if given["as_json"]:
        click.echo(as_json([asdict(o) for o in found]))
    else:
        click.echo("\n".join(summary(found)))
        if given["dry_run"]:
            todo = [scene.paths for scene, o in zip(listed, found, strict=True) if o.status == TODO]
            click.echo(total_size(todo, config.opening))
    if any(o.status == FAILED for o in found):
        raise click.exceptions.Exit(1)


def summary(found: list[Outcome]) -> list[str]:
    """Summarise the outcomes `found` in lines of text: a table of the scenes, and the number of scenes by status."""
    rows = [("scene", "status", "seconds", "corrected", "method", "reason")]
    for o in found:
        share = "" if o.corrected is None else f"{o.corrected:.1%}"
        why = o.reason or (f"{o.warnings} warning{'s' * (o.warnings > 1)}, see the sidecar" if o.warnings else "")
        rows.append((o.name, o.status, f"{o.seconds:.1f}", share, o.method, why))
    widths = [max(len(row[i]) for row in rows) for i in range(5)]
    out = ["  ".join([*(c.ljust(w) for c, w in zip(row[:5], widths, strict=True)), row[5]]).rstrip() for row in rows]
    counts = Counter(o.status for o in found)
    scenes = f"{len(found)} scene{'s' * (len(found) != 1)}"
    return [*out, "", f"{scenes}: " + ", ".join(f"{n} {status}" for status, n in counts.items())]


def total_size(paths: Iterable[Sequence[str]], options: Mapping[str, Any]) -> str:
    """Text for a dry run: size of the pixels of all scenes before compression, according to the headers of the files.
    `paths` has the file names of each scene; `options` are keyword arguments of `open_scene`.
    """
    from ..errors import DeglintError
    from ..raster.environment import environment
    from ..readers import open_scene

    total = unread = 0
    with environment():
        for names in paths:
            try:
                total += read_bytes(open_scene(list(names), **options))
            except DeglintError:
                unread += 1
    left = f"; {unread} scenes cannot be opened" if unread else ""
    return f"would read and write {size(total)} of pixels before compression{left}"


def _watch(total: int, console: Console) -> Callable[[Outcome], None]:
    """Make a function to call after each of `total` scenes: it logs a line, and shows progress on a terminal."""
    numbers = count(1)

    def done(scene: Outcome) -> None:
        why = f": {scene.reason}" if scene.reason else ""
        took = f" in {scene.seconds:.1f} s" if scene.status == "done" else ""
        number = next(numbers)
        log.info("[%d/%d] %s %s%s%s", number, total, scene.name, scene.status, took, why)
        console.progress("scenes", number, total)

    return done
