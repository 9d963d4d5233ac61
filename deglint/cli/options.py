"""Command-line options that several commands share, and parsers of their values."""

import contextlib
import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from typing import Any, get_args

import click
from click.shell_completion import CompletionItem

from ..checks import nearest
from .running import BoldContext

log = logging.getLogger(__name__)
SETTINGS = {"help_option_names": ["-h", "--help"], "show_default": True}  # click settings of a command
Decorator = Callable[[Callable[..., None]], Callable[..., None]]  # decorates the function of a command


class Grouped(click.Command):
    """click command whose `--help` lists options in groups (see `heading`), and explains the values of `--method`."""

    context_class = BoldContext

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options to the help text, group by group."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            if record := isinstance(parameter, click.Option) and parameter.get_help_record(ctx):
                groups.setdefault(getattr(parameter, "heading", "Messages"), []).append(record)
            if parameter.name == "method" and isinstance(parameter.type, ChoiceFromTable):
                groups["Methods"] = parameter.type.summaries()
        for text, records in groups.items():
            with formatter.section(text):
                formatter.write_dl(records)


def heading(text: str) -> Decorator:
    """Decorator that puts a heading above the options that follow it, up to the next heading."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        for option in vars(command)["__click_params__"]:
            option.heading = getattr(option, "heading", text)
        return command

    return decorate


class ChoiceFromTable(click.Choice[str]):
    """Option type with values `words` and entries of `table` (dict, tuple, Literal); `module` is imported on use."""

    def __init__(self, table: str, module: str, *words: str) -> None:
        self._table, self._module, self._words, self.case_sensitive = table, module, words, False

    @property
    def choices(self) -> tuple[str, ...]:  # type: ignore[override]
        """All allowed values of the option."""
        table = getattr(import_module(self._module), self._table)
        return (*self._words, *(get_args(table) or table))

    def summaries(self) -> list[tuple[str, str]]:
        """Name and summary of each entry of a table of methods, with the options that only this method takes."""
        table = getattr(import_module(self._module), self._table).items()
        rows = ((name, entry.summary, ", --".join(entry.options).replace("_", "-")) for name, entry in table)
        return [(name, f"{summary}; takes --{own}" if own else summary) for name, summary, own in rows]

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        """The error message of click, with the allowed value that is similar to `value`, if there is one."""
        said = super().get_invalid_choice_message(value, ctx).rstrip(".")
        return said + (nearest(str(value), list(self.choices)) or ".")


SENSOR_CHOICE = ChoiceFromTable("PRESETS", "deglint.physics.presets")
SKY_CHOICE = ChoiceFromTable("SKY_MODELS", "deglint.physics.sky")


class FileName(click.Path):
    """Option type for a file name, one of `words` or, if `presets`, a sensor preset; a shell completes all of them."""

    def __init__(self, *words: str, presets: bool = False) -> None:
        super().__init__(readable=False)
        self.name = "file"  # click shows it in capitals as the default metavar
        self._words, self._presets = words, presets

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value. If the option takes words and FILE, another word that is no file raises a usage error."""
        words = self._words if "FILE" in str(param and param.metavar) else ()
        if words and value.isalpha() and value not in words and not os.path.exists(value):  # noqa: PTH110
            hint = nearest(value, list(words)) or "."
            self.fail(f"{value!r} is not one of {', '.join(words)}, nor a file that is there{hint}", param, ctx)
        return super().convert(value, param, ctx)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Completions of the text `incomplete`: words of this type and sensor presets, then file names."""
        from ..sensors import names as presets

        words = (*self._words, *(presets() if self._presets else ()))
        found = [CompletionItem(word) for word in words if word.startswith(incomplete)]
        return found + super().shell_complete(ctx, param, incomplete)


FILE = FileName()
COUNT = click.IntRange(1, 1024)  # of threads or processes


def creation_options(_ctx: click.Context, _param: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    """click callback that converts texts "NAME=VALUE" to a dict {NAME: VALUE}; upper and lower case are kept."""
    if wrong := [text for text in values if text.find("=") < 1]:
        raise click.BadParameter(f"{wrong[0]!r} is not NAME=VALUE, such as COMPRESS=ZSTD.")
    return {name: value for name, _, value in (text.partition("=") for text in values)}


def names(_ctx: click.Context, _param: click.Parameter, values: tuple[str, ...]) -> tuple[str, ...]:
    """click callback that splits texts at commas: ("NIR1,NIR2", "NIR3") becomes ("NIR1", "NIR2", "NIR3")."""
    return tuple(part.strip() for text in values for part in text.split(",") if part.strip())


def parsed(read: Callable[[str], object], wrong: str) -> Callable[..., object]:
    """Make a click callback that converts each text by `read`; a ValueError becomes a usage error with text `wrong`."""

    def one(text: str) -> object:
        try:
            return read(text)
        except ValueError:
            raise click.BadParameter(f"{text!r} {wrong}") from None

    def callback(_ctx: click.Context, _param: click.Parameter, value: str | tuple[str, ...] | None) -> object:
        if value is None or isinstance(value, tuple):
            return value and tuple(map(one, value))
        return one(value)

    return callback


def place(option: str, metavar: str, said: str) -> Decorator:
    """Make an option for a file or a word of `metavar`, like "auto|none|FILE", by default the first; `said`: help."""
    words = [word for word in metavar.split("|") if word.islower()]
    return click.option(option, type=FileName(*words), default=words[0], metavar=metavar, help=said)


def bands_to(*option: str, shown: str, said: str) -> Decorator:
    """Make an option that takes bands, by names or numbers; `shown` describes its default, `said` is its help text."""
    metavar = "BAND[,BAND]"
    return click.option(*option, multiple=True, callback=names, metavar=metavar, show_default=shown, help=said)


def with_options(*options: Decorator) -> Decorator:
    """Decorator that adds several options to a command, in the order in which `--help` lists them."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


