"""`rxdetect bench`: every experiment in, one page and every number out; `rxdetect bench compare`: what changed."""

from __future__ import annotations

import logging
import shlex
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from deglint.cli.console import Console
from deglint.cli.options import names

from ..bench import EXPERIMENTS

if TYPE_CHECKING:
    from ..bench.collect import Collected

log = logging.getLogger(__name__)
SEEDS = {True: 2, False: 5}
"""Scenes of each kind, quick and not."""


class Bench(click.Command):
    """The benchmark; after the word `compare`, the comparison of two."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Of the command that the arguments are for."""
        if args[:1] == ["compare"]:
            from .compare import compare

            return compare.make_context(f"{info_name} compare", args[1:], parent, **extra)
        return super().make_context(info_name, args, parent, **extra)

    def format_epilog(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the experiments."""
        with formatter.section("Experiments"):
            formatter.write_dl(list(EXPERIMENTS.items()))


@click.command(cls=Bench, context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("out", default="benchmark.html", metavar="[OUT.html]")
@click.option("--quick", is_flag=True, help="Least of everything: under three minutes on two cores, not thirty.")
@click.option("--only", multiple=True, callback=names, metavar="NAME[,NAME]", help="These experiments alone.")
@click.option("--seeds", type=click.IntRange(1, 1000), metavar="N",
              help=f"Scenes of each kind. [default: {SEEDS[False]}; with --quick {SEEDS[True]}]")  # fmt: skip
@click.option("--json", "json_file", metavar="FILE", help="Where every number goes. [default: OUT.html.json]")
@click.option("--docs", metavar="DIR", help="Remake the page benchmark.md and its figures in this directory, too.")
@click.option("--peers", metavar="PYTHON", default="", help="Interpreter of an environment with other programs, such "
              "as sensingpy. [default: this one]")  # fmt: skip
@click.option("--scratch", metavar="DIR", help="Where scratch files go, up to 6 GB; --quick 0.1. [default: the "
              "system's temporary directory]")  # fmt: skip
@click.option("--overwrite", is_flag=True, help="Replace outputs that exist.")
@click.option("-v", "--verbose", count=True, help="Say more; -vv: a traceback where an experiment fails.")
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but errors.")
def bench(out: str, **given: Any) -> None:
    """Measure it all: error against truth, run time, skipping, digits, other programs. Writes a page, OUT.html, and
    every number, OUT.html.json.

    \b
    rxdetect bench --quick
    rxdetect bench report.html --only thesis,peers --seeds 3
    rxdetect bench compare OLD.json NEW.json          # what got better or worse; --help says more
    """  # fmt: skip
    from deglint.raster.output import Scratch, write_json, write_text
    from deglint.raster.targets import check_targets

    from ..bench.collect import as_json, collect
    from ..bench.machine import cores, load_now, provenance
    from ..bench.report import page
    from ..bench.section import Effort

    wanted = _wanted(given["only"])
    targets = Path(out), Path(given["json_file"] or f"{out}.json")
    if targets[0] == targets[1]:
        raise click.UsageError(f"OUT.html and --json are both {out}: name two files.")
    check_targets(targets, {"the interpreter": [given["peers"]]}, overwrite=given["overwrite"])
    docs = _docs(given)
    start, load = time.perf_counter(), load_now()
    with Console(given) as console:
        tell = _Progress(console, len(wanted))
        with tempfile.TemporaryDirectory(prefix="rxdetect-", dir=_scratch(given["scratch"])) as place:
            seeds = given["seeds"] or SEEDS[given["quick"]]
            effort = Effort(given["quick"], seeds, Path(place), cores(), given["peers"])
            found = collect(wanted, effort, tell.before, tell.after)
        made = provenance(_command(out, given), effort, found, load)
        with Scratch(overwrite=given["overwrite"]) as scratch:
            write_text(scratch, targets[0], page(found, made))
            write_json(scratch, targets[1], as_json(found, made))
        if docs is not None and not found.failed:
            _write_docs(docs, found, made)
        log.info("%s and %s: written in %.0f s", *targets, time.perf_counter() - start)
        if docs is not None:
            log.info("%s: %s", docs, "left as it was: an experiment failed" if found.failed else "remade")
    if given["verbose"] > 1:
        for trace in found.traces.values():
            click.echo(trace, err=True)
    if found.failed:
        raise click.exceptions.Exit(1)


class _Progress:
    """A line for each experiment."""

    def __init__(self, console: Console, total: int) -> None:
        self._console, self._total, self._done = console, total, 0

    def before(self, name: str) -> None:
        """It starts."""
        self._console.progress(name, self._done, self._total)

    def after(self, name: str, seconds: float, failure: str) -> None:
        """It ended."""
        self._done += 1
        log.info("%-10s %7.1f s", name, seconds)
        if failure:
            log.error("%s failed: %s", name, failure)


def _wanted(only: tuple[str, ...]) -> list[str]:
    """Experiments to run, in the order of the report."""
    from ..bench import present

    for name in only:
        if name not in present():
            raise click.BadParameter(f"{name!r} is no experiment; there are {', '.join(present())}.",
                                     param_hint="--only")  # fmt: skip
    return [name for name in present() if name in only or not only]


def _scratch(directory: str | None) -> str | None:
    """The directory for scratch files, if it is one that can be written to."""
    from deglint.raster.targets import check_target

    if directory is not None:
        check_target(Path(directory) / "scratch", overwrite=True)
    return directory


def _docs(given: dict[str, Any]) -> Path | None:
    """The documentation's page, if it is to be remade and can be."""
    from deglint.raster.targets import check_target

    from ..bench.markdown import PAGE

    if given["docs"] is None:
        return None
    if given["only"]:
        raise click.UsageError("--docs remakes the whole page: leave out --only.")
    page = Path(given["docs"]) / PAGE
    check_target(page, overwrite=True)
    return page


def _write_docs(page: Path, found: Collected, made: dict[str, Any]) -> None:
    """Write the documentation's page and its figures; figures that it had before and has no more go."""
    from deglint.raster.output import Scratch, write_text

    from ..bench.markdown import EMPTY, FOLDER, pages, stale

    files = pages(found, made, page.read_text(encoding="utf-8") if page.exists() else EMPTY)
    (page.parent / FOLDER).mkdir(exist_ok=True)
    with Scratch(overwrite=True) as scratch:
        for name, text in files.items():
            write_text(scratch, page.parent / name, text)
    for left in stale(page.parent, files):
        left.unlink()


def _command(out: str, given: dict[str, Any]) -> str:
    """The command line that does the same again, with every number that matters spelled out."""
    words = ["rxdetect", "bench", out, *["--quick"] * given["quick"]]
    words += ["--only", ",".join(given["only"])] if given["only"] else []
    words += ["--seeds", str(given["seeds"] or SEEDS[given["quick"]])]
    for key, flag in {"json_file": "--json", "docs": "--docs", "peers": "--peers", "scratch": "--scratch"}.items():
        words += [flag, given[key]] if given[key] else []
    return shlex.join([*words, *["--overwrite"] * given["overwrite"]])
