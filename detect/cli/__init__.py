"""The command `rxdetect`. Each of its subcommands is a module, which is imported only when it is called."""

import shlex
import sys
from typing import NoReturn

import click
from click.core import ParameterSource

from deglint import __version__
from deglint.cli import running

COMMANDS = {
    "score": "score how anomalous every pixel is, and mark objects",
    "roc": "compare scores with truth: ROC curves, tables, a report",
    "bench": "measure run time and error of all removal methods: a report",
}


@click.group("rxdetect", cls=running.Commands, home=__name__, lines=COMMANDS)
@click.version_option(__version__, "--version", prog_name="rxdetect")
def cli() -> None:
    """Find anomalies in an image, and measure how well they are found.

    \b
    rxdetect score clean.tif scores.tif --pfa 1e-4 --objects found.geojson
    rxdetect roc scores.tif truth.tif --report roc.html
    rxdetect bench --quick
    """


def command_line(*arguments: str) -> str:
    """Text of the command that is running, with `arguments` and the options that the user gave, to run it again."""
    context = click.get_current_context()
    words = [*context.command_path.split(), *arguments]
    for option in context.command.params:
        source, value = context.get_parameter_source(option.name or ""), context.params.get(option.name or "")
        if isinstance(option, click.Option) and source is ParameterSource.COMMANDLINE:
            values = value if isinstance(value, tuple) else (value,)
            words += [option.opts[0]] + [",".join(map(str, values))] * (not option.is_flag and not option.count)
    return shlex.join(words)


def main() -> NoReturn:
    """Run the command; exit with its code: 0 success, 1 failure, 2 wrong usage, 3 nothing to score, 130 interrupted."""
    sys.exit(run(sys.argv[1:]))


run = cli.run  # function that runs the command with its arguments, and returns its exit code
