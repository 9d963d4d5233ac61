"""The command `rxdetect roc`: compare score rasters with known targets; print rates, and write a report if asked."""

import json
import logging
import time
from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from deglint.cli import options
from deglint.cli.running import Console

from . import command_line

log = logging.getLogger(__name__)


# fmt: off
@click.command(cls=options.Grouped, context_settings=options.SETTINGS)
@click.argument("scores", nargs=-1, required=True, type=options.FILE, metavar="SCORES [SCORES ...]")
@click.argument("truth", type=options.FILE, metavar="TRUTH")
@options.heading("What to do")
@click.option("--per-object", is_flag=True, help="Count objects found and false alarms (connected parts), too.")
@click.option("--connected", is_flag=True, help="Connected pixels of TRUTH are an object, whatever their numbers.")
@click.option("--mask", type=options.FILE, metavar="FILE|WINDOW",
              help="Judge only here: a raster (not 0), GeoJSON or window of pixels.")
@click.option("--pfa-max", type=click.FloatRange(0, 1, min_open=True), default=0.1, metavar="PFA",
              help="Partial areas and object counts go up to this false-alarm rate.")
@click.option("--bootstrap", "draws", type=click.IntRange(0, 100_000), default=1000, metavar="N",
              help="Bootstrap samples for confidence intervals; 0: none.")
@click.option("--block", type=click.IntRange(1), metavar="PIXELS",
              help="Block size of the bootstrap. [default: 1/24 of the longer side, at least 16]")
@click.option("--seed", type=click.IntRange(0), default=0, metavar="N", help="Seed of the draws.")
@click.option("--lower-is-anomalous", "lower", is_flag=True, help="Low scores are anomalous, not high ones.")
@options.heading("Output")
@click.option("--report", type=options.FILE, metavar="FILE.html",
              help="Write the report, one file; FILE.html.json beside it.")
@click.option("--overwrite", is_flag=True, help="Replace outputs that exist.")
@options.heading("Messages")
@click.option("--json", "as_json", is_flag=True, help="Print every number as JSON on stdout, and nothing else there.")
@click.option("-v", "--verbose", count=True, show_default=False, help="Log more; -vv: also a traceback after an error.")
@click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
def roc(scores: tuple[str, ...], truth: str, **given: Any) -> None:
    """Print how well the SCORES of each detector find the targets in TRUTH: area under the ROC curve, detection rates.

    SCORES are rasters on one grid; higher is more anomalous. TRUTH is polygons in GeoJSON, or a raster on this grid: 0
    for background, else an object's number. With only one number, connected pixels are one object. Nodata is left out.

    \b
    rxdetect roc scores.tif truth.tif
    rxdetect roc global.tif local.tif truth.tif --per-object --report roc.html
    """
    from deglint.checksum import Checksum
    from deglint.raster.environment import environment
    from deglint.raster.output import Scratch, plain, write_json, write_text
    from deglint.raster.targets import check_ending, check_targets

    from ..report import Request, evaluate, page
    from ..report.page import check_installed, provenance, table

    if given["report"]:
        check_installed("--report")
    targets = () if given["report"] is None else (Path(given["report"]), Path(f"{given['report']}.json"))
    reads = {"a SCORES file": scores, "TRUTH": [truth], "--mask": [given["mask"] or ""]}
    with environment():
        check_targets(targets, reads, overwrite=given["overwrite"])
        check_ending(targets[0] if targets else None, "a page of HTML", ".html", ".htm")
    request = Request(scores, truth, **{f.name: given[f.name] for f in fields(Request) if f.name in given})
    start = time.perf_counter()
    with Console(given) as console, environment():
        checksum = Checksum([*scores, truth, *([request.mask] if request.mask else [])])
        found = evaluate(request, console.progress)
        made = provenance(request, command_line(*scores, truth), time.perf_counter() - start, checksum)
        numbers = plain(found.numbers | {"made": made})
        for note in numbers["notes"]:
            log.info("note: %s", note)
        if targets:
            with Scratch(overwrite=given["overwrite"]) as scratch:
                write_text(scratch, targets[0], page(found, made))
                write_json(scratch, targets[1], numbers)
            log.info("%s and %s: written in %.2f s", *targets, time.perf_counter() - start)
    if given["as_json"]:
        click.echo(json.dumps(numbers, indent=2))
    elif not given["quiet"]:
        click.echo("\n".join(table(numbers)))
# fmt: on