MEMORY_SHARE = "its share of the machine's"
SHARED_HELP = {
    "--co": "GDAL creation option, such as COMPRESS=ZSTD; OVERVIEWS=NONE leaves overviews out.",
    "--sensor": "Sensor preset (worldview3, sentinel2, planetscope, micasense, landsat8, ...) or a sensor file, "
    "for band properties that the input lacks.",
    "--bands": "Names of all bands in the file's order, such as 'blue,green,red,nir', if the file does not say them.",
    "--scale": "Physical value = number in the file times scale plus offset; one scale for all bands or one for each, "
    "in place of what the file says.",
    "--nodata": "Nodata value; none: all values are valid.",
    "--worker-memory": "With --workers: memory of each, such as 1GiB. A worker that needs more is ended, and its tiles "
    "are done again.",
    "--verbose": "Also log reasons for decisions; -vv: also a traceback after an error.",
}
"""Help texts that do not fit in the line of their option."""
threads = click.option(
    "--threads", type=COUNT, metavar="N", show_default="all processors", help="Threads; same result for any number."
)
creation = click.option(
    "--co", "options", multiple=True, callback=creation_options, metavar="NAME=VALUE", help=SHARED_HELP["--co"]
)
print_sidecar = with_options(
    heading("Messages"), click.option("--json", "as_json", is_flag=True, help="Print OUT.json on stdout, too.")
)
read_nodata = parsed(lambda text: text if text == "none" else float(text), "is not a number, nan or none.")
reading = with_options(
    heading("Input"),
    click.option("--sensor", type=FileName(presets=True), metavar="NAME|FILE.toml", help=SHARED_HELP["--sensor"]),
    click.option("--bands", "band_names", metavar="NAME,NAME,...", help=SHARED_HELP["--bands"]),
    click.option("--wavelengths", metavar="NM,NM,...", help="Centre wavelengths [nm], such as 475,560,668,842."),
    click.option("--scale", metavar="N[,N...]", help=SHARED_HELP["--scale"]),
    click.option("--offset", metavar="N[,N...]", help="Offset of the physical values, such as -0.1."),
    bands_to("--nir", shown="deduced from the wavelengths", said="NIR band by name or number (from 1)."),
    click.option("--nodata", callback=read_nodata, metavar="NUMBER|nan|none", help=SHARED_HELP["--nodata"]),
)
"""Options for reading the input."""
processing = with_options(
    heading("Processing"),
    click.option("--cluster", metavar="tcp://HOST:PORT", help="Work on this Dask cluster; its workers read the input."),
    click.option("--workers", type=COUNT, metavar="N", help="Work on N processes of this machine in place of threads."),
    click.option("--worker-memory", metavar="SIZE", show_default=MEMORY_SHARE, help=SHARED_HELP["--worker-memory"]),
    threads,
)
"""Options for threads, or a Dask cluster in place of them."""
messages = with_options(
    heading("Messages"),
    click.option("-v", "--verbose", count=True, show_default=False, help=SHARED_HELP["--verbose"]),
    click.option("-q", "--quiet", is_flag=True, help="Log errors only."),
)


def opening(given: Mapping[str, Any]) -> dict[str, Any]:
    """Convert the options for reading the input to keyword arguments of `deglint.open_scene`."""
    same = {name: given[name] for name in ("sensor", "nodata", "wavelengths", "scale", "offset")}
    return same | {"bands": given["band_names"]}


def needs_output(inputs: Sequence[str], output: str, command: str) -> None:
    """Raise a usage error if `inputs` is empty: the user gave one file name only, and click took it for the output."""
    if not inputs:
        stem, _, _ = output.rpartition(".")
        raise click.UsageError(
            f"OUT is missing: only {output} is named. Name the output, too: {command} {output} {stem or output}_out.tif"
        )


@contextlib.contextmanager
def cluster_of(given: dict[str, Any]) -> Iterator[Any]:
    """Provide the Dask cluster that the options select; for a dry run, or if they select none, provide None.

    Raises UsageError if options conflict. At the end, the memory of the workers is logged.
    """
    if given["worker_memory"] and given["workers"] is None:
        raise click.UsageError("--worker-memory limits the processes of --workers: give --workers, too.")
    if given["cluster"] is None and given["workers"] is None:
        yield None
        return
    if given["threads"] is not None:
        raise click.UsageError("--threads has no effect with --cluster or --workers: leave out --threads.")
    if given["cluster"] is not None and given["workers"] is not None:
        raise click.UsageError("--workers starts a cluster of its own: leave it out with --cluster.")
    from ..cluster import check_cluster, connect

    address, workers, memory = given["cluster"], given["workers"], given["worker_memory"] or "auto"
    if given.get("dry_run"):
        check_cluster(address, workers, memory)
        yield None
        return
    with connect(address, workers=workers, memory=memory) as cluster:
        yield cluster
        log.info("cluster: %d workers, largest peak memory %.0f MB", *cluster.numbers().values())
