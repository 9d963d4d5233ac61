"""The command `deglint`: one module a command, loaded when it is called."""

from __future__ import annotations

import signal
import sys
from importlib import import_module
from typing import Any, NoReturn

import click

from .. import __version__
from ..errors import DeglintError, NoWaterError

COMMANDS = {"remove": "remove glint from a raster", "info": "say what a raster is and what it needs"}


class Commands(click.Group):
    """Loads a command's module when the command is called, so that `--help` is quick."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Names of the commands."""
        return list(COMMANDS)

    def get_command(self, _ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of this name."""
        if cmd_name not in COMMANDS:
            return None
        return getattr(import_module(f".{cmd_name}", __name__), cmd_name)

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without loading them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, "--version", prog_name="deglint")
def cli() -> None:
    """Find and remove sun glint in multispectral images of the sea.

    \b
    deglint remove scene.tif clean.tif --picture look.png
    deglint info scene.tif
    """


def main() -> NoReturn:
    """Run the command and leave with its exit code: 0 done, 1 failed, 2 usage, 3 no usable water."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run the command; what goes wrong becomes one line on stderr and an exit code."""
    verbose = any(a.startswith("-vv") for a in arguments)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        cli.main(arguments, prog_name="deglint", standalone_mode=False)
    except click.exceptions.Exit as error:
        return int(error.exit_code)
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("interrupted: nothing was written.", err=True)
        return 130
    except DeglintError as error:
        if verbose:
            raise
        click.echo(f"Error: {error}", err=True)
        return 3 if isinstance(error, NoWaterError) else 1
    except BrokenPipeError:
        return 1
    except MemoryError:
        if verbose:
            raise
        click.echo("Error: out of memory. Use fewer --threads, or a machine with more.", err=True)
        return 1
    return 0


def _interrupt(_signal: int, _frame: Any) -> NoReturn:
    raise KeyboardInterrupt
