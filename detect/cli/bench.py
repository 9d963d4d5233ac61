"""The command `rxdetect bench`: measure the error and run time of all methods of glint removal."""

import logging
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from deglint.cli import options
from deglint.cli.running import Console

from . import command_line

log = logging.getLogger(__name__)


# fmt: off
@click.command(cls=options.Grouped, context_settings=options.SETTINGS)
@click.argument("out", default="benchmark.html", type=options.FILE, metavar="[OUT.html]")
@options.heading("What to do")
@click.option("--quick", is_flag=True, help="One wind and small scenes: seconds, not minutes.")
@click.option("--only", multiple=True, callback=options.names, metavar="NAME[,NAME]",
              help="These methods, or 'default' (deglint remove without options). [default: all]")
@click.option("--seeds", type=click.IntRange(1, 1000), metavar="N",
              help="Scenes of each condition. [default: 5; with --quick 2]")
@options.heading("Output")
@click.option("--json", type=options.FILE, metavar="FILE", help="Where every number goes. [default: OUT.html.json]")
@click.option("--overwrite", is_flag=True, help="Replace outputs that exist.")
@options.messages
def bench(out: str, **given: Any) -> None:
    """Measure every removal method on simulated scenes: error, run time, objects found, ROC curves. Writes a page,
    OUT.html (by default benchmark.html), and every number, OUT.html.json.

    \b
    rxdetect bench --quick
    rxdetect bench report.html --only hedley,multiband,default --seeds 3
    """
    from deglint.raster.output import Scratch, write_json, write_text
    from deglint.raster.targets import check_ending, check_targets

    from ..bench import report
    from ..bench.numbers import load_now, provenance
    from ..bench.run import Effort, measure, removals
    from ..report.page import check_installed

    check_installed("rxdetect bench")
    targets = Path(out), Path(given["json"] or f"{out}.json")
    if targets[0] == targets[1]:
        raise click.UsageError(f"OUT.html and --json are both {out}: name two files.")
    if other := [name for name in given["only"] if name not in removals()]:
        raise click.BadParameter(f"{other[0]!r} is no method; there are {', '.join(removals())}.", param_hint="--only")
    wanted = [name for name in removals() if name in given["only"] or not given["only"]]
    effort = Effort.of(wanted, quick=given["quick"], seeds=given["seeds"])
    check_ending(targets[0], "a page of HTML", ".html", ".htm")
    check_ending(targets[1], "numbers in JSON", ".json")
    check_targets(targets, {}, overwrite=given["overwrite"])
    start, load = time.perf_counter(), load_now()
    with Console(given) as console:
        if not given["verbose"]:
            logging.getLogger("deglint").setLevel(logging.ERROR)  # without the messages of every removal
        with tempfile.TemporaryDirectory(prefix="rxdetect-") as place:
            found = measure(effort, Path(place), console.progress)
        for name, reason in found.refused.items():
            log.info("%s is left out: %s", name, reason)
        seconds = time.perf_counter() - start
        made = provenance(command_line(out), quick=given["quick"], seeds=effort.seeds, seconds=seconds, load=load)
        with Scratch(overwrite=given["overwrite"]) as scratch:
            write_text(scratch, targets[0], report.page(found, made))
            numbers = {name: asdict(number) for name, number in found.numbers().items()}
            write_json(scratch, targets[1], {"made": made, "numbers": numbers, "refused": found.refused})
        log.info("%s and %s: written in %.0f s", *targets, seconds)
# fmt: on
